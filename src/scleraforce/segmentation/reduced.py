"""Raw frames as networks see them: reduced to few pixels, their noise at 0 and their bright tissue at 1."""

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Floats, Reals
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.grid import Float
from scleraforce.study import RawReaderStudy

BLACK_SHARE = 2e-3  # of the brightest pixel: what is darker is not imaged
FLOOR_SHARE, BRIGHT_SHARE = 0.2, 0.99  # of the pixels that are not black: noise, and what lies below bright tissue
LEAST_LEVEL, LARGEST_LEVEL = -0.5, 1.5
LEAST_CONTRAST = 1e-6  # of the counts of bright tissue


def reduced_frame(frame: Pixels, rows: int, columns: int) -> Float:
    """Reduce a frame and scale its counts, shape (rows, columns); a frame without contrast is 0."""
    small = _resized(frame, rows, columns)
    lit = small[small > float(small.max()) * np.float32(BLACK_SHARE)]
    if not len(lit):
        return np.zeros((rows, columns), dtype=np.float32)
    low_nth, high_nth = (int(share * (len(lit) - 1)) for share in (FLOOR_SHARE, BRIGHT_SHARE))
    ordered = np.partition(lit, (low_nth, high_nth))
    low, high = float(ordered[low_nth]), float(ordered[high_nth])
    if high - low <= LEAST_CONTRAST * max(high, 1.0):
        return np.zeros((rows, columns), dtype=np.float32)
    return np.clip((small - np.float32(low)) / np.float32(high - low), LEAST_LEVEL, LARGEST_LEVEL)


def _resized(frame: Pixels, rows: int, columns: int) -> Float:
    """Return the means of a frame in `rows` and `columns`; halves first, which is many times quicker."""
    while frame.shape[0] >= 2 * rows and frame.shape[1] >= columns and not frame.shape[0] % 2:
        frame = cast(Pixels, cv2.resize(frame, (frame.shape[1], frame.shape[0] // 2), interpolation=cv2.INTER_LINEAR))
    while frame.shape[1] >= 2 * columns and frame.shape[0] >= rows and not frame.shape[1] % 2:
        frame = cast(Pixels, cv2.resize(frame, (frame.shape[1] // 2, frame.shape[0]), interpolation=cv2.INTER_LINEAR))
    smaller = frame.shape[0] >= rows and frame.shape[1] >= columns
    method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return cv2.resize(frame, (columns, rows), interpolation=method).astype(np.float32)


def reduced_columns(columns: int, answers: int) -> Floats:
    """Return the columns of a frame, as fractions, of `answers` evenly spaced columns, shape (answers,).

    >>> reduced_columns(8, 4)
    array([0.5, 2.5, 4.5, 6.5])
    """
    return (np.arange(answers) + 0.5) * columns / answers - 0.5


@dataclass(frozen=True, kw_only=True)
class FrameWindow:
    """Cells of `row_m` x `column_m` about the frame's middle column, from its upper edge downwards."""

    rows: int
    columns: int
    row_m: float
    column_m: float

    @classmethod
    def of(cls, study: RawReaderStudy) -> "FrameWindow":
        """Return the window of a raw reader."""
        return cls(rows=study.rows, columns=study.columns, row_m=study.row_m, column_m=study.column_m)

    @property
    def laterals_m(self) -> Floats:
        """Centres of the columns, m from the middle, (column,)."""
        return np.asarray((np.arange(self.columns) + 0.5 - 0.5 * self.columns) * self.column_m)

    def means(self, frame: Pixels, scale: PixelScale) -> Float:
        """Return the mean count of each cell, (row, column); 0 where the frame does not reach.

        >>> window = FrameWindow(rows=2, columns=2, row_m=2e-6, column_m=1e-6)
        >>> frame = np.array([[1, 2, 3], [3, 4, 5]], dtype=np.uint16)
        >>> window.means(frame, PixelScale(lateral_m=1e-6, depth_m=1e-6))
        array([[2.5, 3.5],
               [0. , 0. ]], dtype=float32)
        """
        rows_at = np.arange(self.rows + 1) * (self.row_m / scale.depth_m)
        columns_at = 0.5 * frame.shape[1] + (np.arange(self.columns + 1) - 0.5 * self.columns) * (
            self.column_m / scale.lateral_m
        )
        return _means_between(columns_at, _means_between(rows_at, frame).T).T

    def reduced(self, frame: Pixels, scale: PixelScale) -> Float:
        """Return the cells of a frame as a network sees them, (row, column); see `levels`."""
        return self.levels(self.means(frame, scale))

    def levels(self, means: Float) -> Float:
        """Return mean counts of cells with the noise at 0 and bright tissue at 1 (`reduced_frame`)."""
        return reduced_frame(means, self.rows, self.columns)  # type: ignore[arg-type]  # means of counts


def _means_between(edges: Reals, values: NDArray[Any]) -> Float:
    """Return the means (cell, column) of rows (row, column) between increasing edges (cell + 1,), 0 beyond the rows."""
    inside = np.clip(edges, 0.0, len(values))
    whole = inside.astype(np.intp)
    padded = np.concatenate([values, np.zeros((1, values.shape[1]), dtype=values.dtype)]).astype(np.float32)
    sums = np.add.reduceat(padded, whole, axis=0)[:-1]
    sums[np.diff(whole) == 0] = 0.0
    part = (inside - whole).astype(np.float32)[:, None] * padded[whole]
    width = np.maximum(np.diff(inside), 1e-9).astype(np.float32)
    return ((sums + np.diff(part, axis=0)) / width[:, None]).astype(np.float32, copy=False)
