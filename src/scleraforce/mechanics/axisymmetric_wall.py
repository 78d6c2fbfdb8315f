"""Finite strain of a wall of revolution about the needle axis: load paths at a
hundredth of the cost of a 3-D wall.

The eye is the sphere seen from the needle: the contact is its pole, and the support, a
plane through the centre of the 3-D eye, becomes a circle at an angle from the needle
axis. Everything is at E = 1 Pa: forces are F/E in m^2, the eye pressure is p/E. Gravity
is neglected. Nodal forces are for the full circle; unknown 2 n + c is node n, component
c (from the axis, along it).

Beside the pole the far part of the wall moves by the plane base, in proportion to its
loads: linear 3-D displacement less linear axisymmetric displacement, at equal force and
at equal pressure (`base_shift`), is added to the curves. It is smooth, and harmonics of
the direction around the needle axis up to the second represent it. `docs/physics.md`
states the remaining errors.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs, dpbtrf, dpbtrs

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics import meridian_elements
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.equilibrium import Solve
from scleraforce.mechanics.finite_elements import gauss_points
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, locate
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.load_path_tracing import (
    PathEnd,
    PathStates,
    pressurise,
    trace_load_path,
)
from scleraforce.mechanics.meridian_elements import (
    MeridianMesh,
    MeridianSize,
    line_shapes,
    meridian_mesh,
)
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw

BOUNDARY_POINTS = 3  # exact for r^2 dz along a quadratic curve


def needle_load(mesh: MeridianMesh) -> Floats:
    """Return inward nodal forces of 1 N, uniform over the first element's disc seen
    along the axis, (all unknowns,).
    """
    nodes_en, values_pn, slopes_pn, weights_p = boundary_shapes(mesh.outer_n[:3])
    distance_en = mesh.points_nc[nodes_en, 0]
    rim_m = distance_en[-1, -1]
    weight_ep = (
        2.0
        * (distance_en @ values_pn.T)
        * (distance_en @ slopes_pn.T)
        * weights_p
        / rim_m**2
    )

    return inward_forces(mesh, nodes_en, weight_ep @ values_pn)


def inward_forces(mesh: MeridianMesh, nodes_en: Integers, amount_en: Floats) -> Floats:
    """Return nodal forces along the axis, (all unknowns,), that sum up inward amounts
    at nodes, (element, node).
    """
    along = np.bincount(
        (2 * nodes_en + 1).ravel(), amount_en.ravel(), minlength=mesh.points_nc.size
    )
    return np.asarray(-along, dtype=np.float64)


class Interior:
    """The space inside the inner boundary, V = pi times the integral of r^2 dz from the
    support to the axis.

    Pressure does work on V: dV is its load, the second derivative its part of the
    tangent. The support holds z.
    """

    def __init__(self, mesh: MeridianMesh) -> None:
        self._points_nc = mesh.points_nc
        self._nodes_en, self._values_pn, slopes_pn, self._weights_p = boundary_shapes(
            mesh.inner_n
        )
        self._slopes_pn = -slopes_pn  # from the support to the axis
        self._unknowns = np.concatenate(
            [2 * self._nodes_en.ravel(), 2 * self._nodes_en.ravel() + 1]
        )
        # The inner nodes of an element of the innermost layer are its last three.
        layers = len(mesh.cells_en) // len(self._nodes_en)
        self._elements = np.arange(layers - 1, len(mesh.cells_en), layers)
        rows = self._weights_p[:, None] * self._values_pn
        self._mass_pab = (rows[:, :, None] * self._values_pn[:, None, :]).reshape(-1, 9)
        self._mixed_pab = (rows[:, :, None] * self._slopes_pn[:, None, :]).reshape(
            -1, 9
        )

    def volume(self, everywhere: Floats) -> tuple[float, Floats]:
        """Return V in m^3 and its derivative, (all unknowns,)."""
        r_ep, slope_ep = self._curve(everywhere)
        along = (2.0 * np.pi * r_ep * slope_ep * self._weights_p) @ self._values_pn
        up = (np.pi * r_ep**2 * self._weights_p) @ self._slopes_pn
        forces = np.concatenate([along.ravel(), up.ravel()])
        gradient: Floats = np.bincount(
            self._unknowns, forces, minlength=len(everywhere)
        ).astype(np.float64, copy=False)

        return float(np.pi * np.sum(r_ep**2 * slope_ep * self._weights_p)), gradient

    def subtract_curvature(
        self, tangents: Floats, everywhere: Floats, pressure: float
    ) -> None:
        """Subtract p times the second derivative of V from the element tangents
        (element, 18, 18).
        """
        r_ep, slope_ep = self._curve(everywhere)
        block = tangents.reshape(len(tangents), 9, 2, 9, 2)
        part = np.zeros((len(self._elements), 3, 2, 3, 2))
        mixed = 2.0 * np.pi * (r_ep @ self._mixed_pab).reshape(-1, 3, 3)
        part[:, :, 0, :, 0] = (
            2.0 * np.pi * (slope_ep @ self._mass_pab).reshape(-1, 3, 3)
        )
        part[:, :, 0, :, 1] = mixed
        part[:, :, 1, :, 0] = mixed.transpose(0, 2, 1)
        block[self._elements, 6:, :, 6:, :] -= pressure * part

    def _curve(self, everywhere: Floats) -> tuple[Floats, Floats]:
        """Distance from the axis and slope of the height along the deformed inner
        boundary, (element, point).
        """
        points_enc = (self._points_nc + everywhere.reshape(-1, 2))[self._nodes_en]
        return (
            points_enc[..., 0] @ self._values_pn.T,
            points_enc[..., 1] @ self._slopes_pn.T,
        )


def boundary_shapes(
    nodes_n: Integers, points: int = BOUNDARY_POINTS
) -> tuple[Integers, Floats, Floats, Floats]:
    """Return the nodes of a boundary's elements (element, 3), shapes and slopes (point,
    3), and weights (point,).
    """
    places_pk, weights_p = gauss_points(1, points)
    nodes_en = np.stack([nodes_n[:-2:2], nodes_n[1::2], nodes_n[2::2]], axis=1)
    return nodes_en, *line_shapes(places_pk[:, 0]), weights_p


@dataclass(frozen=True, eq=False)
class AxisymmetricPath:
    """States along a load path of a wall of revolution, (state,) each; the first is
    under pressure without the needle.

    `tip_m`: inward displacement of the outer surface at the contact from the undented
    wall at the state's pressure. F/E may fall where the wall snaps; p/E is constant
    unless the globe is sealed. `displaced_m3`: volume inside the undented wall at the
    state's pressure less that inside the state. `curves_sbnc`: deformed boundaries,
    (state, [outer, inner], node, [distance from the needle axis, depth below the
    undeformed contact]) in m, from the axis to the support; the same nodes for every
    wall of one size of mesh.
    """

    tip_m: Floats
    force_ratio_m2: Floats
    iop_ratio: Floats
    displaced_m3: Floats
    curves_sbnc: Floats


@dataclass(frozen=True)
class EvenWall:
    """A sphere whose wall is equally thick everywhere, and the needle along its normal.

    `radius_m` is that of the outer surface. The needle's force is uniform over its disc
    seen along the axis. The wall is clamped at the angle `support_rad` from the needle
    axis. `stiffening`: b of `mechanics.tissue_material`. `size`: of the mesh.
    """

    radius_m: float
    thickness_m: float
    poisson_ratio: float
    needle_radius_m: float
    stiffening: float = 0.0
    support_rad: float = 0.5 * np.pi
    size: MeridianSize = field(default_factory=MeridianSize)

    def mesh(self) -> MeridianMesh:
        """Return the meridian's mesh; sizes that make no eye raise `InputError`."""
        return meridian_mesh(
            self.radius_m,
            self.thickness_m,
            self.needle_radius_m,
            self.support_rad,
            self.size,
        )


