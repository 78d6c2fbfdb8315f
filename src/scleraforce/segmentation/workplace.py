"""Sizes, tables and memory of the loops, for frames of one size."""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation import surface
from scleraforce.segmentation.columns import INNER_COLUMNS, continuation, fine_columns, grouping, nearest_point
from scleraforce.segmentation.grid import MAX_COLUMNS, MAX_ROWS, Float, GridSize, grid_size
from scleraforce.segmentation.inner import CELLS, GROUP, slope_reach
from scleraforce.segmentation.loops import BINS
from scleraforce.segmentation.needle import top_rows

Counts = NDArray[np.uint16]
Double = NDArray[np.float64]
Places = NDArray[np.int64]
Indices = NDArray[np.uintp]  # not negative: Numba need not ask
Flags = NDArray[np.bool_]

GROUPS = INNER_COLUMNS // GROUP
BEYOND = 8  # points by which a surface is made longer while it is smoothed


class Sizes(NamedTuple):
    """Lengths of the steps, for a frame's size and scale."""

    width: int
    grid_rows: int
    grid_columns: int
    step_rows: int
    top_rows: int
    line_rows: int
    judged_rows: int
    reach: int
    strip_line: int
    slope_reach: int
    rise: float
    tissue_depth_m: float
    widest_gap: int


class Tables(NamedTuple):
    """Arrays that stay as they are."""

    pairs: Indices
    downwards: Float
    column: Float
    columns: Indices  # before and after each point, (2, point)
    across: Float
    looked_columns: Indices
    looked_across: Float
    place: Places
    weight: Float
    looked_at: Places
    group: Places
    group_weight: Float
    nearest: Places


class Memory(NamedTuple):
    """Arrays that the loops write into; their content from the frame before is never used."""

    halves: Counts
    other_halves: Counts
    sample: Counts
    bins: Places
    cell_column: Float  # (2, column of the grid)
    eroded: Counts
    opened: Counts
    tissue: Counts
    level: Float
    means: Float
    pair_total: Double
    lowest: Float
    score: Float
    four: Float  # (3, pair, row / 4)
    path: Places
    coarse: Float
    strip: Float  # (3, row * point)
    rows: Indices  # (2, point)
    down: Float
    point: Float  # (6, point)
    point_double: Double  # (3, point)
    shown: Flags  # (3, point)
    longer: Float  # (2, point + BEYOND)
    looked: Float  # (4, point that is looked at)
    looked_there: Flags
    cells: Float  # (6, group, cell)
    edges: Float  # (5, group, edge)
    edge: Float  # (2, edge)
    group: Float  # (7, group)
    group_path: Places
    prior: Float  # (group, edge)
    sizes: Float


@structref.register
class _WorkplaceType(types.StructRef):
    """The type of a workplace, for Numba."""


class Workplace(structref.StructRefProxy):
    """All of them as one argument of a loop: passing so many arrays would take 60 us a call.

    Made by a compiled function only, whose code is cached.
    """

    sizes: Sizes
    tables: Tables
    memory: Memory


structref.define_proxy(Workplace, _WorkplaceType, ["sizes", "tables", "memory"])


@compiled
def _new_workplace(sizes: Sizes, tables: Tables, memory: Memory) -> Workplace:
    return Workplace(sizes, tables, memory)


