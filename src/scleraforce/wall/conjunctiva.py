"""The sclera's surface below a conjunctiva: a layer with a surface of its own, over a
wall of known thickness.

The first surface that light meets is then the layer's, and the wall looks thicker than
it is known to be. The frame is unrolled along that surface, as for the inner boundary,
and the sclera's is the path of the largest steps up (the sclera sends more light back)
at about the depth that the known thickness leaves. If no such path stands out of the
speckle, or if the wall below it would fit the known thickness no better, the
segmentation stays unchanged.
"""

from dataclasses import replace
from math import sqrt
from typing import cast

import cv2
import numpy as np

from scleraforce.base.arrays import Places, Singles
from scleraforce.base.normal_distribution import NORMAL_MEDIAN
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.inner_boundary import stretch
from scleraforce.wall.shared_loops import best_path
from scleraforce.wall.wall import Segmentation

# a wall that looks this much thicker than known may lie below a conjunctiva
LEAST_M = 35e-6
LARGEST_M = 0.7e-3  # conjunctiva with Tenon's layer
CELL_M = 8e-6  # of depth below the surface in the unrolled picture
CELLS = 80  # at least
BEYOND = 1.2  # of the excess of thickness: the unrolled picture reaches to there
GROUPS = 40  # of columns
SURFACE_CELLS = 3  # mirror reflection and blur of the surface
WINDOW = 6  # cells above and below a step that are compared
EXPECTED = (0.4, 1.7)  # of the excess of thickness: where the step may lie
REACH = 4  # cells from group to group
SURE_SDS = 1.5  # of a step: their mean on a path through speckle is less than 1
# Without a known thickness: 1.5 at most on 60 even walls, 1.7 and more under layers of
# 50 to 450 um.
SURE_ALONE_SDS = 2.0
MOST_SHARE = 0.6  # of the wall, in which a second surface is sought
LEAST_STEP = 0.02  # of the level below the surface
POOLED = 3  # groups whose mean makes a step stand out of the speckle
SMOOTHED = 3  # groups
FITS = 0.5  # of the excess may be left below the step


def below_conjunctiva(
    frame: Pixels, scale: PixelScale, found: Segmentation, thickness_m: float | None
) -> Segmentation:
    """Return the wall that was found, its outer boundary the sclera's where a layer is
    seen over a known thickness.
    """
    if thickness_m is None or not found.usable or not found.inner_found:
        return found

    excess_m = found.thickness_m - thickness_m
    if not LEAST_M < excess_m < LARGEST_M:
        return found

    columns = np.flatnonzero(np.isfinite(found.outer_row))
    row, along_rows = _surface(found, columns, scale)
    light = _unrolled(frame, columns, row, along_rows, _cells(excess_m))

    path, sure = _climb(
        light,
        found.thickness_m,
        EXPECTED[0] * excess_m,
        EXPECTED[1] * excess_m,
        SURE_SDS,
    )
    if not sure:
        return found

    # The layer's thickness in each group: the path of its lower edge, smoothed by the
    # size of the steps.
    weight = np.maximum(
        _steps(light)[np.arange(len(path)), path], np.float32(0.0)
    ) + np.float32(1e-3)
    smooth = cv2.blur((path * weight)[None].astype(np.float32), (SMOOTHED, 1))[0]
    smooth /= cv2.blur(weight[None].astype(np.float32), (SMOOTHED, 1))[0]
    layer_m = smooth * np.float32(CELL_M)

    median_m = float(np.median(layer_m))
    if abs(excess_m - median_m) > FITS * excess_m:
        return found

    outer_row = found.outer_row.copy()
    middles = (np.arange(GROUPS) + 0.5) / GROUPS * (len(columns) - 1)
    outer_row[columns] += along_rows * np.interp(
        np.arange(len(columns)), middles, layer_m
    )
    left_m = (found.inner_row[columns] - outer_row[columns]) / along_rows

    return replace(
        found,
        outer_row=outer_row,
        thickness_m=float(np.median(left_m)),
        conjunctiva_m=median_m,
    )