def axisymmetric_path(
    wall: EvenWall,
    iop_ratio: float,
    end: PathEnd,
    globe: PressureLaw = CONSTANT_PRESSURE,
) -> AxisymmetricPath:
    """Return the load path of an even wall under a pressure p/E.

    The force of `end` is F/E in m^2; the globe is over Young's modulus
    (`PressureLaw.over`).
    """
    equilibrium = AxisymmetricWall(
        wall.mesh(), wall.poisson_ratio, stiffening=wall.stiffening
    )
    start = pressurise(equilibrium, iop_ratio)
    path = trace_load_path(equilibrium, start, iop_ratio, end, globe=globe)

    return equilibrium.boundaries(path)


class AxisymmetricWall:
    """A wall of revolution as an `Equilibrium`."""

    def __init__(
        self,
        mesh: MeridianMesh,
        poisson_ratio: float,
        *,
        symmetric: bool = False,
        stiffening: float = 0.0,
    ) -> None:
        """`symmetric`: the support is a plane of symmetry, at a right angle to the
        axis, instead of a clamp.
        """
        self.mesh = mesh
        held_nc = np.zeros(mesh.points_nc.shape, dtype=bool)
        across = len(mesh.points_nc) // len(mesh.outer_n)
        held_nc[:across, 0] = True  # radial motion on the axis
        held_nc[-across:] = not symmetric, True  # the support
        self.free: Integers = np.flatnonzero(~held_nc.ravel())
        self._solid = meridian_elements.solid_of_revolution(
            mesh, poisson_ratio, stiffening
        )
        self._band = _Band(self._solid.unknowns_en, self.free, mesh.points_nc.size)
        self._inside = Interior(mesh)
        self.needle = needle_load(mesh)[self.free]
        tip = np.zeros(mesh.points_nc.size)
        tip[2 * mesh.outer_n[0] + 1] = -1.0
        self.tip = tip[self.free]

    def residual(self, u: Floats, pressure: float) -> Floats:
        """Internal forces minus the pressure's, (unknown,)."""
        everywhere = self.full(u)
        balance: Floats = (
            meridian_elements.nodal_forces(self._solid, everywhere)
            - pressure * self._inside.volume(everywhere)[1]
        )
        return balance[self.free]

    def factor(self, u: Floats, pressure: float) -> Solve:
        """Factor the tangent."""
        everywhere = self.full(u)
        tangents = meridian_elements.element_tangents(self._solid, everywhere)
        self._inside.subtract_curvature(tangents, everywhere, pressure)
        return self._band.factor(tangents)

    def volume(self, u: Floats) -> tuple[float, Floats]:
        """Return the volume inside in m^3 and its derivative, (unknown,)."""
        volume_m3, gradient = self._inside.volume(self.full(u))
        return volume_m3, gradient[self.free]

    def boundaries(self, path: PathStates) -> AxisymmetricPath:
        """Return the path as the two boundary curves of each state."""
        points_snc = self.mesh.points_nc + np.stack(
            [self.full(u).reshape(-1, 2) for u in path.displacement_su]
        )
        curves_sbnc: Floats = points_snc[
            :, np.stack([self.mesh.outer_n, self.mesh.inner_n])
        ]
        curves_sbnc[..., 1] = self.mesh.radius_m - curves_sbnc[..., 1]
        inside, undented = (
            np.array([self.volume(u)[0] for u in states])
            for states in (path.displacement_su, path.undented_su)
        )

        return AxisymmetricPath(
            path.tip_m, path.force, path.pressure, undented - inside, curves_sbnc
        )

    def full(self, u: Floats) -> Floats:
        """Return the displacement (unknown of the mesh,) whose free components are
        given; the held ones are zero.
        """
        everywhere = np.zeros(self.mesh.points_nc.size)
        everywhere[self.free] = u
        return everywhere


