"""The steps as compiled loops (`kernels`), in memory that is kept for the next frame of the same size.

They round as NumPy and OpenCV 5 do, but for sums of products, which are taken in double precision: boundaries differ by
less than 1e-3 rows, unless two edges in a column fit equally well.
"""

from math import isnan

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.columns import fine_columns
from scleraforce.segmentation.imaged import LEAST_SHAPE
from scleraforce.segmentation.kernels.boundaries import find_as_before, find_boundaries, glance
from scleraforce.segmentation.kernels.lit import find_lit
from scleraforce.segmentation.kernels.workplace import Workplace, workplace_for
from scleraforce.segmentation.steps import Part, Segmentation, blank_fault, surface_fault, without_wall

KEPT = 16  # sizes: black bands at both sides may change from frame to frame

Counts = NDArray[np.uint16]
Size = tuple[int, int, PixelScale]


class CompiledSteps:
    """The steps, for one frame after another; of several threads each needs its own.

    `found` is asked about the part that `glance` has seen last, or about one beside a needle.
    """

    def __init__(self) -> None:
        self._workplaces: dict[Size, Workplace] = {}
        self._seen: tuple[Part, Counts, int] | None = None
        self._before: tuple[Size, tuple[int, int], Workplace] | None = None
        self._brightest, self._dark = np.empty(0, np.uint16), np.empty(0, np.bool_)

    def at_once(self, frame: Pixels, scale: PixelScale) -> Segmentation | None:
        """Return the wall in a frame that is imaged where the one before is, None where the steps are needed."""
        size = (*frame.shape, scale)
        # A frame without light, in between, may have left scratch of another size, which the loops would overrun.
        if self._before is None or self._before[0] != size or len(self._dark) != frame.shape[1]:
            return None
        _, before, workplace = self._before
        rows = np.empty((2, frame.shape[1]))
        seen, contrast, noise, thickness_m = find_as_before(
            _counts(frame), frame.dtype == np.uint8, self._brightest, self._dark, before, workplace, rows
        )
        return (
            None if seen < LEAST_SHAPE else _segmentation(rows, frame.shape, before, seen, contrast, noise, thickness_m)
        )

    def lit_columns(self, frame: Pixels) -> tuple[int, NDArray[np.bool_], int] | None:
        """See `imaged.lit_columns`."""
        self._brightest, self._dark = np.empty(frame.shape[1], np.uint16), np.empty(frame.shape[1], np.bool_)
        left, after, lit, largest = find_lit(_counts(frame), self._brightest, self._dark)
        return (left, self._dark[left:after].copy(), largest) if lit >= LEAST_SHAPE else None

    def glance(self, part: Part, brightest: int) -> tuple[str, bool]:
        """Return why nothing can be looked for, and whether something at the top edge may be a needle."""
        eight_bits, workplace = part.frame.dtype == np.uint8, self._workplace(part)
        cells, floor, saturated, needle = glance(_counts(part.frame), part.first, eight_bits, brightest, workplace)
        self._seen = part, cells, floor
        return blank_fault(floor, brightest, saturated), needle

    def found(self, part: Part) -> Segmentation:
        """Return the wall in a part of a frame."""
        if self._seen is None or self._seen[0] is not part:
            self.glance(part, 0)
        assert self._seen is not None
        _, cells, floor = self._seen
        workplace, behind = self._workplace(part), part.hidden_points
        span, shape = (part.left, part.left + len(part.missing)), (len(part.frame), part.columns)
        if part.frame.shape == shape and part.hidden is None:
            self._before = (*shape, part.scale), span, workplace
        rows = np.full((2, part.columns), np.nan)
        outer, inner = rows[0, span[0] : span[1]], rows[1, span[0] : span[1]]
        seen, contrast, noise, thickness_m = find_boundaries(
            _counts(part.frame), part.first, cells, floor, part.missing, (behind.start, behind.stop), workplace,
            outer, inner,
        )  # fmt: skip
        return _segmentation(rows, shape, span, seen, contrast, noise, thickness_m)

    def _workplace(self, part: Part) -> Workplace:
        """Return the workplace for a part of a frame; the one that was made first gives way where there are many."""
        size = len(part.frame), len(part.missing), part.scale
        if size not in self._workplaces:
            if len(self._workplaces) == KEPT:
                del self._workplaces[next(iter(self._workplaces))]
            self._workplaces[size] = workplace_for(*size)
        return self._workplaces[size]


def _segmentation(
    rows: NDArray[np.float64], shape: tuple[int, ...], span: tuple[int, int], seen: int, contrast: float, noise: float,
    thickness_m: float,
) -> Segmentation:  # fmt: skip
    """Return what was found in the columns of a span: boundaries (2, column), and what `find_boundaries` returns."""
    fault = surface_fault(seen, len(fine_columns(span[1] - span[0])), contrast, noise)
    if seen < LEAST_SHAPE:
        return without_wall(shape, fault or "no wall was found")
    found = not isnan(thickness_m)
    return Segmentation(rows[0], rows[1], shape[0], not fault, fault, found, thickness_m=thickness_m)


def _counts(frame: Pixels) -> Counts:
    """Return a frame as the kernels take it: one type for all, which are compiled once."""
    counts = np.ascontiguousarray(frame, np.uint16).view()
    counts.flags.writeable = False
    return counts
