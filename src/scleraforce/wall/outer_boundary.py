"""The outer boundary: the first dark-to-bright step from above that has tissue, not
just a line, below it.

Three rules, none of which knows the scale of the image:

- what is thinner than 12 pixels (or 0.1 mm) along the depth is a reflection, a contact
  lens or a coverslip: it is removed by an opening (Serra, Image Analysis and
  Mathematical Morphology, 1982) along the columns;
- the surface is the path that gains most contrast between what lies below and above it;
  contrast saturates, so that a mirror reflection does not outweigh ten shadowed
  columns;
- tissue above the path costs: iris and lens are not reached through the wall. What is
  bright from the top edge on without a dark gap above has no visible surface and
  neither gains nor costs.
"""

import numpy as np

from scleraforce.base.arrays import Counts, Flags, Indices, Integers, Singles
from scleraforce.base.compiled_loops import compiled
from scleraforce.wall.shared_loops import (
    best_path,
    best_rows,
    count_at,
    is_path,
    mirrored,
    open_rows,
    sample_rows,
)

ROWS = 2  # ... and rows of the grid taken as one
BRIGHT_SHARE = 0.985  # of the cells are darker than bright tissue
LEAST_STEP = np.float32(0.06)  # of the bright tissue's level: less is texture
LARGEST_LEVEL = np.float32(1.2)  # times that: what is brighter counts as that
# a step of this size (over LEAST_STEP) earns half of the largest gain
HALF_STEP = np.float32(0.25)
# share of the bright tissue's level: less is haze, not tissue
LEAST_EXCESS = np.float32(0.15)
# cost of tissue above the path, in steps of full depth
EXCESS_COST = 0.5
EXCESS_CAP = 1.5
SMOOTHED = 5  # points
BLACK_SHARE = 0.25  # of the noise floor: darker cells are not measured
# share of the frame's own typical contrast: a column with less shows no surface
ABSENT_SHARE = 0.3
TYPICAL = 0.75  # of the columns have less than the typical contrast
FOUR = 4  # rows of the score of which the best one is searched first
_LARGEST_COST = np.float32(EXCESS_COST * EXCESS_CAP)
_ZERO = np.float32(0.0)
_ONE_HALF = np.float32(0.5)
_NINTH = 1.0 / 9.0


