"""PNG, JPEG and NumPy files; films as OpenCV writes them."""

import struct
import zlib
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import FRAMES, STORED, pictures_of, write_dicom

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.image_files import (
    read_film,
    read_frame,
    read_image,
    read_numpy,
)
from scleraforce.recordings.formats.picture_streams import AXES, UnansweredError

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


def test_pictures_are_read_unchanged(tmp_path):
    # they do not change counts
    profiles = png_chunk(b"sRGB\0") + png_chunk(b"gAMA" + (45455).to_bytes(4, "big"))
    for pixels, more in ((BYTES, b""), (RAMP, b""), (RAMP, profiles)):
        data = cv2.imencode(".png", pixels)[1].tobytes()
        (tmp_path / "a.png").write_bytes(data[:33] + more + data[33:])
        np.testing.assert_array_equal(
            read_frame(tmp_path / "a.png"), pixels, strict=True
        )


def test_colour_becomes_grey_alike_in_all_formats(tmp_path):
    grey = np.full((40, 60), 90, dtype=np.uint8)
    colour = np.dstack([grey, grey // 2, grey * 2])  # OpenCV's order: blue, green, red
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    cv2.imwrite(str(tmp_path / "a.jpg"), colour, [cv2.IMWRITE_JPEG_QUALITY, 100])
    tifffile.imwrite(
        tmp_path / "a.tif", np.ascontiguousarray(colour[..., ::-1]), photometric="rgb"
    )

    for name in ("a.png", "a.jpg", "a.tif"):
        pixels = read_frame(tmp_path / name)
        assert (
            np.abs(
                pixels.astype(int) - round(0.114 * 90 + 0.587 * 45 + 0.299 * 180)
            ).max()
            <= 1
        )

    picture = pytest.importorskip("PIL.Image").frombytes("P", (60, 40), BYTES.tobytes())
    picture.putpalette([255 - level for level in range(256) for _ in range(3)])
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), 255 - BYTES)
    cv2.imwrite(
        str(tmp_path / "a.png"), np.dstack([grey, grey, grey, np.full_like(grey, 7)])
    )
    pixels, scan = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(pixels, grey)
    assert any("transparency" in note for note in scan.notes)


def png_chunk(chunk: bytes) -> bytes:
    return (
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )


def with_exif(picture: np.ndarray, ending: str, orientation: int, order: str) -> bytes:
    """Encode a picture as PNG or JPEG with an EXIF orientation."""
    data = cv2.imencode(
        ending, np.ascontiguousarray(picture), [cv2.IMWRITE_JPEG_QUALITY, 100]
    )[1].tobytes()
    kind = {"<": b"II*\0\x08\0\0\0", ">": b"MM\0*\0\0\0\x08"}[order]
    held = kind + struct.pack(f"{order}HHHIHHI", 1, 274, 3, 1, orientation, 0, 0)

    if ending == ".jpg":
        body = b"Exif\0\0" + held
        return (
            data[:2]
            + b"\xff\xe1"
            + (len(body) + 2).to_bytes(2, "big")
            + body
            + data[2:]
        )

    return data[:33] + png_chunk(b"eXIf" + held) + data[33:]


def test_pictures_are_shown_as_their_exif_says(tmp_path):
    shown = np.add.outer(np.arange(48) * 2, np.arange(64)).astype(np.uint8)
    path = tmp_path / "a"

    for ending, order, (orientation, stored) in product(
        (".png", ".jpg"), "<>", STORED.items()
    ):
        path.write_bytes(with_exif(stored(shown), ending, orientation, order))
        pixels, scan = read_image(path)
        assert pixels.shape == shown.shape == (scan.rows, scan.columns)
        assert np.abs(pixels.astype(int) - shown).max() <= 2
        assert any("Orientation" in note for note in scan.notes) is (orientation != 1)


