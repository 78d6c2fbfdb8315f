"""The needle in a frame: a thin bright line from the frame's top edge down to the tissue, and the shadow below it.

Lines that come in through the top edge (`needle_edges`) are a shaft's only where the tissue below them is darker than
that beside, and they end at it: what shines through the tissue, or goes on below it, is a flare, and a shadow without a
line is a vessel's.
"""

from dataclasses import dataclass
from math import atan, hypot
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.grid import Float, Grid
from scleraforce.segmentation.needle_edges import WIDEST_M, ShaftEdge, find_edges, top_rows
from scleraforce.units import from_si

MARGIN_M = 0.1e-3  # beside a shadow light is not yet whole
DARK_SHARE = 0.35  # of the tissue's usual level: a column with less is in the shadow
LIT_SHARE = 0.5  # ... one with more is not
SHADED_SHARE = 0.93  # of the level beside: the tissue under a needle is darker
BESIDE_M = 2.5e-3
TISSUE_M = 0.1e-3  # depth over which light is tissue's: thinner lines are not
HOVERING_M = 0.3e-3  # over the surface beside it, at most: a needle's tip
BELOW_M = 1.2e-3  # below a line's end, from where on no tissue is expected
DEEP_M = 0.5e-3  # from there down to the frame's end, at least, to judge what goes on there
NEAR_M = 0.5e-3  # beside a line's end, of what its column is compared with there
PARTS = 3  # of that depth
STREAK = 0.06  # of the spread of a frame's light: a flare is brighter by so much in all parts, drawn needles by 0.015
NEAREST = 6  # columns of the grid with tissue on each side, which tell where its surface is
BEVELLED = 0.6  # of the width: an edge that is so much longer than the other one is the point of a bevel


@dataclass(frozen=True)
class Shaft:
    """A needle's shaft in the columns of a frame's imaged part and the rows of its grid: tip, slope in columns a row.

    `hidden` are the first column that the shaft or its shadow covers, and the first one after.
    """

    tip: tuple[float, float]
    slope: float
    hidden: tuple[int, int]


@dataclass(frozen=True)
class SeenNeedle:
    """A needle seen in a frame.

    `angle_rad` lies between its shaft and the depth; above 0 it leans to growing columns on its way up. `tip_m`:
    lateral place from the frame's middle and depth from its top edge, None where the shaft goes on below the frame. In
    pixels, `tip` and `top`: column and row of its tip, or of the last that is seen of it, and of where its axis meets
    the top edge; `hidden`: the first column that shaft or shadow cover, and the first one after.
    """

    angle_rad: float
    tip_m: tuple[float, float] | None
    tip: tuple[float, float]
    top: tuple[float, float]
    hidden: tuple[int, int]


def needle_entry(needle: SeenNeedle | None) -> dict[str, Any] | None:
    """Return a needle as it stands in JSON: its angle off the depth, where it leans on its way up, its tip.

    >>> seen = SeenNeedle(angle_rad=-0.5, tip_m=(1e-4, 2e-3), tip=(259.0, 256.0), top=(200.0, -0.5), hidden=(199, 270))
    >>> needle_entry(seen)
    {'angle_deg': 28.65, 'leans': 'left', 'tip_mm': [0.1, 2.0]}
    """
    if needle is None:
        return None
    return {
        "angle_deg": round(from_si(abs(needle.angle_rad), "deg"), 2),
        "leans": "left" if needle.angle_rad < 0.0 else "right",
        "tip_mm": None if needle.tip_m is None else [round(from_si(place_m, "mm"), 4) for place_m in needle.tip_m],
    }


def find_shaft(frame: Pixels, grid: Grid) -> Shaft | None:
    """Return the needle's shaft in a frame; None where none is seen.

    Args:
        frame: its imaged part, shape (row, column).
        grid: of that part.
    """
    edges = find_edges(frame, grid)
    return _shaded_shaft(grid, edges) if edges else None


