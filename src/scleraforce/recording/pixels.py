"""Pixels of frames of any file: their type and size, colour to grey, counts of at most 16 bits."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Counts
from scleraforce.errors import FrameError, InputError

if TYPE_CHECKING:
    from scleraforce.recording.folder import OctInfo
    from scleraforce.study import OctStudy

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

MAX_PIXELS = 64 * 2**20
MAX_SAMPLES = 4  # of a pixel: colour and transparency
# JPEG markers that begin a frame: all but tables (C4, CC) and the JPEG extension (C8); F7 is that of JPEG-LS.
FRAME_MARKERS = (set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}) | {0xF7}
STANDALONE_MARKERS = {0x01, *range(0xD0, 0xD9)}
JPEG_2000 = b"\xff\x4f\xff\x51"
MIRRORED = {2: (1,), 3: (0, 1), 4: (0,), 6: (1,), 7: (0, 1), 8: (0,)}  # axes, by TIFF's and EXIF's Orientation
TRANSPOSED = 5  # from this Orientation on, rows are stored as columns


@dataclass(frozen=True)
class Sourced:
    """A value, and its source: "option", "recording.toml", "file", or an assumption."""

    value: float
    source: str


@dataclass(frozen=True, kw_only=True)
class PixelScale:
    """The size of a frame's pixel: along a row (lateral) and along a column (optical depth), m.

    `refractive_index` is optical over geometric depth below the tissue surface; 1 if the scanner has corrected it.
    """

    lateral_m: float
    depth_m: float
    refractive_index: float = 1.0

    def __post_init__(self) -> None:
        if not (0.0 < self.lateral_m < 1.0 and 0.0 < self.depth_m < 1.0):
            raise ValueError(f"a pixel of {self.lateral_m} m x {self.depth_m} m: give its size in metres, above 0")
        if not 1.0 <= self.refractive_index <= 2.0:
            raise ValueError(f"a refractive index of {self.refractive_index}: tissue lies between 1 (corrected) and 2")

    @classmethod
    def of(cls, scanner: "OctStudy | OctInfo") -> "PixelScale":
        """Return the scale of a scanner's frames (`OctStudy`, `OctInfo`)."""
        lateral_m, depth_m = scanner.width_m / scanner.columns, scanner.depth_m / scanner.rows
        return cls(lateral_m=lateral_m, depth_m=depth_m, refractive_index=scanner.refractive_index)


def check_size(rows: int, columns: int, samples: int = 1) -> None:
    """Check the size that a file states, before memory is taken for its pixels."""
    if min(rows, columns) < 2:
        raise FrameError(f"an image of {rows} x {columns} pixels; give one frame, rows x columns")
    if rows * columns > MAX_PIXELS or not 1 <= samples <= MAX_SAMPLES:
        many = f" with {samples} samples each" if samples > 1 else ""
        most = f"a frame may have {MAX_PIXELS // 2**20} million pixels (docs/recordings.md)"
        raise FrameError(f"{rows} x {columns} pixels{many}; {most}")


def grey_pixels(pixels: NDArray[Any], colour: int = cv2.COLOR_RGB2GRAY) -> Pixels:
    """Return grey uint8 or uint16 pixels (rows, columns) of (rows, columns[, 1, 3 or 4]); `colour` is OpenCV's code."""
    if pixels.dtype not in (np.uint8, np.uint16):
        lost = int(np.count_nonzero(~np.isfinite(pixels)))
        found = f"{lost} pixels that are NaN or infinite" if lost else f"{pixels.dtype} pixels"
        raise FrameError(f"{found}; give whole numbers of 8 or 16 bits")
    if pixels.ndim == 3 and pixels.shape[-1] in (3, 4):
        pixels = np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), colour))
    elif pixels.ndim == 3 and pixels.shape[-1] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim != 2:
        raise FrameError(f"an image of shape {pixels.shape}; give one frame, rows x columns")
    check_size(*pixels.shape)
    return pixels


def one_grey(picture: NDArray[Any]) -> NDArray[Any]:
    """Return a picture without colour."""
    return grey_pixels(picture) if picture.ndim == 3 else picture


