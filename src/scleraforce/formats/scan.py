"""Several files of frames as one scan, and what their sources leave open."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.scan import (
    PictureStream,
    Scan,
    Times,
    rising,
)
from scleraforce.units import from_si

KIND = ("rows", "columns", "bits", "depth of a pixel (um)", "width of a pixel (um)")  # the same in all files


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


def joined(scans: Sequence[Scan]) -> Scan:
    """Return several files of frames as one scan: in the order of their times, or as they are given.

    Raises:
        FrameError: they differ in size, scale or bits.
    """
    first = scans[0]
    for scan in scans[1:]:
        for field, mine, theirs in zip(KIND, _kind(scan), _kind(first), strict=True):
            if mine != theirs:
                found = f"{field} {_words(mine)}, where {first.names[0]} has {_words(theirs)}"
                raise FrameError(f"{scan.names[0]}: {found}; import frames of one kind at a time")
    ordered, times = _by_time(scans)
    return replace(
        first,
        names=tuple(name for scan in ordered for name in scan.names),
        pictures=lambda: (picture for scan in ordered for picture in _checked(scan)),
        times=times,
        scale_fault=next((scan.scale_fault for scan in scans if scan.scale_fault), None),
        times_fault=next((scan.times_fault for scan in scans if scan.times_fault), None),
        notes=tuple(dict.fromkeys(note for scan in scans for note in scan.notes)),
    )


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


def _kind(scan: Scan) -> tuple[float | None, ...]:
    sizes = (scan.depth_pixel_m, scan.lateral_pixel_m)
    sizes_um = (None if size is None else float(f"{from_si(size.value, 'um'):.9g}") for size in sizes)
    return (scan.rows, scan.columns, scan.bits, *sizes_um)


def _words(value: float | None) -> str:
    return "not stated" if value is None else f"{value:g}"


def _by_time(scans: Sequence[Scan]) -> tuple[Sequence[Scan], Times | None]:
    stated = [scan.times for scan in scans if scan.times is not None]
    if len(stated) < len(scans):
        return scans, None
    order = sorted(range(len(scans)), key=lambda nth: float(stated[nth].time_s[0]))
    time_s = np.concatenate([stated[nth].time_s for nth in order])
    return ([scans[nth] for nth in order], Times(time_s, stated[0].source)) if rising(time_s) else (scans, None)
