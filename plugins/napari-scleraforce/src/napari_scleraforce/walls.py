"""Walls as editable paths, and back as masks.

A boundary is a path for each stretch of columns in which it is seen. Its points are
(frame, row, column), as the image layer has them: row r is the centre of a pixel.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from skimage.measure import approximate_polygon

UPPER = "upper"
LOWER = "lower"
WALL = 255
NOT_JUDGED = 128
TOLERANCE_ROWS = 0.3  # by which a path may differ from the boundary, along its normal
Points = NDArray[np.float64]
Paths = list[tuple[str, Points]]


def paths_of(frame: int, outer_row: Points, inner_row: Points | None) -> Paths:
    """Return the paths (point, 3) of a wall with boundaries in rows (column,), NaN
    where unseen; with their names.
    """
    boundaries = {UPPER: outer_row} | ({} if inner_row is None else {LOWER: inner_row})
    return [
        (
            name,
            np.insert(approximate_polygon(stretch, TOLERANCE_ROWS), 0, frame, axis=1),
        )
        for name, row in boundaries.items()
        for stretch in _stretches(np.asarray(row, float))
    ]


def _stretches(row: Points) -> Iterator[Points]:
    """Yield the seen stretches of a boundary that have two columns or more, as points
    (row, column).
    """
    columns = np.flatnonzero(np.isfinite(row))
    for part in np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1):
        if len(part) > 1:
            yield np.column_stack([row[part], part])


def mask_of(
    paths: Iterable[tuple[str, Points]], shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return the mask (row, column) of a frame's paths: 255 from the upper boundary to
    the lower one, 0 elsewhere.

    Columns without the one or the other are not judged (128). Without any lower path,
    the wall ends below the frame.
    """
    rows, columns = shape
    upper, lower = np.full((2, columns), np.nan)
    bounded = False

    for name, points in paths:
        (upper if name == UPPER else lower)[:] = _drawn(
            points, upper if name == UPPER else lower
        )
        bounded |= name == LOWER

    lower = lower if bounded else np.full(columns, float(rows))
    row = np.arange(rows)[:, None]
    mask = np.where((row >= upper) & (row < lower), np.uint8(WALL), np.uint8(0))
    mask[:, ~np.isfinite(upper + lower)] = NOT_JUDGED

    return mask


def _drawn(points: Points, row: Points) -> Points:
    """Return a boundary (column,) with a path's rows in the columns that it spans."""
    ordered = points[np.argsort(points[:, 2], kind="stable")]
    column = np.arange(len(row))
    inside = (column >= np.ceil(ordered[0, 2])) & (column <= np.floor(ordered[-1, 2]))
    return np.where(inside, np.interp(column, ordered[:, 2], ordered[:, 1]), row)
