"""From a segmented frame to boundaries in metres."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.steps import Segmentation

Array = NDArray[np.float64]

BOTTOM_M = 0.1e-3  # a boundary this near to the last row is where the frame ends, not where the wall does
HIDDEN_SHARE = 0.25  # of the thickness: so far above the bottom the inner boundary must be expected to be seen
UNEVEN_SHARE = 0.2  # of the thickness: bending hardly changes it, so more is not the wall's inner boundary
STEEPEST = 1.25  # stretch, 37 degrees: the inner boundary is sought down the columns, and lost on steeper parts
MIDDLE_M, ASIDE_M, FLANK_M = 1.2e-3, 3e-3, 0.3e-3  # where a dent is, and where the wall beside it
SLOPE_M = 0.3e-3  # over which the surface's slope is taken


def segmented_boundaries(segmentation: Segmentation, scale: PixelScale) -> Boundaries:
    """Return the boundaries of a segmented frame, free of refraction, NaN where they are not seen.

    OCT measures optical depth: below the surface it is stretched by the refractive index, above it is not. Where the
    frame ends before the wall does, where the wall is steep, or would be far from as thick as elsewhere, the inner
    boundary counts as unseen.
    """
    lateral_m, outer_m = surface(segmentation, scale)
    bottom_m = _bottom_m(segmentation, scale)
    inner_m = np.full_like(outer_m, np.nan)
    if segmentation.inner_found:
        index = scale.refractive_index
        optical_m = (segmentation.inner_row - segmentation.outer_row) * scale.depth_m
        stretch = _stretch(lateral_m, outer_m)
        stretched_m = segmentation.thickness_m * stretch
        seen = outer_m + (1 + HIDDEN_SHARE) * stretched_m * index < bottom_m
        even = np.abs(optical_m / index - stretched_m) < UNEVEN_SHARE * stretched_m
        inner_m = np.where(seen & even & (stretch < STEEPEST), outer_m + optical_m / index, np.nan)
    return Boundaries(lateral_m, np.stack([outer_m, inner_m]), scale.depth_m)


def surface(segmentation: Segmentation, scale: PixelScale) -> tuple[Array, Array]:
    """Return the columns' lateral places from the frame's middle and the surface's depth, (column,), m; NaN: unseen."""
    columns = len(segmentation.outer_row)
    lateral_m = (np.arange(columns, dtype=np.float64) + (0.5 - columns / 2)) * scale.lateral_m
    # Row r is centred half a pixel below its upper edge.
    outer_m = (segmentation.outer_row + 0.5) * scale.depth_m
    outer_m[~(outer_m < _bottom_m(segmentation, scale))] = np.nan
    return lateral_m, outer_m


def dent(boundaries: Boundaries) -> float:
    """Return how deep the surface lies below the line through its flanks, m; NaN where it is not seen there.

    It grows with the force and says so without a model; its zero depends on the eye.
    """
    lateral_m, depth_m = boundaries.lateral_m, boundaries.depth_m[0]
    middle = (np.abs(lateral_m) < MIDDLE_M) & np.isfinite(depth_m)
    flanks = [(np.abs(lateral_m - side) < FLANK_M) & np.isfinite(depth_m) for side in (-ASIDE_M, ASIDE_M)]
    if not (middle.any() and flanks[0].any() and flanks[1].any()):
        return float("nan")
    line_m = np.interp(lateral_m[middle], [-ASIDE_M, ASIDE_M], [float(depth_m[flank].mean()) for flank in flanks])
    return float((depth_m[middle] - line_m).max())


def _bottom_m(segmentation: Segmentation, scale: PixelScale) -> float:
    return segmentation.rows * scale.depth_m - BOTTOM_M


def _stretch(lateral_m: Array, outer_m: Array) -> Array:
    """Return depth along a column over thickness along the normal, NaN where the surface is unseen."""
    half = max(1, round(SLOPE_M / 2 / (lateral_m[1] - lateral_m[0])))
    slope = np.full_like(outer_m, np.nan)
    slope[half:-half] = (outer_m[2 * half :] - outer_m[: -2 * half]) / (lateral_m[2 * half :] - lateral_m[: -2 * half])
    stretch: Array = np.sqrt(1 + slope**2)
    return stretch
