"""TIFF: white or black as zero, palettes, planes; its scale; what is packed in it is no larger than it says."""

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from peak_memory import less_than

from scleraforce.errors import FrameError
from scleraforce.recording.images import read_frame, read_frame_image
from scleraforce.recording.tiff import read_tiff

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


@pytest.mark.parametrize(("pixels", "top"), [(BYTES, 255), (RAMP, 65535)])
def test_white_is_zero_is_turned_round(tmp_path: Path, pixels: np.ndarray, top: int) -> None:
    tifffile.imwrite(tmp_path / "a.tif", top - pixels, photometric="miniswhite")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), pixels)


@pytest.mark.parametrize("factor", [257, 256, 1])  # as the format says, and as programs write it
def test_a_palette_gives_the_colours_that_it_stands_for(tmp_path: Path, factor: int) -> None:
    colormap = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * factor, (3, 1))
    tifffile.imwrite(tmp_path / "a.tif", BYTES, photometric="palette", colormap=colormap)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), 255 - BYTES)


def test_a_palette_of_a_png_gives_the_colours_that_it_stands_for(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    picture = image.frombytes("P", (60, 40), BYTES.tobytes())
    picture.putpalette([255 - level for level in range(256) for _ in range(3)])
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), 255 - BYTES)


def test_colours_in_planes_are_read_as_colours(tmp_path: Path) -> None:
    colour = np.stack([BYTES, BYTES // 2, 255 - BYTES])
    tifffile.imwrite(tmp_path / "a.tif", colour, photometric="rgb", planarconfig="separate")
    expected = cv2.cvtColor(np.moveaxis(colour, 0, -1), cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), expected)


def test_a_kind_that_is_no_grey_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((40, 60, 4), np.uint8), photometric="separated")
    with pytest.raises(FrameError, match="of kind SEPARATED; save it as grey"):
        read_frame(tmp_path / "a.tif")


def test_a_compression_that_needs_a_package_is_no_damage(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.tif"), BYTES, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with pytest.raises(FrameError, match=r"a\.tif: compressed as LZW; save it without compression, .* imagecodecs"):
        read_frame(tmp_path / "a.tif")


OME = {"axes": "YX", "PhysicalSizeX": 0.02, "PhysicalSizeXUnit": "mm", "PhysicalSizeY": 7.0}


@pytest.mark.parametrize(
    "options",
    [
        {"resolution": (1e4 / 20, 1e4 / 7), "resolutionunit": "CENTIMETER"},
        {"resolution": (25400 / 20, 25400 / 7), "resolutionunit": "INCH"},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "um"}},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "\\u00B5m", "spacing": 3.0}},
        {"resolution": (50.0, 1e3 / 7), "imagej": True, "metadata": {"unit": "mm"}},
        {"ome": True, "metadata": OME},
    ],
    ids=["centimetre", "inch", "ImageJ um", "ImageJ escaped", "ImageJ mm", "OME"],
)
def test_a_scale_is_taken_from_the_tags(tmp_path: Path, options: dict[str, Any]) -> None:
    tifffile.imwrite(tmp_path / "a.tif", RAMP, **options)
    image = read_frame_image(tmp_path / "a.tif")
    assert (image.lateral_pixel_m, image.depth_pixel_m) == pytest.approx((20e-6, 7e-6), rel=1e-4)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"resolution": (100.0, 100.0), "resolutionunit": "NONE"},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "pixel"}},
        {"resolution": (72, 72), "imagej": True, "metadata": {"unit": "inch"}},
        {"ome": True, "metadata": {"axes": "YX"}},
        *({"resolution": (dots, dots), "resolutionunit": "INCH"} for dots in (72, 96, 300, 1200)),
        {"resolution": (28.35, 28.35), "resolutionunit": "CENTIMETER"},
    ],
)
def test_dots_of_a_screen_or_printer_and_a_number_without_unit_are_no_scale(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    tifffile.imwrite(tmp_path / "a.tif", RAMP, **options)
    image = read_frame_image(tmp_path / "a.tif")
    assert (image.lateral_pixel_m, image.depth_pixel_m) == (None, None)


def tiff(rows: int, columns: int, strip: bytes, compression: int = 8, **tags: int) -> bytes:
    """Return a TIFF of 8 bits with one strip, whatever its tags say."""
    values = {256: columns, 257: rows, 258: 8, 259: compression, 262: 1, 273: 8, 277: 1, 278: rows, 279: len(strip)}
    values |= {int(name.removeprefix("tag")): value for name, value in tags.items()}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(values.items()))
    begin = struct.pack("<2sHI", b"II", 42, 8 + len(strip))
    return begin + strip + struct.pack("<H", len(values)) + entries + bytes(4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (tiff(60_000, 60_000, zlib.compress(bytes(100))), "60000 x 60000 pixels; a frame may have 64 million"),
        (tiff(64, 64, zlib.compress(bytes(100)), tag277=60_000), "with 60000 samples each; a frame may have"),
        (tiff(64, 64, zlib.compress(bytes(50_000_000))), "more is packed in it than"),
        (tiff(64, 64, bytes([129, 0]) * 400_000, compression=32773), "more is packed in it than"),
    ],
    ids=["header", "samples", "deflate", "PackBits"],
)
def test_the_size_is_checked_before_memory_is_taken(tmp_path: Path, content: bytes, message: str) -> None:
    tifffile.TiffFile(io.BytesIO(content)).close()  # what is wrong is not that it is no TIFF
    with less_than(10e6), pytest.raises(FrameError, match=message):
        read_tiff(tmp_path / "a.tif", content)


def test_what_a_test_packs_by_hand_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(tiff(40, 60, zlib.compress(BYTES.tobytes())))
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), BYTES)
