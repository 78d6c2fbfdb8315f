"""From the IMAGE messages of a scanner to B-scans: counts, the size of a pixel, and images sent in parts."""

from dataclasses import KW_ONLY, dataclass, replace
from math import hypot, prod
from typing import Any

import numpy as np

from scleraforce.errors import ProtocolError
from scleraforce.openigtlink import MAX_BODY_BYTES, Image
from scleraforce.recording.pixels import Pixels
from scleraforce.units import to_si

SENT = tuple(map(np.dtype, ("int8", "uint8", "int16", "uint16")))


@dataclass(frozen=True, eq=False)
class ScannerFrame:
    """A B-scan as the scanner sent it; `lateral_m` and `depth_m` are the stated size of a pixel.

    `pixels` (row, column) are uint8 or uint16 and read-only; `sent_type` is their type as it was sent.
    """

    pixels: Pixels
    _: KW_ONLY
    lateral_m: float
    depth_m: float
    sent_type: str = "uint16"


class FrameAssembler:
    """Assembles frames from the images of one scanner; it holds at most one frame of at most `max_frame_bytes`.

    The part of an image with its first pixel has to come first, the others in any order. So the end of an image whose
    beginning was lost is not taken for the beginning of the next. Start a new assembler after every lost message
    (`BadChecksum`, `Malformed`): then no frame mixes two images.
    """

    def __init__(self, max_frame_bytes: int = MAX_BODY_BYTES) -> None:
        self.max_frame_bytes = max_frame_bytes
        self._begun: _Begun | None = None

    def add(self, image: Image) -> ScannerFrame | None:
        """Take the next image of the scanner; return the frame that it completes, None if parts are still missing.

        A whole image is not copied. A ProtocolError refuses an image that is not a B-scan, or does not belong to the
        parts before it, which are forgotten; a new frame begins with the image if it has the first pixel.
        """
        begun, self._begun = self._begun, None
        frame, part = _frame(image), _Part.of(image)
        if begun is None and part.whole:
            return frame
        reason = begun.refusal(part) if begun else None
        if begun is None or (reason and part.first and not part.whole):
            begun = _Begun(part, frame.pixels.dtype, self.max_frame_bytes)
        if reason is None or begun.first is part:
            begun.put(frame.pixels, part)
            self._begun = begun if begun.left else None
        if reason:
            raise ProtocolError(f"IMAGE: the part {part} {reason}")
        if begun.left:
            return None
        begun.pixels.flags.writeable = False
        return replace(frame, pixels=begun.pixels)


@dataclass(frozen=True)
class _Part:
    """A part's place in the whole image (rows, columns), and its statement of the whole, in which all parts agree."""

    rows: slice
    columns: slice
    size: tuple[int, int]
    stated: tuple[object, ...]

    @classmethod
    def of(cls, image: Image) -> "_Part":
        _, rows, columns = image.pixels.shape
        whole_columns, whole_rows, _ = image.size or (columns, rows, 1)
        column, row, _ = image.offset
        size = whole_rows, whole_columns
        stated = size, image.pixels.dtype, image.matrix, image.coordinates
        return cls(slice(row, row + rows), slice(column, column + columns), size, stated)

    @property
    def first(self) -> bool:
        return (self.rows.start, self.columns.start) == (0, 0)

    @property
    def whole(self) -> bool:
        return (self.rows.stop - self.rows.start, self.columns.stop - self.columns.start) == self.size

    def __str__(self) -> str:
        rows, columns = self.rows, self.columns
        return f"rows {rows.start} to {rows.stop}, columns {columns.start} to {columns.stop} of {self.size}"


class _Begun:
    """A frame of which parts have come; `left` pixels are missing."""

    def __init__(self, first: _Part, dtype: np.dtype[Any], most_bytes: int) -> None:
        stated = prod(first.size) * dtype.itemsize
        if not first.first:
            raise ProtocolError(f"IMAGE: the part {first} arrived without the one with the first pixel")
        if stated > most_bytes:
            raise ProtocolError(f"IMAGE: parts of an image of {stated} bytes: at most {most_bytes}")
        self.first, self.left = first, prod(first.size)
        self.pixels: Pixels = np.empty(first.size, dtype=dtype)
        self._covered = np.zeros(first.size, dtype=np.bool_)

    def refusal(self, part: _Part) -> str | None:
        """Return the reason if a part does not belong here."""
        if part.stated != self.first.stated:
            return "states another size, type or matrix than those before it"
        return "overlaps those before it" if self._covered[part.rows, part.columns].any() else None

    def put(self, pixels: Pixels, part: _Part) -> None:
        self.pixels[part.rows, part.columns] = pixels
        self._covered[part.rows, part.columns] = True
        self.left -= pixels.size


def _frame(image: Image) -> ScannerFrame:
    """Return the pixels of an image as counts, and their size."""
    pixels = image.pixels
    if pixels.dtype not in SENT:
        raise ProtocolError(f"IMAGE: {pixels.dtype} pixels: must be 8 or 16 bit in this machine's byte order")
    slices = (image.size or (0, 0, pixels.shape[0]))[2]
    if pixels.ndim != 3 or slices != 1:
        components = pixels.shape[3] if pixels.ndim == 4 else 1
        raise ProtocolError(f"IMAGE: {slices} slices, {components} components: a B-scan has one of each")
    if pixels.dtype.kind == "i" and pixels.min() < 0:
        raise ProtocolError(f"IMAGE: {pixels.dtype} pixels down to {pixels.min()}: none may be negative")
    lateral_m, depth_m = (to_si(hypot(*image.matrix[n : n + 3]), "mm") for n in (0, 3))
    if not (lateral_m > 0.0 and depth_m > 0.0):
        raise ProtocolError(f"IMAGE: pixels of {lateral_m} x {depth_m} m: the matrix's columns must have a length")
    counts = pixels[0].view(f"u{pixels.itemsize}")
    counts.flags.writeable = False
    return ScannerFrame(counts, lateral_m=lateral_m, depth_m=depth_m, sent_type=pixels.dtype.name)
