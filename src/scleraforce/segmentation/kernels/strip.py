"""The surface on the full frame: `surface.refine_surface` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.kernels.sampling import mirrored, sample_row
from scleraforce.segmentation.kernels.windows import largest_of_rows, smallest_of_rows
from scleraforce.segmentation.surface import SMOOTHED

Counts = NDArray[np.uint16]
Indices = NDArray[np.uintp]
Double = NDArray[np.float64]

_NINTH = 1.0 / 9.0
_ONE_HALF = np.float32(0.5)


@compiled
def start_rows(coarse: Float, place: NDArray[np.int64], weight: Float, rows: int, start: Float) -> None:
    """Write a coarse curve at the fine columns: of each, the two points that it lies between, and their weights."""
    last = np.float32(rows - 1.0)
    for at in range(len(start)):
        one = np.float64(weight[at, 0]) * np.float64(coarse[place[at, 0]])
        other = np.float64(weight[at, 1]) * np.float64(coarse[place[at, 1]])
        start[at] = min(max(np.float32(one + other), np.float32(0.0)), last)


@compiled
def sample_strip(
    frame: Counts, first: int, near: Indices, far: Indices, across: Float, start: Float, row: Float, upper: Indices,
    lower: Indices, down: Float, raw: Float,
) -> float:  # fmt: skip
    """Write the light in a strip about a curve, (row * column,), and return the noise of a pixel above it.

    Args:
        frame: as of `sample_row`, like those that are not named here.
        first: column.
        near: columns.
        far: columns.
        across: shares.
        start: rows of the strip's middle, (column,).
        row: scratch, (column,).
        upper: scratch.
        lower: scratch.
        down: scratch.
        raw: the light.
    """
    columns = len(start)
    half = len(raw) // columns // 2
    for step in range(2 * half):
        for at in range(columns):
            row[at] = np.float32(step - half) + _ONE_HALF + start[at]
        light = raw[step * columns : (step + 1) * columns]
        sample_row(frame, first, near, far, across, row, upper, lower, down, light)
    number = (half - 2) * columns
    total = squares = 0
    for at in range(number):
        count = np.int64(raw[at])
        total += count
        squares += count * count
    mean = total / number
    return np.sqrt(max(squares / number - mean * mean, 0.0))


@compiled
def fit_edges(
    raw: Float, thin: int, start: Float, strip: Float, other: Float, total: Double, middle: Double, best: Double,
    found: Float, contrast: Float,
) -> None:  # fmt: skip
    """Write the rows of the best two-level fit along each column of a strip, and by how much it is brighter below.

    Args:
        raw: light in the strip, (row * column,).
        thin: rows; what is thinner is removed.
        start: rows of the strip's middle.
        strip: scratch, (row * column,).
        other: the same.
        total: scratch, (column,).
        middle: the same.
        best: the same.
        found: the rows.
        contrast: level below less that above.
    """
    _smooth_and_open(raw, len(start), thin, strip, other)
    columns = len(start)
    rows = len(strip) // columns
    half, end = rows // 2, rows // 2 - 2
    above, below = total, best
    for at in range(columns):
        above[at] = below[at] = 0.0
    for row in range(end):
        line, other_line = strip[row * columns :], strip[(rows - 1 - row) * columns :]
        for at in range(columns):
            above[at] += np.float64(line[at])
            below[at] += np.float64(other_line[at])
    for at in range(columns):
        middle[at] = (above[at] + below[at]) / (2 * end)
        contrast[at] = np.float32((below[at] - above[at]) / end)
        total[at] = best[at] = 0.0
        found[at] = 0.0
    for row in range(rows):
        line = strip[row * columns :]
        for at in range(columns):
            total[at] += np.float64(line[at]) - middle[at]
            if total[at] < best[at]:
                best[at] = total[at]
                found[at] = np.float32(row + 1)
    for at in range(columns):
        found[at] = start[at] + found[at] - np.float32(half)


@compiled
def _smooth_and_open(raw: Float, columns: int, thin: int, strip: Float, other: Float) -> None:
    """Write the mean of 3 x 3 neighbours, opened along the columns, into `strip`."""
    rows = len(raw) // columns
    for row in range(rows):
        upper, lower = raw[mirrored(row - 1, rows) * columns :], raw[mirrored(row + 1, rows) * columns :]
        line, three, mean = raw[row * columns :], other[row * columns :], strip[row * columns :]
        for at in range(columns):
            three[at] = upper[at] + line[at] + lower[at]  # counts: no sum is rounded
        for at in range(1, columns - 1):
            mean[at] = np.float32(np.float64(three[at - 1] + three[at] + three[at + 1]) * _NINTH)
        mean[0] = np.float32(np.float64(three[0] + three[1] + three[1]) * _NINTH)
        mean[columns - 1] = np.float32(
            np.float64(three[columns - 1] + three[columns - 2] + three[columns - 2]) * _NINTH
        )
    smallest_of_rows(strip, rows * columns, columns, thin, other)
    largest_of_rows(other, rows * columns, columns, thin, strip)


@compiled
def smooth_surface(found: Float, longer: Float, median: Float) -> None:
    """Take a median and a mean over five points of a surface, a slope going on beyond its ends."""
    number = len(found)
    if number < SMOOTHED:
        return
    for step in range(4):
        longer[step] = 2 * found[0] - found[4 - step]
        longer[number + 4 + step] = 2 * found[number - 1] - found[number - 2 - step]
    for at in range(number):
        longer[at + 4] = found[at]
    for at in range(2, number + 6):
        median[at] = _median_of_five(longer[at - 2 : at + 3])
    for at in range(number):
        total = 0.0
        for step in range(2, 7):
            total += np.float64(median[at + step])
        found[at] = np.float32(total * 0.2)


@compiled
def _median_of_five(values: Float) -> np.float32:
    """Return the third of five: of the lower of the larger ones and the larger of the lower ones, and the fifth."""
    a, b, c, d, e = values[0], values[1], values[2], values[3], values[4]
    low = max(min(a, b), min(c, d))  # the smallest of the four is not it
    high = min(max(a, b), max(c, d))  # nor is the largest
    return max(min(low, high), min(max(low, high), e))
