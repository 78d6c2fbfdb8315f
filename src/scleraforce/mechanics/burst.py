"""The pressure at which a thin sphere of the wall's material bursts: no equilibrium holds more (NumPy only)."""

from functools import cache

import numpy as np

from scleraforce.mechanics.elasticity import lame_constants
from scleraforce.mechanics.stiffening import strain_measure

LARGEST_STRETCH = 3.0  # of the circumference; the limit is reached below 1.5, and below 1.8 in tissue that stiffens
STRETCHES = 20_001
NEWTON_STEPS = 40


@cache
def burst_tension(poisson_ratio: float, stiffening: float = 0.0) -> float:
    """Return the largest p R/(E t) of a thin sphere of undeformed radius R and thickness t; infinite where none is.

    With the stretch L along the wall and L3 across it, J = L^2 L3: the stress across vanishes,
    mu (L3^2 - 1) + lambda ln J = 0, and p R/t = 2 (mu (L^2 - 1) + lambda ln J)/L^3 exp(b Q) has a first maximum.
    Already a little stiffening, b = 0.07, leaves none: such a sphere never bursts.

    >>> round(burst_tension(0.45), 3), burst_tension(0.45, stiffening=1.0)
    (0.416, inf)
    """
    lame_lambda, mu = lame_constants(1.0, poisson_ratio)
    stretch = np.linspace(1.0, LARGEST_STRETCH, STRETCHES)[1:]
    across = 1.0 / stretch
    for _ in range(NEWTON_STEPS):
        stress = mu * (across**2 - 1.0) + lame_lambda * np.log(stretch**2 * across)
        across = np.maximum(across - stress / (2.0 * mu * across + lame_lambda / across), 1e-3)
    log_ratio = np.log(stretch**2 * across)
    tension = 2.0 * (mu * (stretch**2 - 1.0) + lame_lambda * log_ratio) / stretch**3
    exponent = stiffening * strain_measure(2.0 * stretch**2 + across**2 - 3.0, log_ratio, poisson_ratio)
    falling = np.flatnonzero(np.diff(exponent + np.log(tension)) < 0.0)  # the logarithm does not overflow
    return float(tension[falling[0]] * np.exp(exponent[falling[0]])) if len(falling) else float("inf")
