"""The columns that boundaries are found at, and the maps between them: cached for each size of a frame."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.inner import GROUP

FINE_COLUMNS = 128
INNER_COLUMNS = 128  # at which the inner boundary is looked for
CACHED = 64  # sizes of frames: black bands at both sides may change from frame to frame


@lru_cache(maxsize=CACHED)
def fine_columns(columns: int) -> Float:
    """Return at most 128 columns of a frame, evenly spaced from the first to the last."""
    return np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)


def between(columns: int, first: int, after: int) -> slice:
    """Return which of `fine_columns` lie in the columns from `first` to before `after`."""
    start, stop = np.searchsorted(fine_columns(columns), (first - 0.5, after - 0.5))
    return slice(int(start), int(stop))


@lru_cache(maxsize=CACHED)
def nearest_point(columns: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the columns of a frame, and for each the nearest of `fine_columns`, both shape (column,)."""
    fine, at = fine_columns(columns), np.arange(columns, dtype=np.float64)
    return at, np.rint(np.interp(at, fine, np.arange(len(fine)))).astype(np.intp)


@lru_cache(maxsize=CACHED)
def continuation(columns: int, first: float, spacing: float, points: int) -> Float:
    """Return the matrix that takes a curve at evenly spaced points to `fine_columns`, shape (fine, point).

    It interpolates, and extrapolates beyond the curve's ends along their slopes (over three points: less ragged).
    """
    at, column = fine_columns(columns), first + spacing * np.arange(points)
    matrix = np.array([np.interp(at, column, unit) for unit in np.eye(points)]).T
    reach = min(3, points - 1)
    for end, other, beyond in ((0, reach, at < column[0]), (points - 1, points - 1 - reach, at > column[-1])):
        away = (at[beyond] - column[end]) / (column[end] - column[other])
        matrix[beyond] = 0.0
        matrix[beyond, end], matrix[beyond, other] = 1.0 + away, -away
    return matrix.astype(np.float32)


@lru_cache(maxsize=CACHED)
def grouping(points: int) -> tuple[NDArray[np.intp], Float]:
    """Return INNER_COLUMNS evenly spread points, and the matrix (point, group) from means of groups to all points."""
    chosen = np.arange(INNER_COLUMNS) * (points - 1) // (INNER_COLUMNS - 1)
    middle = chosen.reshape(-1, GROUP).mean(axis=1)
    matrix = np.array([np.interp(np.arange(points), middle, unit) for unit in np.eye(len(middle))]).T
    return chosen, matrix.astype(np.float32)


def grouped(values: Float) -> Float:
    """Return the means over groups of points, (group,)."""
    mean: Float = values[grouping(len(values))[0]].reshape(-1, GROUP).mean(axis=1)
    return mean
