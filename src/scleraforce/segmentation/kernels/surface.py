"""The surface on the grid: `surface.find_surface` as compiled loops over (row, pair of columns)."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation import surface
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.kernels.path import best_rows, find_path, is_path
from scleraforce.segmentation.kernels.ranks import nth_count
from scleraforce.segmentation.kernels.windows import largest_of_rows, smallest_of_rows

Counts = NDArray[np.uint16]

_BLACK_SHARE, _BRIGHT_SHARE, _EXCESS_COST = surface.BLACK_SHARE, surface.BRIGHT_SHARE, surface.EXCESS_COST
_LARGEST_LEVEL = np.float32(surface.LARGEST_LEVEL)
_LEAST_STEP, _HALF_STEP = np.float32(surface.LEAST_STEP), np.float32(surface.HALF_STEP)
_LEAST_EXCESS, _LARGEST_COST = np.float32(surface.LEAST_EXCESS), np.float32(surface.EXCESS_COST * surface.EXCESS_CAP)
_ZERO = np.float32(0.0)
FOUR = 4  # rows of the score of which the best one is searched first


@compiled
def opened_pairs(
    cells: Counts, floor: int, pairs: NDArray[np.uintp], thin: int, eroded: Counts, opened: Counts, tissue: Counts
) -> None:
    """Write pairs of the grid's columns, opened along depth, over the noise floor, into `tissue` (row / 2, pair).

    `eroded` and `opened` (row * column of a pair,) are scratch.
    """
    columns, number = len(pairs), len(opened)
    for row in range(number // columns):
        line, to = cells[row], opened[row * columns : (row + 1) * columns]
        for at in range(columns):
            to[at] = line[pairs[at]]
    for at in range(number):
        opened[at] = max(opened[at], np.uint16(floor))
    smallest_of_rows(opened, number, columns, thin, eroded)
    largest_of_rows(eroded, number, columns, thin, opened)
    for at in range(number):
        opened[at] -= np.uint16(floor)
    _extend_upwards(cells, _BLACK_SHARE * floor, pairs, thin, opened)
    for row in range(tissue.shape[0]):
        upper, lower = opened[2 * row * columns :], opened[(2 * row + 1) * columns :]
        for pair in range(tissue.shape[1]):
            above = np.int32(upper[2 * pair]) + np.int32(upper[2 * pair + 1])
            below = np.int32(lower[2 * pair]) + np.int32(lower[2 * pair + 1])
            tissue[row, pair] = (above + below + 2) >> 2


@compiled
def _extend_upwards(cells: Counts, black: float, pairs: NDArray[np.uintp], margin: int, opened: Counts) -> None:
    """Continue what lies at the upper edge of the measured part into the black above it: that edge is no surface."""
    columns = len(pairs)
    rows = len(opened) // columns
    for at in range(columns):
        first = 0
        while first < rows and cells[first, pairs[at]] <= black:
            first += 1
        if 0 < first < rows:
            top = min(first + margin, rows - 1)
            value = opened[top * columns + at]
            for row in range(top + 1, min(top + 3, rows)):
                value = max(value, opened[row * columns + at])
            for row in range(top):
                opened[row * columns + at] = value


@compiled
def surface_score(
    tissue: Counts, depth: int, downwards: Float, sample: Counts, bins: NDArray[np.int64], level: Float, means: Float,
    total: NDArray[np.float64], lowest: Float, score_cr: Float,
) -> None:  # fmt: skip
    """Write what a surface gains at the upper edge of each cell, (pair, row).

    Args:
        tissue: of `opened_pairs`.
        depth: rows that a step is judged by.
        downwards: bonus of each row.
        sample: scratch, like all that follow, but for the score.
        bins: BINS of them.
        level: (row, pair).
        means: (row + depth, pair).
        total: (pair,).
        lowest: (pair,).
        score_cr: the score.
    """
    rows, pairs = tissue.shape
    _scale_level(tissue, sample, bins, level)
    _depth_means(level, depth, total, means)
    for pair in range(pairs):
        total[pair], lowest[pair] = 0.0, level[0, pair]
    cost_factor = np.float64(np.float32(_EXCESS_COST * 2.0 / depth))
    for row in range(rows):
        for pair in range(pairs):
            cost = min(np.float32(total[pair]), _LARGEST_COST)
            step = max(means[row + depth, pair] - means[row, pair] - _LEAST_STEP, _ZERO)
            score_cr[pair, row] = step / (step + _HALF_STEP) - cost + downwards[row]
        if row % 2 == 1:  # the tissue above every other cell will do: it changes slowly
            for pair in range(pairs):
                lowest[pair] = min(lowest[pair], level[row - 1, pair])
                total[pair] += max(level[row - 1, pair] - lowest[pair] - _LEAST_EXCESS, _ZERO) * cost_factor


@compiled
def _scale_level(tissue: Counts, sample: Counts, bins: NDArray[np.int64], level: Float) -> None:
    """Write the tissue over that of the bright one."""
    rows, pairs = tissue.shape
    number = 0
    for row in range(0, rows, 2):
        for pair in range(pairs):
            sample[number] = tissue[row, pair]
            number += 1
    bright = nth_count(sample, number, int(_BRIGHT_SHARE * number), bins)
    scale = np.float32(1.0 / max(float(bright), 1e-6))
    for row in range(rows):
        for pair in range(pairs):
            level[row, pair] = min(np.float32(tissue[row, pair]) * scale, _LARGEST_LEVEL)


@compiled
def _depth_means(level: Float, depth: int, total: NDArray[np.float64], means: Float) -> None:
    """Write the mean of the `depth` rows above each row, from the first one to `depth` rows below the last."""
    rows, pairs = level.shape
    share = 1.0 / depth
    for pair in range(pairs):
        total[pair] = depth * np.float64(level[0, pair])
    for row in range(rows + depth):
        entering, leaving = min(row, rows - 1), max(row - depth, 0)
        for pair in range(pairs):
            means[row, pair] = np.float32(total[pair] * share)
            total[pair] += np.float64(level[entering, pair]) - np.float64(level[leaving, pair])


@compiled
def coarse_rows(
    score_cr: Float, reach: int, four: Float, downwards: Float, upwards: Float, path: NDArray[np.int64]
) -> None:
    """Write the best path; where the best rows make none, it is found on the best of each four: quicker to search.

    `four` (column, row / 4), `downwards` and `upwards` of its shape are scratch.
    """
    best_rows(score_cr, path)
    if is_path(path, reach):
        return
    columns, fours = four.shape
    for column in range(columns):
        for row in range(fours):
            best = score_cr[column, FOUR * row]
            for near in range(FOUR * row + 1, FOUR * row + FOUR):
                best = max(best, score_cr[column, near])
            four[column, row] = best
    find_path(four, (reach + FOUR - 1) // FOUR, path, downwards, upwards)
    for column in range(columns):
        first = FOUR * path[column]
        path[column] = first
        for near in range(first + 1, first + FOUR):
            if score_cr[column, near] > score_cr[column, path[column]]:
                path[column] = near
