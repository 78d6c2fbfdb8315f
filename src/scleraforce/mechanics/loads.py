"""Nodal forces: eye pressure, gravity, the needle, any load on the outer surface (paper sec. 2.1).

All are consistent: integrals of the load times the shape functions, so that the sum of the nodal forces is exactly the
resultant of the integrated load. They act on the undeformed wall, as linear mechanics has it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.eye.contact import Contact
from scleraforce.eye.mesh import HexMesh, locate, surface_weights
from scleraforce.mechanics.quadrature import VolumePoints, gauss_points, surface_points

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

PRESSURE_POINTS = 3  # exact: normal times shape function of a curved quad is of degree 5 in each direction
DISC_RINGS = 6
DISC_ANGLES = 24


def pressure_load(mesh: HexMesh) -> Floats:
    """Return nodal forces of a unit pressure inside, normal to the inner surface, outward: (node, 3) in N/Pa."""
    points = surface_points(mesh, mesh.inner_qn, PRESSURE_POINTS)
    return _scatter(mesh, mesh.inner_qn, np.einsum("pn,qpc->qnc", points.values_pn, points.areas_qpc))


def gravity_load(mesh: HexMesh, points: VolumePoints) -> Floats:
    """Return nodal forces of a unit weight density (density times g) along -z: (node, 3) in N per N/m^3."""
    down = np.array([0.0, 0.0, -1.0])
    return _scatter(mesh, mesh.cells_en, (points.volumes_ep @ points.values_pn)[..., None] * down)


def needle_loads(mesh: HexMesh, contacts: Sequence[Contact], needle_radius_m: float) -> Floats:
    """Return nodal forces of 1 N through the needle at each contact: (contact, node, 3).

    The needle, seen along its axis, covers a disc of its outer radius; the force along the axis is uniform over it and
    taken up by the outer surface below. Integrated by Gauss in the squared radius and equal angles; the weights of the
    points sum to 1 and so do the shape functions, hence the resultant is exactly 1 N along the inward normal.

    Raises:
        InputError: a disc reaches over the base plane.
    """
    places_pk, weights_p = disc_rule()
    directions = _disc_directions(contacts, needle_radius_m / mesh.radius_m * places_pk)
    _check_disc(contacts, directions)
    quads, local = locate(mesh, directions.reshape(-1, 3))
    weights = surface_weights(mesh, local) * np.tile(weights_p, len(contacts))[:, None]
    load_of = np.repeat(np.arange(len(contacts)), len(weights_p))
    flat = load_of[:, None] * len(mesh.points_nc) + mesh.outer_qn[quads]
    amount = np.bincount(flat.ravel(), weights.ravel(), minlength=len(contacts) * len(mesh.points_nc))
    normals = np.array([contact.normal for contact in contacts])
    loads: Floats = -amount.reshape(len(contacts), -1, 1) * normals[:, None]
    return loads


def weighted_surface_load(
    mesh: HexMesh, weight: Callable[[Floats], Floats], direction_c: Floats, points_per_quad: int = 8
) -> Floats:
    """Return nodal forces of 1 N along `direction_c`, spread over the outer surface: (node, 3).

    `weight` maps positions (..., 3) in m to a load per area (...) of any scale; it is normalised to the total. The
    Gaussian of reference problem R1 is one such weight.
    """
    points = surface_points(mesh, mesh.outer_qn, points_per_quad)
    load_qp = weight(points.positions_qpc) * np.linalg.norm(points.areas_qpc, axis=-1)
    nodal_qn = load_qp @ points.values_pn / load_qp.sum()
    return _scatter(mesh, mesh.outer_qn, nodal_qn[..., None] * direction_c)


def disc_rule() -> tuple[Floats, Floats]:
    """Return points (point, 2) in the unit disc and weights (point,) that sum to 1: a uniform load."""
    places, weights = gauss_points(1, DISC_RINGS)
    radius = np.sqrt(0.5 * (places[:, 0] + 1.0))  # equal steps of r^2 are equal areas
    # Half a step turns every other ring, so that no two rings share their angles.
    angles = (np.arange(DISC_ANGLES) + 0.5 * (np.arange(DISC_RINGS) % 2)[:, None]) * (2.0 * np.pi / DISC_ANGLES)
    points = radius[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return points.reshape(-1, 2), np.repeat(0.5 * weights / DISC_ANGLES, DISC_ANGLES)


def _disc_directions(contacts: Sequence[Contact], sideways_pk: Floats) -> Floats:
    """Project points of a disc (in outer radii) along each needle axis on the unit sphere: (contact, point, 3)."""
    height = np.sqrt(1.0 - np.sum(sideways_pk**2, axis=1))
    local = np.concatenate([sideways_pk, height[:, None]], axis=1)
    axes = np.array([[contact.meridian, contact.parallel, contact.normal] for contact in contacts])
    directions: Floats = local @ axes
    return directions


def _check_disc(contacts: Sequence[Contact], directions_cpk: Floats) -> None:
    below = np.flatnonzero(np.any(directions_cpk[..., 2] < 0.0, axis=1))
    if len(below):
        polar = np.degrees(contacts[below[0]].polar_rad)
        raise InputError(f"polar angle: the needle at {polar:g} deg reaches over the base; use a smaller angle")


def _scatter(mesh: HexMesh, nodes_en: Integers, values_enc: Floats) -> Floats:
    """Add values per element and local node to the mesh's nodes, shape (node, 3)."""
    flat, count = nodes_en.ravel(), len(mesh.points_nc)
    values = values_enc.reshape(-1, 3)
    return np.stack([np.bincount(flat, values[:, c], minlength=count) for c in range(3)], axis=1)
