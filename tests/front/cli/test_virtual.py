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
def study(tmp_path: Path) -> Path:
    (tmp_path / "study.toml").write_text(COARSE)
    return tmp_path / "study.toml"


def test_each_option_reaches_the_linear_model(study: Path, shell) -> None:
    wall = {
        "--thickness-um": 600,
        "--polar-angle-deg": 30,
        "--force-mn": 10,
        "--youngs-modulus-mpa": 0.25,
    }

    def tip_mm(**changed: float) -> float:
        options = wall | {
            f"--{name.replace('_', '-')}": value for name, value in changed.items()
        }
        answer = shell.json(
            "simulate",
            "--study",
            study,
            *(word for pair in options.items() for word in pair),
        )
        assert (answer["elements"], answer["dofs"]) == (
            3 * 4**2,
            3 * 3 * (9**2 + 4 * 9 * 4 - 4 * 4),
        )
        assert {
            "seconds",
            "globe",
            "mechanics",
            "stiffening",
            "dent_mm",
            "pressure_mmhg",
        } <= answer.keys()

        return answer["tip_displacement_mm"]

    base = tip_mm()
    assert 0.1 < base < 1.0
    assert tip_mm(force_mn=20) == pytest.approx(2 * base, rel=1e-9)
    assert tip_mm(youngs_modulus_mpa=0.5) == pytest.approx(base / 2, rel=1e-9)
    assert tip_mm(force_mn=0) == 0.0
    # neither pressure nor gap changes a linear tip
    assert tip_mm(iop_mmhg=10) == pytest.approx(base, rel=1e-6)
    assert tip_mm(gap_mm=0.8) == pytest.approx(base, rel=1e-9)
    assert tip_mm(polar_angle_deg=40) != pytest.approx(base, rel=1e-4)
    assert tip_mm(thickness_um=700) < 0.9 * base


def test_the_force_of_a_displacement_is_found(study: Path, shell) -> None:
    wall = ("simulate", "--study", study, "--thickness-um", 600)
    pushed = shell.json(*wall, "--force-mn", 12.5)
    found = shell.json(*wall, "--displacement-mm", pushed["tip_displacement_mm"])
    assert found["force_mn"] == pytest.approx(12.5)
    assert found["tip_displacement_mm"] == pytest.approx(pushed["tip_displacement_mm"])

    for both in ((), ("--force-mn", 10, "--displacement-mm", 1)):
        assert "give either --force-mn or --displacement-mm" in shell.refused(
            *wall, *both
        )

    assert "'--displacement-mm': 11 is above the largest" in shell.refused(
        *wall, "--displacement-mm", 11
    )


def test_files_are_written_and_named(study: Path, tmp_path: Path, shell) -> None:
    vtu = tmp_path / "eye.vtu"
    plot = tmp_path / "eye.png"
    command = ["simulate", "--study", study, "--thickness-um", 500, "--force-mn", 40]
    out, _ = shell.run(*command, "--vtu", vtu, "--plot", plot)
    assert str(vtu) in out
    assert "times the wall's thickness" in out  # a limit of linear mechanics
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "eye.png",
        "eye.vtu",
        "study.toml",
    ]
    assert "exists already" in shell.refused(*command, "--plot", plot)


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
        arguments = {
            "--study": study,
            "--thickness-um": 500,
            "--force-mn": 10,
            option: value,
        }
        assert named in shell.refused(
            "simulate", *(word for pair in arguments.items() for word in pair)
        )


@pytest.mark.slow
def test_finite_strain_stiffens_and_comes_from_the_study_or_the_option(
    tmp_path: Path, shell
) -> None:
    (tmp_path / "finite.toml").write_text(FINITE)
    wall = (
        "simulate",
        "--study",
        tmp_path / "finite.toml",
        "--thickness-um",
        800,
        "--youngs-modulus-mpa",
        0.3,
    )
    small = shell.json(*wall, "--force-mn", 3)
    large = shell.json(
        *wall,
        "--force-mn",
        24,
        "--vtu",
        tmp_path / "eye.vtu",
        "--plot",
        tmp_path / "eye.png",
    )
    linear = shell.json(*wall, "--force-mn", 24, "--mechanics", "linear")
    assert [answer["mechanics"] for answer in (small, large, linear)] == [
        "finite-strain",
        "finite-strain",
        "linear",
    ]
    assert large["elements"] == 4**2 + 6 * 16
    # 8 times the force
    assert large["tip_displacement_mm"] > 8.5 * small["tip_displacement_mm"]
    assert large["tip_displacement_mm"] > 1.1 * linear["tip_displacement_mm"]
    moved_mm = (
        np.linalg.norm(
            meshio.read(tmp_path / "eye.vtu").point_data["needle_displacement"], axis=1
        ).max()
        * 1e3
    )
    assert moved_mm > 0.9 * large["tip_displacement_mm"]
    assert (tmp_path / "eye.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_sealed_eye_gives_way_less_and_its_pressure_rises(
    tmp_path: Path, shell
) -> None:
    (tmp_path / "study.toml").write_text(FINITE)
    wall = (
        "simulate",
        "--study",
        tmp_path / "study.toml",
        "--thickness-um",
        600,
        "--force-mn",
        25,
    )
    wall += ("--youngs-modulus-mpa", 0.45)
    opened = shell.json(*wall)
    sealed = shell.json(*wall, "--globe", "closed", "--rigidity", 0.03)
    assert (opened["globe"], sealed["globe"]) == ("open", "sealed")
    assert opened["pressure_mmhg"] == pytest.approx(2.0)
    assert opened["dent_mm"] == opened["tip_displacement_mm"]
    assert sealed["pressure_mmhg"] > 3.0
    assert sealed["tip_displacement_mm"] < sealed["dent_mm"] < opened["dent_mm"]
    assert "the pressure rises from 2 to " in shell.text(*wall, "--globe", "sealed")
    again = shell.json(
        *wall[:5],
        *wall[7:],
        "--globe",
        "sealed",
        "--displacement-mm",
        sealed["tip_displacement_mm"],
    )

    for name in ("force_mn", "dent_mm", "pressure_mmhg", "tip_displacement_mm"):
        assert again[name] == pytest.approx(sealed[name], rel=1e-3)