def animated(path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    frames = [
        image.fromarray(np.full((40, 60), level, np.uint8)) for level in (10, 200)
    ]
    frames[0].save(path, "PNG", save_all=True, append_images=frames[1:])


def large(path: Path, ending: str) -> None:
    """Write a picture whose header says 48,000 x 48,000 pixels."""
    data = bytearray(cv2.imencode(ending, BYTES)[1].tobytes())
    at, kind = (16, ">II") if ending == ".png" else (data.index(b"\xff\xc0") + 5, ">HH")
    struct.pack_into(kind, data, at, 48_000, 48_000)
    data[29:33] = (
        struct.pack(">I", zlib.crc32(data[12:29])) if ending == ".png" else data[29:33]
    )
    path.write_bytes(data)


def test_what_is_not_a_frame_is_named(tmp_path):
    for write, message in [
        (lambda path: path.write_bytes(b""), "an empty file; give a PNG"),
        (
            lambda path: path.write_bytes(b"file,time_s\n"),
            "not an image that can be read; give a PNG",
        ),
        (lambda path: path.mkdir(), "a folder; give a regular file"),
        (lambda _: None, "No such file"),
        (
            lambda path: tifffile.imwrite(path, np.stack([RAMP, RAMP])),
            "2 frames in one file; give a file for each",
        ),
        (
            lambda path: tifffile.imwrite(path, np.full((9, 9), np.nan)),
            "81 pixels that are NaN or infinite",
        ),
        (
            lambda path: tifffile.imwrite(path, np.ones((9, 9), np.float32)),
            "float32 pixels; give whole numbers",
        ),
        (
            lambda path: tifffile.imwrite(path, np.ones((9, 9), np.uint32)),
            "uint32 pixels; give whole numbers",
        ),
        (
            lambda path: tifffile.imwrite(path, np.ones((1, 9), np.uint8)),
            "give one frame, rows x columns",
        ),
        (lambda path: write_dicom(path, np.stack([RAMP] * 6)), "6 frames in one file"),
        (animated, "several pictures in one PNG; give a file for each frame"),
        (
            lambda path: path.write_bytes(with_exif(BYTES, ".jpg", 9, "<")),
            "EXIF Orientation 9",
        ),
        *(
            (partial(large, ending=ending), r"\(2304000000 pixels\) exceeds")
            for ending in (".png", ".jpg")
        ),
    ]:
        path = Path(mkdtemp(dir=tmp_path)) / "a.img"
        write(path)
        with pytest.raises(FrameError, match=message) as caught:
            read_frame(path)

        assert str(caught.value).startswith(f"{path}: ")


def test_a_truncated_file_and_a_flipped_bit_of_a_png_are_errors(tmp_path):
    png, jpg = (
        cv2.imencode(ending, pixels)[1].tobytes()
        for ending, pixels in ((".png", RAMP), (".jpg", BYTES))
    )
    write_dicom(tmp_path / "a.dcm", RAMP)
    tifffile.imwrite(tmp_path / "a.tif", RAMP)
    whole = [png, jpg, *((tmp_path / name).read_bytes() for name in ("a.dcm", "a.tif"))]
    cut = [
        data[: int(len(data) * share)]
        for data, share in product(whole, (0.3, 0.7, 0.97))
    ]
    flipped = [
        png[:at] + bytes([png[at] ^ 16]) + png[at + 1 :]
        for at in range(8, len(png) - 4, 7)
    ]

    for data in (*cut, *flipped):
        (tmp_path / "bad").write_bytes(data)
        with pytest.raises(FrameError, match="bad: "):
            read_frame(tmp_path / "bad")


def test_arrays_of_either_byte_order_and_any_number_come_back(tmp_path):
    for kind in ["<u2", ">u2", "<i4", ">f8", np.float16]:
        np.save(tmp_path / "a.npy", (FRAMES % 2048).astype(kind, order="F"))
        np.testing.assert_array_equal(
            pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES % 2048
        )


def test_the_only_array_of_frames_is_found_and_others_are_asked_for(
    tmp_path,
):
    np.savez(tmp_path / "a.npz", volume=FRAMES, pos=np.zeros(6))
    np.testing.assert_array_equal(
        pictures_of(read_numpy(tmp_path / "a.npz", AXES, None)), FRAMES
    )
    np.savez_compressed(tmp_path / "b.npz", first=FRAMES, second=FRAMES[::-1])

    with pytest.raises(
        UnansweredError,
        match=r"b\.npz: which array has the frames.*first, second; give `array`",
    ):
        read_numpy(tmp_path / "b.npz", AXES, None)

    np.testing.assert_array_equal(
        pictures_of(read_numpy(tmp_path / "b.npz", AXES, "second")), FRAMES[::-1]
    )
    with pytest.raises(FrameError, match="no array 'third'; there are first, second"):
        read_numpy(tmp_path / "b.npz", AXES, "third")


def test_arrays_that_are_not_grey_or_not_whole_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    for kind in [bool, np.complex64, [("re", "f4"), ("im", "f4")], "M8[s]"]:
        np.save(path, np.zeros((5, 24, 40), kind))
        with pytest.raises(
            FrameError, match=r"a\.npy: pixels of type .*; give whole numbers or floats"
        ):
            read_numpy(path, None, None)  # before the axes are asked for

    for array, lost in (
        (FRAMES, 10),
        (np.array([{"a": 1}], dtype=object), 0),
    ):
        # pickled objects are never opened
        np.save(path, array)
        path.write_bytes(path.read_bytes()[: path.stat().st_size - lost])

        with pytest.raises(
            FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy file"
        ):
            read_numpy(path, AXES, None)


LEVELS = (20, 60, 100, 140, 180, 220)
SHADES = (
    np.repeat(np.array(LEVELS, np.uint8), 64 * 96 * 3).reshape(-1, 64, 96, 3).copy()
)
SHADES[:, :, :32] -= 15  # each frame is of one grey, its left third darker


def film(
    path: Path,
    code: str,
    pictures: np.ndarray = SHADES,
    options: list[int] | None = None,
) -> Path:
    kind = (cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*code), 12.5, (96, 64))
    writer = cv2.VideoWriter(str(path), *kind, options or [])
    if not writer.isOpened():
        pytest.skip(f"OpenCV cannot write {code} here")

    for picture in pictures:
        writer.write(picture)

    writer.release()
    return path


