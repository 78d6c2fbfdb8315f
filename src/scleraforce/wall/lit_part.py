"""The part of a frame that shows the eye: bands and reflections left out."""

from math import isnan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scleraforce.base.arrays import Counts, Flags, Integers
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.frame_light import LEAST_SHAPE, counts_of, find_lit
from scleraforce.wall.per_frame_loops import (
    FINE_COLUMNS,
    Workplace,
    find_boundaries,
    fine_columns,
    workplace_for,
)
from scleraforce.wall.wall import (
    LEAST_COVER,
    Segmentation,
    surface_fault,
    without_wall,
)

if TYPE_CHECKING:
    pass


COUNTED = np.dtype(np.uint8), np.dtype(np.uint16)

LARGEST_LEFT = 0.5  # of the imaged width may be below the frame

LEAST_SIDE = 0.05  # of the imaged width: less beside a needle is not looked at


class LitPart(NamedTuple):
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

    def segment(
        self, brightest: int
    ) -> tuple[tuple[Counts, int, bool, Integers], Segmentation]:
        """Return cells, their floor, whether they are saturated, where a needle may
        begin; and the wall: see `find_boundaries`.
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
        cells, floor, saturated, begin, seen, contrast, noise, thickness_m = (
            find_boundaries(
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


def lit_part(frame: Pixels, scale: PixelScale) -> LitPart | None:
    """Return the imaged part of a frame; None: nothing is imaged."""
    counts = counts_of(frame)
    left, after, lit, _, dark, _ = find_lit(counts)
    return (
        part_of_frame(counts, frame.itemsize == 1, scale, left, dark[left:after])
        if lit >= LEAST_SHAPE
        else None
    )


def part_of_frame(
    frame: Counts,
    is_bytes: bool,
    scale: PixelScale,
    left: int,
    missing: Flags,
    hidden: tuple[int, int] | None = None,
) -> LitPart:
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

    return LitPart(
        frame, first, left, columns, missing, scale, workplace, is_bytes, hidden
    )


def part_beside(
    frame: Counts, part: LitPart, hidden: tuple[int, int]
) -> LitPart | None:
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

    return part_of_frame(
        frame, part.is_bytes, part.scale, part.left + start, filled, inside
    )
