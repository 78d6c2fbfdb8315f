"""Curves at some columns taken to others: `columns.bridged` and `columns.at_columns` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float

Flags = NDArray[np.bool_]


@compiled
def bridge(row: Float, there: Flags, bridged: Float) -> None:
    """Write a curve with straight lines over what is not there; something is."""
    last = -1
    for at in range(len(row)):
        if there[at]:
            bridged[at] = row[at]
            first = last + 1
            for between in range(first, at):
                bridged[between] = straight_line(between, last, at, row[last], row[at]) if last >= 0 else row[at]
            last = at
    for after in range(last + 1, len(row)):
        bridged[after] = row[last]


@compiled
def at_every_column(
    column: Float, row: Float, there: Flags, nearest: NDArray[np.int64], everywhere: bool, to: NDArray[np.float64]
) -> None:
    """Write a curve at every column of a frame's imaged part; NaN where the nearest point is not there.

    Args:
        column: of the points, (point,), from the first column to the last one.
        row: of the curve.
        there: which points are; some are.
        nearest: point of each column.
        everywhere: whether each of those is there: those that are not do not count then either.
        to: the result, (column,).
    """
    after, points = 0, len(column)
    last = -1
    for at in range(len(to)):
        while after < points and (not (everywhere or there[after]) or column[after] <= at):
            last = after if everywhere or there[after] else last
            after += 1
        if not there[nearest[at]]:
            to[at] = np.nan
        elif last < 0:
            to[at] = row[after]
        elif after == points:
            to[at] = row[last]
        else:
            to[at] = straight_line(at, column[last], column[after], row[last], row[after])


@compiled
def straight_line(at: float, left: float, right: float, first: np.floating, last: np.floating) -> float:
    """Return the straight line between two points, in the order of operations of `np.interp`."""
    slope = (np.float64(last) - np.float64(first)) / (np.float64(right) - np.float64(left))
    return slope * (np.float64(at) - np.float64(left)) + np.float64(first)
