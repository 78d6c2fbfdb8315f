"""The loops that are called for each frame: a glance at a part of it, and the boundaries in it."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.found import EMPTY_SHARE, SATURATED_LEVEL, SATURATED_SHARE, UNSEEN_DEPTH_M
from scleraforce.segmentation.grid import LEAST_SHAPE, Float
from scleraforce.segmentation.inner import find_jumps, find_thickness, score_jumps, stretch, unroll
from scleraforce.segmentation.light import find_lit, grid_cells, noise_floor, stands_out
from scleraforce.segmentation.loops import at_every_column, bridge, mean_of_neighbours
from scleraforce.segmentation.surface import (
    ABSENT_SHARE,
    ROWS,
    TYPICAL,
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
from scleraforce.segmentation.workplace import Memory, Sizes, Tables, Workplace

Counts = NDArray[np.uint16]
Flags = NDArray[np.bool_]
Double = NDArray[np.float64]

BOTTOM_ROWS = 7.0  # of a surface this close to the last row too little is seen: it has left the window
FOUND_SHARE = 2 / 3  # of the columns must show the inner boundary
_ONE_HALF = np.float32(0.5)


@compiled
def glance(
    frame: Counts, first: int, eight_bits: bool, brightest: int, workplace: Workplace
) -> tuple[Counts, int, bool, bool]:
    """Return a frame's columns from the first one on as cells, their noise floor, and two warnings.

    The warnings are whether the detector is saturated, and whether a needle may be there. `eight_bits`: see
    `grid_cells`; `brightest`: largest count.
    """
    sizes, memory = workplace.sizes, workplace.memory
    rows, columns = sizes.grid_rows, sizes.grid_columns
    cells = grid_cells(frame, first, sizes.width, eight_bits, memory.halves, memory.other_halves)
    floor, bright = noise_floor(cells, rows, columns, memory.sample, memory.bins), int(SATURATED_LEVEL * brightest)
    saturated = some = 0
    for row in range(0, rows, 8):
        for column in range(0, columns, 4):
            saturated += cells[row, column] >= bright
            some += 1
    needle = stands_out(cells, min(sizes.top_rows, rows), columns, memory.cell_column[0], memory.cell_column[1])
    return cells, floor, saturated > SATURATED_SHARE * some, needle


@compiled
def find_boundaries(
    frame: Counts, first: int, cells: Counts, floor: int, missing: Flags, behind: tuple[int, int],
    workplace: Workplace, outer_row: Double, inner_row: Double,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Write the boundaries in a frame's columns from the first one on, (column,), NaN where there is no wall.

    `cells` and `floor` are those of `glance`; `missing` are columns that have been filled from beside, `behind` the
    first point of the surface that a needle hides, and the first one after.

    Returns:
        The number of points that show the surface, its median contrast in these, the noise of a pixel, and the wall's
            median thickness, m, NaN if its inner boundary was not found. Nothing is written if fewer points than
            LEAST_SHAPE show the surface.
    """
    sizes, tables, memory = workplace.sizes, workplace.tables, workplace.memory
    row, contrast, bridged, inner = memory.point[0], memory.point[1], memory.point[2], memory.point[3]
    present, shown = memory.shown[0], memory.shown[1]
    noise = _find_surface(frame, first, cells, floor, behind, sizes, tables, memory)
    deepest = frame.shape[0] - BOTTOM_ROWS
    widest = sizes.widest_gap
    show_points(
        row, contrast, missing, tables.column, deepest, ABSENT_SHARE, TYPICAL, widest, memory.shown[2], present,
        memory.point[4],
    )  # fmt: skip
    seen = 0
    for at in range(len(row)):
        shown[at] = present[at] and not behind[0] <= at < behind[1]
        seen += shown[at]
    typical = np.float64(quantile_of_chosen(contrast, shown, 0.5, memory.point[4]))
    if seen < LEAST_SHAPE:
        return seen, typical, noise, np.nan
    bridge(row, present, bridged)
    thickness_m = _find_inner(frame, first, floor, sizes, tables, memory, bridged, present, inner)
    everywhere = True
    for column in range(sizes.width):
        everywhere = everywhere and present[tables.nearest[column]]
    at_every_column(tables.column, row, present, tables.nearest, everywhere, outer_row)
    at_every_column(tables.column, inner, present, tables.nearest, everywhere, inner_row)
    return seen, typical, noise, thickness_m


