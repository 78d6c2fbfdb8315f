"""How far a contact beside the pole rises under the pressure, and what follows for the volume that its dent displaces.

A half-sphere under pressure bulges between its clamps: its middle rises more than what lies beside it. At a pressure p
the needle's force F moves the contact inwards by x, and the volume and the contact's way are the derivatives of one
potential (Maxwell's reciprocity, Timoshenko and Goodier, Theory of Elasticity, sec. 97):

    d(dV)/dF = -d(V)/dF = dx/dp = w'(p) - d(dent)/dp

with w(p) the contact's rise without the needle and the dent from there, as in the library. At one pressure and one dent
a contact at another polar angle differs by its force and by w', so its dent displaces F w' less F0 w0' more than one on
the pole. What the dents of both differ by, d/dp of the integral of F - F0 over the dent, is left out: below 1 % of the
volume. Under the pressure alone wall and base are of revolution about the eye's axis, so w is the pole's curve.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.base_bulge import meridian_angles
from scleraforce.library.splines import CubicSpline

Floats = NDArray[np.float64]


def contact_rises(undented_tpbnc: NDArray[np.float32], polar_rad: Floats, radius_m: float) -> Floats:
    """Return how far contacts rise along their normal under the pressure alone (a, t, p), m.

    Args:
        undented_tpbnc: walls of the library without the needle (`library.responses`).
        polar_rad: polar angles of the contacts (a,).
        radius_m: of the eye.
    """
    outer_tpnc = undented_tpbnc[:, :, 0].astype(np.float64)
    # The first has hardly moved; and an angle that is a little off turns the rise by its square only.
    spline = CubicSpline(meridian_angles(undented_tpbnc[0, 0].astype(np.float64), radius_m))
    contact_tpac = spline.shares(polar_rad) @ outer_tpnc
    away, above = contact_tpac[..., 0], radius_m - contact_tpac[..., 1]
    return np.moveaxis(away * np.sin(polar_rad) + above * np.cos(polar_rad) - radius_m, -1, 0)


def rise_slope(rise_tp: Floats, thinness_t: Floats, tension: Floats) -> Floats:
    """Return the derivative of a contact's rise by the pressure over E (t, p), m.

    Args:
        rise_tp: the rise at the library's thicknesses and tensions, m.
        thinness_t: thickness over radius.
        tension: p R/(E t) (p,).
    """
    ratio_tp = tension * thinness_t[:, None]
    per_ratio = rise_tp / ratio_tp  # hardly turns where the wall is linear
    spline = CubicSpline(np.log(tension))
    return per_ratio + spline.slopes(spline.coefficients(per_ratio, axis=1))
