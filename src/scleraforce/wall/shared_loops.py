"""Loops that several steps share: light between pixels, windows, straight lines, the
best path.

They are compiled (`scleraforce.base.compiled_loops`) and write into arrays that the
caller owns.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from scleraforce.base.arrays import Counts, Flags, Indices, Integers, Singles
from scleraforce.base.compiled_loops import compiled

Numbers = NDArray[np.number]

# columns that are searched on each side of steps of a path that are too large
MARGIN = 1
TABLES = 4  # neighbours are often alike: each table counts every fourth value


def _multiply_add() -> Callable[..., Any]:
    """Return a * b + c, rounded once to single precision: an instruction of the
    processor, for compiled loops.
    """

    @intrinsic
    def multiply_add(typing: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001 - as Numba calls it
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
            return builder.fma(*arguments)

        return types.float32(types.float32, types.float32, types.float32), code

    return multiply_add


multiply_add = _multiply_add()


@compiled
def count_at(counts: Counts, place: int) -> int:
    """Return the count at a place of all (value,) in order, as np.partition has it.

    Counted by the upper and then the lower byte, without a branch that is taken by
    chance: a fifth of the time.
    """
    of_byte = np.zeros((TABLES, 256), np.int64)
    for at in range(len(counts)):
        of_byte[at % TABLES, counts[at] >> 8] += 1

    upper, before = _byte_at(of_byte, place)
    of_byte[:] = 0
    for at in range(len(counts)):
        of_byte[at % TABLES, counts[at] & 255] += (counts[at] >> 8) == upper

    lower, _ = _byte_at(of_byte, place - before)
    return 256 * upper + lower


@compiled
def size_at(sizes: Singles, place: int) -> np.float32:
    """Return the size at a place of all (value,), 0 or more, in order, as np.partition
    has it.

    The bits of such numbers are in the order of the numbers (IEEE 754), and counted
    byte by byte.
    """
    bits = sizes.view(np.uint32)
    of_byte = np.zeros((TABLES, 256), np.int64)
    known = np.uint32(0)
    left = place

    for shift in (24, 16, 8, 0):
        of_byte[:] = 0
        for at in range(len(bits)):
            rest = (bits[at] ^ known) >> np.uint32(shift)
            # the bytes above are those that are known
            of_byte[at % TABLES, rest & np.uint32(255)] += rest < 256

        byte, before = _byte_at(of_byte, left)
        known |= np.uint32(byte) << np.uint32(shift)
        left -= before

    found = np.empty(1, np.uint32)
    found[0] = known
    return found.view(np.float32)[0]


@compiled
def _byte_at(of_byte: Integers, place: int) -> tuple[int, int]:
    """Return the byte at a place of all in order, and how many are smaller, by how
    often each occurs (table, byte).
    """
    before = 0
    for byte in range(256):
        here = 0
        for table in range(TABLES):
            here += of_byte[table, byte]
        if before + here > place:
            return byte, before
        before += here

    return 255, before


@compiled
def sample_rows(
    frame: Counts, first: int, columns: Indices, across: Singles, row: Singles
) -> Singles:
    """Return the counts at points, interpolated and rounded; the frame's edges continue
    beyond it.

    `columns`: those before and after each point, from `first` on, (2, point); `across`:
    distance beyond the one before; `row`: of the points, (line, point).
    """
    last = frame.shape[0] - 1
    origin = np.uintp(first)
    points = len(across)
    near = columns[0]
    far = columns[1]
    light = np.empty(row.shape, np.float32)
    upper = np.empty(points, np.uintp)
    lower = np.empty(points, np.uintp)
    down = np.empty(points, np.float32)

    for line in range(len(row)):
        for at in range(points):
            above = np.floor(row[line, at])
            down[at] = row[line, at] - above
            place = int(above)
            upper[at] = min(max(place, 0), last)
            lower[at] = min(max(place + 1, 0), last)

        for at in range(points):
            left = origin + near[at]
            right = origin + far[at]
            p00 = np.float32(frame[upper[at], left])
            p01 = np.float32(frame[upper[at], right])
            p10 = np.float32(frame[lower[at], left])
            p11 = np.float32(frame[lower[at], right])
            above = multiply_add(across[at], p01 - p00, p00)
            below = multiply_add(across[at], p11 - p10, p10)
            light[line, at] = np.rint(multiply_add(down[at], below - above, above))

    return light


@compiled
def mirrored(place: int, length: int) -> int:
    """Return the place inside of a row of this length that stands for one beyond its
    ends.
    """
    if length == 1:
        return 0
    while place < 0 or place >= length:
        place = -place if place < 0 else 2 * (length - 1) - place
    return place


@compiled
def mean_of_neighbours(values: Singles, reach: int) -> Singles:
    """Return the mean over `reach` values on each side, mirrored at the ends, as
    `cv2.blur` does.
    """
    length = len(values)
    share = 1.0 / (2 * reach + 1)
    means = np.empty_like(values)
    total = 0.0

    for place in range(-reach, reach + 1):
        total += np.float64(values[mirrored(place, length)])

    for at in range(length):
        means[at] = np.float32(total * share)
        total += np.float64(values[mirrored(at + reach + 1, length)]) - np.float64(
            values[mirrored(at - reach, length)]
        )

    return means


@compiled
def open_rows(values: Numbers, window: int) -> None:
    """Take the largest of the smallest of `window` rows about each row; an even window
    has one row more above.

    Windows of 1, 2, 4 ... rows are made of two shorter ones, the last of two that
    overlap. The first row stands for those above it.
    """
    rows, columns = values.shape
    above = window // 2
    flat = values.reshape(values.size)
    size = (rows + above) * columns
    here = np.empty(size, values.dtype)
    longer = np.empty(size, values.dtype)

    for largest in (False, True):
        for row in range(above):
            _copy(values[0], here[row * columns : (row + 1) * columns])

        _copy(flat, here[above * columns :])
        length = 1

        while length < window:
            step = min(length, window - length)
            both = max(size - step * columns, 0)
            _larger_or_smaller(here[:both], here[size - both :], largest, longer[:both])
            _copy(here[both:], longer[both:])  # the last ones
            here, longer = longer, here
            length += step

        _copy(here[: values.size], flat)


@compiled
def _copy(values: Numbers, to: Numbers) -> None:
    """Copy an array: Numba's assignment of slices takes eight times as long."""
    for at in range(len(to)):
        to[at] = values[at]


