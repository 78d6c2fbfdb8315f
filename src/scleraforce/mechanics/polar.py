"""The effect of the base on a needle that pushes away from the pole: from the wall of revolution to the eye.

A wall of revolution about the needle axis is clamped all around at one angle. The base of an eye with the needle at the
polar angle a is a plane, nearer on one side: in the direction phi around the needle axis (from the meridian, away from
the pole) it lies at the angle b with tan b = cot a / cos phi. Two corrections make up for it.

- *Stiffening.* The force at a dent is scaled by 1 + SHARE (mean over phi of F(b) / F(90 deg) - 1), where F(b) is the
  force of a wall of revolution clamped at b. SHARE is what is left of it where neighbouring directions share the load:
  on three eyes (0.5 to 0.8 mm, E 0.25 to 0.38 MPa, IOP 266 and 400 Pa), needles at 35 to 50 deg and dents to 4 mm, 3-D
  finite strain gave 0.41 to 0.63 of the mean.
- *Shift.* The far part of the wall moves in proportion to its loads, and differently in 3-D: linear 3-D displacement
  less linear axisymmetric displacement, at equal force and at equal pressure, is added to the curves. It is smooth, and
  harmonics of phi up to the second hold it.

`docs/physics.md` has the errors with both, with each and with none, and what other reductions gave.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.eye.contact import Contact
from scleraforce.eye.graded import graded_mesh
from scleraforce.eye.mesh import HexMesh, locate, surface_weights
from scleraforce.mechanics.axisymmetric.mesh import MeridianSize, meridian_mesh
from scleraforce.mechanics.axisymmetric.path import AxisymmetricPath, AxisymmetricWall, axisymmetric_path
from scleraforce.mechanics.linear import LinearWall

Floats = NDArray[np.float64]

SHARE = 0.5
DIRECTIONS = 4  # around half of the needle axis; the force is 0.02 % off at 35 deg, 0.5 % at 50 deg
LARGEST_POLAR_RAD = np.radians(55.0)
HARMONICS = 3
AZIMUTHS = 12
MARGIN_RAD = np.radians(1.0)


def base_angle(polar_rad: float, azimuth_rad: Floats) -> Floats:
    """Return the angle from the needle axis at which the base lies, by the direction around that axis.

    >>> base_angle(np.radians(50.0), np.radians([0.0, 90.0, 180.0])).round(6)
    array([0.698132, 1.570796, 2.443461])
    """
    angle: Floats = np.arctan2(np.cos(polar_rad), np.cos(azimuth_rad) * np.sin(polar_rad))
    return angle


def polar_path(
    radius_m: float,
    thickness_m: float,
    poisson_ratio: float,
    needle_radius_m: float,
    iop_ratio: float,
    *,
    polar_rad: float,
    tips_m: Floats,
    size: MeridianSize | None = None,
) -> AxisymmetricPath:
    """Return the path of `axisymmetric_path` with the forces of a needle at a polar angle, up to 55 deg.

    Arguments, units and errors are those of `axisymmetric_path`; `tips_m` is required, because all walls share them.
    The globe is open.
    """
    if not 0.0 <= polar_rad <= LARGEST_POLAR_RAD:
        raise InputError(f"polar angle: {np.degrees(polar_rad):g} deg; must be 0 to 55 deg")

    def path_to(support_rad: float) -> AxisymmetricPath:
        sizes = (radius_m, thickness_m, poisson_ratio, needle_radius_m, iop_ratio)
        return axisymmetric_path(*sizes, tips_m=tips_m, support_rad=support_rad, size=size)

    even = path_to(0.5 * np.pi)
    if polar_rad == 0.0:
        return even
    around = np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    forces = [path_to(float(angle)).force_ratio_m2 for angle in base_angle(polar_rad, around)]
    stiffer = SHARE * (np.mean(forces, axis=0) - even.force_ratio_m2)
    return replace(even, force_ratio_m2=even.force_ratio_m2 + stiffer)


@dataclass(frozen=True, eq=False)
class BaseShift:
    """The motion of the two boundaries of a wall of revolution caused by a plane base, in proportion to the loads.

    The nodes are those of `AxisymmetricPath.curves_sbnc`. The parts away from the axis and along it go with cos(m phi),
    the part around it with sin(m phi). Beyond the angle where the base begins, the last value stands.

    Attributes:
        pressure_mbnc: for p/E = 1, (harmonic, [outer, inner], node, [away from the axis, around it, depth]) in m.
        needle_mbnc: for F/E = 1 m^2, same shape, in m.
    """

    pressure_mbnc: Floats
    needle_mbnc: Floats

    def in_plane(
        self, iop_ratio: float, force_ratio_m2: float, lateral_bn: Floats, gap_m: float, direction_rad: float
    ) -> Floats:
        """Return the motion of the points of a section, (boundary, node, [lateral, depth]) in m.

        Args:
            iop_ratio: p/E.
            force_ratio_m2: F/E in m^2.
            lateral_bn: where the plane meets the ring of each node, (boundary, node) in m.
            gap_m: distance of the plane from the needle axis.
            direction_rad: of the plane's lateral axis from the meridian.
        """
        field_mbnc = iop_ratio * self.pressure_mbnc + force_ratio_m2 * self.needle_mbnc
        inside_bn = np.arctan2(gap_m, lateral_bn)  # from the lateral axis
        phase_mbn = np.arange(len(field_mbnc))[:, None, None] * (inside_bn + direction_rad)
        cosine, sine = np.cos(phase_mbn), np.sin(phase_mbn)
        away, depth = np.sum(field_mbnc[..., 0] * cosine, axis=0), np.sum(field_mbnc[..., 2] * cosine, axis=0)
        around = np.sum(field_mbnc[..., 1] * sine, axis=0)
        return np.stack([away * np.cos(inside_bn) - around * np.sin(inside_bn), depth], axis=-1)


def base_shift(
    radius_m: float,
    thickness_m: float,
    poisson_ratio: float,
    needle_radius_m: float,
    *,
    polar_rad: float,
    size: MeridianSize | None = None,
) -> BaseShift:
    """Return the shift for a needle at a polar angle, up to 55 deg: one linear solution in 3-D and one of revolution.

    Arguments are those of `axisymmetric_path`.

    Raises:
        InputError: a polar angle out of range, or sizes that make no eye.
    """
    if not 0.0 <= polar_rad <= LARGEST_POLAR_RAD:
        raise InputError(f"polar angle: {np.degrees(polar_rad):g} deg; must be 0 to 55 deg")
    contact = Contact(polar_rad=polar_rad)
    solid = LinearWall(graded_mesh(radius_m, thickness_m, contact), poisson_ratio)
    meridian = meridian_mesh(radius_m, thickness_m, needle_radius_m, 0.5 * np.pi, size or MeridianSize())
    even = AxisymmetricWall(meridian, poisson_ratio)
    none = np.zeros_like(even.needle)
    solve = even.factor(none, 0.0)
    loads = [
        (solid.pressure_nc, solve(even.volume(none)[1])),
        (solid.needle_cnc([contact], needle_radius_m)[0], solve(even.needle)),
    ]
    outer_nc = meridian.points_nc[meridian.outer_n]
    angles = np.arctan2(outer_nc[:, 0], outer_nc[:, 1])
    ahead = np.count_nonzero(angles < 0.5 * np.pi - polar_rad - MARGIN_RAD)  # of the base where it is nearest
    last_n = np.minimum(np.arange(len(angles)), ahead - 1)
    shifts = [
        _harmonics(solid.mesh, contact, angles[:ahead], displacement_nc) - _even(even, displacement)[:, :, :ahead]
        for displacement_nc, displacement in loads
    ]
    return BaseShift(*(shift[:, :, last_n] for shift in shifts))


def _harmonics(mesh: HexMesh, contact: Contact, angles_n: Floats, displacement_nc: Floats) -> Floats:
    """Displacement of a 3-D wall at angles from the needle axis as harmonics, (harmonic, boundary, node, 3)."""
    azimuths = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    angle, azimuth = np.meshgrid(angles_n, azimuths, indexing="ij")
    across = np.sin(angle)
    local = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle)], axis=-1)
    axes = np.stack([contact.meridian, contact.parallel, contact.normal])
    quads, places = locate(mesh, local.reshape(-1, 3) @ axes)
    nodes_bdn = np.stack([mesh.outer_qn[quads], mesh.inner_qn[quads]])
    found = np.einsum("dn,bdnc->bdc", surface_weights(mesh, places), displacement_nc[nodes_bdn])
    meridional, parallel, outward = np.moveaxis(found.reshape(2, *angle.shape, 3) @ axes.T, -1, 0)
    away = meridional * np.cos(azimuths) + parallel * np.sin(azimuths)
    around = parallel * np.cos(azimuths) - meridional * np.sin(azimuths)
    order = np.arange(HARMONICS)[:, None]
    cosine = np.where(order == 0, 1.0, 2.0) / AZIMUTHS * np.cos(order * azimuths)
    sine = 2.0 / AZIMUTHS * np.sin(order * azimuths)
    parts = ((away, cosine), (around, sine), (-outward, cosine))
    return np.stack([np.einsum("bna,ma->mbn", field, wave) for field, wave in parts], axis=-1)


def _even(wall: AxisymmetricWall, displacement: Floats) -> Floats:
    """The same of a wall of revolution: its zeroth harmonic is all there is."""
    boundaries_bnc = wall.boundary_displacement(displacement)
    answer = np.zeros((HARMONICS, *boundaries_bnc.shape[:2], 3))
    answer[0, ..., 0], answer[0, ..., 2] = boundaries_bnc[..., 0], -boundaries_bnc[..., 1]
    return answer
