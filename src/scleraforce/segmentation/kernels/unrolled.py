"""The wall unrolled along its surface: `below_surface.rows_per_metre` and `inner.unroll` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation import inner
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.inner import CELLS, GROUP
from scleraforce.segmentation.kernels.multiply_add import multiply_add
from scleraforce.segmentation.kernels.sampling import mirrored, sample_row

Counts = NDArray[np.uint16]
Indices = NDArray[np.uintp]

_THICKNESS_M = inner.THICKNESS_M
_LEVEL_FIRST, _LEVEL_AFTER = inner.SKIP_CELLS, inner.LEVEL_CELLS
_STEEPEST, _BRIGHTEST = np.float32(inner.STEEPEST**2), np.float32(inner.BRIGHTEST)
_LEAST_LEVEL_SHARE, _LEAST_LEVEL = inner.LEAST_LEVEL_SHARE, np.float32(1e-6)
_ONE, _ZERO, _THIRD = np.float32(1.0), np.float32(0.0), 1.0 / 3.0


@compiled
def stretch(row: Float, reach: int, rise: float, depth_m: float, along_rows: Float) -> None:
    """Write the rows along a column for 1 m of thickness along a surface's normal.

    Args:
        row: of the surface, no NaN.
        reach: points on each side that tell its slope.
        rise: slope, metres over metres, of one row between them.
        depth_m: of a pixel in tissue.
        along_rows: the result.
    """
    points = len(row)
    for at in range(points):
        first, last = at - reach, at + reach
        # Mirrored in its end points, a slope goes on beyond them.
        before = row[first] if first >= 0 else np.float32(2 * row[0] - row[-first])
        after = row[last] if last < points else np.float32(2 * row[points - 1] - row[2 * (points - 1) - last])
        slope = (after - before) * np.float32(rise)
        along_rows[at] = np.sqrt(min(slope * slope, _STEEPEST) + _ONE) / np.float32(depth_m)


@compiled
def unroll(
    frame: Counts, first: int, floor: int, near: Indices, far: Indices, across: Float, row: Float,
    there: NDArray[np.bool_], along_rows: Float, places: Float, line: Float, upper: Indices, lower: Indices,
    down: Float, level: Float, wall: Float, seen: Float,
) -> None:  # fmt: skip
    """Write the wall as (group, cell), surface level 1 and floor 0, and where it is measured (1 or 0).

    Args:
        frame: counts, shape (row, column), as of `sample_row`, like those that are not named here.
        first: column.
        floor: count of its noise floor.
        near: columns.
        far: columns.
        across: shares.
        row: of the surface, (point,).
        there: whether there is a surface.
        along_rows: of `stretch`.
        places: scratch, (point,).
        line: the same.
        upper: scratch.
        lower: scratch.
        down: scratch.
        level: scratch, (2, group).
        wall: the first result.
        seen: the second one.
    """
    _measure(np.float32(len(frame) - 1), row, there, along_rows, seen)
    for cell in range(CELLS):
        for at in range(len(row)):
            places[at] = multiply_add(_THICKNESS_M[cell], along_rows[at], row[at])
        sample_row(frame, first, near, far, across, places, upper, lower, down, line)
        for group in range(len(wall)):
            total = _ZERO
            for at in range(GROUP * group, GROUP * group + GROUP):
                total += line[at]
            wall[group, cell] = max(total * np.float32(1.0 / GROUP) - np.float32(floor), _ZERO) * seen[group, cell]
    _level_out(wall, seen, level)


@compiled
def _measure(last_row: np.float32, row: Float, there: NDArray[np.bool_], along_rows: Float, seen: Float) -> None:
    """Write 1 in the cells above the deepest thickness at the outer points of a group, else 0."""
    for group in range(len(seen)):
        first, last = GROUP * group, GROUP * group + GROUP - 1
        shallower = min(
            (last_row - row[first]) / along_rows[first] * np.float32(there[first]),
            (last_row - row[last]) / along_rows[last] * np.float32(there[last]),
        )
        for cell in range(CELLS):
            seen[group, cell] = np.float32(shallower >= _THICKNESS_M[cell])


@compiled
def _level_out(wall: Float, seen: Float, level: Float) -> None:
    """Divide each group by its own level near the surface; where that is dark, nothing is measured."""
    groups = len(wall)
    own, smooth = level[0], level[1]
    for group in range(groups):
        light = measured = 0.0
        for cell in range(_LEVEL_FIRST, _LEVEL_AFTER):
            light += np.float64(wall[group, cell])
            measured += np.float64(seen[group, cell])
        own[group] = np.float32(light) / np.float32(max(measured, 1.0))
    largest = _ZERO
    for group in range(groups):
        before, after = own[mirrored(group - 1, groups)], own[mirrored(group + 1, groups)]
        smooth[group] = np.float32((np.float64(before) + np.float64(own[group]) + np.float64(after)) * _THIRD)
        largest = max(largest, smooth[group])
    least = np.float32(max(_LEAST_LEVEL_SHARE * np.float64(largest), 1e-9))
    for group in range(groups):
        for cell in range(CELLS):
            seen[group, cell] *= np.float32(smooth[group] > least)
            share = seen[group, cell] / max(smooth[group], _LEAST_LEVEL)
            wall[group, cell] = min(wall[group, cell] * share, _BRIGHTEST)
