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
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation_grid import Float, Grid, Pixels, PixelScale, rows_of
from scleraforce.imaging.segmentation_path import best_path

__all__ = ["Surface", "find_surface", "refine_surface"]

LINE_PIXELS, LINE_M = 12.0, 0.1e-3  # what is thinner is a line
STEP_PIXELS, STEP_M = 32.0, 0.2e-3  # depth of tissue that a step is judged by
PATH_COLUMNS = 30  # the path is searched on at most so many columns ...
ROWS = 2  # ... and on so many rows of the grid taken as one
MAX_SLOPE = 2.5  # of the surface: 68 degrees
BRIGHT_SHARE = 0.985  # of the cells are darker than bright tissue
LEAST_STEP = 0.06  # of the bright tissue's level: less is texture
HALF_STEP = 0.25  # a step of this size (over LEAST_STEP) earns half of what the largest one can
LEAST_EXCESS = 0.15  # of the bright tissue's level: less is haze, not tissue
EXCESS_COST, EXCESS_CAP = 0.5, 1.5  # cost of tissue above the path, in steps of full depth
STRIP_PIXELS, STRIP_M = 24.0, 0.15e-3  # half height of the strip in which the boundary is refined
FINE_COLUMNS = 128
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
    tissue, columns = _without_lines(grid)
    depth_m = ROWS * grid.scale.depth_m
    spacing = columns[1] - columns[0]
    score = _score(tissue, rows_of(STEP_PIXELS / ROWS, STEP_M / ROWS, grid, 3))
    reach = ceil(MAX_SLOPE * spacing * grid.scale.lateral_m / depth_m)
    path = _best_rows(score, min(max(2, reach), score.shape[1] // 3))
    column = (columns + 1.0) * grid.step_columns - 0.5  # the middle of two columns
    return column.astype(np.float32), (path * (ROWS * grid.step_rows) - 0.5).astype(np.float32)


def _without_lines(grid: Grid) -> tuple[Float, NDArray[np.intp]]:
    """Return pairs of the grid's columns, opened along depth, over the noise floor, and the first of each pair.

    Shape (pair, row / ROWS). The opening comes before neighbours are averaged: that would thicken a line at a slope.
    """
    columns = np.arange(0, grid.cells.shape[1] - 1, max(2, ceil(grid.cells.shape[1] / PATH_COLUMNS)))
    pairs = np.repeat(columns, 2)
    pairs[1::2] += 1
    cells = np.ascontiguousarray(grid.cells.take(pairs, axis=1).T)
    thin = np.ones((1, rows_of(LINE_PIXELS, LINE_M, grid, 1) + 2), dtype=np.uint8)  # a line touches one row more
    floor = np.asarray(round(grid.floor), dtype=cells.dtype)
    opened = cv2.morphologyEx(np.maximum(cells, floor), cv2.MORPH_OPEN, thin) - floor
    _extend_upwards(opened, cells, BLACK_SHARE * grid.floor, thin.shape[1])
    size = (opened.shape[1] // ROWS, len(columns))
    halved = cv2.resize(opened[:, : ROWS * size[0]], size, interpolation=cv2.INTER_AREA)
    return halved.astype(np.float32), columns


def _extend_upwards(opened: NDArray[Any], cells: NDArray[Any], black: float, margin: int) -> None:
    """Continue what lies at the upper edge of the measured part into the black above it: that edge is no surface."""
    if not (cells[:, 0] <= black).any():
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
    bright = np.float32(max(float(np.partition(sample, nth)[nth]), 1e-6))
    level = np.minimum(tissue / bright, np.float32(1.2))
    padded = cv2.copyMakeBorder(level, 0, 0, depth, depth, cv2.BORDER_REPLICATE)
    means = cv2.blur(padded, (depth, 1), anchor=(0, 0))
    step = np.maximum(means[:, depth : depth + rows] - means[:, :rows] - np.float32(LEAST_STEP), np.float32(0.0))
    # The tissue above every other cell will do: it changes slowly.
    coarse = level[:, ::2]
    darkest = np.minimum.accumulate(coarse, axis=1)
    bright_cells = np.maximum(coarse - darkest - np.float32(LEAST_EXCESS), np.float32(0.0))
    above = bright_cells @ _triangle(coarse.shape[1])[:, :-1]
    excess = np.repeat(above * np.float32(2.0 / depth), 2, axis=1)[:, :rows]
    score = step / (step + np.float32(HALF_STEP)) - np.float32(EXCESS_COST) * np.minimum(excess, np.float32(EXCESS_CAP))
    # Where nothing speaks, the path goes down: a wall that cannot be seen has left the window at the bottom.
    result: Float = score + np.arange(rows, dtype=np.float32) * np.float32(2e-3 / rows)
    return result


def _best_rows(score: Float, reach: int) -> NDArray[np.intp]:
    """Return the best path, found on the best rows of each four: a quarter of the states."""
    rows = score.shape[1] // 4 * 4
    pairs = np.maximum(score[:, 0:rows:2], score[:, 1:rows:2])
    path = best_path(np.maximum(pairs[:, ::2], pairs[:, 1::2]), ceil(reach / 4))
    four = score[np.arange(len(path))[:, None], 4 * path[:, None] + np.arange(4)]
    best: NDArray[np.intp] = 4 * path + four.argmax(axis=1)
    return best


def refine_surface(frame: Pixels, scale: PixelScale, column: Float, row: Float) -> Surface:
    """Move a coarse surface to the edge of the full frame: the best two-level fit along each column of a strip.

    Between a dark level above and a bright one below, the edge that fits best in the sense of least squares is where
    the sum of (count - middle level) above it is smallest.

    Args:
        frame: counts, shape (row, column).
        scale: size of its pixel.
        column: columns of the coarse surface, shape (point,), increasing.
        row: rows of the coarse surface, shape (point,).

    Returns:
        The surface at no more than 128 columns, in rows of pixel centres: row r is below it where r >= `row`.
    """
    rows, columns = frame.shape
    half = max(4, round(min(STRIP_PIXELS, STRIP_M / scale.depth_m)))
    fine, map_column, offset = _strip(columns, half)
    start = np.minimum(np.maximum(_extended(fine, column, row), np.float32(0.0)), np.float32(rows - 1.0))
    sampled = cv2.remap(frame, map_column, start + offset, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    raw: Float = sampled.astype(np.float32)
    noise = float(cv2.meanStdDev(raw[: half - 2])[1][0, 0])
    thin = np.ones((max(2, round(min(LINE_PIXELS, LINE_M / scale.depth_m))), 1), dtype=np.uint8)
    strip = np.asarray(cv2.morphologyEx(cv2.blur(raw, (3, 3)), cv2.MORPH_OPEN, thin), dtype=np.float32)
    sums = _triangle(2 * half).T @ strip
    above = sums[half - 2] / np.float32(half - 2)
    below = (sums[-1] - sums[half + 2]) / np.float32(half - 2)
    middle = (above + below) / 2
    edge = (sums - middle * np.arange(2 * half + 1, dtype=np.float32)[:, None]).argmin(axis=0)
    found = start + edge.astype(np.float32) - np.float32(half)
    # Mirrored in its end points, a slope goes on beyond them.
    longer = np.concatenate([2 * found[0] - found[4:0:-1], found, 2 * found[-1] - found[-2:-6:-1]])
    smooth = np.asarray(cv2.blur(cv2.medianBlur(longer[None], 5), (5, 1))[0, 4:-4], dtype=np.float32)
    contrast = np.asarray(cv2.blur((below - above)[None], (5, 1))[0], dtype=np.float32)
    return Surface(fine, smooth, contrast, noise)


def _extended(at: Float, column: Float, row: Float) -> Float:
    """Interpolate a curve, and continue it beyond its ends along their slopes (over three points: less ragged)."""
    inside = np.interp(at, column, row)
    reach = min(3, len(column) - 1)
    for end, other in ((0, reach), (-1, -1 - reach)):
        slope = (row[end] - row[other]) / (column[end] - column[other])
        beyond = at < column[0] if end == 0 else at > column[-1]
        inside[beyond] = row[end] + slope * (at[beyond] - column[end])
    return inside.astype(np.float32)


@lru_cache(maxsize=8)
def _strip(columns: int, half: int) -> tuple[Float, Float, Float]:
    """Return the columns to refine at, (point,), the same for each pixel of a strip, (row, point), and its rows."""
    fine = np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)
    offset = np.arange(-half, half, dtype=np.float32) + np.float32(0.5)
    return fine, np.repeat(fine[None], 2 * half, axis=0), offset[:, None]


@lru_cache(maxsize=8)
def _triangle(size: int) -> Float:
    """Return the matrix, (size, size + 1), whose product with rows are their sums up to each edge: see `cumsum`.

    The product takes a third of the time of `cumsum`.
    """
    return np.triu(np.ones((size, size + 1), dtype=np.float32), 1)
