"""The needle in a frame: a thin bright line from the frame's top edge down to the
tissue, and the shadow below it.

Where something stands out in the uppermost rows, the straight line that shines longest
is looked for (a Hough transform whose lines begin at the top edge), then another one
beside it. Such lines are a shaft's only where the tissue below them is darker than that
beside, and they end at it: what shines through the tissue, or continues below it, is a
flare, and a shadow without a line is a vessel's.
"""

from dataclasses import dataclass, replace
from math import atan, hypot
from typing import Any, cast

import cv2
import numpy as np

from scleraforce.base.arrays import Counts, Flags, Floats, Places, Singles
from scleraforce.base.units import from_si
from scleraforce.records.frame import Pixels
from scleraforce.wall.frame_light import GridSize

MARGIN_M = 0.1e-3  # beside a shadow light is not yet whole
DARK_SHARE = 0.35  # of the tissue's usual level: a column with less is in the shadow
LIT_SHARE = 0.5  # ... one with more is not
SHADED_SHARE = 0.93  # of the level beside: the tissue under a needle is darker
BESIDE_M = 2.5e-3
TISSUE_M = 0.1e-3  # depth over which light is tissue's: thinner lines are not
HOVERING_M = 0.3e-3  # over the surface beside it, at most: a needle's tip
BELOW_M = 1.2e-3  # below a line's end, from where on no tissue is expected
# from there down to the frame's end, at least, to judge the light there
DEEP_M = 0.5e-3
NEAR_M = 0.5e-3  # beside a line's end: columns that its own is compared with
PARTS = 3  # of that depth
# of the spread of a frame's light: a flare is brighter by so much in all parts, drawn
# needles by 0.015
STREAK = 0.06
# columns of the grid with tissue on each side, which tell where its surface is
NEAREST = 6
# share of the width: an edge longer than the other one by this is the point of a bevel
BEVELLED = 0.6
# of the longer line: as far down the other one of two sides of a shaft goes, at least
SAME_LENGTH = 0.7
# the cut of the thickest needle (22G, 18 degrees); longer lines are shafts
BEVEL_M = 2.2e-3
# and at least 4 rows: the shaft comes in through the top edge
TOP_M = 0.19e-3
TOP_ROWS = 4

POOLED_M = 62e-6  # of depth taken as one, for the coarse search
WIDEST_M = 1.3e-3  # between the edges of a shaft, along the columns
# a line is narrower along the columns, or narrower than 5 pixels
LINE_M = 0.4e-3
LINE_COLUMNS = 5
STEEPEST = 1.2  # columns over rows in metres: 50 degrees off the depth
SLOPES = 81
BRIGHT = 4.0  # spreads of the background: as bright as this is all that counts
LEAST_BRIGHT = 0.45  # of that: a line continues while it is brighter in the mean
LEAST_LENGTH_M = 0.1e-3  # of full brightness, over LEAST_BRIGHT: a shaft is not shorter
NEAR_SLOPES = 2  # steps of the slope that a coarse line may be off
NEAR_COLUMNS = 2.0  # of the frame: what shines so near to a line belongs to it
LEAST_ROWS = 4
MORE_M = 0.3e-3  # a line may continue farther than the grid shows
OTHER_SHARE = 0.35  # of the first edge's length: the other edge's


@dataclass(frozen=True, kw_only=True)
class ShaftEdge:
    """A line from the top edge down: column there, slope in columns a row, last row,
    and how many rows it shines.
    """

    top: float
    slope: float
    row: int
    length: float

    @property
    def end(self) -> float:
        """Its column in its last row."""
        return self.top + self.slope * (self.row + 0.5)


@dataclass(frozen=True)
class SeenNeedle:
    """A needle seen in a frame."""

    # : between its shaft and the depth; above 0 it leans to growing columns on its way
    # up
    angle_rad: float
    # : from the middle and the top edge, None if the shaft leaves below the frame
    tip_m: tuple[float, float] | None
    tip: tuple[float, float]  #: column and row, or of the last that is seen of it
    top: tuple[float, float]  #: column and row where its axis meets the top edge
    # : the first column that shaft or shadow cover, and the first one after
    hidden: tuple[int, int]
    # : as `angle_rad`, of the axis; None if the lines may be a bevel's, or one side's
    axis_rad: float | None = None


