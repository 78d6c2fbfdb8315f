"""Eyes that are not spheres, walls that are not even, regions of another modulus, and
the cornea.

A node in direction d goes to the outer surface's point in that direction, stretched by
the semi-axes, and from there inward along the surface's normal by its share of the
local thickness; then the eye moves rigidly, so that contact and normal are where the
sphere has them. The nodes' places on the sphere remain the coordinates of material
points. The cornea: docs/physics.md, "Form of the cornea".
"""

from dataclasses import replace
from math import asin, pi, sqrt

import numpy as np
from numpy.polynomial.legendre import legval

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import gauss_points
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.shape_functions import shape_values
from scleraforce.records.study_of_eye import CorneaStudy, FormStudy


def corneal_surface(
    directions_nc: Floats, cornea: CorneaStudy, radius_m: float
) -> tuple[Floats, Floats]:
    """Return points of the outer surface in unit directions, m, and outward unit
    normals there, (direction, 3) each.

    >>> up_nc = np.array([[0.0, 0.0, 1.0]])
    >>> apex_nc, normal_nc = corneal_surface(up_nc, CorneaStudy(), 12e-3)
    >>> print(f"{1e3 * apex_nc[0, 2]:.2f} mm")
    13.06 mm
    """
    ends_rad = _limbus(cornea, radius_m)
    axis_c = Contact(polar_rad=cornea.polar_rad, azimuth_rad=cornea.azimuth_rad).normal
    cosine_n = directions_nc @ axis_c
    # sin a times the unit vector of growing a
    across_nc = cosine_n[:, None] * directions_nc - axis_c
    angle_n = np.arctan2(np.linalg.norm(across_nc, axis=1), cosine_n)
    rho_n = np.full_like(angle_n, radius_m)
    lean_n = np.zeros_like(angle_n)
    inside = angle_n <= ends_rad[0]
    rho_n[inside], lean_n[inside] = _sphere(angle_n[inside], cornea, radius_m)
    between = (angle_n > ends_rad[0]) & (angle_n < ends_rad[1])
    rho_n[between], lean_n[between] = _furrow(
        angle_n[between], ends_rad, cornea, radius_m
    )

    return rho_n[:, None] * directions_nc, _unit(
        directions_nc - lean_n[:, None] * across_nc
    )


def _limbus(cornea: CorneaStudy, radius_m: float) -> tuple[float, float]:
    """Return the angles from the corneal axis between which the limbus lies, rad; an
    `InputError` if none is there.
    """
    if not cornea.limbus_radius_m < radius_m:
        found, globe = (
            f"{from_si(value, 'mm'):g} mm"
            for value in (cornea.limbus_radius_m, radius_m)
        )
        raise InputError(
            f"form.cornea: limbus_radius_mm: {found}; must be below the radius of the"
            f" eye, {globe}"
        )

    limbus_rad = asin(cornea.limbus_radius_m / radius_m)
    half_edge_rad = 0.5 * cornea.edge_m / radius_m
    width = f"form.cornea: edge_mm: {from_si(cornea.edge_m, 'mm'):g} mm"
    if not half_edge_rad < limbus_rad:
        raise InputError(f"{width}; must be narrower than the cornea is wide")
    if not cornea.polar_rad + limbus_rad + half_edge_rad < 0.5 * pi:
        raise InputError(
            f"{width} about a ring of {from_si(cornea.limbus_radius_m, 'mm'):g} mm and"
            f" polar_deg: {np.degrees(cornea.polar_rad):g}; the limbus must lie above"
            " the base plane"
        )

    return limbus_rad - half_edge_rad, limbus_rad + half_edge_rad


def _sphere(
    angle_n: Floats | float, cornea: CorneaStudy, radius_m: float
) -> tuple[Floats, Floats]:
    """The cornea's sphere at angles from its axis: rho, m, and the lean of the normal,
    rho'/(rho sin a).
    """
    r = cornea.radius_m
    ring = cornea.limbus_radius_m
    h = sqrt(radius_m**2 - ring**2) - sqrt(r**2 - ring**2)
    w = np.sqrt(r**2 - (h * np.sin(angle_n)) ** 2)
    return np.asarray(h * np.cos(angle_n) + w), np.asarray(-h / w)


def _furrow(
    angle_n: Floats, ends_rad: tuple[float, float], cornea: CorneaStudy, radius_m: float
) -> tuple[Floats, Floats]:
    """The cubic across the limbus: rho and the lean of the normal, as `_sphere`."""
    start = ends_rad[0]
    width = ends_rad[1] - ends_rad[0]
    rho, lean = (float(value) for value in _sphere(start, cornea, radius_m))
    # over the globe; along x, from 0 to 1
    rise = rho - radius_m
    slope = lean * rho * np.sin(start) * width
    x = (angle_n - start) / width
    rho_n = (
        radius_m + rise * (1.0 - x) ** 2 * (1.0 + 2.0 * x) + slope * x * (1.0 - x) ** 2
    )
    slope_n = (1.0 - x) * (slope * (1.0 - 3.0 * x) - 6.0 * rise * x) / width

    return rho_n, slope_n / (rho_n * np.sin(angle_n))


