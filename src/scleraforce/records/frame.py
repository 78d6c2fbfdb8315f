"""A frame: its pixels, its scale, its mask, and where each is from; the frames of one
moment.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError, InputError
from scleraforce.records.fields import check_fields, check_kind, optional_quantity
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.scan import PixelScale, Scan

Pixels = NDArray[np.uint8] | NDArray[np.uint16]


def check_frame(pixels: Pixels, stated: Scan, path: Path) -> None:
    """Check a frame against its recording.toml."""
    fault = None
    largest = int(pixels.max())

    if pixels.shape != (stated.rows, stated.columns):
        found = " x ".join(map(str, pixels.shape))
        fault = (
            f"{found} pixels (rows x columns); recording.toml says {stated.rows} x"
            f" {stated.columns}"
        )
    elif pixels.dtype == np.uint8 and stated.pixel_bits > 8:
        fault = f"8 bits a pixel; recording.toml says {stated.bits}"
    elif largest >= 2**stated.pixel_bits:
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


MASK_SD_ROWS = 2.0  # of the boundaries of a mask that people draw

FrameSource = str | PathLike[str] | NDArray[Any]
Mask = str | PathLike[str] | NDArray[Any]


@dataclass(frozen=True, eq=False)
class Frame:
    """A B-scan to be read, and what is known of it.

    Attributes:
        pixels: an image file, or an array (row, column), whose rows go down into the
            eye.
        plane: name of the plane that it shows, one of the scan's. None: the only one,
            or its place in the order of the planes; of a recording's frame, as stated
            there.
        mask: the wall in place of the one that is found: an image file, or an array of
            the frame's shape, 255 or True where wall is, 128 in columns that are not
            judged. None: the recording's, else the one that is found.
        mask_sd_rows: standard deviation of the mask's boundaries, rows.

    Raises:
        InputError: `mask_sd_rows` is no number above 0, or `plane` no name.

    >>> import scleraforce as sf
    >>> sf.Frame("eye-a/frames/0002.png", mask="mine.png").mask_sd_rows
    2.0
    """

    pixels: FrameSource
    _: KW_ONLY
    plane: str | None = None
    mask: Mask | None = None
    mask_sd_rows: float = MASK_SD_ROWS

    def __post_init__(self) -> None:
        check_fields(self)
        check_kind("plane", self.plane, str, '"across"')
        if self.mask_sd_rows is None or self.mask_sd_rows <= 0.0:
            raise InputError(
                f"mask_sd_rows: {self.mask_sd_rows}; give the standard deviation of"
                " the mask's boundaries, rows"
            )


@dataclass(frozen=True, eq=False)
class Moment:
    """The frames of one moment, one of each plane, which are read together.

    Attributes:
        frames: one, or one of each plane.
        time_s: on a clock that the moments of a sequence share. None: of a recording's
            frames that are read in a sequence, as frames.csv lists it; else it is not
            known what was before.
        held_s: time since the needle's push, in tissue that relaxes. None: as
            frames.csv lists it, else as in the frames of the calibration.
        iop_pa: pressure at rest at this moment, as sure as the eye's own (its
            `iop_sd_pa`). None: as frames.csv lists it, else the eye's.
        travel_m: the needle's travel along its axis, inwards, from any start. None: as
            frames.csv lists it, else not known; a fall of the force may then be a
            withdrawal as fast as a robot makes it.

    Raises:
        InputError: there is no frame, `held_s` is below 0, or a field is no finite
            number.

    >>> import scleraforce as sf
    >>> frame = sf.Frame("eye-a/frames/0002.png")
    >>> sf.Moment((frame,), held_s=1.5).held_s
    1.5
    """

    frames: tuple[Frame, ...]
    _: KW_ONLY
    time_s: float | None = None
    held_s: float | None = None
    iop_pa: float | None = optional_quantity("iop_pa")
    travel_m: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.frames, tuple) or not all(
            isinstance(frame, Frame) for frame in self.frames
        ):
            raise InputError("frames: give a tuple of Frame, like (Frame(path),)")
        if not self.frames:
            raise InputError("frame: none; give one, or one of each plane")
        check_fields(self)
        if self.held_s is not None and self.held_s < 0.0:
            raise InputError(
                f"held_s: {self.held_s:g}; give the time since the push, 0 s or more"
            )


@dataclass(frozen=True, eq=False)
class OpenedFrame:
    """A frame (rows: depth, columns: lateral) in memory.

    `scan` has its width, depth and refractive index, `sources` where each of these is
    from: "option", "recording.toml", "file", or an assumption. `info`: of the recording
    that it is in, None without one.
    """

    pixels: Pixels
    scan: Scan
    sources: Mapping[str, str]
    info: RecordingInfo | None
    notes: tuple[str, ...] = ()

    @property
    def scale(self) -> PixelScale:
        """Size of a pixel as stored, with the refractive index."""
        return self.scan.scale_of(self.pixels.shape)


NO_WALL = 0

NOT_JUDGED = 128

WALL = 255
