"""The columns that boundaries are found at, and the maps between them: the same for every frame of a size, so kept."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.segmentation.grid import Float

FINE_COLUMNS = 128
KEPT = 64  # sizes of frames: black bands at both sides may change from frame to frame


@lru_cache(maxsize=KEPT)
def fine_columns(columns: int) -> Float:
    """Return at most 128 columns of a frame with so many, evenly spaced from the first to the last."""
    return np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)


def between(columns: int, first: int, after: int) -> slice:
    """Return which of `fine_columns` lie in the columns from `first` to before `after`."""
    start, stop = np.searchsorted(fine_columns(columns), (first - 0.5, after - 0.5))
    return slice(int(start), int(stop))


@lru_cache(maxsize=KEPT)
def repeated(columns: int, rows: int) -> Float:
    """Return `fine_columns` once for each of so many rows, shape (row, point)."""
    return np.repeat(fine_columns(columns)[None], rows, axis=0)


@lru_cache(maxsize=KEPT)
def nearest_point(columns: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the columns of a frame, and for each the nearest of `fine_columns`, both shape (column,)."""
    fine, at = fine_columns(columns), np.arange(columns, dtype=np.float64)
    return at, np.rint(np.interp(at, fine, np.arange(len(fine)))).astype(np.intp)


@lru_cache(maxsize=KEPT)
def continuation(columns: int, first: float, spacing: float, points: int) -> Float:
    """Return the matrix that takes a curve at evenly spaced points to `fine_columns`, shape (fine, point).

    It interpolates, and goes on beyond the curve's ends along their slopes (over three points: less ragged).
    """
    at, column = fine_columns(columns), first + spacing * np.arange(points)
    matrix = np.array([np.interp(at, column, unit) for unit in np.eye(points)]).T
    reach = min(3, points - 1)
    for end, other, beyond in ((0, reach, at < column[0]), (points - 1, points - 1 - reach, at > column[-1])):
        away = (at[beyond] - column[end]) / (column[end] - column[other])
        matrix[beyond] = 0.0
        matrix[beyond, end], matrix[beyond, other] = 1.0 + away, -away
    return matrix.astype(np.float32)


@lru_cache(maxsize=KEPT)
def interpolation(points: int, at: int, group: int) -> tuple[NDArray[np.intp], Float]:
    """Return `at` evenly spread ones of so many points, and the matrix from means of groups of these to the points.

    Shapes (at,) and (point, at / group).
    """
    chosen = np.arange(at) * (points - 1) // (at - 1)
    middle = chosen.reshape(-1, group).mean(axis=1)
    matrix = np.array([np.interp(np.arange(points), middle, unit) for unit in np.eye(len(middle))]).T
    return chosen, matrix.astype(np.float32)


def bridged(row: Float, there: NDArray[np.bool_]) -> Float:
    """Return a curve with straight lines over what is not there."""
    if np.count_nonzero(there) == len(there):
        return row
    at = np.arange(len(row))
    bridged: Float = np.interp(at, at[there], row[there]).astype(np.float32)
    return bridged


def at_columns(
    columns: int, left: int, width: int, there: NDArray[np.bool_], *curves: Float
) -> tuple[NDArray[np.float64], ...]:
    """Return curves at the columns of a frame whose imaged part starts at `left` and is so wide.

    NaN outside of that part, and where the nearest point is not there.
    """
    fine, (at, nearest) = fine_columns(width), nearest_point(width)
    known = there[nearest]
    whole = np.count_nonzero(known) == width
    filled = []
    for rows in curves:
        curve = np.empty(columns)
        curve[:left] = curve[left + width :] = np.nan
        curve[left : left + width] = np.interp(at, fine, rows) if whole else np.interp(at, fine[there], rows[there])
        if not whole:
            curve[left : left + width][~known] = np.nan
        filled.append(curve)
    return tuple(filled)
