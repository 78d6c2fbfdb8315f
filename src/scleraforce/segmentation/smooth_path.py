"""The best path through a map of scores whose steps cost: exact dynamic programming."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scleraforce.segmentation.grid import Float


def smooth_path(score_cr: Float, cost: Float) -> NDArray[np.intp]:
    """Return the rows of the path with the largest sum of scores less what its steps cost.

    Both directions are run at once, as in `path.best_path`. A step's best beginning is the upper envelope of lines that
    fall by its cost a row (Felzenszwalb and Huttenlocher 2012, Distance Transforms of Sampled Functions).

    Args:
        score_cr: scores, shape (column, row).
        cost: of a row's step between a column and the next, not negative, shape (column - 1,).

    Returns:
        The row in each column, shape (column,).

    >>> smooth_path(np.array([[0, 9, 0, 0], [0, 1, 0, 5], [0, 4, 0, 0]], dtype=np.float32), np.full(2, 3.0))
    array([1, 1, 1])
    """
    columns, rows = score_cr.shape
    total = np.empty((columns, 2, rows), dtype=np.float32)
    total[:, 0], total[:, 1] = score_cr, score_cr[::-1]
    fall = np.stack([cost, cost[::-1]], axis=1)[:, :, None].astype(np.float32) * np.arange(rows, dtype=np.float32)
    for (before, after), down in zip(pairwise(total), fall, strict=True):
        from_above = np.maximum.accumulate(before + down, axis=1)
        from_above -= down
        from_below = np.maximum.accumulate((before - down)[:, ::-1], axis=1)[:, ::-1]
        from_below += down
        after += np.maximum(from_above, from_below)  # a view of `total`
    through: Float = total[:, 0] + total[::-1, 1] - score_cr
    path: NDArray[np.intp] = through.argmax(axis=1)
    return path
