"""The inner boundary: where the light that comes back jumps down, and does not just
fall as the wall attenuates it.

The wall is unrolled along its surface into (column, thickness), thickness measured
along the surface's normal, so that a wall of even thickness is a straight band whatever
its dents. In it light falls steadily (linearly on a logarithmic scale in an even
medium: Beer-Lambert), and the wall's end is a jump: the few cells below lie lower than
a straight line through the cells above would. Below the wall there may be a thin weaker
layer, the choroid, whose own lower edge jumps further; so a jump with another one close
above it counts less. The cells below are few because that layer is thin: a mean over
both its edges would hide the upper one. The path of the largest jumps is then moved,
column by column, to where the light crosses the middle of the jump.
"""

import numpy as np

from scleraforce.base.arrays import Counts, Flags, Indices, Singles
from scleraforce.base.compiled_loops import compiled
from scleraforce.wall.shared_loops import (
    best_path,
    mean_of_neighbours,
    mirrored,
    multiply_add,
    sample_rows,
    size_at,
)

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
# share of the level at the surface: a jump of this size earns half of the largest gain
HALF_JUMP = np.float32(0.08)
UPPER_COST = np.float32(1.2)  # share of an upper jump's gain that a jump below it loses
# between both: a weaker layer below the wall is 0.08 to 0.32 mm thick
NEAR_CELLS = 4
FAR_CELLS = 16
REACH_CELLS = 5
REFINE_CELLS = 6
# share of the level at the surface: a smaller jump does not show the boundary
LEAST_JUMP = 0.06
SURE_JUMP = 2.5  # ... nor is less than this many times the median jump
SLOPE_M = 0.15e-3  # on each side: over which a surface's slope is taken
# square of a surface's slope: beyond it a wall is no longer along a column
STEEPEST = np.float32(3.0**2)
LEAST_LEVEL_SHARE = 1e-3  # of the brightest level: a group with less is not measured
# times a group's own level: what is brighter counts as that
BRIGHTEST = np.float32(1.5)
# ... nor this many standard deviations of jumps within some cells
SURE_SPREAD = np.float32(1.3)
SPREAD_REACH = 10

# between cells, where a jump is looked for
FIRST_EDGE = LEAST_CELLS
AFTER_EDGE = CELLS - LOW_CELLS - SKIP_EDGE + 1
# Makes the path unique where nothing is seen.
ROW_COST = np.linspace(0.0, 1e-3, CELLS + 1, dtype=np.float32)
THICKNESS_M = (np.arange(CELLS, dtype=np.float32) + np.float32(0.5)) * np.float32(
    CELL_M
)
_REACH = LINE_CELLS / 2 + SKIP_EDGE  # from the middle of a line to the jump
_OFFSET = np.arange(-REFINE_CELLS, REFINE_CELLS)
FROM_MIDDLE = ((_OFFSET + 0.5) / _REACH + 1.0).astype(np.float32)
_RAMP = np.arange(LINE_CELLS) - (LINE_CELLS - 1) / 2
# of a straight line, least squares, over _REACH
BEND = (_REACH * _RAMP / np.square(_RAMP).sum()).astype(np.float32)
# `BEND` goes from a line's middle to the jump; this many times that, it continues to
# the middle of the cells below.
BEND_TO_LOW = np.float32(1.0 + (LOW_CELLS / 2 + SKIP_EDGE) / _REACH)
_LINE_SHARE = np.float32(1.0 / LINE_CELLS)
_LOW_SHARE = np.float32(1.0 / LOW_CELLS)
_CELL_M = np.float32(CELL_M)
_MEASURED = np.float32(0.3)
_SEEN = np.float32(1e-3)
_LEAST_LEVEL = np.float32(1e-6)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_THIRD = 1.0 / 3.0