class _Band:
    """Element matrices summed into a banded matrix of the free unknowns, in LAPACK's
    storage.
    """

    def __init__(self, unknowns_eN: Integers, free: Integers, count: int) -> None:
        number = np.full(count, -1)
        number[free] = np.arange(len(free))
        local = number[unknowns_eN]
        rows, columns = np.broadcast_arrays(local[:, :, None], local[:, None, :])
        kept = (rows >= 0) & (columns >= 0)
        self._entries = np.flatnonzero(kept)
        self._columns = columns[kept]
        self._offsets = rows[kept] - columns[kept]
        self._below = self._offsets >= 0
        self._entries_below = self._entries[self._below]
        self.width = int(np.abs(self._offsets).max())
        self._half = (
            self._columns[self._below] * (self.width + 1) + self._offsets[self._below]
        )
        self._unknowns = len(free)

    def factor(self, tangents: Floats) -> Solve:
        """Factor without row exchanges, or with them past a limit of the force, where
        the tangent is not definite.
        """
        below = tangents.ravel()[self._entries_below]
        band = np.bincount(
            self._half, below, minlength=self._unknowns * (self.width + 1)
        )
        if not np.all(np.isfinite(band)):
            raise SolverError("wall: turned inside out; use a shorter step")

        factor, fault = dpbtrf(
            band.reshape(self._unknowns, -1).T, lower=1, overwrite_ab=1
        )
        if fault != 0:
            return self._exchanged(tangents)

        return lambda rhs: np.asarray(dpbtrs(factor, rhs, lower=1)[0]).reshape(
            rhs.shape
        )

    def _exchanged(self, tangents: Floats) -> Solve:
        shape = (self._unknowns, 3 * self.width + 1)
        flat = self._columns * shape[1] + 2 * self.width + self._offsets
        entries = np.bincount(
            flat, tangents.ravel()[self._entries], minlength=shape[0] * shape[1]
        )

        factors, pivots, fault = dgbtrf(
            entries.reshape(shape).T, self.width, self.width, overwrite_ab=1
        )
        if fault != 0:
            raise SolverError(
                "wall: its tangent is singular; add supports against rigid motion"
            )

        return lambda rhs: np.asarray(
            dgbtrs(factors, self.width, self.width, rhs, pivots)[0]
        ).reshape(rhs.shape)


