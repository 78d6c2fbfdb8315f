"""How a section of the library's wall moves because the eye's base is a plane, nearer on one side of the needle.

The library's wall is clamped all around at 90 degrees from the needle. Under a needle that does not push on the pole
the eye gives way less on the near side: the whole dent moves and turns by up to 0.1 mm. Along the section that is a
pose, and registration sees to it; across the plane it is a gap that is not the stated one, which costs E 3 to 7 %.
`mechanics.polar` has the motion, in proportion to the loads; here it is taken to the plane of the B-scan.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeConstants
from scleraforce.mechanics.axisymmetric.mesh import MeridianSize, meridian_mesh
from scleraforce.mechanics.polar import LARGEST_POLAR_RAD, BaseShift, base_shift
from scleraforce.study import Study

__all__ = ["BaseMoves", "base_moves"]

Array = NDArray[np.float64]

SIZE = MeridianSize()


@dataclass(frozen=True, eq=False)
class BaseMoves:
    """Motion of the wall at places of a section, in proportion to the loads.

    `pressure_bsc` for IOP/E = 1, `needle_bsc` for F/E = 1 m^2: (boundary, place, [lateral, across, depth]) in m.
    """

    pressure_bsc: Array
    needle_bsc: Array

    def at(self, iop_ratio: Array, force_ratio: Array) -> Array:
        """Return the motion (state, boundary, place, 3) in m for IOP/E and F/E (state,)."""
        moved: Array = (
            iop_ratio[:, None, None, None] * self.pressure_bsc + force_ratio[:, None, None, None] * self.needle_bsc
        )
        return moved


def base_moves(study: Study, constants: EyeConstants, polar_rad: float, lateral_m: Array) -> BaseMoves:
    """Return the motion for a needle at a polar angle: two linear solutions, 0.4 s.

    Gap and thickness are those stated; where they are uncertain the motion, small as it is, is held. It does not grow
    beyond a polar angle of 55 degrees.

    Args:
        study: radius, Poisson's ratio and needle.
        constants: thickness, gap and direction of the plane.
        polar_rad: polar angle of the contact; 0: nothing moves.
        lateral_m: places of the section (place,), m.
    """
    if polar_rad == 0.0:
        nothing = np.zeros((2, len(lateral_m), 3))
        return BaseMoves(nothing, nothing)
    wall = (study.eye.radius_m, constants.thickness_m)
    needle_radius_m = study.needle.outer_diameter_m / 2
    polar_rad = min(polar_rad, LARGEST_POLAR_RAD)
    shift = base_shift(*wall, study.eye.poisson_ratio, needle_radius_m, polar_rad=polar_rad, size=SIZE)
    mesh = meridian_mesh(*wall, needle_radius_m, np.pi / 2, SIZE)
    rings_bn = np.stack([mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)])
    return _in_plane(shift, rings_bn, lateral_m, constants.gap_m, constants.direction_rad)


def _in_plane(shift: BaseShift, rings_bn: Array, lateral_m: Array, gap_m: float, direction_rad: float) -> BaseMoves:
    """Take the harmonics about the needle axis to places at the plane's distance from it."""
    inside = np.arctan2(gap_m, lateral_m)  # angle about the needle axis, from the lateral axis
    parts = [
        [_displacement(shift_nmc, rings, np.hypot(lateral_m, gap_m), inside, direction_rad)
         for shift_nmc, rings in zip(field.transpose(1, 2, 0, 3), rings_bn, strict=True)]
        for field in (shift.pressure_mbnc, shift.needle_mbnc)
    ]  # fmt: skip
    return BaseMoves(np.array(parts[0]), np.array(parts[1]))


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
