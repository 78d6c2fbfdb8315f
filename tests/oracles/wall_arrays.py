"""The wall in a frame by NumPy and OpenCV: the oracle of the loops of `scleraforce.segmentation`."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, isnan
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation import found as verdict, grid as cells_of, inner as below, light as lit_of, surface as top
from scleraforce.segmentation.boundaries import BOTTOM_ROWS, FOUND_SHARE
from scleraforce.segmentation.found import Segmentation, without_wall
from scleraforce.segmentation.grid import LEAST_SHAPE, Float, Grid, imaged_part
from scleraforce.segmentation.inner import CELLS, EDGES, LINE_CELLS, LOW_CELLS, POOLED, REFINE_CELLS, SKIP_EDGE
from scleraforce.segmentation.needle import STANDS_OUT, find_needle, top_rows
from scleraforce.segmentation.slice import BoundaryRows
from scleraforce.segmentation.tables import continuation, fine_columns, grouping, nearest_point
from scleraforce.segmentation.wall import LEAST_SIDE
from scleraforce.study import SliceStudy

Flags = NDArray[np.bool_]

_ABOVE = slice(EDGES.start - SKIP_EDGE - LINE_CELLS, EDGES.stop - SKIP_EDGE - LINE_CELLS)  # first cells of the lines
_BELOW = slice(EDGES.start + SKIP_EDGE, EDGES.stop + SKIP_EDGE)  # first cells below
_DEEPEST = slice(_BELOW.start + LOW_CELLS - 1, _BELOW.stop + LOW_CELLS - 1)  # last cells below


@dataclass(frozen=True)
class Surface:
    """A surface along fine columns: `row` (column,), `contrast` in counts (below less above), `noise` of a pixel."""

    column: Float
    row: Float
    contrast: Float
    noise: float


def find_wall(frame: Pixels, scale: PixelScale) -> Segmentation:
    """The wall below the first surface that light meets."""
    columns = frame[:: cells_of.LIT_ROWS].max(axis=0)
    brightest = int(columns.max())
    dark = columns <= int(cells_of.LIT_SHARE * brightest)
    if np.count_nonzero(~dark) < LEAST_SHAPE:
        return without_wall(frame.shape, "the frame is empty: all pixels are alike")
    left, right = int(dark.argmin()), len(dark) - int(dark[::-1].argmin())
    missing = dark[left:right]
    grid = make_grid(imaged_part(frame, left, missing), scale)
    some = grid.cells[::8, ::4]
    bright = np.count_nonzero(some >= int(verdict.SATURATED_LEVEL * brightest))
    fault = verdict.blank_fault(grid.floor, brightest, bool(bright > verdict.SATURATED_SHARE * some.size))
    if fault:
        return without_wall(frame.shape, fault)
    mean = grid.cells[: top_rows(grid.size)].sum(axis=0, dtype=np.float32)
    middle, low = np.sort(mean)[[len(mean) // 2, len(mean) // 6]]
    begin = np.flatnonzero(mean > middle + STANDS_OUT * max(middle - low, np.float32(1e-3) * middle))
    needle = find_needle(imaged_part(frame, left, missing), grid, begin, left, frame.shape[1]) if len(begin) else None
    if needle is None:
        return _found(frame, scale, left, missing, None)
    first, after = (end - left for end in needle.hidden)
    least = max(LEAST_SHAPE, round(LEAST_SIDE * len(missing)))
    start, stop = (after if first < least else 0), (first if len(missing) - after < least else len(missing))
    hides = without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
    if stop - start < least:
        return hides
    filled, hidden = missing[start:stop].copy(), None
    if start < first and after < stop:
        filled[first - start : after - start] = True
    lit = np.flatnonzero(~filled)
    if not len(lit):
        return hides
    start, filled = start + int(lit[0]), filled[lit[0] : lit[-1] + 1]
    if start < first and after < stop:
        hidden = first - start, after - start
    found = replace(_found(frame, scale, left + start, filled, hidden), needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan
    return found


def _found(frame: Pixels, scale: PixelScale, left: int, missing: Flags, hidden: tuple[int, int] | None) -> Segmentation:
    imaged = imaged_part(frame, left, missing)
    grid, width, behind = make_grid(imaged, scale), len(missing), slice(0, 0)
    if hidden is not None:
        behind = slice(*np.searchsorted(fine_columns(width), (hidden[0] - 0.5, hidden[1] - 0.5)).tolist())
    surface = refine_surface(imaged, scale, find_surface(grid), grid, behind)
    present = _present(surface, missing, len(frame), scale)
    shown = present.copy()
    shown[behind] = False  # no evidence of a wall; the inner boundary's path continues there all the same
    seen = int(np.count_nonzero(shown))
    contrast = _quantile(surface.contrast[shown], 0.5) if seen else 0.0
    fault = verdict.surface_fault(seen, len(shown), contrast, surface.noise)
    if seen < LEAST_SHAPE:
        return without_wall(frame.shape, fault or "no wall was found")
    inner, thickness_m = _inner(imaged, scale, grid.floor, surface, present)
    rows = at_columns(frame.shape[1], left, width, present, surface.row, inner)
    return Segmentation(*rows, len(frame), not fault, fault, not isnan(thickness_m), thickness_m=thickness_m)


def _inner(imaged: Pixels, scale: PixelScale, floor: float, surface: Surface, present: Flags) -> tuple[Float, float]:
    """The inner boundary's rows and the median thickness along the normal (NaN: not found)."""
    at, depth_m = np.arange(len(present)), scale.depth_m / scale.refractive_index
    row = np.interp(at, at[present], surface.row[present]).astype(np.float32)
    along_rows = surface_stretch(surface.column, row, scale.lateral_m, depth_m) / np.float32(depth_m)
    points, to_all = grouping(len(row))
    found_m, support = find_inner(
        imaged, floor, surface.column[points], row[points], present[points], along_rows[points]
    )
    if support < FOUND_SHARE:
        return row + np.float32(verdict.UNSEEN_DEPTH_M / depth_m), float("nan")
    thickness_m = to_all @ found_m
    return along_rows * thickness_m + row, _quantile(thickness_m[present], 0.5)


