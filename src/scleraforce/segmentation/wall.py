"""Raw frame to mask of the corneoscleral wall, and a verdict whether that can be judged.

`docs/segmentation.md` explains the steps. Only NumPy and OpenCV are used: this runs in the control loop.
"""

from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from math import isnan

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.below_surface import grouping, in_tissue, rows_per_metre, search_below
from scleraforce.segmentation.columns import at_columns, between, bridged
from scleraforce.segmentation.grid import Float, Grid, make_grid
from scleraforce.segmentation.imaged import LEAST_SHAPE, imaged_part, lit_columns
from scleraforce.segmentation.needle import SeenNeedle, find_shaft, needle_of
from scleraforce.segmentation.slice import boundary_slice, boundary_slices
from scleraforce.segmentation.surface import Surface, find_surface, refine_surface

__all__ = ["UNSEEN_DEPTH_M", "PixelScale", "Segmentation", "boundary_slice", "boundary_slices", "find_wall"]

WALL = 255
UNSEEN_DEPTH_M = 1e-3  # below the surface: the mask ends here where the inner boundary cannot be seen
SATURATED_SHARE, SATURATED_LEVEL = 0.4, 0.99  # share of the frame at (nearly) the largest count: saturated
LEAST_CONTRAST = 0.6  # of the surface, in standard deviations of a pixel's noise
LEAST_COVER = 0.4  # of the imaged width must show the wall
ABSENT_SHARE = 0.3  # of the frame's own typical contrast: a column with less shows no surface
BOTTOM_ROWS = 7.0  # of a surface this close to the last row too little is seen: it has left the window
GAP_M = 1.5e-3  # a wall goes on behind a gap that is narrower
GAP_SHARE = 0.15  # ... and narrower than this share of the frame
LEAST_SIDE = 0.05  # of the imaged width: less beside a needle is not looked at
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary


@dataclass(frozen=True)
class Segmentation:
    """The wall in one frame.

    `outer_row`, `inner_row` (column,): boundaries in rows of pixel centres (the wall covers rows r with
    outer_row <= r < inner_row), NaN where there is no wall; they may lie beyond the last of the frame's `rows`.
    `usable`: a wall was found that can be judged; `reason` says why not ('' where it is).
    `inner_found`: where False, the inner boundary cannot be seen and the mask ends 1 mm below the surface.
    `thickness_m`: median thickness along the surface's normal, NaN where the inner boundary was not found.
    `needle`: the one that crosses the frame, None where none is seen; what it hides has no boundaries.
    `conjunctiva_m`: median thickness of a layer over the wall, along its normal, None where none is looked for or seen.
    """

    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]
    rows: int
    usable: bool
    reason: str
    inner_found: bool
    _: KW_ONLY
    thickness_m: float
    needle: SeenNeedle | None = None
    conjunctiva_m: float | None = None

    @cached_property
    def mask(self) -> NDArray[np.uint8]:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column); drawn when it is asked for."""
        row = np.arange(self.rows, dtype=np.float32)[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)  # NaN compares as False: no wall
        wall: NDArray[np.uint8] = inside.view(np.uint8) * np.uint8(WALL)
        return wall


def find_wall(frame: Pixels, scale: PixelScale) -> Segmentation:
    """Find the wall in a frame.

    Args:
        frame: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
        scale: size of the frame's pixel, with the refractive index.

    Returns:
        Boundaries, mask and verdict; a frame without a wall has NaN boundaries and an empty mask.

    Raises:
        ValueError: not such an array, or smaller than 16 x 16.
    """
    _check(frame)
    lit = lit_columns(frame)
    if lit is None:
        return _without_wall(frame.shape, "the frame is empty: all pixels are alike")
    left, missing, brightest = lit
    imaged = imaged_part(frame, left, missing)
    grid = make_grid(imaged, scale)
    fault = _blank(grid, brightest)
    if fault:
        return _without_wall(frame.shape, fault)
    shaft = find_shaft(imaged, grid)
    if shaft is None:
        return _found(frame.shape, _Part(imaged, grid, left, missing), scale)
    needle = needle_of(shaft, grid, left, frame.shape[1])
    part = _beside(frame, scale, left, missing, shaft.hidden)
    if part is None:
        return _without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
    found = replace(_found(frame.shape, part, scale), needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan
    return found


@dataclass(frozen=True, eq=False)
class _Part:
    """The imaged part of a frame, from column `left` on, which of its columns are missing, the span a needle hides."""

    imaged: Pixels
    grid: Grid
    left: int
    missing: NDArray[np.bool_]
    hidden: tuple[int, int] | None = None

    @property
    def hidden_points(self) -> slice:
        """Which of the surface's points the needle hides."""
        return slice(0, 0) if self.hidden is None else between(len(self.missing), *self.hidden)


def _beside(
    frame: Pixels, scale: PixelScale, left: int, missing: NDArray[np.bool_], hidden: tuple[int, int]
) -> _Part | None:
    """Return what a frame shows beside a needle that hides a span of its imaged part; None: hardly anything.

    What it hides is filled from both sides, so that the paths that are looked for lead on behind it. A side that is
    narrower than the smoothing of the surface is left out.
    """
    first, after = hidden
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
    imaged = imaged_part(frame, left + start, filled)
    return _Part(imaged, make_grid(imaged, scale), left + start, filled, inside)


