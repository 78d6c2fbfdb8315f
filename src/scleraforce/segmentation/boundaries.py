"""The loops that are called for each frame: a look at a part of it, and single steps near a wall that is known."""

import numpy as np

from scleraforce.arrays import Counts, Flags, Floats, Integers
from scleraforce.compiled import compiled
from scleraforce.segmentation.found import EMPTY_SHARE, SATURATED_LEVEL, SATURATED_SHARE, UNSEEN_DEPTH_M
from scleraforce.segmentation.grid import LEAST_SHAPE, Float
from scleraforce.segmentation.inner import CELLS, GROUP, find_thickness, stretch, unroll
from scleraforce.segmentation.light import brighter_columns, grid_cells, noise_floor
from scleraforce.segmentation.loops import at_every_column, bridge, mean_of_neighbours
from scleraforce.segmentation.surface import (
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
from scleraforce.segmentation.tables import Tables, Workplace

BOTTOM_ROWS = 7.0  # of a surface this close to the last row too little is seen: it has left the window
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary


@compiled
def look(
    frame: Counts, first: int, eight_bits: bool, brightest: int, missing: Flags, behind: tuple[int, int],
    workplace: Workplace, left: int, rows: Floats,
) -> tuple[Counts, int, bool, Integers, int, float, float, float]:  # fmt: skip
    """Look for the wall in a frame's columns from the first one on; write its boundaries (2, column).

    They are NaN without wall; the frame's first column is the `left` one there.

    `eight_bits`: see `grid_cells`; `brightest`: largest count, 0 to look whatever the frame shows; `missing` are
    columns that have been filled from beside, `behind` the first point of the surface that a needle hides, and the
    first one after.

    Returns:
        The columns as cells, their noise floor, whether the detector is saturated, and where a needle may begin; the
            number of points that show the surface, its median contrast in these, the noise of a pixel, and the
            wall's median thickness, m, NaN if its inner boundary was not found. The number is -1 if the detector is
            saturated, a needle may be there or the frame is empty; nothing is written for less than LEAST_SHAPE.
    """
    tables = workplace.tables
    cells = grid_cells(frame, first, tables.width, eight_bits)
    floor, bright = noise_floor(cells), int(SATURATED_LEVEL * brightest)
    saturated = some = 0
    for row in range(0, cells.shape[0], 8):
        for column in range(0, cells.shape[1], 4):
            saturated += cells[row, column] >= bright
            some += 1
    begin, flooded = brighter_columns(cells, tables.top_rows), saturated > SATURATED_SHARE * some
    if brightest > 0 and (len(begin) or flooded or brightest - floor < EMPTY_SHARE * brightest):
        return cells, floor, flooded, begin, -1, np.nan, np.nan, np.nan
    tissue = opened_pairs(cells, floor, tables.pairs, tables.line_rows)
    path = coarse_rows(surface_score(tissue, tables.judged_rows, tables.downwards), tables.reach)
    start = start_rows(path, tables.step_rows, tables.place, tables.weight, frame.shape[0])
    row, contrast, noise = _fit_strip(frame, first, start, behind, tables)
    present = show_points(row, contrast, missing, tables.column, frame.shape[0] - BOTTOM_ROWS, tables.widest_gap)
    shown, seen = present.copy(), 0
    for at in range(len(row)):
        shown[at] = present[at] and not behind[0] <= at < behind[1]
        seen += shown[at]
    typical = np.float64(quantile_of_chosen(contrast, shown, 0.5))
    if seen < LEAST_SHAPE:
        return cells, floor, flooded, begin, seen, typical, noise, np.nan
    inner, thickness_m = _find_inner(frame, first, floor, tables, bridge(row, present), present)
    rows[:] = np.nan
    at_every_column(tables.column, row, present, tables.nearest, rows[0, left : left + tables.width])
    at_every_column(tables.column, inner, present, tables.nearest, rows[1, left : left + tables.width])
    return cells, floor, flooded, begin, seen, typical, noise, thickness_m


@compiled
def _fit_strip(
    frame: Counts, first: int, start: Float, behind: tuple[int, int], tables: Tables
) -> tuple[Float, Float, float]:
    """Move a surface from its start to the edge of the full frame; return rows, contrast and the noise of a pixel."""
    raw, noise = sample_strip(frame, first, tables.columns, tables.across, start, tables.strip_half)
    row, contrast = fit_edges(raw, tables.strip_line, start)
    if behind[0] == behind[1]:
        smooth_surface(row)
    else:
        smooth_surface(row[: behind[0]])
        smooth_surface(row[behind[1] :])
    return row, mean_of_neighbours(contrast, 2), noise


@compiled
def _find_inner(
    frame: Counts, first: int, floor: int, tables: Tables, row: Float, present: Flags
) -> tuple[Float, float]:
    """Return the inner boundary's rows below a surface without gaps, and the median thickness, NaN: not found."""
    along_rows, thickness_m = stretch(row, tables.point_m, tables.tissue_depth_m), np.empty_like(row)
    prior = np.zeros((len(tables.looked_at) // GROUP, CELLS + 1), np.float32)
    group_m, _, support = _search_below(frame, first, floor, tables, row, present, along_rows, prior)
    if support < FOUND_SHARE:
        return row + np.float32(UNSEEN_DEPTH_M / tables.tissue_depth_m), np.nan
    inner = np.empty_like(row)
    for at in range(len(row)):
        one = np.float64(tables.group_weight[at, 0]) * np.float64(group_m[tables.group[at, 0]])
        other = np.float64(tables.group_weight[at, 1]) * np.float64(group_m[tables.group[at, 1]])
        thickness_m[at] = np.float32(one + other)
        inner[at] = along_rows[at] * thickness_m[at] + row[at]
    return inner, np.float64(quantile_of_chosen(thickness_m, present, 0.5))


@compiled
def _search_below(
    frame: Counts, first: int, floor: int, tables: Tables, row: Float, present: Flags, along_rows: Float, prior: Float
) -> tuple[Float, Flags, float]:
    """Return the wall's thickness at each group, which groups show its end, and their share: see `find_thickness`."""
    at = tables.looked_at
    wall, seen = unroll(
        frame, first, floor, tables.looked_columns, tables.looked_across, row[at], present[at], along_rows[at]
    )
    return find_thickness(wall, seen, prior)


@compiled
def edge_near(frame: Counts, first: int, start: Float, workplace: Workplace) -> Float:
    """Return the edge of the full frame that lies nearest to a surface, both (point,), in rows."""
    return _fit_strip(frame, first, start, (0, 0), workplace.tables)[0]


@compiled
def thickness_below(
    frame: Counts, first: int, eight_bits: bool, row: Float, present: Flags, along_rows: Float, prior: Float,
    workplace: Workplace,
) -> tuple[Float, Flags]:  # fmt: skip
    """Return the thickness below a surface without NaN at each group of points, m, and which groups show its end."""
    tables = workplace.tables
    floor = noise_floor(grid_cells(frame, first, tables.width, eight_bits))
    thickness_m, shown, _ = _search_below(frame, first, floor, tables, row, present, along_rows, prior)
    return thickness_m, shown
