"""A raw frame as the wall finder sees it: reduced to few pixels, its noise at 0 and its bright tissue at 1."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.grid import Float

BLACK_SHARE = 2e-3  # of the brightest pixel: what is darker is not imaged
FLOOR_SHARE, BRIGHT_SHARE = 0.2, 0.99  # of the pixels that are not black: noise, and what lies below bright tissue
LEAST_LEVEL, LARGEST_LEVEL = -0.5, 1.5
LEAST_CONTRAST = 1e-6  # of the counts of bright tissue


def reduced_frame(frame: Pixels, rows: int, columns: int) -> Float:
    """Reduce a frame and scale its counts, shape (rows, columns); a frame without contrast is 0.

    Args:
        frame: counts, shape (row, column).
        rows: of the answer.
        columns: of the answer.
    """
    small = _resized(frame, rows, columns)
    lit = small[small > float(small.max()) * np.float32(BLACK_SHARE)]
    if not len(lit):
        return np.zeros((rows, columns), dtype=np.float32)
    low_nth, high_nth = (int(share * (len(lit) - 1)) for share in (FLOOR_SHARE, BRIGHT_SHARE))
    ordered = np.partition(lit, (low_nth, high_nth))
    low, high = float(ordered[low_nth]), float(ordered[high_nth])
    if high - low <= LEAST_CONTRAST * max(high, 1.0):
        return np.zeros((rows, columns), dtype=np.float32)
    scaled: Float = np.clip((small - np.float32(low)) / np.float32(high - low), LEAST_LEVEL, LARGEST_LEVEL)
    return scaled


def _resized(frame: Pixels, rows: int, columns: int) -> Float:
    """Return the means of a frame over so many rows and columns; halves first, which is many times quicker."""
    while frame.shape[0] >= 2 * rows and frame.shape[1] >= columns and not frame.shape[0] % 2:
        frame = cast(Pixels, cv2.resize(frame, (frame.shape[1], frame.shape[0] // 2), interpolation=cv2.INTER_LINEAR))
    while frame.shape[1] >= 2 * columns and frame.shape[0] >= rows and not frame.shape[1] % 2:
        frame = cast(Pixels, cv2.resize(frame, (frame.shape[1] // 2, frame.shape[0]), interpolation=cv2.INTER_LINEAR))
    smaller = frame.shape[0] >= rows and frame.shape[1] >= columns
    method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    resized: Float = cv2.resize(frame, (columns, rows), interpolation=method).astype(np.float32)
    return resized


def reduced_columns(columns: int, answers: int) -> NDArray[np.float64]:
    """Return the columns of a frame, as fractions, that `answers` evenly spaced columns stand for, shape (answers,).

    >>> reduced_columns(8, 4)
    array([0.5, 2.5, 4.5, 6.5])
    """
    at: NDArray[np.float64] = (np.arange(answers) + 0.5) * columns / answers - 0.5
    return at
