"""The inner boundary: where the light that comes back drops below what the wall's own attenuation foretells.

The wall is unrolled along its surface into (column, thickness), thickness measured along the surface's normal, so that
a wall of even thickness is a straight band whatever its dents. All columns together then give one profile with little
speckle. In it the wall falls slowly (in an attenuating medium, light falls linearly on a logarithmic scale:
Beer-Lambert), and its end is a drop within some tens of micrometres. Below the wall there may be a thin weaker layer,
the choroid, whose own lower edge drops further; then the upper one of two close drops is the wall's. With the wall's
line as threshold the boundary is found column by column, as a path.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from scleraforce.imaging.segmentation_grid import Float, Pixels, PixelScale
from scleraforce.imaging.segmentation_path import best_path

__all__ = ["InnerBoundary", "find_inner", "surface_stretch"]

CELL_M = 20e-6  # of thickness in the unrolled wall
CELLS = 75  # 1.5 mm; thicker walls are none
COLUMNS = 192  # sampled, of which GROUP neighbours are averaged
GROUP = 4
SKIP_CELLS = 3  # mirror reflection and blur of the surface
LEVEL_CELLS = 12  # below the surface: these give a column's own level (shadows)
LEAST_CELLS = 11  # a wall is thicker than this: 0.22 mm
SLOPE_CELLS = 6  # above a drop: these give the wall's level and slope there
SKIP_EDGE = 1  # on each side of a drop: transition
NEXT_CELLS = 3  # below a drop: these give the level there
LEAST_DROP = 0.1  # of the level at the surface
UPPER_DROP_SHARE = 0.25  # of the largest drop; a smaller one above it is texture
LAYER_CELLS = 16  # a weaker layer below the wall is thinner than 0.32 mm
LEAST_COLUMNS_SHARE = 0.25  # of the columns must reach a depth for the profile to count there
WINDOW_CELLS = 10  # below the boundary: 0.2 mm must be darker than the threshold
CELL_COST = 0.02  # per cell between a column's boundary and the profile's, in cells
REACH_CELLS = 3
LEAST_SUPPORT = 0.5  # of the drop

_SLOPE = (np.arange(SLOPE_CELLS) - (SLOPE_CELLS - 1) / 2) / (SLOPE_CELLS * (SLOPE_CELLS**2 - 1) / 12)  # least squares


@dataclass(frozen=True)
class InnerBoundary:
    """Thickness along the normal at some columns of the frame, m, shape (point,), and the share of them that show it."""

    column: Float
    thickness_m: Float
    support: float


def surface_stretch(column: Float, row: Float, scale: PixelScale) -> Float:
    """Return by how much a wall is longer along a column than along the surface's normal, shape (column,).

    Args:
        column, row: the surface, evenly spaced columns, no NaN.
        scale: size of the frame's pixel, in tissue.
    """
    step_m = (column[1] - column[0]) * scale.lateral_m
    reach = min(max(1, round(0.15e-3 / step_m)), (len(column) - 1) // 2)
    padded = np.concatenate([2 * row[0] - row[reach:0:-1], row, 2 * row[-1] - row[-2 : -2 - reach : -1]])
    slope = (padded[2 * reach :] - padded[: -2 * reach]) * np.float32(scale.depth_m / (2 * reach * step_m))
    stretch: Float = np.sqrt(1.0 + np.minimum(np.square(slope), np.float32(9.0)))
    return stretch


def find_inner(
    frame: Pixels, floor: float, column: Float, row: Float, there: np.ndarray, along_rows: Float
) -> InnerBoundary | None:
    """Find the inner boundary below a surface.

    Args:
        frame: counts, shape (row, column).
        floor: count of its noise floor.
        column: columns of the surface in the frame, shape (point,); evenly spaced.
        row: its rows in the frame, no NaN.
        there: whether there is a surface.
        along_rows: rows of the frame along a column for 1 m of thickness along the normal, shape (point,).

    Returns:
        The boundary, or None where no drop is seen.
    """
    wall, seen = _unroll(frame, floor, row, column, there, along_rows)
    stretch = along_rows / along_rows.min()
    edge = _find_drop(_mean_profile(wall, seen / np.square(np.square(_grouped(stretch[None])[0]))[:, None]))
    if edge is None:
        return None
    cell, level, drop = edge
    half_drop = np.float32(drop / 2)
    excess = np.clip(wall - np.maximum(level - half_drop, np.float32(0.05)), -half_drop, half_drop) * seen
    sums = np.zeros((len(excess), CELLS + 1), dtype=np.float32)
    np.cumsum(excess, axis=1, out=sums[:, 1:])
    below = np.minimum(np.arange(CELLS + 1) + WINDOW_CELLS, CELLS)
    score = (2 * sums - sums[:, below]) / half_drop
    score -= np.float32(CELL_COST) * np.abs(np.arange(CELLS + 1, dtype=np.float32) - np.float32(cell))
    score[:, :LEAST_CELLS] = -1e3
    return _smooth_boundary(best_path(score, REACH_CELLS), sums, seen, _grouped(column[None])[0], drop)


def _grouped(values: Float) -> Float:
    """Average groups of neighbouring columns, (row, column) -> (row, column / GROUP)."""
    size = (values.shape[1] // GROUP, values.shape[0])
    return np.asarray(cv2.resize(values[:, : size[0] * GROUP], size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _unroll(
    frame: Pixels, floor: float, row: Float, column: Float, there: np.ndarray, along_rows: Float
) -> tuple[Float, Float]:
    """Return the wall as (column group, cell), surface level 1 and floor 0, and where it is measured (1 or 0)."""
    thickness_m = (np.arange(CELLS, dtype=np.float32) + np.float32(0.5)) * np.float32(CELL_M)
    map_row = row + np.multiply.outer(thickness_m, along_rows)
    map_column = np.repeat(column[None], CELLS, axis=0)
    sampled = cv2.remap(frame, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    lit = _grouped(sampled.astype(np.float32)).T
    inside = _grouped(((map_row <= len(frame) - 1) & there).astype(np.float32)).T
    seen = (inside > 0.99).astype(np.float32)
    light = np.maximum(lit - np.float32(floor), 0) * seen
    top = slice(SKIP_CELLS, LEVEL_CELLS)
    level = cv2.blur(
        light[:, top].sum(axis=1, keepdims=True) / np.maximum(seen[:, top].sum(axis=1, keepdims=True), 1.0), (1, 3)
    )
    usable = (level > 1e-3 * max(float(level.max()), 1e-6)).astype(np.float32)
    return np.minimum(light / np.maximum(level, np.float32(1e-6)), np.float32(1.5)), seen * usable


def _mean_profile(wall: Float, weight: Float) -> Float:
    """Return the weighted mean over columns, shape (cell,), down to where too little weight is left."""
    total = weight.sum(axis=0)
    deep = int((total >= max(1e-6, LEAST_COLUMNS_SHARE * total[0])).argmin()) or len(total)
    profile: Float = (wall * weight).sum(axis=0)[:deep] / total[:deep].clip(1e-6)
    return profile


def _find_drop(profile: Float) -> tuple[int, Float, float] | None:
    """Find where a profile jumps down: the distance, at each cell, of straight lines through the cells on either side.

    A mere change of slope is no jump.

    Returns:
        The cell where the wall has ended; the wall's level at all cells of the unrolled wall, continued beyond the
        drop along its slope, never below 0; and the drop. None where there is no drop.
    """
    ends = np.arange(LEAST_CELLS, len(profile) - SLOPE_CELLS - SKIP_EDGE + 1)
    if len(ends) < 2:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(profile, SLOPE_CELLS)
    mean, slope = windows.mean(axis=1), np.minimum(windows @ _SLOPE, 0.0)
    first, next_first = ends - SLOPE_CELLS - SKIP_EDGE, ends + SKIP_EDGE
    reach = SLOPE_CELLS / 2 + SKIP_EDGE  # from a window's middle to the drop
    drop = np.maximum(mean[first] + slope[first] * reach, 0.0) - (mean[next_first] - slope[next_first] * reach)
    best = int(drop.argmax())
    if drop[best] < LEAST_DROP:
        return None
    peak = np.concatenate([[drop[0] > drop[1]], (drop[1:-1] >= drop[:-2]) & (drop[1:-1] > drop[2:]), [False]])
    above = np.flatnonzero(peak & (drop >= max(LEAST_DROP, UPPER_DROP_SHARE * drop[best])))
    above = above[(above < best) & (above >= best - LAYER_CELLS)]
    best = int(above[0]) if len(above) else best
    middle = int(first[best]) + SLOPE_CELLS // 2
    level = np.zeros(CELLS, dtype=np.float32)
    level[:middle] = profile[:middle]
    level[middle:] = np.maximum(mean[first[best]] + slope[first[best]] * (np.arange(CELLS - middle) + 0.5), 0.0)
    return int(ends[best]), level, float(drop[best])


def _smooth_boundary(
    path: np.ndarray[tuple[int], np.dtype[np.intp]], sums: Float, seen: Float, column: Float, drop: float
) -> InnerBoundary:
    """Average the path over neighbouring columns, and count the columns that show the drop at it."""
    point = np.arange(len(path))
    last = np.minimum(path + SKIP_EDGE + NEXT_CELLS, CELLS)
    above = (sums[point, path] - sums[point, np.maximum(path - NEXT_CELLS, 0)]) / NEXT_CELLS
    below = (sums[point, last] - sums[point, np.minimum(path + SKIP_EDGE, CELLS)]) / NEXT_CELLS
    testable = seen[point, last - 1] > 0
    shown = (above - below > LEAST_SUPPORT * drop) & testable
    weight = (shown.astype(np.float32) + np.float32(1e-3))[None]
    smooth = cv2.blur(path.astype(np.float32) * weight, (5, 1)) / cv2.blur(weight, (5, 1))
    return InnerBoundary(column, smooth[0] * np.float32(CELL_M), float(shown.sum() / max(1, testable.sum())))
