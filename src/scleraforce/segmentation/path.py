"""The best path through a map of scores, one row for each column: exact dynamic programming."""

from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.segmentation.grid import Float

MARGIN = 1  # columns that are searched on each side of steps that are too large


def best_path(score_cr: Float, reach: int) -> NDArray[np.intp]:
    """Return the rows of the path with the largest sum of scores whose steps are at most `reach` rows.

    Mostly the best rows of the columns make such a path already. Where they do not, the part from the first step that
    is too large to the last one is searched; if its ends fit to the rest, no path can be better, as each part is at its
    largest sum. If they do not, all of it is searched.

    Args:
        score_cr: scores, shape (column, row). Give each row its own small bonus: the path is unique only if no two
            paths have the same sum.
        reach: largest step between neighbouring columns, rows.

    Returns:
        The row in each column, shape (column,).

    >>> best_path(np.array([[0, 9, 0, 0], [0, 1, 0, 5], [0, 4, 0, 0]], dtype=np.float32), reach=1)
    array([1, 1, 1])
    """
    path: NDArray[np.intp] = score_cr.argmax(axis=1)
    large = _too_large(path, reach)
    if not len(large):
        return path
    part = slice(max(0, large[0] - MARGIN), large[-1] + 2 + MARGIN)
    path[part] = _searched(score_cr[part], reach)
    return path if not len(_too_large(path, reach)) else _searched(score_cr, reach)


def _too_large(path: NDArray[np.intp], reach: int) -> NDArray[np.intp]:
    """Return the places of steps that are larger than `reach`."""
    places: NDArray[np.intp] = (np.abs(path[1:] - path[:-1]) > reach).nonzero()[0]
    return places


def _searched(score_cr: Float, reach: int) -> NDArray[np.intp]:
    """Return the best path, by dynamic programming.

    Both directions are run at once (rows of one array); their sum is, for each column and row, the best score of all
    paths through there (max-marginals of a Markov chain: Bishop, Pattern Recognition and Machine Learning, sec. 8.4.5),
    so the path needs no backtracking. OpenCV's dilation is the maximum over a window.
    """
    columns, rows = score_cr.shape
    total = np.empty((columns, 2, rows), dtype=np.float32)
    total[:, 0], total[:, 1] = score_cr, score_cr[::-1]
    window, moved = _window(reach), np.empty((2, rows), dtype=np.float32)
    dilate, add = cv2.dilate, np.add
    for before, after in pairwise(total):
        add(after, dilate(before, window, moved), after)
    through: Float = total[:, 0] + total[::-1, 1] - score_cr
    rows_c: NDArray[np.intp] = through.argmax(axis=1)
    return rows_c


@lru_cache(maxsize=16)
def _window(reach: int) -> NDArray[np.uint8]:
    return np.ones((1, 2 * reach + 1), dtype=np.uint8)
