"""Eyes that are not spheres, walls that are not even, regions of another modulus.

The wall is shaped from that of a sphere: a node in direction d goes to the outer surface's point in that direction,
stretched by the semi-axes, and from there inward along the surface's normal by its share of the local thickness. Then
the whole eye moves rigidly, so that the contact and the outward normal there are where the sphere has them: needle,
B-scan plane and tip displacement need not know of the form. The nodes' places on the sphere stay the coordinates by
which material points are found.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from scleraforce.eye.contact import Contact
from scleraforce.eye.cornea import corneal_surface
from scleraforce.eye.mesh import HexMesh
from scleraforce.eye.shapes import shape_values
from scleraforce.study.eye import FormStudy, RegionStudy

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FormedEye:
    """A wall shaped by a form: `mesh`, in place under the needle, and the modulus of its points."""

    mesh: HexMesh
    form: FormStudy

    def modulus_factor(self, local_pk: Floats) -> Floats:
        """Return the modulus over the eye's at local points (point, 3) of all elements, (element, point)."""
        sphere_enc = self.mesh.sphere_nc[self.mesh.cells_en]
        positions_epc = shape_values(local_pk, sphere_enc.shape[1]) @ sphere_enc
        return modulus_factor(self.form, _unit(positions_epc))


def form_mesh(mesh: HexMesh, form: FormStudy, contact: Contact) -> FormedEye:
    """Shape a spherical wall and put it under the needle.

    Args:
        mesh: the wall of a sphere about the origin.
        form: semi-axes, waves of the thickness, regions, cornea.
        contact: the needle's; the material in this direction on the sphere is what it touches.

    Returns:
        The eye. Its `mesh` locates directions as the sphere does, and keeps the nominal radius and thickness.

    Raises:
        InputError: a cornea that is none of this globe.

    >>> from scleraforce.eye.mesh import build_mesh
    >>> eye = form_mesh(build_mesh(12e-3, 0.5e-3), FormStudy(semi_axes=(1.1, 1.0, 0.9)), Contact(polar_rad=0.0))
    >>> heights_m = eye.mesh.points_nc[:, 2]
    >>> print(f"{heights_m.min():.4f} {heights_m.max():.4f}")  # the pole stays, the base is 0.9 R below it
    0.0012 0.0120
    """
    sphere_nc = mesh.sphere_nc
    radii_n = np.linalg.norm(sphere_nc, axis=1)
    directions_nc = sphere_nc / radii_n[:, None]
    depths_n = (mesh.radius_m - radii_n) * thickness_factor(form, directions_nc)
    surface_nc, normals_nc = _outer_surface(directions_nc, form, mesh.radius_m)
    shaped_nc = surface_nc - depths_n[:, None] * normals_nc
    touched_1c, normal_1c = _outer_surface(contact.normal[None], form, mesh.radius_m)
    turn_cc = _rotation(normal_1c[0], contact.normal)
    placed_nc = (shaped_nc - touched_1c) @ turn_cc.T + mesh.radius_m * contact.normal
    return FormedEye(replace(mesh, points_nc=placed_nc, shaped_from_nc=sphere_nc), form)


def thickness_factor(form: FormStudy, directions_nc: Floats) -> Floats:
    """Return the wall's thickness as a multiple of the nominal one in unit directions (..., 3), shape (...)."""
    factor: Floats = np.ones(directions_nc.shape[:-1])
    for wave in form.wave:
        cosine = directions_nc @ Contact(polar_rad=wave.polar_rad, azimuth_rad=wave.azimuth_rad).normal
        factor += wave.amplitude_fraction * legval(cosine, np.eye(wave.degree + 1)[-1])
    return factor


def modulus_factor(form: FormStudy, directions_nc: Floats) -> Floats:
    """Return the modulus as a multiple of the eye's in unit directions (..., 3), shape (...); regions multiply."""
    factor: Floats = np.ones(directions_nc.shape[:-1])
    for region in form.region:
        factor *= 1.0 + (region.modulus_ratio - 1.0) * _inside(region, directions_nc)
    return factor


def _inside(region: RegionStudy, directions_nc: Floats) -> Floats:
    """1 inside a cap, 0 outside; a cubic with no kinks in between."""
    angle = np.arccos(
        np.clip(directions_nc @ Contact(polar_rad=region.polar_rad, azimuth_rad=region.azimuth_rad).normal, -1.0, 1.0)
    )
    x = np.clip((region.half_angle_rad - angle) / region.edge_rad + 0.5, 0.0, 1.0)
    smooth: Floats = x * x * (3.0 - 2.0 * x)
    return smooth


def _outer_surface(directions_nc: Floats, form: FormStudy, radius_m: float) -> tuple[Floats, Floats]:
    """Points of the outer surface and its outward unit normals there, (direction, 3)."""
    axes = np.array(form.semi_axes)
    if form.cornea is None:
        return radius_m * axes * directions_nc, _unit(directions_nc / axes)
    points_nc, normals_nc = corneal_surface(directions_nc, form.cornea, radius_m)
    return axes * points_nc, _unit(normals_nc / axes)


def _rotation(start: Floats, end: Floats) -> Floats:
    """The smallest rotation that turns one unit vector into another (Rodrigues), (3, 3); they are not opposite."""
    cross_cc = np.cross(np.eye(3), np.cross(start, end))  # cross_cc @ x = axis x x
    turn: Floats = np.eye(3) + cross_cc + cross_cc @ cross_cc / (1.0 + start @ end)
    return turn


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit
