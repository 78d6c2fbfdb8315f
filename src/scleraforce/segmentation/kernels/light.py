"""Raw frame to grid: its cells, their noise floor, and whether something stands out at the top edge."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import BLACK_PART, FLOOR_SHARE, MAX_COLUMNS, MAX_ROWS, Float
from scleraforce.segmentation.kernels.ranks import nth, nth_count
from scleraforce.segmentation.needle_edges import STANDS_OUT

Counts = NDArray[np.uint16]

_STANDS_OUT, _LEAST_SPREAD = np.float32(STANDS_OUT), np.float32(1e-3)


@compiled
def grid_cells(frame: Counts, left: int, width: int, eight_bits: bool, halves: Counts, others: Counts) -> Counts:
    """Return a frame's columns, averaged into cells as `grid.make_grid` does, at the start of one of two arrays.

    Args:
        frame: counts, shape (row, column).
        left: first column.
        width: columns.
        eight_bits: whether the counts came as bytes, of which OpenCV rounds a half up, not to the even number.
        halves: as many rows and columns as the frame has after one halving, at least.
        others: the same.
    """
    rows, columns = _halve(frame, left, frame.shape[0], width, eight_bits, halves)
    while rows >= MAX_ROWS or columns >= MAX_COLUMNS:
        rows, columns = _halve(halves, 0, rows, columns, eight_bits, others)
        halves, others = others, halves
    return halves


@compiled
def _halve(frame: Counts, left: int, rows: int, columns: int, eight_bits: bool, to: Counts) -> tuple[int, int]:
    """Write the means of neighbours and return how many rows and columns these are; an odd last one is dropped."""
    across, down = columns >= MAX_COLUMNS, rows >= MAX_ROWS
    rows, columns = (rows // 2 if down else rows), (columns // 2 if across else columns)
    for row in range(rows):
        half = to[row]
        upper = frame[2 * row if down else row, left:]
        lower = frame[2 * row + 1 if down else row, left:]
        if across and down:
            for at in range(columns):
                above = np.int32(upper[2 * at]) + np.int32(upper[2 * at + 1])
                below = np.int32(lower[2 * at]) + np.int32(lower[2 * at + 1])
                half[at] = (above + below + 2) >> 2
        elif across:
            for at in range(columns):
                half[at] = _mean_of_two(np.int32(upper[2 * at]), np.int32(upper[2 * at + 1]), eight_bits)
        else:
            for at in range(columns):  # of a row and itself where it is not halved at all
                half[at] = _mean_of_two(np.int32(upper[at]), np.int32(lower[at]), eight_bits)
    return rows, columns


@compiled
def _mean_of_two(one: int, other: int, eight_bits: bool) -> int:
    both = one + other
    half = both >> 1
    return half + (both & 1 & (half | np.int32(eight_bits)))


@compiled
def noise_floor(cells: Counts, rows: int, columns: int, sample: Counts, bins: NDArray[np.int64]) -> int:
    """Return the count that a fifth of so many rows and columns of cells, of those that are not black, lie below."""
    brightest = 0
    for row in range(0, rows, 8):
        for column in range(0, columns, 2):
            brightest = max(brightest, np.int64(cells[row, column]))
    black, lit = brightest // BLACK_PART, 0
    for row in range(0, rows, 8):
        for column in range(0, columns, 2):
            sample[lit] = cells[row, column]
            lit += cells[row, column] > black
    return nth_count(sample, lit, int(FLOOR_SHARE * lit), bins) if lit else 0


@compiled
def stands_out(cells: Counts, rows: int, columns: int, total: Float, ordered: Float) -> bool:
    """Return whether a column is brighter in the uppermost rows than columns there are: see `needle_edges`."""
    for column in range(columns):
        total[column] = 0.0
    for row in range(rows):
        for column in range(columns):
            total[column] += np.float32(cells[row, column])
    largest = total[0]
    for column in range(columns):
        ordered[column] = total[column]
        largest = max(largest, total[column])
    middle = nth(ordered, columns, columns // 2)
    low = nth(ordered, columns, columns // 6)
    return largest > middle + _STANDS_OUT * max(middle - low, _LEAST_SPREAD * middle)