@compiled
def opened_pairs(cells: Counts, floor: int, pairs: Indices, thin: int) -> Counts:
    """Return pairs of the grid's columns, opened along depth, over the noise floor,
    (row / 2, pair).
    """
    rows = len(cells)
    columns = len(pairs)
    opened = np.empty((rows, columns), np.uint16)
    for row in range(rows):
        for at in range(columns):
            opened[row, at] = max(cells[row, pairs[at]], np.uint16(floor))

    open_rows(opened, thin)
    for row in range(rows):
        for at in range(columns):
            opened[row, at] -= np.uint16(floor)

    _extend_upwards(cells, BLACK_SHARE * floor, pairs, thin, opened)
    tissue = np.empty((rows // ROWS, columns // 2), np.uint16)

    for row in range(tissue.shape[0]):
        upper = opened[2 * row]
        lower = opened[2 * row + 1]

        for pair in range(tissue.shape[1]):
            above = np.int32(upper[2 * pair]) + np.int32(upper[2 * pair + 1])
            below = np.int32(lower[2 * pair]) + np.int32(lower[2 * pair + 1])
            tissue[row, pair] = (above + below + 2) >> 2

    return tissue


@compiled
def _extend_upwards(
    cells: Counts, black: float, pairs: Indices, margin: int, opened: Counts
) -> None:
    """Continue what lies at the upper edge of the measured part into the black above:
    it is not a surface.
    """
    rows, columns = opened.shape
    for at in range(columns):
        first = 0
        while first < rows and cells[first, pairs[at]] <= black:
            first += 1

        if 0 < first < rows:
            top = min(first + margin, rows - 1)
            value = opened[top, at]
            for row in range(top + 1, min(top + 3, rows)):
                value = max(value, opened[row, at])

            for row in range(top):
                opened[row, at] = value


@compiled
def surface_score(tissue: Counts, depth: int, downwards: Singles) -> Singles:
    """Return the gain of a surface at the upper edge of each cell, (pair, row), by the
    `depth` rows above and below.

    `tissue` is of `opened_pairs`; `downwards` is the bonus of each row.
    """
    rows, pairs = tissue.shape
    level = _scaled_level(tissue)
    means = _depth_means(level, depth)
    total = np.zeros(pairs)
    lowest = level[0].copy()
    score_cr = np.empty((pairs, rows), np.float32)
    cost_factor = np.float64(np.float32(EXCESS_COST * 2.0 / depth))

    for row in range(rows):
        for pair in range(pairs):
            cost = min(np.float32(total[pair]), _LARGEST_COST)
            step = max(means[row + depth, pair] - means[row, pair] - LEAST_STEP, _ZERO)
            score_cr[pair, row] = step / (step + HALF_STEP) - cost + downwards[row]

        if row % 2 == 1:  # the tissue above every other cell will do: it changes slowly
            for pair in range(pairs):
                lowest[pair] = min(lowest[pair], level[row - 1, pair])
                total[pair] += (
                    max(level[row - 1, pair] - lowest[pair] - LEAST_EXCESS, _ZERO)
                    * cost_factor
                )

    return score_cr


@compiled
def _scaled_level(tissue: Counts) -> Singles:
    """Return the tissue over that of the bright one."""
    rows, pairs = tissue.shape
    sample = np.empty(tissue.size, np.uint16)
    number = 0

    for row in range(0, rows, 2):
        for pair in range(pairs):
            sample[number] = tissue[row, pair]
            number += 1

    place = int(BRIGHT_SHARE * number)
    bright = count_at(sample[:number], place)
    scale = np.float32(1.0 / max(float(bright), 1e-6))
    level = np.empty(tissue.shape, np.float32)

    for row in range(rows):
        for pair in range(pairs):
            level[row, pair] = min(np.float32(tissue[row, pair]) * scale, LARGEST_LEVEL)

    return level


@compiled
def _depth_means(level: Singles, depth: int) -> Singles:
    """Return the mean of the `depth` rows above each row, from the first one to `depth`
    rows below the last.
    """
    rows, pairs = level.shape
    share = 1.0 / depth
    total = np.empty(pairs)
    means = np.empty((rows + depth, pairs), np.float32)

    for pair in range(pairs):
        total[pair] = depth * np.float64(level[0, pair])

    for row in range(rows + depth):
        entering = min(row, rows - 1)
        leaving = max(row - depth, 0)

        for pair in range(pairs):
            means[row, pair] = np.float32(total[pair] * share)
            total[pair] += np.float64(level[entering, pair]) - np.float64(
                level[leaving, pair]
            )

    return means


@compiled
def coarse_rows(score_cr: Singles, reach: int) -> Integers:
    """Return the best path; if the best rows do not make one, it is found on the best
    of each four: quicker.
    """
    path = best_rows(score_cr)
    if is_path(path, reach):
        return path

    columns = len(path)
    fours = score_cr.shape[1] // FOUR
    four = np.empty((columns, fours), np.float32)

    for column in range(columns):
        for row in range(fours):
            best = score_cr[column, FOUR * row]
            for near in range(FOUR * row + 1, FOUR * row + FOUR):
                best = max(best, score_cr[column, near])

            four[column, row] = best

    path = best_path(four, (reach + FOUR - 1) // FOUR)
    for column in range(columns):
        first = FOUR * path[column]
        path[column] = first
        for near in range(first + 1, first + FOUR):
            if score_cr[column, near] > score_cr[column, path[column]]:
                path[column] = near

    return path


@compiled
def start_rows(
    path: Integers, step_rows: int, place: Integers, weight: Singles, rows: int
) -> Singles:
    """Return a path at the fine columns, in rows of a frame, from its two neighbours'
    places and weights.
    """
    coarse = np.empty(len(path), np.float32)
    start = np.empty(len(place), np.float32)
    last = np.float32(rows - 1.0)
    for pair in range(len(path)):
        coarse[pair] = np.float32(path[pair] * (ROWS * step_rows)) - _ONE_HALF

    for at in range(len(start)):
        one = np.float64(weight[at, 0]) * np.float64(coarse[place[at, 0]])
        other = np.float64(weight[at, 1]) * np.float64(coarse[place[at, 1]])
        start[at] = min(max(np.float32(one + other), np.float32(0.0)), last)

    return start


@compiled
def sample_strip(
    frame: Counts,
    first: int,
    columns: Indices,
    across: Singles,
    start: Singles,
    half: int,
) -> tuple[Singles, float]:
    """Return the light in a strip about a curve, (row, column), and the noise of a
    pixel above it.

    `start`: rows of the strip's middle, (column,); `half` of its height. For `frame` to
    `across` see `sample_rows`.
    """
    rows = np.empty((2 * half, len(start)), np.float32)
    for step in range(2 * half):
        for at in range(len(start)):
            rows[step, at] = np.float32(step - half) + _ONE_HALF + start[at]

    raw = sample_rows(frame, first, columns, across, rows)
    number = (half - 2) * len(start)
    total = squares = 0

    for row in range(half - 2):
        for at in range(len(start)):
            count = np.int64(raw[row, at])
            total += count
            squares += count * count

    mean = total / number
    return raw, np.sqrt(max(squares / number - mean * mean, 0.0))


@compiled
def fit_edges(raw: Singles, thin: int, start: Singles) -> tuple[Singles, Singles]:
    """Return the rows of the best two-level fit along each column of a strip, and by
    how much it is brighter below.
    """
    strip = _smoothed_and_opened(raw, thin)
    rows, columns = strip.shape
    half = rows // 2
    end = rows // 2 - 2
    above = np.zeros(columns)
    below = np.zeros(columns)
    middle = np.empty(columns)
    found = np.zeros(columns, np.float32)
    contrast = np.empty(columns, np.float32)

    for row in range(end):
        line = strip[row]
        other_line = strip[rows - 1 - row]
        for at in range(columns):
            above[at] += np.float64(line[at])
            below[at] += np.float64(other_line[at])

    for at in range(columns):
        middle[at] = (above[at] + below[at]) / (2 * end)
        contrast[at] = np.float32((below[at] - above[at]) / end)

    total = np.zeros(columns)
    best = np.zeros(columns)

    for row in range(rows):
        line = strip[row]
        for at in range(columns):
            total[at] += np.float64(line[at]) - middle[at]
            if total[at] < best[at]:
                best[at] = total[at]
                found[at] = np.float32(row + 1)

    for at in range(columns):
        found[at] = start[at] + found[at] - np.float32(half)

    return found, contrast


@compiled
def _smoothed_and_opened(raw: Singles, thin: int) -> Singles:
    """Return the mean of 3 x 3 neighbours, opened along the columns."""
    rows, columns = raw.shape
    strip = np.empty(raw.shape, np.float32)
    three = np.empty(columns, np.float32)

    for row in range(rows):
        upper = raw[mirrored(row - 1, rows)]
        line = raw[row]
        lower = raw[mirrored(row + 1, rows)]
        mean = strip[row]

        for at in range(columns):
            three[at] = upper[at] + line[at] + lower[at]  # counts: no sum is rounded

        for at in range(1, columns - 1):
            mean[at] = np.float32(
                np.float64(three[at - 1] + three[at] + three[at + 1]) * _NINTH
            )

        mean[0] = np.float32(np.float64(three[0] + three[1] + three[1]) * _NINTH)
        mean[columns - 1] = np.float32(
            np.float64(three[columns - 1] + three[columns - 2] + three[columns - 2])
            * _NINTH
        )

    open_rows(strip, thin)
    return strip


@compiled
def smooth_surface(found: Singles) -> None:
    """Take a median and a mean over five points of a surface, extrapolated along its
    slope.
    """
    number = len(found)
    if number < SMOOTHED:
        return

    longer = np.empty(number + 8, np.float32)
    median = np.empty(number + 8, np.float32)
    for step in range(4):
        longer[step] = 2 * found[0] - found[4 - step]
        longer[number + 4 + step] = 2 * found[number - 1] - found[number - 2 - step]

    longer[4 : number + 4] = found
    for at in range(2, number + 6):
        median[at] = np.median(longer[at - 2 : at + 3])

    for at in range(number):
        total = 0.0
        for step in range(2, 7):
            total += np.float64(median[at + step])

        found[at] = np.float32(total * 0.2)


@compiled
def show_points(
    row: Singles,
    contrast: Singles,
    missing: Flags,
    column: Singles,
    deepest: float,
    widest: int,
) -> Flags:
    """Return which points, in their columns of a frame's imaged part, show a surface,
    or a gap of at most `widest`.

    A surface below row `deepest` has left the window; less than ABSENT_SHARE of the
    typical contrast does not show it.
    """
    points = len(row)
    inside = np.empty(points, np.bool_)
    present = np.empty(points, np.bool_)
    for at in range(points):
        inside[at] = row[at] < np.float32(deepest)
        present[at] = inside[at] and not missing[int(column[at])]

    usual = quantile_of_chosen(contrast, present, TYPICAL)
    least = np.float32(ABSENT_SHARE * max(np.float64(usual), 1e-6))
    last = -1

    for at in range(points):
        if not (present[at] and contrast[at] > least):
            present[at] = False
            continue

        within = False
        for gap in range(last + 1, at):
            within = within or inside[gap]

        if last >= 0 and within and at - 1 - last <= widest:
            present[last + 1 : at] = True

        last = at

    return present


@compiled
def quantile_of_chosen(of: Singles, chosen: Flags, share: float) -> np.float32:
    """Return the value that `share` of the chosen ones lie below, NaN of none."""
    values = np.empty_like(of)
    number = 0

    for at in range(len(of)):
        if chosen[at]:
            values[number] = of[at]
            number += 1

    place = int(share * number)
    return np.partition(values[:number], place)[place] if number else np.float32(np.nan)
