"""Walls that are no even spheres where the needle does not push: what that adds to the section of a library's wall.

To either side of the contact lies a limbus, at which the surface turns by an angle and from which on it curves
otherwise: the cornea, or the flat side of an ellipsoid. And the wall may grow thicker along the section. Of an even
sphere angles, curvatures and thickening are 0, and the places of the limbus do not matter.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of each side, left and right: place of the limbus from the contact, m; the angle there, rad, up below 0; the curvature
# beyond, 1/m. Then how the thickness grows along the section, m/m.
FORMS = (
    "left_limbus_m", "left_angle_rad", "left_curvature",
    "right_limbus_m", "right_angle_rad", "right_curvature", "wedge",
)  # fmt: skip
# Least and largest of them. A limbus turns up: the cornea bulges.
FORM_ENDS = np.array([[1.5e-3, -0.5, -20.0, 1.5e-3, -0.5, -20.0, -0.05], [7e-3, 0.01, 60.0, 7e-3, 0.01, 60.0, 0.05]])
SOFT_M = 0.4e-3  # the limbus is a smooth furrow


def form_depths(form: Array, from_contact_m: Array, is_inner: Array) -> tuple[Array, Array, Array]:
    """Return what a form adds to depths and slopes, (place,) each, and how the depths turn with it, (place, form).

    Args:
        form: (7,), in the order of `FORMS`.
        from_contact_m: lateral distance from the contact (place,), m.
        is_inner: 1 on the inner boundary, 0 on the outer (place,).
    """
    wedge = form[6]
    depths, slopes = wedge * from_contact_m * is_inner, wedge * is_inner
    turned = np.empty((len(from_contact_m), len(FORMS)))
    turned[:, 6] = from_contact_m * is_inner
    for side, first in ((-1.0, 0), (1.0, 3)):
        limbus_m, angle, curvature = form[first : first + 3]
        beyond = side * from_contact_m - limbus_m
        root = np.sqrt(beyond**2 + SOFT_M**2)
        ramp, rise = 0.5 * (beyond + root), 0.5 * (1.0 + beyond / root)
        by_beyond = (angle + curvature * ramp) * rise
        depths = depths + (angle + 0.5 * curvature * ramp) * ramp
        slopes = slopes + side * by_beyond
        turned[:, first : first + 3] = np.stack([-by_beyond, ramp, 0.5 * ramp**2], axis=1)
    return depths, slopes, turned
