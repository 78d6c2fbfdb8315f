"""`scleraforce calibrate` from its arguments to its file and its figures."""

import json
from dataclasses import replace

import pytest

from scleraforce.front.cli.main import run
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.study import Study, format_study
from virtual_eyes import wall_of


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [
        ["--mechanics", "linear"],
        ["--method", "roukf"],
        ["--method", "roukf", "--mechanics", "linear"],
    ],
)
def test_it_writes_the_posterior_and_the_picture_and_prints_one_json_object(
    laboratory,
    virtual_folder,
    tmp_path,
    capsys,
    eye,
    method: list[str],
):
    study = tmp_path / "study.toml"
    study.write_text(format_study(laboratory.study))
    out = tmp_path / "out.json"
    plot = tmp_path / "out.png"
    options = ["--study", study, "--out", out, *method, "--plot", plot]
    assert run(["calibrate", str(virtual_folder), *map(str, options), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("notes") == []
    assert printed == json.loads(out.read_text())
    assert printed["mechanics"] == "linear"
    assert printed["eyes"]["virtual"]["mean_mpa"] == pytest.approx(
        wall_of(eye).youngs_modulus_pa / 1e6, rel=0.04
    )
    frames = [frame["file"] for frame in printed["eyes"]["virtual"]["frames"]]
    assert frames == [f"000{number}.png" for number in range(2, 7)]
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert set(tmp_path.iterdir()) == {study, out, plot}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("relaxation", "shares", "words"),
    [
        ("none", [], "declared: tissue is elastic"),
        ("0.12:1.2", [0.12], "declared: tissue relaxes"),
    ],
)
def test_finite_strain_is_the_default_and_takes_the_cached_library_and_what_is_declared(
    made_up_folder,
    library,
    tmp_path,
    monkeypatch,
    capsys,
    relaxation: str,
    shares: list[float],
    words: str,
):
    """Another study than the paper's, whose library is bundled."""
    study = Study()
    other = replace(study, library=replace(study.library, tips=study.library.tips - 1))
    (tmp_path / "study.toml").write_text(format_study(other))
    asked = list[Study]()
    monkeypatch.setattr(
        "scleraforce.library.library_store.cached_library",
        lambda study, **_: asked.append(study) or library,
    )
    out = tmp_path / "out.json"
    options = ["--study", tmp_path / "study.toml", "--out", out, "--frames", 2]
    arguments = ["calibrate", made_up_folder, *options, "--relaxation", relaxation]
    assert run(list(map(str, arguments))) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    assert [one.library.tips for one in asked] == [study.library.tips - 1]
    written = read_calibration(out)
    assert written.mechanics == "finite-strain"
    assert shares or written.eyes["made-up"].eye.modulus_pa == pytest.approx(
        0.27e6, rel=0.1
    )
    assert len(written.digests) == 2
    found = json.loads(out.read_text())["eyes"]["made-up"]["relaxation"]
    assert (found["source"], found["shares"]) == ("declared", shares)
    assert found["finding"] is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--parameters", "iop"], "error: --parameters: "),
        (["--parameters", "e,stiffness"], "error: --parameters: "),
        (
            ["--parameters", "stiffening,iop,e", "--mechanics", "linear"],
            "error: --parameters: linear mechanics knows no tissue that stiffens",
        ),
        (["--relaxation", "elastic"], "give none, or SHARE:SECONDS"),
        (["--relaxation", "0.7:1,0.7:2"], "add up to less than 1"),
        (["--relaxation", "none", "--mechanics", "linear"], "linear mechanics knows"),
        (["--without-force", "--mechanics", "linear"], "finds E at finite strain"),
        (
            ["--without-force", "--method", "roukf"],
            "error: --without-force: finds E at finite strain; leave out --method,"
            " --mechanics and --parameters",
        ),
        (
            ["--method", "roukf", "--mechanics", "finite-strain"],
            "error: --method: roukf has linear mechanics, not finite-strain; leave out"
            " --mechanics or --method",
        ),
        (
            ["--method", "ours", "--mechanics", "linear"],
            "error: --method: ours has finite-strain mechanics, not linear; leave out",
        ),
        (
            ["--method", "roukf", "--parameters", "e,stiffening"],
            "error: --parameters: linear mechanics knows no tissue that stiffens",
        ),
        (["--method", "roukf", "--relaxation", "none"], "linear mechanics knows"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    virtual_folder,
    tmp_path,
    capsys,
    options: list[str],
    words: str,
):
    out = str(tmp_path / "o.json")
    assert run(["calibrate", str(virtual_folder), "--out", out, *options]) == 2
    printed = capsys.readouterr()
    (line,) = (text for text in printed.err.splitlines() if text.strip())
    assert words in line
    assert (printed.out, list(tmp_path.iterdir())) == ("", [])


def test_an_existing_file_is_not_overwritten(virtual_folder, capsys, tmp_path):
    there = tmp_path / "there.json"
    there.write_text("mine")
    assert run(["calibrate", str(virtual_folder), "--out", str(there)]) == 2
    assert there.read_text() == "mine"
    assert "exists already" in capsys.readouterr().err
