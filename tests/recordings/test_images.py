"""PNG, JPEG and NumPy files; films as OpenCV writes them."""

import struct
import zlib
from functools import partial
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import FRAMES, STORED, check_scan, pictures_of, write_dicom

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.image_files import (
    read_film,
    read_frame,
    read_image,
    read_numpy,
)
from scleraforce.recordings.formats.picture_streams import UnansweredError

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


@pytest.mark.parametrize(
    ("pixels", "profiled"), [(BYTES, False), (RAMP, False), (RAMP, True)]
)
def test_pictures_are_read_unchanged(tmp_path, pixels, profiled):
    data = cv2.imencode(".png", pixels)[1].tobytes()
    # they do not change counts
    profiles = png_chunk(b"sRGB\0") + png_chunk(b"gAMA" + (45455).to_bytes(4, "big"))
    (tmp_path / "a.png").write_bytes(data[:33] + profiles * profiled + data[33:])
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), pixels, strict=True)


GREY = np.full((40, 60), 90, dtype=np.uint8)


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_colour_becomes_grey_alike_in_all_formats(tmp_path, name):
    colour = np.dstack([GREY, GREY // 2, GREY * 2])  # OpenCV's order: blue, green, red
    options = [cv2.IMWRITE_JPEG_QUALITY, 100, cv2.IMWRITE_TIFF_COMPRESSION, 1]
    cv2.imwrite(str(tmp_path / name), colour, options)
    pixels = read_frame(tmp_path / name).astype(int)
    weighted = 0.114 * 90 + 0.587 * 45 + 0.299 * 180
    np.testing.assert_allclose(pixels, round(weighted), atol=1)


def test_a_palette_of_a_png_becomes_grey(tmp_path):
    picture = pytest.importorskip("PIL.Image").frombytes("P", (60, 40), BYTES.tobytes())
    picture.putpalette([255 - level for level in range(256) for _ in range(3)])
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), 255 - BYTES)


def test_transparency_is_left_out_with_a_note(tmp_path):
    picture = np.dstack([GREY, GREY, GREY, np.full_like(GREY, 7)])
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    pixels, scan = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(pixels, GREY)
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


@pytest.mark.parametrize("ending", [".png", ".jpg"])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("orientation", STORED)
def test_pictures_are_shown_as_their_exif_says(tmp_path, ending, order, orientation):
    shown = np.add.outer(np.arange(48) * 2, np.arange(64)).astype(np.uint8)
    path = tmp_path / "a"
    path.write_bytes(with_exif(STORED[orientation](shown), ending, orientation, order))
    pixels, scan = read_image(path)
    assert (scan.rows, scan.columns) == shown.shape
    np.testing.assert_allclose(pixels.astype(int), shown, atol=2)
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


def write_tiff(pixels):
    return lambda path: tifffile.imwrite(path, pixels)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (Path.touch, "an empty file; give a PNG"),
        (
            lambda path: path.write_text("file,time_s"),
            "not an image that can be read; give a PNG",
        ),
        (Path.mkdir, "a folder; give a regular file"),
        (lambda _: None, "No such file"),
        (
            write_tiff(np.stack([RAMP, RAMP])),
            "2 frames in one file; give a file for each",
        ),
        (write_tiff(np.full((9, 9), np.nan)), "81 pixels that are NaN or infinite"),
        (write_tiff(np.ones((9, 9), np.float32)), "float32 pixels; give whole numbers"),
        (write_tiff(np.ones((9, 9), np.uint32)), "uint32 pixels; give whole numbers"),
        (write_tiff(np.ones((1, 9), np.uint8)), "give one frame, rows x columns"),
        (
            partial(write_dicom, pixels=np.stack([RAMP] * 6)),
            "6 frames in one file",
        ),
        (animated, "several pictures in one PNG; give a file for each frame"),
        (
            lambda path: path.write_bytes(with_exif(BYTES, ".jpg", 9, "<")),
            "EXIF Orientation 9",
        ),
        (partial(large, ending=".png"), r"\(2304000000 pixels\) exceeds"),
        (partial(large, ending=".jpg"), r"\(2304000000 pixels\) exceeds"),
    ],
    ids=range(14),
)
def test_what_is_not_a_frame_is_named(tmp_path, write, message):
    path = tmp_path / "a.img"
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


AXES = ("frame", "depth", "lateral")


@pytest.mark.parametrize("kind", ["<u2", ">u2", "<i4", ">f8", np.float16])
def test_arrays_of_either_byte_order_and_any_number_come_back(tmp_path, kind):
    np.save(tmp_path / "a.npy", (FRAMES % 2048).astype(kind, order="F"))
    check_scan(read_numpy(tmp_path / "a.npy", AXES, None), FRAMES % 2048)