def needle_entry(needle: SeenNeedle | None) -> dict[str, Any] | None:
    """Return a needle for JSON: its angle off the depth, where it leans on its way up,
    its tip.

    >>> seen = SeenNeedle(
    ...     angle_rad=-0.5,
    ...     tip_m=(1e-4, 2e-3),
    ...     tip=(259.0, 256.0),
    ...     top=(200.0, -0.5),
    ...     hidden=(199, 270),
    ... )
    >>> needle_entry(seen)
    {'angle_deg': 28.65, 'leans': 'left', 'tip_mm': [0.1, 2.0]}
    """
    if needle is None:
        return None

    return {
        "angle_deg": round(from_si(abs(needle.angle_rad), "deg"), 2),
        "leans": "left" if needle.angle_rad < 0.0 else "right",
        "tip_mm": (
            None
            if needle.tip_m is None
            else [round(from_si(place_m, "mm"), 4) for place_m in needle.tip_m]
        ),
    }


def find_needle(
    frame: Pixels, cells: Counts, size: GridSize, begin: Places, left: int, columns: int
) -> SeenNeedle | None:
    """Return the needle in the imaged part of a frame of `columns`, whose first imaged
    one is `left`, or None.

    It begins in one of the columns `begin` of the grid, `cells` of a size: see
    `frame_light.brighter_columns`.
    """
    edges = _find_edges(frame, cells, size, begin)
    shaded = _shaded(cells, size, edges) if edges else None
    if shaded is None:
        return None

    (column, row), (first, after) = shaded
    lateral_m = size.scale.lateral_m / size.step_columns
    depth_m = size.scale.depth_m / size.step_rows
    tip = left + column, (row + 1.0) * size.step_rows - 0.5
    slope = edges[0].slope / size.step_rows
    axis = _axis_slope(edges, size)
    ends = row < len(cells) - 1.0

    return SeenNeedle(
        angle_rad=-atan(slope * lateral_m / depth_m),
        tip_m=(
            ((tip[0] + 0.5 - columns / 2) * lateral_m, (tip[1] + 0.5) * depth_m)
            if ends
            else None
        ),
        tip=tip,
        top=(tip[0] - slope * (tip[1] + 0.5), -0.5),
        hidden=(left + first, left + after),
        axis_rad=(
            None if axis is None else -atan(axis / size.step_rows * lateral_m / depth_m)
        ),
    )


def _axis_slope(edges: list[ShaftEdge], size: GridSize) -> float | None:
    """Return the slope of a shaft's axis, columns a row of the grid; None if its lines
    do not tell it.

    It is midway between two sides, which converge upward where the shaft leaves the
    plane. Lines that meet at the wall belong to a side and a bevel; a short line alone
    may belong to either.
    """
    one = edges[0]
    other = edges[-1]
    if min(one.row, other.row) >= SAME_LENGTH * max(one.row, other.row):
        at_end = (
            one.top
            - other.top
            + (one.slope - other.slope) * (min(one.row, other.row) + 0.5)
        )
        if abs(at_end) > 0.5 * abs(one.top - other.top):
            return 0.5 * (one.slope + other.slope)

    return one.slope if (one.row + 1) * size.scale.depth_m > BEVEL_M else None


