"""Sections of spherical walls with a dent in their middle: what segmentation is tried
on, its truth known exactly.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.contact_and_section import WallSection


def dented_wall(
    thickness_m: float | NDArray[np.float64],
    dent_m: float,
    width_m: float = 1.6e-3,
    points: int = 1500,
) -> WallSection:
    """Return a wall of 12 mm radius, its thickness along the normal.

    Args:
        thickness_m: one for all points, or of each (point,).
        dent_m: depth of the dent, a Gaussian.
        width_m: its standard deviation.
        points: of each curve.
    """
    lateral = np.linspace(-8.5e-3, 8.5e-3, points)
    depth = (
        12e-3
        - np.sqrt(12e-3**2 - lateral**2)
        + dent_m * np.exp(-(lateral**2) / (2 * width_m**2))
    )
    tangent = np.stack([np.gradient(lateral), np.gradient(depth)], axis=1)
    inward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(
        tangent, axis=1, keepdims=True
    )
    outer = np.stack([lateral, depth], axis=1)

    return WallSection(
        outer, outer + np.broadcast_to(thickness_m, lateral.shape)[:, None] * inward
    )
