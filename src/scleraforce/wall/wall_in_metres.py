"""The boundaries of a segmented frame in metres, points on them with their noise (paper
sec. 3.2, Fig. 4), and slices.

Half of the points lie on the outer boundary, half on the inner, at evenly spaced
lateral places within a span about the needle; so a frame whose dent leaves the window
still gives all its points. A point is the value of a parabola fitted to the boundary
over a short stretch: speckle makes the boundary rough, and roughness is correlated over
a few columns, so the stretch counts as fewer columns than it has.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, sqrt

import numpy as np

from scleraforce.base.arrays import Bytes, Floats, Places
from scleraforce.base.compiled_loops import compiled, compiled_in_place
from scleraforce.base.errors import FrameError
from scleraforce.records.frame import MASK_SD_ROWS, NOT_JUDGED, WALL
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import SliceStudy
from scleraforce.wall.frame_light import LEAST_SHAPE
from scleraforce.wall.wall import Segmentation, surface_fault, without_wall

STRETCH_M = 0.3e-3  # to either side of a point
LEAST_COLUMNS = 5  # for a parabola
LARGEST_CORRELATION = 0.97
# share of a pixel, in depth and sideways, that the segmentation cannot resolve; common
# to a stretch
PIXEL_SHARE = 0.5
# a boundary this near to the last row is where the frame ends, not where the wall does
BOTTOM_M = 0.1e-3
# margin needed between the expected inner boundary and the bottom of the image, as a
# share of the thickness
HIDDEN_SHARE = 0.25
# largest unevenness of the thickness: bending hardly changes it, so more is not the
# wall's inner boundary
UNEVEN_SHARE = 0.2
# stretch, 37 degrees: the inner boundary is sought down the columns, and lost on
# steeper parts
STEEPEST = 1.25
# where a dent is, and where the wall beside it
MIDDLE_M = 1.2e-3
ASIDE_M = 3e-3
FLANK_M = 0.3e-3
SLOPE_M = 0.3e-3  # over which the surface's slope is taken


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Outer and inner boundary of the wall in a frame: geometric depth, free of
    refraction.
    """

    lateral_m: Floats  # (column,), from the frame's middle, increasing
    depth_m: Floats  # (2, column), from its top edge, NaN where unseen
    pixel_m: float  # depth of a pixel
    # standard deviation of boundaries that were given, 0 of those found
    sd_m: float = 0.0


def segmented_boundaries(segmentation: Segmentation, scale: PixelScale) -> Boundaries:
    """Return the boundaries of a segmented frame, free of refraction, NaN where they
    are not seen.

    OCT measures optical depth: below the surface it is stretched by the refractive
    index, above it is not. Where the frame ends before the wall does, where the wall is
    steep, or far from as thick as elsewhere, the inner boundary is not used.
    """
    lateral_m, outer_m = surface_places(segmentation, scale)
    bottom_m = segmentation.rows * scale.depth_m - BOTTOM_M
    inner_m = np.full_like(outer_m, np.nan)

    if segmentation.inner_found:
        index = scale.refractive_index
        optical_m = (segmentation.inner_row - segmentation.outer_row) * scale.depth_m
        stretch = stretch_of(lateral_m, outer_m)
        stretched_m = segmentation.thickness_m * stretch
        seen = outer_m + (1 + HIDDEN_SHARE) * stretched_m * index < bottom_m
        even = np.abs(optical_m / index - stretched_m) < UNEVEN_SHARE * stretched_m
        inner_m = np.where(
            seen & even & (stretch < STEEPEST), outer_m + optical_m / index, np.nan
        )

    return Boundaries(
        lateral_m,
        np.stack([outer_m, inner_m]),
        scale.depth_m,
        segmentation.sd_rows * scale.depth_m,
    )


def surface_places(
    segmentation: Segmentation, scale: PixelScale
) -> tuple[Floats, Floats]:
    """Return the columns' lateral places from the frame's middle and the surface's
    depth, (column,), m; NaN: unseen.
    """
    columns = len(segmentation.outer_row)
    lateral_m = (
        np.arange(columns, dtype=np.float64) + (0.5 - columns / 2)
    ) * scale.lateral_m
    # Row r is centred half a pixel below its upper edge.
    outer_m = (segmentation.outer_row + 0.5) * scale.depth_m
    outer_m[~(outer_m < segmentation.rows * scale.depth_m - BOTTOM_M)] = np.nan

    return lateral_m, outer_m