def _shaded(
    cells: Counts, size: GridSize, edges: list[ShaftEdge]
) -> tuple[tuple[float, float], tuple[int, int]] | None:
    """Return the tip between edges (column of the imaged part, row of the grid), and
    the span hidden by both.

    None: the tissue below the edges is in no shadow of theirs.
    """
    step = size.step_columns
    columns = cells.shape[1]
    reached = [place for edge in edges for place in (edge.top, edge.end)]
    first = max(0, round(min(reached) / step - 0.5))

    after = min(columns, round(max(reached) / step + 0.5))
    if first >= after:
        return None

    tissue = _tissue(cells, size, edges)
    level: Singles = tissue.max(axis=0)
    reach = max(2, round(BESIDE_M / size.scale.lateral_m))
    beside = _beside(level, first, after, reach)
    usual = float(np.sort(level)[3 * columns // 4])

    lit = beside[beside > LIT_SHARE * usual]
    if not len(lit) or float(np.median(level[first:after])) > SHADED_SHARE * float(
        np.median(lit)
    ):
        return None

    dark = level < DARK_SHARE * usual
    while first > 0 and dark[first - 1]:
        first -= 1

    while after < columns and dark[after]:
        after += 1

    shown = tissue > LIT_SHARE * usual
    tip = _tip(size, edges, (first * step, after * step))

    if _goes_through(size, edges, shown, first, after) or _shines_below(
        cells, size, edges
    ):
        return None
    if not _touches(size, shown, (first, after), tip[1]):
        return None

    margin = max(1, round(MARGIN_M / size.scale.lateral_m))
    return tip, (max(0, first - margin) * step, min(columns, after + margin) * step)


def _touches(
    size: GridSize, lit: Flags, shadow: tuple[int, int], tip_row: float
) -> bool:
    """Return whether tissue is seen on both sides of a shadow, and a tip is not far
    above it (a reflex).
    """
    first, after = shadow
    reach = max(2, round(BESIDE_M / size.scale.lateral_m))
    surfaces = []

    for side in (
        lit[:, max(0, first - reach) : first][:, ::-1],
        lit[:, after : after + reach],
    ):
        seen = np.flatnonzero(side.any(axis=0))[:NEAREST]
        if not len(seen):
            return False

        surfaces.append(float(np.median(side[:, seen].argmax(axis=0))))

    return (min(surfaces) - tip_row) * size.scale.depth_m <= HOVERING_M


def _goes_through(
    size: GridSize, edges: list[ShaftEdge], lit: Flags, first: int, after: int
) -> bool:
    """Return whether edges end far below the tissue's surface beside them: a flare's
    do.
    """
    around = max(1, round(MARGIN_M / size.scale.lateral_m)) + 1
    sides = lit[:, max(0, first - around) : first], lit[:, after : after + around]
    surfaces = [int(side.argmax(axis=0).max()) for side in sides if side.any()]
    below = max(edge.row for edge in edges) - max(surfaces, default=len(lit))
    return below * size.scale.depth_m > WIDEST_M


def _shines_below(cells: Counts, size: GridSize, edges: list[ShaftEdge]) -> bool:
    """Return whether columns in which edges end are brighter than those beside down to
    the frame's end, as in a flare.

    A steep reflection floods its A-scans with light, which remains at all depths; below
    a needle it is dark.
    """
    begin = round(max(edge.row for edge in edges) + BELOW_M / size.scale.depth_m)
    deep: Singles = cells[begin:].astype(np.float32)
    if len(deep) * size.scale.depth_m < DEEP_M or len(deep) < PARTS:
        return False

    ends = [round(edge.end / size.step_columns - 0.5) for edge in edges]
    first = max(0, min(ends))
    after = max(0, max(ends) + 1)
    reach = max(2, round(NEAR_M / size.scale.lateral_m)) + 1
    levels: list[Singles] = [part.mean(axis=0) for part in np.array_split(deep, PARTS)]
    pairs = [
        (level[first:after], _beside(level, first, after, reach)) for level in levels
    ]
    least = STREAK * float(cells.std())

    return all(
        len(one) and len(other) and float(one.mean() - other.mean()) > least
        for one, other in pairs
    )


def _beside(level: Singles, first: int, after: int, reach: int) -> Singles:
    """Return the levels of columns on both sides of others, without those right beside
    them.
    """
    return np.concatenate(
        [
            level[max(0, first - reach) : max(0, first - 1)],
            level[after + 1 : after + reach],
        ]
    )


def _tissue(cells: Counts, size: GridSize, edges: list[ShaftEdge]) -> Singles:
    """Return how bright the tissue in each cell of the grid is, over the background,
    the shaft left out.
    """
    light = cells.astype(np.float32)
    some = np.sort(light[::4, ::2].ravel())
    light -= some[: len(some) // 2].mean()
    rows = np.arange(min(max(edge.row for edge in edges) + 3, len(light)))[:, None]
    at = (np.arange(light.shape[1]) + 0.5) * size.step_columns - 0.5
    lines = np.stack([edge.top + edge.slope * (rows + 0.5) for edge in edges])
    around = 2.0 * size.step_columns
    inside = (at >= lines.min(axis=0) - around) & (at <= lines.max(axis=0) + around)
    light[: len(rows)][inside] = 0.0
    light[: top_rows(size)] = 0.0  # where a shaft comes in it may shine all across
    light = cast(Singles, cv2.blur(light, (1, 3)))
    # what is thinner is a line
    deep = np.ones((max(3, round(TISSUE_M / size.scale.depth_m)), 1), np.uint8)

    return cast(Singles, cv2.erode(light, deep))


def _tip(
    size: GridSize, edges: list[ShaftEdge], dark: tuple[int, int]
) -> tuple[float, float]:
    """Return column and row (of the grid) where the shaft ends: between its edges'
    ends, or at the point of a bevel.

    Where one edge alone is seen, the other one's end is the end of the shadow, on the
    side away from the shaft.
    """
    pixel_m = np.array([size.scale.lateral_m / size.step_columns, size.scale.depth_m])
    ends = np.array([(edge.end, edge.row) for edge in edges])
    if len(ends) == 1:
        column, row = ends[0].tolist()
        other = dark[1] - 1 if edges[0].slope >= 0 else dark[0]
        return (
            0.5 * (column + other)
            if abs(other - column) * pixel_m[0] < WIDEST_M
            else column
        ), row

    along = np.array([edges[0].slope * pixel_m[0], pixel_m[1]])
    along /= hypot(*along)
    apart = (ends[1] - ends[0]) * pixel_m
    longer = float(apart @ along)
    width = abs(float(apart[0] * along[1] - apart[1] * along[0]))
    tip = ends[int(longer > 0)] if abs(longer) > BEVELLED * width else ends.mean(axis=0)

    return float(tip[0]), float(tip[1])


def _find_edges(
    frame: Pixels, cells: Counts, size: GridSize, begin: Places
) -> list[ShaftEdge]:
    """Return the longest bright line of a frame's imaged part, and the one beside it if
    seen, the shaft's own first.
    """
    thin = _thin(cells, size.scale.lateral_m)
    start = np.unique(
        np.clip(np.concatenate([begin - 1, begin, begin + 1]), 0, thin.shape[1] - 1)
    )

    coarse = _best(thin, start.astype(np.float64), _slopes(size), _pooled_rows(size))
    if coarse.length * size.scale.depth_m < LEAST_LENGTH_M:
        return []

    if size.step_rows > 1:  # in the grid's rows, with the frame's own columns
        shape = (frame.shape[1], len(cells))
        frame = frame[: len(cells) * size.step_rows]
        frame = cast(Pixels, cv2.resize(frame, shape, interpolation=cv2.INTER_AREA))

    fine = _thin(frame, size.scale.lateral_m / size.step_columns)
    return _edges(thin, fine, coarse, size)


def _thin(light: Pixels, lateral_m: float) -> Singles:
    """Return the light of structures that are thin along the columns, over the spread
    of the background, at most 1.
    """
    width = max(LINE_COLUMNS, round(LINE_M / lateral_m)) | 1
    opened = cv2.morphologyEx(light, cv2.MORPH_OPEN, np.ones((1, width), np.uint8))
    thin = (light - opened).astype(np.float32)
    some = thin[::4, :: max(1, width // 4)].ravel()
    places = len(some) // 2, 5 * len(some) // 6
    some.partition(places)
    middle = float(some[places[0]])
    high = float(some[places[1]])
    thin -= np.float32(middle)
    thin *= np.float32(1.0 / (BRIGHT * max(high - middle, 1e-6)))
    np.clip(thin, -0.5, 1.0, out=thin)

    return thin


def top_rows(size: GridSize) -> int:
    """Return the number of uppermost rows of a grid."""
    return max(TOP_ROWS, round(TOP_M / size.scale.depth_m))


def _pooled_rows(size: GridSize) -> int:
    return max(1, round(POOLED_M / size.scale.depth_m))


def _slopes(size: GridSize) -> Floats:
    """Return the slopes to try, columns a row."""
    return np.linspace(-STEEPEST, STEEPEST, SLOPES) * (
        size.scale.depth_m / size.scale.lateral_m
    )


def _edges(
    thin: Singles, fine: Singles, coarse: ShaftEdge, size: GridSize
) -> list[ShaftEdge]:
    """Return the shaft's edge near a coarse line, and the other edge if it is seen, the
    shaft's own one first.

    `thin` are the thin structures in the grid, `fine` structures in the frame's own
    columns.
    """
    first = _refined(fine, coarse, size)
    widest = max(2, round(WIDEST_M / size.scale.lateral_m))
    deepest = coarse.row + round(WIDEST_M / size.scale.depth_m)
    others = np.setdiff1d(np.arange(-widest, widest + 1), [-1, 0, 1]) + coarse.top
    other = _best(
        _without(thin[:deepest], coarse, 1.0),
        others,
        _slopes(size)[::2],
        _pooled_rows(size),
    )

    meets = (
        abs(other.end - coarse.end) <= widest
        and abs(other.row - coarse.row) * size.scale.depth_m <= WIDEST_M
    )
    if not meets or other.length < OTHER_SHARE * coarse.length:
        return [first]

    second = _refined(_without(fine, first, NEAR_COLUMNS + 1.0), other, size)
    # The shaft's edge is the longer one, of a bevel the lower one: it is held with its
    # cut up.
    left, right = sorted([first, second], key=lambda edge: edge.top)

    # they converge
    bevelled = (
        right.top - left.top - abs(right.end - left.end)
        > widest * size.step_columns / 4
    )
    if bevelled and left.slope * right.slope > 0.0:
        return [right, left] if left.slope < 0.0 else [left, right]

    return sorted([first, second], key=lambda edge: -edge.length)


def _refined(fine: Singles, coarse: ShaftEdge, size: GridSize) -> ShaftEdge:
    """Return the line of the frame's own columns near one of the grid: straight through
    the light near it.
    """
    step = size.step_columns
    near = (coarse.top + 0.5) * step - 0.5 + np.arange(-1.5 * step, 1.5 * step + 1)
    spread = (
        NEAR_SLOPES
        * 2.0
        * STEEPEST
        / (SLOPES - 1)
        * size.scale.depth_m
        / size.scale.lateral_m
        * step
    )
    slopes = coarse.slope * step + np.linspace(-spread, spread, 2 * NEAR_SLOPES + 1)
    deepest = coarse.row + round(MORE_M / size.scale.depth_m)
    edge = _best(fine[:deepest], near, slopes)
    at = np.arange(fine.shape[1], dtype=np.float32)
    rows = np.arange(edge.row + 1)
    off = at - (edge.top + edge.slope * (rows[:, None] + 0.5))
    weight = np.where(
        np.abs(off) <= NEAR_COLUMNS,
        np.maximum(fine[: edge.row + 1] - np.float32(0.25), 0.0),
        0.0,
    )

    by_row = weight.sum(axis=1)
    if np.count_nonzero(by_row) < LEAST_ROWS:
        return edge

    centre = (weight * at).sum(axis=1) / np.maximum(by_row, 1e-6)
    # least squares
    slope, top = (
        float(value) for value in np.polyfit(rows + 0.5, centre, 1, w=np.sqrt(by_row))
    )

    return replace(edge, top=top, slope=slope)


def _without(thin: Singles, edge: ShaftEdge, columns: float) -> Singles:
    """Return a picture without the light within some columns of an edge."""
    rows = np.arange(len(thin))[:, None]
    near = (
        np.abs(np.arange(thin.shape[1]) - (edge.top + edge.slope * (rows + 0.5)))
        <= columns
    )
    return np.where(near & (rows <= edge.row + 2), np.float32(-0.5), thin)


def _best(
    thin: Singles, start: Floats, slopes: Floats, pooled_rows: int = 1
) -> ShaftEdge:
    """Return the longest bright line in a picture, with `pooled_rows` rows averaged.

    A line's length is the largest sum, down to any row, of the light over LEAST_BRIGHT.
    """
    if pooled_rows > 1:
        shape = thin.shape[1], max(1, len(thin) // pooled_rows)
        thin = cast(Singles, cv2.resize(thin, shape, interpolation=cv2.INTER_AREA))

    rows = np.arange(len(thin))[:, None]
    place = np.rint(start + slopes[:, None, None] * pooled_rows * (rows + 0.5)).astype(
        np.intp
    )
    inside = (place >= 0) & (place < thin.shape[1])
    shine = np.where(
        inside, thin[rows, place.clip(0, thin.shape[1] - 1)], np.float32(-0.5)
    )
    sums = np.cumsum(shine - np.float32(LEAST_BRIGHT), axis=1)  # (slope, row, start)
    lengths = sums.max(axis=1)
    which, column = np.unravel_index(int(lengths.argmax()), lengths.shape)
    row = int(sums[which, :, column].argmax())
    length = float(lengths[which, column])
    row = pooled_rows * (row + 1) - 1
    length = pooled_rows * length

    return ShaftEdge(
        top=float(start[column]), slope=float(slopes[which]), row=row, length=length
    )