LARGEST_POLAR_RAD = np.radians(55.0)
HARMONICS = 3
AZIMUTHS = 12
MARGIN_RAD = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class BaseShift:
    """The motion of the two boundaries of a wall of revolution caused by a plane base,
    in proportion to the loads.

    For p/E = 1 and for F/E = 1 m^2: (harmonic, [outer, inner], node, [away from the
    axis, around it, depth]) in m, at the nodes of `AxisymmetricPath.curves_sbnc`. The
    parts away from the axis and along it vary with cos(m phi), the part around it with
    sin(m phi). Beyond the angle where the base begins, the last value is repeated.
    """

    pressure_mbnc: Floats
    needle_mbnc: Floats


def base_shift(wall: EvenWall, polar_rad: float) -> BaseShift:
    """Return the shift for a needle at a polar angle, up to 55 deg: one linear solution
    in 3-D and one of revolution.

    The support of `wall` is the plane base under a needle at the pole, at a right angle
    from its axis. Stiffening has no part in linear solutions.
    """
    if not 0.0 <= polar_rad <= LARGEST_POLAR_RAD:
        raise InputError(
            f"polar angle: {np.degrees(polar_rad):g} deg; must be 0 to 55 deg"
        )

    contact = Contact(polar_rad=polar_rad)
    solid = LinearWall(
        graded_mesh(wall.radius_m, wall.thickness_m, contact), wall.poisson_ratio
    )
    even = AxisymmetricWall(wall.mesh(), wall.poisson_ratio)
    none = np.zeros_like(even.needle)
    solve = even.factor(none, 0.0)
    loads = [
        (solid.pressure_nc, solve(even.volume(none)[1])),
        (solid.needle_cnc([contact], wall.needle_radius_m)[0], solve(even.needle)),
    ]
    nodes_bn = np.stack([even.mesh.outer_n, even.mesh.inner_n])
    angles = np.arctan2(*even.mesh.points_nc[nodes_bn[0]].T)
    # of the base where it is nearest
    ahead = np.count_nonzero(angles < 0.5 * np.pi - polar_rad - MARGIN_RAD)
    last_n = np.minimum(np.arange(len(angles)), ahead - 1)
    shifts = []

    for displacement_nc, displacement in loads:
        shift_mbnc = _harmonics(solid.mesh, contact, angles[:ahead], displacement_nc)
        even_bnc = even.full(displacement).reshape(-1, 2)[nodes_bn[:, :ahead]]
        # a wall of revolution has no other harmonics
        shift_mbnc[0, ..., 0] -= even_bnc[..., 0]
        shift_mbnc[0, ..., 2] += even_bnc[..., 1]
        shifts.append(shift_mbnc[:, :, last_n])

    return BaseShift(*shifts)


def _harmonics(
    mesh: HexMesh, contact: Contact, angles_n: Floats, displacement_nc: Floats
) -> Floats:
    """Displacement of a 3-D wall at angles from the needle axis as harmonics,
    (harmonic, boundary, node, 3).
    """
    azimuths = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    angle, azimuth = np.meshgrid(angles_n, azimuths, indexing="ij")
    across = np.sin(angle)
    local = np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle)], axis=-1
    )
    axes = np.stack([contact.meridian, contact.parallel, contact.normal])
    quads, weights_dn = locate(mesh, local.reshape(-1, 3) @ axes)
    nodes_bdn = np.stack([mesh.outer_qn[quads], mesh.inner_qn[quads]])
    found = np.einsum("dn,bdnc->bdc", weights_dn, displacement_nc[nodes_bdn])
    meridional, parallel, outward = np.moveaxis(
        found.reshape(2, *angle.shape, 3) @ axes.T, -1, 0
    )
    away = meridional * np.cos(azimuths) + parallel * np.sin(azimuths)
    around = parallel * np.cos(azimuths) - meridional * np.sin(azimuths)
    order = np.arange(HARMONICS)[:, None]
    cosine = np.where(order == 0, 1.0, 2.0) / AZIMUTHS * np.cos(order * azimuths)
    sine = 2.0 / AZIMUTHS * np.sin(order * azimuths)
    parts = ((away, cosine), (around, sine), (-outward, cosine))

    return np.stack(
        [np.einsum("bna,ma->mbn", field, wave) for field, wave in parts], axis=-1
    )
