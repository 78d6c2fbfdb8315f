"""Films as OpenCV writes them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from format_frames import pictures_of

from scleraforce.errors import FrameError
from scleraforce.formats.video import read_film

LEVELS = (20, 60, 100, 140, 180, 220)


def film(path: Path, code: str, rate_hz: float = 12.5) -> Path:
    """Each frame is of one grey, its left third darker by 15."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), rate_hz, (96, 64))
    if not writer.isOpened():
        pytest.skip(f"OpenCV cannot write {code} here")
    for level in LEVELS:
        frame = np.full((64, 96, 3), level, np.uint8)
        frame[:, :32] -= 15
        writer.write(frame)
    writer.release()
    return path


@pytest.mark.parametrize(("name", "code"), [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "MJPG")])
def test_a_film_gives_its_frames_and_the_times_at_which_they_play(tmp_path: Path, name: str, code: str) -> None:
    scan = read_film(film(tmp_path / name, code))
    found = pictures_of(scan)
    assert found.shape == (len(LEVELS), 64, 96)
    np.testing.assert_allclose(found[:, 32, 80], LEVELS, atol=4)
    np.testing.assert_allclose(found[:, 32, 10], np.array(LEVELS) - 15, atol=4)
    np.testing.assert_allclose(scan.times.time_s, np.arange(len(LEVELS)) / 12.5, atol=2e-3)
    assert scan.bits == 8
    assert "--rate-hz" in scan.notes[0]
    assert len(scan.notes) == 1


def test_a_film_that_was_cut_off_is_noted(tmp_path: Path) -> None:
    path = film(tmp_path / "a.avi", "MJPG")
    path.write_bytes(path.read_bytes()[: int(0.85 * path.stat().st_size)])
    scan = read_film(path)
    assert 0 < len(pictures_of(scan)) < len(LEVELS)
    assert f"states {len(LEVELS)} frames, of which {len(scan.names)} can be decoded" in scan.notes[1]


def test_a_file_that_is_no_film_is_refused(tmp_path: Path, capfd) -> None:
    (tmp_path / "a.avi").write_bytes(b"RIFF\x00\x00\x00\x00AVI " + bytes(100))
    with pytest.raises(FrameError, match=r"a\.avi: "):
        read_film(tmp_path / "a.avi")
    capfd.readouterr()
