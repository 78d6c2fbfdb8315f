"""The energy and the stress of tissue that stiffens, straight from the law."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.material import lame_constants

NU = 0.45
LAMBDA, MU = lame_constants(1.0, NU)
STEP = 1e-30  # of a complex step: its square is lost


def energy(F: NDArray, b: float) -> NDArray:
    """W of matrices (..., 3, 3), real or complex: the definition, with expm1 for small b."""
    log_J = np.log(np.linalg.det(F))
    Q = np.sum(F**2, axis=(-2, -1)) - 3.0 - 2.0 * log_J + LAMBDA / MU * log_J**2
    return MU / (2.0 * b) * np.expm1(b * Q)


def stress(F: NDArray, b: float) -> NDArray:
    """P of matrices (..., 3, 3), real or complex."""
    log_J = np.log(np.linalg.det(F))[..., None, None]
    turned = np.linalg.inv(F).swapaxes(-1, -2)
    Q = np.sum(F**2, axis=(-2, -1))[..., None, None] - 3.0 - 2.0 * log_J + LAMBDA / MU * log_J**2
    return np.exp(b * Q) * (MU * (F - turned) + LAMBDA * log_J * turned)
