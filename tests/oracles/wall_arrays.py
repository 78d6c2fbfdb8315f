"""The wall in a frame by NumPy and OpenCV: the oracle of the loops of `scleraforce.segmentation`."""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import ceil, isnan
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.boundaries import BOTTOM_ROWS, FOUND_SHARE
from scleraforce.segmentation.columns import continuation, fine_columns, grouping, nearest_point
from scleraforce.segmentation.found import (
    SATURATED_LEVEL,
    SATURATED_SHARE,
    UNSEEN_DEPTH_M,
    Segmentation,
    blank_fault,
    surface_fault,
    without_wall,
)
from scleraforce.segmentation.grid import (
    BLACK_PART,
    FLOOR_SHARE,
    LEAST_SHAPE,
    LIT_ROWS,
    LIT_SHARE,
    MAX_COLUMNS,
    MAX_ROWS,
    Float,
    Grid,
    grid_size,
    imaged_part,
)
from scleraforce.segmentation.inner import (
    BEND,
    BEND_TO_LOW,
    BRIGHTEST,
    CELL_M,
    CELLS,
    EDGES,
    FROM_MIDDLE,
    GROUP,
    HALF_JUMP,
    LAYER_CELLS,
    LEAST_JUMP,
    LEAST_LEVEL_SHARE,
    LEVEL_CELLS,
    LINE_CELLS,
    LOW_CELLS,
    POOLED,
    REACH_CELLS,
    REFINE_CELLS,
    ROW_COST,
    SKIP_CELLS,
    SKIP_EDGE,
    SPREAD_CELLS,
    STEEPEST,
    SURE_JUMP,
    SURE_SPREAD,
    THICKNESS_M,
    UPPER_COST,
    slope_reach,
)
from scleraforce.segmentation.light import DIMMER, LEAST_PAIRS, LOOKED_AT_ROWS, PAIR_COLUMNS
from scleraforce.segmentation.needle import find_shaft, needle_of
from scleraforce.segmentation.slice import BoundaryRows
from scleraforce.segmentation.surface import (
    ABSENT_SHARE,
    BLACK_SHARE,
    BRIGHT_SHARE,
    EXCESS_CAP,
    EXCESS_COST,
    HALF_STEP,
    LARGEST_LEVEL,
    LEAST_EXCESS,
    LEAST_STEP,
    ROWS,
    SMOOTHED,
    TYPICAL,
    downwards,
    line_rows,
    pairs_of,
    path_reach,
    step_rows,
    strip_rows,
    widest_gap,
)
from scleraforce.segmentation.wall import LEAST_SIDE
from scleraforce.study import SliceStudy

Flags = NDArray[np.bool_]

_ABOVE = slice(EDGES.start - SKIP_EDGE - LINE_CELLS, EDGES.stop - SKIP_EDGE - LINE_CELLS)  # first cells of the lines
_BELOW = slice(EDGES.start + SKIP_EDGE, EDGES.stop + SKIP_EDGE)  # first cells below
_DEEPEST = slice(_BELOW.start + LOW_CELLS - 1, _BELOW.stop + LOW_CELLS - 1)  # last cells below
_LAYER = np.ones((1, LAYER_CELLS[1] - LAYER_CELLS[0] + 1), dtype=np.uint8)
_OFFSET = np.arange(-REFINE_CELLS, REFINE_CELLS)
_MEAN = np.full((1, LINE_CELLS), 1.0 / LINE_CELLS, dtype=np.float32)
_LOW_MEAN = np.full((1, LOW_CELLS), 1.0 / LOW_CELLS, dtype=np.float32)


@dataclass(frozen=True)
class Surface:
    """A surface along fine columns: `row` (column,), `contrast` in counts (below less above), `noise` of a pixel."""

    column: Float
    row: Float
    contrast: Float
    noise: float


