"""Loads and supports of the wall: eye pressure, gravity, the needle; the clamped base
and springs (paper sec. 2.1).

Loads are consistent: integrals of the load times the shape functions, so that the sum
of the nodal forces is exactly the resultant of the integrated load. They act on the
undeformed wall, as in linear mechanics, or follow it (`InnerSurface`). Springs on the
outer surface are an elastic bed around the lower half, and straps where the rectus
muscles are inserted; they are linear in the displacement, with directions of the
undeformed wall. Insertions lie on the spiral of Tillaux: 5.5, 6.5, 6.9 and 7.7 mm
behind the limbus (medial, inferior, lateral, superior), 9 to 11 mm wide (Apt, Trans.
Am. Ophthalmol. Soc. 78, 1980, 365), on an eye of 12 mm radius whose limbus has a radius
of 5.75 mm; on other eyes at the same angles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, pi

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Integers, Reals
from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import (
    VolumePoints,
    add_faces,
    gauss_points,
    surface_points,
)
from scleraforce.mechanics.hexahedral_mesh import HexMesh, locate, sum_at
from scleraforce.mechanics.shape_functions import shape_gradients, shape_values
from scleraforce.records.study import SupportsStudy

# exact: normal times shape function of a curved quad is of degree 5 in each direction
PRESSURE_POINTS = 3
DISC_RINGS = 6
DISC_ANGLES = 24


def pressure_load(mesh: HexMesh) -> Floats:
    """Return nodal forces of a unit pressure inside, normal to the inner surface,
    outward: (node, 3) in N/Pa.
    """
    values_pn, areas_qpc = surface_points(mesh, mesh.inner_qn, PRESSURE_POINTS)
    return sum_at(
        mesh.inner_qn,
        np.einsum("pn,qpc->qnc", values_pn, areas_qpc),
        len(mesh.points_nc),
    )


def gravity_load(mesh: HexMesh, points: VolumePoints) -> Floats:
    """Return nodal forces of a unit weight density (density times g) along -z: (node,
    3) in N per N/m^3.
    """
    down = np.array([0.0, 0.0, -1.0])
    return sum_at(
        mesh.cells_en,
        (points.volumes_ep @ points.values_pn)[..., None] * down,
        len(mesh.points_nc),
    )


def needle_loads(
    mesh: HexMesh, contacts: Sequence[Contact], needle_radius_m: float
) -> Floats:
    """Return nodal forces of 1 N through the needle at each contact: (contact, node,
    3).

    The needle, seen along its axis, covers a disc of its outer radius; the force along
    the axis is uniform over it and taken up by the outer surface below. Integrated by
    Gauss in the squared radius and equal angles; the weights of the points sum to 1 and
    so do the shape functions, hence the resultant is exactly 1 N along the inward
    normal.
    """
    places_pk, weights_p = disc_rule()
    sideways_pk = needle_radius_m / mesh.radius_m * places_pk
    height = np.sqrt(1.0 - np.sum(sideways_pk**2, axis=1))
    axes = np.array(
        [[contact.meridian, contact.parallel, contact.normal] for contact in contacts]
    )
    # (contact, point, 3)
    directions = np.concatenate([sideways_pk, height[:, None]], axis=1) @ axes

    below = np.flatnonzero(np.any(directions[..., 2] < 0.0, axis=1))
    if len(below):
        raise _over_base(contacts[below[0]])

    quads, values = locate(mesh, directions.reshape(-1, 3))
    weights = values * np.tile(weights_p, len(contacts))[:, None]
    load_of = np.repeat(np.arange(len(contacts)), len(weights_p))
    flat = load_of[:, None] * len(mesh.points_nc) + mesh.outer_qn[quads]
    amount = np.bincount(
        flat.ravel(), weights.ravel(), minlength=len(contacts) * len(mesh.points_nc)
    )
    normals = np.array([contact.normal for contact in contacts])

    return -amount.reshape(len(contacts), -1, 1) * normals[:, None]


def disc_rule() -> tuple[Floats, Floats]:
    """Return points (point, 2) in the unit disc and weights (point,) that sum to 1: a
    uniform load.
    """
    places, weights = gauss_points(1, DISC_RINGS)
    radius = np.sqrt(0.5 * (places[:, 0] + 1.0))  # equal steps of r^2 are equal areas
    # Half a step turns every other ring, so that no two rings share their angles.
    angles = (np.arange(DISC_ANGLES) + 0.5 * (np.arange(DISC_RINGS) % 2)[:, None]) * (
        2.0 * np.pi / DISC_ANGLES
    )
    points = radius[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)

    return points.reshape(-1, 2), np.repeat(0.5 * weights / DISC_ANGLES, DISC_ANGLES)


def _over_base(contact: Contact) -> InputError:
    polar = np.degrees(contact.polar_rad)
    return InputError(
        f"polar angle: the needle at {polar:g} deg reaches over the base; use a smaller"
        " angle"
    )


PROJECTIONS = 30
PROJECTED_M = 1e-9


@dataclass(frozen=True, eq=False)
class NeedleLoad:
    """A push on the wall.

    `load_nc` (node, 3): nodal forces of 1 N. `tip_nc` (node, 3): the sum of its product
    with a displacement is the tip's displacement along the needle axis, inward, in m.
    """

    load_nc: Floats
    tip_nc: Floats


def needle_at(
    mesh: HexMesh,
    contact: Contact,
    needle_radius_m: float,
    axis_c: Floats | None = None,
) -> NeedleLoad:
    """Return a needle whose axis meets the outer surface at the contact, with a load as
    that of `needle_loads`.

    Of a wall of another form the contact is the point that has this direction on the
    sphere. `axis_c` is a unit vector into the eye, (3,); by default the opposite of the
    contact's normal.
    """
    axis = -contact.normal if axis_c is None else axis_c
    if not abs(np.linalg.norm(axis) - 1.0) < 1e-6 or axis @ contact.normal > -0.5:
        raise InputError(
            f"needle axis: {np.round(axis, 3).tolist()}; must be a unit vector into"
            " the eye"
        )

    places_pk, weights_p = disc_rule()
    across = np.cross(contact.parallel, axis)
    across /= np.linalg.norm(across)
    sideways_pc = (
        needle_radius_m * places_pk @ np.stack([across, np.cross(axis, across)])
    )
    directions = _below_disc(mesh, contact, sideways_pc, axis)

    return NeedleLoad(
        _spread(mesh, directions, weights_p)[:, None] * axis,
        tip_at(mesh, contact, axis),
    )


def tip_at(mesh: HexMesh, contact: Contact, axis_c: Floats) -> Floats:
    """Return the functional of the outer surface's displacement at the contact along
    `axis_c`, (node, 3).
    """
    return _spread(mesh, contact.normal[None], np.ones(1))[:, None] * axis_c


def _spread(mesh: HexMesh, directions_dc: Floats, weights_d: Floats) -> Floats:
    """Sum of weights times shape functions of the outer surface at directions,
    (node,).
    """
    quads, values_dn = locate(mesh, directions_dc)
    amounts = values_dn * weights_d[:, None]
    nodal = np.bincount(
        mesh.outer_qn[quads].ravel(), amounts.ravel(), minlength=len(mesh.points_nc)
    )
    return np.asarray(nodal, dtype=np.float64)


def _below_disc(
    mesh: HexMesh, contact: Contact, sideways_pc: Floats, axis_c: Floats
) -> Floats:
    """Directions (point, 3) of the outer surface's points that lie below points of the
    disc, along the axis.

    A direction that grows by v moves its point by about v, so correcting it by the
    point's error across the axis contracts: by the squared sine of the tilt on a
    sphere.
    """
    goals_pc = _surface_points(mesh, contact.normal[None]) + sideways_pc
    directions = mesh.radius_m * contact.normal + sideways_pc

    for _ in range(PROJECTIONS):
        if len(mesh.base_nodes) and np.any(directions[:, 2] < 0.0):
            raise _over_base(contact)

        off = _surface_points(mesh, directions) - goals_pc
        off -= (off @ axis_c)[:, None] * axis_c
        directions = directions - off
        if np.abs(off).max() < PROJECTED_M:
            return directions

    raise SolverError(
        "needle: its disc could not be laid on the wall; use an axis closer to the"
        " normal"
    )


def _surface_points(mesh: HexMesh, directions_dc: Floats) -> Floats:
    """Points of the outer surface whose directions on the sphere these are, (direction,
    3).
    """
    quads, values_dn = locate(mesh, directions_dc)
    return np.einsum("dn,dnc->dc", values_dn, mesh.points_nc[mesh.outer_qn[quads]])


# (e_k x a)_i = a_m for these (i, k, m), and -a_m with i and k exchanged.
TURNS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


class InnerSurface:
    """The inner surface of the wall, on which the vitreous presses; displacements are
    (node, 3) in m.

    The force f_a = p * integral of N_a (x,1 x x,2) over the local coordinates of the
    inner quads is the derivative by the nodes' positions of p times the cavity's
    volume, as long as the edge of the surface is held or stays in its plane: then the
    derivative of f is symmetric. Source: Bonet and Wood, Nonlinear Continuum Mechanics,
    sec. 8.5 and 9.5.
    """

    def __init__(self, mesh: HexMesh) -> None:
        places, weights = gauss_points(2, PRESSURE_POINTS)
        nodes = mesh.inner_qn.shape[1]
        self._mesh = mesh
        self._points_nc = mesh.points_nc
        self._quads_qn = mesh.inner_qn
        base = mesh.points_nc[np.intersect1d(mesh.base_nodes, mesh.inner_qn)]
        self._origin_c = base.mean(axis=0) if len(base) else np.zeros(3)
        self._values_pn = shape_values(places, nodes)
        self._slopes_kpn = shape_gradients(places, nodes).transpose(2, 0, 1)
        self._weights_p = weights
        # integral of N_a N_b,k for the derivative: w_p N_a N_b,k, (k, a, b, point)
        self._products = np.einsum(
            "p,pa,kpb->kabp", weights, self._values_pn, self._slopes_kpn
        )

    def volume(self, displacement_nc: Floats) -> float:
        """Return the volume of the cavity in m^3: inside a whole globe, or above the
        base of a half.

        V = 1/3 integral of x . n with x from a point of the base, so that the base,
        which is plane, adds nothing.
        """
        x_qnc = (self._points_nc + displacement_nc - self._origin_c)[self._quads_qn]
        areas = self._areas(x_qnc)
        return (
            float(
                np.einsum(
                    "p,pn,qnc,qpc->",
                    self._weights_p,
                    self._values_pn,
                    x_qnc,
                    areas,
                    optimize=True,
                )
            )
            / 3.0
        )

    def forces(self, displacement_nc: Floats) -> Floats:
        """Return the nodal forces of 1 Pa, normal to the deformed surface, outward:
        (node, 3) in N.
        """
        areas = self._areas((self._points_nc + displacement_nc)[self._quads_qn])
        local_qnc = np.einsum(
            "p,pn,qpc->qnc", self._weights_p, self._values_pn, areas, optimize=True
        )
        return sum_at(self._quads_qn, local_qnc, len(self._points_nc))

    def add_tangent(
        self, element_eiajb: Reals, displacement_nc: Floats, factor: float
    ) -> None:
        """Add `factor` times the derivative of the forces by the displacement to the
        element matrices, in place.

        df_a / du_b = integral of N_a (N_b,1 e_k x x,2 - N_b,2 e_k x x,1). Only the
        symmetric part of every quad is added: the rest cancels between neighbours, and
        at the edge where it is held.
        """
        x_qnc = (self._points_nc + displacement_nc)[self._quads_qn]
        first, second = (slopes_pn @ x_qnc for slopes_pn in self._slopes_kpn)
        vectors = np.einsum("abp,qpm->qabm", self._products[0], second, optimize=True)
        vectors -= np.einsum("abp,qpm->qabm", self._products[1], first, optimize=True)
        vectors = 0.5 * factor * (vectors - vectors.transpose(0, 2, 1, 3))
        nodes = self._quads_qn.shape[1]
        local = np.zeros((len(vectors), 3, nodes, 3, nodes))

        for i, k, m in TURNS:
            local[:, i, :, k] = vectors[..., m]
            local[:, k, :, i] = -vectors[..., m]

        add_faces(element_eiajb, self._mesh, local, layer=0)

    def _areas(self, x_qnc: Floats) -> Floats:
        """x,1 x x,2 at the Gauss points of quads with nodes at x, (quad, point, 3)."""
        first, second = (slopes_pn @ x_qnc for slopes_pn in self._slopes_kpn)
        return np.cross(first, second)


def clamped_base(mesh: HexMesh) -> Flags:
    """Clamp the whole base (the paper's Dirichlet condition, sec. 2.1): flags (node,
    3), True where held.
    """
    held = np.zeros(mesh.points_nc.shape, dtype=bool)
    held[mesh.base_nodes] = True
    return held


BED_POINTS = 3
STRAP_POINTS = 16  # Gauss points along the line of an insertion
EYE_RADIUS_MM = 12.0
LIMBUS_RAD = asin(5.75 / EYE_RADIUS_MM)  # its polar angle
# Polar angle, azimuth from the medial rectus, the arc's width, in rad; from mm behind
# the limbus and mm of width.
INSERTIONS = {
    name: (
        LIMBUS_RAD + behind_limbus_mm / EYE_RADIUS_MM,
        0.5 * pi * quarter_turns,
        width_mm / EYE_RADIUS_MM,
    )
    for quarter_turns, (name, behind_limbus_mm, width_mm) in enumerate(
        (
            ("medial", 5.5, 10.3),
            ("superior", 7.7, 10.6),
            ("lateral", 6.9, 9.2),
            ("inferior", 6.5, 9.8),
        )
    )
}


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs between a wall and its undeformed place.

    `quads_q` (quad,): the outer quads they act on; `blocks_qnnii` (quad, node, node, 3,
    3): their stiffness in N/m. A quad may occur more than once.
    """

    mesh: HexMesh
    quads_q: Integers
    blocks_qnnii: Floats

    def __add__(self, other: "Springs") -> "Springs":
        """Return the springs of both."""
        quads_q = np.concatenate([self.quads_q, other.quads_q])
        return Springs(
            self.mesh, quads_q, np.concatenate([self.blocks_qnnii, other.blocks_qnnii])
        )

    def add_to(self, element_eiajb: Reals, factor: float) -> None:
        """Add `factor` times the stiffness to element matrices, in place."""
        blocks = factor * self.blocks_qnnii.transpose(0, 3, 1, 4, 2)
        add_faces(element_eiajb, self.mesh, blocks, self.quads_q, layer=2)

    def forces(self, displacement_nc: Floats) -> Floats:
        """Return the nodal forces (node, 3) that hold a displacement (node, 3) in m
        against the springs, in N.
        """
        nodes_qn = self.mesh.outer_qn[self.quads_q]
        local_qni = np.einsum(
            "qnmij,qmj->qni",
            self.blocks_qnnii,
            displacement_nc[nodes_qn],
            optimize=True,
        )

        return sum_at(nodes_qn, local_qni, len(displacement_nc))


