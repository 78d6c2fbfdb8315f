"""From a segmented frame to boundaries in metres."""

import numpy as np

from scleraforce.calibration.observations import Boundaries
from scleraforce.imaging.segmentation import PixelScale, Segmentation

__all__ = ["segmented_boundaries"]

BOTTOM_ROWS = 4.0  # a boundary this near to the last row is where the frame ends, not where the wall does


def segmented_boundaries(segmentation: Segmentation, scale: PixelScale, refractive_index: float) -> Boundaries:
    """Return the boundaries of a segmented frame, free of refraction, NaN where they are not seen.

    OCT measures optical depth: below the surface it is stretched by the refractive index, above it is not.
    """
    rows, columns = segmentation.mask.shape
    lateral_m = (np.arange(columns) + 0.5 - columns / 2) * scale.lateral_m
    outer = np.where(segmentation.outer_row < rows - BOTTOM_ROWS, segmentation.outer_row, np.nan)
    inner = np.where(segmentation.inner_row < rows - BOTTOM_ROWS, segmentation.inner_row, np.nan)
    if not segmentation.inner_found:
        inner = np.full_like(inner, np.nan)
    inner = outer + (inner - outer) / refractive_index
    # Row r is centred half a pixel below its upper edge.
    return Boundaries(lateral_m, (np.stack([outer, inner]) + 0.5) * scale.depth_m, scale.depth_m)
