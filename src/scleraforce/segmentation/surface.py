"""The outer boundary: the first dark-to-bright step from above that has tissue, not just a line, below it.

Three rules, none of which knows the scale of the image:

- what is thinner than 12 pixels (or 0.1 mm) along the depth is a reflection, a contact lens or a coverslip: it is
  removed by an opening (Serra, Image Analysis and Mathematical Morphology, 1982) along the columns;
- the surface is the path that gains most contrast between what lies below and above it; contrast saturates, so that a
  mirror reflection does not outweigh ten shadowed columns;
- tissue above the path costs: iris and lens are not reached through the wall. What is bright from the top edge on
  without a dark gap above has no visible surface and neither gains nor costs.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.columns import continuation, fine_columns, repeated
from scleraforce.segmentation.grid import Float, Grid, rows_of
from scleraforce.segmentation.path import best_path

LINE_PIXELS, LINE_M = 12.0, 0.1e-3  # what is thinner is a line
STEP_PIXELS, STEP_M = 32.0, 0.2e-3  # depth of tissue that a step is judged by
PATH_COLUMNS = 30  # the path is searched on at most so many columns ...
ROWS = 2  # ... and on so many rows of the grid taken as one
MAX_SLOPE = 2.5  # of the surface: 68 degrees
BRIGHT_SHARE = 0.985  # of the cells are darker than bright tissue
LEAST_STEP = 0.06  # of the bright tissue's level: less is texture
LARGEST_LEVEL = 1.2  # times that: what is brighter counts as that
HALF_STEP = 0.25  # a step of this size (over LEAST_STEP) earns half of what the largest one can
LEAST_EXCESS = 0.15  # of the bright tissue's level: less is haze, not tissue
EXCESS_COST, EXCESS_CAP = 0.5, 1.5  # cost of tissue above the path, in steps of full depth
STRIP_PIXELS, STRIP_M = 24.0, 0.15e-3  # half height of the strip in which the boundary is refined
SMOOTHED = 5  # points
BLACK_SHARE = 0.25  # of the noise floor: less light than that is no measurement


@dataclass(frozen=True)
class Surface:
    """A surface along fine columns: `row` (column,), `contrast` in counts (below less above), `noise` of a pixel."""

    column: Float
    row: Float
    contrast: Float
    noise: float


def find_surface(grid: Grid) -> tuple[Float, Float]:
    """Return the surface on a coarse grid: columns and rows of the frame, each shape (point,)."""
    tissue = _without_lines(grid)
    column, _ = pairs_of(grid.cells.shape[1], grid.step_columns)
    path = _best_rows(_score(tissue, step_rows(grid)), path_reach(grid))
    row = path.astype(np.float32)
    row *= np.float32(ROWS * grid.step_rows)
    row -= np.float32(0.5)
    return column, row


def line_rows(grid: Grid) -> int:
    """Return how many rows of a grid a line touches at most: the opening that removes it is of so many."""
    return rows_of(LINE_PIXELS, LINE_M, grid, 1) + 2  # it touches one row more


def step_rows(grid: Grid) -> int:
    """Return by how many rows of the path's map a step is judged."""
    return rows_of(STEP_PIXELS / ROWS, STEP_M / ROWS, grid, 3)


