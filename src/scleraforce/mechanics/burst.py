"""The pressure at which a thin sphere of the wall's material bursts: no equilibrium holds more (NumPy only)."""

from functools import cache

import numpy as np

from scleraforce.mechanics.elasticity import lame_constants

__all__ = ["burst_tension"]

LARGEST_STRETCH = 3.0  # of the circumference; the limit is reached below 1.5
STRETCHES = 20_001
NEWTON_STEPS = 40


@cache
def burst_tension(poisson_ratio: float) -> float:
    """Return the largest p R/(E t) of a thin neo-Hookean sphere of undeformed radius R and thickness t.

    With the stretch L along the wall and L3 across it, J = L^2 L3: the stress across vanishes,
    mu (L3^2 - 1) + lambda ln J = 0, and p R/t = 2 (mu (L^2 - 1) + lambda ln J)/L^3 has a maximum.

    >>> round(burst_tension(0.45), 3)
    0.416
    """
    lame_lambda, mu = lame_constants(1.0, poisson_ratio)
    stretch = np.linspace(1.0, LARGEST_STRETCH, STRETCHES)
    across = 1.0 / stretch
    for _ in range(NEWTON_STEPS):
        stress = mu * (across**2 - 1.0) + lame_lambda * np.log(stretch**2 * across)
        across = np.maximum(across - stress / (2.0 * mu * across + lame_lambda / across), 1e-3)
    along = mu * (stretch**2 - 1.0) + lame_lambda * np.log(stretch**2 * across)
    return float((2.0 * along / stretch**3).max())