def elastic_bed(
    mesh: HexMesh, stiffness_pa_m: float, shear_stiffness_pa_m: float
) -> Springs:
    """Return a Winkler bed under the outer surface of a whole globe's lower half, z < 0
    on the sphere.

    Its stiffness is pressure per metre along the wall's normal, either way, and shear
    per metre that the wall slides.
    """
    places, _ = gauss_points(2, BED_POINTS)
    heights_qp = (
        mesh.sphere_nc[mesh.outer_qn][..., 2]
        @ shape_values(places, mesh.outer_qn.shape[1]).T
    )

    quads = np.flatnonzero(np.any(heights_qp < 0.0, axis=1))
    if not len(quads):
        raise InputError(
            "bed: this wall has no lower half to lie on it; use a whole globe"
        )

    values_pn, areas_qpc = surface_points(mesh, mesh.outer_qn[quads], BED_POINTS)
    amounts_qp = np.linalg.norm(areas_qpc, axis=-1)
    normals_qpc = areas_qpc / amounts_qp[..., None]
    outer_qpii = normals_qpc[..., :, None] * normals_qpc[..., None, :]
    stiffness_qpii = (
        shear_stiffness_pa_m * np.eye(3)
        + (stiffness_pa_m - shear_stiffness_pa_m) * outer_qpii
    )
    stiffness_qpii *= (amounts_qp * (heights_qp[quads] < 0.0))[..., None, None]

    return Springs(
        mesh,
        quads,
        np.einsum(
            "pn,pm,qpij->qnmij", values_pn, values_pn, stiffness_qpii, optimize=True
        ),
    )


