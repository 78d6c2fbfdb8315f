"""From the IMAGE messages of a scanner to B-scans: counts, the size of a pixel, and
images sent in parts.
"""

from dataclasses import KW_ONLY, dataclass, replace
from math import hypot, prod

import numpy as np

from scleraforce.base.arrays import Flags
from scleraforce.base.errors import ProtocolError
from scleraforce.base.units import to_si
from scleraforce.live.network.openigtlink import MAX_BODY_BYTES, Image
from scleraforce.records.frame import Pixels

SENT = tuple(map(np.dtype, ("int8", "uint8", "int16", "uint16")))


@dataclass(frozen=True, eq=False)
class ScannerFrame:
    """A B-scan as the scanner sent it; `lateral_m` and `depth_m` are the stated size of
    a pixel.

    `pixels` (row, column) are uint8 or uint16 and read-only; `sent_type` is their type
    as it was sent. `begun_s`: arrival of the first part of a frame that was sent in
    parts; None if it was not.
    """

    pixels: Pixels
    _: KW_ONLY
    lateral_m: float
    depth_m: float
    sent_type: str = "uint16"
    begun_s: float | None = None


class FrameAssembler:
    """Assembles frames from the images of one scanner; it holds at most one frame of at
    most `max_frame_bytes`.

    The part of an image with its first pixel has to come first, the others in any
    order. So the end of an image whose beginning was lost is not taken for the
    beginning of the next. Start a new assembler after every lost message
    (`BadChecksum`, `Malformed`): then no frame mixes two images.
    """

    def __init__(self, max_frame_bytes: int = MAX_BODY_BYTES) -> None:
        self.max_frame_bytes = max_frame_bytes
        self._stated: tuple[
            object, ...
        ] = ()  # by all parts of the frame that has begun; empty if none has
        self._begun_s = 0.0
        self._pixels: Pixels = np.empty((0, 0), np.uint16)
        self._missing: Flags = np.empty((0, 0), np.bool_)

    def add(
        self, image: Image, at_s: float = 0.0, sent_s: float | None = None
    ) -> ScannerFrame | None:
        """Take the next image of the scanner, which came at `at_s` and states `sent_s`;
        return the frame that it completes, None if parts are still missing.

        All parts of a frame state one time: those of another are of another picture.
        A whole image is not copied. A ProtocolError refuses an image that is not a
        B-scan, or does not belong to the parts before it, which are forgotten; a new
        frame begins with the image if it has the first pixel.
        """
        begun = self._stated
        self._stated = ()
        frame = _frame(image)
        rows, columns = frame.pixels.shape
        column, row, _ = image.offset
        whole_columns, whole_rows, _ = image.size or (columns, rows, 1)

        size = whole_rows, whole_columns
        if not begun and (rows, columns) == size:
            return frame

        place = np.s_[row : row + rows, column : column + columns]
        stated = size, image.pixels.dtype, image.matrix, image.coordinates, sent_s
        part = (
            f"IMAGE: the part rows {row} to {row + rows}, columns {column} to"
            f" {column + columns} of {size}"
        )
        reason = ""

        if begun and stated != begun:
            reason = "states another size, type, matrix or time than those before it"
        elif begun and not self._missing[place].all():
            reason = "overlaps those before it"

        begins = not begun or (
            bool(reason) and (row, column) == (0, 0) and (rows, columns) != size
        )
        if begins:
            if (row, column) != (0, 0):
                raise ProtocolError(
                    f"{part} arrived without the one with the first pixel"
                )
            if (needed := prod(size) * frame.pixels.itemsize) > self.max_frame_bytes:
                raise ProtocolError(
                    f"IMAGE: parts of an image of {needed} bytes: at most"
                    f" {self.max_frame_bytes}"
                )

            self._pixels = np.empty(size, frame.pixels.dtype)
            self._missing = np.ones(size, np.bool_)
            self._begun_s = at_s

        if begins or not reason:
            self._pixels[place] = frame.pixels
            self._missing[place] = False
            self._stated = stated if self._missing.any() else ()

        if reason:
            raise ProtocolError(f"{part} {reason}")
        if self._stated:
            return None

        self._pixels.flags.writeable = False
        return replace(frame, pixels=self._pixels, begun_s=self._begun_s)


def _frame(image: Image) -> ScannerFrame:
    pixels = image.pixels
    if pixels.dtype not in SENT:
        raise ProtocolError(
            f"IMAGE: {pixels.dtype} pixels: must be 8 or 16 bit in this machine's byte"
            " order"
        )

    slices = (image.size or (0, 0, pixels.shape[0]))[2]
    if pixels.ndim != 3 or slices != 1:
        components = pixels.shape[3] if pixels.ndim == 4 else 1
        raise ProtocolError(
            f"IMAGE: {slices} slices, {components} components: a B-scan has one of each"
        )
    if pixels.dtype.kind == "i" and pixels.min() < 0:
        raise ProtocolError(
            f"IMAGE: {pixels.dtype} pixels down to {pixels.min()}: none may be negative"
        )

    lateral_m, depth_m = (to_si(hypot(*image.matrix[n : n + 3]), "mm") for n in (0, 3))
    if not (lateral_m > 0.0 and depth_m > 0.0):
        raise ProtocolError(
            f"IMAGE: pixels of {lateral_m} x {depth_m} m: the matrix's columns must"
            " have a length"
        )

    counts = pixels[0].view(f"u{pixels.itemsize}")
    counts.flags.writeable = False
    return ScannerFrame(
        counts, lateral_m=lateral_m, depth_m=depth_m, sent_type=pixels.dtype.name
    )
