"""A frame on a grid of bounded size, its noise floor, and what shines in it without being tissue.

Scanners sample a reflection with a few pixels, whatever their scale: a line is thin in pixels, tissue is thick in
pixels and in metres. Lengths below are therefore given as pixels with a bound in metres.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale

Float = NDArray[np.float32]

MAX_COLUMNS = 192  # of the grid: the frame is halved until it has fewer
MAX_ROWS = 384
BLACK_PART = 1000  # th part of the brightest cell: less is black
FLOOR_SHARE = 0.2  # of the pixels that are not black, this share lies at or below the noise floor


@dataclass(frozen=True)
class Grid:
    """A frame, averaged into cells of `step_columns` x `step_rows` pixels.

    `cells` (row, column) are counts, `floor` is the count of the noise, `scale` the size of a cell.
    """

    cells: Pixels
    floor: float
    step_columns: int
    step_rows: int
    scale: PixelScale


def make_grid(frame: Pixels, scale: PixelScale) -> Grid:
    """Average a frame into at most 191 x 383 cells and find its noise floor.

    Args:
        frame: counts, shape (row, column).
        scale: size of the frame's pixel.

    Returns:
        The grid; `scale` is that of its cells.
    """
    cells, step_columns, step_rows = _halve(frame)
    cell = PixelScale(
        lateral_m=scale.lateral_m * step_columns,
        depth_m=scale.depth_m * step_rows,
        refractive_index=scale.refractive_index,
    )
    return Grid(cells, _noise_floor(cells), step_columns, step_rows, cell)


def rows_of(pixels: float, length_m: float, grid: Grid, least: int) -> int:
    """Return a length in rows of the grid: so many pixels of the frame, at most `length_m`, at least `least` rows."""
    return max(least, round(min(pixels / grid.step_rows, length_m / grid.scale.depth_m)))


def _noise_floor(cells: Pixels) -> float:
    """Return the count that a fifth of the cells that are not black lie below: noise, whatever share tissue takes."""
    sample = cells[::8, ::2].ravel()
    lit = sample[sample > int(sample.max()) // BLACK_PART]
    if not len(lit):
        return 0.0
    nth = int(FLOOR_SHARE * len(lit))
    lit.partition(nth)
    return float(lit[nth])


def _halve(frame: Pixels) -> tuple[Pixels, int, int]:
    """Average neighbours by halves (the quick case of `cv2.resize`); an odd last row or column is dropped."""
    step_columns = step_rows = 1
    while True:
        rows, columns = frame.shape
        across, down = columns >= MAX_COLUMNS, rows >= MAX_ROWS
        if not across and not down:
            return frame, step_columns, step_rows
        size = (columns // 2 if across else columns, rows // 2 if down else rows)
        frame = frame[: 2 * size[1] if down else rows, : 2 * size[0] if across else columns]
        # At exactly a half, INTER_LINEAR averages two neighbours; along one axis it is quicker than INTER_AREA.
        method = cv2.INTER_AREA if across and down else cv2.INTER_LINEAR
        frame = cast(Pixels, cv2.resize(frame, size, interpolation=method))
        step_columns *= 2 if across else 1
        step_rows *= 2 if down else 1