def test_the_only_array_of_frames_is_found_and_others_are_asked_for(tmp_path):
    np.savez(tmp_path / "a.npz", volume=FRAMES, pos=np.zeros(6))
    check_scan(read_numpy(tmp_path / "a.npz", AXES, None))
    np.savez_compressed(tmp_path / "b.npz", first=FRAMES, second=FRAMES[::-1])
    asked = r"b\.npz: which array has the frames.*first, second; give `array`"
    with pytest.raises(UnansweredError, match=asked):
        read_numpy(tmp_path / "b.npz", AXES, None)

    check_scan(read_numpy(tmp_path / "b.npz", AXES, "second"), FRAMES[::-1])
    with pytest.raises(FrameError, match="no array 'third'; there are first, second"):
        read_numpy(tmp_path / "b.npz", AXES, "third")


@pytest.mark.parametrize(
    "kind", [bool, np.complex64, [("re", "f4"), ("im", "f4")], "M8[s]"]
)
def test_arrays_that_are_not_grey_are_refused_before_the_axes_are_asked_for(
    tmp_path, kind
):
    np.save(tmp_path / "a.npy", np.zeros((5, 24, 40), kind))
    refusal = r"a\.npy: pixels of type .*; give whole numbers or floats"
    with pytest.raises(FrameError, match=refusal):
        read_numpy(tmp_path / "a.npy", None, None)


@pytest.mark.parametrize(
    ("array", "lost"),
    # pickled objects are never opened
    [(FRAMES, 10), (np.array([{"a": 1}], dtype=object), 0)],
)
def test_arrays_that_are_cut_or_pickled_are_refused(tmp_path, array, lost):
    path = tmp_path / "a.npy"
    np.save(path, array)
    path.write_bytes(path.read_bytes()[: path.stat().st_size - lost])
    with pytest.raises(
        FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy"
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


@pytest.mark.parametrize(
    ("name", "code"), [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "MJPG")]
)
def test_a_film_gives_its_frames_and_the_times_at_which_they_play(tmp_path, name, code):
    scan = read_film(film(tmp_path / name, code))
    found = pictures_of(scan)
    assert (found.shape, scan.bits) == ((len(LEVELS), 64, 96), 8)
    places = (slice(None), 32, [80, 10])
    np.testing.assert_allclose(found[places], SHADES[..., 0][places], atol=4)
    played_s = np.arange(len(LEVELS)) / 12.5
    np.testing.assert_allclose(scan.times.time_s, played_s, atol=2e-3)
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


@pytest.mark.parametrize(
    ("times_ms", "sound_ms"),
    [
        ([0, 100, 200, 300, 400, 500], 0),
        ([5000, 5100, 5200, 5300, 5400, 5500], 0),
        ([0, 100, 200, 2300, 2400, 7500], 0),
        ([0, 100, 200, 300, 400, 500], 9000),
    ],
)
def test_a_complete_film_that_starts_late_or_has_uneven_times_is_not_called_cut_off(
    tmp_path, times_ms, sound_ms
):
    scan = read_film(matroska(tmp_path / "a.mkv", times_ms, sound_ms))
    np.testing.assert_allclose(pictures_of(scan)[:, 9, 9], LEVELS, atol=2)
    since_s = (np.array(times_ms) - times_ms[0]) / 1e3
    np.testing.assert_allclose(scan.times.time_s, since_s, atol=1e-6)
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


@pytest.mark.parametrize("ending", ["avi", "mkv"])
def test_sixteen_bits_of_grey_stay(tmp_path, ending):
    deep = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0, cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U]
    pictures = np.random.default_rng(0).integers(0, 2**16, (3, 64, 96), np.uint16)
    scan = read_film(film(tmp_path / f"a.{ending}", "FFV1", pictures, deep))
    check_scan(scan, pictures)
    assert scan.bits is None


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_a_depth_that_opencv_would_cut_to_8_is_refused(tmp_path, bits):
    code = b"Y1\0" + bytes([bits])
    path = matroska(tmp_path / "a.mkv", [0, 1, 2, 3, 4, 5], raw=code)
    refusal = r"a\.mkv: FFmpeg's pixel format .*-pix_fmt gray16le"
    with pytest.raises(FrameError, match=refusal):
        read_film(path)


@pytest.mark.parametrize(
    ("least", "most", "taken"), [(-10, 3000, True), (-10, 70_000, False)]
)
def test_signed_pixels_begin_at_zero_and_keep_their_range_or_are_refused(
    tmp_path, least, most, taken
):
    path = tmp_path / "a.tif"
    pixels = np.linspace(least, most, RAMP.size).astype(np.int32).reshape(RAMP.shape)
    tifffile.imwrite(path, pixels)
    if taken:
        np.testing.assert_array_equal(read_frame(path), pixels - least)
    else:
        with pytest.raises(FrameError, match="8 or 16 bits"):
            read_frame(path)
