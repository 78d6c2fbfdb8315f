"""Films as OpenCV writes them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign_files import pictures_of

from scleraforce.errors import FrameError
from scleraforce.recording.images import read_film

CASES = Path(__file__).parents[3] / "shared" / "cases" / "import" / "15-film-frames-missing"
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


def test_a_film_gives_its_frames_and_the_times_at_which_they_play(tmp_path: Path) -> None:
    for name, code in [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "MJPG")]:
        scan = read_film(film(tmp_path / name, code))
        found = pictures_of(scan)
        assert found.shape == (len(LEVELS), 64, 96)
        np.testing.assert_allclose(found[:, 32, 80], LEVELS, atol=4)
        np.testing.assert_allclose(found[:, 32, 10], np.array(LEVELS) - 15, atol=4)
        np.testing.assert_allclose(scan.times.time_s, np.arange(len(LEVELS)) / 12.5, atol=2e-3)
        assert scan.bits == 8
        assert "--rate-hz" in scan.notes[0]
        assert len(scan.notes) == 1


def matroska(path: Path, times_ms: list[int], sound_ms: int = 0, raw: bytes = b"") -> Path:
    """A Matroska film of MJPEG, a cluster for each frame; it states how long it lasts from 0 on, sound included.

    `raw`: FFmpeg's tag of a pixel format of two bytes, in which it is not compressed.
    """

    def element(name: str, content: bytes) -> bytes:
        return bytes.fromhex(name) + (len(content) | 1 << 56).to_bytes(8, "big") + content

    def number(name: str, value: int) -> bytes:
        return element(name, value.to_bytes(4, "big"))

    duration = np.array(max(times_ms[-1] + 100, sound_ms), ">f8").tobytes()
    info = element("1549a966", number("2ad7b1", 1_000_000) + element("4489", duration))
    video = element("e0", number("b0", 96) + number("ba", 64) + (element("2eb524", raw) if raw else b""))
    codec = element("86", b"V_UNCOMPRESSED" if raw else b"V_MJPEG")
    track = number("d7", 1) + number("73c5", 1) + number("83", 1) + codec
    tracks = element("1654ae6b", element("ae", track + number("23e383", 100_000_000) + video))
    clusters = b""
    for time_ms, level in zip(times_ms, LEVELS, strict=True):
        picture = np.full((64, 96), level, np.uint16 if raw else np.uint8)
        data = picture.tobytes() if raw else cv2.imencode(".jpg", picture)[1].tobytes()
        clusters += element("1f43b675", number("e7", time_ms) + element("a3", b"\x81\0\0\x80" + data))
    path.write_bytes(element("1a45dfa3", element("4282", b"matroska")) + element("18538067", info + tracks + clusters))
    return path


def test_a_complete_film_that_starts_late_or_has_uneven_times_is_not_called_cut_off(tmp_path: Path) -> None:
    for times_ms, sound_ms in [
        ([0, 100, 200, 300, 400, 500], 0),
        ([5000, 5100, 5200, 5300, 5400, 5500], 0),
        ([0, 100, 200, 2300, 2400, 7500], 0),
        ([0, 100, 200, 300, 400, 500], 9000),
    ]:
        scan = read_film(matroska(tmp_path / "a.mkv", times_ms, sound_ms))
        np.testing.assert_allclose(pictures_of(scan)[:, 9, 9], LEVELS, atol=2)
        np.testing.assert_allclose(scan.times.time_s, (np.array(times_ms) - times_ms[0]) / 1e3, atol=1e-6)
        assert len(scan.notes) == 1
        assert ("time stamps" in scan.times.source) == (times_ms[-1] == 7500)


def test_a_film_that_was_cut_off_is_noted(tmp_path: Path) -> None:
    late_ms = [5000, 5100, 5200, 5300, 8400, 9500]
    for path, lost, states in [
        (film(tmp_path / "a.avi", "MJPG"), 0.15, f"states {len(LEVELS)} frames, of which "),
        (matroska(tmp_path / "a.mkv", [0, 100, 200, 300, 400, 500]), 0.1, ""),
        (matroska(tmp_path / "b.mkv", late_ms), 0.1, ""),
    ]:
        path.write_bytes(path.read_bytes()[: int((1.0 - lost) * path.stat().st_size)])
        scan = read_film(path)
        assert 0 < len(pictures_of(scan)) < len(LEVELS)
        assert f"{states}{len(scan.names)} can be decoded: it was cut off" in scan.notes[1]


@pytest.mark.real
@pytest.mark.skipif(not CASES.exists(), reason="no ../shared/cases/import")
def test_complete_films_of_others_are_not_called_cut_off() -> None:
    for name in ["a_start.mkv", "a_vfr.mkv"]:
        assert len(read_film(CASES / name).notes) == 1


def deep_film(path: Path, pictures: np.ndarray) -> Path:
    rows, columns = pictures.shape[1:]
    grey = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0, cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U]
    code = cv2.VideoWriter_fourcc(*"FFV1")
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 10.0, (columns, rows), grey)
    if not writer.isOpened():
        pytest.skip("OpenCV cannot write FFV1 here")
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def test_sixteen_bits_of_grey_stay(tmp_path: Path) -> None:
    for ending in ["avi", "mkv"]:
        pictures = np.random.default_rng(0).integers(0, 2**16, (3, 64, 96)).astype(np.uint16)
        scan = read_film(deep_film(tmp_path / f"a.{ending}", pictures))
        np.testing.assert_array_equal(pictures_of(scan), pictures)
        assert scan.bits is None


def test_grey_of_a_depth_that_opencv_would_cut_to_8_bits_is_refused(tmp_path: Path) -> None:
    for bits in [10, 12, 14]:
        path = matroska(tmp_path / "a.mkv", [0, 1, 2, 3, 4, 5], raw=b"Y1\0" + bytes([bits]))
        with pytest.raises(FrameError, match=rf"a\.mkv: pixels of {bits} bits .*-pix_fmt gray16le"):
            read_film(path)
