"""`simulate`: options reach the model, files are written, bad input is one line."""

from pathlib import Path

import meshio
import numpy as np
import pytest

COARSE = "[mesh]\ndivisions = 4\nlevel = 0\n"
FINITE = '[mesh]\ncore = 4\nrings = 6\n[mechanics]\nkind = "finite-strain"\n'


@pytest.fixture
def study(tmp_path: Path) -> Path:
    (tmp_path / "study.toml").write_text(COARSE)
    return tmp_path / "study.toml"


def test_each_option_reaches_the_linear_model(study: Path, shell) -> None:
    wall = {"--thickness-um": 600, "--polar-angle-deg": 30, "--force-mn": 10, "--youngs-modulus-mpa": 0.25}

    def tip_mm(**changed: float) -> float:
        options = wall | {f"--{name.replace('_', '-')}": value for name, value in changed.items()}
        answer = shell.json("simulate", "--study", study, *(word for pair in options.items() for word in pair))
        assert (answer["elements"], answer["dofs"]) == (3 * 4**2, 3 * 3 * (9**2 + 4 * 9 * 4 - 4 * 4))
        assert {"seconds", "globe", "mechanics", "stiffening", "dent_mm", "pressure_mmhg"} <= answer.keys()
        return answer["tip_displacement_mm"]

    base = tip_mm()
    assert 0.1 < base < 1.0
    assert tip_mm(force_mn=20) == pytest.approx(2 * base, rel=1e-9)
    assert tip_mm(youngs_modulus_mpa=0.5) == pytest.approx(base / 2, rel=1e-9)
    assert tip_mm(force_mn=0) == 0.0
    assert tip_mm(iop_mmhg=10) == pytest.approx(base, rel=1e-6)  # neither pressure nor gap changes a linear tip
    assert tip_mm(gap_mm=0.8) == pytest.approx(base, rel=1e-9)
    assert tip_mm(polar_angle_deg=40) != pytest.approx(base, rel=1e-4)
    assert tip_mm(thickness_um=700) < 0.9 * base


def test_files_are_written_and_named(study: Path, tmp_path: Path, shell) -> None:
    vtu, plot = tmp_path / "eye.vtu", tmp_path / "eye.png"
    command = ["simulate", "--study", study, "--thickness-um", 500, "--force-mn", 40]
    out, _ = shell.run(*command, "--vtu", vtu, "--plot", plot)
    assert str(vtu) in out
    assert "times the wall's thickness" in out  # a limit of linear mechanics
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["eye.png", "eye.vtu", "study.toml"]
    assert "exists already" in shell.refused(*command, "--plot", plot)


def test_the_force_of_a_displacement_is_found(study: Path, shell) -> None:
    wall = ("simulate", "--study", study, "--thickness-um", 600)
    pushed = shell.json(*wall, "--force-mn", 12.5)
    found = shell.json(*wall, "--displacement-mm", pushed["tip_displacement_mm"])
    assert found["force_mn"] == pytest.approx(12.5)
    assert found["tip_displacement_mm"] == pytest.approx(pushed["tip_displacement_mm"])
    for both in ((), ("--force-mn", 10, "--displacement-mm", 1)):
        assert "give either --force-mn or --displacement-mm" in shell.refused(*wall, *both)
    assert "'--displacement-mm': 11 is above the largest" in shell.refused(*wall, "--displacement-mm", 11)


def test_bad_input_is_one_line_that_names_it(study: Path, shell) -> None:
    for option, value, named in (
        ("--thickness-um", 200, "thickness_um: 200 is below"),
        ("--force-mn", -1, "'--force-mn': -1 is below"),
        ("--force-mn", "nan", "--force-mn"),
        ("--iop-mmhg", 100, "iop_mmhg"),
        ("--polar-angle-deg", 85, "polar_angle_deg"),
        ("--gap-mm", -0.1, "--gap-mm"),
        ("--mechanics", "magic", "linear"),
        ("--rigidity", 0.03, "--rigidity: of a sealed globe"),  # which is the default's
        ("--vtu", "no/such/folder/eye.vtu", "no/such/folder"),
        ("--study", "no-such-study.toml", "no-such-study.toml"),
    ):
        arguments = {"--study": study, "--thickness-um": 500, "--force-mn": 10, option: value}
        assert named in shell.refused("simulate", *(word for pair in arguments.items() for word in pair))


@pytest.mark.slow
def test_finite_strain_stiffens_and_comes_from_the_study_or_the_option(tmp_path: Path, shell) -> None:
    (tmp_path / "finite.toml").write_text(FINITE)
    wall = ("simulate", "--study", tmp_path / "finite.toml", "--thickness-um", 800, "--youngs-modulus-mpa", 0.3)
    small = shell.json(*wall, "--force-mn", 3)
    large = shell.json(*wall, "--force-mn", 24, "--vtu", tmp_path / "eye.vtu", "--plot", tmp_path / "eye.png")
    linear = shell.json(*wall, "--force-mn", 24, "--mechanics", "linear")
    assert [answer["mechanics"] for answer in (small, large, linear)] == ["finite-strain", "finite-strain", "linear"]
    assert large["elements"] == 4**2 + 6 * 16
    assert large["tip_displacement_mm"] > 8.5 * small["tip_displacement_mm"]  # 8 times the force
    assert large["tip_displacement_mm"] > 1.1 * linear["tip_displacement_mm"]
    moved_mm = np.linalg.norm(meshio.read(tmp_path / "eye.vtu").point_data["needle_displacement"], axis=1).max() * 1e3
    assert moved_mm > 0.9 * large["tip_displacement_mm"]
    assert (tmp_path / "eye.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_sealed_eye_gives_way_less_and_its_pressure_rises(tmp_path: Path, shell) -> None:
    (tmp_path / "study.toml").write_text(FINITE)
    wall = ("simulate", "--study", tmp_path / "study.toml", "--thickness-um", 600, "--force-mn", 25)
    wall += ("--youngs-modulus-mpa", 0.45)
    opened, sealed = shell.json(*wall), shell.json(*wall, "--globe", "closed", "--rigidity", 0.03)
    assert (opened["globe"], sealed["globe"]) == ("open", "sealed")
    assert opened["pressure_mmhg"] == pytest.approx(2.0)
    assert opened["dent_mm"] == opened["tip_displacement_mm"]
    assert sealed["pressure_mmhg"] > 3.0
    assert sealed["tip_displacement_mm"] < sealed["dent_mm"] < opened["dent_mm"]
    assert "the pressure rises from 2 to " in shell.text(*wall, "--globe", "sealed")
    again = shell.json(*wall[:5], *wall[7:], "--globe", "sealed", "--displacement-mm", sealed["tip_displacement_mm"])
    for name in ("force_mn", "dent_mm", "pressure_mmhg", "tip_displacement_mm"):
        assert again[name] == pytest.approx(sealed[name], rel=1e-3)
