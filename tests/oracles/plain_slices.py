"""The slices of a segmented frame as whole arrays, slow and plain."""

import numpy as np

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.records.frame import WALL
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import SliceStudy
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import dent_leaves, surface_places


def plain_slices(
    segmentation: Segmentation,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...],
) -> tuple[Bytes, bool, float]:
    """Return what `boundary_slices` does."""
    columns = slice_study.columns
    pixel_m = slice_study.pixel_m
    lateral_m, outer_m = surface_places(segmentation, scale)
    seen_m = lateral_m[
        (np.abs(lateral_m) <= columns * pixel_m / 2) & np.isfinite(outer_m)
    ]
    depth_bc = _depths(segmentation, scale, columns, pixel_m)
    middle_m = (
        np.arange(slice_study.rows)[:, None] + 0.5 + np.array(shifts)[:, None, None]
    ) * pixel_m
    inside = (depth_bc[0] <= middle_m) & (middle_m < depth_bc[1])
    walls = np.where(inside, np.uint8(WALL), np.uint8(0))
    extent_m = float(np.ptp(seen_m)) if len(seen_m) else 0.0
    return walls, dent_leaves(walls[0]), extent_m


def _depths(
    segmentation: Segmentation, scale: PixelScale, columns: int, pixel_m: float
) -> Floats:
    """Return the depths of both boundaries at a slice's columns (2, column), m, NaN
    where there is no wall.
    """
    rows = segmentation.outer_row, segmentation.inner_row
    there = np.isfinite(rows[0]) & np.isfinite(rows[1])
    width = len(rows[0])
    if not there.any():
        return np.full((2, columns), np.nan)

    middle = np.arange(columns) + 0.5 - columns / 2
    at = middle * pixel_m / scale.lateral_m + width / 2 - 0.5
    nearest = np.clip(np.rint(at), 0, width - 1).astype(np.intp)
    shown = (at >= -0.5) & (at <= width - 0.5) & there[nearest]
    outer_m, inner_m = (
        (np.interp(at, np.flatnonzero(there), row[there]) + 0.5) * scale.depth_m
        for row in rows
    )
    end_m = outer_m + (inner_m - outer_m) / scale.refractive_index
    return np.where(shown, [outer_m, end_m], np.nan)
