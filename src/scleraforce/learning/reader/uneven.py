"""Walls that are no even spheres at rest: what their form adds to the sections of a library's walls (NumPy only).

An ellipsoid curves otherwise than a sphere, and more on one side of the contact than on the other; at the limbus the
surface turns up to the cornea, which curves more (7.8 mm instead of 12); and the wall's thickness changes along the
section. This is the form at rest: it lies on the dented wall as it is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.library import INNER

Floats = NDArray[np.float64]

# Relative, of the curvature: semi-axes within 6 % of the radius (sd 3.5 %) turn it along a section by sqrt(5) as much.
CURVATURE_SD, SKEW_SD = 0.08, 0.05
CORNEA_RADIUS_M, LIMBUS_M, LIMBUS_SHARE = 7.8e-3, (2e-3, 6e-3), 0.3
# Spheres of 12 and 7.8 mm that meet at a ring of 5.5 to 6 mm radius make 0.31 to 0.35 rad; real eyes are smoother.
LIMBUS_RAD, SOFT_M = (0.05, 0.36), (0.2e-3, 0.6e-3)
# Relative, of the thickness, a radian from the contact and by the square of the angle: waves of 12 % along the globe.
WEDGE_SD, BOW_SD = 0.12, 0.12


@dataclass(frozen=True, kw_only=True)
class Forms:
    """Forms of walls, each (sample,).

    `curvature` and `skew`, 1/m: what the surface curves more, to both sides and to the right (to the left less).
    `limbus_m`: where the cornea begins, from the contact; to the left below 0, far away where it is not in view.
    `limbus_rad`: by how much the surface turns up there, softly over `soft_m`.
    `wedge` and `bow`: how the thickness grows, m a metre along the section and m a square metre.
    """

    curvature: Floats
    skew: Floats
    limbus_m: Floats
    limbus_rad: Floats
    soft_m: Floats
    wedge: Floats
    bow: Floats


def draw_forms(thickness_m: Floats, radius_m: Floats, uneven: NDArray[np.bool_], rng: np.random.Generator) -> Forms:
    """Draw forms (sample,): even spheres but for those that are to be uneven."""
    count = len(thickness_m)
    numbers = rng.standard_normal((4, count)) * uneven
    side = rng.choice([-1.0, 1.0], count)
    in_view = uneven & (rng.random(count) < LIMBUS_SHARE)
    return Forms(
        curvature=CURVATURE_SD * numbers[0] / radius_m,
        skew=SKEW_SD * numbers[1] / radius_m,
        limbus_m=side * np.where(in_view, rng.uniform(*LIMBUS_M, count), radius_m),
        limbus_rad=in_view * rng.uniform(*LIMBUS_RAD, count),
        soft_m=rng.uniform(*SOFT_M, count),
        wedge=WEDGE_SD * numbers[2] * thickness_m / radius_m,
        bow=BOW_SD * numbers[3] * thickness_m / radius_m**2,
    )


def added_depths(forms: Forms, radius_m: Floats, from_contact_m: Floats) -> Floats:
    """Return what forms add to the depths of both boundaries (sample, boundary, column), m.

    Args:
        forms: of the walls.
        radius_m: of the walls (sample,).
        from_contact_m: lateral distance from the contact (sample, column).
    """
    s = from_contact_m
    column = {name: values[:, None] for name, values in vars(forms).items()}
    outer = 0.5 * (column["curvature"] + column["skew"] * np.sign(s)) * s**2
    beyond_m = np.sign(column["limbus_m"]) * s - np.abs(column["limbus_m"])
    ramp_m = 0.5 * (beyond_m + np.sqrt(beyond_m**2 + column["soft_m"] ** 2))
    cornea = (column["limbus_rad"] > 0.0) * (1.0 / CORNEA_RADIUS_M - 1.0 / radius_m[:, None])
    outer += (0.5 * cornea * ramp_m - np.tan(column["limbus_rad"])) * ramp_m
    depths = np.repeat(outer[:, None], 2, axis=1)
    depths[:, INNER] += column["wedge"] * s + column["bow"] * s**2
    return depths