def workplace_for(rows: int, width: int, scale: PixelScale) -> Workplace:
    """Return the workplace for the imaged part of frames: `rows` and `width` columns of one scale."""
    grid = grid_size(rows, width, scale)
    middle, pairs = surface.pairs_of(grid.columns, grid.step_columns)
    column = fine_columns(width)
    half, strip_line = surface.strip_rows(scale)
    depth_m, point_m = scale.depth_m / scale.refractive_index, float(column[1] - column[0]) * scale.lateral_m
    reach = slope_reach(len(column), point_m)
    sizes = Sizes(
        width=width,
        grid_rows=grid.rows,
        grid_columns=grid.columns,
        step_rows=grid.step_rows,
        top_rows=top_rows(grid),
        line_rows=surface.line_rows(grid),
        judged_rows=surface.step_rows(grid),
        reach=surface.path_reach(grid),
        strip_line=strip_line,
        slope_reach=reach,
        rise=depth_m / (2 * reach * point_m),
        tissue_depth_m=depth_m,
        widest_gap=surface.widest_gap(len(column), point_m),
    )
    looked_at, groups = grouping(len(column))
    before = np.floor(column).astype(np.intp)
    columns, across = np.minimum([before, before + 1], width - 1).astype(np.uintp), column - before.astype(np.float32)
    place, weight = _two_of_each(continuation(width, float(middle[0]), float(middle[1] - middle[0]), len(middle)))
    group, group_weight = _two_of_each(groups)
    tables = Tables(
        pairs=pairs.astype(np.uintp),
        downwards=surface.downwards(grid.rows // surface.ROWS),
        column=column,
        columns=columns,
        across=across,
        looked_columns=np.ascontiguousarray(columns[:, looked_at]),
        looked_across=across[looked_at],
        place=place,
        weight=weight,
        looked_at=looked_at.astype(np.int64),
        group=group,
        group_weight=group_weight,
        nearest=nearest_point(width)[1].astype(np.int64),
    )
    memory = _memory(rows, width, grid, len(middle), 2 * half, sizes.judged_rows, len(column))
    return _new_workplace(sizes, tables, memory)


def _two_of_each(matrix: Float) -> tuple[Places, Float]:
    """Return the places of the (at most two) nonzero values in each row of a matrix, and these, (row, 2)."""
    place = np.sort(np.argsort(matrix == 0.0, axis=1, kind="stable")[:, :2], axis=1).astype(np.int64)
    return place, np.take_along_axis(matrix, place, axis=1)


def _memory(rows: int, width: int, grid: GridSize, pairs: int, strip: int, judged_rows: int, points: int) -> Memory:
    """Return the memory for frames of `rows` and `width` columns, whose grid, pairs, strip and points are so large."""
    grid_rows, grid_columns = grid.rows, grid.columns
    half_rows = grid_rows // surface.ROWS
    halved = (rows // 2 if rows >= MAX_ROWS else rows), (width // 2 if width >= MAX_COLUMNS else width)
    single, double, counts = np.float32, np.float64, np.uint16
    return Memory(
        halves=np.empty(halved, counts),
        other_halves=np.empty(halved, counts),
        sample=np.empty(grid_rows * grid_columns, counts),
        bins=np.empty(BINS, np.int64),
        cell_column=np.empty((2, grid_columns), single),
        eroded=np.empty(grid_rows * 2 * pairs, counts),
        opened=np.empty(grid_rows * 2 * pairs, counts),
        tissue=np.empty((half_rows, pairs), counts),
        level=np.empty((half_rows, pairs), single),
        means=np.empty((half_rows + judged_rows, pairs), single),
        pair_total=np.empty(pairs, double),
        lowest=np.empty(pairs, single),
        score=np.empty((pairs, half_rows), single),
        four=np.empty((3, pairs, half_rows // 4), single),
        path=np.empty(pairs, np.int64),
        coarse=np.empty(pairs, single),
        strip=np.empty((3, strip * points), single),
        rows=np.empty((2, INNER_COLUMNS), np.uintp),
        down=np.empty(INNER_COLUMNS, single),
        point=np.empty((6, points), single),
        point_double=np.empty((3, points), double),
        shown=np.empty((3, points), np.bool_),
        longer=np.empty((2, points + BEYOND), single),
        looked=np.empty((4, INNER_COLUMNS), single),
        looked_there=np.empty(INNER_COLUMNS, np.bool_),
        cells=np.empty((6, GROUPS, CELLS), single),
        edges=np.empty((5, GROUPS, CELLS + 1), single),
        edge=np.empty((2, CELLS + 1), single),
        group=np.empty((7, GROUPS), single),
        group_path=np.empty(GROUPS, np.int64),
        prior=np.zeros((GROUPS, CELLS + 1), single),
        sizes=np.empty(GROUPS * (CELLS + 1), single),
    )