def form_mesh(mesh: HexMesh, form: FormStudy, contact: Contact) -> HexMesh:
    """Return a spherical wall about the origin, shaped by a form and put under the
    needle.

    The needle touches the material that is in the contact's direction on the sphere.
    The mesh locates directions as the sphere does, and keeps the nominal radius and
    thickness. A cornea that does not fit this globe is an `InputError`.

    >>> from scleraforce.mechanics.hexahedral_mesh import build_mesh
    >>> form = FormStudy(semi_axes=(1.1, 1.0, 0.9))
    >>> eye = form_mesh(build_mesh(12e-3, 0.5e-3), form, Contact(polar_rad=0.0))
    >>> heights_m = eye.points_nc[:, 2]  # the pole stays, the base is 0.9 R below it
    >>> print(f"{heights_m.min():.4f} {heights_m.max():.4f}")
    0.0012 0.0120
    """
    sphere_nc = mesh.sphere_nc
    radii_n = np.linalg.norm(sphere_nc, axis=1)
    directions_nc = sphere_nc / radii_n[:, None]
    depths_n = (mesh.radius_m - radii_n) * thickness_factor(form, directions_nc)
    surface_nc, normals_nc = _outer_surface(directions_nc, form, mesh.radius_m)
    shaped_nc = surface_nc - depths_n[:, None] * normals_nc
    touched_1c, normal_1c = _outer_surface(contact.normal[None], form, mesh.radius_m)
    # The smallest rotation of one normal onto the other (Rodrigues): cross_cc @ x =
    # axis x x. They are not opposite.
    cross_cc = np.cross(np.eye(3), np.cross(normal_1c[0], contact.normal))
    turn_cc = (
        np.eye(3)
        + cross_cc
        + cross_cc @ cross_cc / (1.0 + normal_1c[0] @ contact.normal)
    )
    placed_nc = (shaped_nc - touched_1c) @ turn_cc.T + mesh.radius_m * contact.normal

    return replace(mesh, points_nc=placed_nc, shaped_from_nc=sphere_nc)


def thickness_factor(form: FormStudy, directions_nc: Floats) -> Floats:
    """Return the wall's thickness as a multiple of the nominal one in unit directions
    (..., 3), shape (...).
    """
    factor: Floats = np.ones(directions_nc.shape[:-1])
    for wave in form.wave:
        cosine = (
            directions_nc
            @ Contact(polar_rad=wave.polar_rad, azimuth_rad=wave.azimuth_rad).normal
        )
        factor += wave.amplitude_fraction * legval(cosine, np.eye(wave.degree + 1)[-1])

    return factor


def element_modulus(mesh: HexMesh, form: FormStudy) -> Floats:
    """Return the modulus over the eye's at the Gauss points of `volume_points`,
    (element, point).
    """
    sphere_enc = mesh.sphere_nc[mesh.cells_en]
    places_pk = gauss_points(3, mesh.order + 1)[0]
    return modulus_factor(
        form, _unit(shape_values(places_pk, sphere_enc.shape[1]) @ sphere_enc)
    )


def modulus_factor(form: FormStudy, directions_nc: Floats) -> Floats:
    """Return the modulus as a multiple of the eye's in unit directions (..., 3), shape
    (...); regions multiply.
    """
    factor: Floats = np.ones(directions_nc.shape[:-1])
    for region in form.region:
        axis_c = Contact(
            polar_rad=region.polar_rad, azimuth_rad=region.azimuth_rad
        ).normal
        angle = np.arccos(np.clip(directions_nc @ axis_c, -1.0, 1.0))
        x = np.clip((region.half_angle_rad - angle) / region.edge_rad + 0.5, 0.0, 1.0)
        # 1 in the cap, 0 outside, and no kinks in between
        inside = x * x * (3.0 - 2.0 * x)
        factor *= 1.0 + (region.modulus_ratio - 1.0) * inside

    return factor


def _outer_surface(
    directions_nc: Floats, form: FormStudy, radius_m: float
) -> tuple[Floats, Floats]:
    """Points of the outer surface and its outward unit normals there, (direction,
    3).
    """
    axes = np.array(form.semi_axes)
    if form.cornea is None:
        return radius_m * axes * directions_nc, _unit(directions_nc / axes)
    points_nc, normals_nc = corneal_surface(directions_nc, form.cornea, radius_m)
    return axes * points_nc, _unit(normals_nc / axes)


def _unit(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
