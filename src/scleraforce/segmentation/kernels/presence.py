"""Where a surface shows: `wall._present` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.kernels.ranks import nth

Flags = NDArray[np.bool_]


@compiled
def show_points(
    row: Float, contrast: Float, missing: Flags, column: Float, deepest: float, share: float, typical: float,
    widest: int, inside: Flags, present: Flags, values: Float,
) -> int:  # fmt: skip
    """Write which points of a surface show it, or lie in a gap so narrow that it goes on behind it.

    Args:
        row: of the surface.
        contrast: of it.
        missing: columns of the frame's imaged part that are missing.
        column: of the points in that part.
        deepest: a surface below this row has left the window.
        share: of the typical contrast: a point with less shows no surface.
        typical: share of the points that have less contrast than is typical.
        widest: gap that the surface goes on behind, points.
        inside: scratch, (point,).
        present: the result.
        values: scratch, (point,).

    Returns:
        How many.
    """
    points = len(row)
    for at in range(points):
        inside[at] = row[at] < np.float32(deepest)
        present[at] = inside[at] and not missing[int(column[at])]
    usual = quantile_of_chosen(contrast, present, typical, values)
    if np.isnan(usual):
        return 0
    least, number = np.float32(share * max(np.float64(usual), 1e-6)), 0
    for at in range(points):
        present[at] = present[at] and contrast[at] > least
        number += present[at]
    return number if number == points else _close_gaps(present, inside, widest)


@compiled
def _close_gaps(present: Flags, inside: Flags, widest: int) -> int:
    """Close the gaps that are at most `widest` points wide and lie (in part) inside; return how many are present."""
    last, number = -1, 0
    for at in range(len(present)):
        if present[at]:
            within = False
            for gap in range(last + 1, at):
                within = within or inside[gap]
            if last >= 0 and within and at - 1 - last <= widest:
                for gap in range(last + 1, at):
                    present[gap] = True
                    number += 1
            last = at
            number += 1
    return number


@compiled
def quantile_of_chosen(of: Float, chosen: Flags, share: float, values: Float) -> np.float32:
    """Return the value that `share` of the chosen ones lie below, NaN of none; `values` is scratch."""
    number = 0
    for at in range(len(of)):
        if chosen[at]:
            values[number] = of[at]
            number += 1
    return nth(values, number, int(share * number)) if number else np.float32(np.nan)
