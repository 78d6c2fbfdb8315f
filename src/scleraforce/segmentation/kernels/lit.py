"""Which columns of a frame are imaged: `imaged.lit_columns` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.imaged import LIT_ROWS, LIT_SHARE

Counts = NDArray[np.uint16]


@compiled
def find_lit(frame: Counts, brightest: Counts, dark: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Write which columns are black.

    Args:
        frame: counts, shape (row, column).
        brightest: scratch, (column,).
        dark: the result.

    Returns:
        The first column that is not, the one after the last such, how many are not, and the largest count seen.
    """
    columns = frame.shape[1]
    for column in range(columns):
        brightest[column] = frame[0, column]
    for row in range(LIT_ROWS, frame.shape[0], LIT_ROWS):
        line = frame[row]
        for column in range(columns):
            brightest[column] = max(brightest[column], line[column])
    largest = 0
    for column in range(columns):
        largest = max(largest, np.int64(brightest[column]))
    black, left, after, lit = int(LIT_SHARE * largest), 0, 0, 0
    for column in range(columns):
        dark[column] = brightest[column] <= black
        if not dark[column]:
            left, after, lit = (left if lit else column), column + 1, lit + 1
    return left, after, lit, largest
