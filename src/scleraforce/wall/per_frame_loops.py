"""The loops that are called for each frame, their tables for frames of one size, and
the columns of boundaries.

They look at a part of a frame, or take single steps near a wall that is known.
"""

from functools import lru_cache
from math import ceil
from typing import NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref

from scleraforce.base.arrays import (
    Counts,
    Flags,
    Floats,
    Indices,
    Integers,
    Places,
    Singles,
)
from scleraforce.base.compiled_loops import compiled
from scleraforce.records.scan import PixelScale
from scleraforce.wall.frame_light import (
    LEAST_SHAPE,
    GridSize,
    brighter_columns,
    grid_cells,
    grid_size,
    noise_floor,
)
from scleraforce.wall.inner_boundary import (
    CELLS,
    GROUP,
    find_thickness,
    stretch,
    unroll,
)
from scleraforce.wall.needle_in_frame import top_rows
from scleraforce.wall.outer_boundary import (
    ROWS,
    coarse_rows,
    fit_edges,
    opened_pairs,
    quantile_of_chosen,
    sample_strip,
    show_points,
    smooth_surface,
    start_rows,
    surface_score,
)
from scleraforce.wall.shared_loops import at_every_column, bridge, mean_of_neighbours
from scleraforce.wall.wall import (
    EMPTY_SHARE,
    SATURATED_LEVEL,
    SATURATED_SHARE,
    UNSEEN_DEPTH_M,
)

FINE_COLUMNS = 128
INNER_COLUMNS = 128  # at which the inner boundary is looked for
CACHED = 64  # sizes of frames: black bands at both sides may change from frame to frame
# what is thinner is a line
LINE_PIXELS = 12.0
LINE_M = 0.1e-3
# depth of tissue that a step is judged by
STEP_PIXELS = 32.0
STEP_M = 0.2e-3
PATH_COLUMNS = 30  # columns at most on which the path is searched ...
MAX_SLOPE = 2.5  # of the surface: 68 degrees
# half height of the strip in which the boundary is refined
STRIP_PIXELS = 24.0
STRIP_M = 0.15e-3
GAP_M = 1.5e-3  # a wall continues behind a gap that is narrower
GAP_SHARE = 0.15  # ... and narrower than this share of the frame
# rows above the bottom within which too little of a surface is seen: it has left the
# window
BOTTOM_ROWS = 7.0
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary


@lru_cache(maxsize=CACHED)
def fine_columns(columns: int) -> Singles:
    """Return at most 128 columns of a frame, evenly spaced from the first to the
    last.
    """
    return np.linspace(0.0, columns - 1.0, min(columns, FINE_COLUMNS), dtype=np.float32)


@lru_cache(maxsize=CACHED)
def nearest_point(columns: int) -> Integers:
    """Return the nearest of `fine_columns` to each column of a frame, (column,)."""
    fine = fine_columns(columns)
    return np.rint(
        np.interp(np.arange(columns, dtype=np.float64), fine, np.arange(len(fine)))
    ).astype(np.int64)


@lru_cache(maxsize=CACHED)
def continuation(columns: int, first: float, spacing: float, points: int) -> Singles:
    """Return the matrix (fine, point) that takes a curve at even points to
    `fine_columns`, beyond its ends by slope.
    """
    at = fine_columns(columns)
    column = first + spacing * np.arange(points)
    matrix = np.array([np.interp(at, column, unit) for unit in np.eye(points)]).T
    reach = min(3, points - 1)  # of the slopes: less ragged

    for end, other, beyond in (
        (0, reach, at < column[0]),
        (points - 1, points - 1 - reach, at > column[-1]),
    ):
        away = (at[beyond] - column[end]) / (column[end] - column[other])
        matrix[beyond] = 0.0
        matrix[beyond, end] = 1.0 + away
        matrix[beyond, other] = -away

    return matrix.astype(np.float32)


