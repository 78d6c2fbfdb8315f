"""The inner boundary: where the light that comes back jumps down, and does not just fall as the wall attenuates it.

The wall is unrolled along its surface into (column, thickness), thickness measured along the surface's normal, so that
a wall of even thickness is a straight band whatever its dents. In it light falls steadily (linearly on a logarithmic
scale in an even medium: Beer-Lambert), and the wall's end is a jump: the distance between a straight line through the
cells above and one through the cells below. A mere change of slope is none. Below the wall there may be a thin weaker
layer, the choroid, whose own lower edge jumps further; so a jump with another one close above it counts less. The path
of the largest jumps is then moved, column by column, to where the light crosses the middle of the jump.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation_grid import Float, Pixels, PixelScale
from scleraforce.imaging.segmentation_path import best_path

__all__ = ["InnerBoundary", "find_inner", "surface_stretch"]

CELL_M = 20e-6  # of thickness in the unrolled wall
CELLS = 75  # 1.5 mm: the boundary is looked for down to 1.36 mm
GROUP = 4  # columns sampled for one point
SKIP_CELLS = 3  # mirror reflection and blur of the surface
LEVEL_CELLS = 12  # below the surface: these give a column's own level (shadows)
LEAST_CELLS = 11  # a wall is thicker than this: 0.22 mm
POOLED = 3  # points whose mean makes a jump stand out of the speckle
LINE_CELLS = 6  # for the straight line on each side of a jump
SKIP_EDGE = 1  # on each side of a jump: transition
HALF_JUMP = 0.08  # of the level at the surface: a jump of this size earns half of what the largest one can
UPPER_COST = 1.2  # share of an upper jump's gain that a jump below it loses
LAYER_CELLS = (4, 16)  # distance between both: a weaker layer below the wall is 0.08 to 0.32 mm thick
REACH_CELLS = 5
REFINE_CELLS = 6
LEAST_JUMP = 0.06  # of the level at the surface: less is no sign of the boundary
SURE_JUMP = 2.5  # ... nor is less than this many times the median jump
SURE_SPREAD, SPREAD_CELLS = 1.3, 21  # ... nor this many standard deviations of jumps at about that depth

_LAYER = np.ones((1, LAYER_CELLS[1] - LAYER_CELLS[0] + 1), dtype=np.uint8)
# Makes the path unique where nothing is seen.
_ROW_COST = np.linspace(0.0, 1e-3, CELLS + 1, dtype=np.float32)
_THICKNESS_M = (np.arange(CELLS, dtype=np.float32) + np.float32(0.5)) * np.float32(CELL_M)
_OFFSET = np.arange(-REFINE_CELLS, REFINE_CELLS)
_FROM_MIDDLE = (_OFFSET + 0.5 + SKIP_EDGE + LINE_CELLS / 2).astype(np.float32)
_SUMS = np.triu(np.ones((2 * REFINE_CELLS, 2 * REFINE_CELLS + 1), dtype=np.float32), 1)
_RAMP = np.arange(LINE_CELLS) - (LINE_CELLS - 1) / 2
_SLOPE = (_RAMP / np.square(_RAMP).sum()).astype(np.float32)[None]  # of a straight line, least squares
_MEAN = np.full((1, LINE_CELLS), 1.0 / LINE_CELLS, dtype=np.float32)


@dataclass(frozen=True)
class InnerBoundary:
    """Thickness along the normal at some columns, m, shape (point,), and the share of those that show the boundary."""

    column: Float
    thickness_m: Float
    support: float


def surface_stretch(column: Float, row: Float, scale: PixelScale) -> Float:
    """Return by how much a wall is longer along a column than along the surface's normal, shape (column,).

    Args:
        column: columns of the surface in the frame, evenly spaced.
        row: its rows, no NaN.
        scale: size of the frame's pixel, in tissue.
    """
    step_m = (column[1] - column[0]) * scale.lateral_m
    reach = min(max(1, round(0.15e-3 / step_m)), (len(column) - 1) // 2)
    padded = np.concatenate([2 * row[0] - row[reach:0:-1], row, 2 * row[-1] - row[-2 : -2 - reach : -1]])
    slope = (padded[2 * reach :] - padded[: -2 * reach]) * np.float32(scale.depth_m / (2 * reach * step_m))
    stretch: Float = np.sqrt(1.0 + np.minimum(np.square(slope), np.float32(9.0)))
    return stretch


def find_inner(
    frame: Pixels, floor: float, column: Float, row: Float, there: NDArray[np.bool_], along_rows: Float
) -> InnerBoundary:
    """Find the inner boundary below a surface.

    Args:
        frame: counts, shape (row, column).
        floor: count of its noise floor.
        column: columns of the surface in the frame, shape (point,); their number a multiple of 8.
        row: its rows in the frame, no NaN.
        there: whether there is a surface.
        along_rows: rows of the frame along a column for 1 m of thickness along the normal, shape (point,).

    Returns:
        The boundary; its `support` is 0 where none is seen.
    """
    wall, seen = _unroll(frame, floor, column, row, there, along_rows)
    mean, slope, jump = _jumps(wall, seen)
    least = _least_jump(jump)
    gain = np.maximum(jump - least, np.float32(0.0))
    gain /= gain + np.float32(HALF_JUMP)
    score = gain - _ROW_COST
    near, far = LAYER_CELLS
    upper = cv2.dilate(gain, _LAYER, anchor=(far - near, 0))  # of the jumps `far - near` cells above, down to here
    score[:, near:] -= np.float32(UPPER_COST) * upper[:, :-near]
    path = best_path(score, REACH_CELLS)
    point = np.arange(len(path))
    first = np.maximum(path - SKIP_EDGE - LINE_CELLS, 0)
    boundary = _cross(wall, path, mean[point, first], slope[point, first], np.maximum(jump[point, path], 0))
    testable = seen[point, np.minimum(path + SKIP_EDGE, CELLS - 1)] > 0
    shown = (jump[point, path] > least[path]) & testable
    weight = (shown.astype(np.float32) + np.float32(1e-3))[None]
    smooth = cv2.blur(boundary[None] * weight, (5, 1)) / cv2.blur(weight, (5, 1))
    support = float(shown.sum() / max(1, testable.sum()))
    return InnerBoundary(_grouped(column[None])[0], smooth[0] * np.float32(CELL_M), support)


def _grouped(values: Float) -> Float:
    """Average groups of neighbouring columns, (row, column) -> (row, column / GROUP)."""
    size = (values.shape[1] // GROUP, values.shape[0])
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _unroll(
    frame: Pixels, floor: float, column: Float, row: Float, there: NDArray[np.bool_], along_rows: Float
) -> tuple[Float, Float]:
    """Return the wall as (point, cell), surface level 1 and floor 0, and where it is measured (1 or 0)."""
    map_row = row + _THICKNESS_M[:, None] * along_rows
    map_column = np.ascontiguousarray(np.broadcast_to(column, map_row.shape))
    sampled = cv2.remap(frame, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    light = np.ascontiguousarray(_grouped(sampled.astype(np.float32)).T)
    inside = (map_row <= len(frame) - 1) & there
    seen = (inside[:, ::GROUP] & inside[:, GROUP - 1 :: GROUP]).T.astype(np.float32)
    light = np.maximum(light - np.float32(floor), np.float32(0.0)) * seen
    top = slice(SKIP_CELLS, LEVEL_CELLS)
    count = seen[:, top].sum(axis=1, keepdims=True)
    level = cv2.blur(light[:, top].sum(axis=1, keepdims=True) / np.maximum(count, 1.0), (1, 3))
    seen *= level > 1e-3 * max(float(level.max()), 1e-6)
    return np.minimum(light / np.maximum(level, np.float32(1e-6)), np.float32(1.5)), seen


def _jumps(wall: Float, seen: Float) -> tuple[Float, Float, Float]:
    """Return, for the lines that start at each cell, their mean and slope, and the jump at each edge between cells.

    Shapes (point, cell), (point, cell), (point, cell + 1); neighbouring points are pooled.
    """
    share = cv2.blur(seen, (1, POOLED))
    pooled = cv2.blur(wall * seen, (1, POOLED)) / np.maximum(share, np.float32(1e-3))
    mean = np.asarray(cv2.filter2D(pooled, -1, _MEAN, anchor=(0, 0)), dtype=np.float32)
    tilt = np.asarray(cv2.filter2D(pooled, -1, _SLOPE, anchor=(0, 0)), dtype=np.float32)
    slope = np.minimum(tilt, np.float32(0.0))
    reach = np.float32(LINE_CELLS / 2 + SKIP_EDGE)
    edges = slice(LEAST_CELLS, CELLS - LINE_CELLS - SKIP_EDGE + 1)
    above = slice(edges.start - SKIP_EDGE - LINE_CELLS, edges.stop - SKIP_EDGE - LINE_CELLS)
    below = slice(edges.start + SKIP_EDGE, edges.stop + SKIP_EDGE)
    jump = np.zeros((len(wall), CELLS + 1), dtype=np.float32)
    jump[:, edges] = np.maximum(mean[:, above] + slope[:, above] * reach, np.float32(0.0))
    jump[:, edges] -= mean[:, below] - slope[:, below] * reach
    deepest = slice(edges.start + SKIP_EDGE + LINE_CELLS - 1, edges.stop + SKIP_EDGE + LINE_CELLS - 1)
    jump[:, edges] *= share[:, deepest] > 0.3
    return mean, slope, jump


def _least_jump(jump: Float) -> Float:
    """Return the jump that stands out at each edge, shape (edge,), from what speckle and texture make.

    Their jumps are told by their median size (the wall's end is rare), and by how much jumps at one depth differ from
    place to place (the wall's end does not).
    """
    sizes = np.abs(jump[:, LEAST_CELLS : CELLS - LINE_CELLS : 2]).ravel()
    sizes = sizes[sizes > 0]
    typical = float(np.partition(sizes, len(sizes) // 2)[len(sizes) // 2]) if len(sizes) else 0.0
    change = jump[POOLED:] - jump[:-POOLED]
    spread = cv2.blur(np.sqrt(np.square(change).mean(axis=0) / 2)[None], (SPREAD_CELLS, 1))[0]
    least: Float = np.maximum(max(LEAST_JUMP, SURE_JUMP * typical), SURE_SPREAD * spread).astype(np.float32)
    return least


def _cross(wall: Float, path: NDArray[np.intp], mean: Float, slope: Float, jump: Float) -> Float:
    """Return the edge near a path, in cells, shape (point,), that best parts light above and below a jump's middle."""
    cell = np.minimum(np.maximum(path[:, None] + _OFFSET, 0), CELLS - 1)
    smooth = cv2.blur(wall, (1, 3))[np.arange(len(path))[:, None], cell]
    threshold = mean[:, None] + slope[:, None] * _FROM_MIDDLE - jump[:, None] / 2
    limit = np.maximum(jump[:, None], np.float32(1e-3))
    sums = np.minimum(np.maximum(smooth - threshold, -limit), limit) @ _SUMS
    edge: Float = (path + sums.argmax(axis=1) - REFINE_CELLS).astype(np.float32)
    return edge
