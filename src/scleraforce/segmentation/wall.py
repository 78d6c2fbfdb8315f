"""The wall of the eye in a raw frame, and a verdict whether it can be judged.

`docs/segmentation.md` explains the steps. Frames are taken one by one, each by one thread; the same frame gives the
same wall, to the last bit, whatever came before it.
"""

from dataclasses import dataclass, replace
from math import isnan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.boundaries import find_as_before, find_boundaries, glance
from scleraforce.segmentation.columns import fine_columns
from scleraforce.segmentation.conjunctiva import below_conjunctiva
from scleraforce.segmentation.found import Segmentation, blank_fault, surface_fault, without_wall
from scleraforce.segmentation.grid import LEAST_SHAPE, Grid, counts_of, grid_size, imaged_part
from scleraforce.segmentation.light import as_logarithmic, find_lit
from scleraforce.segmentation.needle import find_shaft, needle_of
from scleraforce.segmentation.workplace import Workplace, workplace_for

if TYPE_CHECKING:
    from scleraforce.segmentation.wall_finder import WallFinder

LEAST_SIDE = 0.05  # of the imaged width: less beside a needle is not looked at
CACHED = 16  # sizes: black bands at both sides may change from frame to frame

Counts = NDArray[np.uint16]
Flags = NDArray[np.bool_]
Size = tuple[int, int, PixelScale]


def find_wall(
    frame: Pixels, scale: PixelScale, thickness_m: float | None = None, finder: "WallFinder | None" = None
) -> Segmentation:
    """Find the wall in a frame: the one that forces are read from.

    Args:
        frame: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
        scale: size of the frame's pixel, with the refractive index.
        thickness_m: of the wall, if known: its surface is then looked for below a conjunctiva, too.
        finder: a network that checks the wall; None: nothing does, as in the control loop, where its 7 ms are too long.

    Returns:
        Boundaries, mask and verdict; a frame without a wall has NaN boundaries and an empty mask. With a network the
        wall is the one that both methods give (see `checked_wall.checked_by`).

    Raises:
        ValueError: not such an array, or smaller than 16 x 16.
        ModelError: as of `WallFinder.find`.
    """
    frame = as_logarithmic(_checked(frame))
    first = find_first_wall(frame, scale)
    found = below_conjunctiva(frame, scale, first, thickness_m)
    if finder is None:
        return found
    # Imported here: ONNX Runtime takes longer than a frame does.
    from scleraforce.segmentation.checked_wall import checked_by

    return checked_by(finder, frame, scale, first, found)


def find_first_wall(frame: Pixels, scale: PixelScale) -> Segmentation:
    """Find the wall below the first surface that light meets, in a frame of a logarithmic display.

    Arguments, result and errors are those of `find_wall`.
    """
    frame = _checked(frame)
    try:
        steps = _idle_steps.pop()
    except IndexError:
        steps = _Steps()
    try:
        return steps.wall(frame, scale)
    finally:
        _idle_steps.append(steps)


@dataclass(frozen=True, eq=False)
class Part:
    """The imaged part of a frame: `frame` from its column `first` on, as many as `missing` has.

    `left` is that column in the whole frame, of `columns`; what is `missing` has been filled from beside. `hidden`: the
    span of the part's columns that a needle hides. `workplace` is the one for its size.
    """

    frame: Counts
    first: int
    left: int
    columns: int
    missing: Flags
    scale: PixelScale
    workplace: Workplace
    is_bytes: bool
    hidden: tuple[int, int] | None = None

    @property
    def imaged(self) -> Pixels:
        """The columns of the part."""
        return self.frame[:, self.first : self.first + len(self.missing)]

    @property
    def hidden_points(self) -> tuple[int, int]:
        """The first of the surface's points that the needle hides, and the first one after."""
        if self.hidden is None:
            return 0, 0
        start, stop = np.searchsorted(fine_columns(len(self.missing)), (self.hidden[0] - 0.5, self.hidden[1] - 0.5))
        return int(start), int(stop)

    def glance(self, brightest: int) -> tuple[Counts, int, bool, bool]:
        """Return the grid's cells, their noise floor, whether they are saturated, and whether a needle may be there."""
        return glance(self.frame, self.first, self.is_bytes, brightest, self.workplace)

    def grid(self, cells: Counts, floor: int) -> Grid:
        """Return the part's grid, of what `glance` returns."""
        size = grid_size(len(self.frame), len(self.missing), self.scale)
        return Grid(cells[: size.rows, : size.columns], float(floor), size)


def lit_part(frame: Pixels, scale: PixelScale) -> Part | None:
    """Return the imaged part of a frame, with a workplace of its own; None: nothing is imaged."""
    counts, (_, columns) = counts_of(frame), frame.shape
    dark = np.empty(columns, np.bool_)
    left, after, lit, _ = find_lit(counts, np.empty(columns, np.uint16), dark)
    if lit < LEAST_SHAPE:
        return None
    return _Steps().part(counts, frame.dtype == np.uint8, scale, left, dark[left:after].copy())