def second_surface_m(
    frame: Pixels, scale: PixelScale, found: Segmentation
) -> float | None:
    """Return how deep a second surface lies below the first, then maybe a layer's, m;
    None if none stands out.
    """
    if not found.usable or not found.inner_found:
        return None

    columns = np.flatnonzero(np.isfinite(found.outer_row))
    deepest_m = min(LARGEST_M, MOST_SHARE * found.thickness_m)
    light = _unrolled(
        frame, columns, *_surface(found, columns, scale), _cells(deepest_m)
    )
    path, sure = _climb(light, found.thickness_m, LEAST_M, deepest_m, SURE_ALONE_SDS)

    return float(np.median(path)) * CELL_M if sure else None


def _cells(deepest_m: float) -> int:
    return max(CELLS, int(BEYOND * deepest_m / CELL_M) + 2 * WINDOW)


def _surface(
    found: Segmentation, columns: Places, scale: PixelScale
) -> tuple[Singles, Singles]:
    """Return the first surface's rows at columns, and the rows along a column for 1 m
    along its normal, (column,).
    """
    span = np.arange(columns[0], columns[-1] + 1)
    # across what is not seen, too
    row = np.interp(span, columns, found.outer_row[columns]).astype(np.float32)
    depth_m = scale.depth_m / scale.refractive_index
    along_rows = stretch(row, scale.lateral_m, depth_m)

    return row[columns - columns[0]], along_rows[columns - columns[0]]


def _unrolled(
    frame: Pixels, columns: Places, row: Singles, along_rows: Singles, cells: int
) -> Singles:
    """Return the mean light below a surface, (group, cell), over its level there."""
    depth_m = (np.arange(cells, dtype=np.float32) + np.float32(0.5)) * np.float32(
        CELL_M
    )
    map_row = row + depth_m[:, None] * along_rows
    map_column = np.broadcast_to(columns.astype(np.float32), map_row.shape).copy()
    sampled = cv2.remap(
        frame, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    light = cast(
        Singles,
        cv2.resize(
            sampled.astype(np.float32), (GROUPS, cells), interpolation=cv2.INTER_AREA
        ),
    ).T
    level = cv2.blur(light[:, SURFACE_CELLS:].mean(axis=1, keepdims=True), (1, 3))

    return light / np.maximum(level, np.float32(1e-6))


def _climb(
    light: Singles, thickness_m: float, least_m: float, most_m: float, sure_sds: float
) -> tuple[Places, bool]:
    """Return the path of the largest steps up between two depths, (group,) cells, and
    whether it stands out.
    """
    end = min(light.shape[1], int(thickness_m / CELL_M)) - WINDOW
    first = max(int(least_m / CELL_M), SURFACE_CELLS + 1)
    last = min(int(most_m / CELL_M), end)
    if last - first < 2:
        return np.empty(0, dtype=np.intp), False

    step = _steps(light)
    judged = step[:, first:end]
    # that speckle makes: such groups share no column
    differences = np.abs(judged[POOLED:] - judged[:-POOLED])
    sd = max(NORMAL_MEDIAN / sqrt(2.0) * float(np.median(differences)), 1e-6)
    score = np.ascontiguousarray(step[:, first:last]) - np.linspace(
        0.0, 1e-4, last - first, dtype=np.float32
    )
    path = best_path(score, REACH) + first
    size = step[np.arange(len(path)), path].mean()

    return path, bool(size >= max(sure_sds * sd, LEAST_STEP))


def _steps(light: Singles) -> Singles:
    """Return the rise of light at each edge between cells, (group, cell); neighbours
    are pooled.
    """
    pooled = cast(Singles, cv2.blur(light, (1, POOLED)))
    total = np.concatenate(
        [
            np.zeros((len(light), 1), np.float32),
            pooled.cumsum(axis=1, dtype=np.float32),
        ],
        axis=1,
    )
    edge = np.arange(light.shape[1])  # between cells
    top = np.clip(edge - WINDOW, SURFACE_CELLS, None).clip(None, edge)
    bottom = np.minimum(edge + WINDOW, len(edge))
    above = (total[:, edge] - total[:, top]) / np.maximum(edge - top, 1)
    below = (total[:, bottom] - total[:, edge]) / np.maximum(bottom - edge, 1)

    return np.where(edge > SURFACE_CELLS, below - above, 0.0).astype(np.float32)
