"""The wall's material: Hooke's constants, tissue that stiffens, and the pressure at which a thin sphere bursts.

The stiffening is an exponential of the neo-Hookean energy, whose modulus rises with strain. With one more parameter b,
which has no unit,

    W = mu/(2 b) (exp(b Q) - 1)        Q = I1 - 3 - 2 ln J + (lambda/mu) (ln J)^2

mu Q/2 is the energy of the neo-Hookean solid, which W becomes for b -> 0; b does not matter at small strains. So first
Piola-Kirchhoff stress and elasticity have the neo-Hookean P0 and A0, and a term of rank one:

    P = exp(b Q) P0        A = exp(b Q) (A0 + (2 b/mu) P0 (x) P0)

and nothing is divided by b. Sources: Fung, Am. J. Physiol. 213, 1967, 1532 (an exponential in simple elongation);
Demiray, J. Biomech. 5, 1972, 309 (the same of I1 - 3, incompressible). Here Q includes the volume, so that b leaves
Poisson's ratio unchanged at every strain.
"""

from functools import cache

import numpy as np

from scleraforce.arrays import Floats


def lame_constants(youngs_modulus_pa: float, poisson_ratio: float) -> tuple[float, float]:
    """Return lambda and mu in Pa.

    >>> lame_constants(2.5, 0.25)
    (1.0, 1.0)
    """
    E, nu = youngs_modulus_pa, poisson_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


LARGEST_EXPONENT = 300.0  # of b Q: sums of squares of such stresses are finite; no tissue is e^300 times as stiff


def strain_measure(excess: Floats, log_ratio: Floats, poisson_ratio: float) -> Floats:
    """Return Q, 0 without strain, by I1 - 3 (the sum of the squared stretches less 3) and ln J; shapes broadcast."""
    lame_ratio = 2.0 * poisson_ratio / (1.0 - 2.0 * poisson_ratio)
    return excess - 2.0 * log_ratio + lame_ratio * log_ratio**2


def growth(stiffening: float, strain: Floats) -> Floats:
    """Return exp(b Q), the factor on the stress; not a number beyond b Q = 300: a step that goes there is too long.

    >>> growth(10.0, np.array([0.0, 0.1, 31.0])).round(3)
    array([1.   , 2.718,   nan])
    """
    exponent = stiffening * strain
    return np.exp(np.where(exponent <= LARGEST_EXPONENT, exponent, np.nan))


LARGEST_STRETCH = 3.0  # of the circumference; the limit is reached below 1.5, and below 1.8 in tissue that stiffens
STRETCHES = 20_001
NEWTON_STEPS = 40


@cache
def burst_tension(poisson_ratio: float, stiffening: float = 0.0) -> float:
    """Return the largest p R/(E t) of a thin sphere of undeformed radius R and thickness t; infinite without a limit.

    With the stretch L along the wall and L3 across it, J = L^2 L3: the stress across vanishes, mu (L3^2 - 1) + lambda
    ln J = 0, and p R/t = 2 (mu (L^2 - 1) + lambda ln J)/L^3 exp(b Q) has a first maximum. With only a little
    stiffening, b = 0.07, there is no maximum: such a sphere never bursts.

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