@compiled
def find_as_before(
    frame: Counts, eight_bits: bool, brightest: Counts, dark: Flags, before: tuple[int, int], workplace: Workplace,
    rows: Double,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Take all steps at once, for a frame that is imaged from and to the columns that the one before was.

    `before`: first column of the frame before, and the one after its last. `rows`: outer and inner boundary, (2,
    column). Return as `find_boundaries`; -1 points where another part is imaged, something at the top edge may be a
    needle, or hardly anything is seen: then the single steps find the reason.
    """
    first, after, lit, largest = find_lit(frame, brightest, dark)
    if first != before[0] or after != before[1] or lit != after - first:
        return -1, np.nan, np.nan, np.nan
    cells, floor, saturated, needle = glance(frame, first, eight_bits, largest, workplace)
    if needle or saturated or largest - floor < EMPTY_SHARE * max(largest, 1):
        return -1, np.nan, np.nan, np.nan
    for column in range(rows.shape[1]):
        rows[0, column] = rows[1, column] = np.nan
    return find_boundaries(
        frame, first, cells, floor, dark[first:after], (0, 0), workplace, rows[0, first:after], rows[1, first:after]
    )


@compiled
def _find_surface(
    frame: Counts, first: int, cells: Counts, floor: int, behind: tuple[int, int], sizes: Sizes, tables: Tables,
    memory: Memory,
) -> float:  # fmt: skip
    """Write the surface's rows and contrast into the memory's first points, and return the noise of a pixel."""
    start = memory.point[2]
    opened_pairs(cells, floor, tables.pairs, sizes.line_rows, memory.eroded, memory.opened, memory.tissue)
    surface_score(
        memory.tissue, sizes.judged_rows, tables.downwards, memory.sample, memory.bins, memory.level, memory.means,
        memory.pair_total, memory.lowest, memory.score,
    )  # fmt: skip
    coarse_rows(memory.score, sizes.reach, memory.four[0], memory.four[1], memory.four[2], memory.path)
    for pair in range(len(memory.path)):
        memory.coarse[pair] = np.float32(memory.path[pair] * (ROWS * sizes.step_rows)) - _ONE_HALF
    start_rows(memory.coarse, tables.place, tables.weight, frame.shape[0], start)
    return _fit_strip(frame, first, start, behind, sizes, tables, memory)


@compiled
def _fit_strip(
    frame: Counts, first: int, start: Float, behind: tuple[int, int], sizes: Sizes, tables: Tables, memory: Memory
) -> float:
    """Move a surface from the rows where it starts to the edge of the full frame; see `_find_surface`."""
    row, contrast, line = memory.point[0], memory.point[1], memory.point[3]
    raw, strip, other = memory.strip[0], memory.strip[1], memory.strip[2]
    noise = sample_strip(
        frame, first, tables.columns[0], tables.columns[1], tables.across, start, line, memory.rows[0], memory.rows[1],
        memory.down, raw,
    )  # fmt: skip
    total, middle, best = memory.point_double[0], memory.point_double[1], memory.point_double[2]
    fit_edges(raw, sizes.strip_line, start, strip, other, total, middle, best, row, line)
    mean_of_neighbours(line, 2, contrast)
    if behind[0] == behind[1]:
        smooth_surface(row, memory.longer[0], memory.longer[1])
    else:
        smooth_surface(row[: behind[0]], memory.longer[0], memory.longer[1])
        smooth_surface(row[behind[1] :], memory.longer[0], memory.longer[1])
    return noise


@compiled
def _find_inner(
    frame: Counts, first: int, floor: int, sizes: Sizes, tables: Tables, memory: Memory, row: Float, present: Flags,
    inner: Float,
) -> float:  # fmt: skip
    """Write the inner boundary's rows below a surface without gaps, and return the median thickness, NaN: not found."""
    along_rows, thickness_m = memory.point[4], memory.point[5]
    stretch(row, sizes.slope_reach, sizes.rise, sizes.tissue_depth_m, along_rows)
    support = _search_below(frame, first, floor, tables, memory, row, present, along_rows, memory.prior)
    if support < FOUND_SHARE:
        for at in range(len(row)):
            inner[at] = row[at] + np.float32(UNSEEN_DEPTH_M / sizes.tissue_depth_m)
        return np.nan
    for at in range(len(row)):
        one = np.float64(tables.group_weight[at, 0]) * np.float64(memory.group[6, tables.group[at, 0]])
        other = np.float64(tables.group_weight[at, 1]) * np.float64(memory.group[6, tables.group[at, 1]])
        thickness_m[at] = np.float32(one + other)
        inner[at] = along_rows[at] * thickness_m[at] + row[at]
    return np.float64(quantile_of_chosen(thickness_m, present, 0.5, along_rows))


@compiled
def _search_below(
    frame: Counts, first: int, floor: int, tables: Tables, memory: Memory, row: Float, present: Flags,
    along_rows: Float, prior: Float,
) -> float:  # fmt: skip
    """Write the wall's thickness at each group into `memory.group[6]`; return the share of groups that show its end."""
    looked_row, looked_along = memory.looked[0], memory.looked[1]
    for at in range(len(tables.looked_at)):
        point = tables.looked_at[at]
        looked_row[at], looked_along[at] = row[point], along_rows[point]
        memory.looked_there[at] = present[point]
    wall, seen, pooled, near, mean, bend = (
        memory.cells[0], memory.cells[1], memory.cells[2], memory.cells[3], memory.cells[4], memory.cells[5],
    )  # fmt: skip
    unroll(
        frame, first, floor, tables.looked_columns[0], tables.looked_columns[1], tables.looked_across, looked_row,
        memory.looked_there, looked_along, memory.looked[2], memory.looked[3], memory.rows[0], memory.rows[1],
        memory.down, memory.group, wall, seen,
    )  # fmt: skip
    jump, gain, score = memory.edges[0], memory.edges[1], memory.edges[2]
    find_jumps(wall, seen, pooled, near, mean, bend, jump)
    score_jumps(jump, prior, memory.sizes, memory.edge[0], memory.edge[1], gain, score)
    return find_thickness(
        near, seen, mean, bend, jump, memory.edge[1], score, memory.group_path, memory.edges[3], memory.edges[4],
        memory.group[2:4], memory.group[4:6], memory.group[6],
    )  # fmt: skip


@compiled
def edge_near(frame: Counts, first: int, start: Float, workplace: Workplace, row: Float) -> None:
    """Write the edge of the full frame that lies nearest to a surface, both (point,), in rows."""
    memory = workplace.memory
    _fit_strip(frame, first, start, (0, 0), workplace.sizes, workplace.tables, memory)
    row[:] = memory.point[0]


@compiled
def thickness_below(
    frame: Counts, first: int, floor: int, row: Float, present: Flags, along_rows: Float, prior: Float,
    workplace: Workplace, thickness_m: Float, shown: Flags,
) -> None:  # fmt: skip
    """Write the thickness below a surface without NaN at each group of points, m, and which groups show its end."""
    memory = workplace.memory
    _search_below(frame, first, floor, workplace.tables, memory, row, present, along_rows, prior)
    thickness_m[:] = memory.group[6]
    for group in range(len(shown)):
        shown[group] = memory.group[4, group] > 0.5
