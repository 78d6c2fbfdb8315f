"""The shift: the motion of a wall of revolution by the plane base of the eye, for a needle beside the pole.

The far part of the wall moves in proportion to its loads, and differently in 3-D: linear 3-D displacement less linear
axisymmetric displacement, at equal force and at equal pressure, is added to the curves. It is smooth, and harmonics of
the direction around the needle axis up to the second represent it. `docs/physics.md` states the remaining errors.
"""

from dataclasses import dataclass

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.errors import InputError
from scleraforce.mechanics.axisymmetric import AxisymmetricWall
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.meridian import MeridianSize, meridian_mesh
from scleraforce.mechanics.mesh import HexMesh, locate

LARGEST_POLAR_RAD = np.radians(55.0)
HARMONICS = 3
AZIMUTHS = 12
MARGIN_RAD = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class BaseShift:
    """The motion of the two boundaries of a wall of revolution caused by a plane base, in proportion to the loads.

    For p/E = 1 and for F/E = 1 m^2: (harmonic, [outer, inner], node, [away from the axis, around it, depth]) in m, at
    the nodes of `AxisymmetricPath.curves_sbnc`. The parts away from the axis and along it vary with cos(m phi), the
    part around it with sin(m phi). Beyond the angle where the base begins, the last value is repeated.
    """

    pressure_mbnc: Floats
    needle_mbnc: Floats


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

    See `axisymmetric_path` for the arguments.
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
    quads, weights_dn = locate(mesh, local.reshape(-1, 3) @ axes)
    nodes_bdn = np.stack([mesh.outer_qn[quads], mesh.inner_qn[quads]])
    found = np.einsum("dn,bdnc->bdc", weights_dn, displacement_nc[nodes_bdn])
    meridional, parallel, outward = np.moveaxis(found.reshape(2, *angle.shape, 3) @ axes.T, -1, 0)
    away = meridional * np.cos(azimuths) + parallel * np.sin(azimuths)
    around = parallel * np.cos(azimuths) - meridional * np.sin(azimuths)
    order = np.arange(HARMONICS)[:, None]
    cosine = np.where(order == 0, 1.0, 2.0) / AZIMUTHS * np.cos(order * azimuths)
    sine = 2.0 / AZIMUTHS * np.sin(order * azimuths)
    parts = ((away, cosine), (around, sine), (-outward, cosine))
    return np.stack([np.einsum("bna,ma->mbn", field, wave) for field, wave in parts], axis=-1)


def _even(wall: AxisymmetricWall, displacement: Floats) -> Floats:
    """The same of a wall of revolution: only its zeroth harmonic is not zero."""
    nodes_bn = np.stack([wall.mesh.outer_n, wall.mesh.inner_n])
    boundaries_bnc = wall.full(displacement).reshape(-1, 2)[nodes_bn]
    answer = np.zeros((HARMONICS, *boundaries_bnc.shape[:2], 3))
    answer[0, ..., 0], answer[0, ..., 2] = boundaries_bnc[..., 0], -boundaries_bnc[..., 1]
    return answer