@lru_cache(maxsize=CACHED)
def grouping(points: int) -> tuple[Places, Singles]:
    """Return INNER_COLUMNS evenly spread points, and the matrix (point, group) from
    means of groups to all points.
    """
    chosen = np.arange(INNER_COLUMNS) * (points - 1) // (INNER_COLUMNS - 1)
    middle = chosen.reshape(-1, GROUP).mean(axis=1)
    matrix = np.array(
        [np.interp(np.arange(points), middle, unit) for unit in np.eye(len(middle))]
    ).T
    return chosen, matrix.astype(np.float32)


def grouped(values: Singles) -> Singles:
    """Return the means over groups of points, (group,)."""
    return values[grouping(len(values))[0]].reshape(-1, GROUP).mean(axis=1)


class FrameTables(NamedTuple):
    """Lengths in rows and columns, and constant arrays, for the imaged part of frames
    of one size and scale.
    """

    width: int
    step_rows: int
    top_rows: int
    line_rows: int  # of the opening that removes lines from the grid
    judged_rows: int  # of the path's map, that a step is judged by
    # largest step of the path, in rows of its map, from one pair of columns to the next
    reach: int
    strip_half: int  # height of the strip in which the boundary is refined
    strip_line: int  # of the opening there
    widest_gap: int  # in points, that the wall bridges
    point_m: float
    tissue_depth_m: float
    pairs: Indices  # columns of the grid, by turns
    downwards: (
        Singles  # a bonus of each row that is too small to outweigh anything seen
    )
    column: Singles
    columns: Indices  # before and after each point, (2, point)
    across: Singles
    looked_at: Integers
    looked_columns: Indices
    looked_across: Singles
    place: Integers
    weight: Singles
    group: Integers
    group_weight: Singles
    nearest: Integers


@structref.register
class _WorkplaceType(types.StructRef):
    """The type of a workplace, for Numba."""


class Workplace(structref.StructRefProxy):
    """Tables as one argument of a loop (each array would take 60 us a call); made by
    cached compiled code only.
    """

    tables: FrameTables


structref.define_proxy(Workplace, _WorkplaceType, ["tables"])


@compiled
def _new_workplace(tables: FrameTables) -> Workplace:
    return Workplace(tables)


