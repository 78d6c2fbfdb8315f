"""A frame: its pixels, its scale, its mask, and where each is from."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.scan import OctInfo, PixelScale

if TYPE_CHECKING:
    from scleraforce.records.scan import OctInfo


Pixels = NDArray[np.uint8] | NDArray[np.uint16]


def check_frame(pixels: Pixels, stated: OctInfo, path: Path) -> None:
    """Check a frame against its recording.toml."""
    fault = None
    largest = int(pixels.max())

    if pixels.shape != (stated.rows, stated.columns):
        found = " x ".join(map(str, pixels.shape))
        fault = (
            f"{found} pixels (rows x columns); recording.toml says {stated.rows} x"
            f" {stated.columns}"
        )
    elif pixels.dtype == np.uint8 and stated.bits > 8:
        fault = f"8 bits a pixel; recording.toml says {stated.bits}"
    elif largest >= 2**stated.bits:
        fault = (
            f"a pixel of {largest} is more than {stated.bits} bits; check bits in"
            " recording.toml"
        )

    if fault is not None:
        raise FrameError(f"{path}: {fault}")


def frame_digest(pixels: Pixels) -> str:
    """Return the SHA-256 of a frame's size and pixels, hexadecimal.

    >>> import numpy as np
    >>> narrow, wide = (np.zeros((2, 3), kind) for kind in (np.uint8, np.uint16))
    >>> frame_digest(narrow) == frame_digest(wide)
    True
    """
    size = f"{pixels.shape[0]} x {pixels.shape[1]}\n".encode()
    return hashlib.sha256(size + pixels.astype("<u2").tobytes()).hexdigest()


@dataclass(frozen=True)
class SourcedValue:
    """A value, and its source: "option", "recording.toml", "file", or an assumption."""

    value: float
    source: str


@dataclass(frozen=True, eq=False)
class ScaledFrame:
    """A frame (rows: depth, columns: lateral) with its scale, notes, and its
    recording's metadata if it has any.
    """

    pixels: Pixels
    width_m: SourcedValue
    depth_m: SourcedValue
    refractive_index: SourcedValue
    info: RecordingInfo | None
    notes: tuple[str, ...] = ()

    @property
    def scale(self) -> PixelScale:
        """Size of a pixel as stored, with the refractive index."""
        rows, columns = self.pixels.shape
        lateral_m = self.width_m.value / columns
        depth_m = self.depth_m.value / rows
        return PixelScale(
            lateral_m=lateral_m,
            depth_m=depth_m,
            refractive_index=self.refractive_index.value,
        )


NO_WALL = 0

NOT_JUDGED = 128

WALL = 255