def dent_depth_m(boundaries: Boundaries) -> float:
    """Return the depth of the surface below the line through its flanks, m; NaN if it
    is not seen there.

    It grows with the force without a model; its zero depends on the eye.
    """
    lateral_m = boundaries.lateral_m
    depth_m = boundaries.depth_m[0]
    middle = (np.abs(lateral_m) < MIDDLE_M) & np.isfinite(depth_m)

    flanks = [
        (np.abs(lateral_m - side) < FLANK_M) & np.isfinite(depth_m)
        for side in (-ASIDE_M, ASIDE_M)
    ]
    if not (middle.any() and flanks[0].any() and flanks[1].any()):
        return float("nan")

    line_m = np.interp(
        lateral_m[middle],
        [-ASIDE_M, ASIDE_M],
        [float(depth_m[flank].mean()) for flank in flanks],
    )
    return float((depth_m[middle] - line_m).max())


def assumed_inner_row(
    segmentation: Segmentation, scale: PixelScale, thickness_m: float
) -> Floats:
    """Return the rows of an inner boundary that lies a thickness below the surface,
    along its normal, (column,); NaN without a surface.
    """
    reach = max(1, round(SLOPE_M / 2 / scale.lateral_m))
    below_rows = thickness_m * scale.refractive_index / scale.depth_m
    steepness = scale.depth_m / scale.lateral_m
    return _rows_below(segmentation.outer_row, reach, steepness, below_rows)


@compiled
def _rows_below(
    outer_row: Floats, reach: int, steepness: float, below_rows: float
) -> Floats:
    """Return rows below a surface along its normal, (column,): by `below_rows` where it
    is level.

    Its slope is taken between the outermost columns that show it within `reach`;
    `steepness`: the slope of one row in a column.
    """
    columns = len(outer_row)
    inner_row = np.full(columns, np.nan)
    for column in range(columns):
        if np.isnan(outer_row[column]):
            continue

        left = max(column - reach, 0)
        while np.isnan(outer_row[left]):
            left += 1
        right = min(column + reach, columns - 1)
        while np.isnan(outer_row[right]):
            right -= 1

        rise = outer_row[right] - outer_row[left]
        slope = rise / max(right - left, 1) * steepness
        inner_row[column] = outer_row[column] + below_rows * np.sqrt(1.0 + slope**2)

    return inner_row


WAVE_M = 4e-3  # half the length of the wave that `dent_measures` lays on a surface


def dent_measures(lateral_m: Floats, outer_m: Floats) -> tuple[float, float]:
    """Return two measures that grow with the dent, m: its depth below the surface's
    mean, and the size of a wave in the middle; NaN where they are not seen.

    The first one needs the deepest place, the second one spans a gap there. Which of
    both follows the force better depends on the frame (a needle in the picture, a dent
    that leaves it).
    """
    seen = np.isfinite(outer_m)
    middle = (np.abs(lateral_m) < MIDDLE_M) & seen
    depth_m = outer_m[middle].max() - outer_m[seen].mean() if middle.any() else np.nan

    near = seen & (np.abs(lateral_m) < WAVE_M)
    if near.sum() < LEAST_SHAPE or np.ptp(lateral_m[near]) < WAVE_M:
        return float(depth_m), float("nan")

    at_m = lateral_m[near]
    wave = np.cos(np.pi * at_m / WAVE_M)
    design = np.stack([np.ones_like(at_m), at_m, wave], axis=1)
    terms = np.linalg.lstsq(design, outer_m[near], rcond=None)[0]
    return float(depth_m), float(terms[2])


def stretch_of(lateral_m: Floats, outer_m: Floats) -> Floats:
    """Return depth along a column over thickness along the normal, NaN where the
    surface is unseen.
    """
    half = max(1, round(SLOPE_M / 2 / (lateral_m[1] - lateral_m[0])))
    slope = np.full_like(outer_m, np.nan)
    slope[half:-half] = (outer_m[2 * half :] - outer_m[: -2 * half]) / (
        lateral_m[2 * half :] - lateral_m[: -2 * half]
    )
    return np.sqrt(1 + slope**2)