def test_a_film_gives_its_frames_and_the_times_at_which_they_play(
    tmp_path,
):
    for name, code in [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "MJPG")]:
        scan = read_film(film(tmp_path / name, code))
        found = pictures_of(scan)
        assert (found.shape, scan.bits) == ((len(LEVELS), 64, 96), 8)
        np.testing.assert_allclose(
            found[:, 32, [80, 10]], SHADES[:, 32, [80, 10], 0], atol=4
        )
        np.testing.assert_allclose(
            scan.times.time_s, np.arange(len(LEVELS)) / 12.5, atol=2e-3
        )
        (note,) = scan.notes
        assert "`rate_hz`" in note


def matroska(
    path: Path, times_ms: list[int], sound_ms: int = 0, raw: bytes = b""
) -> Path:
    """A Matroska film of MJPEG, a cluster for each frame; it states how long it lasts
    from 0 on, sound included.

    `raw`: FFmpeg's tag of a pixel format of two bytes, in which it is not compressed.
    """

    def element(name: str, content: bytes) -> bytes:
        return (
            bytes.fromhex(name) + (len(content) | 1 << 56).to_bytes(8, "big") + content
        )

    def number(name: str, value: int) -> bytes:
        return element(name, value.to_bytes(4, "big"))

    duration = np.array(max(times_ms[-1] + 100, sound_ms), ">f8").tobytes()
    info = element("1549a966", number("2ad7b1", 1_000_000) + element("4489", duration))
    video = element(
        "e0",
        number("b0", 96) + number("ba", 64) + (element("2eb524", raw) if raw else b""),
    )
    codec = element("86", b"V_UNCOMPRESSED" if raw else b"V_MJPEG")
    track = number("d7", 1) + number("73c5", 1) + number("83", 1) + codec
    tracks = element(
        "1654ae6b", element("ae", track + number("23e383", 100_000_000) + video)
    )
    clusters = b""

    for time_ms, level in zip(times_ms, LEVELS, strict=True):
        picture = np.full((64, 96), level, np.uint16 if raw else np.uint8)
        data = picture.tobytes() if raw else cv2.imencode(".jpg", picture)[1].tobytes()
        clusters += element(
            "1f43b675", number("e7", time_ms) + element("a3", b"\x81\0\0\x80" + data)
        )

    path.write_bytes(
        element("1a45dfa3", element("4282", b"matroska"))
        + element("18538067", info + tracks + clusters)
    )
    return path


def test_a_complete_film_that_starts_late_or_has_uneven_times_is_not_called_cut_off(
    tmp_path,
):
    for times_ms, sound_ms in [
        ([0, 100, 200, 300, 400, 500], 0),
        ([5000, 5100, 5200, 5300, 5400, 5500], 0),
        ([0, 100, 200, 2300, 2400, 7500], 0),
        ([0, 100, 200, 300, 400, 500], 9000),
    ]:
        scan = read_film(matroska(tmp_path / "a.mkv", times_ms, sound_ms))
        np.testing.assert_allclose(pictures_of(scan)[:, 9, 9], LEVELS, atol=2)
        np.testing.assert_allclose(
            scan.times.time_s, (np.array(times_ms) - times_ms[0]) / 1e3, atol=1e-6
        )
        assert len(scan.notes) == 1
        assert ("time stamps" in scan.times.source) == (times_ms[-1] == 7500)


def test_a_film_that_was_cut_off_is_noted(tmp_path):
    path = film(tmp_path / "a.avi", "MJPG")
    path.write_bytes(path.read_bytes()[: int(0.85 * path.stat().st_size)])
    scan = read_film(path)
    assert 0 < len(pictures_of(scan)) < len(LEVELS)
    assert (
        f"states {len(LEVELS)} frames and plays {len(scan.names)}: cut off"
        in scan.notes[1]
    )


def test_sixteen_bits_of_grey_stay_and_a_depth_that_opencv_would_cut_to_8_is_refused(
    tmp_path,
):
    deep = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0, cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U]
    pictures = (
        np.random.default_rng(0).integers(0, 2**16, (3, 64, 96)).astype(np.uint16)
    )

    for ending in ["avi", "mkv"]:
        scan = read_film(film(tmp_path / f"a.{ending}", "FFV1", pictures, deep))
        np.testing.assert_array_equal(pictures_of(scan), pictures)
        assert scan.bits is None

    for bits in [10, 12, 14]:
        path = matroska(
            tmp_path / "a.mkv", [0, 1, 2, 3, 4, 5], raw=b"Y1\0" + bytes([bits])
        )
        with pytest.raises(
            FrameError, match=r"a\.mkv: FFmpeg's pixel format .*-pix_fmt gray16le"
        ):
            read_film(path)
