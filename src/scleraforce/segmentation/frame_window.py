"""The same window of every raw frame, whatever its size: cells of a fixed size in metres, not in pixels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.reduced import reduced_frame
from scleraforce.study import RawReaderStudy

__all__ = ["FrameWindow"]


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
        rows, columns = frame.shape
        along = _shares(columns, scale.lateral_m, self.columns, self.column_m, -0.5 * self.columns * self.column_m)
        down = _shares(rows, scale.depth_m, self.rows, self.row_m, -0.5 * rows * scale.depth_m)
        means: Float = down @ frame.astype(np.float32) @ along.T
        return means

    def reduced(self, frame: Pixels, scale: PixelScale) -> Float:
        """Return the cells of a frame as a network sees them, (row, column); see `levels`."""
        return self.levels(self.means(frame, scale))

    def levels(self, means: Float) -> Float:
        """Return mean counts of cells with the noise at 0 and bright tissue at 1 (`reduced_frame`)."""
        return reduced_frame(means, self.rows, self.columns)  # type: ignore[arg-type]  # means of counts


def _shares(pixels: int, pixel_m: float, cells: int, cell_m: float, first_m: float) -> Float:
    """Return which share each pixel has in each cell (cell, pixel); all 0 in cells that pixels do not reach.

    Args:
        pixels: of the frame, evenly about 0.
        pixel_m: size of one.
        cells: of the window.
        cell_m: size of one.
        first_m: where the first cell begins, m from the frame's middle.
    """
    pixel_edges = (np.arange(pixels + 1) - 0.5 * pixels) * pixel_m
    cell_edges = first_m + np.arange(cells + 1)[:, None] * cell_m
    covered = np.clip(pixel_edges, cell_edges[:-1], cell_edges[1:])
    part_m = np.diff(covered, axis=1)
    shares: Float = (part_m / np.maximum(part_m.sum(axis=1, keepdims=True), 1e-15)).astype(np.float32)
    return shares
