"""Lengths and tables of the loops for frames of one size, and the columns that boundaries are found at."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref

from scleraforce.arrays import Indices, Integers, Places
from scleraforce.compiled import compiled
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation import surface
from scleraforce.segmentation.grid import Float, grid_size
from scleraforce.segmentation.inner import GROUP
from scleraforce.segmentation.needle import top_rows

FINE_COLUMNS = 128
INNER_COLUMNS = 128  # at which the inner boundary is looked for
CACHED = 64  # sizes of frames: black bands at both sides may change from frame to frame


@lru_cache(maxsize=CACHED)
def fine_columns(columns: int) -> Float:
    """Return at most 128 columns of a frame, evenly spaced from the first to the last."""
    return np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)


@lru_cache(maxsize=CACHED)
def nearest_point(columns: int) -> Integers:
    """Return the nearest of `fine_columns` to each column of a frame, (column,)."""
    fine = fine_columns(columns)
    return np.rint(np.interp(np.arange(columns, dtype=np.float64), fine, np.arange(len(fine)))).astype(np.int64)


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
def grouping(points: int) -> tuple[Places, Float]:
    """Return INNER_COLUMNS evenly spread points, and the matrix (point, group) from means of groups to all points."""
    chosen = np.arange(INNER_COLUMNS) * (points - 1) // (INNER_COLUMNS - 1)
    middle = chosen.reshape(-1, GROUP).mean(axis=1)
    matrix = np.array([np.interp(np.arange(points), middle, unit) for unit in np.eye(len(middle))]).T
    return chosen, matrix.astype(np.float32)


def grouped(values: Float) -> Float:
    """Return the means over groups of points, (group,)."""
    return values[grouping(len(values))[0]].reshape(-1, GROUP).mean(axis=1)


class Tables(NamedTuple):
    """Lengths in rows and columns, and constant arrays, for the imaged part of frames of one size and scale."""

    width: int
    step_rows: int
    top_rows: int
    line_rows: int
    judged_rows: int
    reach: int
    strip_half: int
    strip_line: int
    widest_gap: int
    point_m: float
    tissue_depth_m: float
    pairs: Indices
    downwards: Float
    column: Float
    columns: Indices  # before and after each point, (2, point)
    across: Float
    looked_at: Integers
    looked_columns: Indices
    looked_across: Float
    place: Integers
    weight: Float
    group: Integers
    group_weight: Float
    nearest: Integers


@structref.register
class _WorkplaceType(types.StructRef):
    """The type of a workplace, for Numba."""


class Workplace(structref.StructRefProxy):
    """Tables as one argument of a loop: passing each array would take 60 us a call.

    Made by a compiled function only, whose code is cached.
    """

    tables: Tables


structref.define_proxy(Workplace, _WorkplaceType, ["tables"])


@compiled
def _new_workplace(tables: Tables) -> Workplace:
    return Workplace(tables)


@lru_cache(maxsize=CACHED)
def workplace_for(rows: int, width: int, lateral_m: float, depth_m: float, refractive_index: float) -> Workplace:
    """Return the tables for the imaged part of frames: `rows` and `width` columns of one scale (`PixelScale`)."""
    scale = PixelScale(lateral_m=lateral_m, depth_m=depth_m, refractive_index=refractive_index)
    grid = grid_size(rows, width, scale)
    middle, pairs = surface.pairs_of(grid.columns, grid.step_columns)
    column = fine_columns(width)
    strip_half, strip_line = surface.strip_rows(scale)
    point_m = float(column[1] - column[0]) * scale.lateral_m
    looked_at, groups = grouping(len(column))
    before = np.floor(column).astype(np.intp)
    columns, across = np.minimum([before, before + 1], width - 1).astype(np.uintp), column - before.astype(np.float32)
    place, weight = _two_of_each(continuation(width, float(middle[0]), float(middle[1] - middle[0]), len(middle)))
    group, group_weight = _two_of_each(groups)
    return _new_workplace(
        Tables(
            width=width,
            step_rows=grid.step_rows,
            top_rows=top_rows(grid),
            line_rows=surface.line_rows(grid),
            judged_rows=surface.step_rows(grid),
            reach=surface.path_reach(grid),
            strip_half=strip_half,
            strip_line=strip_line,
            widest_gap=surface.widest_gap(len(column), point_m),
            point_m=point_m,
            tissue_depth_m=scale.depth_m / scale.refractive_index,
            pairs=pairs.astype(np.uintp),
            downwards=surface.downwards(grid.rows // surface.ROWS),
            column=column,
            columns=columns,
            across=across,
            looked_at=looked_at.astype(np.int64),
            looked_columns=np.ascontiguousarray(columns[:, looked_at]),
            looked_across=across[looked_at],
            place=place,
            weight=weight,
            group=group,
            group_weight=group_weight,
            nearest=nearest_point(width),
        )
    )


def _two_of_each(matrix: Float) -> tuple[Integers, Float]:
    """Return the places of the (at most two) nonzero values in each row of a matrix, and these, (row, 2)."""
    place = np.sort(np.argsort(matrix == 0.0, axis=1, kind="stable")[:, :2], axis=1).astype(np.int64)
    return place, np.take_along_axis(matrix, place, axis=1)