@dataclass(frozen=True, eq=False)
class Observation:
    """Observed points, each (point,): lateral place and depth in m, boundary (0 outer,
    1 inner), noise in m.
    """

    lateral_m: Floats
    depth_m: Floats
    boundary: Places
    sd_m: Floats


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """Scatter of a boundary about its smooth course: standard deviation along the
    normal, lag-1 correlation.
    """

    sd_m: float
    correlation: float

    def columns_as_one(self) -> float:
        """Number of neighbouring columns that count as one independent observation
        (AR(1)).
        """
        return (1 + self.correlation) / (1 - self.correlation)


def observe_points(
    boundaries: Boundaries, count: int, centre_m: float, span_m: float
) -> Observation:
    """Take at most `count` points about the needle, at `centre_m`: half (rounded up)
    outer ones, the rest inner.
    """
    parts: list[tuple[float, float, int, float]] = []
    inside = np.abs(boundaries.lateral_m - centre_m) <= span_m

    for boundary, wanted in enumerate((ceil(count / 2), count // 2)):
        seen = np.flatnonzero(inside & np.isfinite(boundaries.depth_m[boundary]))
        if wanted == 0 or len(seen) < 10 * wanted:
            continue

        share = np.linspace(0.02, 0.98, wanted) if wanted > 1 else np.array([0.5])
        rough = roughness(boundaries, boundary)
        for column in seen[np.rint(share * (len(seen) - 1)).astype(np.intp)].tolist():
            depth_m, sd_m = _point(boundaries, boundary, column, rough)
            parts.append((boundaries.lateral_m[column], depth_m, boundary, sd_m))

    lateral, depth, kind, sd = np.array(parts, dtype=np.float64).reshape(-1, 4).T
    return Observation(lateral, depth, kind.astype(np.intp), sd)


def roughness(boundaries: Boundaries, boundary: int) -> Roughness:
    """Measure the roughness of a boundary from the residuals of parabolas over short
    stretches.
    """
    step = float(np.median(np.diff(boundaries.lateral_m)))
    half = max(2, round(STRETCH_M / step))
    columns = np.flatnonzero(np.isfinite(boundaries.depth_m[boundary]))
    starts = columns[: len(columns) // (2 * half) * 2 * half].reshape(-1, 2 * half)

    whole = starts[(np.diff(starts, axis=1) == 1).all(axis=1)]
    if len(whole) < 2:
        return Roughness(sd_m=boundaries.pixel_m, correlation=0.0)

    x = np.linspace(-1, 1, 2 * half)
    basis = np.linalg.qr(np.stack([np.ones_like(x), x, x * x], axis=1))[0]
    depth = boundaries.depth_m[boundary][whole]
    rest = depth - (depth @ basis) @ basis.T
    slope = (depth[:, -1] - depth[:, 0]) / (step * (2 * half - 1))
    rest = rest / np.sqrt(1 + slope[:, None] ** 2)
    variance = float(np.median((rest**2).sum(axis=1) / (2 * half - 3)))
    square = np.maximum((rest**2).sum(axis=1), 1e-30)
    correlation = float(np.median((rest[:, 1:] * rest[:, :-1]).sum(axis=1) / square))
    # what the parabola takes off it (Kendall 1954)
    correlation += (1 + 3 * correlation) / (2 * half)
    sd = sqrt(max(variance, boundaries.pixel_m**2 / 12))

    return Roughness(
        sd_m=sd, correlation=min(max(correlation, 0.0), LARGEST_CORRELATION)
    )


def _point(
    boundaries: Boundaries, boundary: int, column: int, rough: Roughness
) -> tuple[float, float]:
    """Return depth and noise of the boundary at a column, from the stretch around
    it.
    """
    half = max(
        2, round(STRETCH_M / (boundaries.lateral_m[1] - boundaries.lateral_m[0]))
    )
    first = max(column - half, 0)
    depth = boundaries.depth_m[boundary, first : column + half + 1]
    seen = np.isfinite(depth)

    offsets = tuple((np.flatnonzero(seen) + first - column).tolist())
    if len(offsets) < LEAST_COLUMNS:
        return float(boundaries.depth_m[boundary, column]), 10 * boundaries.pixel_m

    weights = _parabola_weights(offsets)
    value, slope = weights @ depth[seen]
    step_m = boundaries.lateral_m[1] - boundaries.lateral_m[0]
    slope /= step_m
    independent = min(float(weights[0] @ weights[0]) * rough.columns_as_one(), 1.0)
    speckle = rough.sd_m**2 * independent * (1 + slope**2)

    return float(value), sqrt(
        speckle + PIXEL_SHARE**2 * (boundaries.pixel_m**2 + (slope * step_m) ** 2)
    )


@lru_cache(maxsize=1024)
def _parabola_weights(offsets: tuple[int, ...]) -> Floats:
    """Return the weights (2, column) of values at `offsets` in the value and slope at 0
    of their parabola.
    """
    x = np.array(offsets, dtype=np.float64)
    return np.linalg.pinv(np.stack([np.ones_like(x), x, x * x], axis=1))[:2]


def boundary_slice(
    segmentation: Segmentation, scale: PixelScale, slice_study: SliceStudy
) -> Bytes:
    """Draw the wall of a frame into the slice's window, (rows, columns): 255 where a
    pixel's centre lies in the wall.

    The window is centred on the frame laterally and starts at its top edge. Boundaries
    are interpolated between the frame's columns, as in `fill_section`, and free of
    refraction. Columns outside the frame or without a wall are 0.
    """
    wall: Bytes = boundary_slices(segmentation, scale, slice_study, (0.0,))[0][0]
    return wall


def boundary_slices(
    segmentation: Segmentation,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...],
) -> tuple[Bytes, bool, float]:
    """Draw the wall as `boundary_slice`, in windows that start lower by shares of a row
    (shift, rows, columns).

    Then follow what `dent_leaves` says of the first, and the distance between the ends
    of the surface in it, m.
    """
    walls = np.zeros((len(shifts), slice_study.rows, slice_study.columns), np.uint8)
    extent_m = _draw_walls(
        walls,
        segmentation.outer_row,
        segmentation.inner_row,
        segmentation.rows * scale.depth_m - BOTTOM_M,
        (scale.lateral_m, scale.depth_m, scale.refractive_index),
        slice_study.pixel_m,
        np.array(shifts),
    )
    return walls, dent_leaves(walls[0]), extent_m


@compiled
def _draw_walls(
    walls: Bytes,
    outer_row: Floats,
    inner_row: Floats,
    bottom_m: float,
    scale: tuple[float, float, float],
    pixel_m: float,
    shift_s: Floats,
) -> float:
    """Set the pixels of slices (shift, row, column) whose centre lies in the wall to
    `WALL`; return the distance between the ends of the surface in them, m.

    `outer_row` and `inner_row` (column,), NaN where there is no wall; a surface below
    `bottom_m` is where the frame ends. `scale`: width and depth of a pixel of the
    frame, m, and the refractive index.
    """
    lateral_m, depth_m, index = scale
    width = len(outer_row)
    _, rows, columns = walls.shape
    there = np.empty(width, np.int64)  # columns with both boundaries
    count = 0
    first = last = -1  # columns of the surface in the window
    for column in range(width):
        if np.isfinite(outer_row[column]) and np.isfinite(inner_row[column]):
            there[count] = column
            count += 1

        place_m = (column + (0.5 - width / 2)) * lateral_m
        if (
            abs(place_m) <= columns * pixel_m / 2
            and (outer_row[column] + 0.5) * depth_m < bottom_m
        ):
            first = column if first < 0 else first
            last = column

    before = 0
    for column in range(columns):
        at = (column + 0.5 - columns / 2) * pixel_m / lateral_m + width / 2 - 0.5
        if not -0.5 <= at <= width - 0.5:
            continue

        nearest = int(min(max(np.rint(at), 0.0), width - 1.0))
        if not (np.isfinite(outer_row[nearest]) and np.isfinite(inner_row[nearest])):
            continue

        while before < count - 2 and there[before + 1] <= at:
            before += 1

        outer_m = (_between(outer_row, there, before, count, at) + 0.5) * depth_m
        inner_m = (_between(inner_row, there, before, count, at) + 0.5) * depth_m
        end_m = outer_m + (inner_m - outer_m) / index
        for number in range(len(shift_s)):
            for row in range(rows):
                middle_m = (row + 0.5 + shift_s[number]) * pixel_m
                if outer_m <= middle_m < end_m:
                    walls[number, row, column] = WALL

    return (last - first) * lateral_m if first >= 0 else 0.0


@compiled_in_place
def _between(
    values: Floats, there: Places, before: int, count: int, at: float
) -> float:
    """Return a boundary at a place, linear between columns that show it and level
    beyond the first and the last of them.
    """
    left = there[before]
    if count == 1 or at <= left:
        return values[left]
    right = there[before + 1]
    if at >= right:
        return values[right]
    slope = (values[right] - values[left]) / (right - left)
    return slope * (at - left) + values[left]


@compiled
def dent_leaves(cut: Bytes) -> bool:
    """Return True if the wall of a slice (row, column) leaves through the bottom and
    comes in again.

    Most columns between two that reach into the lowest quarter then have no wall, the
    others fragments.

    >>> dent = np.full((4, 3), 255, dtype=np.uint8)
    >>> dent[:, 1] = 0
    >>> shadow = dent.copy()
    >>> shadow[1:, 2] = 0
    >>> dent_leaves(dent), dent_leaves(shadow)
    (True, False)
    """
    rows, columns = cut.shape
    last = -1
    missing = 0
    leaves = False

    for column in range(columns):
        unseen = deep = 0
        for row in range(rows):
            unseen += cut[row, column] > 0
            deep += cut[row, column] > 0 and row >= rows - rows // 4

        missing += unseen == 0
        if deep > 0:
            leaves = leaves or (last >= 0 and 2 * missing > column - last - 1)
            last = column
            missing = 0

    return leaves


def given_wall(
    mask: Bytes, scale: PixelScale, sd_rows: float = MASK_SD_ROWS, source: str = "mask"
) -> Segmentation:
    """Return the wall of a mask (row, column) of NO_WALL, NOT_JUDGED and WALL
    (`recordings.drawn_walls`).

    A boundary lies in the middle between a row with wall and one without. A column is
    left out if a pixel of it is not judged, if its wall touches the frame's first row,
    or is interrupted. `sd_rows`: of the boundaries, rows.
    """
    rows = len(mask)
    is_wall = mask == WALL
    first = is_wall.argmax(axis=0)
    last = rows - is_wall[::-1].argmax(axis=0)
    count = is_wall.sum(axis=0)
    judged = ~(mask == NOT_JUDGED).any(axis=0)
    whole = judged & (count > 0) & (last - first == count) & (first > 0)
    outer_row = np.where(whole, first - 0.5, np.nan)
    inner_row = np.where(whole, last - 0.5, np.nan)
    fault = surface_fault(int(whole.sum()), max(int(judged.sum()), 1), 1.0, 1.0)

    if whole.sum() < LEAST_SHAPE:
        return without_wall(mask.shape, fault or "no wall was found")

    wall = Segmentation(
        outer_row,
        inner_row,
        rows,
        not fault,
        fault,
        True,
        thickness_m=0.0,
        source=source,
        sd_rows=sd_rows,
    )
    lateral_m, outer_m = surface_places(wall, scale)
    along_m = (
        (inner_row - outer_row)
        * scale.depth_m
        / scale.refractive_index
        / stretch_of(lateral_m, outer_m)
    )
    inside = (last < rows) & np.isfinite(along_m)
    thickness_m = float(np.median(along_m[inside])) if inside.any() else float("nan")

    return replace(wall, inner_found=bool(inside.any()), thickness_m=thickness_m)


def check_mask_size(mask: Bytes, shape: tuple[int, ...], place: str) -> None:
    """Raise a `FrameError` naming `place` unless a mask has the shape of its frame."""
    if mask.shape != shape:
        size, of_frame = (
            f"{rows} x {columns}" for rows, columns in (mask.shape, shape)
        )
        raise FrameError(f"{place}: {size} pixels, the frame has {of_frame}")
