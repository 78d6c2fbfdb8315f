"""The wall of the eye in a raw frame, and a verdict whether it can be judged.

`docs/segmentation.md` explains the steps. Frames are taken one by one, each by one
thread; the same frame gives the same wall, to the last bit, whatever the frames before
it show.
"""

from dataclasses import replace
from math import isnan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scleraforce.arrays import Counts, Flags, Integers
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.boundaries import (
    FINE_COLUMNS,
    Workplace,
    fine_columns,
    look,
    workplace_for,
)
from scleraforce.segmentation.conjunctiva import below_conjunctiva
from scleraforce.segmentation.found import (
    EMPTY_SHARE,
    LEAST_COVER,
    SATURATED_SHARE,
    Segmentation,
    surface_fault,
    without_wall,
)
from scleraforce.segmentation.light import (
    LEAST_SHAPE,
    NOT_LOGARITHMIC,
    Lit,
    as_logarithmic,
    counts_of,
    find_lit,
    grid_size,
    without_page,
)
from scleraforce.segmentation.needle import find_needle

if TYPE_CHECKING:
    from scleraforce.segmentation.wall_finder import WallFinder

COUNTED = np.dtype(np.uint8), np.dtype(np.uint16)
EMPTY = "the frame is empty: all pixels are alike"
SATURATED = (
    f"the detector is saturated: more than {SATURATED_SHARE:.0%} of the pixels have the"
    " largest count"
)
LARGEST_LEFT = 0.5  # of the imaged width may be below the frame
LEAST_SIDE = 0.05  # of the imaged width: less beside a needle is not looked at


def find_wall(
    frame: Pixels,
    scale: PixelScale,
    thickness_m: float | None = None,
    finder: "WallFinder | None" = None,
) -> Segmentation:
    """Find the wall in a frame: the one that forces are read from.

    `frame`: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
    With a known thickness the surface is looked for below a conjunctiva, too. A network
    (`finder`) checks the wall, which is then the one that both methods give (see
    `checked_wall.checked_by`); the control loop has no time for its 7 ms. A frame
    without a wall has NaN boundaries and an empty mask.

    Raises:
        ValueError: not such an array, or smaller than 16 x 16.
        ModelError: as of `WallFinder.find`.
    """
    if frame.ndim != 2 or frame.dtype not in COUNTED:
        raise ValueError(
            f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x"
            " columns of counts"
        )
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(
            f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16"
            " x 16"
        )

    frame = without_page(frame)
    counts = counts_of(frame)

    lit = find_lit(counts)
    if lit[-1] > NOT_LOGARITHMIC:
        frame = as_logarithmic(frame)
        counts = counts_of(frame)
        lit = find_lit(counts)

    first = _first_wall(counts, frame.itemsize == 1, scale, lit)
    found = (
        first
        if thickness_m is None
        else below_conjunctiva(frame, scale, first, thickness_m)
    )

    if finder is None:
        return found

    # Imported here: ONNX Runtime takes longer than a frame does.
    from scleraforce.segmentation.checked_wall import checked_by

    return checked_by(finder, frame, scale, first, found)