@compiled
def stretch(row: Singles, point_m: float, depth_m: float) -> Singles:
    """Return the rows (`depth_m` in tissue) along a column for 1 m along the normal of
    a surface at every `point_m`.
    """
    points = len(row)
    along_rows = np.empty_like(row)
    reach = min(max(1, round(SLOPE_M / point_m)), (points - 1) // 2)
    # slope, metres over metres, of one row
    rise = np.float32(depth_m / (2 * reach * point_m))

    for at in range(points):
        first = at - reach
        last = at + reach
        # Mirrored in its end points, a slope continues beyond them.
        before = row[first] if first >= 0 else np.float32(2 * row[0] - row[-first])
        after = (
            row[last]
            if last < points
            else np.float32(2 * row[points - 1] - row[2 * (points - 1) - last])
        )
        slope = (after - before) * rise
        along_rows[at] = np.sqrt(min(slope * slope, STEEPEST) + _ONE) / np.float32(
            depth_m
        )

    return along_rows


@compiled
def unroll(
    frame: Counts,
    first: int,
    floor: int,
    columns: Indices,
    across: Singles,
    row: Singles,
    there: Flags,
    along_rows: Singles,
) -> tuple[Singles, Singles]:
    """Return the wall as (group, cell), surface level 1 and noise floor 0, and where it
    is measured (1 or 0).

    The surface has rows `row` (point,), and is stretched by `along_rows`. For `frame`
    to `across` see `sample_rows`.
    """
    points = len(row)
    places = np.empty((CELLS, points), np.float32)
    wall = np.empty((points // GROUP, CELLS), np.float32)
    for cell in range(CELLS):
        for at in range(points):
            places[cell, at] = multiply_add(THICKNESS_M[cell], along_rows[at], row[at])

    light = sample_rows(frame, first, columns, across, places)
    seen = _measured(np.float32(len(frame) - 1), row, there, along_rows)

    for cell in range(CELLS):
        for group in range(len(wall)):
            total = _ZERO
            for at in range(GROUP * group, GROUP * group + GROUP):
                total += light[cell, at]

            wall[group, cell] = (
                max(total * np.float32(1.0 / GROUP) - np.float32(floor), _ZERO)
                * seen[group, cell]
            )

    _level_out(wall, seen)
    return wall, seen


@compiled
def _measured(
    last_row: np.float32, row: Singles, there: Flags, along_rows: Singles
) -> Singles:
    """Return 1 in the cells above the deepest thickness at the outer points of a group,
    else 0, (group, cell).
    """
    seen = np.empty((len(row) // GROUP, CELLS), np.float32)
    for group in range(len(seen)):
        first = GROUP * group
        last = GROUP * group + GROUP - 1
        shallower = min(
            (last_row - row[first]) / along_rows[first] * np.float32(there[first]),
            (last_row - row[last]) / along_rows[last] * np.float32(there[last]),
        )

        for cell in range(CELLS):
            seen[group, cell] = np.float32(shallower >= THICKNESS_M[cell])

    return seen


@compiled
def _level_out(wall: Singles, seen: Singles) -> None:
    """Divide each group by its own level near the surface; where that is dark, nothing
    is measured.
    """
    groups = len(wall)
    largest = _ZERO
    own = np.empty(groups, np.float32)
    smooth = np.empty(groups, np.float32)

    for group in range(groups):
        light = measured = 0.0
        for cell in range(SKIP_CELLS, LEVEL_CELLS):
            light += np.float64(wall[group, cell])
            measured += np.float64(seen[group, cell])

        own[group] = np.float32(light) / np.float32(max(measured, 1.0))

    for group in range(groups):
        before = own[mirrored(group - 1, groups)]
        after = own[mirrored(group + 1, groups)]
        smooth[group] = np.float32(
            (np.float64(before) + np.float64(own[group]) + np.float64(after)) * _THIRD
        )
        largest = max(largest, smooth[group])

    least = np.float32(max(LEAST_LEVEL_SHARE * np.float64(largest), 1e-9))
    for group in range(groups):
        for cell in range(CELLS):
            seen[group, cell] *= np.float32(smooth[group] > least)
            share = seen[group, cell] / max(smooth[group], _LEAST_LEVEL)
            wall[group, cell] = min(wall[group, cell] * share, BRIGHTEST)


@compiled
def find_thickness(
    wall: Singles, seen: Singles, prior: Singles
) -> tuple[Singles, Flags, float]:
    """Return the thickness along the normal at each group, m, which groups show the
    boundary, and their share.

    `prior` (group, edge): gain by prior knowledge; a jump gains at most 1.
    """
    near, mean, bend, jump = _find_jumps(wall, seen)
    least = _standing_out(jump)
    path = best_path(_score_jumps(jump, least, prior), REACH_CELLS)
    groups = len(path)
    shown = 0
    testable = 0
    shows = np.empty(groups, np.bool_)
    edge = np.empty(groups, np.float32)
    weight = np.empty(groups, np.float32)

    for group in range(groups):
        size = jump[group, path[group]]
        first = max(path[group] - SKIP_EDGE - LINE_CELLS, 0)
        found = _cross(
            near[group],
            path[group],
            mean[group, first],
            bend[group, first],
            max(size, _ZERO),
        )
        measured = seen[group, min(path[group] + SKIP_EDGE, CELLS - 1)] > 0
        shows[group] = size > least[path[group]] and measured
        testable += measured
        shown += shows[group]
        weight[group] = np.float32(shows[group]) + _SEEN
        edge[group] = found * weight[group]

    thickness_m = mean_of_neighbours(edge, 2)
    weight = mean_of_neighbours(weight, 2)
    for group in range(groups):
        thickness_m[group] = thickness_m[group] / weight[group] * _CELL_M

    return thickness_m, shows, shown / max(1, testable)


@compiled
def _find_jumps(
    wall: Singles, seen: Singles
) -> tuple[Singles, Singles, Singles, Singles]:
    """Return means of neighbouring groups, the lines that start at each cell, and the
    jump at each edge between cells.

    Of the lines, mean and fall from their middle to the jump; (group, cell), the jump
    (group, CELLS + 1).
    """
    groups = len(wall)
    shape = wall.shape
    near = np.empty(shape, np.float32)
    pooled = np.empty(shape, np.float32)
    mean = np.empty(shape, np.float32)
    bend = np.empty(shape, np.float32)
    jump = np.zeros((groups, CELLS + 1), np.float32)

    for group in range(groups):
        before = mirrored(group - 1, groups)
        after = mirrored(group + 1, groups)

        for cell in range(CELLS):
            light = (
                np.float64(wall[before, cell])
                + np.float64(wall[group, cell])
                + np.float64(wall[after, cell])
            )
            share = np.float32(
                (seen[before, cell] + seen[group, cell] + seen[after, cell]) * _THIRD
            )
            near[group, cell] = np.float32(light * _THIRD)
            pooled[group, cell] = near[group, cell] / max(share, _SEEN)

        for cell in range(CELLS - LINE_CELLS + 1):
            middle = fall = _ZERO
            for step in range(LINE_CELLS):
                middle = multiply_add(_LINE_SHARE, pooled[group, cell + step], middle)
                fall = multiply_add(BEND[step], pooled[group, cell + step], fall)

            mean[group, cell] = middle
            bend[group, cell] = min(fall, _ZERO)

        for edge in range(FIRST_EDGE, AFTER_EDGE):
            line = edge - SKIP_EDGE - LINE_CELLS
            low = _ZERO

            for step in range(LOW_CELLS):
                low = multiply_add(
                    _LOW_SHARE, pooled[group, edge + SKIP_EDGE + step], low
                )

            deepest = edge + SKIP_EDGE + LOW_CELLS - 1
            share = np.float32(
                (seen[before, deepest] + seen[group, deepest] + seen[after, deepest])
                * _THIRD
            )
            if share > _MEASURED:
                above = max(bend[group, line] * BEND_TO_LOW + mean[group, line], _ZERO)
                jump[group, edge] = above - low

    return near, mean, bend, jump


@compiled
def _score_jumps(jump: Singles, least: Singles, prior: Singles) -> Singles:
    """Return a path's gain at each edge, (group, edge), where jumps over `least`
    (edge,) stand out.
    """
    groups, edges = jump.shape
    own = np.empty(edges, np.float32)
    upper = np.empty(edges, np.float32)
    score = np.empty(jump.shape, np.float32)

    for group in range(groups):
        for edge in range(edges):
            over = max(jump[group, edge] - least[edge], _ZERO)
            own[edge] = over / (over + HALF_JUMP)

        upper[:] = _ZERO
        for above in range(NEAR_CELLS, FAR_CELLS + 1):
            for edge in range(edges - above):
                upper[edge + above] = max(upper[edge + above], own[edge])

        for edge in range(edges):
            score[group, edge] = (
                own[edge]
                - ROW_COST[edge]
                - upper[edge] * UPPER_COST
                + prior[group, edge]
            )

    return score


@compiled
def _standing_out(jump: Singles) -> Singles:
    """Return the jump that stands out of speckle and texture, (edge,).

    The wall's end is rare: less than the median; and its jumps at one depth hardly
    differ from place to place.
    """
    groups, edges = jump.shape
    sizes = np.empty(jump.size, np.float32)
    number = 0
    spread = np.empty(edges, np.float32)

    for group in range(groups):
        for edge in range(FIRST_EDGE, AFTER_EDGE, 2):
            sizes[number] = abs(jump[group, edge])
            number += sizes[number] > 0

    typical = np.float64(size_at(sizes[:number], number // 2)) if number else 0.0
    half_share = np.float64(np.float32(0.5 / (groups - POOLED)))

    for edge in range(edges):
        total = 0.0
        for group in range(groups - POOLED):
            change = jump[group + POOLED, edge] - jump[group, edge]
            total += half_share * np.float64(change * change)

        spread[edge] = np.sqrt(np.float32(total))

    least = mean_of_neighbours(spread, SPREAD_REACH)
    smallest = np.float32(max(LEAST_JUMP, SURE_JUMP * typical))
    for edge in range(edges):
        least[edge] = max(least[edge] * SURE_SPREAD, smallest)

    return least


@compiled
def _cross(
    near: Singles, path: int, mean: np.float32, bend: np.float32, jump: np.float32
) -> np.float32:
    """Return the edge near a path, in cells, that best parts light above and below a
    jump's middle.
    """
    path = min(max(path, REFINE_CELLS), CELLS - REFINE_CELLS)
    limit = max(jump, _SEEN)
    middle = mean - jump / np.float32(2.0)
    best = 0
    total = _ZERO
    largest = _ZERO

    for step in range(2 * REFINE_CELLS):
        above = near[path + step - REFINE_CELLS] - bend * FROM_MIDDLE[step] - middle
        total += min(max(above, -limit), limit)
        if total > largest:
            best = step + 1
            largest = total

    return np.float32(path + best) - np.float32(REFINE_CELLS)
