"""The needle on a wall of any form: its nodal forces, and the functional of the tip's inward displacement."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError, SolverError
from scleraforce.eye.contact import Contact
from scleraforce.eye.mesh import HexMesh, locate, surface_weights
from scleraforce.mechanics.loads import disc_rule

Floats = NDArray[np.float64]

PROJECTIONS = 30
PROJECTED_M = 1e-9


@dataclass(frozen=True, eq=False)
class Needle:
    """A push on the wall.

    `load_nc` (node, 3): nodal forces of 1 N. `tip_nc` (node, 3): the sum of its product with a displacement is the
    tip's displacement along the needle axis, inward, in m.
    """

    load_nc: Floats
    tip_nc: Floats


def needle_at(mesh: HexMesh, contact: Contact, needle_radius_m: float, axis_c: Floats | None = None) -> Needle:
    """Return a needle whose axis meets the outer surface at the contact.

    The force along the axis is uniform over the disc of the needle's outer radius, seen along the axis, and taken up by
    the outer surface below; for a sphere and the default axis it is that of `loads.needle_loads`.

    Args:
        mesh: the wall, of any form.
        contact: where it pushes; of a wall that is no sphere, the point that has this direction on the sphere.
        needle_radius_m: outer radius of the needle.
        axis_c: unit vector of the needle axis, inward, (3,); by default the opposite of the contact's normal.

    Raises:
        InputError: the axis is no unit vector that points inward, or the disc reaches over the base plane.
    """
    axis = -contact.normal if axis_c is None else axis_c
    if not abs(np.linalg.norm(axis) - 1.0) < 1e-6 or axis @ contact.normal > -0.5:
        raise InputError(f"needle axis: {np.round(axis, 3).tolist()}; must be a unit vector into the eye")
    places_pk, weights_p = disc_rule()
    across = np.cross(contact.parallel, axis)
    across /= np.linalg.norm(across)
    sideways_pc = needle_radius_m * places_pk @ np.stack([across, np.cross(axis, across)])
    directions = _below_disc(mesh, contact, sideways_pc, axis)
    return Needle(_spread(mesh, directions, weights_p)[:, None] * axis, tip_at(mesh, contact, axis))


def tip_at(mesh: HexMesh, contact: Contact, axis_c: Floats) -> Floats:
    """Return the functional of the outer surface's displacement at the contact along `axis_c`, (node, 3)."""
    return _spread(mesh, contact.normal[None], np.ones(1))[:, None] * axis_c


def _spread(mesh: HexMesh, directions_dc: Floats, weights_d: Floats) -> Floats:
    """Sum of weights times shape functions of the outer surface at directions, (node,)."""
    quads, local = locate(mesh, directions_dc)
    amounts: Floats = surface_weights(mesh, local) * weights_d[:, None]
    nodal = np.bincount(mesh.outer_qn[quads].ravel(), amounts.ravel(), minlength=len(mesh.points_nc))
    return np.asarray(nodal, dtype=np.float64)


def _below_disc(mesh: HexMesh, contact: Contact, sideways_pc: Floats, axis_c: Floats) -> Floats:
    """Directions (point, 3) of the outer surface's points that lie below points of the disc, along the axis.

    A direction that grows by v moves its point of the surface by about v, so correcting it by what the point is off,
    across the axis, contracts: by the squared sine of the tilt on a sphere.
    """
    goals_pc = _surface_points(mesh, contact.normal[None]) + sideways_pc
    directions = mesh.radius_m * contact.normal + sideways_pc
    for _ in range(PROJECTIONS):
        if len(mesh.base_nodes) and np.any(directions[:, 2] < 0.0):
            polar = np.degrees(contact.polar_rad)
            raise InputError(f"polar angle: the needle at {polar:g} deg reaches over the base; use a smaller angle")
        off = _surface_points(mesh, directions) - goals_pc
        off -= (off @ axis_c)[:, None] * axis_c
        directions = directions - off
        if np.abs(off).max() < PROJECTED_M:
            return directions
    raise SolverError("needle: its disc could not be laid on the wall; use an axis closer to the normal")


def _surface_points(mesh: HexMesh, directions_dc: Floats) -> Floats:
    """Points of the outer surface whose directions on the sphere these are, (direction, 3)."""
    quads, local = locate(mesh, directions_dc)
    points: Floats = np.einsum("dn,dnc->dc", surface_weights(mesh, local), mesh.points_nc[mesh.outer_qn[quads]])
    return points