def find_wall(frame: Pixels, scale: PixelScale) -> Segmentation:
    """The wall below the first surface that light meets."""
    columns = frame[::LIT_ROWS].max(axis=0)
    brightest = int(columns.max())
    dark = columns <= int(LIT_SHARE * brightest)
    if np.count_nonzero(~dark) < LEAST_SHAPE:
        return without_wall(frame.shape, "the frame is empty: all pixels are alike")
    left, right = int(dark.argmin()), len(dark) - int(dark[::-1].argmin())
    missing = dark[left:right]
    grid = make_grid(imaged_part(frame, left, missing), scale)
    some = grid.cells[::8, ::4]
    saturated = np.count_nonzero(some >= int(SATURATED_LEVEL * brightest)) > SATURATED_SHARE * some.size
    fault = blank_fault(grid.floor, brightest, bool(saturated))
    if fault:
        return without_wall(frame.shape, fault)
    shaft = find_shaft(imaged_part(frame, left, missing), grid)
    if shaft is None:
        return _found(frame, scale, left, missing, None)
    needle = needle_of(shaft, grid, left, frame.shape[1])
    (first, after), least = shaft.hidden, max(LEAST_SHAPE, round(LEAST_SIDE * len(missing)))
    start, stop = (after if first < least else 0), (first if len(missing) - after < least else len(missing))
    if stop - start < least:
        return without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
    filled, hidden = missing[start:stop].copy(), None
    if start < first and after < stop:
        filled[first - start : after - start] = True
    lit = np.flatnonzero(~filled)
    if not len(lit):
        return without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
    start, filled = start + int(lit[0]), filled[lit[0] : lit[-1] + 1]
    if start < first and after < stop:
        hidden = first - start, after - start
    found = replace(_found(frame, scale, left + start, filled, hidden), needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan
    return found


def _found(frame: Pixels, scale: PixelScale, left: int, missing: Flags, hidden: tuple[int, int] | None) -> Segmentation:
    imaged = imaged_part(frame, left, missing)
    grid, width = make_grid(imaged, scale), len(missing)
    behind = slice(0, 0)
    if hidden is not None:
        behind = slice(*np.searchsorted(fine_columns(width), (hidden[0] - 0.5, hidden[1] - 0.5)).tolist())
    surface = refine_surface(imaged, scale, *find_surface(grid), behind)
    present = _present(surface, missing, len(frame), scale)
    shown = present.copy()
    shown[behind] = False  # no evidence of a wall; the inner boundary's path leads on there all the same
    seen = int(np.count_nonzero(shown))
    contrast = _quantile(surface.contrast[shown], 0.5) if seen else 0.0
    fault = surface_fault(seen, len(shown), contrast, surface.noise)
    if seen < LEAST_SHAPE:
        return without_wall(frame.shape, fault or "no wall was found")
    inner, thickness_m = _inner(imaged, scale, grid.floor, surface, present)
    rows = at_columns(frame.shape[1], left, width, present, surface.row, inner)
    return Segmentation(*rows, len(frame), not fault, fault, not isnan(thickness_m), thickness_m=thickness_m)


def _inner(imaged: Pixels, scale: PixelScale, floor: float, surface: Surface, present: Flags) -> tuple[Float, float]:
    """The inner boundary's rows and the median thickness along the normal (NaN: not found)."""
    row, depth_m = bridged(surface.row, present), scale.depth_m / scale.refractive_index
    along_rows = surface_stretch(surface.column, row, scale.lateral_m, depth_m) / np.float32(depth_m)
    points, to_all = grouping(len(row))
    column = np.repeat(surface.column[points][None], CELLS, axis=0)
    found_m, support = find_inner(imaged, floor, column, row[points], present[points], along_rows[points])
    if support < FOUND_SHARE:
        return row + np.float32(UNSEEN_DEPTH_M / depth_m), float("nan")
    thickness_m = to_all @ found_m
    return along_rows * thickness_m + row, _quantile(thickness_m[present], 0.5)


def _present(surface: Surface, missing: Flags, rows: int, scale: PixelScale) -> Flags:
    """Which points of a surface show it, or lie in a gap so narrow that it goes on behind it."""
    inside = surface.row < np.float32(rows - BOTTOM_ROWS)
    seen = inside & ~missing[surface.column.astype(np.intp)]
    if not np.count_nonzero(seen):
        return seen
    typical = _quantile(surface.contrast[seen], TYPICAL)
    present = seen & (surface.contrast > np.float32(ABSENT_SHARE * max(typical, 1e-6)))
    point_m = float(surface.column[1] - surface.column[0]) * scale.lateral_m
    widest, there = widest_gap(len(present), point_m), np.flatnonzero(present)
    for last, following in pairwise(there):
        gap = slice(last + 1, following)
        if following - last - 1 <= widest and inside[gap].any():
            present[gap] = True
    return present


def _quantile(values: NDArray[np.floating], share: float) -> float:
    return float(np.sort(values)[int(share * len(values))])


def make_grid(frame: Pixels, scale: PixelScale) -> Grid:
    """Average a frame into at most 191 x 383 cells and find its noise floor."""
    cells = _halve(frame)
    return Grid(cells, _noise_floor(cells), grid_size(*frame.shape, scale))


def _noise_floor(cells: Pixels) -> float:
    """Return the count that a fifth of the cells that are not black lie below: noise, whatever share tissue takes."""
    sample = cells[::8, ::2].ravel()
    lit = sample[sample > int(sample.max()) // BLACK_PART]
    if not len(lit):
        return 0.0
    nth = int(FLOOR_SHARE * len(lit))
    lit.partition(nth)
    return float(lit[nth])


def _halve(frame: Pixels) -> Pixels:
    """Average neighbours by halves (the quick case of `cv2.resize`); an odd last row or column is dropped."""
    while True:
        rows, columns = frame.shape
        across, down = columns >= MAX_COLUMNS, rows >= MAX_ROWS
        if not across and not down:
            return frame
        size = (columns // 2 if across else columns, rows // 2 if down else rows)
        frame = frame[: 2 * size[1] if down else rows, : 2 * size[0] if across else columns]
        # At exactly a half, INTER_LINEAR averages two neighbours; along one axis it is quicker than INTER_AREA.
        method = cv2.INTER_AREA if across and down else cv2.INTER_LINEAR
        frame = cast(Pixels, cv2.resize(frame, size, interpolation=method))


def find_surface(grid: Grid) -> tuple[Float, Float]:
    """Return the surface on a coarse grid: columns and rows of the frame, each shape (point,)."""
    tissue = _without_lines(grid)
    column, _ = pairs_of(grid.size.columns, grid.size.step_columns)
    path = _best_rows(_score(tissue, step_rows(grid.size)), path_reach(grid.size))
    row = path.astype(np.float32)
    row *= np.float32(ROWS * grid.size.step_rows)
    row -= np.float32(0.5)
    return column, row


def _without_lines(grid: Grid) -> Float:
    """Return pairs of the grid's columns, opened along depth, over the noise floor.

    Shape (pair, row / ROWS). The opening comes before neighbours are averaged: that would thicken a line at a slope.
    """
    _, pairs = pairs_of(grid.size.columns, grid.size.step_columns)
    cells = cv2.transpose(grid.cells).take(pairs, axis=0)
    thin = _line(1, line_rows(grid.size))
    floor = cells.dtype.type(grid.floor)
    opened = cv2.morphologyEx(np.maximum(cells, floor), cv2.MORPH_OPEN, thin) - floor
    _extend_upwards(opened, cells, BLACK_SHARE * grid.floor, thin.shape[1])
    size = (opened.shape[1] // ROWS, len(pairs) // 2)
    halved = cv2.resize(opened[:, : ROWS * size[0]], size, interpolation=cv2.INTER_AREA)
    return halved.astype(np.float32)


def _extend_upwards(opened: NDArray[Any], cells: NDArray[Any], black: float, margin: int) -> None:
    """Continue what lies at the upper edge of the measured part into the black above it: that edge is no surface."""
    if not np.count_nonzero(cells[:, 0] <= int(black)):
        return
    first = (cells > black).argmax(axis=1)
    for column in np.flatnonzero(first):
        top = min(first[column] + margin, opened.shape[1] - 1)
        opened[column, :top] = opened[column, top : top + 3].max()


def _score(tissue: Float, depth: int) -> Float:
    """Return what a surface gains at the upper edge of each cell, shape (column, row)."""
    rows = tissue.shape[1]
    sample = tissue[:, ::2].ravel()
    nth = int(BRIGHT_SHARE * sample.size)
    sample.partition(nth)
    level = tissue * np.float32(1.0 / max(float(sample[nth]), 1e-6))
    cv2.threshold(level, LARGEST_LEVEL, 0.0, cv2.THRESH_TRUNC, level)
    padded = cv2.copyMakeBorder(level, 0, 0, depth, depth, cv2.BORDER_REPLICATE)
    means = cv2.blur(padded, (depth, 1), anchor=(0, 0))
    step = means[:, depth : depth + rows] - means[:, :rows]
    step -= np.float32(LEAST_STEP)
    cv2.threshold(step, 0.0, 0.0, cv2.THRESH_TOZERO, step)
    # The tissue above every other cell will do: it changes slowly.
    coarse = level[:, ::2]
    bright_cells = coarse - np.minimum.accumulate(coarse, axis=1)
    bright_cells -= np.float32(LEAST_EXCESS)
    cv2.threshold(bright_cells, 0.0, 0.0, cv2.THRESH_TOZERO, bright_cells)
    above = bright_cells @ _above(coarse.shape[1], EXCESS_COST * 2.0 / depth)
    cv2.threshold(above, EXCESS_COST * EXCESS_CAP, 0.0, cv2.THRESH_TRUNC, above)
    score = step / (step + np.float32(HALF_STEP))
    score[:, ::2] -= above
    score[:, 1::2] -= above[:, : rows // 2]
    # Where nothing speaks, the path goes down: a wall that cannot be seen has left the window at the bottom.
    score += downwards(rows)
    return score


def _best_rows(score: Float, reach: int) -> NDArray[np.intp]:
    """Return the best path; where the best rows make none, it is found on the best of each four: quicker to search."""
    path: NDArray[np.intp] = score.argmax(axis=1)
    if not np.count_nonzero(np.abs(path[1:] - path[:-1]) > reach):
        return path
    rows = score.shape[1] // 4 * 4
    pairs = np.maximum(score[:, 0:rows:2], score[:, 1:rows:2])
    path = best_path(np.maximum(pairs[:, ::2], pairs[:, 1::2]), ceil(reach / 4))
    path *= 4
    four = score[np.arange(len(path))[:, None], path[:, None] + np.arange(4)]
    path += four.argmax(axis=1)
    return path


def refine_surface(frame: Pixels, scale: PixelScale, column: Float, row: Float, hidden: slice = slice(0, 0)) -> Surface:
    """Move a coarse surface to the edge of the full frame: the best two-level fit along each column of a strip.

    Between a dark level above and a bright one below, the edge that fits best in the sense of least squares is where
    the sum of (count - middle level) above it is smallest.

    Args:
        frame: counts, shape (row, column).
        scale: size of its pixel.
        column: columns of the coarse surface, shape (point,), increasing.
        row: rows of the coarse surface, shape (point,).
        hidden: points of the result that say nothing of those beside them; they are not smoothed.

    Returns:
        The surface at no more than 128 columns, in rows of pixel centres: row r is below it where r >= `row`.
    """
    rows, columns = frame.shape
    half, line = strip_rows(scale)
    fine = fine_columns(columns)
    start = continuation(columns, float(column[0]), float(column[1] - column[0]), len(column)) @ row
    np.minimum(np.maximum(start, np.float32(0.0), out=start), np.float32(rows - 1.0), out=start)
    map_column, map_row = np.repeat(fine[None], 2 * half, axis=0), _strip_rows(half) + start
    raw = cv2.remap(frame, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    noise = cv2.meanStdDev(raw[: half - 2])[1].item()
    strip = cv2.morphologyEx(cv2.blur(raw, (3, 3)), cv2.MORPH_OPEN, _line(line, 1))
    fits = strip.T @ two_levels(half)
    found = start + fits[:, :-1].argmin(axis=1).astype(np.float32)
    found -= np.float32(half)
    if hidden.start == hidden.stop:
        smooth = _smoothed(found)
    else:
        sides = _smoothed(found[: hidden.start]), found[hidden], _smoothed(found[hidden.stop :])
        smooth = np.concatenate(sides)
    contrast = cv2.blur(fits[None, :, -1], (5, 1))[0]
    return Surface(fine, smooth.astype(np.float32), contrast.astype(np.float32), noise)


def _smoothed(found: Float) -> Float:
    """Return a surface after a median and a mean over five points."""
    if len(found) < SMOOTHED:
        return found
    # Mirrored in its end points, a slope goes on beyond them.
    longer = np.concatenate([2 * found[0] - found[4:0:-1], found, 2 * found[-1] - found[-2:-6:-1]])
    return cast(Float, cv2.blur(cv2.medianBlur(longer[None], 5), (5, 1))[0, 4:-4])


@lru_cache(maxsize=8)
def _line(rows: int, columns: int) -> NDArray[np.uint8]:
    """Return the shape of an opening."""
    return np.ones((rows, columns), dtype=np.uint8)


@lru_cache(maxsize=8)
def _above(size: int, factor: float) -> Float:
    """Return the matrix, (size, size), whose product with rows are `factor` times the sums before each cell.

    The product takes a third of the time of `cumsum`.
    """
    return np.triu(np.full((size, size), factor, dtype=np.float32), 1)


@lru_cache(maxsize=8)
def _strip_rows(half: int) -> Float:
    """Return the rows of a strip from its middle, (row, 1)."""
    return (np.arange(-half, half, dtype=np.float32) + np.float32(0.5))[:, None]


def two_levels(half: int) -> NDArray[np.float64]:
    """Return the matrix, (row, edge + 1), that a strip's columns are multiplied by.

    For each edge between the rows it gives the sum of (count - middle level) above; last, the level below less that
    above. The levels are means of the strip's ends.
    """
    size, end = 2 * half, half - 2
    above, below = np.zeros(size), np.zeros(size)
    above[:end], below[-end:] = 1.0 / end, 1.0 / end
    sums = np.triu(np.ones((size, size + 1)), 1)
    edges = sums - np.outer((above + below) / 2, np.arange(size + 1))
    return np.column_stack([edges, below - above])


def surface_stretch(column: Float, row: Float, lateral_m: float, depth_m: float) -> Float:
    """Return by how much a wall is longer along a column than along the surface's normal, shape (column,)."""
    step_m = float(column[1] - column[0]) * lateral_m
    reach = slope_reach(len(column), step_m)
    # Mirrored in its end points, a slope goes on beyond them.
    longer = np.concatenate((2 * row[0] - row[reach:0:-1], row, 2 * row[-1] - row[-2 : -2 - reach : -1]))
    slope = longer[2 * reach :] - longer[: -2 * reach]
    slope *= np.float32(depth_m / (2 * reach * step_m))
    np.square(slope, slope)
    np.minimum(slope, np.float32(STEEPEST**2), out=slope)
    slope += np.float32(1.0)
    stretch: Float = np.sqrt(slope, slope)
    return stretch


def find_inner(
    frame: Pixels,
    floor: float,
    column: Float,
    row: Float,
    there: NDArray[np.bool_],
    along_rows: Float,
) -> tuple[Float, float]:
    """Find the inner boundary below a surface.

    Args:
        frame: counts, shape (row, column).
        floor: count of its noise floor.
        column: columns of the surface in the frame, once for each of CELLS rows, shape (CELLS, point); a multiple of 8.
        row: its rows in the frame, no NaN, shape (point,).
        there: whether there is a surface.
        along_rows: rows of the frame along a column for 1 m of thickness along the normal, shape (point,).

    Returns:
        Thickness along the normal at each group, m, and the share of groups that show the boundary.
    """
    wall, seen = _unroll(frame, floor, column, row, there, along_rows)
    mean, bend, jump = _jumps(wall, seen)
    least = _least_jump(jump)
    gain = jump - least
    cv2.threshold(gain, 0.0, 0.0, cv2.THRESH_TOZERO, gain)
    gain /= gain + np.float32(HALF_JUMP)
    score = gain - ROW_COST
    near, far = LAYER_CELLS
    # The largest of the jumps `far - near` cells above, down to here.
    upper = cast(Float, cv2.dilate(gain, _LAYER, anchor=(far - near, 0)))
    upper *= np.float32(UPPER_COST)
    score[:, near:] -= upper[:, :-near]
    path = best_path(score, REACH_CELLS)
    point = np.arange(len(path))
    first = np.maximum(path - (SKIP_EDGE + LINE_CELLS), 0)
    size = jump[point, path]
    boundary = _cross(wall, path, mean[point, first], bend[point, first], np.maximum(size, np.float32(0.0)))
    testable = seen[point, np.minimum(path + SKIP_EDGE, CELLS - 1)] > 0
    shown = (size > least[path]) & testable
    weight = shown + np.float32(1e-3)
    smooth = cv2.blur((boundary * weight)[None], (5, 1))[0]
    smooth /= cv2.blur(weight[None], (5, 1))[0]
    smooth *= np.float32(CELL_M)
    support = int(np.count_nonzero(shown)) / max(1, int(np.count_nonzero(testable)))
    return cast(Float, smooth), support


def _unroll(
    frame: Pixels, floor: float, column: Float, row: Float, there: NDArray[np.bool_], along_rows: Float
) -> tuple[Float, Float]:
    """Return the wall as (group, cell), surface level 1 and floor 0, and where it is measured (1 or 0)."""
    map_row = np.stack([np.ones_like(THICKNESS_M), THICKNESS_M], axis=1) @ np.stack([row, along_rows])
    sampled = cv2.remap(frame, column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    light = cast(Float, cv2.transpose(cv2.resize(sampled, (len(row) // GROUP, CELLS), interpolation=cv2.INTER_AREA)))
    seen = _measured((len(frame) - 1 - row) / along_rows, there)
    light -= np.float32(floor)
    cv2.threshold(light, 0.0, 0.0, cv2.THRESH_TOZERO, light)
    light *= seen
    near_surface = slice(SKIP_CELLS, LEVEL_CELLS)
    level = light[:, near_surface].sum(axis=1) / np.maximum(seen[:, near_surface].sum(axis=1), np.float32(1.0))
    level = cast(Float, cv2.blur(level[:, None], (1, 3)))
    seen *= level > max(LEAST_LEVEL_SHARE * float(level.max()), 1e-9)
    light *= seen / np.maximum(level, np.float32(1e-6))
    cv2.threshold(light, BRIGHTEST, 0.0, cv2.THRESH_TRUNC, light)
    return light, seen


def _measured(deepest_m: Float, there: NDArray[np.bool_]) -> Float:
    """Return 1 in the cells, (group, cell), above the deepest thickness at the outer points of a group, else 0."""
    deepest_m *= there
    ends = np.minimum(deepest_m[::GROUP], deepest_m[GROUP - 1 :: GROUP])
    return (ends[:, None] >= THICKNESS_M).astype(np.float32)


def _jumps(wall: Float, seen: Float) -> tuple[Float, Float, Float]:
    """Return what straight lines through the cells say, and the jump at each edge between cells.

    For the lines that start at each cell: their mean, and by how much they fall from their middle to the jump, both
    (group, cell); jump (group, cell + 1): by how much the cells below lie lower than the line above goes on to there.
    Neighbouring groups are pooled.
    """
    share = cv2.blur(seen, (1, POOLED))
    pooled = cast(Float, cv2.blur(wall, (1, POOLED)))
    pooled /= np.maximum(share, np.float32(1e-3))
    mean = cast(Float, cv2.filter2D(pooled, -1, _MEAN, anchor=(0, 0)))
    bend = cast(Float, cv2.filter2D(pooled, -1, BEND[None], anchor=(0, 0)))
    cv2.threshold(bend, 0.0, 0.0, cv2.THRESH_TRUNC, bend)
    low = cast(Float, cv2.filter2D(pooled, -1, _LOW_MEAN, anchor=(0, 0)))
    jump = np.zeros((len(wall), CELLS + 1), dtype=np.float32)
    inside = jump[:, EDGES]
    np.multiply(bend[:, _ABOVE], BEND_TO_LOW, inside)
    inside += mean[:, _ABOVE]
    np.maximum(inside, np.float32(0.0), out=inside)
    inside -= low[:, _BELOW]
    inside *= share[:, _DEEPEST] > np.float32(0.3)
    return mean, bend, jump


def _least_jump(jump: Float) -> Float:
    """Return the jump that stands out at each edge, shape (edge,), from what speckle and texture make.

    Their jumps are told by their median size (the wall's end is rare), and by how much jumps at one depth differ from
    place to place (the wall's end does not).
    """
    sizes = np.abs(jump[:, EDGES.start : EDGES.stop : 2]).ravel()
    sizes = sizes[sizes > 0]
    typical = float(np.partition(sizes, len(sizes) // 2)[len(sizes) // 2]) if len(sizes) else 0.0
    change = jump[POOLED:] - jump[:-POOLED]
    np.square(change, change)
    spread = np.full(len(change), 0.5 / len(change), np.float32) @ change
    np.sqrt(spread, spread)
    least: Float = cv2.blur(spread[None], (SPREAD_CELLS, 1))[0]
    least *= np.float32(SURE_SPREAD)
    np.maximum(least, np.float32(max(LEAST_JUMP, SURE_JUMP * typical)), out=least)
    return least


def _cross(wall: Float, path: NDArray[np.intp], mean: Float, bend: Float, jump: Float) -> Float:
    """Return the edge near a path, in cells, shape (group,), that best parts light above and below a jump's middle."""
    path = np.minimum(np.maximum(path, REFINE_CELLS), CELLS - REFINE_CELLS)
    above = cv2.blur(wall, (1, 3))[np.arange(len(path))[:, None], path[:, None] + _OFFSET]
    above -= bend[:, None] * FROM_MIDDLE
    above -= (mean - jump / 2)[:, None]
    limit = np.maximum(jump, np.float32(1e-3))[:, None]
    np.minimum(np.maximum(above, -limit, out=above), limit, out=above)
    sums = np.triu(np.ones((2 * REFINE_CELLS, 2 * REFINE_CELLS + 1), np.float32), 1)
    edge: Float = (path + (above @ sums).argmax(axis=1)).astype(np.float32)
    edge -= np.float32(REFINE_CELLS)
    return edge


def best_path(score_cr: Float, reach: int) -> NDArray[np.intp]:
    """Return the rows of the path with the largest sum of scores whose steps are at most `reach` rows.

    Mostly the best rows of the columns make such a path already. Where they do not, the part from the first step that
    is too large to the last one is searched; if its ends fit to the rest, no path can be better, as each part is at its
    largest sum. If they do not, all of it is searched.

    Args:
        score_cr: scores, shape (column, row). Give each row its own small bonus: the path is unique only if no two
            paths have the same sum.
        reach: largest step between neighbouring columns, rows.

    Returns:
        The row in each column, shape (column,).
    """
    path: NDArray[np.intp] = score_cr.argmax(axis=1)
    large = _too_large(path, reach)
    if not len(large):
        return path
    part = slice(max(0, large[0] - 1), large[-1] + 2 + 1)
    path[part] = _searched(score_cr[part], reach)
    return path if not len(_too_large(path, reach)) else _searched(score_cr, reach)


def _too_large(path: NDArray[np.intp], reach: int) -> NDArray[np.intp]:
    """Return the places of steps that are larger than `reach`."""
    places: NDArray[np.intp] = (np.abs(path[1:] - path[:-1]) > reach).nonzero()[0]
    return places


def _searched(score_cr: Float, reach: int) -> NDArray[np.intp]:
    """Return the best path, by dynamic programming.

    Both directions are run at once (rows of one array); their sum is, for each column and row, the best score of all
    paths through there (max-marginals of a Markov chain: Bishop, Pattern Recognition and Machine Learning, sec. 8.4.5),
    so the path needs no backtracking. OpenCV's dilation is the maximum over a window.
    """
    columns, rows = score_cr.shape
    total = np.empty((columns, 2, rows), dtype=np.float32)
    total[:, 0], total[:, 1] = score_cr, score_cr[::-1]
    window, moved = _window(reach), np.empty((2, rows), dtype=np.float32)
    dilate, add = cv2.dilate, np.add
    for before, after in pairwise(total):
        add(after, dilate(before, window, moved), after)
    through: Float = total[:, 0] + total[::-1, 1] - score_cr
    rows_c: NDArray[np.intp] = through.argmax(axis=1)
    return rows_c


@lru_cache(maxsize=16)
def _window(reach: int) -> NDArray[np.uint8]:
    return np.ones((1, 2 * reach + 1), dtype=np.uint8)


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


def pair_contrast(frame: Pixels) -> float:
    """Return how much the brightest pairs of a frame differ, as a share of their sums (median): 0 where few are lit.

    Pairs as bright as the dimmest of the brightest tenth count as well.
    """
    looked_at = frame[:: max(1, len(frame) // LOOKED_AT_ROWS)]
    rows = looked_at.astype(np.int32)
    one, other = rows[:, PAIR_COLUMNS:], rows[:, :-PAIR_COLUMNS]
    lit = (one > 0) & (other > 0)
    one, other = one[lit], other[lit]
    if len(one) < LEAST_PAIRS:
        return 0.0
    total = one + other
    place, mean = int(DIMMER * len(total)), total >> 1
    brightest = mean >= np.partition(mean, place)[place]
    shares = np.abs(one - other)[brightest].astype(np.float32) / total[brightest].astype(np.float32)
    return float(np.median(shares))


def boundary_depths(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> NDArray[np.float64]:
    """Return the depth of both boundaries below the frame's upper edge at the centres of the slice's columns.

    Args and columns are those of `boundary_slice`.

    Returns:
        Outer and inner boundary, shape (2, columns), m; NaN outside the frame and where there is no wall.
    """
    outer_row, inner_row = segmentation.outer_row, segmentation.inner_row
    middle = np.arange(slice_study.columns) + 0.5 - slice_study.columns / 2
    at = middle * slice_study.pixel_m / scale.lateral_m + len(outer_row) / 2 - 0.5
    nearest, inside = np.rint(at).astype(int).clip(0, len(outer_row) - 1), (at >= -0.5) & (at <= len(outer_row) - 0.5)
    there = np.isfinite(outer_row) & np.isfinite(inner_row)
    known = there[nearest] & inside
    depths = np.full((2, len(at)), np.nan)
    if not np.count_nonzero(known):
        return depths
    columns = np.flatnonzero(there)
    for depth_m, rows in zip(depths, (outer_row, inner_row), strict=True):
        depth_m[:] = np.interp(at, columns, rows[columns])
    depths += 0.5
    depths *= scale.depth_m
    outer_m, inner_m = depths
    inner_m -= outer_m
    inner_m /= scale.refractive_index
    inner_m += outer_m
    depths[:, ~known] = np.nan
    return depths