def _found(shape: tuple[int, ...], part: _Part, scale: PixelScale) -> Segmentation:
    """Return the wall in the imaged part of a frame."""
    behind = part.hidden_points
    surface = refine_surface(part.imaged, scale, *find_surface(part.grid), behind)
    present = _present(surface, scale, part.imaged.shape, part.missing)
    shown = present.copy()
    shown[behind] = False  # no evidence of a wall; the inner boundary's path leads on there all the same
    seen = int(np.count_nonzero(shown))
    fault = _verdict(surface, shown, seen)
    if seen < LEAST_SHAPE:
        return _without_wall(shape, fault or "no wall was found")
    inner, thickness_m = _inner(part.imaged, part.grid.floor, scale, surface, present)
    outer_row, inner_row = at_columns(shape[1], part.left, len(part.missing), present, surface.row, inner)
    found = not isnan(thickness_m)
    return Segmentation(outer_row, inner_row, shape[0], not fault, fault, found, thickness_m=thickness_m)


def _inner(
    frame: Pixels, floor: float, scale: PixelScale, surface: Surface, present: NDArray[np.bool_]
) -> tuple[Float, float]:
    """Return the inner boundary's rows and the median thickness along the normal (NaN: not found)."""
    row = bridged(surface.row, present)
    tissue = in_tissue(scale)
    along_rows = rows_per_metre(frame.shape[1], row, tissue)
    inner = search_below(frame, floor, row, present, along_rows)
    if inner.support < FOUND_SHARE:
        return row + np.float32(UNSEEN_DEPTH_M / tissue.depth_m), float("nan")
    thickness_m = grouping(len(row))[1] @ inner.thickness_m
    along_rows *= thickness_m
    along_rows += row
    return along_rows, _quantile(thickness_m[present], 0.5)


def _check(frame: Pixels) -> None:
    if frame.ndim != 2 or frame.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x columns of counts")
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16 x 16")


def _without_wall(shape: tuple[int, ...], reason: str, needle: SeenNeedle | None = None) -> Segmentation:
    nowhere = np.full(shape[1], np.nan)
    return Segmentation(
        nowhere, nowhere.copy(), shape[0], False, reason, False, thickness_m=float("nan"), needle=needle
    )


def _blank(grid: Grid, brightest: int) -> str:
    """Return why nothing can be looked for in a frame, '' where that is not so."""
    if brightest - grid.floor < 1e-3 * max(brightest, 1):
        return "the frame is empty: all pixels are alike"
    some = grid.cells[::8, ::4]
    if np.count_nonzero(some >= int(SATURATED_LEVEL * brightest)) > SATURATED_SHARE * some.size:
        return f"the detector is saturated: more than {SATURATED_SHARE:.0%} of the pixels have the largest count"
    return ""


def _present(
    surface: Surface, scale: PixelScale, shape: tuple[int, ...], hidden: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which points of a surface show it, or lie in a gap so narrow that it goes on behind it."""
    inside = surface.row < np.float32(shape[0] - BOTTOM_ROWS)
    seen = inside
    if np.count_nonzero(hidden):
        seen = inside & ~hidden[surface.column.astype(np.intp)]
    if not np.count_nonzero(seen):
        return seen
    typical = _quantile(surface.contrast[seen], 0.75)
    present = seen & (surface.contrast > np.float32(ABSENT_SHARE * max(typical, 1e-6)))
    if np.count_nonzero(present) == len(present):
        return present
    step_m = float(surface.column[1] - surface.column[0]) * scale.lateral_m
    return _close_gaps(present, inside, round(min(GAP_M / step_m, GAP_SHARE * len(present))))


def _close_gaps(present: NDArray[np.bool_], inside: NDArray[np.bool_], widest: int) -> NDArray[np.bool_]:
    """Return `present` with gaps closed that are at most `widest` points wide and lie (in part) inside the window."""
    change = np.flatnonzero(present[1:] != present[:-1]) + 1
    gaps = change if present[0] else change[1:]  # by turns the start and the end of a gap between two present parts
    closed = present.copy()
    for start, end in zip(gaps[::2], gaps[1::2], strict=False):
        if end - start <= widest and inside[start:end].any():
            closed[start:end] = True
    return closed


def _verdict(surface: Surface, present: NDArray[np.bool_], seen: int) -> str:
    """Return why a surface of which so many points are present cannot be judged, '' where it can."""
    if not seen:
        return "no wall was found"
    contrast = _quantile(surface.contrast[present], 0.5)
    if contrast < LEAST_CONTRAST * surface.noise:
        return (
            f"the signal is too weak: the surface stands out by {contrast / surface.noise:.1f} times the noise, "
            f"not {LEAST_CONTRAST}"
        )
    cover = seen / len(present)
    if cover < LEAST_COVER:
        return f"the wall covers {cover:.0%} of the imaged width, not {LEAST_COVER:.0%}"
    return ""


def _quantile(values: NDArray[np.floating], share: float) -> float:
    """Return the value that `share` of the values lie below; many times quicker than NumPy's own."""
    nth = int(share * len(values))
    return float(np.partition(values, nth)[nth])
