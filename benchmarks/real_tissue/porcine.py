"""Porcine sclera below a 5 mm flat punch: which Young's modulus has the measured
stiffness, by loads of the whole face of the punch.

Leung et al., Invest. Ophthalmol. Vis. Sci. 55, 2014, 3721: 15 eyes ex vivo at 15 mmHg,
0.13 +- 0.02 N/mm; radius of curvature 7.86 +- 0.49 mm, thickness 1.03 +- 0.14 mm; 0.20
+- 0.04 MPa by shell theory.
"""

import numpy as np
from scipy.optimize import brentq

from real_tissue.shells import shallow
from real_tissue.walls import bonded_stiffness, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.units import to_si

STIFFNESS_N_M = 130.0
IOP_PA = to_si(15.0, "mmhg")
RADIUS_M = 7.86e-3
THICKNESS_M = 1.03e-3
PUNCH_M = 2.5e-3
NU = 0.45


def modulus_by_shell_theory(stiffness_n_m: float = STIFFNESS_N_M) -> float:
    """Return E, Pa, by the shallow shell without pressure, uniformly pressed over the
    punch's disc.
    """
    middle_m = RADIUS_M - 0.5 * THICKNESS_M
    return stiffness_n_m / shallow(THICKNESS_M, middle_m, 0.0, PUNCH_M, NU)


def small_load_modulus(*, bonded: bool, iop_pa: float = IOP_PA) -> float:
    """Return E, Pa, of the measured stiffness for small loads: uniform over the disc,
    or a rigid disc bonded to it.
    """
    mesh = fine_meridian(RADIUS_M, THICKNESS_M, PUNCH_M, inside=12, outside=40)
    wall = disc_wall(mesh, PUNCH_M, NU, symmetric=False)

    def missing(log_modulus: float) -> float:
        pressure = iop_pa / np.exp(log_modulus)
        found = (
            bonded_stiffness(wall, pressure, PUNCH_M)
            if bonded
            else pressed_wall(wall, pressure).outer_stiffness_m
        )

        return float(log_modulus + np.log(found / STIFFNESS_N_M))

    return float(np.exp(brentq(missing, np.log(0.05e6), np.log(1e6), xtol=1e-6)))