def _first_wall(
    frame: Counts, is_bytes: bool, scale: PixelScale, lit: Lit
) -> Segmentation:
    """Return the wall below the first surface that light meets."""
    left, after, columns, brightest, dark, _ = lit
    if columns < LEAST_SHAPE:
        return without_wall(frame.shape, EMPTY)

    part = _part(frame, is_bytes, scale, left, dark[left:after])
    (cells, floor, saturated, begin), found = part.look(brightest)
    if brightest - floor < EMPTY_SHARE * brightest:
        return without_wall(frame.shape, EMPTY)
    if saturated:
        return without_wall(frame.shape, SATURATED)
    if not len(begin):
        return found

    shown = part.frame[:, part.first : part.first + len(part.missing)]
    needle = find_needle(
        shown,
        cells,
        grid_size(len(frame), len(part.missing), scale),
        begin,
        left,
        part.columns,
    )
    if needle is None:
        return part.look(0)[1]

    beside = _beside(frame, part, (needle.hidden[0] - left, needle.hidden[1] - left))
    if beside is None:
        return without_wall(
            frame.shape, "the needle and its shadow hide the wall", needle
        )

    found = replace(beside.look(0)[1], needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan

    return found


class Part(NamedTuple):
    """The imaged part of a frame: `frame` from its column `first` on, as many as
    `missing` has.
    """

    frame: Counts
    first: int
    left: int  # that column in the whole frame
    columns: int  # of the whole frame
    missing: Flags  # which have been filled from beside
    scale: PixelScale
    workplace: Workplace
    is_bytes: bool
    hidden: tuple[int, int] | None  # the span of the part's columns that a needle hides

    def look(
        self, brightest: int
    ) -> tuple[tuple[Counts, int, bool, Integers], Segmentation]:
        """Return cells, their floor, whether they are saturated, where a needle may
        begin; and the wall: see `look`.
        """
        width = len(self.missing)
        shape = (len(self.frame), self.columns)
        behind = (0, 0)

        if self.hidden is not None:
            start, stop = np.searchsorted(
                fine_columns(width), np.array(self.hidden) - 0.5
            )
            behind = int(start), int(stop)

        rows = np.empty((2, self.columns))
        cells, floor, saturated, begin, seen, contrast, noise, thickness_m = look(
            self.frame,
            self.first,
            self.is_bytes,
            brightest,
            self.missing,
            behind,
            self.workplace,
            self.left,
            rows,
        )

        points = min(width, FINE_COLUMNS)
        if LEAST_SHAPE <= seen < LEAST_COVER * points:
            seen_at = np.flatnonzero(np.isfinite(rows[0]))
            # between two of these the surface has left the frame
            low = rows[0, seen_at] >= 0.75 * shape[0]
            left = float(
                (np.diff(seen_at) - 1)[low[:-1] & low[1:]].sum() / self.columns
            )
            points -= round(min(left, LARGEST_LEFT) * points)

        fault = surface_fault(seen, points, contrast, noise)
        if seen < LEAST_SHAPE:
            return (cells, floor, saturated, begin), without_wall(
                shape, fault or "no wall was found"
            )

        found = not isnan(thickness_m)
        wall = Segmentation(
            rows[0], rows[1], shape[0], not fault, fault, found, thickness_m=thickness_m
        )

        return (cells, floor, saturated, begin), wall


def lit_part(frame: Pixels, scale: PixelScale) -> Part | None:
    """Return the imaged part of a frame; None: nothing is imaged."""
    counts = counts_of(frame)
    left, after, lit, _, dark, _ = find_lit(counts)
    return (
        _part(counts, frame.itemsize == 1, scale, left, dark[left:after])
        if lit >= LEAST_SHAPE
        else None
    )


def _part(
    frame: Counts,
    is_bytes: bool,
    scale: PixelScale,
    left: int,
    missing: Flags,
    hidden: tuple[int, int] | None = None,
) -> Part:
    """Return the part of a frame from a column on, missing ones as the nearest that are
    not; neither end is missing.
    """
    size = scale.lateral_m, scale.depth_m, scale.refractive_index
    workplace = workplace_for(len(frame), len(missing), *size)
    columns = frame.shape[1]
    first = left

    if np.count_nonzero(missing):
        filled = frame[:, left : left + len(missing)].copy()
        first = 0
        change = np.flatnonzero(missing[1:] != missing[:-1]) + 1

        for start, end in zip(change[::2], change[1::2], strict=True):
            middle = (start + end + 1) // 2
            filled[:, start:middle] = filled[:, start - 1 : start]
            filled[:, middle:end] = filled[:, end : end + 1]

        frame = counts_of(filled)

    return Part(
        frame, first, left, columns, missing, scale, workplace, is_bytes, hidden
    )


def _beside(frame: Counts, part: Part, hidden: tuple[int, int]) -> Part | None:
    """Return what a frame shows beside a needle that hides a span of its imaged part;
    None: hardly anything.

    What it hides is filled from both sides, so that paths lead on behind it; too narrow
    a side is left out.
    """
    first, after = hidden
    missing = part.missing
    least = max(LEAST_SHAPE, round(LEAST_SIDE * len(missing)))
    start = after if first < least else 0

    stop = first if len(missing) - after < least else len(missing)
    if stop - start < least:
        return None

    inside = (first - start, after - start) if start < first and after < stop else None
    filled = missing[start:stop].copy()
    if inside is not None:
        filled[slice(*inside)] = True

    lit = np.flatnonzero(~filled)
    if not len(lit):
        return None

    start = start + int(lit[0])
    filled = filled[lit[0] : lit[-1] + 1]
    inside = (
        None if inside is None else (inside[0] - int(lit[0]), inside[1] - int(lit[0]))
    )

    return _part(frame, part.is_bytes, part.scale, part.left + start, filled, inside)
