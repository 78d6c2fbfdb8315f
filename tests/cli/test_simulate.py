import json
from itertools import product
from pathlib import Path

import meshio
import numpy as np
import pytest

from scleraforce.cli.main import run

COARSE = "[mesh]\ndivisions = 4\nlevel = 0\n"


@pytest.fixture
def study(tmp_path: Path) -> str:
    path = tmp_path / "study.toml"
    path.write_text(COARSE)
    return str(path)


def simulated(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert run(["simulate", *arguments, "--json"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return json.loads(captured.out)


def test_the_answer_has_the_promised_keys_and_the_mesh_of_the_study(study: str, capsys) -> None:
    answer = simulated(capsys, "--study", study, "--thickness-um", "800", "--force-mn", "10")
    assert {"tip_displacement_mm", "elements", "dofs", "seconds"} <= set(answer)
    assert (answer["elements"], answer["dofs"]) == (3 * 4**2, 3 * 3 * (9**2 + 4 * 9 * 4 - 4 * 4))
    assert 0.1 < answer["tip_displacement_mm"] < 1.0
    assert answer["stiffening"] == 0.0


def test_the_contact_sinks_in_proportion_to_the_force_and_against_the_modulus(study: str, capsys) -> None:
    wall = ("--study", study, "--thickness-um", "600", "--polar-angle-deg", "30")
    once, twice, stiff, none = (
        simulated(capsys, *wall, "--force-mn", force, "--youngs-modulus-mpa", modulus)["tip_displacement_mm"]
        for force, modulus in (("10", "0.25"), ("20", "0.25"), ("10", "0.5"), ("0", "0.25"))
    )
    assert twice == pytest.approx(2 * once, rel=1e-9)
    assert stiff == pytest.approx(once / 2, rel=1e-9)
    assert none == 0.0


def test_iop_and_gap_do_not_change_the_linear_tip_but_angle_and_thickness_do(study: str, capsys) -> None:
    def tip(*options: str) -> float:
        arguments = {
            "--thickness-um": "600",
            "--polar-angle-deg": "30",
            **dict(zip(options[::2], options[1::2], strict=True)),
        }
        flat = [word for pair in arguments.items() for word in pair]
        return simulated(capsys, "--study", study, "--force-mn", "10", *flat)["tip_displacement_mm"]

    base = tip()
    assert tip("--iop-mmhg", "10") == pytest.approx(base, rel=1e-6)
    assert tip("--gap-mm", "0.8") == pytest.approx(base, rel=1e-9)
    assert tip("--polar-angle-deg", "40") != pytest.approx(base, rel=1e-4)
    assert tip("--thickness-um", "700") < 0.9 * base


def test_files_are_written_and_named(study: str, tmp_path: Path, capsys) -> None:
    vtu, plot, page = tmp_path / "eye.vtu", tmp_path / "eye.png", tmp_path / "eye.html"
    command = ["simulate", "--study", study, "--thickness-um", "500", "--force-mn", "40"]
    assert run([*command, "--vtu", str(vtu), "--plot", str(plot), "--html", str(page)]) == 0
    out = capsys.readouterr().out
    assert str(vtu) in out
    assert "times the wall's thickness" in out  # the limit of the linear model is said
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "the contact sinks in" in page.read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["eye.html", "eye.png", "eye.vtu", "study.toml"]
    assert run([*command, "--plot", str(plot)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_bad_input_is_exit_code_2_and_one_line_that_names_it(study: str, capsys) -> None:
    for options, named in (
        ({"--thickness-um": "200"}, "thickness_um: 200 is below"),
        ({"--thickness-um": "1300"}, "thickness_um: 1300 is above"),
        ({"--force-mn": "-1"}, "'--force-mn': -1 is below"),
        ({"--force-mn": "nan"}, "--force-mn"),
        ({"--youngs-modulus-mpa": "0"}, "--youngs-modulus-mpa"),
        ({"--iop-mmhg": "100"}, "iop_mmhg"),
        ({"--polar-angle-deg": "85"}, "polar_angle_deg"),
        ({"--gap-mm": "-0.1"}, "--gap-mm"),
        ({"--mechanics": "magic"}, "linear"),
        ({"--vtu": "no/such/folder/eye.vtu"}, "no/such/folder"),
        ({"--study": "no-such-study.toml"}, "no-such-study.toml"),
    ):
        arguments = {"--study": study, "--thickness-um": "500", "--force-mn": "10", **options}
        assert run(["simulate", *(word for pair in arguments.items() for word in pair)]) == 2
        err = capsys.readouterr().err
        assert named in err
        assert err.count("\n") == 1


@pytest.mark.slow
def test_finite_strain_softens_past_the_thickness_and_the_study_or_the_option_asks_for_it(tmp_path, capsys) -> None:
    path = tmp_path / "finite.toml"
    path.write_text('[mesh]\ncore = 4\nrings = 6\n[mechanics]\nkind = "finite-strain"\n')
    options = ("--study", str(path), "--thickness-um", "800", "--youngs-modulus-mpa", "0.3")
    small, large, linear = (
        simulated(capsys, *options, *more)
        for more in (
            ("--force-mn", "3"),
            ("--force-mn", "24", "--vtu", str(tmp_path / "eye.vtu"), "--plot", str(tmp_path / "eye.png")),
            ("--force-mn", "24", "--mechanics", "linear"),
        )
    )
    assert [answer["mechanics"] for answer in (small, large, linear)] == ["finite-strain", "finite-strain", "linear"]
    assert large["elements"] == 4**2 + 6 * 16
    assert large["tip_displacement_mm"] > 8.5 * small["tip_displacement_mm"]  # 8 times the force
    assert large["tip_displacement_mm"] > 1.1 * linear["tip_displacement_mm"]
    mesh = meshio.read(tmp_path / "eye.vtu")
    assert (
        np.linalg.norm(mesh.point_data["needle_displacement"], axis=1).max() * 1e3 > 0.9 * large["tip_displacement_mm"]
    )
    assert (tmp_path / "eye.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_sealed_eye_gives_way_less_and_tells_its_pressure(tmp_path: Path, capsys) -> None:
    path = tmp_path / "study.toml"
    path.write_text('[mesh]\nkind = "graded"\ncore = 4\nrings = 6\n[mechanics]\nkind = "finite-strain"\n')
    wall = ("--study", str(path), "--thickness-um", "600", "--force-mn", "25", "--youngs-modulus-mpa", "0.45")
    opened = simulated(capsys, *wall)
    sealed = simulated(capsys, *wall, "--globe", "sealed", "--rigidity", "0.03")
    assert (opened["globe"], sealed["globe"]) == ("open", "sealed")
    assert opened["pressure_mmhg"] == pytest.approx(2.0)
    assert opened["dent_mm"] == opened["tip_displacement_mm"]
    assert sealed["pressure_mmhg"] > 3.0
    assert sealed["tip_displacement_mm"] < sealed["dent_mm"] < opened["dent_mm"]
    assert run(["simulate", *wall, "--globe", "sealed"]) == 0
    assert "the pressure rises from 2 to " in capsys.readouterr().out


def test_a_rigidity_of_an_open_globe_is_refused(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    commands = (("simulate", "--force-mn", "25"), ("phantom", "--out", "eye"))
    globes, rigidities = ((), ("--globe", "open")), ("0.02", "0.03")  # the last is the default's
    for command, globe, rigidity in product(commands, globes, rigidities):
        given = ("--thickness-um", "600", "--mechanics", "finite-strain", "--rigidity", rigidity)
        assert run([*command, *given, *globe]) == 2
        assert "--rigidity: of a sealed globe" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