def _present(surface: Surface, missing: Flags, rows: int, scale: PixelScale) -> Flags:
    """Which points of a surface show it, or lie in a gap so narrow that it continues behind it."""
    inside = surface.row < np.float32(rows - BOTTOM_ROWS)
    seen = inside & ~missing[surface.column.astype(np.intp)]
    if not np.count_nonzero(seen):
        return seen
    typical = _quantile(surface.contrast[seen], top.TYPICAL)
    present = seen & (surface.contrast > np.float32(top.ABSENT_SHARE * max(typical, 1e-6)))
    point_m = float(surface.column[1] - surface.column[0]) * scale.lateral_m
    for last, following in pairwise(np.flatnonzero(present)):
        gap = slice(last + 1, following)
        if following - last - 1 <= top.widest_gap(len(present), point_m) and inside[gap].any():
            present[gap] = True
    return present


def _quantile(values: NDArray[np.floating], share: float) -> float:
    return float(np.sort(values)[int(share * len(values))])


def make_grid(frame: Pixels, scale: PixelScale) -> Grid:
    """Average a frame into at most 191 x 383 cells and find its noise floor."""
    cells = _halve(frame)
    sample = cells[::8, ::2].ravel()
    lit = sample[sample > int(sample.max()) // cells_of.BLACK_PART]
    floor = _quantile(lit, cells_of.FLOOR_SHARE) if len(lit) else 0.0
    return Grid(cells, floor, cells_of.grid_size(*frame.shape, scale))


def _halve(frame: Pixels) -> Pixels:
    """Average neighbours by halves; an odd last row or column is dropped."""
    while True:
        rows, columns = frame.shape
        across, down = columns >= cells_of.MAX_COLUMNS, rows >= cells_of.MAX_ROWS
        if not across and not down:
            return frame
        size = (columns // 2 if across else columns, rows // 2 if down else rows)
        frame = frame[: 2 * size[1] if down else rows, : 2 * size[0] if across else columns]
        method = cv2.INTER_AREA if across and down else cv2.INTER_LINEAR
        frame = cast(Pixels, cv2.resize(frame, size, interpolation=method))


def find_surface(grid: Grid) -> Float:
    """Return the surface's rows of the frame at the grid's pairs of columns."""
    score, reach = _score(_without_lines(grid), top.step_rows(grid.size)), top.path_reach(grid.size)
    path: NDArray[np.intp] = score.argmax(axis=1)
    if np.any(np.abs(np.diff(path)) > reach):  # found on the best of each four: quicker to search
        four = score[:, : score.shape[1] // 4 * 4].reshape(len(path), -1, 4)
        path = best_path(four.max(axis=2), ceil(reach / 4))
        path = 4 * path + four[np.arange(len(path)), path].argmax(axis=1)
    return path.astype(np.float32) * np.float32(top.ROWS * grid.size.step_rows) - np.float32(0.5)


def _without_lines(grid: Grid) -> Float:
    """Return pairs of the grid's columns, opened along depth, over the noise floor, (pair, row / ROWS)."""
    _, pairs = top.pairs_of(grid.size.columns, grid.size.step_columns)
    cells = cv2.transpose(grid.cells).take(pairs, axis=0)
    thin = top.line_rows(grid.size)
    floor = cells.dtype.type(grid.floor)
    opened = cv2.morphologyEx(np.maximum(cells, floor), cv2.MORPH_OPEN, np.ones((1, thin), np.uint8)) - floor
    first = (cells > top.BLACK_SHARE * grid.floor).argmax(axis=1)
    for column in np.flatnonzero(first):  # the upper edge of the measured part is no surface
        edge = min(first[column] + thin, opened.shape[1] - 1)
        opened[column, :edge] = opened[column, edge : edge + 3].max()
    size = (opened.shape[1] // top.ROWS, len(pairs) // 2)
    return cv2.resize(opened[:, : top.ROWS * size[0]], size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _score(tissue: Float, depth: int) -> Float:
    """Return what a surface gains at the upper edge of each cell, shape (column, row)."""
    rows, zero = tissue.shape[1], np.float32(0.0)
    bright = _quantile(tissue[:, ::2].ravel(), top.BRIGHT_SHARE)
    level = np.minimum(tissue * np.float32(1.0 / max(bright, 1e-6)), np.float32(top.LARGEST_LEVEL))
    padded = cv2.copyMakeBorder(level, 0, 0, depth, depth, cv2.BORDER_REPLICATE)
    means = cv2.blur(padded, (depth, 1), anchor=(0, 0))
    step = np.maximum(means[:, depth : depth + rows] - means[:, :rows] - np.float32(top.LEAST_STEP), zero)
    coarse = level[:, ::2]
    excess = np.maximum(coarse - np.minimum.accumulate(coarse, axis=1) - np.float32(top.LEAST_EXCESS), zero)
    above = excess @ np.triu(np.full((excess.shape[1],) * 2, top.EXCESS_COST * 2.0 / depth, np.float32), 1)
    above = np.minimum(above, np.float32(top.EXCESS_COST * top.EXCESS_CAP))
    return step / (step + np.float32(top.HALF_STEP)) - np.repeat(above, 2, axis=1)[:, :rows] + top.downwards(rows)


def refine_surface(frame: Pixels, scale: PixelScale, row: Float, grid: Grid, hidden: slice) -> Surface:
    """Move a coarse surface to the edge of the full frame: the best two-level fit along each column of a strip.

    Between a dark level above and a bright one below, the edge that fits best in the sense of least squares is where
    the sum of (count - middle level) above it is smallest. `hidden` points are not smoothed.
    """
    rows, columns = frame.shape
    half, thin = top.strip_rows(scale)
    fine, (column, _) = fine_columns(columns), top.pairs_of(grid.size.columns, grid.size.step_columns)
    start = continuation(columns, float(column[0]), float(column[1] - column[0]), len(column)) @ row
    start = np.clip(start, np.float32(0.0), np.float32(rows - 1.0))
    map_row = np.arange(-half, half, dtype=np.float32)[:, None] + np.float32(0.5) + start
    raw = _sampled(frame, fine, map_row)
    noise = cv2.meanStdDev(raw[: half - 2])[1].item()
    strip = cv2.morphologyEx(cv2.blur(raw, (3, 3)), cv2.MORPH_OPEN, np.ones((thin, 1), np.uint8)).astype(np.float64)
    end = half - 2
    above, below_edge = strip[:end].mean(axis=0), strip[-end:].mean(axis=0)
    sums = np.cumsum(strip - 0.5 * (above + below_edge), axis=0)
    edge = np.concatenate([np.zeros((1, len(fine))), sums]).argmin(axis=0)
    found = start + edge.astype(np.float32) - np.float32(half)
    if hidden.start == hidden.stop:
        smooth = _smoothed(found)
    else:
        smooth = np.concatenate([_smoothed(found[: hidden.start]), found[hidden], _smoothed(found[hidden.stop :])])
    contrast = cv2.blur((below_edge - above)[None], (5, 1))[0]
    return Surface(fine, smooth.astype(np.float32), contrast.astype(np.float32), noise)


def _sampled(frame: Pixels, column: Float, row: Float) -> Float:
    """Return the counts at points (line, column)."""
    at = np.repeat(column[None], len(row), axis=0)
    return cv2.remap(frame, at, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


def _smoothed(found: Float) -> Float:
    """Return a surface after a median and a mean over five points."""
    if len(found) < top.SMOOTHED:
        return found
    # Mirrored in its end points, a slope continues beyond them.
    longer = np.concatenate([2 * found[0] - found[4:0:-1], found, 2 * found[-1] - found[-2:-6:-1]])
    return cast(Float, cv2.blur(cv2.medianBlur(longer[None], 5), (5, 1))[0, 4:-4])


def surface_stretch(column: Float, row: Float, lateral_m: float, depth_m: float) -> Float:
    """Return by how much a wall is longer along a column than along the surface's normal, shape (column,)."""
    step_m = float(column[1] - column[0]) * lateral_m
    reach = min(max(1, round(below.SLOPE_M / step_m)), (len(column) - 1) // 2)
    longer = np.concatenate((2 * row[0] - row[reach:0:-1], row, 2 * row[-1] - row[-2 : -2 - reach : -1]))
    slope = (longer[2 * reach :] - longer[: -2 * reach]) * np.float32(depth_m / (2 * reach * step_m))
    return np.sqrt(np.minimum(np.square(slope), np.float32(below.STEEPEST**2)) + np.float32(1.0))


def find_inner(
    frame: Pixels, floor: float, column: Float, row: Float, there: Flags, along_rows: Float
) -> tuple[Float, float]:
    """Return thickness along the normal at each group, m, and the share of groups that show the inner boundary.

    Columns and rows of the surface (point,), whether there is one, and rows of the frame along a column for 1 m of
    thickness along the normal.
    """
    wall, seen = _unroll(frame, floor, column, row, there, along_rows)
    mean, bend, jump = _jumps(wall, seen)
    least = _least_jump(jump)
    gain = np.maximum(jump - least, np.float32(0.0))
    gain /= gain + np.float32(below.HALF_JUMP)
    score = gain - below.ROW_COST
    near, far = below.LAYER_CELLS
    # The largest of the jumps `far - near` cells above, down to here.
    upper = cast(Float, cv2.dilate(gain, np.ones((1, far - near + 1), np.uint8), anchor=(far - near, 0)))
    score[:, near:] -= upper[:, :-near] * np.float32(below.UPPER_COST)
    path = best_path(score, below.REACH_CELLS)
    point = np.arange(len(path))
    first, size = np.maximum(path - (SKIP_EDGE + LINE_CELLS), 0), jump[point, path]
    boundary = _cross(wall, path, mean[point, first], bend[point, first], np.maximum(size, np.float32(0.0)))
    testable = seen[point, np.minimum(path + SKIP_EDGE, CELLS - 1)] > 0
    shown = (size > least[path]) & testable
    weight = shown + np.float32(1e-3)
    smooth = cv2.blur((boundary * weight)[None], (5, 1))[0] / cv2.blur(weight[None], (5, 1))[0]
    support = int(np.count_nonzero(shown)) / max(1, int(np.count_nonzero(testable)))
    return smooth * np.float32(below.CELL_M), support


def _unroll(
    frame: Pixels, floor: float, column: Float, row: Float, there: Flags, along_rows: Float
) -> tuple[Float, Float]:
    """Return the wall as (group, cell), surface level 1 and floor 0, and where it is measured (1 or 0)."""
    thickness_m, group = below.THICKNESS_M, below.GROUP
    map_row = np.stack([np.ones_like(thickness_m), thickness_m], axis=1) @ np.stack([row, along_rows])
    sampled = _sampled(frame, column, map_row)
    light = cast(Float, cv2.resize(sampled, (len(row) // group, CELLS), interpolation=cv2.INTER_AREA)).T
    deepest_m = (len(frame) - 1 - row) / along_rows * there
    ends = np.minimum(deepest_m[::group], deepest_m[group - 1 :: group])
    seen = (ends[:, None] >= thickness_m).astype(np.float32)
    light = np.maximum(light - np.float32(floor), np.float32(0.0)) * seen
    near_surface = slice(below.SKIP_CELLS, below.LEVEL_CELLS)
    level = light[:, near_surface].sum(axis=1) / np.maximum(seen[:, near_surface].sum(axis=1), np.float32(1.0))
    level = cast(Float, cv2.blur(level[:, None], (1, 3)))
    seen *= level > max(below.LEAST_LEVEL_SHARE * float(level.max()), 1e-9)
    return np.minimum(light * (seen / np.maximum(level, np.float32(1e-6))), np.float32(below.BRIGHTEST)), seen


def _jumps(wall: Float, seen: Float) -> tuple[Float, Float, Float]:
    """Return straight lines through the cells, and the jump at each edge between cells; neighbours are pooled.

    For the lines that start at each cell: their mean, and by how much they fall from their middle to the jump, both
    (group, cell); jump (group, cell + 1): by how much the cells below lie lower than the line above, continued.
    """
    share = cv2.blur(seen, (1, POOLED))
    pooled = cv2.blur(wall, (1, POOLED)) / np.maximum(share, np.float32(1e-3))

    def weighted(weights: NDArray[Any]) -> Float:
        return cast(Float, cv2.filter2D(pooled, -1, weights[None].astype(np.float32), anchor=(0, 0)))

    mean, low = weighted(np.full(LINE_CELLS, 1.0 / LINE_CELLS)), weighted(np.full(LOW_CELLS, 1.0 / LOW_CELLS))
    bend = np.minimum(weighted(below.BEND), np.float32(0.0))
    jump = np.zeros((len(wall), CELLS + 1), dtype=np.float32)
    line = np.maximum(bend[:, _ABOVE] * below.BEND_TO_LOW + mean[:, _ABOVE], np.float32(0.0))
    jump[:, EDGES] = (line - low[:, _BELOW]) * (share[:, _DEEPEST] > np.float32(0.3))
    return mean, bend, jump


def _least_jump(jump: Float) -> Float:
    """Return the jump that stands out at each edge, shape (edge,), from what speckle and texture make."""
    sizes = np.abs(jump[:, EDGES.start : EDGES.stop : 2]).ravel()
    sizes = sizes[sizes > 0]
    typical = _quantile(sizes, 0.5) if len(sizes) else 0.0
    change = np.square(jump[POOLED:] - jump[:-POOLED])
    spread = np.sqrt(np.full(len(change), 0.5 / len(change), np.float32) @ change)
    least = cv2.blur(spread[None], (below.SPREAD_CELLS, 1))[0] * np.float32(below.SURE_SPREAD)
    return np.maximum(least, np.float32(max(below.LEAST_JUMP, below.SURE_JUMP * typical)))


def _cross(wall: Float, path: NDArray[np.intp], mean: Float, bend: Float, jump: Float) -> Float:
    """Return the edge near a path, in cells, shape (group,), that best parts light above and below a jump's middle."""
    path = np.clip(path, REFINE_CELLS, CELLS - REFINE_CELLS)
    near = path[:, None] + np.arange(-REFINE_CELLS, REFINE_CELLS)
    above = cv2.blur(wall, (1, 3))[np.arange(len(path))[:, None], near]
    above = above - bend[:, None] * below.FROM_MIDDLE - (mean - jump / 2)[:, None]
    limit = np.maximum(jump, np.float32(1e-3))[:, None]
    sums = np.cumsum(np.clip(above, -limit, limit), axis=1, dtype=np.float32)
    best = np.concatenate([np.zeros((len(path), 1), np.float32), sums], axis=1).argmax(axis=1)
    return (path + best).astype(np.float32) - np.float32(REFINE_CELLS)


def best_path(score_cr: Float, reach: int) -> NDArray[np.intp]:
    """Return the path of `loops.best_path` by dynamic programming; OpenCV's dilation is the maximum over a window."""
    best: NDArray[np.intp] = score_cr.argmax(axis=1)
    if not np.any(np.abs(np.diff(best)) > reach):
        return best
    total = np.stack([score_cr, score_cr[::-1]], axis=1)  # both directions at once
    window = np.ones((1, 2 * reach + 1), np.uint8)
    for before, after in pairwise(total):
        after += cv2.dilate(before, window)
    through: Float = total[:, 0] + total[::-1, 1] - score_cr
    return through.argmax(axis=1)


def at_columns(columns: int, left: int, width: int, there: Flags, *curves: Float) -> list[NDArray[np.float64]]:
    """Return curves at the columns of a frame whose imaged part starts at `left` and is `width` wide.

    NaN outside of that part, and where the nearest point is not there.
    """
    fine, known = fine_columns(width), there[nearest_point(width)]
    used = np.full_like(there, True) if known.all() else there
    filled = np.full((len(curves), columns), np.nan)
    for curve, rows in zip(filled, curves, strict=True):
        curve[left : left + width] = np.where(known, np.interp(np.arange(width), fine[used], rows[used]), np.nan)
    return list(filled)


def pair_contrast(frame: Pixels) -> float:
    """Return the contrast of `light.pair_contrast`."""
    rows = frame[:: max(1, len(frame) // lit_of.LOOKED_AT_ROWS)].astype(np.int32)
    one, other = rows[:, lit_of.PAIR_COLUMNS :], rows[:, : -lit_of.PAIR_COLUMNS]
    lit = (one > 0) & (other > 0)
    one, other = one[lit], other[lit]
    if len(one) < lit_of.LEAST_PAIRS:
        return 0.0
    total = one + other
    place, mean = int(lit_of.DIMMER * len(total)), total >> 1
    brightest = mean >= np.partition(mean, place)[place]
    shares = np.abs(one - other)[brightest].astype(np.float32) / total[brightest].astype(np.float32)
    return float(np.median(shares))


def boundary_depths(segmentation: BoundaryRows, scale: PixelScale, slice_study: SliceStudy) -> NDArray[np.float64]:
    """Return the depth of both boundaries at the centres of the slice's columns, (2, columns), m, NaN without wall."""
    outer_row, inner_row = segmentation.outer_row, segmentation.inner_row
    middle = np.arange(slice_study.columns) + 0.5 - slice_study.columns / 2
    at = middle * slice_study.pixel_m / scale.lateral_m + len(outer_row) / 2 - 0.5
    nearest, inside = np.rint(at).astype(int).clip(0, len(outer_row) - 1), (at >= -0.5) & (at <= len(outer_row) - 0.5)
    there = np.isfinite(outer_row) & np.isfinite(inner_row)
    known, columns = there[nearest] & inside, np.flatnonzero(there)
    if not known.any():
        return np.full((2, len(at)), np.nan)
    outer_m, inner_m = (
        (np.interp(at, columns, rows[columns]) + 0.5) * scale.depth_m for rows in (outer_row, inner_row)
    )
    inner_m = (inner_m - outer_m) / scale.refractive_index + outer_m
    return np.where(known, np.stack([outer_m, inner_m]), np.nan)
