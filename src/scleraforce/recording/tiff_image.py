"""Read a TIFF of one page as a frame: white or black as zero, palettes, colour; and what it says of its scale."""

import io
import lzma
import re
import zlib
from math import isfinite
from mmap import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import FrameImage, check_size, grey_pixels, inverted, unpacked_bytes

if TYPE_CHECKING:
    import tifffile

__all__ = ["METRES", "check_page", "page_scale", "read_tiff", "upright"]

WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE = range(4)  # PhotometricInterpretation
DEFLATE, PACKBITS, LZMA = (8, 32946), 32773, 34925  # Compression
PLANES_APART = 2  # PlanarConfiguration
INCH, CENTIMETRE = 2, 3  # ResolutionUnit; 1: none
METRES = {
    "m": 1.0, "meter": 1.0, "cm": 1e-2, "inch": 25.4e-3, "in": 25.4e-3, "mm": 1e-3, "µm": 1e-6, "μm": 1e-6, "um": 1e-6,
    "micron": 1e-6, "microns": 1e-6, "micrometer": 1e-6, "nm": 1e-9,
}  # fmt: skip
PRINTED = (25.4e-3, 1e-2)  # units in which programs state the resolution of a screen or a printer, asked or not ...
PRINTED_M = 20e-6  # ... which are never finer than this: 1,270 dots per inch


def read_tiff(path: Path, data: bytes) -> FrameImage:
    """Read a TIFF.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    import tifffile  # here, so that reading PNG needs OpenCV only

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            if len(file.pages) != 1:
                raise FrameError(f"{path}: {len(file.pages)} pages; give a file for each frame")
            page = file.pages.first
            check_page(path, page, data)
            pixels = upright(path, page, np.asarray(page.asarray()))
            depth_m, lateral_m = page_scale(file, page)
    except FrameError:
        raise
    except Exception as fault:  # tifffile and its codecs raise whatever the damage leads to
        raise FrameError(f"{path}: damaged or an unknown kind of TIFF: {fault}") from fault
    return FrameImage(grey_pixels(pixels, path), depth_pixel_m=depth_m, lateral_pixel_m=lateral_m)


def check_page(path: Path, page: "tifffile.TiffPage", data: bytes | mmap) -> None:
    """Check what a page says of its size, and that what is packed in it is no larger.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    if page.photometric not in (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE):
        kind = getattr(page.photometric, "name", page.photometric)
        raise FrameError(f"{path}: a TIFF of kind {kind}; save it as grey (black is zero) or RGB")
    _check_compression(path, page)
    check_size(path, page.imagelength, page.imagewidth, page.samplesperpixel)
    check_size(path, max(2, page.tilelength), max(2, page.tilewidth))
    if page.imagedepth != 1 or page.bitspersample > 64:
        raise FrameError(f"{path}: a TIFF of {page.imagedepth} layers of {page.bitspersample} bits; give one frame")
    largest = int(np.prod(page.chunks)) * 8
    for at, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if _unpacks_to_more(page.compression, data[at : at + count], largest):
            raise FrameError(f"{path}: damaged: more is packed in it than the {page.shape} pixels that it states")


def _check_compression(path: Path, page: "tifffile.TiffPage") -> None:
    from tifffile import TIFF

    try:
        TIFF.DECOMPRESSORS[page.compression]
    except KeyError as fault:
        name = getattr(page.compression, "name", page.compression)
        raise FrameError(
            f"{path}: compressed as {name}; save it without compression, or as ZIP (deflate), or install what reads "
            "it: pip install imagecodecs"
        ) from fault


def _unpacks_to_more(compression: int, packed: bytes, largest: int) -> bool:
    """Return whether a strip or tile gives more bytes than its pixels have at most."""
    if compression in DEFLATE:
        return len(zlib.decompressobj().decompress(packed, largest + 1)) > largest
    if compression == LZMA:
        return len(lzma.LZMADecompressor().decompress(packed, largest + 1)) > largest
    return compression == PACKBITS and unpacked_bytes(packed, largest) > largest


def upright(path: Path, page: "tifffile.TiffPage", pixels: NDArray[Any]) -> NDArray[Any]:
    """Return pixels that are brighter the larger they are, colours last.

    Raises:
        FrameError: a pixel has more bits than the page says.
    """
    if page.photometric == PALETTE and page.colormap is not None:
        # Values of 16 bits; some programs write 8 bits all the same.
        colours = np.asarray(page.colormap)
        colours = (colours if colours.max() < 256 else colours >> 8).astype(np.uint8)
        return np.moveaxis(colours[:, pixels], 0, -1)
    if page.planarconfig == PLANES_APART and pixels.ndim == 3:
        pixels = np.moveaxis(pixels, 0, -1)
    if page.photometric == WHITE_IS_ZERO and pixels.dtype in (np.uint8, np.uint16):
        return inverted(pixels, page.bitspersample, path)
    return pixels


def page_scale(file: "tifffile.TiffFile", page: "tifffile.TiffPage") -> tuple[float | None, float | None]:
    """Return the distance of rows and of columns in m: as OME, ImageJ or the plain tags state it, else None."""
    if file.ome_metadata:
        return _ome_size(file.ome_metadata, "Y"), _ome_size(file.ome_metadata, "X")
    unit_m = {INCH: 25.4e-3, CENTIMETRE: 1e-2}.get(int(page.resolutionunit))
    if file.imagej_metadata and unit_m is None:
        unit = str(file.imagej_metadata.get("unit", "")).replace("\\u00B5", "µ")
        unit_m = METRES.get(unit if unit in METRES else unit.lower())
    sizes = [_size(page, name, unit_m) for name in ("YResolution", "XResolution")]
    printed = unit_m in PRINTED and sizes[0] == sizes[1] and (sizes[0] or 0.0) >= PRINTED_M
    return (None, None) if printed else (sizes[0], sizes[1])


def _size(page: "tifffile.TiffPage", name: str, unit_m: float | None) -> float | None:
    """Return the size of a pixel in m, where the tag has a number of them for each unit."""
    tag = page.tags.get(name)
    count, units = tag.value if tag is not None else (0, 0)
    return units / count * unit_m if unit_m and count > 0 and units > 0 else None


def _ome_size(xml: str, axis: str) -> float | None:
    """Return the physical size of a pixel that OME-XML states, in m; its unit is the micrometre where it names none."""
    pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", xml)
    stated = dict(re.findall(r'(PhysicalSize\w+)\s*=\s*"([^"]*)"', pixels.group())) if pixels else {}
    unit_m = METRES.get(stated.get(f"PhysicalSize{axis}Unit", "µm"))
    size = float(stated.get(f"PhysicalSize{axis}", "nan"))
    return size * unit_m if unit_m and isfinite(size) and size > 0.0 else None
