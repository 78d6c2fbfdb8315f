"""The cornea as a sphere of its own, steeper or flatter than the globe: the outer surface and its normals.

In a direction d at the angle a from the corneal axis n the surface lies rho(a) d from the globe's centre. Two spheres,

    globe:   rho = R
    cornea:  rho = h cos a + w,  w = sqrt(r^2 - h^2 sin^2 a),  h = sqrt(R^2 - l^2) - sqrt(r^2 - l^2),

of radius R and r, the second one's centre h in front of the first one's, meet at the limbus, a ring of radius l about
the axis. They meet at an angle; a cubic in a that has the value and slope of both at its ends takes their place across
the limbus, in real eyes a shallow furrow 1.5 to 2 mm wide (Hogan, Alvarado, Weddell, Histology of the Human Eye, 1971).
"""

from math import asin, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.eye.contact import Contact
from scleraforce.study.eye import CorneaStudy
from scleraforce.units import from_si

Floats = NDArray[np.float64]


def corneal_surface(directions_nc: Floats, cornea: CorneaStudy, radius_m: float) -> tuple[Floats, Floats]:
    """Return the outer surface of a globe with a cornea of another radius.

    Args:
        directions_nc: unit directions from the globe's centre (direction, 3).
        cornea: radius, ring of the limbus and its width, axis.
        radius_m: of the globe.

    Returns:
        Points (direction, 3), m, and outward unit normals there (direction, 3).

    Raises:
        InputError: the limbus is no ring of this globe, is as wide as the cornea, or passes the base plane.

    >>> apex_nc, normal_nc = corneal_surface(np.array([[0.0, 0.0, 1.0]]), CorneaStudy(), 12e-3)
    >>> print(f"{1e3 * apex_nc[0, 2]:.2f} mm")
    13.06 mm
    """
    limbus_rad, half_edge_rad = _limbus(cornea, radius_m)
    axis_c = Contact(polar_rad=cornea.polar_rad, azimuth_rad=cornea.azimuth_rad).normal
    cosine_n = directions_nc @ axis_c
    across_nc = cosine_n[:, None] * directions_nc - axis_c  # sin a times the unit vector of growing a
    angle_n = np.arctan2(np.linalg.norm(across_nc, axis=1), cosine_n)
    ends_rad = limbus_rad - half_edge_rad, limbus_rad + half_edge_rad
    rho_n, lean_n = np.full_like(angle_n, radius_m), np.zeros_like(angle_n)
    inside = angle_n <= ends_rad[0]
    rho_n[inside], lean_n[inside] = _sphere(angle_n[inside], cornea, radius_m)
    between = (angle_n > ends_rad[0]) & (angle_n < ends_rad[1])
    rho_n[between], lean_n[between] = _furrow(angle_n[between], ends_rad, cornea, radius_m)
    normals_nc = directions_nc - lean_n[:, None] * across_nc
    return rho_n[:, None] * directions_nc, normals_nc / np.linalg.norm(normals_nc, axis=1, keepdims=True)


def _limbus(cornea: CorneaStudy, radius_m: float) -> tuple[float, float]:
    """Angle of the limbus from the corneal axis and half its width, rad."""
    if not cornea.limbus_radius_m < radius_m:
        found, globe = (f"{from_si(value, 'mm'):g} mm" for value in (cornea.limbus_radius_m, radius_m))
        raise InputError(f"form.cornea: limbus_radius_mm: {found}; must be below the radius of the eye, {globe}")
    limbus_rad, half_edge_rad = asin(cornea.limbus_radius_m / radius_m), 0.5 * cornea.edge_m / radius_m
    width = f"form.cornea: edge_mm: {from_si(cornea.edge_m, 'mm'):g} mm"
    if not half_edge_rad < limbus_rad:
        raise InputError(f"{width}; must be narrower than the cornea is wide")
    if not cornea.polar_rad + limbus_rad + half_edge_rad < 0.5 * pi:
        raise InputError(f"{width} about a ring of {from_si(cornea.limbus_radius_m, 'mm'):g} mm and polar_deg: "
                         f"{np.degrees(cornea.polar_rad):g}; the limbus must lie above the base plane")  # fmt: skip
    return limbus_rad, half_edge_rad


def _sphere(angle_n: Floats | float, cornea: CorneaStudy, radius_m: float) -> tuple[Floats, Floats]:
    """The cornea's sphere at angles from its axis: rho, m, and what the normal leans by, rho'/(rho sin a)."""
    r, ring = cornea.radius_m, cornea.limbus_radius_m
    h = sqrt(radius_m**2 - ring**2) - sqrt(r**2 - ring**2)
    w = np.sqrt(r**2 - (h * np.sin(angle_n)) ** 2)
    return np.asarray(h * np.cos(angle_n) + w), np.asarray(-h / w)


def _furrow(
    angle_n: Floats, ends_rad: tuple[float, float], cornea: CorneaStudy, radius_m: float
) -> tuple[Floats, Floats]:
    """The cubic across the limbus; the same as of the sphere."""
    start, width = ends_rad[0], ends_rad[1] - ends_rad[0]
    rho, lean = (float(value) for value in _sphere(start, cornea, radius_m))
    rise, slope = rho - radius_m, lean * rho * np.sin(start) * width  # over the globe; along x, from 0 to 1
    x = (angle_n - start) / width
    rho_n = radius_m + rise * (1.0 - x) ** 2 * (1.0 + 2.0 * x) + slope * x * (1.0 - x) ** 2
    slope_n = (1.0 - x) * (slope * (1.0 - 3.0 * x) - 6.0 * rise * x) / width
    return rho_n, slope_n / (rho_n * np.sin(angle_n))
