"""A frame to read before the first real one, which then takes no longer than those after it.

A first reading loads machine code, or compiles it, lays out tables and fills caches: it takes ten times as long as the
second, and many seconds where loops are compiled. That holds only where it goes all the way, so the frame shows a wall.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import PixelScale

THICKNESS_M = 0.6e-3  # of the wall, where nothing is known of it
SURFACE = 0.2  # depth of the apex, of the frame's
NOISE, TISSUE = (0, 400), (600, 1600)  # counts; those of the tissue are added


def warming_frame(
    shape: tuple[int, int], scale: PixelScale, radius_m: float, thickness_m: float | None = None
) -> NDArray[np.uint16]:
    """Return a raw B-scan of the wall of an eye at rest, the same at each call.

    Args:
        shape: rows and columns.
        scale: size of a pixel as stored, with the refractive index.
        radius_m: of the eye.
        thickness_m: of the wall; None: not known.

    Returns:
        uint16 (row, column).
    """
    (rows, columns), rng = shape, np.random.default_rng(0)
    lateral_m = (np.arange(columns) + 0.5 - columns / 2) * scale.lateral_m
    falls_m = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
    depth_m = (np.arange(rows)[:, None] + 0.5 - SURFACE * rows) * scale.depth_m - falls_m
    is_tissue = (depth_m > 0.0) & (depth_m < (thickness_m or THICKNESS_M) * scale.refractive_index)
    noise, tissue = (rng.integers(*counts, shape, dtype=np.uint16) for counts in (NOISE, TISSUE))
    return noise + np.where(is_tissue, tissue, np.uint16(0))