@compiled
def _larger_or_smaller(one: Numbers, other: Numbers, larger: bool, to: Numbers) -> None:
    """Write the larger or smaller of two; a place in the loop with a summand would be
    asked whether it is negative.
    """
    if larger:
        for at in range(len(to)):
            to[at] = max(one[at], other[at])
    else:
        for at in range(len(to)):
            to[at] = min(one[at], other[at])


@compiled
def bridge(row: Singles, there: Flags) -> Singles:
    """Return a curve with straight lines over its missing points; not all are
    missing.
    """
    return np.interp(
        np.arange(len(row)), np.flatnonzero(there), row[there].astype(np.float64)
    ).astype(np.float32)


@compiled
def at_every_column(
    column: Singles,
    row: Singles,
    there: Flags,
    nearest: Integers,
    to: NDArray[np.float64],
) -> None:
    """Write a curve at every column, by its points' columns; NaN where the `nearest`
    point to a column is not there.

    If all of these are there, the other points count, too.
    """
    shown = there[nearest]
    chosen = np.logical_or(there, shown.all())
    if chosen.any():
        at = column[chosen].astype(np.float64)
        known = row[chosen].astype(np.float64)
        to[:] = np.interp(np.arange(len(to)), at, known)

    to[~shown] = np.nan


@compiled
def best_rows(score_cr: Singles) -> Integers:
    """Return the best row of each column; the first one of several."""
    path = np.empty(len(score_cr), np.int64)
    for column in range(len(score_cr)):
        path[column] = np.argmax(score_cr[column])
    return path


@compiled
def is_path(path: Integers, reach: int) -> bool:
    """Return whether no step is larger than `reach`."""
    largest = 0
    for column in range(1, len(path)):
        largest = max(largest, abs(path[column] - path[column - 1]))
    return largest <= reach


@compiled
def best_path(score_cr: Singles, reach: int) -> Integers:
    """Return the rows (column,) of the path with the largest sum of scores whose steps
    are at most `reach` rows.

    Mostly the best rows of the columns make such a path. If not, the part with steps
    that are too large is searched; if its ends fit to the rest, no path is better, as
    each part has its largest sum. Otherwise all of it is searched. Give each row of the
    scores (column, row) its own small bonus, so that no two paths have the same sum.

    >>> scores = np.array([[0, 9, 0, 0], [0, 1, 0, 5], [0, 4, 0, 0]], dtype=np.float32)
    >>> best_path(scores, reach=1)
    array([1, 1, 1])
    """
    path = best_rows(score_cr)
    first = -1
    last = -1

    for column in range(1, len(path)):
        if abs(path[column] - path[column - 1]) > reach:
            first = column - 1 if first < 0 else first
            last = column - 1

    if first < 0:
        return path

    start = max(0, first - MARGIN)
    stop = min(len(path), last + 2 + MARGIN)
    _search(score_cr[start:stop], reach, path[start:stop])
    if not is_path(path, reach):
        _search(score_cr, reach, path)

    return path


@compiled
def _search(score_cr: Singles, reach: int, path: Integers) -> None:
    """Write the rows with the largest sum of scores of all paths through them, by
    dynamic programming.

    The sum comes from both sides (max-marginals of a Markov chain: Bishop, Pattern
    Recognition and Machine Learning, sec. 8.4.5), so the path needs no backtracking.
    """
    columns, rows = score_cr.shape
    before = np.empty_like(score_cr)
    after = np.empty_like(score_cr)
    before[0] = score_cr[0]
    after[columns - 1] = score_cr[columns - 1]

    for column in range(1, columns):
        back = columns - 1 - column
        _add_best(before[column - 1], score_cr[column], reach, before[column])
        _add_best(after[back + 1], score_cr[back], reach, after[back])

    for column in range(columns):
        best = 0
        largest = np.float32(-np.inf)

        for row in range(rows):
            through = before[column, row] + after[column, row] - score_cr[column, row]
            if through > largest:
                best = row
                largest = through

        path[column] = best


@compiled
def _add_best(sums: Singles, score: Singles, reach: int, to: Singles) -> None:
    """Write a column's scores plus the largest of the sums within reach."""
    rows = len(score)
    to[:] = sums

    for step in range(1, min(reach, rows - 1) + 1):
        for row in range(rows - step):
            to[row] = max(to[row], sums[row + step])
        for row in range(rows - step):
            to[row + step] = max(to[row + step], sums[row])

    to += score
