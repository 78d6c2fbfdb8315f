"""Frames as a file of any format has them, and what it states of them; None: the file does not state it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import Sourced
from scleraforce.units import from_si

PictureStream = Iterator[NDArray[Any]]

LARGEST_BYTES = 16 * 2**30  # of the frames of one source, unpacked
METRES = {
    "m": 1.0, "meter": 1.0, "metre": 1.0, "cm": 1e-2, "centimeter": 1e-2, "inch": 25.4e-3, "in": 25.4e-3, "mm": 1e-3,
    "millimeter": 1e-3, "millimetre": 1e-3, "µm": 1e-6, "μm": 1e-6, "um": 1e-6, "micron": 1e-6, "microns": 1e-6,
    "micrometer": 1e-6, "micrometre": 1e-6, "nm": 1e-9, "nanometer": 1e-9,
}  # fmt: skip
SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "sek": 1.0, "sekunden": 1.0, "secondes": 1.0, "min": 60.0,
    "h": 3600.0, "d": 86400.0, "days": 86400.0, "ms": 1e-3, "msec": 1e-3, "milliseconds": 1e-3, "us": 1e-6,
    "µs": 1e-6, "usec": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nsec": 1e-9, "nanoseconds": 1e-9,
}  # fmt: skip
ROUNDED = 0.001  # sizes of a pixel that differ by less were rounded


@dataclass(frozen=True, eq=False)
class Times:
    """When frames were taken, s, on a clock of the source's own, and who states it."""

    time_s: NDArray[np.float64]
    source: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan:
    """Frames of one or several files.

    Attributes:
        names: of the frames, for messages.
        rows: depth.
        columns: lateral.
        pictures: gives the frames (row, column) from the first on, whenever it is called: whole numbers or floats,
            larger is brighter.
        bits: that the pixels use, where the file says so.
        depth_pixel_m: distance of rows.
        lateral_pixel_m: distance of columns.
        times: of the frames.
        notes: sentences on what was done to the frames, or is to be known of them.
        scale_fault: the contradiction in what the file states of its scale; the sizes of a pixel are None then.
        times_fault: the contradiction in what the file states of its times; `times` is None then.
    """

    names: tuple[str, ...]
    rows: int
    columns: int
    pictures: Callable[[], PictureStream]
    bits: int | None = None
    depth_pixel_m: Sourced | None = None
    lateral_pixel_m: Sourced | None = None
    times: Times | None = None
    notes: tuple[str, ...] = ()
    scale_fault: str | None = None
    times_fault: str | None = None

    def turned(self) -> "Scan":
        """Return the scan with depth along the columns' index made depth along the rows'."""
        return replace(
            self,
            rows=self.columns,
            columns=self.rows,
            pictures=lambda: (picture.T for picture in self.pictures()),
            depth_pixel_m=self.lateral_pixel_m,
            lateral_pixel_m=self.depth_pixel_m,
        )


@dataclass(frozen=True)
class PixelSize:
    """The size of a pixel that one field of a file states."""

    source: str
    _: KW_ONLY
    depth_m: float | None
    lateral_m: float | None

    @property
    def words(self) -> str:
        """The field and its values, for messages."""
        sizes = ("?" if size_m is None else f"{from_si(size_m, 'mm'):.6g}" for size_m in (self.depth_m, self.lateral_m))
        return f"{self.source} states pixels of {' x '.join(sizes)} mm (depth x lateral)"

    def differs(self, other: "PixelSize") -> bool:
        """Return whether the two sizes cannot both be right."""
        pairs = ((self.depth_m, other.depth_m), (self.lateral_m, other.lateral_m))
        return any(mine and theirs and abs(mine - theirs) > ROUNDED * mine for mine, theirs in pairs)


def one_size(path: Path, sizes: Sequence[PixelSize]) -> tuple[Sourced | None, Sourced | None, str | None]:
    """Return the distance of rows and of columns by the first field that states one, and the fault if fields differ."""
    stated = [size for size in sizes if size.depth_m or size.lateral_m]
    if not stated:
        return None, None, None
    first = stated[0]
    other = next((size for size in stated[1:] if size.differs(first)), None)
    if other is not None:
        return None, None, f"{path}: {first.words}, {other.words}"
    depth, lateral = (size_m and Sourced(size_m, first.source) for size_m in (first.depth_m, first.lateral_m))
    return depth or None, lateral or None, None


def frame_names(path: Path, count: int) -> tuple[str, ...]:
    """Return the names of a file's frames.

    >>> frame_names(Path("a.tif"), 2), frame_names(Path("b.tif"), 1)
    (('a.tif[0]', 'a.tif[1]'), ('b.tif',))
    """
    return tuple(f"{path}[{nth}]" for nth in range(count)) if count > 1 else (str(path),)


def even_times(count: int, step_s: float, source: str) -> Times | None:
    """Return times in even steps from 0 on; None where the step is none."""
    return Times(np.arange(count, dtype=np.float64) * step_s, source) if step_s > 0.0 else None


def rising(time_s: NDArray[np.float64]) -> bool:
    """Return whether every time comes after the one before.

    >>> rising(np.array([0.0, 0.1])), rising(np.array([0.0, 0.0]))
    (True, False)
    """
    return bool(np.isfinite(time_s).all() and (np.diff(time_s) > 0.0).all())


def check_bytes(path: Path, count: int) -> None:
    """Check how much memory or room the frames of a file take, before they are read.

    Raises:
        FrameError: too much.
    """
    if count > LARGEST_BYTES:
        raise FrameError(f"{path}: {count:,} bytes of frames; {LARGEST_BYTES // 2**30} GiB at most (docs/formats.md)")
