"""The unknowns of a fit, and the steps that their derivatives are taken over."""

import numpy as np

from scleraforce.fitting.resting_form import FORMS

# (unknown,): dent and pose in m and rad; logarithms of the eye's size over the library's, of E
# in Pa and of the IOP without the needle in Pa; an offset of the inner boundary in m, which the segmentation may see a
# little too deep; the logarithm of the pressure under the needle in Pa, which counts where the globe may be sealed; by
# how much the segmentation sees the outer boundary too high where that faces the light (`fit_prediction.shining`), in
# m; the form at rest (`resting_form.FORMS`), in m; and where the pole lies, along the section and across it
# (`base_bulge.pole_direction`).
NAMES = (
    "tip_m", "lateral_m", "depth_m", "rotation_rad", "gap_m", "thickness_m", "log_modulus", "log_iop", "log_size",
    "inner_m", "log_pressure", "shine_m", *FORMS, "pole_along", "pole_across",
)  # fmt: skip
TIP, LATERAL, DEPTH, ROTATION, GAP, THICKNESS, MODULUS, IOP, SIZE, INNER_OFFSET, PRESSURE, SHINE = range(12)
FORM = slice(SHINE + 1, SHINE + 1 + len(FORMS))
POLE = slice(FORM.stop, len(NAMES))

TIP_STEP_M, GAP_STEP_M, THICKNESS_STEP_M, LOG_PRESSURE_STEP = 20e-6, 10e-6, 5e-6, 0.02
POLE_STEP = 5e-3
SHINING_SLOPE = 0.115  # at which the surface's mirror reflection moves its edge 1/e as far as where it faces the light
# Of a wall and what it is compared to, by each of these steps: whose curves, whose motion under the pressure they have.
SAME_CURVES_AND_MOTION = np.array([[0, 1, 0, 3, 4, 0, 0], [0, 0, 0, 3, 4, 5, 6]])