def needle_of(shaft: Shaft, grid: Grid, left: int, columns: int) -> SeenNeedle:
    """Return a shaft as a needle of the frame.

    Args:
        shaft: in the grid.
        grid: of the frame's imaged part.
        left: first imaged column.
        columns: of the frame.
    """
    lateral_m, depth_m = grid.scale.lateral_m / grid.step_columns, grid.scale.depth_m / grid.step_rows
    tip = left + shaft.tip[0], (shaft.tip[1] + 1.0) * grid.step_rows - 0.5
    slope = shaft.slope / grid.step_rows
    first, after = (left + end for end in shaft.hidden)
    ends = shaft.tip[1] < len(grid.cells) - 1.0
    return SeenNeedle(
        angle_rad=-atan(slope * lateral_m / depth_m),
        tip_m=((tip[0] + 0.5 - columns / 2) * lateral_m, (tip[1] + 0.5) * depth_m) if ends else None,
        tip=tip,
        top=(tip[0] - slope * (tip[1] + 0.5), -0.5),
        hidden=(first, min(after, columns)),
    )


def _shaded_shaft(grid: Grid, edges: list[ShaftEdge]) -> Shaft | None:
    """Return the shaft between edges, of all columns, where the tissue below is in its shadow; None where it is not."""
    step, columns = grid.step_columns, grid.cells.shape[1]
    reached = [place for edge in edges for place in (edge.top, edge.end)]
    first, after = max(0, round(min(reached) / step - 0.5)), min(columns, round(max(reached) / step + 0.5))
    if first >= after:
        return None
    tissue = _tissue(grid, edges)
    level: Float = tissue.max(axis=0)
    reach = max(2, round(BESIDE_M / grid.scale.lateral_m))
    beside = _beside(level, first, after, reach)
    usual = float(np.sort(level)[3 * columns // 4])
    lit = beside[beside > LIT_SHARE * usual]
    if not len(lit) or float(np.median(level[first:after])) > SHADED_SHARE * float(np.median(lit)):
        return None
    dark = level < DARK_SHARE * usual
    while first > 0 and dark[first - 1]:
        first -= 1
    while after < columns and dark[after]:
        after += 1
    shown = tissue > LIT_SHARE * usual
    tip = _tip(grid, edges, (first * step, after * step))
    if _goes_through(grid, edges, shown, first, after) or _goes_on(grid, edges):
        return None
    if not _touches(grid, shown, (first, after), tip[1]):
        return None
    margin = max(1, round(MARGIN_M / grid.scale.lateral_m))
    hidden = max(0, first - margin) * step, min(columns, after + margin) * step
    return Shaft(tip, edges[0].slope, hidden)


def _touches(grid: Grid, lit: NDArray[np.bool_], shadow: tuple[int, int], tip_row: float) -> bool:
    """Return whether tissue is seen on both sides of a shadow, and a shaft's tip lies no higher than over it.

    A line that ends far above the tissue is a reflex; one at the end of the tissue may be that end.
    """
    (first, after), reach = shadow, max(2, round(BESIDE_M / grid.scale.lateral_m))
    surfaces = []
    for side in (lit[:, max(0, first - reach) : first][:, ::-1], lit[:, after : after + reach]):
        seen = np.flatnonzero(side.any(axis=0))[:NEAREST]
        if not len(seen):
            return False
        surfaces.append(float(np.median(side[:, seen].argmax(axis=0))))
    return (min(surfaces) - tip_row) * grid.scale.depth_m <= HOVERING_M


def _goes_through(grid: Grid, edges: list[ShaftEdge], lit: NDArray[np.bool_], first: int, after: int) -> bool:
    """Return whether edges end far below the tissue's surface beside them: they are a flare's."""
    around = max(1, round(MARGIN_M / grid.scale.lateral_m)) + 1
    sides = lit[:, max(0, first - around) : first], lit[:, after : after + around]
    surfaces = [int(side.argmax(axis=0).max()) for side in sides if side.any()]
    below = max(edge.row for edge in edges) - max(surfaces, default=len(lit))
    return below * grid.scale.depth_m > WIDEST_M


def _goes_on(grid: Grid, edges: list[ShaftEdge]) -> bool:
    """Return whether columns in which edges end are brighter than those beside down to the frame's end: a flare's are.

    A steep reflection floods its A-scans with light, whose rest lies over all depths; below a needle it is dark.
    """
    begin = round(max(edge.row for edge in edges) + BELOW_M / grid.scale.depth_m)
    deep: Float = grid.cells[begin:].astype(np.float32)
    if len(deep) * grid.scale.depth_m < DEEP_M or len(deep) < PARTS:
        return False
    ends = [round(edge.end / grid.step_columns - 0.5) for edge in edges]
    first, after = max(0, min(ends)), max(0, max(ends) + 1)
    reach = max(2, round(NEAR_M / grid.scale.lateral_m)) + 1
    least = STREAK * float(grid.cells.std())
    for part in np.array_split(deep, PARTS):
        level: Float = part.mean(axis=0)
        within, beside = level[first:after], _beside(level, first, after, reach)
        if not len(within) or not len(beside) or float(within.mean() - beside.mean()) <= least:
            return False
    return True


def _beside(level: Float, first: int, after: int, reach: int) -> Float:
    """Return the levels of columns on both sides of others, without those right beside them."""
    return np.concatenate([level[max(0, first - reach) : max(0, first - 1)], level[after + 1 : after + reach]])


def _tissue(grid: Grid, edges: list[ShaftEdge]) -> Float:
    """Return how bright the tissue in each cell of the grid is, over the background, the shaft left out."""
    light = grid.cells.astype(np.float32)
    some = np.sort(light[::4, ::2].ravel())
    light -= some[: len(some) // 2].mean()
    rows = np.arange(min(max(edge.row for edge in edges) + 3, len(light)))[:, None]
    at = (np.arange(light.shape[1]) + 0.5) * grid.step_columns - 0.5
    lines = np.stack([edge.top + edge.slope * (rows + 0.5) for edge in edges])
    around = 2.0 * grid.step_columns
    inside = (at >= lines.min(axis=0) - around) & (at <= lines.max(axis=0) + around)
    light[: len(rows)][inside] = 0.0
    light[: top_rows(grid)] = 0.0  # where a shaft comes in it may shine all across
    light = cast(Float, cv2.blur(light, (1, 3)))
    deep = np.ones((max(3, round(TISSUE_M / grid.scale.depth_m)), 1), np.uint8)  # what is thinner is a line
    return cast(Float, cv2.erode(light, deep))


def _tip(grid: Grid, edges: list[ShaftEdge], dark: tuple[int, int]) -> tuple[float, float]:
    """Return column and row (of the grid) where the shaft ends.

    That is in the middle between its edges' ends, or at the longer one's where that is the point of a bevel. Where one
    edge alone is seen, the other one's end is the end of the shadow, on the side away from the shaft.
    """
    size = np.array([grid.scale.lateral_m / grid.step_columns, grid.scale.depth_m])
    ends = np.array([(edge.end, edge.row) for edge in edges])
    if len(ends) == 1:
        column, row = ends[0].tolist()
        other = dark[1] - 1 if edges[0].slope >= 0 else dark[0]
        return (0.5 * (column + other) if abs(other - column) * size[0] < WIDEST_M else column), row
    along = np.array([edges[0].slope * size[0], size[1]])
    along /= hypot(*along)
    apart = (ends[1] - ends[0]) * size
    longer, width = float(apart @ along), abs(float(apart[0] * along[1] - apart[1] * along[0]))
    tip = ends[int(longer > 0)] if abs(longer) > BEVELLED * width else ends.mean(axis=0)
    return float(tip[0]), float(tip[1])
