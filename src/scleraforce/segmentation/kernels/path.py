"""The best path through a map of scores: `segmentation.path` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.path import MARGIN


@compiled
def best_rows(score_cr: Float, path: NDArray[np.int64]) -> None:
    """Write the best row of each column; the first one of several."""
    for column in range(len(score_cr)):
        best = 0
        for row in range(1, score_cr.shape[1]):
            if score_cr[column, row] > score_cr[column, best]:
                best = row
        path[column] = best


@compiled
def is_path(path: NDArray[np.int64], reach: int) -> bool:
    """Return whether no step is larger than `reach`."""
    largest = 0
    for column in range(1, len(path)):
        largest = max(largest, abs(path[column] - path[column - 1]))
    return largest <= reach


@compiled
def find_path(score_cr: Float, reach: int, path: NDArray[np.int64], downwards: Float, upwards: Float) -> None:
    """Write the path of `path.best_path`; both sums of scores, (column, row), are scratch."""
    best_rows(score_cr, path)
    first, last = -1, -1
    for column in range(1, len(path)):
        if abs(path[column] - path[column - 1]) > reach:
            first, last = (column - 1 if first < 0 else first), column - 1
    if first < 0:
        return
    start, stop = max(0, first - MARGIN), min(len(path), last + 2 + MARGIN)
    _search(score_cr[start:stop], reach, path[start:stop], downwards, upwards)
    if not is_path(path, reach):
        _search(score_cr, reach, path, downwards, upwards)


@compiled
def _search(score_cr: Float, reach: int, path: NDArray[np.int64], before: Float, after: Float) -> None:
    """Write the rows with the largest sum of what leads there from both sides: see `path.best_path`."""
    columns, rows = score_cr.shape
    before[0] = score_cr[0]
    after[columns - 1] = score_cr[columns - 1]
    for column in range(1, columns):
        back = columns - 1 - column
        _add_best(before[column - 1], score_cr[column], reach, before[column])
        _add_best(after[back + 1], score_cr[back], reach, after[back])
    for column in range(columns):
        best, largest = 0, np.float32(-np.inf)
        for row in range(rows):
            through = before[column, row] + after[column, row] - score_cr[column, row]
            if through > largest:
                best, largest = row, through
        path[column] = best


@compiled
def _add_best(sums: Float, score: Float, reach: int, to: Float) -> None:
    """Write a column's scores and for each the largest of the sums that lie so near."""
    rows = len(score)
    for row in range(rows):
        to[row] = sums[row]
    for step in range(1, min(reach, rows - 1) + 1):
        for row in range(rows - step):
            to[row] = max(to[row], sums[row + step])
        for row in range(rows - step):
            to[row + step] = max(to[row + step], sums[row])
    for row in range(rows):
        to[row] += score[row]
