"""How much stiffer an eye is where the needle does not push on the pole (`mechanics.polar` has the mechanics).

From a contact beside the pole the base lies nearer on one side and farther on the other. The force of a wall of
revolution depends on where it is clamped, smoothly; half of what the mean over the directions differs from the force
with the clamp at 90 degrees is the correction. It is that of the first stiffening of the tissue for all of them: up to
45 degrees from the pole it changes by less than 1 % with it, at 55 degrees by 3 % (b = 10) and 9 % (30) in thick walls.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.plan import LARGEST_POLAR_DEG, SUPPORTS_DEG, evenly_picked
from scleraforce.library.splines import SUPPORT, CubicSpline
from scleraforce.mechanics.polar import DIRECTIONS, SHARE, base_angle

Floats = NDArray[np.float64]

POLAR_ANGLES = 11
RIGHT_ANGLE = int(np.searchsorted(SUPPORTS_DEG, 90.0))  # where it stands among the supports


def base_stiffness(
    thickness_m: Floats, tension: Floats, tip_m: Floats, force_tpd: Floats, support_force_bklt: Floats
) -> tuple[Floats, Floats]:
    """Return polar angles of the contact (a,), rad, and the factor of the force there (a, t, p, d).

    Args:
        thickness_m: thicknesses of the library (t,), m.
        tension: tensions p R/(E t) (p,).
        tip_m: tips (d,), m.
        force_tpd: F/E with the clamp at 90 degrees.
        support_force_bklt: F/E with the clamps of the plan, at its thicknesses and tensions, at the first tips.
    """
    tips = support_force_bklt.shape[3]
    counts = support_force_bklt.shape[1:3]
    nodes = [evenly_picked(len(axis), count) for axis, count in zip((thickness_m, tension), counts, strict=True)]
    even_klt = force_tpd[np.ix_(*nodes, np.arange(1, tips))]
    ratio_bklt = np.insert(support_force_bklt[..., 1:] / even_klt, RIGHT_ANGLE, 1.0, axis=0)
    angles = np.radians(np.insert(SUPPORTS_DEG, RIGHT_ANGLE, 90.0))
    polar_rad = np.radians(np.linspace(0.0, LARGEST_POLAR_DEG, POLAR_ANGLES))
    around = np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    factor_aklt = np.stack([_factor(angles, ratio_bklt, base_angle(float(polar), around)) for polar in polar_rad])
    for axis, (values, known) in enumerate(zip((thickness_m, tension), nodes, strict=True), start=1):
        moved = np.moveaxis(factor_aklt, axis, 0)
        factor_aklt = np.moveaxis(_along(np.log(values[known]), moved, np.log(values)), 0, axis)
    # The ratio has a limit at no dent, and stays as it is beyond the last tip.
    column = np.clip(np.arange(len(tip_m)) - 1, 0, tips - 2)
    return polar_rad, np.ascontiguousarray(factor_aklt[..., column])


def _factor(angles: Floats, ratio_bklt: Floats, base_rad: Floats) -> Floats:
    """Return the factor (k, l, t) of a contact whose base lies so far away around it.

    The outermost supports, which deep dents run into, would make the spline between the others swing: they count where
    they are needed.
    """
    inner = angles[1] <= base_rad.min() and base_rad.max() <= angles[-2]
    near = slice(1, -1) if inner else slice(None)
    factor: Floats = 1.0 + SHARE * (_along(angles[near], ratio_bklt[near], base_rad).mean(axis=0) - 1.0)
    return factor


def _along(nodes: Floats, values: Floats, places: Floats) -> Floats:
    """Interpolate along the first axis."""
    spline = CubicSpline(nodes)
    first, weights = spline.weights(np.clip(places, nodes[0], nodes[-1]))
    near = spline.coefficients(values)[first[:, None] + np.arange(SUPPORT)]
    found: Floats = np.einsum("sk,sk...->s...", weights, near)
    return found
