"""Raw frame to mask of the corneoscleral wall, and a verdict whether that can be judged.

`docs/segmentation.md` explains the steps. Only NumPy and OpenCV are used: this runs in the control loop.
"""

from dataclasses import dataclass
from math import isnan

import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation_grid import Float, Grid, Pixels, PixelScale, make_grid
from scleraforce.imaging.segmentation_inner import find_inner, surface_stretch
from scleraforce.imaging.segmentation_slice import boundary_slice
from scleraforce.imaging.segmentation_surface import Surface, find_surface, refine_surface

__all__ = ["PixelScale", "Segmentation", "Segmenter", "boundary_slice"]

WALL = 255
UNSEEN_DEPTH_M = 1e-3  # below the surface: the mask ends here where the inner boundary cannot be seen
LEAST_SHAPE = 16  # rows and columns of a frame
LIT_ROWS = 4  # every fourth row tells whether a column is imaged
LIT_SHARE = 0.02  # of the frame's largest count: a column that never reaches it is black
SATURATED_SHARE, SATURATED_LEVEL = 0.4, 0.99  # share of the frame at (nearly) the largest count: saturated
LEAST_CONTRAST = 0.6  # of the surface, in standard deviations of a pixel's noise
LEAST_COVER = 0.4  # of the imaged width must show the wall
ABSENT_SHARE = 0.3  # of the frame's own typical contrast: a column with less shows no surface
BOTTOM_ROWS = 7.0  # of a surface this close to the last row too little is seen: it has left the window
GAP_M = 1.5e-3  # a wall goes on behind a gap that is narrower
GAP_SHARE = 0.15  # ... and narrower than this share of the frame
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary
INNER_COLUMNS = 128


@dataclass(frozen=True)
class Segmentation:
    """The wall in one frame.

    `outer_row`, `inner_row` (column,): boundaries in rows of pixel centres (the wall covers rows r with
    outer_row <= r < inner_row), NaN where there is no wall; they may lie beyond the frame's last row. `mask` (row,
    column): 255 = wall, else 0. `usable`: a wall was found that can be judged; `reason` says why not ('' where it is).
    `inner_found`: where False, the inner boundary cannot be seen and the mask ends 1 mm below the surface.
    `thickness_m`: median thickness along the surface's normal, NaN where the inner boundary was not found.
    """

    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]
    mask: NDArray[np.uint8]
    usable: bool
    reason: str
    inner_found: bool
    thickness_m: float


class Segmenter:
    """Finds the wall in frames, one after the other.

    Args:
        refractive_index: optical over geometric depth below the tissue surface; 1 where the scanner has corrected it.

    It holds nothing of a frame but the buffers for its size; each result owns its arrays.
    """

    def __init__(self, refractive_index: float = 1.0) -> None:
        if not 1.0 <= refractive_index <= 2.0:
            raise ValueError(f"a refractive index of {refractive_index}: tissue lies between 1 (corrected) and 2")
        self._refractive_index = refractive_index
        self._depth = np.empty((0, 0), dtype=np.uint16)
        self._inside = np.empty((0, 0), dtype=np.bool_)

    def segment(self, frame: Pixels, scale: PixelScale) -> Segmentation:
        """Find the wall in a frame.

        Args:
            frame: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
            scale: size of the frame's pixel.

        Returns:
            Boundaries, mask and verdict; a frame without a wall has NaN boundaries and an empty mask.

        Raises:
            ValueError: not such an array, or smaller than 16 x 16.
        """
        _check(frame)
        lit = _lit_columns(frame)
        if lit is None:
            return self._without_wall(frame.shape, "the frame is empty: all pixels are alike")
        left, hidden = lit
        imaged = frame[:, left : left + len(hidden)]
        if hidden.any():
            imaged = imaged[:, _nearest(~hidden)]
        grid = make_grid(imaged, scale)
        fault = _blank(imaged, grid)
        if fault:
            return self._without_wall(frame.shape, fault)
        surface = refine_surface(imaged, scale, *find_surface(grid))
        present = _present(surface, scale, imaged.shape, hidden)
        fault = _verdict(surface, present)
        if present.sum() < LEAST_SHAPE:
            return self._without_wall(frame.shape, fault or "no wall was found")
        inner, thickness_m = self._inner(imaged, grid.floor, scale, surface, present)
        at = np.arange(frame.shape[1]) - left
        outer_row, inner_row = _at_columns(at, surface.column, present, surface.row, inner)
        mask = self._mask(outer_row, inner_row, frame.shape[0])
        return Segmentation(outer_row, inner_row, mask, not fault, fault, not isnan(thickness_m), thickness_m)

    def _inner(
        self, frame: Pixels, floor: float, scale: PixelScale, surface: Surface, present: NDArray[np.bool_]
    ) -> tuple[Float, float]:
        """Return the inner boundary's rows and the median thickness along the normal (NaN: not found)."""
        tissue = PixelScale(scale.lateral_m, scale.depth_m / self._refractive_index)
        row = np.interp(surface.column, surface.column[present], surface.row[present]).astype(np.float32)
        along_rows = surface_stretch(surface.column, row, tissue) / np.float32(tissue.depth_m)
        points = np.arange(INNER_COLUMNS) * (len(row) - 1) // (INNER_COLUMNS - 1)
        inner = find_inner(frame, floor, surface.column[points], row[points], present[points], along_rows[points])
        if inner.support < FOUND_SHARE:
            return row + np.float32(UNSEEN_DEPTH_M / tissue.depth_m), float("nan")
        thickness_m = np.interp(surface.column, inner.column, inner.thickness_m)
        rows: Float = (row + thickness_m * along_rows).astype(np.float32)
        return rows, _quantile(thickness_m[present], 0.5)

    def _mask(self, outer_row: NDArray[np.float64], inner_row: NDArray[np.float64], rows: int) -> NDArray[np.uint8]:
        """Return 255 in the rows whose centre lies in the wall, shape (row, column)."""
        columns = len(outer_row)
        if self._depth.shape != (rows, columns):
            self._depth = np.empty((rows, columns), dtype=np.uint16)
            self._inside = np.empty((rows, columns), dtype=np.bool_)
        first, end = (np.minimum(np.maximum(np.ceil(edge), 0.0), float(rows)) for edge in (outer_row, inner_row))
        gone = np.isnan(outer_row)
        first[gone], end[gone] = rows, 0
        top, bottom = int(first.min()), max(int(end.max()), int(first.min()))
        first[gone] = end[gone] = 0
        mask = np.zeros((rows, columns), dtype=np.uint8)
        # Unsigned: a row above `first` wraps around to a large number, so one comparison decides both edges.
        depth, inside = self._depth[top:bottom], self._inside[top:bottom]
        np.subtract(np.arange(top, bottom, dtype=np.uint16)[:, None], first.astype(np.uint16), out=depth)
        np.less(depth, (end - first).astype(np.uint16), out=inside)
        np.multiply(inside.view(np.uint8), np.uint8(WALL), out=mask[top:bottom])
        return mask

    def _without_wall(self, shape: tuple[int, ...], reason: str) -> Segmentation:
        nowhere = np.full(shape[1], np.nan)
        return Segmentation(
            nowhere, nowhere.copy(), np.zeros(shape, dtype=np.uint8), False, reason, False, float("nan")
        )


