"""Bright straight lines that come in through a frame's top edge: those of a needle's shaft, if there is one.

Where something stands out in the uppermost rows, the straight line that shines longest is looked for (a Hough transform
whose lines begin at the top edge), then another one beside it. `needle` says whether they are a shaft's edges.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.grid import Float, Grid

TOP_M, TOP_ROWS = 0.19e-3, 4  # and at least so many rows: the shaft comes in through the top edge
STANDS_OUT = 5.0  # times the spread of the columns' means there
POOLED_M = 62e-6  # of depth taken as one, for the coarse search
WIDEST_M = 1.3e-3  # between the edges of a shaft, along the columns
LINE_M, LINE_COLUMNS = 0.4e-3, 5  # what is narrower along the columns, or than so many pixels, is a line
STEEPEST = 1.2  # columns over rows in metres: 50 degrees off the depth
SLOPES = 81
BRIGHT = 4.0  # spreads of the background: as bright as this is all that counts
LEAST_BRIGHT = 0.45  # of that: a line goes on while it is brighter in the mean
LEAST_LENGTH_M = 0.1e-3  # of full brightness, over LEAST_BRIGHT: what is shorter is no shaft
NEAR_SLOPES = 2  # steps of the slope that a coarse line may be off
NEAR_COLUMNS = 2.0  # of the frame: what shines so near to a line belongs to it
LEAST_ROWS = 4
MORE_M = 0.3e-3  # a line may go on farther than it is seen in the grid
OTHER_SHARE = 0.35  # of the first edge's length: the other edge's


@dataclass(frozen=True, kw_only=True)
class ShaftEdge:
    """A line from the top edge down: column there, slope in columns a row, last row, and how long it shines, rows."""

    top: float
    slope: float
    row: int
    length: float

    @property
    def end(self) -> float:
        """Its column in its last row."""
        return self.top + self.slope * (self.row + 0.5)


def find_edges(frame: Pixels, grid: Grid) -> list[ShaftEdge]:
    """Return the line of a frame that shines longest, and the one beside it where it is seen, the shaft's own first.

    None where nothing shines long enough.

    Args:
        frame: its imaged part, shape (row, column).
        grid: of that part.
    """
    begin = _standing_out(grid)
    if not len(begin):
        return []
    thin = _thin(grid.cells, grid.scale.lateral_m)
    coarse = _longest(thin, begin, grid)
    if coarse is None:
        return []
    fine = _thin(_all_columns(frame, grid), grid.scale.lateral_m / grid.step_columns)
    return _edges(thin, fine, coarse, grid)


def _standing_out(grid: Grid) -> NDArray[np.intp]:
    """Return the columns that are brighter in the uppermost rows than columns there are."""
    mean = grid.cells[: top_rows(grid)].sum(axis=0, dtype=np.float32)
    ordered = np.sort(mean)
    middle, low = ordered[len(ordered) // 2], ordered[len(ordered) // 6]
    limit = middle + STANDS_OUT * max(middle - low, np.float32(1e-3) * middle)
    return np.flatnonzero(mean > limit) if ordered[-1] > limit else _NOWHERE


def _thin(light: Pixels, lateral_m: float) -> Float:
    """Return what is thin along the columns, over the spread of the background, (row, column), at most 1."""
    width = max(LINE_COLUMNS, round(LINE_M / lateral_m)) | 1
    opened = cv2.morphologyEx(light, cv2.MORPH_OPEN, np.ones((1, width), np.uint8))
    thin = (light - opened).astype(np.float32)
    some = thin[::4, :: max(1, width // 4)].ravel()
    places = len(some) // 2, 5 * len(some) // 6
    some.partition(places)
    middle, high = float(some[places[0]]), float(some[places[1]])
    thin -= np.float32(middle)
    thin *= np.float32(1.0 / (BRIGHT * max(high - middle, 1e-6)))
    np.clip(thin, -0.5, 1.0, out=thin)
    return thin


def _longest(thin: Float, begin: NDArray[np.intp], grid: Grid) -> ShaftEdge | None:
    """Return the line from some columns at the top edge that shines longest; None: none is long enough."""
    start = np.unique(np.clip(np.concatenate([begin - 1, begin, begin + 1]), 0, thin.shape[1] - 1))
    slopes = _slopes(grid.scale.depth_m / grid.scale.lateral_m)
    found = _best(thin, start.astype(np.float64), slopes, _pooled_rows(grid))
    return found if found.length * grid.scale.depth_m >= LEAST_LENGTH_M else None


def top_rows(grid: Grid) -> int:
    """Return how many rows of a grid count as its uppermost ones."""
    return max(TOP_ROWS, round(TOP_M / grid.scale.depth_m))


def _pooled_rows(grid: Grid) -> int:
    return max(1, round(POOLED_M / grid.scale.depth_m))


@lru_cache(maxsize=8)
def _slopes(ratio: float) -> NDArray[np.float64]:
    """Return the slopes that are tried, columns a row; `ratio` is a pixel's depth over its width."""
    return np.linspace(-STEEPEST, STEEPEST, SLOPES) * ratio


def _lengths(thin: Float, start: NDArray[np.floating], slopes: NDArray[np.float64]) -> tuple[Float, NDArray[np.intp]]:
    """Return the length of lines and their last rows, (slope, start) each.

    A line's length is the largest sum, down to any row, of what shines over LEAST_BRIGHT.
    """
    rows = np.arange(len(thin))[:, None]
    place = np.rint(start + slopes[:, None, None] * (rows + 0.5)).astype(np.intp)
    inside = (place >= 0) & (place < thin.shape[1])
    shine = np.where(inside, thin[rows, place.clip(0, thin.shape[1] - 1)], np.float32(-0.5))
    sums = np.cumsum(shine - np.float32(LEAST_BRIGHT), axis=1)
    return sums.max(axis=1), sums.argmax(axis=1)


