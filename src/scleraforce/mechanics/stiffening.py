"""Tissue that stiffens: an exponential of the neo-Hookean energy, whose modulus rises with strain.

With one more parameter b, the stiffening, which has no unit,

    W = mu/(2 b) (exp(b Q) - 1)        Q = I1 - 3 - 2 ln J + (lambda/mu) (ln J)^2

mu Q/2 is the energy of the neo-Hookean solid, which W becomes for b -> 0; small strains know nothing of b. So first
Piola-Kirchhoff stress and elasticity are those of the neo-Hookean solid, P0 and A0, and a term of rank one:

    P = exp(b Q) P0        A = exp(b Q) (A0 + (2 b/mu) P0 (x) P0)

and nothing is divided by b. Sources: Fung, Am. J. Physiol. 213, 1967, 1532 (an exponential in simple elongation);
Demiray, J. Biomech. 5, 1972, 309 (the same of I1 - 3, incompressible). Here Q holds the volume, too, so that b leaves
Poisson's ratio of every strain as it is without.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LARGEST_EXPONENT = 300.0  # of b Q: sums of squares of such stresses are finite; no tissue is e^300 times as stiff


def strain_measure(excess: Floats, log_ratio: Floats, poisson_ratio: float) -> Floats:
    """Return Q, 0 without strain; shapes broadcast.

    Args:
        excess: I1 - 3, the sum of the squared stretches less 3.
        log_ratio: ln J.
        poisson_ratio: nu; lambda/mu = 2 nu/(1 - 2 nu).
    """
    lame_ratio = 2.0 * poisson_ratio / (1.0 - 2.0 * poisson_ratio)
    return excess - 2.0 * log_ratio + lame_ratio * log_ratio**2


def growth(stiffening: float, strain: Floats) -> Floats:
    """Return exp(b Q), the factor on the stress; not a number beyond b Q = 300: a step that goes there is too long.

    >>> growth(10.0, np.array([0.0, 0.1, 31.0])).round(3)
    array([1.   , 2.718,   nan])
    """
    exponent = stiffening * strain
    return np.exp(np.where(exponent <= LARGEST_EXPONENT, exponent, np.nan))
