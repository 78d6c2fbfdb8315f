"""`scleraforce calibrate` from its arguments to its file and its figures."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ideal_boundaries import virtual_sections
from scleraforce.front.cli.main import run
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.library import Library
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, format_study
from virtual_eyes import wall_of


@pytest.fixture(scope="module")
def folder(
    laboratory: Any, eye: Setup, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    folder = tmp_path_factory.mktemp("command")
    wall = laboratory.wall(wall_of(eye).thickness_m)
    study = laboratory.study
    plan = plan_phantom(eye, (0.03, 0.015, 0.04), study, 5)
    write_phantom(
        folder / "eye",
        plan,
        lambda forces: virtual_sections(wall, eye, forces, study),
        study,
    )
    (folder / "study.toml").write_text(format_study(study))

    return folder


@pytest.mark.slow
def test_it_writes_the_posterior_and_the_picture_and_prints_one_json_object(
    folder: Path, capsys: pytest.CaptureFixture[str], eye: Setup
) -> None:
    out = folder / "out.json"
    plot = folder / "out.png"
    arguments = [
        "calibrate",
        str(folder / "eye"),
        "--study",
        str(folder / "study.toml"),
        "--out",
        str(out),
    ]
    assert (
        run([*arguments, "--mechanics", "linear", "--plot", str(plot), "--json"]) == 0
    )
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("notes") == []
    assert printed == json.loads(out.read_text())
    assert printed["mechanics"] == "linear"
    assert printed["eyes"]["virtual"]["mean_mpa"] == pytest.approx(
        wall_of(eye).youngs_modulus_pa / 1e6, rel=0.04
    )
    assert printed["population"]["mean_mpa"] == printed["eyes"]["virtual"]["mean_mpa"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in folder.iterdir()) == [
        "eye",
        "out.json",
        "out.png",
        "study.toml",
    ]


@pytest.mark.slow
def test_finite_strain_is_the_default_and_takes_the_cached_library(
    made_up_folder: Path,
    library: Library,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another study than the paper's, whose library is bundled."""
    study = Study()
    asked = list[Study]()
    other = replace(study, library=replace(study.library, tips=study.library.tips - 1))
    (tmp_path / "study.toml").write_text(format_study(other))

    def cached(
        study: Study, *, workers: int | None, progress: Callable[[int], None]
    ) -> Library:
        assert workers is None
        asked.append(study)
        progress(10)
        return library

    monkeypatch.setattr("scleraforce.library.library_store.cached_library", cached)
    out = tmp_path / "out.json"
    arguments = [
        "calibrate",
        str(made_up_folder),
        "--study",
        str(tmp_path / "study.toml"),
        "--out",
        str(out),
    ]
    assert run([*arguments, "--frames", "2"]) == 0
    written = read_calibration(out)
    assert written.mechanics == "finite-strain"
    eye = written.eyes["made-up"].eye
    assert eye.modulus_pa == pytest.approx(0.27e6, rel=0.1)
    assert eye.thickness_m == pytest.approx(0.7e-3)
    assert len(written.digests) == 2
    assert [one.library.tips for one in asked] == [study.library.tips - 1]


def test_an_existing_file_is_not_overwritten(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    there = tmp_path / "there.json"
    there.write_text("mine")
    assert run(["calibrate", str(folder / "eye"), "--out", str(there)]) == 2
    assert there.read_text() == "mine"
    assert "exists already" in capsys.readouterr().err


def test_parameters_that_cannot_be_are_refused_in_one_line(
    folder: Path, tmp_path: Path, capsys
) -> None:
    arguments = [
        "calibrate",
        str(folder / "eye"),
        "--out",
        str(tmp_path / "o.json"),
        "--parameters",
    ]
    for parameters in ("iop", "e,e", "e,stiffness"):
        assert run([*arguments, parameters]) == 2
        assert "error: --parameters: " in capsys.readouterr().err

    for parameters in ("e,stiffening", "stiffening,iop,e"):
        assert run([*arguments, parameters, "--mechanics", "linear"]) == 2
        printed = capsys.readouterr()
        (line,) = (text for text in printed.err.splitlines() if text.strip())
        assert (
            line
            == "error: --parameters: linear mechanics knows no tissue that stiffens;"
            " leave out stiffening"
        )
        assert (printed.out, list(tmp_path.iterdir())) == ("", [])


def test_a_relaxation_that_cannot_be_is_refused_in_one_line(
    folder: Path, tmp_path: Path, capsys
) -> None:
    arguments = [
        "calibrate",
        str(folder / "eye"),
        "--out",
        str(tmp_path / "o.json"),
        "--relaxation",
    ]
    for text, words in (
        ("elastic", "give none, or SHARE:SECONDS"),
        ("0.7:1,0.7:2", "add up to less than 1"),
    ):
        assert run([*arguments, text]) == 2
        assert words in capsys.readouterr().err

    assert run([*arguments, "none", "--mechanics", "linear"]) == 2
    assert "linear mechanics knows none" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "shares", "words"),
    [
        ("none", [], "declared: tissue is elastic"),
        ("0.12:1.2", [0.12], "declared: tissue relaxes"),
    ],
)
def test_a_declared_relaxation_is_used_and_said(
    made_up_folder: Path, tmp_path: Path, capsys, text, shares, words
) -> None:
    arguments = ["calibrate", str(made_up_folder), "--frames", "2", "--out"]
    assert run([*arguments, str(tmp_path / "o.json"), "--relaxation", text]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    written = json.loads((tmp_path / "o.json").read_text())
    relaxation = written["eyes"]["made-up"]["relaxation"]
    assert (relaxation["source"], relaxation["shares"]) == ("declared", shares)
    assert relaxation["finding"] is None