class _Steps:
    """The steps from a frame to its wall, with tables and memory for some sizes; each thread needs its own."""

    def __init__(self) -> None:
        self._workplaces: dict[Size, Workplace] = {}
        self._before: tuple[Size, tuple[int, int], Workplace] | None = None
        self._brightest, self._dark = np.empty(0, np.uint16), np.empty(0, np.bool_)

    def wall(self, frame: Pixels, scale: PixelScale) -> Segmentation:
        """Return the wall in a frame, by one call of the loops if it is imaged where the frame before was."""
        counts, is_bytes = counts_of(frame), frame.dtype == np.uint8
        found = self._as_before(counts, is_bytes, scale)
        if found is not None:
            return found
        if len(self._dark) != frame.shape[1]:
            self._brightest, self._dark = np.empty(frame.shape[1], np.uint16), np.empty(frame.shape[1], np.bool_)
        left, after, lit, brightest = find_lit(counts, self._brightest, self._dark)
        if lit < LEAST_SHAPE:
            return without_wall(frame.shape, "the frame is empty: all pixels are alike")
        part = self.part(counts, is_bytes, scale, left, self._dark[left:after].copy())
        cells, floor, saturated, suspected = part.glance(brightest)
        fault = blank_fault(floor, brightest, saturated)
        if fault:
            return without_wall(frame.shape, fault)
        grid = part.grid(cells, floor)
        shaft = find_shaft(part.imaged, grid) if suspected else None
        if shaft is None:
            return self._found(part, cells, floor)
        needle = needle_of(shaft, grid, left, frame.shape[1])
        beside = self._beside(counts, part, shaft.hidden)
        if beside is None:
            return without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
        cells, floor, _, _ = beside.glance(0)
        found = replace(self._found(beside, cells, floor), needle=needle)
        for boundary in (found.outer_row, found.inner_row):
            boundary[slice(*needle.hidden)] = np.nan
        return found

    def part(
        self, frame: Counts, is_bytes: bool, scale: PixelScale, left: int, missing: Flags,
        hidden: tuple[int, int] | None = None,
    ) -> Part:  # fmt: skip
        """Return the part of a frame from a column on, without its missing columns; neither end is missing."""
        workplace, columns = self._workplace((len(frame), len(missing), scale)), frame.shape[1]
        if not np.count_nonzero(missing):
            return Part(frame, left, left, columns, missing, scale, workplace, is_bytes, hidden)
        imaged = counts_of(imaged_part(frame, left, missing))
        return Part(imaged, 0, left, columns, missing, scale, workplace, is_bytes, hidden)

    def _as_before(self, frame: Counts, is_bytes: bool, scale: PixelScale) -> Segmentation | None:
        """Return the wall in a frame that is imaged where the one before is, None where the steps are needed."""
        size = (*frame.shape, scale)
        # A frame without light, in between, may have left scratch of another size.
        if self._before is None or self._before[0] != size or len(self._dark) != frame.shape[1]:
            return None
        _, before, workplace = self._before
        rows = np.empty((2, frame.shape[1]))
        seen, contrast, noise, thickness_m = find_as_before(
            frame, is_bytes, self._brightest, self._dark, before, workplace, rows
        )
        if seen < LEAST_SHAPE:
            return None
        return _segmentation(rows, frame.shape, before, seen, contrast, noise, thickness_m)

    def _found(self, part: Part, cells: Counts, floor: int) -> Segmentation:
        """Return the wall in a part of a frame, of which `glance` has found the cells and their noise floor."""
        span, shape = (part.left, part.left + len(part.missing)), (len(part.frame), part.columns)
        if part.frame.shape == shape and part.hidden is None:
            self._before = (*shape, part.scale), span, part.workplace
        rows = np.full((2, part.columns), np.nan)
        outer, inner = rows[0, span[0] : span[1]], rows[1, span[0] : span[1]]
        seen, contrast, noise, thickness_m = find_boundaries(
            part.frame, part.first, cells, floor, part.missing, part.hidden_points, part.workplace, outer, inner
        )
        return _segmentation(rows, shape, span, seen, contrast, noise, thickness_m)

    def _beside(self, frame: Counts, part: Part, hidden: tuple[int, int]) -> Part | None:
        """Return what a frame shows beside a needle that hides a span of its imaged part; None: hardly anything.

        What it hides is filled from both sides, so that the paths that are looked for lead on behind it. A side that is
        narrower than the smoothing of the surface is left out.
        """
        (first, after), missing = hidden, part.missing
        least = max(LEAST_SHAPE, round(LEAST_SIDE * len(missing)))
        start, stop = (after if first < least else 0), (first if len(missing) - after < least else len(missing))
        if stop - start < least:
            return None
        inside = (first - start, after - start) if start < first and after < stop else None
        filled = missing[start:stop].copy()
        if inside is not None:
            filled[slice(*inside)] = True
        lit = np.flatnonzero(~filled)
        if not len(lit):
            return None
        start, filled = start + int(lit[0]), filled[lit[0] : lit[-1] + 1]
        inside = None if inside is None else (inside[0] - int(lit[0]), inside[1] - int(lit[0]))
        return self.part(frame, part.is_bytes, part.scale, part.left + start, filled, inside)

    def _workplace(self, size: Size) -> Workplace:
        """Return the workplace for a size; the one that was made first gives way where there are many."""
        if size not in self._workplaces:
            if len(self._workplaces) == CACHED:
                del self._workplaces[next(iter(self._workplaces))]
            self._workplaces[size] = workplace_for(*size)
        return self._workplaces[size]


_idle_steps: list[_Steps] = []  # those that no thread uses at the moment


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


def _checked(frame: Pixels) -> Pixels:
    if frame.ndim != 2 or frame.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x columns of counts")
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16 x 16")
    return frame
