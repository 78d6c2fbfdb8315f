"""The unknowns of a fit, the steps of their derivatives, and the form at rest of a wall
that is not an even sphere.

To either side of the contact lies a limbus, at which the surface turns by an angle and
from which on it curves otherwise: the cornea, or the flat side of an ellipsoid. And the
wall may grow thicker along the section. Of an even sphere angles, curvatures and
thickening are 0, and the places of the limbus do not matter.
"""

import numpy as np

from scleraforce.base.arrays import Floats, Number
from scleraforce.base.compiled_loops import compiled_in_place

# Of each side, left and right: place of the limbus from the contact, m; the angle
# there, rad, up below 0; the curvature beyond, 1/m. Then how the thickness grows along
# the section, m/m.
FORMS = (
    "left_limbus_m",
    "left_angle_rad",
    "left_curvature",
    "right_limbus_m",
    "right_angle_rad",
    "right_curvature",
    "wedge",
)
# Least and largest of them. A limbus turns up: the cornea bulges.
FORM_ENDS = np.array(
    [
        [1.5e-3, -0.5, -20.0, 1.5e-3, -0.5, -20.0, -0.05],
        [7e-3, 0.01, 60.0, 7e-3, 0.01, 60.0, 0.05],
    ]
)
SOFT_M = 0.4e-3  # the limbus is a smooth furrow


@compiled_in_place
def furrow(beyond_m: float) -> tuple[float, float]:
    """Return how far a place lies beyond a limbus, a smooth furrow, and the slope of
    that.
    """
    root = np.sqrt(beyond_m**2 + SOFT_M**2)
    return 0.5 * (beyond_m + root), 0.5 * (1.0 + beyond_m / root)


@compiled_in_place
def form_at(
    form: Floats, from_contact_m: float, is_inner: float
) -> tuple[float, float]:
    """Return the contribution of a form (7,) to the depth, m, and the slope.

    `from_contact_m`: lateral distance from the contact; `is_inner`: 1 on the inner
    boundary, 0 on the outer.
    """
    depth = form[6] * from_contact_m * is_inner
    slope = form[6] * is_inner

    for side, first in ((-1.0, 0), (1.0, 3)):
        angle = form[first + 1]
        curvature = form[first + 2]
        ramp, rise = furrow(side * from_contact_m - form[first])
        depth += (angle + 0.5 * curvature * ramp) * ramp
        slope += side * (angle + curvature * ramp) * rise

    return depth, slope


# (unknown,): dent and pose in m and rad; logarithms of the eye's size over the
# library's, of E in Pa and of the IOP without the needle in Pa; an offset of the inner
# boundary in m, which the segmentation may see a little too deep; the logarithm of the
# pressure under the needle in Pa, which counts where the globe may be sealed; by how
# much the segmentation sees the outer boundary too high where that faces the light
# (`shining`), in m; the form at rest (`unknowns.FORMS`), in m; and where the pole lies,
# along the section and across it (`moving_base.pole_directions`).
NAMES = (
    "tip_m",
    "lateral_m",
    "depth_m",
    "rotation_rad",
    "gap_m",
    "thickness_m",
    "log_modulus",
    "log_iop",
    "log_size",
    "inner_m",
    "log_pressure",
    "shine_m",
    *FORMS,
    "pole_along",
    "pole_across",
)
(
    TIP,
    LATERAL,
    DEPTH,
    ROTATION,
    GAP,
    THICKNESS,
    MODULUS,
    IOP,
    SIZE,
    INNER_OFFSET,
    PRESSURE,
    SHINE,
) = range(12)
FORM = slice(SHINE + 1, SHINE + 1 + len(FORMS))
POLE = slice(FORM.stop, len(NAMES))

TIP_STEP_M = 20e-6
GAP_STEP_M = 10e-6
THICKNESS_STEP_M = 5e-6
LOG_PRESSURE_STEP = 0.02
POLE_STEP = 5e-3
# slope at which the mirror reflection moves the surface's edge 1/e as far as where it
# faces the light
SHINING_SLOPE = 0.115


def shining(slope: Number) -> Number:
    """Return the shift of the edge by the mirror reflection, over that of a surface
    that faces the light.

    `fit.shown_wall` compiles it.
    """
    shift: Number = np.exp(-((slope / SHINING_SLOPE) ** 2))
    return shift
