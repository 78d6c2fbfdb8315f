"""The energy and the stress of tissue that stiffens, straight from the law; a thick
sphere under pressure.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from scleraforce.mechanics.tissue_material import lame_constants

NU = 0.45
LAMBDA, MU = lame_constants(1.0, NU)
STEP = 1e-30  # of a complex step: its square is lost


def energy(F: NDArray, b: float) -> NDArray:
    """W of matrices (..., 3, 3), real or complex: the definition, with expm1 for small
    b.
    """
    log_J = np.log(np.linalg.det(F))
    Q = np.sum(F**2, axis=(-2, -1)) - 3.0 - 2.0 * log_J + LAMBDA / MU * log_J**2
    return MU / (2.0 * b) * np.expm1(b * Q)


def stress(F: NDArray, b: float) -> NDArray:
    """P of matrices (..., 3, 3), real or complex."""
    log_J = np.log(np.linalg.det(F))[..., None, None]
    turned = np.linalg.inv(F).swapaxes(-1, -2)
    Q = (
        np.sum(F**2, axis=(-2, -1))[..., None, None]
        - 3.0
        - 2.0 * log_J
        + LAMBDA / MU * log_J**2
    )

    return np.exp(b * Q) * (MU * (F - turned) + LAMBDA * log_J * turned)


def radial_displacement(
    inner_m: float, outer_m: float, pressure: float, at_r: np.ndarray
) -> np.ndarray:
    """Displacement of a thick neo-Hookean sphere under pressure p/E: P_rr' + 2 (P_rr -
    P_tt) / r = 0, by shooting.
    """

    def nominal(own: float, along: float, across: float) -> float:
        return MU * (own - 1 / own) + LAMBDA * np.log(along * across**2) / own

    def slope(r: float, y: np.ndarray) -> list[float]:
        along = y[1]
        across = y[0] / r
        by_along = (
            MU * (1 + 1 / along**2)
            + LAMBDA * (1 - np.log(along * across**2)) / along**2
        )
        by_across = 2 * LAMBDA / (along * across)
        difference = nominal(along, along, across) - nominal(across, along, across)

        return [
            along,
            -(2 * difference + by_across * (along - across)) / (r * by_along),
        ]

    def shot(stretch: float):
        along = brentq(
            lambda s: nominal(s, s, stretch) + pressure * stretch**2,
            0.05,
            2.0,
            xtol=1e-14,
        )
        start = [stretch * inner_m, along]

        return solve_ivp(
            slope, (inner_m, outer_m), start, rtol=1e-11, atol=1e-14, dense_output=True
        )

    def traction(stretch: float) -> float:
        r, along = shot(stretch).y[:, -1]
        return nominal(along, along, r / outer_m)

    return shot(brentq(traction, 1.0, 1.6, xtol=1e-13)).sol(at_r)[0] - at_r