def _check(frame: Pixels) -> None:
    if frame.ndim != 2 or frame.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x columns of counts")
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16 x 16")


def _lit_columns(frame: Pixels) -> tuple[int, NDArray[np.bool_]] | None:
    """Return the first imaged column and, from it to the last imaged one, which are missing; None: too few are."""
    brightest = frame[::LIT_ROWS].max(axis=0)  # an imaged column has light in all its rows
    lit = np.flatnonzero(brightest > LIT_SHARE * float(brightest.max()))
    if len(lit) < LEAST_SHAPE:
        return None
    hidden = np.ones(lit[-1] - lit[0] + 1, dtype=np.bool_)
    hidden[lit - lit[0]] = False
    return int(lit[0]), hidden


def _nearest(there: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return for each place the nearest one that is there; the first and the last are."""
    places = np.flatnonzero(there)
    return places[np.rint(np.interp(np.arange(len(there)), places, np.arange(len(places)))).astype(np.intp)]


def _blank(frame: Pixels, grid: Grid) -> str:
    """Return why nothing can be looked for in a frame, '' where that is not so."""
    brightest = float(grid.cells.max())
    if brightest - grid.floor < 1e-3 * max(brightest, 1.0):
        return "the frame is empty: all pixels are alike"
    some = grid.cells[::2]
    if np.count_nonzero(some >= int(SATURATED_LEVEL * int(frame[::4].max()))) > SATURATED_SHARE * some.size:
        return f"the detector is saturated: more than {SATURATED_SHARE:.0%} of the pixels have the largest count"
    return ""


def _present(
    surface: Surface, scale: PixelScale, shape: tuple[int, ...], hidden: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which points of a surface show it, or lie in a gap so narrow that it goes on behind it."""
    rows = shape[0]
    inside = surface.row < rows - BOTTOM_ROWS
    seen = inside & ~hidden[surface.column.astype(np.intp)]
    if not seen.any():
        return seen
    typical = _quantile(surface.contrast[seen], 0.75)
    present = seen & (surface.contrast > ABSENT_SHARE * max(typical, 1e-6))
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


def _verdict(surface: Surface, present: NDArray[np.bool_]) -> str:
    """Return why a surface cannot be judged, '' where it can."""
    if not present.any():
        return "no wall was found"
    contrast = _quantile(surface.contrast[present], 0.5)
    if contrast < LEAST_CONTRAST * surface.noise:
        return (
            f"the signal is too weak: the surface stands out by {contrast / surface.noise:.1f} times the noise, "
            f"not {LEAST_CONTRAST}"
        )
    cover = float(present.mean())
    if cover < LEAST_COVER:
        return f"the wall covers {cover:.0%} of the imaged width, not {LEAST_COVER:.0%}"
    return ""


def _at_columns(
    at: NDArray[np.intp], column: Float, there: NDArray[np.bool_], *curves: Float
) -> tuple[NDArray[np.float64], ...]:
    """Return curves at columns of the frame; NaN outside their ends, and where the nearest point is not there."""
    nearest = np.rint(np.interp(at, column, np.arange(len(column)))).astype(np.intp)
    nowhere = ~there[nearest] | (at < column[0]) | (at > column[-1])
    filled = tuple(np.interp(at, column[there], rows[there]) for rows in curves)
    for curve in filled:
        curve[nowhere] = np.nan
    return filled


def _quantile(values: NDArray[np.floating], share: float) -> float:
    """Return the value that `share` of the values lie below; many times quicker than NumPy's own."""
    nth = int(share * len(values))
    return float(np.partition(values, nth)[nth])