def _all_columns(frame: Pixels, grid: Grid) -> Pixels:
    """Return a frame in the grid's rows, with its own columns."""
    rows, columns = len(grid.cells), frame.shape[1]
    if grid.step_rows == 1:
        return frame
    return cast(Pixels, cv2.resize(frame[: rows * grid.step_rows], (columns, rows), interpolation=cv2.INTER_AREA))


def _edges(thin: Float, fine: Float, coarse: ShaftEdge, grid: Grid) -> list[ShaftEdge]:
    """Return the shaft's edge near a coarse line, and the other edge where it is seen, the shaft's own one first.

    Args:
        thin: what is thin, in the grid.
        fine: the same in the frame's own columns.
        coarse: the longest line in the grid.
        grid: the frame's.
    """
    first = _refined(fine, coarse, grid)
    widest = max(2, round(WIDEST_M / grid.scale.lateral_m))
    deepest = coarse.row + round(WIDEST_M / grid.scale.depth_m)
    others = np.setdiff1d(np.arange(-widest, widest + 1), [-1, 0, 1]) + coarse.top
    slopes = _slopes(grid.scale.depth_m / grid.scale.lateral_m)[::2]
    other = _best(_without(thin[:deepest], coarse, 1.0), others, slopes, _pooled_rows(grid))
    meets = abs(other.end - coarse.end) <= widest and abs(other.row - coarse.row) * grid.scale.depth_m <= WIDEST_M
    if not meets or other.length < OTHER_SHARE * coarse.length:
        return [first]
    second = _refined(_without(fine, first, NEAR_COLUMNS + 1.0), other, grid)
    return _lower_first([first, second], widest * grid.step_columns / 4)


def _refined(fine: Float, coarse: ShaftEdge, grid: Grid) -> ShaftEdge:
    """Return the line of the frame's own columns near one of the grid."""
    step = grid.step_columns
    near = (coarse.top + 0.5) * step - 0.5 + np.arange(-1.5 * step, 1.5 * step + 1)
    spread = NEAR_SLOPES * 2.0 * STEEPEST / (SLOPES - 1) * grid.scale.depth_m / grid.scale.lateral_m * step
    slopes = coarse.slope * step + np.linspace(-spread, spread, 2 * NEAR_SLOPES + 1)
    deepest = coarse.row + round(MORE_M / grid.scale.depth_m)
    return _straightened(fine, _best(fine[:deepest], near, slopes))


def _without(thin: Float, edge: ShaftEdge, columns: float) -> Float:
    """Return a picture without what shines within so many columns of an edge."""
    rows = np.arange(len(thin))[:, None]
    near = np.abs(np.arange(thin.shape[1]) - (edge.top + edge.slope * (rows + 0.5))) <= columns
    return np.where(near & (rows <= edge.row + 2), np.float32(-0.5), thin)


def _lower_first(edges: list[ShaftEdge], widest: float) -> list[ShaftEdge]:
    """Put the edge first that is the shaft's: the longer one, of a bevel the lower one (it is held with its cut up).

    The edges of a bevel lie farther apart at the top than at the end.
    """
    left, right = sorted(edges, key=lambda edge: edge.top)
    converging = right.top - left.top - abs(right.end - left.end) > widest
    if converging and left.slope * right.slope > 0.0:
        return [right, left] if left.slope < 0.0 else [left, right]
    return sorted(edges, key=lambda edge: -edge.length)


def _best(thin: Float, start: NDArray[np.float64], slopes: NDArray[np.float64], pooled_rows: int = 1) -> ShaftEdge:
    """Return the line that shines longest among some, in a picture of which so many rows are taken as one."""
    if pooled_rows > 1:
        size = thin.shape[1], max(1, len(thin) // pooled_rows)
        thin = cast(Float, cv2.resize(thin, size, interpolation=cv2.INTER_AREA))
    lengths, rows = _lengths(thin, start, slopes * pooled_rows)
    best = int(lengths.argmax())
    which, column = np.unravel_index(best, lengths.shape)
    row, length = pooled_rows * (int(rows.flat[best]) + 1) - 1, pooled_rows * float(lengths.flat[best])
    return ShaftEdge(top=float(start[column]), slope=float(slopes[which]), row=row, length=length)


def _straightened(fine: Float, edge: ShaftEdge) -> ShaftEdge:
    """Return the straight line through what shines near an edge (weighted least squares)."""
    at = np.arange(fine.shape[1], dtype=np.float32)
    rows = np.arange(edge.row + 1)
    off = at - (edge.top + edge.slope * (rows[:, None] + 0.5))
    weight = np.where(np.abs(off) <= NEAR_COLUMNS, np.maximum(fine[: edge.row + 1] - np.float32(0.25), 0.0), 0.0)
    by_row = weight.sum(axis=1)
    if np.count_nonzero(by_row) < LEAST_ROWS:
        return edge
    centre = (weight * at).sum(axis=1) / np.maximum(by_row, 1e-6)
    slope, top = (float(value) for value in np.polyfit(rows + 0.5, centre, 1, w=np.sqrt(by_row)))
    return replace(edge, top=top, slope=slope)


_NOWHERE = np.zeros(0, dtype=np.intp)