@lru_cache(maxsize=CACHED)
def workplace_for(
    rows: int, width: int, lateral_m: float, depth_m: float, refractive_index: float
) -> Workplace:
    """Return the tables for the imaged part of frames: `rows` and `width` columns of
    one scale (`PixelScale`).
    """
    scale = PixelScale(
        lateral_m=lateral_m, depth_m=depth_m, refractive_index=refractive_index
    )
    grid = grid_size(rows, width, scale)
    column = fine_columns(width)
    # of pairs of the grid's columns
    first = np.arange(0, grid.columns - 1, max(2, ceil(grid.columns / PATH_COLUMNS)))
    # of pairs, in columns of the frame
    middle = ((first + 1.0) * grid.step_columns - 0.5).astype(np.float32)
    spacing = float(middle[1] - middle[0])
    reach = ceil(
        MAX_SLOPE
        * (spacing / grid.step_columns * grid.scale.lateral_m)
        / (ROWS * grid.scale.depth_m)
    )
    point_m = float(column[1] - column[0]) * scale.lateral_m
    looked_at, groups = grouping(len(column))
    before = np.floor(column).astype(np.intp)
    columns = np.minimum([before, before + 1], width - 1).astype(np.uintp)
    across = column - before.astype(np.float32)
    place, weight = _two_of_each(
        continuation(width, float(middle[0]), spacing, len(middle))
    )
    group, group_weight = _two_of_each(groups)
    map_rows = grid.rows // ROWS
    tables = FrameTables(
        width=width,
        step_rows=grid.step_rows,
        top_rows=top_rows(grid),
        line_rows=_rows_of(LINE_PIXELS, LINE_M, grid, 1)
        + 2,  # an opening touches one row more
        judged_rows=_rows_of(STEP_PIXELS / ROWS, STEP_M / ROWS, grid, 3),
        reach=min(max(2, reach), map_rows // 3),
        strip_half=max(4, round(min(STRIP_PIXELS, STRIP_M / scale.depth_m))),
        strip_line=max(2, round(min(LINE_PIXELS, LINE_M / scale.depth_m))),
        widest_gap=round(min(GAP_M / point_m, GAP_SHARE * len(column))),
        point_m=point_m,
        tissue_depth_m=scale.depth_m / scale.refractive_index,
        pairs=np.stack([first, first + 1], axis=1).ravel().astype(np.uintp),
        downwards=np.linspace(0.0, 2e-3, map_rows, endpoint=False, dtype=np.float32),
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

    return _new_workplace(tables)


def _rows_of(pixels: float, length_m: float, size: GridSize, least: int) -> int:
    """Return a length in rows of a grid: pixels of the frame, at most `length_m`, at
    least `least` rows.
    """
    return max(
        least, round(min(pixels / size.step_rows, length_m / size.scale.depth_m))
    )


def _two_of_each(matrix: Singles) -> tuple[Integers, Singles]:
    """Return the places of the (at most two) nonzero values in each row of a matrix,
    and these, (row, 2).
    """
    place = np.sort(
        np.argsort(matrix == 0.0, axis=1, kind="stable")[:, :2], axis=1
    ).astype(np.int64)
    return place, np.take_along_axis(matrix, place, axis=1)


@compiled
def find_boundaries(
    frame: Counts,
    first: int,
    eight_bits: bool,
    brightest: int,
    missing: Flags,
    behind: tuple[int, int],
    workplace: Workplace,
    left: int,
    rows: Floats,
) -> tuple[Counts, int, bool, Integers, int, float, float, float]:
    """Look for the wall in a frame's columns from the first one on; write its
    boundaries from `left` on (2, column).

    `eight_bits`: see `grid_cells`; `brightest`: largest count, 0 to look whatever the
    frame shows; `missing` columns have been filled from beside; `behind`: the first
    point of the surface that a needle hides, and the first after.

    Returns:
        The columns as cells, their noise floor, whether the detector is saturated, and
        where a needle may begin; the number of points that show the surface, its median
        contrast in these, the noise of a pixel, and the wall's median thickness, m, NaN
        if its inner boundary was not found. The number is -1 if the detector is
        saturated, a needle may be there or the frame is empty; nothing is written for
        less than LEAST_SHAPE.
    """
    tables = workplace.tables
    cells = grid_cells(frame, first, tables.width, eight_bits)
    floor = noise_floor(cells)
    bright = int(SATURATED_LEVEL * brightest)
    saturated = some = 0

    for row in range(0, cells.shape[0], 8):
        for column in range(0, cells.shape[1], 4):
            saturated += cells[row, column] >= bright
            some += 1

    begin = brighter_columns(cells, tables.top_rows)
    flooded = saturated > SATURATED_SHARE * some
    if brightest > 0 and (
        len(begin) or flooded or brightest - floor < EMPTY_SHARE * brightest
    ):
        return cells, floor, flooded, begin, -1, np.nan, np.nan, np.nan

    tissue = opened_pairs(cells, floor, tables.pairs, tables.line_rows)
    path = coarse_rows(
        surface_score(tissue, tables.judged_rows, tables.downwards), tables.reach
    )
    start = start_rows(
        path, tables.step_rows, tables.place, tables.weight, frame.shape[0]
    )
    row, contrast, noise = _fit_strip(frame, first, start, behind, tables)
    present = show_points(
        row,
        contrast,
        missing,
        tables.column,
        frame.shape[0] - BOTTOM_ROWS,
        tables.widest_gap,
    )
    shown = present.copy()
    seen = 0

    for at in range(len(row)):
        shown[at] = present[at] and not behind[0] <= at < behind[1]
        seen += shown[at]

    typical = np.float64(quantile_of_chosen(contrast, shown, 0.5))
    if seen < LEAST_SHAPE:
        return cells, floor, flooded, begin, seen, typical, noise, np.nan

    inner, thickness_m = _find_inner(
        frame, first, floor, tables, bridge(row, present), present
    )
    rows[:] = np.nan
    at_every_column(
        tables.column, row, present, tables.nearest, rows[0, left : left + tables.width]
    )
    at_every_column(
        tables.column,
        inner,
        present,
        tables.nearest,
        rows[1, left : left + tables.width],
    )

    return cells, floor, flooded, begin, seen, typical, noise, thickness_m


@compiled
def _fit_strip(
    frame: Counts,
    first: int,
    start: Singles,
    behind: tuple[int, int],
    tables: FrameTables,
) -> tuple[Singles, Singles, float]:
    """Move a surface from its start to the edge of the full frame; return rows,
    contrast and the noise of a pixel.
    """
    raw, noise = sample_strip(
        frame, first, tables.columns, tables.across, start, tables.strip_half
    )
    row, contrast = fit_edges(raw, tables.strip_line, start)

    if behind[0] == behind[1]:
        smooth_surface(row)
    else:
        smooth_surface(row[: behind[0]])
        smooth_surface(row[behind[1] :])

    return row, mean_of_neighbours(contrast, 2), noise


@compiled
def _find_inner(
    frame: Counts,
    first: int,
    floor: int,
    tables: FrameTables,
    row: Singles,
    present: Flags,
) -> tuple[Singles, float]:
    """Return the inner boundary's rows below a surface without gaps, and the median
    thickness, NaN: not found.
    """
    along_rows = stretch(row, tables.point_m, tables.tissue_depth_m)
    thickness_m = np.empty_like(row)
    prior = np.zeros((len(tables.looked_at) // GROUP, CELLS + 1), np.float32)

    group_m, _, support = _search_below(
        frame, first, floor, tables, row, present, along_rows, prior
    )
    if support < FOUND_SHARE:
        return row + np.float32(UNSEEN_DEPTH_M / tables.tissue_depth_m), np.nan

    inner = np.empty_like(row)
    for at in range(len(row)):
        one = np.float64(tables.group_weight[at, 0]) * np.float64(
            group_m[tables.group[at, 0]]
        )
        other = np.float64(tables.group_weight[at, 1]) * np.float64(
            group_m[tables.group[at, 1]]
        )
        thickness_m[at] = np.float32(one + other)
        inner[at] = along_rows[at] * thickness_m[at] + row[at]

    return inner, np.float64(quantile_of_chosen(thickness_m, present, 0.5))


@compiled
def _search_below(
    frame: Counts,
    first: int,
    floor: int,
    tables: FrameTables,
    row: Singles,
    present: Flags,
    along_rows: Singles,
    prior: Singles,
) -> tuple[Singles, Flags, float]:
    """Return the wall's thickness at each group, which groups show its end, and their
    share: see `find_thickness`.
    """
    at = tables.looked_at
    columns = tables.looked_columns
    across = tables.looked_across
    return find_thickness(
        *unroll(
            frame, first, floor, columns, across, row[at], present[at], along_rows[at]
        ),
        prior,
    )


@compiled
def edge_near(
    frame: Counts, first: int, start: Singles, workplace: Workplace
) -> Singles:
    """Return the edge of the full frame that lies nearest to a surface, both (point,),
    in rows.
    """
    return _fit_strip(frame, first, start, (0, 0), workplace.tables)[0]


@compiled
def thickness_below(
    frame: Counts,
    first: int,
    eight_bits: bool,
    row: Singles,
    present: Flags,
    along_rows: Singles,
    prior: Singles,
    workplace: Workplace,
) -> tuple[Singles, Flags]:
    """Return the thickness below a surface without NaN at each group of points, m, and
    which groups show its end.
    """
    tables = workplace.tables
    floor = noise_floor(grid_cells(frame, first, tables.width, eight_bits))
    thickness_m, shown, _ = _search_below(
        frame, first, floor, tables, row, present, along_rows, prior
    )
    return thickness_m, shown
