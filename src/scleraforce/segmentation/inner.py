"""The inner boundary: where the light that comes back jumps down, and does not just fall as the wall attenuates it.

The wall is unrolled along its surface into (column, thickness), thickness measured along the surface's normal, so that
a wall of even thickness is a straight band whatever its dents. In it light falls steadily (linearly on a logarithmic
scale in an even medium: Beer-Lambert), and the wall's end is a jump: the few cells below lie lower than a straight line
through the cells above would go on. Below the wall there may be a thin weaker layer, the choroid, whose own lower edge
jumps further; so a jump with another one close above it counts less. The cells below are few because that layer is
thin: a mean over both its edges would hide the upper one. The path of the largest jumps is then moved, column by
column, to where the light crosses the middle of the jump.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.path import best_path

CELL_M = 20e-6  # of thickness in the unrolled wall
CELLS = 72  # 1.44 mm: the boundary is looked for down to 1.36 mm
GROUP = 4  # columns sampled for one point
SKIP_CELLS = 3  # mirror reflection and blur of the surface
LEVEL_CELLS = 12  # below the surface: these give a column's own level (shadows)
LEAST_CELLS = 11  # a wall is thicker than this: 0.22 mm
POOLED = 3  # points whose mean makes a jump stand out of the speckle
LINE_CELLS = 6  # for the straight line above a jump
LOW_CELLS = 3  # for the mean below it
SKIP_EDGE = 1  # on each side of a jump: transition
HALF_JUMP = 0.08  # of the level at the surface: a jump of this size earns half of what the largest one can
UPPER_COST = 1.2  # share of an upper jump's gain that a jump below it loses
LAYER_CELLS = (4, 16)  # distance between both: a weaker layer below the wall is 0.08 to 0.32 mm thick
REACH_CELLS = 5
REFINE_CELLS = 6
LEAST_JUMP = 0.06  # of the level at the surface: less is no sign of the boundary
SURE_JUMP = 2.5  # ... nor is less than this many times the median jump
SLOPE_M = 0.15e-3  # on each side: a surface's slope is told over so much
STEEPEST = 3.0  # slope of a surface: beyond it a wall is no longer along a column
LEAST_LEVEL_SHARE = 1e-3  # of the brightest level: a group with less is not measured
BRIGHTEST = 1.5  # times a group's own level: what is brighter counts as that
SURE_SPREAD, SPREAD_CELLS = 1.3, 21  # ... nor this many standard deviations of jumps at about that depth

EDGES = slice(LEAST_CELLS, CELLS - LOW_CELLS - SKIP_EDGE + 1)  # between cells, where a jump is looked for
_ABOVE = slice(EDGES.start - SKIP_EDGE - LINE_CELLS, EDGES.stop - SKIP_EDGE - LINE_CELLS)  # first cells of the lines
_BELOW = slice(EDGES.start + SKIP_EDGE, EDGES.stop + SKIP_EDGE)  # first cells below
_DEEPEST = slice(_BELOW.start + LOW_CELLS - 1, _BELOW.stop + LOW_CELLS - 1)  # last cells below
_LAYER = np.ones((1, LAYER_CELLS[1] - LAYER_CELLS[0] + 1), dtype=np.uint8)
# Makes the path unique where nothing is seen.
ROW_COST = np.linspace(0.0, 1e-3, CELLS + 1, dtype=np.float32)
THICKNESS_M = (np.arange(CELLS, dtype=np.float32) + np.float32(0.5)) * np.float32(CELL_M)
_ROW_AND_DEPTH = np.stack([np.ones_like(THICKNESS_M), THICKNESS_M], axis=1)
_LEVEL = np.zeros(CELLS, dtype=np.float32)
_LEVEL[SKIP_CELLS:LEVEL_CELLS] = 1.0
_REACH = LINE_CELLS / 2 + SKIP_EDGE  # from the middle of a line to the jump
_OFFSET = np.arange(-REFINE_CELLS, REFINE_CELLS)
FROM_MIDDLE = ((_OFFSET + 0.5) / _REACH + 1.0).astype(np.float32)
_SUMS = np.triu(np.ones((2 * REFINE_CELLS, 2 * REFINE_CELLS + 1), dtype=np.float32), 1)
_RAMP = np.arange(LINE_CELLS) - (LINE_CELLS - 1) / 2
BEND = (_REACH * _RAMP / np.square(_RAMP).sum()).astype(np.float32)[
    None
]  # of a straight line, least squares, over _REACH
_MEAN = np.full((1, LINE_CELLS), 1.0 / LINE_CELLS, dtype=np.float32)
_LOW_MEAN = np.full((1, LOW_CELLS), 1.0 / LOW_CELLS, dtype=np.float32)
# `BEND` goes from a line's middle to the jump; so many times that, it goes on to the middle of the cells below.
BEND_TO_LOW = np.float32(1.0 + (LOW_CELLS / 2 + SKIP_EDGE) / _REACH)


@dataclass(frozen=True)
class InnerBoundary:
    """Thickness along the normal at each group of points, m, (point / GROUP,), and which of them show the boundary.

    `support` is the share that do.
    """

    thickness_m: Float
    shown: NDArray[np.bool_]
    support: float


def surface_stretch(column: Float, row: Float, scale: PixelScale) -> Float:
    """Return by how much a wall is longer along a column than along the surface's normal, shape (column,).

    Args:
        column: columns of the surface in the frame, evenly spaced.
        row: its rows, no NaN.
        scale: size of the frame's pixel, in tissue.
    """
    step_m = float(column[1] - column[0]) * scale.lateral_m
    reach = slope_reach(len(column), step_m)
    # Mirrored in its end points, a slope goes on beyond them.
    longer = np.concatenate((2 * row[0] - row[reach:0:-1], row, 2 * row[-1] - row[-2 : -2 - reach : -1]))
    slope = longer[2 * reach :] - longer[: -2 * reach]
    slope *= np.float32(scale.depth_m / (2 * reach * step_m))
    np.square(slope, slope)
    np.minimum(slope, np.float32(STEEPEST**2), out=slope)
    slope += np.float32(1.0)
    stretch: Float = np.sqrt(slope, slope)
    return stretch


def slope_reach(points: int, step_m: float) -> int:
    """Return how many points on each side tell a surface's slope."""
    return min(max(1, round(SLOPE_M / step_m)), (points - 1) // 2)


def find_inner(
    frame: Pixels,
    floor: float,
    column: Float,
    row: Float,
    there: NDArray[np.bool_],
    along_rows: Float,
    prior: Float | None = None,
) -> InnerBoundary:
    """Find the inner boundary below a surface.

    Args:
        frame: counts, shape (row, column).
        floor: count of its noise floor.
        column: columns of the surface in the frame, once for each of CELLS rows, shape (CELLS, point); a multiple of 8.
        row: its rows in the frame, no NaN, shape (point,).
        there: whether there is a surface.
        along_rows: rows of the frame along a column for 1 m of thickness along the normal, shape (point,).
        prior: what each edge between cells gains from what is known before, (point / GROUP, CELLS + 1); a jump gains
            at most 1. None: nothing is known.

    Returns:
        The boundary; its `support` is 0 where none is seen.
    """
    wall, seen = _unroll(frame, floor, column, row, there, along_rows)
    mean, bend, jump = _jumps(wall, seen)
    least = _least_jump(jump)
    gain = jump - least
    cv2.threshold(gain, 0.0, 0.0, cv2.THRESH_TOZERO, gain)
    gain /= gain + np.float32(HALF_JUMP)
    score = gain - ROW_COST
    near, far = LAYER_CELLS
    # The largest of the jumps `far - near` cells above, down to here.
    upper = cast(Float, cv2.dilate(gain, _LAYER, anchor=(far - near, 0)))
    upper *= np.float32(UPPER_COST)
    score[:, near:] -= upper[:, :-near]
    if prior is not None:
        score += prior
    path = best_path(score, REACH_CELLS)
    point = _numbers(len(path))
    first = np.maximum(path - (SKIP_EDGE + LINE_CELLS), 0)
    size = jump[point, path]
    boundary = _cross(wall, path, mean[point, first], bend[point, first], np.maximum(size, np.float32(0.0)))
    testable = seen[point, np.minimum(path + SKIP_EDGE, CELLS - 1)] > 0
    shown = (size > least[path]) & testable
    weight = shown + np.float32(1e-3)
    smooth = cv2.blur((boundary * weight)[None], (5, 1))[0]
    smooth /= cv2.blur(weight[None], (5, 1))[0]
    smooth *= np.float32(CELL_M)
    support = int(np.count_nonzero(shown)) / max(1, int(np.count_nonzero(testable)))
    return InnerBoundary(cast(Float, smooth), shown, support)


def _unroll(
    frame: Pixels, floor: float, column: Float, row: Float, there: NDArray[np.bool_], along_rows: Float
) -> tuple[Float, Float]:
    """Return the wall as (group, cell), surface level 1 and floor 0, and where it is measured (1 or 0)."""
    map_row = _ROW_AND_DEPTH @ np.concatenate((row, along_rows)).reshape(2, -1)
    sampled = cv2.remap(frame, column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    light = cast(Float, cv2.transpose(cv2.resize(sampled, (len(row) // GROUP, CELLS), interpolation=cv2.INTER_AREA)))
    seen = _measured((len(frame) - 1 - row) / along_rows, there)
    light -= np.float32(floor)
    cv2.threshold(light, 0.0, 0.0, cv2.THRESH_TOZERO, light)
    light *= seen
    level = (light @ _LEVEL) / np.maximum(seen @ _LEVEL, np.float32(1.0))
    level = cast(Float, cv2.blur(level[:, None], (1, 3)))
    seen *= level > max(LEAST_LEVEL_SHARE * float(level.max()), 1e-9)
    light *= seen / np.maximum(level, np.float32(1e-6))
    cv2.threshold(light, BRIGHTEST, 0.0, cv2.THRESH_TRUNC, light)
    return light, seen


def _measured(deepest_m: Float, there: NDArray[np.bool_]) -> Float:
    """Return 1 in the cells, (group, cell), above the deepest thickness at the outer points of a group, else 0."""
    deepest_m *= there
    ends = np.minimum(deepest_m[::GROUP], deepest_m[GROUP - 1 :: GROUP])
    return (ends[:, None] >= THICKNESS_M).astype(np.float32)


def _jumps(wall: Float, seen: Float) -> tuple[Float, Float, Float]:
    """Return what straight lines through the cells say, and the jump at each edge between cells.

    For the lines that start at each cell: their mean, and by how much they fall from their middle to the jump, both
    (group, cell); jump (group, cell + 1): by how much the cells below lie lower than the line above goes on to there.
    Neighbouring groups are pooled.
    """
    share = cv2.blur(seen, (1, POOLED))
    pooled = cast(Float, cv2.blur(wall, (1, POOLED)))
    pooled /= np.maximum(share, np.float32(1e-3))
    mean = cast(Float, cv2.filter2D(pooled, -1, _MEAN, anchor=(0, 0)))
    bend = cast(Float, cv2.filter2D(pooled, -1, BEND, anchor=(0, 0)))
    cv2.threshold(bend, 0.0, 0.0, cv2.THRESH_TRUNC, bend)
    low = cast(Float, cv2.filter2D(pooled, -1, _LOW_MEAN, anchor=(0, 0)))
    jump = np.zeros((len(wall), CELLS + 1), dtype=np.float32)
    inside = jump[:, EDGES]
    np.multiply(bend[:, _ABOVE], BEND_TO_LOW, inside)
    inside += mean[:, _ABOVE]
    np.maximum(inside, np.float32(0.0), out=inside)
    inside -= low[:, _BELOW]
    inside *= share[:, _DEEPEST] > np.float32(0.3)
    return mean, bend, jump


def _least_jump(jump: Float) -> Float:
    """Return the jump that stands out at each edge, shape (edge,), from what speckle and texture make.

    Their jumps are told by their median size (the wall's end is rare), and by how much jumps at one depth differ from
    place to place (the wall's end does not).
    """
    sizes = np.abs(jump[:, EDGES.start : EDGES.stop : 2]).ravel()
    sizes = sizes[sizes > 0]
    typical = float(np.partition(sizes, len(sizes) // 2)[len(sizes) // 2]) if len(sizes) else 0.0
    change = jump[POOLED:] - jump[:-POOLED]
    np.square(change, change)
    spread = _half_mean(len(change)) @ change
    np.sqrt(spread, spread)
    least: Float = cv2.blur(spread[None], (SPREAD_CELLS, 1))[0]
    least *= np.float32(SURE_SPREAD)
    np.maximum(least, np.float32(max(LEAST_JUMP, SURE_JUMP * typical)), out=least)
    return least


def _cross(wall: Float, path: NDArray[np.intp], mean: Float, bend: Float, jump: Float) -> Float:
    """Return the edge near a path, in cells, shape (group,), that best parts light above and below a jump's middle."""
    path = np.minimum(np.maximum(path, REFINE_CELLS), CELLS - REFINE_CELLS)
    above = cv2.blur(wall, (1, 3))[_numbers(len(path))[:, None], path[:, None] + _OFFSET]
    above -= bend[:, None] * FROM_MIDDLE
    above -= (mean - jump / 2)[:, None]
    limit = np.maximum(jump, np.float32(1e-3))[:, None]
    np.minimum(np.maximum(above, -limit, out=above), limit, out=above)
    edge: Float = (path + (above @ _SUMS).argmax(axis=1)).astype(np.float32)
    edge -= np.float32(REFINE_CELLS)
    return edge


@lru_cache(maxsize=8)
def _numbers(count: int) -> NDArray[np.intp]:
    return np.arange(count)


@lru_cache(maxsize=8)
def _half_mean(count: int) -> Float:
    """Return the weights, (count,), whose product is half the mean: the variance of one of two, from differences."""
    return np.full(count, 0.5 / count, dtype=np.float32)
