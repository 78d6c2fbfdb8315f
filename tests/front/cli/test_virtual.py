"""`simulate` and `scanner`: options reach the model, files are written, bad input is
one line.
"""

from pathlib import Path

import cv2
import meshio
import numpy as np
import pytest
from analytic_frames import drawn_counts

from scleraforce.records.study import Range, Study, read_study

COARSE = "[mesh]\ndivisions = 4\nlevel = 0\n"
FINITE = '[mesh]\ncore = 4\nrings = 6\n[mechanics]\nkind = "finite-strain"\n'


@pytest.fixture
def simulate(shell, tmp_path: Path):
    """Simulate a coarse eye of 600 µm; return the object."""
    (tmp_path / "study.toml").write_text(COARSE)

    def run(*options: object) -> dict:
        study = f"--study {tmp_path}/study.toml --thickness-um 600"
        return shell.json("simulate", study, *options)

    return run


LINEAR = "--polar-angle-deg 30 --force-mn 10 --youngs-modulus-mpa 0.25"


def test_each_option_reaches_the_linear_model(simulate) -> None:
    def tip_mm(*options: str) -> float:
        return simulate(LINEAR, *options)["tip_displacement_mm"]

    answer = simulate(LINEAR)
    base = answer["tip_displacement_mm"]
    assert answer["elements"] == 3 * 4**2
    assert answer["dofs"] == 3 * 3 * (9**2 + 4 * 9 * 4 - 4 * 4)
    assert 0.1 < base < 1.0
    assert tip_mm("--force-mn 20") == pytest.approx(2 * base, rel=1e-9)
    assert tip_mm("--youngs-modulus-mpa 0.5") == pytest.approx(base / 2, rel=1e-9)
    assert tip_mm("--force-mn 0") == 0.0
    # neither pressure nor gap changes a linear tip
    assert tip_mm("--iop-mmhg 10") == pytest.approx(base, rel=1e-6)
    assert tip_mm("--gap-mm 0.8") == pytest.approx(base, rel=1e-9)
    assert tip_mm("--polar-angle-deg 40") != pytest.approx(base, rel=1e-4)
    assert tip_mm("--thickness-um 700") < 0.9 * base


def test_the_force_of_a_displacement_is_found(simulate) -> None:
    tip_mm = simulate("--force-mn 12.5")["tip_displacement_mm"]
    found = simulate("--displacement-mm", tip_mm)
    assert found["force_mn"] == pytest.approx(12.5)
    assert found["tip_displacement_mm"] == pytest.approx(tip_mm)


def test_files_are_written_and_named(tmp_path: Path, shell, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(COARSE)
    command = "simulate --study study.toml --thickness-um 500 --force-mn 40"
    out, _ = shell.run(command, "--vtu eye.vtu --plot eye.png")
    assert "eye.vtu" in out
    assert "times the wall's thickness" in out  # a limit of linear mechanics
    assert Path("eye.png").read_bytes().startswith(b"\x89PNG")
    names = ["eye.png", "eye.vtu", "study.toml"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert "exists already" in shell.refused(command, "--plot eye.png")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ("", "give either --force-mn or --displacement-mm"),
        ("--force-mn 10 --displacement-mm 1", "give either --force-mn or"),
        ("--displacement-mm 11", "'--displacement-mm': 11 is above the largest"),
        ("--force-mn -1", "'--force-mn': -1 is below"),
        ("--force-mn nan", "--force-mn"),
        ("--force-mn 1 --iop-mmhg 100", "iop_mmhg"),
        ("--force-mn 1 --gap-mm -0.1", "--gap-mm"),
        ("--force-mn 1 --mechanics magic", "linear"),
        # which is the default's
        ("--force-mn 1 --rigidity 0.03", "--rigidity: of a sealed globe"),
        ("--force-mn 1 --vtu no/such/folder/eye.vtu", "no/such/folder"),
        ("--force-mn 1 --study no-such-study.toml", "no-such-study.toml"),
    ],
)
def test_bad_input_is_one_line_that_names_it(shell, options: str, named: str) -> None:
    assert named in shell.refused("simulate --thickness-um 600", options)


@pytest.mark.slow
def test_finite_strain_stiffens_and_comes_from_the_study_or_the_option(
    tmp_path: Path, shell
) -> None:
    (tmp_path / "finite.toml").write_text(FINITE)
    study = f"--study {tmp_path}/finite.toml --thickness-um 800"
    wall = f"simulate {study} --youngs-modulus-mpa 0.3 --force-mn"
    files = f"--vtu {tmp_path}/eye.vtu --plot {tmp_path}/eye.png"
    answers = small, large, linear = (
        shell.json(wall, "3"),
        shell.json(wall, "24", files),
        shell.json(wall, "24 --mechanics linear"),
    )
    kinds = [answer["mechanics"] for answer in answers]
    assert kinds == ["finite-strain", "finite-strain", "linear"]
    assert large["elements"] == 4**2 + 6 * 16
    # 8 times the force
    tip_mm = large["tip_displacement_mm"]
    assert tip_mm > 8.5 * small["tip_displacement_mm"]
    assert tip_mm > 1.1 * linear["tip_displacement_mm"]
    moved_m = meshio.read(tmp_path / "eye.vtu").point_data["needle_displacement"]
    assert 1e3 * np.linalg.norm(moved_m, axis=1).max() > 0.9 * tip_mm
    assert (tmp_path / "eye.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_sealed_eye_gives_way_less_and_its_pressure_rises(
    tmp_path: Path, shell
) -> None:
    (tmp_path / "study.toml").write_text(FINITE)
    study = f"--study {tmp_path}/study.toml --thickness-um 600"
    wall = f"simulate {study} --youngs-modulus-mpa 0.45"
    opened = shell.json(wall, "--force-mn 25")
    sealed = shell.json(wall, "--force-mn 25 --globe closed --rigidity 0.03")
    tip_mm = sealed["tip_displacement_mm"]
    assert (opened["globe"], sealed["globe"]) == ("open", "sealed")
    assert opened["pressure_mmhg"] == pytest.approx(2.0)
    assert opened["dent_mm"] == opened["tip_displacement_mm"]
    assert sealed["pressure_mmhg"] > 3.0
    assert tip_mm < sealed["dent_mm"] < opened["dent_mm"]
    text = shell.text(wall, "--force-mn 25 --globe sealed")
    assert "the pressure rises from 2 to " in text
    again = shell.json(wall, "--globe sealed --displacement-mm", tip_mm)
    for name in ("force_mn", "dent_mm", "pressure_mmhg", "tip_displacement_mm"):
        assert again[name] == pytest.approx(sealed[name], rel=1e-3)


