"""Porcine sclera below a 5 mm flat punch: which Young's modulus has the measured
stiffness.

Leung et al., Invest. Ophthalmol. Vis. Sci. 55, 2014, 3721: 15 eyes ex vivo at 15 mmHg,
0.13 +- 0.02 N/mm; radius of curvature 7.86 +- 0.49 mm, thickness 1.03 +- 0.14 mm; 0.20
+- 0.04 MPa by shell theory.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from real_tissue.punch import Pushed, flat_punch_path
from real_tissue.shells import shallow
from real_tissue.walls import bonded_stiffness, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.units import to_si
from scleraforce.records.globe import CONSTANT_PRESSURE, sealed_law

Floats = NDArray[np.float64]

STIFFNESS_N_M = 130.0
IOP_PA = to_si(15.0, "mmhg")
# where paths are computed; between them slopes are interpolated
MODULI_PA = (0.1e6, 0.15e6, 0.2e6, 0.3e6, 0.4e6)
DENTS_M = np.linspace(0.1e-3, 1.1e-3, 11)


@dataclass(frozen=True)
class PunchedEye:
    """Sizes in m, and nu. `symmetric`: a whole sphere between two punches."""

    radius_m: float = 7.86e-3
    thickness_m: float = 1.03e-3
    punch_m: float = 2.5e-3
    poisson_ratio: float = 0.45
    symmetric: bool = False


SIZE = PunchedEye()


def modulus_by_shell_theory(stiffness_n_m: float, size: PunchedEye = SIZE) -> float:
    """Return E, Pa, by the shallow shell without pressure, uniformly pressed over the
    punch's disc.
    """
    middle_m = size.radius_m - 0.5 * size.thickness_m
    return stiffness_n_m / shallow(
        size.thickness_m, middle_m, 0.0, size.punch_m, size.poisson_ratio
    )


def small_load_modulus(
    *, bonded: bool, iop_pa: float = IOP_PA, size: PunchedEye = SIZE
) -> float:
    """Return E, Pa, of the measured stiffness for small loads: uniform over the disc,
    or a rigid disc bonded to it.
    """
    mesh = fine_meridian(
        size.radius_m, size.thickness_m, size.punch_m, inside=12, outside=40
    )
    wall = disc_wall(mesh, size.punch_m, size.poisson_ratio, symmetric=False)

    def missing(log_modulus: float) -> float:
        pressure = iop_pa / np.exp(log_modulus)
        found = (
            bonded_stiffness(wall, pressure, size.punch_m)
            if bonded
            else pressed_wall(wall, pressure).outer_stiffness_m
        )

        return float(log_modulus + np.log(found / STIFFNESS_N_M))

    return float(np.exp(brentq(missing, np.log(0.05e6), np.log(1e6), xtol=1e-6)))


def pushed(
    modulus_pa: float,
    rigidity: float = 0.0,
    *,
    iop_pa: float = IOP_PA,
    size: PunchedEye = SIZE,
    dents_m: Floats = DENTS_M,
) -> Pushed:
    """Return the path below the punch of a globe of rigidity k, mmHg^(1/3)/ul; 0 is
    open.
    """
    globe = (
        sealed_law(to_si(rigidity, "mmhg13_per_ul")).over(modulus_pa)
        if rigidity
        else CONSTANT_PRESSURE
    )
    return flat_punch_path(
        size.radius_m,
        size.thickness_m,
        size.poisson_ratio,
        size.punch_m,
        iop_pa / modulus_pa,
        dents_m,
        symmetric=size.symmetric,
        globe=globe,
    )


def modulus_of_slope(
    paths: dict[float, Pushed], dent_m: float, stiffness_n_m: float = STIFFNESS_N_M
) -> float | None:
    """Return E, Pa, whose path has the measured slope at a dent; None if no E among the
    paths' has it.

    Args:
        paths: for each modulus, Pa, ascending; paths that end before the dent are left
            out.
        dent_m: one of the dents of the paths.
        stiffness_n_m: the measured one.
    """
    slopes = {
        modulus: modulus * float(np.interp(dent_m, path.dent_m, path.slope_m()))
        for modulus, path in paths.items()
        if path.dent_m[-1] >= dent_m * (1.0 + 1e-9)
    }
    if len(slopes) < 2 or not min(slopes.values()) < stiffness_n_m < max(
        slopes.values()
    ):
        return None

    moduli = np.array(list(slopes))
    values = np.array(list(slopes.values()))
    rising = np.flatnonzero(np.diff(values) <= 0.0)
    start = 0 if len(rising) == 0 else int(rising[-1]) + 1

    return float(
        np.exp(PchipInterpolator(values[start:], np.log(moduli[start:]))(stiffness_n_m))
    )