def rectus_straps(
    mesh: HexMesh, stiffness_n_m: float, medial_azimuth_rad: float = 0.0
) -> Springs:
    """Return four straps that hold the insertions of the rectus muscles along the
    meridians, of a stiffness each.
    """
    places, weights = gauss_points(1, STRAP_POINTS)
    contacts = [
        Contact(polar_rad=polar_rad, azimuth_rad=azimuth_rad)
        for polar_rad, from_medial_rad, width_rad in INSERTIONS.values()
        for azimuth_rad in (
            medial_azimuth_rad
            + from_medial_rad
            + 0.5 * width_rad * places[:, 0] / np.sin(polar_rad)
        )
    ]
    quads, values_pn = locate(mesh, np.array([contact.normal for contact in contacts]))
    weights_p = np.tile(0.5 * weights, len(INSERTIONS))
    along_pc = np.array([contact.meridian for contact in contacts])
    blocks = np.einsum(
        "p,pn,pm,pi,pj->pnmij",
        weights_p,
        values_pn,
        values_pn,
        along_pc,
        along_pc,
        optimize=True,
    )

    return Springs(mesh, quads, stiffness_n_m * blocks)


def study_springs(supports: SupportsStudy, mesh: HexMesh) -> Springs | None:
    """Return the springs of a study's supports; None for the clamped base alone."""
    springs = None
    if supports.has_bed:
        springs = elastic_bed(
            mesh, supports.bed_stiffness_pa_per_m, supports.bed_shear_stiffness_pa_per_m
        )

    if supports.has_straps:
        straps = rectus_straps(
            mesh, supports.strap_stiffness_n_per_m, supports.medial_azimuth_rad
        )
        springs = straps if springs is None else springs + straps

    return springs