REAL = Path(__file__).parents[4] / "shared" / "real-oct" / "anterior-segment"
SIZE = "--width-mm 15 --depth-mm 4"
SCALE = f"{SIZE} --bits 12"


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("frames")
    for number in range(2):
        cv2.imwrite(str(folder / f"{number}.png"), drawn_counts(7700 + number))
    return sorted(folder.iterdir())


@pytest.fixture
def scanner(shell, tmp_path: Path):
    """Measure frames; return the object and the study that is written."""

    def measured(
        *arguments: object, out: Path = tmp_path / "study.toml"
    ) -> tuple[dict, Study]:
        return shell.json("scanner", *arguments, "--out", out), read_study(out)

    return measured


@pytest.fixture
def refused(shell, tmp_path: Path):
    def refuse(*arguments: object, out: str = "study.toml") -> str:
        before = sorted(tmp_path.iterdir())
        message = shell.refused("scanner", *arguments, "--out", tmp_path / out)
        assert sorted(tmp_path.iterdir()) == before
        return message

    return refuse


def test_it_writes_a_study_and_its_picture_and_reports_what_it_measured(
    frames, scanner, tmp_path: Path
) -> None:
    result, study = scanner(*frames, SCALE)
    assert result["frames"] == 2
    measured = {name: one["median"] for name, one in result["measured"].items()}
    assert measured["snr_db"] == pytest.approx(22.0, abs=1.0)
    assert measured["axial_resolution_um"] == pytest.approx(8.0, rel=0.1)
    assert result["counts"] == {"shadow_count": [0, 0], "line_count": [0, 0]}
    assert "shadow_loss_percent" in result["not_measured"]
    assert "roll_off_db_per_mm" in {**result["not_drawn"], **result["not_measured"]}
    assert result["histogram_overlap"] > 0.97
    assert (study.oct.columns, study.oct.rows, study.oct.bits) == (512, 512, 12)
    assert isinstance(study.phantom.snr_db, Range)
    assert (tmp_path / "study.png").read_bytes().startswith(b"\x89PNG")


def test_a_study_or_picture_that_is_there_stays(
    frames, tmp_path: Path, refused
) -> None:
    for name in ("study.toml", "study.png"):
        (tmp_path / name).write_text("mine")
        assert "exists already" in refused(*frames, SCALE)
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()
    assert ".toml" in refused(*frames, SCALE, out="study.txt")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--bits 12", "--width-mm"),
        (SIZE, "--bits"),
        (f"{SIZE} --bits 8", "--bits says 8"),
    ],
)
def test_a_frame_without_size_or_bits_is_refused(
    frames, refused, options: str, words: str
) -> None:
    assert words in refused(*frames, options)


def air_of_one_colour() -> np.ndarray:
    counts = drawn_counts(7803)
    counts[:40] = 500
    return np.where(counts < 1400, 500, counts)


@pytest.mark.parametrize(
    ("counts", "others", "words"),
    [
        (lambda: np.full((512, 512), 700), 0, "bad.png: the frame is empty"),
        (lambda: drawn_counts(7802)[:400], 1, "another size"),
        (air_of_one_colour, 0, "the air above the tissue is of one colour"),
    ],
    ids=["empty", "size", "air"],
)
def test_frames_on_which_nothing_can_be_measured_are_refused(
    frames, tmp_path: Path, refused, counts, others: int, words: str
) -> None:
    bad = tmp_path / "bad.png"
    cv2.imwrite(str(bad), counts().astype(np.uint16))
    assert words in refused(*frames[:others], bad, SCALE)


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="../shared is absent")
def test_real_frames_of_one_scanner_have_one_display(scanner, tmp_path: Path) -> None:
    """Averaged frames: by their noise alone the displays would span 70 to 117 dB."""
    ranges_db = []
    for name in ("003", "083", "105"):
        size = "--width-mm 6.4 --depth-mm 4.265"
        out = tmp_path / f"{name}.toml"
        result, study = scanner(REAL / f"{name}.jpeg", size, out=out)
        assert study.oct.bits == 8
        assert 2.0 < result["not_drawn"]["noise_looks"]["median"] < 10.0
        ranges_db.append(result["measured"]["display_range_db"]["median"])

    assert max(ranges_db) - min(ranges_db) < 10.0
