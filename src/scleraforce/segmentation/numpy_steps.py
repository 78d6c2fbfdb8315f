"""The steps by NumPy and OpenCV: those that published figures come from, and the oracle of the compiled ones."""

from math import isnan

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.below_surface import grouping, in_tissue, rows_per_metre, search_below
from scleraforce.segmentation.columns import at_columns, bridged
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.imaged import LEAST_SHAPE, lit_columns
from scleraforce.segmentation.steps import (
    SATURATED_LEVEL,
    SATURATED_SHARE,
    Part,
    Segmentation,
    blank_fault,
    surface_fault,
    without_wall,
)
from scleraforce.segmentation.surface import Surface, find_surface, refine_surface

UNSEEN_DEPTH_M = 1e-3  # below the surface: the mask ends here where the inner boundary cannot be seen
ABSENT_SHARE = 0.3  # of the frame's own typical contrast: a column with less shows no surface
TYPICAL = 0.75  # of the columns have less than the typical contrast
BOTTOM_ROWS = 7.0  # of a surface this close to the last row too little is seen: it has left the window
GAP_M = 1.5e-3  # a wall goes on behind a gap that is narrower
GAP_SHARE = 0.15  # ... and narrower than this share of the frame
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary


class NumpySteps:
    """The steps, with nothing kept from frame to frame but tables."""

    def at_once(self, frame: Pixels, scale: PixelScale) -> Segmentation | None:  # noqa: ARG002 - of the protocol
        """Return None: the steps are always taken one by one."""
        return None

    def lit_columns(self, frame: Pixels) -> tuple[int, NDArray[np.bool_], int] | None:
        """See `imaged.lit_columns`."""
        return lit_columns(frame)

    def glance(self, part: Part, brightest: int) -> tuple[str, bool]:
        """Return why nothing can be looked for; whether a needle is there is told by looking for it."""
        some = part.grid.cells[::8, ::4]
        saturated = np.count_nonzero(some >= int(SATURATED_LEVEL * brightest)) > SATURATED_SHARE * some.size
        return blank_fault(part.grid.floor, brightest, bool(saturated)), True

    def found(self, part: Part) -> Segmentation:
        """Return the wall in a part of a frame."""
        behind, shape = part.hidden_points, (len(part.frame), part.columns)
        surface = refine_surface(part.imaged, part.scale, *find_surface(part.grid), behind)
        present = _present(surface, part)
        shown = present.copy()
        shown[behind] = False  # no evidence of a wall; the inner boundary's path leads on there all the same
        seen = int(np.count_nonzero(shown))
        contrast = _quantile(surface.contrast[shown], 0.5) if seen else 0.0
        fault = surface_fault(seen, len(shown), contrast, surface.noise)
        if seen < LEAST_SHAPE:
            return without_wall(shape, fault or "no wall was found")
        inner, thickness_m = _inner(part, surface, present)
        outer_row, inner_row = at_columns(shape[1], part.left, len(part.missing), present, surface.row, inner)
        found = not isnan(thickness_m)
        return Segmentation(outer_row, inner_row, shape[0], not fault, fault, found, thickness_m=thickness_m)


def widest_gap(points: int, point_m: float) -> int:
    """Return behind how many points that show nothing a wall goes on, of so many that are so far apart."""
    return round(min(GAP_M / point_m, GAP_SHARE * points))


def _inner(part: Part, surface: Surface, present: NDArray[np.bool_]) -> tuple[Float, float]:
    """Return the inner boundary's rows and the median thickness along the normal (NaN: not found)."""
    row = bridged(surface.row, present)
    tissue = in_tissue(part.scale)
    along_rows = rows_per_metre(len(part.missing), row, tissue)
    inner = search_below(part.imaged, part.grid.floor, row, present, along_rows)
    if inner.support < FOUND_SHARE:
        return row + np.float32(UNSEEN_DEPTH_M / tissue.depth_m), float("nan")
    thickness_m = grouping(len(row))[1] @ inner.thickness_m
    along_rows *= thickness_m
    along_rows += row
    return along_rows, _quantile(thickness_m[present], 0.5)


def _present(surface: Surface, part: Part) -> NDArray[np.bool_]:
    """Return which points of a surface show it, or lie in a gap so narrow that it goes on behind it."""
    inside = surface.row < np.float32(len(part.frame) - BOTTOM_ROWS)
    seen = inside
    if np.count_nonzero(part.missing):
        seen = inside & ~part.missing[surface.column.astype(np.intp)]
    if not np.count_nonzero(seen):
        return seen
    typical = _quantile(surface.contrast[seen], TYPICAL)
    present = seen & (surface.contrast > np.float32(ABSENT_SHARE * max(typical, 1e-6)))
    if np.count_nonzero(present) == len(present):
        return present
    point_m = float(surface.column[1] - surface.column[0]) * part.scale.lateral_m
    return _close_gaps(present, inside, widest_gap(len(present), point_m))


def _close_gaps(present: NDArray[np.bool_], inside: NDArray[np.bool_], widest: int) -> NDArray[np.bool_]:
    """Return `present` with gaps closed that are at most `widest` points wide and lie (in part) inside the window."""
    change = np.flatnonzero(present[1:] != present[:-1]) + 1
    gaps = change if present[0] else change[1:]  # by turns the start and the end of a gap between two present parts
    closed = present.copy()
    for start, end in zip(gaps[::2], gaps[1::2], strict=False):
        if end - start <= widest and inside[start:end].any():
            closed[start:end] = True
    return closed


def _quantile(values: NDArray[np.floating], share: float) -> float:
    """Return the value that `share` of the values lie below; many times quicker than NumPy's own."""
    nth = int(share * len(values))
    return float(np.partition(values, nth)[nth])
