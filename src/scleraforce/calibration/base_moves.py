"""How a section of the library's wall moves under the needle because the eye's base is a plane, nearer on one side.

The library's wall is clamped all around at 90 degrees from the needle. Under a needle that does not push on the pole
the eye gives way less on the near side: the dent moves and turns by up to 0.1 mm. Along the section that is a pose, and
registration sees to it; across the plane it is a gap that is not the stated one, which costs E 3 to 7 %.
`mechanics.polar` has the motion, in proportion to the force; here it is taken to the plane of the B-scan. What the
pressure adds to it is `library.base_bulge`.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeConstants
from scleraforce.mechanics.axisymmetric.mesh import MeridianSize, meridian_mesh
from scleraforce.mechanics.polar import LARGEST_POLAR_RAD, base_shift
from scleraforce.study import Study

Array = NDArray[np.float64]

SIZE = MeridianSize()
SHIFTS = 8  # that are kept: an eye has one to three, the same for all tissues that are tried

_kept_shift = lru_cache(maxsize=SHIFTS)(base_shift)


def base_moves(study: Study, constants: EyeConstants, polar_rad: float, lateral_m: Array) -> Array:
    """Return the motion of the wall for F/E = 1 m^2 (boundary, place, [lateral, across, depth]), m: 0.3 s, once an eye.

    Gap and thickness are those stated; where they are uncertain the motion, small as it is, is held. It does not grow
    beyond a polar angle of 55 degrees.

    Args:
        study: radius, Poisson's ratio and needle.
        constants: thickness, gap and direction of the plane; nothing moves where that is not stated: the mean.
        polar_rad: polar angle of the contact; 0: nothing moves.
        lateral_m: places of the section (place,), m.
    """
    if polar_rad == 0.0 or constants.direction_rad is None:
        return np.zeros((2, len(lateral_m), 3))
    wall = (study.eye.radius_m, constants.thickness_m)
    needle_radius_m = study.needle.outer_diameter_m / 2
    polar_rad = min(polar_rad, LARGEST_POLAR_RAD)
    shift = _kept_shift(*wall, study.eye.poisson_ratio, needle_radius_m, polar_rad=polar_rad, size=SIZE)
    mesh = meridian_mesh(*wall, needle_radius_m, np.pi / 2, SIZE)
    rings_bn = np.stack([mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)])
    inside = np.arctan2(constants.gap_m, lateral_m)  # angle about the needle axis, from the lateral axis
    distance_m = np.hypot(lateral_m, constants.gap_m)
    return np.array(
        [
            _displacement(shift_nmc, rings, distance_m, inside, constants.direction_rad)
            for shift_nmc, rings in zip(shift.needle_mbnc.transpose(1, 2, 0, 3), rings_bn, strict=True)
        ]
    )


def _displacement(shift_nmc: Array, ring_n: Array, distance_m: Array, inside: Array, direction_rad: float) -> Array:
    """Return the motion (place, 3) of one boundary from its harmonics (node, harmonic, [away, around, depth])."""
    nodes, harmonics, _ = shift_nmc.shape
    flat = shift_nmc.reshape(nodes, -1).T
    local = np.array([np.interp(distance_m, ring_n, row) for row in flat]).reshape(harmonics, 3, -1)
    phase = np.arange(harmonics)[:, None] * (inside + direction_rad)
    away, depth = (local[:, axis] * np.cos(phase) for axis in (0, 2))
    around = (local[:, 1] * np.sin(phase)).sum(axis=0)
    away, depth = away.sum(axis=0), depth.sum(axis=0)
    lateral = away * np.cos(inside) - around * np.sin(inside)
    return np.stack([lateral, away * np.sin(inside) + around * np.cos(inside), depth], axis=1)
