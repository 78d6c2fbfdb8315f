"""The inner boundary in the unrolled wall: `inner.find_inner` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation import inner
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.inner import CELLS, LINE_CELLS, LOW_CELLS, POOLED, REFINE_CELLS, SKIP_EDGE
from scleraforce.segmentation.kernels.multiply_add import multiply_add
from scleraforce.segmentation.kernels.path import find_path
from scleraforce.segmentation.kernels.ranks import nth
from scleraforce.segmentation.kernels.sampling import mean_of_neighbours, mirrored

_FIRST_EDGE, _AFTER_EDGE = inner.EDGES.start, inner.EDGES.stop
_BEND, _BEND_TO_LOW, _FROM_MIDDLE = inner.BEND.ravel(), inner.BEND_TO_LOW, inner.FROM_MIDDLE
_LINE_SHARE, _LOW_SHARE = np.float32(1.0 / LINE_CELLS), np.float32(1.0 / LOW_CELLS)
_LEAST_JUMP, _SURE_JUMP, _SURE_SPREAD = inner.LEAST_JUMP, inner.SURE_JUMP, np.float32(inner.SURE_SPREAD)
_SPREAD_REACH = inner.SPREAD_CELLS // 2
_HALF_JUMP, _UPPER_COST = np.float32(inner.HALF_JUMP), np.float32(inner.UPPER_COST)
_NEAR, _FAR = inner.LAYER_CELLS
_ROW_COST, _REACH = inner.ROW_COST, inner.REACH_CELLS
_CELL_M = np.float32(inner.CELL_M)
_MEASURED, _SEEN = np.float32(0.3), np.float32(1e-3)
_ZERO, _THIRD = np.float32(0.0), 1.0 / 3.0


@compiled
def find_jumps(wall: Float, seen: Float, pooled: Float, near: Float, mean: Float, bend: Float, jump: Float) -> None:
    """Write what straight lines through the cells say, and the jump at each edge between cells: see `inner._jumps`.

    Args:
        wall: unrolled, (group, cell).
        seen: where it is measured.
        pooled: scratch, (group, cell).
        near: means over neighbouring groups, (group, cell).
        mean: of the lines that start at each cell.
        bend: by how much they fall from their middle to the jump.
        jump: (group, CELLS + 1).
    """
    groups = len(wall)
    for group in range(groups):
        before, after = mirrored(group - 1, groups), mirrored(group + 1, groups)
        for cell in range(CELLS):
            light = np.float64(wall[before, cell]) + np.float64(wall[group, cell]) + np.float64(wall[after, cell])
            share = np.float32((seen[before, cell] + seen[group, cell] + seen[after, cell]) * _THIRD)
            near[group, cell] = np.float32(light * _THIRD)
            pooled[group, cell] = near[group, cell] / max(share, _SEEN)
        for cell in range(CELLS - LINE_CELLS + 1):
            middle = fall = _ZERO
            for step in range(LINE_CELLS):
                middle = multiply_add(_LINE_SHARE, pooled[group, cell + step], middle)
                fall = multiply_add(_BEND[step], pooled[group, cell + step], fall)
            mean[group, cell], bend[group, cell] = middle, min(fall, _ZERO)
        for edge in range(CELLS + 1):
            jump[group, edge] = _ZERO
        for edge in range(_FIRST_EDGE, _AFTER_EDGE):
            line, low = edge - SKIP_EDGE - LINE_CELLS, _ZERO
            for step in range(LOW_CELLS):
                low = multiply_add(_LOW_SHARE, pooled[group, edge + SKIP_EDGE + step], low)
            deepest = edge + SKIP_EDGE + LOW_CELLS - 1
            share = np.float32((seen[before, deepest] + seen[group, deepest] + seen[after, deepest]) * _THIRD)
            if share > _MEASURED:
                above = max(bend[group, line] * _BEND_TO_LOW + mean[group, line], _ZERO)
                jump[group, edge] = above - low


@compiled
def score_jumps(jump: Float, sizes: Float, spread: Float, least: Float, gain: Float, score: Float) -> None:
    """Write the jump that stands out at each edge, and what a path gains there: see `inner.find_inner`.

    Args:
        jump: of `find_jumps`.
        sizes: scratch, as many values as jumps.
        spread: scratch, (edge,).
        least: jump that stands out, (edge,).
        gain: scratch, (group, edge).
        score: (group, edge).
    """
    groups, edges = jump.shape
    _stand_out(jump, sizes, spread, least)
    for group in range(groups):
        for edge in range(edges):
            over = max(jump[group, edge] - least[edge], _ZERO)
            gain[group, edge] = over / (over + _HALF_JUMP)
        own, upper = gain[group], spread
        for edge in range(edges):
            upper[edge] = _ZERO
        for above in range(_NEAR, _FAR + 1):
            for edge in range(edges - above):
                upper[edge + above] = max(upper[edge + above], own[edge])
        for edge in range(edges):
            score[group, edge] = own[edge] - _ROW_COST[edge] - upper[edge] * _UPPER_COST


@compiled
def _stand_out(jump: Float, sizes: Float, spread: Float, least: Float) -> None:
    """Write the jump that stands out from what speckle and texture make: see `inner._least_jump`."""
    groups, edges = jump.shape
    number = 0
    for group in range(groups):
        for edge in range(_FIRST_EDGE, _AFTER_EDGE, 2):
            sizes[number] = abs(jump[group, edge])
            number += sizes[number] > 0
    typical = np.float64(nth(sizes, number, number // 2)) if number else 0.0
    half_share = np.float64(np.float32(0.5 / (groups - POOLED)))
    for edge in range(edges):
        total = 0.0
        for group in range(groups - POOLED):
            change = jump[group + POOLED, edge] - jump[group, edge]
            total += half_share * np.float64(change * change)
        spread[edge] = np.sqrt(np.float32(total))
    mean_of_neighbours(spread, _SPREAD_REACH, least)
    smallest = np.float32(max(_LEAST_JUMP, _SURE_JUMP * typical))
    for edge in range(edges):
        least[edge] = max(least[edge] * _SURE_SPREAD, smallest)


@compiled
def find_thickness(
    near: Float, seen: Float, mean: Float, bend: Float, jump: Float, least: Float, score: Float,
    path: NDArray[np.int64], downwards: Float, upwards: Float, edge: Float, weight: Float, thickness_m: Float,
) -> float:  # fmt: skip
    """Write the thickness along the normal at each group, and return the share of them that show the boundary.

    Args:
        near: of `find_jumps`, like `mean`, `bend` and `jump`.
        seen: where the wall is measured.
        mean: of lines.
        bend: of lines.
        jump: at edges.
        least: of `score_jumps`, like `score`.
        score: of edges.
        path: scratch, (group,).
        downwards: scratch, (group, edge).
        upwards: the same.
        edge: scratch, (2, group).
        weight: the same.
        thickness_m: the result.
    """
    find_path(score, _REACH, path, downwards, upwards)
    shown = testable = 0
    for group in range(len(path)):
        size, first = jump[group, path[group]], max(path[group] - SKIP_EDGE - LINE_CELLS, 0)
        found = _cross(near[group], path[group], mean[group, first], bend[group, first], max(size, _ZERO))
        measured = seen[group, min(path[group] + SKIP_EDGE, CELLS - 1)] > 0
        shows = size > least[path[group]] and measured
        testable += measured
        shown += shows
        weight[0, group] = np.float32(shows) + _SEEN
        edge[0, group] = found * weight[0, group]
    mean_of_neighbours(edge[0], 2, edge[1])
    mean_of_neighbours(weight[0], 2, weight[1])
    for group in range(len(path)):
        thickness_m[group] = edge[1, group] / weight[1, group] * _CELL_M
    return shown / max(1, testable)


@compiled
def _cross(near: Float, path: int, mean: np.float32, bend: np.float32, jump: np.float32) -> np.float32:
    """Return the edge near a path, in cells, that best parts light above and below a jump's middle."""
    path = min(max(path, REFINE_CELLS), CELLS - REFINE_CELLS)
    limit, middle = max(jump, _SEEN), mean - jump / np.float32(2.0)
    best, total, largest = 0, _ZERO, _ZERO
    for step in range(2 * REFINE_CELLS):
        above = near[path + step - REFINE_CELLS] - bend * _FROM_MIDDLE[step] - middle
        total += min(max(above, -limit), limit)
        if total > largest:
            best, largest = step + 1, total
    return np.float32(path + best) - np.float32(REFINE_CELLS)