def path_reach(grid: Grid) -> int:
    """Return by how many rows of its map the path may change from one pair of columns to the next."""
    column, _ = pairs_of(grid.cells.shape[1], grid.step_columns)
    spacing_m = float(column[1] - column[0]) / grid.step_columns * grid.scale.lateral_m
    reach = ceil(MAX_SLOPE * spacing_m / (ROWS * grid.scale.depth_m))
    return min(max(2, reach), len(grid.cells) // ROWS // 3)


def strip_rows(scale: PixelScale) -> tuple[int, int]:
    """Return half the height of the strip in which the boundary is refined, and the opening there, rows of a frame."""
    half = max(4, round(min(STRIP_PIXELS, STRIP_M / scale.depth_m)))
    return half, max(2, round(min(LINE_PIXELS, LINE_M / scale.depth_m)))


def _without_lines(grid: Grid) -> Float:
    """Return pairs of the grid's columns, opened along depth, over the noise floor.

    Shape (pair, row / ROWS). The opening comes before neighbours are averaged: that would thicken a line at a slope.
    """
    _, pairs = pairs_of(grid.cells.shape[1], grid.step_columns)
    cells = cv2.transpose(grid.cells).take(pairs, axis=0)
    thin = _line(1, line_rows(grid))
    floor = cells.dtype.type(grid.floor)
    opened = cv2.morphologyEx(np.maximum(cells, floor), cv2.MORPH_OPEN, thin) - floor
    _extend_upwards(opened, cells, BLACK_SHARE * grid.floor, thin.shape[1])
    size = (opened.shape[1] // ROWS, len(pairs) // 2)
    halved = cv2.resize(opened[:, : ROWS * size[0]], size, interpolation=cv2.INTER_AREA)
    return halved.astype(np.float32)


def _extend_upwards(opened: NDArray[Any], cells: NDArray[Any], black: float, margin: int) -> None:
    """Continue what lies at the upper edge of the measured part into the black above it: that edge is no surface."""
    if not np.count_nonzero(cells[:, 0] <= int(black)):
        return
    first = (cells > black).argmax(axis=1)
    for column in np.flatnonzero(first):
        top = min(first[column] + margin, opened.shape[1] - 1)
        opened[column, :top] = opened[column, top : top + 3].max()


def _score(tissue: Float, depth: int) -> Float:
    """Return what a surface gains at the upper edge of each cell, shape (column, row)."""
    rows = tissue.shape[1]
    sample = tissue[:, ::2].ravel()
    nth = int(BRIGHT_SHARE * sample.size)
    sample.partition(nth)
    level = tissue * np.float32(1.0 / max(float(sample[nth]), 1e-6))
    cv2.threshold(level, LARGEST_LEVEL, 0.0, cv2.THRESH_TRUNC, level)
    padded = cv2.copyMakeBorder(level, 0, 0, depth, depth, cv2.BORDER_REPLICATE)
    means = cv2.blur(padded, (depth, 1), anchor=(0, 0))
    step = means[:, depth : depth + rows] - means[:, :rows]
    step -= np.float32(LEAST_STEP)
    cv2.threshold(step, 0.0, 0.0, cv2.THRESH_TOZERO, step)
    # The tissue above every other cell will do: it changes slowly.
    coarse = level[:, ::2]
    bright_cells = coarse - np.minimum.accumulate(coarse, axis=1)
    bright_cells -= np.float32(LEAST_EXCESS)
    cv2.threshold(bright_cells, 0.0, 0.0, cv2.THRESH_TOZERO, bright_cells)
    above = bright_cells @ _above(coarse.shape[1], EXCESS_COST * 2.0 / depth)
    cv2.threshold(above, EXCESS_COST * EXCESS_CAP, 0.0, cv2.THRESH_TRUNC, above)
    score = step / (step + np.float32(HALF_STEP))
    score[:, ::2] -= above
    score[:, 1::2] -= above[:, : rows // 2]
    # Where nothing speaks, the path goes down: a wall that cannot be seen has left the window at the bottom.
    score += downwards(rows)
    return score


def _best_rows(score: Float, reach: int) -> NDArray[np.intp]:
    """Return the best path; where the best rows make none, it is found on the best of each four: quicker to search."""
    path: NDArray[np.intp] = score.argmax(axis=1)
    if not np.count_nonzero(np.abs(path[1:] - path[:-1]) > reach):
        return path
    rows = score.shape[1] // 4 * 4
    pairs = np.maximum(score[:, 0:rows:2], score[:, 1:rows:2])
    path = best_path(np.maximum(pairs[:, ::2], pairs[:, 1::2]), ceil(reach / 4))
    path *= 4
    four = score[np.arange(len(path))[:, None], path[:, None] + np.arange(4)]
    path += four.argmax(axis=1)
    return path


def refine_surface(frame: Pixels, scale: PixelScale, column: Float, row: Float, hidden: slice = slice(0, 0)) -> Surface:
    """Move a coarse surface to the edge of the full frame: the best two-level fit along each column of a strip.

    Between a dark level above and a bright one below, the edge that fits best in the sense of least squares is where
    the sum of (count - middle level) above it is smallest.

    Args:
        frame: counts, shape (row, column).
        scale: size of its pixel.
        column: columns of the coarse surface, shape (point,), increasing.
        row: rows of the coarse surface, shape (point,).
        hidden: points of the result that say nothing of those beside them; they are not smoothed.

    Returns:
        The surface at no more than 128 columns, in rows of pixel centres: row r is below it where r >= `row`.
    """
    rows, columns = frame.shape
    half, line = strip_rows(scale)
    fine = fine_columns(columns)
    start = continuation(columns, float(column[0]), float(column[1] - column[0]), len(column)) @ row
    np.minimum(np.maximum(start, np.float32(0.0), out=start), np.float32(rows - 1.0), out=start)
    map_column, map_row = repeated(columns, 2 * half), _strip_rows(half) + start
    raw = cv2.remap(frame, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    noise = cv2.meanStdDev(raw[: half - 2])[1].item()
    strip = cv2.morphologyEx(cv2.blur(raw, (3, 3)), cv2.MORPH_OPEN, _line(line, 1))
    fits = strip.T @ _two_levels(half)
    found = start + fits[:, :-1].argmin(axis=1).astype(np.float32)
    found -= np.float32(half)
    if hidden.start == hidden.stop:
        smooth = _smoothed(found)
    else:
        sides = _smoothed(found[: hidden.start]), found[hidden], _smoothed(found[hidden.stop :])
        smooth = np.concatenate(sides)
    contrast = cv2.blur(fits[None, :, -1], (5, 1))[0]
    return Surface(fine, smooth.astype(np.float32), contrast.astype(np.float32), noise)


def _smoothed(found: Float) -> Float:
    """Return a surface after a median and a mean over five points."""
    if len(found) < SMOOTHED:
        return found
    # Mirrored in its end points, a slope goes on beyond them.
    longer = np.concatenate([2 * found[0] - found[4:0:-1], found, 2 * found[-1] - found[-2:-6:-1]])
    return cast(Float, cv2.blur(cv2.medianBlur(longer[None], 5), (5, 1))[0, 4:-4])


@lru_cache(maxsize=64)
def pairs_of(columns: int, step: int) -> tuple[Float, NDArray[np.intp]]:
    """Return pairs of neighbouring columns of a grid, at most PATH_COLUMNS of them, evenly spaced.

    First their middles in columns of the frame, (pair,), then their columns in the grid by turns, (2 pair,).
    """
    first = np.arange(0, columns - 1, max(2, ceil(columns / PATH_COLUMNS)))
    middle = ((first + 1.0) * step - 0.5).astype(np.float32)
    return middle, np.stack([first, first + 1], axis=1).ravel()


@lru_cache(maxsize=8)
def _line(rows: int, columns: int) -> NDArray[np.uint8]:
    """Return the shape of an opening."""
    return np.ones((rows, columns), dtype=np.uint8)


@lru_cache(maxsize=8)
def _above(size: int, factor: float) -> Float:
    """Return the matrix, (size, size), whose product with rows are `factor` times the sums before each cell.

    The product takes a third of the time of `cumsum`.
    """
    return np.triu(np.full((size, size), factor, dtype=np.float32), 1)


@lru_cache(maxsize=8)
def downwards(rows: int) -> Float:
    """Return a bonus of each row that is too small to outweigh anything seen."""
    return np.linspace(0.0, 2e-3, rows, endpoint=False, dtype=np.float32)


@lru_cache(maxsize=8)
def _strip_rows(half: int) -> Float:
    """Return the rows of a strip from its middle, (row, 1)."""
    return (np.arange(-half, half, dtype=np.float32) + np.float32(0.5))[:, None]


@lru_cache(maxsize=8)
def _two_levels(half: int) -> Float:
    return two_levels(half).astype(np.float32)


def two_levels(half: int) -> NDArray[np.float64]:
    """Return the matrix, (row, edge + 1), that a strip's columns are multiplied by.

    For each edge between the rows it gives the sum of (count - middle level) above; last, the level below less that
    above. The levels are means of the strip's ends.
    """
    size, end = 2 * half, half - 2
    above, below = np.zeros(size), np.zeros(size)
    above[:end], below[-end:] = 1.0 / end, 1.0 / end
    sums = np.triu(np.ones((size, size + 1)), 1)
    edges = sums - np.outer((above + below) / 2, np.arange(size + 1))
    return np.column_stack([edges, below - above])
