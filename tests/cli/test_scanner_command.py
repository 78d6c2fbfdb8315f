import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic_frames import drawn_counts

from scleraforce.cli.main import run
from scleraforce.study import Range, read_study

REAL = Path(__file__).parents[3] / "shared" / "real-oct" / "anterior-segment"
SCALE = ("--width-mm", 15, "--depth-mm", 4, "--bits", 12)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("frames")
    for number in range(2):
        cv2.imwrite(str(folder / f"{number}.png"), drawn_counts(7700 + number))
    return sorted(folder.iterdir())


def refused(capsys: pytest.CaptureFixture[str], out: Path, *arguments: object) -> str:
    before = sorted(out.parent.iterdir())
    assert run(["scanner", *map(str, arguments), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    message = captured.err.strip()
    assert message.startswith("error: ")
    assert "\n" not in message
    assert sorted(out.parent.iterdir()) == before
    return message


def test_it_writes_a_study_and_its_picture_and_tells_what_it_measured(frames, tmp_path: Path, capsys) -> None:
    out = tmp_path / "study.toml"
    assert run(["scanner", *map(str, frames), *map(str, SCALE), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["frames"] == 2
    assert told["measured"]["snr_db"]["median"] == pytest.approx(22.0, abs=1.0)
    assert told["measured"]["axial_resolution_um"]["median"] == pytest.approx(8.0, rel=0.1)
    assert told["counts"] == {"shadow_count": [0, 0], "line_count": [0, 0]}
    assert "shadow_loss_percent" in told["not_measured"]
    assert "roll_off_db_per_mm" in {**told["not_drawn"], **told["not_measured"]}
    assert told["histogram_overlap"] > 0.97
    study = read_study(out)
    assert (study.oct.columns, study.oct.rows, study.oct.bits) == (512, 512, 12)
    assert isinstance(study.phantom.snr_db, Range)
    assert cv2.imread(str(tmp_path / "study.png")).shape[1] > 1000


@pytest.mark.slow
def test_a_second_run_writes_the_same_bytes(frames, tmp_path: Path, capsys) -> None:
    written = []
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        assert run(["scanner", *map(str, frames), *map(str, SCALE), "--out", str(folder / "study.toml")]) == 0
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert written[0] == written[1]
    assert "snr_db = " in capsys.readouterr().out


def test_a_study_or_picture_that_is_there_stays(frames, tmp_path: Path, capsys) -> None:
    for name in ("study.toml", "study.png"):
        (tmp_path / name).write_text("mine")
        assert "exists already" in refused(capsys, tmp_path / "study.toml", *frames, *SCALE)
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()
    assert ".toml" in refused(capsys, tmp_path / "study.txt", *frames, *SCALE)


def test_a_frame_without_size_or_bits_is_refused(frames, tmp_path: Path, capsys) -> None:
    out = tmp_path / "study.toml"
    assert "--width-mm" in refused(capsys, out, *frames, "--bits", 12)
    assert "--bits" in refused(capsys, out, *frames, *SCALE[:4])
    assert "--bits says 8" in refused(capsys, out, *frames, *SCALE[:4], "--bits", 8)


def picture(folder: Path, counts: np.ndarray) -> Path:
    cv2.imwrite(str(folder / "bad.png"), counts.astype(np.uint16))
    return folder / "bad.png"


def test_frames_on_which_nothing_can_be_measured_are_refused(frames, tmp_path: Path, capsys) -> None:
    rng, out = np.random.default_rng(7800), tmp_path / "out" / "study.toml"
    out.parent.mkdir()
    grey = np.full((512, 512), 700)
    assert "bad.png: the frame is empty" in refused(capsys, out, picture(tmp_path, grey), *SCALE)
    noise = rng.normal(700.0, 150.0, (512, 512)).clip(0, 4095)
    assert "bad.png: " in refused(capsys, out, frames[0], picture(tmp_path, noise), *SCALE)
    saturated = np.where(drawn_counts(7801) > 300, 4095, 0)
    assert "bad.png: " in refused(capsys, out, picture(tmp_path, saturated), *SCALE)
    small = drawn_counts(7802)[:400]
    assert "another size" in refused(capsys, out, frames[0], picture(tmp_path, small), *SCALE)
    one_colour_air = drawn_counts(7803)
    one_colour_air[:40] = 500
    one_colour_air = np.where(one_colour_air < 1400, 500, one_colour_air)
    assert "the air above the tissue is of one colour" in refused(
        capsys, out, picture(tmp_path, one_colour_air), *SCALE
    )


def test_a_linear_display_is_told_written_and_drawn(tmp_path: Path, capsys) -> None:
    out = tmp_path / "study.toml"
    optics = {"display": "linear", "snr_db": 20.0, "display_range_db": 38.0, "attenuation_per_m": 2000.0}
    frame, mask = str(tmp_path / "0.png"), str(tmp_path / "mask")
    cv2.imwrite(frame, drawn_counts(7710, **optics))
    assert run(["segment", frame, "--out", mask, *map(str, SCALE[:4]), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"][0]["usable"]
    assert run(["scanner", frame, *map(str, SCALE), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["display"] == read_study(out).phantom.display == "linear"
    assert told["measured"]["snr_db"]["median"] == pytest.approx(20.0, abs=1.0)
    assert told["measured"]["display_range_db"]["median"] == pytest.approx(38.0, abs=1.0)
    assert told["measured"]["attenuation_per_mm"]["median"] == pytest.approx(2.0, rel=0.1)
    assert told["not_drawn"]["spread_slope"]["median"] == pytest.approx(1.58, abs=0.2)
    assert told["histogram_overlap"] > 0.95


def test_a_display_that_the_wall_does_not_tell_is_said_to_be_taken_for_granted(tmp_path: Path, capsys) -> None:
    out = tmp_path / "study.toml"
    cv2.imwrite(str(tmp_path / "0.png"), drawn_counts(7110, attenuation_per_m=20.0))
    assert run(["scanner", str(tmp_path / "0.png"), *map(str, SCALE), "--out", str(out)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "note: that the display is logarithmic is taken for granted: the wall's light is too even" in told
    assert "taken for granted" in out.read_text()


@pytest.mark.slow
def test_phantom_draws_frames_of_the_measured_scanner(frames, tmp_path: Path, capsys) -> None:
    """A recording that the written study draws is measured again: the same display, resolution and attenuation."""
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    assert run(["scanner", *map(str, frames), *map(str, SCALE), "--out", str(first), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    eye = tmp_path / "eye"
    assert run(["phantom", "--study", str(first), "--out", str(eye), "--forces-mn", "0,0,0"]) == 0
    capsys.readouterr()
    drawn = sorted(map(str, (eye / "frames").iterdir()))
    assert run(["scanner", *drawn, "--out", str(second), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    for key in ("display_range_db", "lateral_resolution_um", "attenuation_per_mm", "choroid_thickness_um"):
        assert again["measured"][key]["median"] == pytest.approx(told["measured"][key]["median"], rel=0.1)


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="../shared is absent")
def test_real_frames_of_one_scanner_have_one_display(tmp_path: Path, capsys) -> None:
    """Averaged frames: by their noise alone the displays would span 70 to 117 dB."""
    found = []
    for name in ("003", "083", "105"):
        frame, out = REAL / f"{name}.jpeg", tmp_path / f"{name}.toml"
        arguments = (frame, "--width-mm", 6.4, "--depth-mm", 4.265, "--out", out, "--json")
        assert run(["scanner", *map(str, arguments)]) == 0
        found.append(json.loads(capsys.readouterr().out))
        assert read_study(out).oct.bits == 8
    ranges_db = [told["measured"]["display_range_db"]["median"] for told in found]
    assert max(ranges_db) - min(ranges_db) < 10.0
    assert all(2.0 < told["not_drawn"]["noise_looks"]["median"] < 10.0 for told in found)
