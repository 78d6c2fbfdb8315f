"""Frames as a file of any format has them, and what it states of them; what it does not state is None."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.scaled_frame import Sourced

__all__ = [
    "LARGEST_BYTES",
    "PictureStream",
    "Scan",
    "Times",
    "UnansweredError",
    "check_bytes",
    "even_times",
    "frame_names",
    "joined",
    "rising",
]

PictureStream = Iterator[NDArray[Any]]

LARGEST_BYTES = 16 * 2**30  # of the frames of one source, unpacked


class UnansweredError(InputError):
    """A source leaves something open, and the option that answers it was not given.

    Args:
        option: like "--axes".
        question: what the source leaves open, in words.
        forms: of the answers, where the option is given several times.
    """

    def __init__(self, option: str, question: str, *forms: str) -> None:
        super().__init__(f"{question}; give {' '.join(f'{option} {form}' for form in forms) or option}")
        self.option, self.question, self.forms = option, question, forms


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


def joined(scans: Sequence[Scan]) -> Scan:
    """Return several files of frames as one scan: in the order of their times, or as they are given.

    Raises:
        FrameError: they differ in size, scale or bits.
    """
    first = scans[0]
    for scan in scans[1:]:
        if _kind(scan) != _kind(first):
            raise FrameError(
                f"{scan.names[0]}: another size, scale or number of bits than {first.names[0]}; import frames of one "
                "kind at a time"
            )
    ordered, times = _by_time(scans)
    return replace(
        first,
        names=tuple(name for scan in ordered for name in scan.names),
        pictures=lambda: (picture for scan in ordered for picture in _checked(scan)),
        times=times,
        notes=tuple(dict.fromkeys(note for scan in scans for note in scan.notes)),
    )


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


def _checked(scan: Scan) -> PictureStream:
    """Yield a scan's frames where they are as many and as large as it says; damaged files have others.

    Raises:
        FrameError: they are not.
    """
    count = 0
    for picture in scan.pictures():
        count += 1
        if picture.shape != (scan.rows, scan.columns) or count > len(scan.names):
            raise FrameError(
                f"{scan.names[0]}: damaged: a frame of {picture.shape}, number {count}, that it does not state"
            )
        yield picture
    if count < len(scan.names):
        raise FrameError(f"{scan.names[0]}: damaged: {count} of {len(scan.names)} frames can be read")


def _kind(scan: Scan) -> tuple[object, ...]:
    sizes = (scan.depth_pixel_m, scan.lateral_pixel_m)
    return (scan.rows, scan.columns, scan.bits, *(size and round(size.value, 12) for size in sizes))


def _by_time(scans: Sequence[Scan]) -> tuple[Sequence[Scan], Times | None]:
    stated = [scan.times for scan in scans if scan.times is not None]
    if len(stated) < len(scans):
        return scans, None
    order = sorted(range(len(scans)), key=lambda nth: float(stated[nth].time_s[0]))
    time_s = np.concatenate([stated[nth].time_s for nth in order])
    return ([scans[nth] for nth in order], Times(time_s, stated[0].source)) if rising(time_s) else (scans, None)
