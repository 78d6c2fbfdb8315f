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
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.imaging.segmentation_grid import Float, Grid, Pixels, PixelScale, rows_of
from scleraforce.imaging.segmentation_path import best_path

__all__ = ["Surface", "find_surface", "refine_surface"]

LINE_PIXELS, LINE_M = 12.0, 0.1e-3  # what is thinner is a line
STEP_PIXELS, STEP_M = 32.0, 0.2e-3  # depth of tissue that a step is judged by
PATH_COLUMNS = 48  # the path is searched on at most about so many columns
MAX_SLOPE = 2.5  # of the surface: 68 degrees
BRIGHT_SHARE = 0.985  # of the cells are darker than bright tissue
LEAST_STEP = 0.06  # of the bright tissue's level: less is texture
HALF_STEP = 0.25  # a step of this size (over LEAST_STEP) earns half of what the largest one can
LEAST_EXCESS = 0.15  # of the bright tissue's level: less is haze, not tissue
EXCESS_COST, EXCESS_CAP = 0.5, 1.5  # cost of tissue above the path, in steps of full depth
STRIP_PIXELS, STRIP_M = 24.0, 0.15e-3  # half height of the strip in which the boundary is refined
FINE_COLUMNS = 512


@dataclass(frozen=True)
class Surface:
    """A surface along fine columns: `row` (column,), `contrast` in counts (below less above), `noise` of a pixel."""

    column: Float
    row: Float
    contrast: Float
    noise: float


def find_surface(grid: Grid) -> tuple[Float, Float]:
    """Return the surface on a coarse grid: columns and rows of the frame, each shape (point,)."""
    pairs = max(1, grid.cells.shape[1] // PATH_COLUMNS)
    width = 2 if pairs > 1 else 1
    usable = (grid.cells.shape[1] - width) // pairs * pairs + 1
    tissue, measured = _without_lines(grid, pairs, width, usable)
    score = _score(tissue, rows_of(STEP_PIXELS, STEP_M, grid, 3), measured.any(axis=1))
    slope = MAX_SLOPE * pairs * grid.scale.lateral_m / grid.scale.depth_m
    path = best_path(score, min(max(2, ceil(slope)), score.shape[1] // 3))
    column = (np.arange(len(path)) * pairs + width / 2) * grid.step_columns - 0.5
    return column.astype(np.float32), (path * grid.step_rows - 0.5).astype(np.float32)


def _without_lines(grid: Grid, pairs: int, width: int, usable: int) -> tuple[Float, NDArray[np.bool_]]:
    """Return every `pairs`-th column (as the mean of `width`), opened along depth, over the floor: (column, row)."""
    thin = np.ones((1, rows_of(LINE_PIXELS, LINE_M, grid, 2)), dtype=np.uint8)
    tissue: Float | None = None
    measured: NDArray[np.bool_] | None = None
    for start in range(width):
        chosen = slice(start, start + usable, pairs)
        opened = cv2.morphologyEx(np.ascontiguousarray(grid.cells[:, chosen].T), cv2.MORPH_OPEN, thin)
        tissue = opened if tissue is None else (tissue + opened) * np.float32(0.5)
        seen = grid.measured[:, chosen].T
        measured = seen if measured is None else measured & seen
    assert tissue is not None and measured is not None
    _extend_upwards(tissue, measured, thin.shape[1])
    return tissue - np.float32(grid.floor), measured


def _extend_upwards(tissue: Float, measured: NDArray[np.bool_], margin: int) -> None:
    """Continue what lies at the upper edge of the measured part into the black above it: that edge is no surface."""
    first = measured.argmax(axis=1)
    for column in np.flatnonzero(first):
        top = min(first[column] + margin, tissue.shape[1] - 1)
        tissue[column, :top] = tissue[column, top : top + 3].max()


def _score(tissue: Float, depth: int, lit: NDArray[np.bool_]) -> Float:
    """Return what a surface gains at the upper edge of each cell, shape (column, row)."""
    columns, rows = tissue.shape
    nth = int(BRIGHT_SHARE * tissue.size)
    bright = float(np.partition(tissue.ravel(), nth)[nth])
    level = np.minimum(tissue / np.float32(max(bright, 1e-6)), np.float32(1.2))
    padded = cv2.copyMakeBorder(level, 0, 0, depth, 0, cv2.BORDER_REPLICATE)
    sums = np.zeros((columns, rows + 2 * depth + 1), dtype=np.float32)
    np.cumsum(padded, axis=1, out=sums[:, 1 : rows + depth + 1])
    sums[:, rows + depth + 1 :] = sums[:, rows + depth, None]
    means = (sums[:, depth:] - sums[:, :-depth]) / np.float32(depth)
    step = np.maximum(means[:, depth : depth + rows] - means[:, :rows] - np.float32(LEAST_STEP), np.float32(0.0))
    darkest = np.minimum.accumulate(level, axis=1)
    excess = np.cumsum(np.maximum(level - darkest - np.float32(LEAST_EXCESS), 0), axis=1) / np.float32(depth)
    score = step / (step + np.float32(HALF_STEP)) - np.float32(EXCESS_COST) * np.minimum(excess, np.float32(EXCESS_CAP))
    score[~lit] = 0.0
    # Where nothing speaks, the path goes down: a wall that cannot be seen has left the window at the bottom.
    result: Float = score + np.linspace(0.0, 2e-3, rows, dtype=np.float32)
    return result


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
        The surface at no more than 512 columns, in rows of pixel centres: row r is below it where r >= `row`.
    """
    rows, columns = frame.shape
    half = max(4, round(min(STRIP_PIXELS, STRIP_M / scale.depth_m)))
    fine = np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)
    start = np.interp(fine, column, row).astype(np.float32).clip(0.0, rows - 1.0)
    offset = np.arange(-half, half, dtype=np.float32) + np.float32(0.5)
    map_row = np.add.outer(start, offset)
    strip = cv2.remap(
        frame, np.repeat(fine[:, None], 2 * half, axis=1), map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float32)
    noise = float(strip[:, : half - 2].std(axis=1).mean())
    strip = cv2.blur(strip, (3, 9))
    sums = np.zeros((len(fine), 2 * half + 1), dtype=np.float32)
    np.cumsum(strip, axis=1, out=sums[:, 1:])
    above = sums[:, half - 2] / np.float32(half - 2)
    below = (sums[:, -1] - sums[:, half + 2]) / np.float32(half - 2)
    ramp = np.arange(2 * half + 1, dtype=np.float32)
    edge = (sums - np.multiply.outer((above + below) / 2, ramp)).argmin(axis=1)
    found = start + edge.astype(np.float32) - np.float32(half)
    smooth = cv2.blur(cv2.medianBlur(found[None], 5), (5, 1))[0]
    return Surface(fine, smooth, below - above, noise)
