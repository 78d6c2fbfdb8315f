"""The grid of bounded size that a frame is averaged into, and which of its columns are imaged.

Scanners sample a reflection with a few pixels, whatever their scale: a line is thin in pixels, tissue is thick in
pixels and in metres. Lengths below are therefore given as pixels with a bound in metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Counts, Flags
from scleraforce.recording.pixels import Pixels, PixelScale

Float = NDArray[np.float32]

MAX_COLUMNS = 192  # of the grid: the frame is halved until it has fewer
MAX_ROWS = 384
LEAST_SHAPE = 16  # rows and columns of a frame


@dataclass(frozen=True)
class GridSize:
    """Cells of a grid, and the frame's pixels in each; `scale` is the size of a cell."""

    rows: int
    columns: int
    step_rows: int
    step_columns: int
    scale: PixelScale


@dataclass(frozen=True, eq=False)
class Grid:
    """A frame averaged into cells: `cells` (row, column) are counts, `floor` is the count of the noise."""

    cells: Pixels
    floor: float
    size: GridSize


def grid_size(rows: int, columns: int, scale: PixelScale) -> GridSize:
    """Return the size of the grid of a frame: it is halved until it has at most 191 columns and 383 rows."""
    step_rows = step_columns = 1
    while rows >= MAX_ROWS:
        rows, step_rows = rows // 2, 2 * step_rows
    while columns >= MAX_COLUMNS:
        columns, step_columns = columns // 2, 2 * step_columns
    cell = PixelScale(
        lateral_m=scale.lateral_m * step_columns,
        depth_m=scale.depth_m * step_rows,
        refractive_index=scale.refractive_index,
    )
    return GridSize(rows, columns, step_rows, step_columns, cell)


def counts_of(frame: Pixels) -> Counts:
    """Return a frame as the loops take it: one type for all, compiled once."""
    counts = np.ascontiguousarray(frame, np.uint16).view()
    counts.flags.writeable = False
    return counts


def imaged_part(frame: Pixels, left: int, hidden: Flags) -> Pixels:
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