def inverted(pixels: NDArray[Any], bits: int) -> NDArray[Any]:
    """Exchange dark and bright: subtract unsigned pixels from the largest value of `bits`, change others' sign."""
    if pixels.dtype.kind == "f":
        return -pixels
    if pixels.dtype not in (np.uint8, np.uint16):
        return -pixels.astype(np.int64 if pixels.dtype != np.uint64 else np.float64)
    top = 2**bits - 1
    if int(pixels.max()) > top:
        raise FrameError(f"damaged: a pixel of {int(pixels.max())} is more than {bits} bits")
    turned: NDArray[Any] = pixels.dtype.type(top) - pixels
    return turned


def as_shown(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return pixels turned by TIFF's or EXIF's Orientation (1 to 8), rows and columns first."""
    turned = pixels.swapaxes(0, 1) if orientation >= TRANSPOSED else pixels
    return np.flip(turned, MIRRORED.get(orientation, ()))


def jpeg_frame(data: bytes) -> tuple[int, int, int, bool] | None:
    """Return rows, columns, bits and signedness of a JPEG, JPEG-LS or JPEG 2000 stream, None for others."""
    begin = data.find(JPEG_2000)
    if begin >= 0 and not data.startswith(b"\xff\xd8"):
        right, bottom, left, top = (int.from_bytes(data[begin + at : begin + at + 4], "big") for at in (8, 12, 16, 20))
        depth = int.from_bytes(data[begin + 42 : begin + 43], "big")
        return bottom - top, right - left, (depth & 0x7F) + 1, depth > 0x7F
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker in FRAME_MARKERS:
            rows, columns = (int.from_bytes(data[at + place : at + place + 2], "big") for place in (5, 7))
            return rows, columns, data[at + 4], False
        if marker == 0xFF:  # a fill byte
            at += 1
        elif marker in STANDALONE_MARKERS:
            at += 2
        else:
            at += 2 + max(2, int.from_bytes(data[at + 2 : at + 4], "big"))
    return None


def unpacked_bytes(packed: bytes, most: int) -> int:
    """Return how many bytes PackBits data (TIFF, DICOM's RLE) gives, or a number above `most` once there are more."""
    at, count = 0, 0
    while at < len(packed) and count <= most:
        code = packed[at]
        if code < 128:
            count += min(code + 1, len(packed) - at - 1)
            at += code + 2
        else:
            count += 257 - code if code > 128 else 0
            at += 2 if code > 128 else 1
    return count


MOST_BITS = 16
TOP = 2**MOST_BITS - 1


@dataclass(frozen=True, kw_only=True)
class Greys:
    """The map of pixels to counts: (pixel - `low`) * TOP / (`high` - `low`), or pixel - `low`; `lost` ones are 0."""

    low: float
    high: float
    scaled: bool
    lost: int = 0

    def fit(self, bits: int) -> bool:
        """Return whether this number of bits holds the counts."""
        return (TOP if self.scaled else self.high - self.low) < 1 << bits

    def counts(self, picture: NDArray[Any]) -> Counts:
        """Return a picture (row, column) as counts, row after row in memory."""
        picture = np.ascontiguousarray(picture)
        if not self.scaled:
            return np.asarray(picture.astype(np.int64) - int(self.low), dtype=np.uint16)
        scaled = np.clip((picture.astype(np.float64) - self.low) * (TOP / (self.high - self.low)), 0.0, TOP)
        return np.asarray(np.nan_to_num(np.rint(scaled), nan=0.0), dtype=np.uint16)


def find_greys(pictures: Iterable[NDArray[Any]], given: tuple[float, float] | None, name: str) -> Greys:
    """Return the map of pixels to counts: whole numbers that 16 bits hold stay or are shifted, others are scaled."""
    if given is not None and not given[0] < given[1]:
        raise InputError(f"--grey-range: {given[0]:g} {given[1]:g}; give the darkest value before a larger one")
    low, high, lost, whole = np.inf, -np.inf, 0, True
    for picture in pictures:
        if picture.dtype.kind not in "uif":
            raise FrameError(f"{name}: pixels of type {picture.dtype}; give whole numbers or floats")
        known = picture[np.isfinite(picture)] if picture.dtype.kind == "f" else picture
        whole, lost = whole and picture.dtype.kind != "f", lost + picture.size - known.size
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    if given is not None:
        return Greys(low=given[0], high=given[1], scaled=True, lost=lost)
    if whole and high - min(low, 0.0) <= TOP:
        return Greys(low=min(low, 0.0), high=high, scaled=False)
    if not low < high:
        raise FrameError(f"{name}: all pixels have one value or none; there is nothing to see in them")
    return Greys(low=low, high=high, scaled=True, lost=lost)
