"""Which columns of a frame are imaged: black bands at its sides, and missing columns inside."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels

LEAST_SHAPE = 16  # rows and columns of a frame
LIT_ROWS = 4  # every fourth row tells whether a column is imaged
LIT_SHARE = 0.02  # of the frame's largest count: a column that never reaches it is black


def lit_columns(frame: Pixels) -> tuple[int, NDArray[np.bool_], int] | None:
    """Return the first imaged column, which are missing from it to the last imaged one, and the largest count seen.

    None: too few are imaged.
    """
    columns = frame[::LIT_ROWS].max(axis=0)  # an imaged column has light in all its rows
    brightest = int(columns.max())
    dark = columns <= int(LIT_SHARE * brightest)
    if len(dark) - np.count_nonzero(dark) < LEAST_SHAPE:
        return None
    left, right = int(dark.argmin()), len(dark) - int(dark[::-1].argmin())
    return left, dark[left:right], brightest


def imaged_part(frame: Pixels, left: int, hidden: NDArray[np.bool_]) -> Pixels:
    """Return the columns from `left` on, its `hidden` ones as the nearest that are not; neither end is hidden."""
    imaged = frame[:, left : left + len(hidden)]
    if not np.count_nonzero(hidden):
        return imaged
    filled = imaged.copy()
    change = np.flatnonzero(hidden[1:] != hidden[:-1]) + 1
    for start, end in zip(change[::2], change[1::2], strict=True):
        middle = (start + end + 1) // 2
        filled[:, start:middle] = imaged[:, start - 1 : start]
        filled[:, middle:end] = imaged[:, end : end + 1]
    return filled