REAL = Path(__file__).parents[4] / "shared" / "real-oct" / "anterior-segment"
SCALE = ("--width-mm", 15, "--depth-mm", 4, "--bits", 12)


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
    result, study = scanner(*frames, *SCALE)
    assert result["frames"] == 2
    assert result["measured"]["snr_db"]["median"] == pytest.approx(22.0, abs=1.0)
    assert result["measured"]["axial_resolution_um"]["median"] == pytest.approx(
        8.0, rel=0.1
    )
    assert result["counts"] == {"shadow_count": [0, 0], "line_count": [0, 0]}
    assert "shadow_loss_percent" in result["not_measured"]
    assert "roll_off_db_per_mm" in {**result["not_drawn"], **result["not_measured"]}
    assert result["histogram_overlap"] > 0.97
    assert (study.oct.columns, study.oct.rows, study.oct.bits) == (512, 512, 12)
    assert isinstance(study.phantom.snr_db, Range)
    assert cv2.imread(str(tmp_path / "study.png")).shape[1] > 1000


def test_a_study_or_picture_that_is_there_stays(
    frames, tmp_path: Path, refused
) -> None:
    for name in ("study.toml", "study.png"):
        (tmp_path / name).write_text("mine")
        assert "exists already" in refused(*frames, *SCALE)
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()
    assert ".toml" in refused(*frames, *SCALE, out="study.txt")


def test_a_frame_without_size_or_bits_is_refused(frames, refused) -> None:
    assert "--width-mm" in refused(*frames, "--bits", 12)
    assert "--bits" in refused(*frames, *SCALE[:4])
    assert "--bits says 8" in refused(*frames, *SCALE[:4], "--bits", 8)


def picture(folder: Path, counts: np.ndarray) -> Path:
    cv2.imwrite(str(folder / "bad.png"), counts.astype(np.uint16))
    return folder / "bad.png"


def test_frames_on_which_nothing_can_be_measured_are_refused(
    frames, tmp_path: Path, refused
) -> None:
    noise = np.random.default_rng(7800).normal(700.0, 150.0, (512, 512)).clip(0, 4095)
    one_colour_air = drawn_counts(7803)
    one_colour_air[:40] = 500

    for counts, before, words in (
        (np.full((512, 512), 700), [], "bad.png: the frame is empty"),
        (noise, frames[:1], "bad.png: "),
        (np.where(drawn_counts(7801) > 300, 4095, 0), [], "bad.png: "),  # saturated
        (drawn_counts(7802)[:400], frames[:1], "another size"),
        (
            np.where(one_colour_air < 1400, 500, one_colour_air),
            [],
            "the air above the tissue is of one colour",
        ),
    ):
        assert words in refused(*before, picture(tmp_path, counts), *SCALE)


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="../shared is absent")
def test_real_frames_of_one_scanner_have_one_display(scanner, tmp_path: Path) -> None:
    """Averaged frames: by their noise alone the displays would span 70 to 117 dB."""
    ranges_db = []
    for name in ("003", "083", "105"):
        size = ("--width-mm", 6.4, "--depth-mm", 4.265)
        result, study = scanner(
            REAL / f"{name}.jpeg", *size, out=tmp_path / f"{name}.toml"
        )
        assert study.oct.bits == 8
        assert 2.0 < result["not_drawn"]["noise_looks"]["median"] < 10.0
        ranges_db.append(result["measured"]["display_range_db"]["median"])

    assert max(ranges_db) - min(ranges_db) < 10.0
