"""The loops of `mechanics.slices` that draw many slices: compiled, with the same roundings."""

import numpy as np

from scleraforce.arrays import Bytes, Floats
from scleraforce.compiled import compiled
from scleraforce.mechanics.slices import SNAP, WALL


@compiled
def draw_contours(contours: Floats, rows: int, columns: int) -> Bytes:
    """Return pictures (slice, row, column) of closed contours (slice, 2, point) in pixels.

    The centre of column c, row r is at (c, r). A pixel is wall where its contour winds around its centre.
    """
    images, winding = np.zeros((len(contours), rows, columns), np.uint8), np.empty((rows, columns), np.int64)
    for n in range(len(images)):
        winding[:] = 0
        x, y = contours[n, 0], contours[n, 1]
        for edge in range(len(x) - 1):
            start = int(min(max(np.ceil(x[edge]), 0.0), columns))
            end = int(min(max(np.ceil(x[edge + 1]), 0.0), columns))
            if start == end:
                continue
            step = 1 if end > start else -1
            slope = (y[edge + 1] - y[edge]) / (x[edge + 1] - x[edge])
            for column in range(min(start, end), max(start, end)):
                row = y[edge] + (column - x[edge]) * slope
                below = int(min(max(np.ceil(row - 0.5 / SNAP), 0.0), rows))
                if below < rows:
                    winding[below, column] += step
        for column in range(columns):
            count = 0
            for row in range(rows):
                count += winding[row, column]
                if count != 0:
                    images[n, row, column] = WALL
    return images
