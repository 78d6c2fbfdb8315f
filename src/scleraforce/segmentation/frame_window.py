"""The same window of every raw frame, whatever its size: cells of a fixed size in metres, not in pixels."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.reduced import reduced_frame
from scleraforce.study import RawReaderStudy


@dataclass(frozen=True, kw_only=True)
class FrameWindow:
    """Cells of `row_m` x `column_m` about the frame's middle column, from its upper edge downwards."""

    rows: int
    columns: int
    row_m: float
    column_m: float

    @classmethod
    def of(cls, study: RawReaderStudy) -> "FrameWindow":
        """Return what a raw reader sees."""
        return cls(rows=study.rows, columns=study.columns, row_m=study.row_m, column_m=study.column_m)

    @property
    def laterals_m(self) -> NDArray[np.float64]:
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


def _means_between(edges: NDArray[np.floating], values: NDArray[Any]) -> Float:
    """Return the means of rows between edges (cell, column), 0 where there are no rows.

    Args:
        edges: of the cells, counted in rows (cell + 1,), increasing.
        values: (row, column).
    """
    inside = np.clip(edges, 0.0, len(values))
    whole = inside.astype(np.intp)
    padded = np.concatenate([values, np.zeros((1, values.shape[1]), dtype=values.dtype)]).astype(np.float32)
    sums = np.add.reduceat(padded, whole, axis=0)[:-1]
    sums[np.diff(whole) == 0] = 0.0
    part = (inside - whole).astype(np.float32)[:, None] * padded[whole]
    width = np.maximum(np.diff(inside), 1e-9).astype(np.float32)
    means: Float = ((sums + np.diff(part, axis=0)) / width[:, None]).astype(np.float32, copy=False)
    return means
