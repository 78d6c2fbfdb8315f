"""The light of a frame: its imaged columns, its grid, and linear displays made like
logarithmic ones.

The wall is looked for in frames of a logarithmic display. Scanners sample a reflection
with a few pixels, whatever their scale: a line is thin in pixels, tissue is thick in
pixels and in metres. So lengths are pixels with a bound in metres.

Two intensities of fully developed speckle, of the same mean and far enough apart, are
exponential and independent (Goodman, Speckle Phenomena in Optics, ch. 3): the share of
one in their sum is uniform, whatever the mean and the sum. So the median of |a - b| /
(a + b), over the brightest pairs of counts, is 1/2 where counts grow with the
intensity, and (sqrt(3) - 1)/(sqrt(3) + 1) = 0.27 where they grow with its root,
whatever the gain. On a logarithmic display it is 2.4 dB over the level of bright tissue
above black, 0.04 to 0.12 on drawn ones.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from scleraforce.base.arrays import Counts, Flags, Integers
from scleraforce.base.compiled_loops import compiled
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.shared_loops import count_at, size_at

Lit = tuple[int, int, int, int, Flags, float]

MAX_COLUMNS = 192  # of the grid: the frame is halved until it has fewer
MAX_ROWS = 384
LEAST_SHAPE = 16  # rows and columns of a frame
BLACK_PART = 1000  # th part of the brightest cell: less is black
# share of the pixels that are not black which lies at or below the noise floor
FLOOR_SHARE = 0.2
LIT_ROWS = 4  # every fourth row tells whether a column is imaged
# share of the frame's largest count: a column that never reaches it is black
LIT_SHARE = 0.02
# how much the grey of margins differs, as a share of the largest count; 2 of 255
PAGE_SPREAD = 0.008
# contrast of pairs: midway between the root and the intensity itself
NOT_LOGARITHMIC = 0.38
PAIR_COLUMNS = 8  # of a pair, from one count to the other
LOOKED_AT_ROWS = 24  # of a frame, spread over it
DIMMER = 0.9  # of the pairs are left out: noise about the tissue
LEAST_PAIRS = 200
# times the spread of the columns' means in the uppermost rows: a needle may begin
STANDS_OUT = np.float32(5.0)
_LEAST_SPREAD = np.float32(1e-3)


@dataclass(frozen=True)
class GridSize:
    """Cells of a grid, and the frame's pixels in each; `scale` is the size of a
    cell.
    """

    rows: int
    columns: int
    step_rows: int
    step_columns: int
    scale: PixelScale


def grid_size(rows: int, columns: int, scale: PixelScale) -> GridSize:
    """Return the size of the grid of a frame: it is halved until it has at most 191
    columns and 383 rows.
    """
    step_rows = step_columns = 1
    while rows >= MAX_ROWS:
        rows = rows // 2
        step_rows = 2 * step_rows

    while columns >= MAX_COLUMNS:
        columns = columns // 2
        step_columns = 2 * step_columns

    lateral_m = scale.lateral_m * step_columns
    depth_m = scale.depth_m * step_rows
    cell = PixelScale(
        lateral_m=lateral_m, depth_m=depth_m, refractive_index=scale.refractive_index
    )

    return GridSize(rows, columns, step_rows, step_columns, cell)


def counts_of(frame: Pixels) -> Counts:
    """Return a frame as the loops take it: one type for all, compiled once."""
    counts = np.ascontiguousarray(frame, np.uint16).view()
    counts.flags.writeable = False
    return counts


def without_page(frame: Pixels) -> Pixels:
    """Return a frame with a page's margins black: edges of one grey, brighter than most
    pixels; itself without any.
    """
    corners = [
        int(frame[row, column]) for row, column in ((0, 0), (0, -1), (-1, -1), (-1, 0))
    ]
    least = PAGE_SPREAD * max(corners)
    if all(
        abs(one - other) > least or not one
        for one, other in zip(corners, corners[1:] + corners[:1], strict=True)
    ):
        return frame

    least = PAGE_SPREAD * int(frame.max())
    dark = float(np.median(frame))
    shown = frame.copy()

    for flip in (slice(None), slice(None, None, -1)):
        for lines, to in ((frame[flip], shown[flip]), (frame.T[flip], shown.T[flip])):
            grey = int(lines[0, 0])
            alike = np.abs(lines.astype(np.intp) - grey).max(axis=1) <= least
            if grey - dark > least and not alike.all():
                to[: int(alike.argmin())] = 0

    return shown


def as_logarithmic(frame: Pixels) -> Pixels:
    """Return a frame as a logarithmic display would show it, as 16 bits; unchanged if
    it comes from one.
    """
    return (
        _logarithms(int(np.iinfo(frame.dtype).max))[frame]
        if pair_contrast(frame) > NOT_LOGARITHMIC
        else frame
    )


def pair_contrast(frame: Pixels) -> float:
    """Return how much the brightest tenth of pairs differ, as a share of their sums
    (median): 0 where few are lit. Pixels of the largest count are left out.
    """
    return find_lit(counts_of(frame))[-1]


@cache
def _logarithms(largest: int) -> Counts:
    """Return the logarithm of each count up to the largest, black being 0 and the
    largest 65,535.
    """
    shares = np.log1p(np.arange(largest + 1.0)) / np.log1p(largest)
    table: Counts = np.rint(65535.0 * shares).astype(np.uint16)
    table.flags.writeable = False
    return table


@compiled
def _contrast(frame: Counts, largest: np.int64) -> float:
    """Return the contrast of pairs: see `pair_contrast`. Nothing tells how bright a
    pixel of the largest count was: it may be saturated.
    """
    step = max(1, len(frame) // LOOKED_AT_ROWS)
    columns = max(frame.shape[1] - PAIR_COLUMNS, 0)
    mean = np.empty(((len(frame) - 1) // step + 1, columns), np.uint16)
    number = 0

    for row in range(len(mean)):
        line = frame[step * row]
        line_mean = mean[row]

        for at in range(columns):
            one = np.int32(line[at + PAIR_COLUMNS])
            other = np.int32(line[at])
            # no branch: half of them would be taken by chance
            lit = (one > 0) & (other > 0) & (one < largest) & (other < largest)
            line_mean[at] = ((one + other) >> 1) * np.int32(lit)
            number += lit

    if number < LEAST_PAIRS:
        return 0.0

    place = mean.size - number + int(DIMMER * number)
    least = count_at(mean.ravel(), place)
    share = np.empty(mean.size, np.float32)
    chosen = 0

    for row in range(len(mean)):
        line = frame[step * row]
        line_mean = mean[row]

        for at in range(columns):
            if line_mean[at] >= least:
                one = np.int32(line[at + PAIR_COLUMNS])
                other = np.int32(line[at])
                share[chosen] = np.float32(abs(one - other)) / np.float32(one + other)
                chosen += 1

    upper = size_at(share[:chosen], chosen // 2)
    lower = upper if chosen % 2 else size_at(share[:chosen], chosen // 2 - 1)
    return float(np.float32(0.5) * (lower + upper))


def imaged_columns(frame: Pixels) -> tuple[int, int] | None:
    """Return the first imaged column of a frame, and the one after the last; None: too
    few are imaged.
    """
    first, after, lit, *_ = find_lit(counts_of(frame))
    return (first, after) if lit >= LEAST_SHAPE else None


@compiled
def find_lit(frame: Counts) -> Lit:
    """Return the first column that is not black, the one after the last, the number of
    such columns, the largest count.

    Then which columns are black, (column,), and the contrast of pairs: see
    `pair_contrast`.
    """
    columns = frame.shape[1]
    brightest = frame[0].copy()
    dark = np.empty(columns, np.bool_)

    for row in range(LIT_ROWS, frame.shape[0], LIT_ROWS):
        line = frame[row]
        for column in range(columns):
            brightest[column] = max(brightest[column], line[column])

    largest = np.int64(brightest.max())
    black = int(LIT_SHARE * largest)
    left = 0
    after = 0
    lit = 0

    for column in range(columns):
        dark[column] = brightest[column] <= black
        if not dark[column]:
            left = left if lit else column
            after = column + 1
            lit = lit + 1

    return left, after, lit, largest, dark, _contrast(frame, largest)


@compiled
def grid_cells(frame: Counts, left: int, width: int, eight_bits: bool) -> Counts:
    """Return a frame's columns as means in cells; `eight_bits`: of bytes, rounded half
    up as by OpenCV, not to even.
    """
    cells = _halved(frame, left, width, eight_bits)
    while cells.shape[0] >= MAX_ROWS or cells.shape[1] >= MAX_COLUMNS:
        cells = _halved(cells, 0, cells.shape[1], eight_bits)
    return cells


@compiled
def _halved(frame: Counts, left: int, columns: int, eight_bits: bool) -> Counts:
    """Return the means of neighbours; an odd last row or column is dropped."""
    rows = frame.shape[0]
    up = np.uint32(eight_bits)
    across = columns >= MAX_COLUMNS
    down = rows >= MAX_ROWS
    rows = rows // 2 if down else rows
    columns = columns // 2 if across else columns
    halves = np.empty((rows, columns), np.uint16)

    if across and down:  # loops of their own: in one, less is computed at once
        for row in range(rows):
            half = halves[row]
            upper = frame[2 * row, left:]
            lower = frame[2 * row + 1, left:]

            for at in range(columns):
                above = np.uint32(upper[2 * at]) + np.uint32(upper[2 * at + 1])
                below = np.uint32(lower[2 * at]) + np.uint32(lower[2 * at + 1])
                half[at] = (above + below + 2) >> 2
    elif across:
        for row in range(rows):
            half = halves[row]
            line = frame[row, left:]

            for at in range(columns):
                half[at] = _mean_of_two(
                    np.uint32(line[2 * at]), np.uint32(line[2 * at + 1]), up
                )
    else:
        for row in range(rows):  # of a row and itself where it is not halved at all
            upper = frame[2 * row if down else row, left:]
            lower = frame[2 * row + 1 if down else row, left:]

            for at in range(columns):
                halves[row, at] = _mean_of_two(
                    np.uint32(upper[at]), np.uint32(lower[at]), up
                )

    return halves


@compiled
def _mean_of_two(one: np.uint32, other: np.uint32, up: np.uint32) -> np.uint32:
    """Return the mean, rounded to the even number, or up."""
    half = (one + other) >> np.uint32(1)
    return half + ((one + other) & np.uint32(1) & (half | up))


@compiled
def noise_floor(cells: Counts) -> int:
    """Return the count below which a fifth of the cells that are not black lie."""
    rows, columns = cells.shape
    brightest = 0
    for row in range(0, rows, 8):
        for column in range(0, columns, 2):
            brightest = max(brightest, np.int64(cells[row, column]))

    black = brightest // BLACK_PART
    lit = 0
    sample = np.empty(cells.size, np.uint16)

    for row in range(0, rows, 8):
        for column in range(0, columns, 2):
            sample[lit] = cells[row, column]
            lit += cells[row, column] > black

    place = int(FLOOR_SHARE * lit)
    return count_at(sample[:lit], place) if lit else 0


@compiled
def brighter_columns(cells: Counts, rows: int) -> Integers:
    """Return the columns that are much brighter than the others in the uppermost rows:
    see `needle_in_frame`.
    """
    columns = cells.shape[1]
    total = np.zeros(columns, np.float32)
    for row in range(min(rows, len(cells))):
        for column in range(columns):
            total[column] += np.float32(cells[row, column])

    ordered = np.sort(total)
    middle = ordered[columns // 2]
    low = ordered[columns // 6]
    return np.flatnonzero(
        total > middle + STANDS_OUT * max(middle - low, _LEAST_SPREAD * middle)
    )
