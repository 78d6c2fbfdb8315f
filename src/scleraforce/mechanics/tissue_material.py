"""The wall's material: Hooke's constants, tissue that stiffens or relaxes, and the
pressure that bursts a thin sphere.

The stiffening is an exponential of the neo-Hookean energy, whose modulus rises with
strain. With one more parameter b, which has no unit,

    W = mu/(2 b) (exp(b Q) - 1)        Q = I1 - 3 - 2 ln J + (lambda/mu) (ln J)^2

mu Q/2 is the energy of the neo-Hookean solid, which W becomes for b -> 0; b does not
matter at small strains. So first Piola-Kirchhoff stress and elasticity have the
neo-Hookean P0 and A0, and a term of rank one:

    P = exp(b Q) P0        A = exp(b Q) (A0 + (2 b/mu) P0 (x) P0)

and nothing is divided by b. Sources: Fung, Am. J. Physiol. 213, 1967, 1532 (an
exponential in simple elongation); Demiray, J. Biomech. 5, 1972, 309 (the same of I1 -
3, incompressible). Here Q includes the volume, so that b leaves Poisson's ratio
unchanged at every strain.

Tissue relaxes by quasi-linear viscoelasticity: the shape at a time is that of an
elastic force Fe(t); the sensor feels

    F(t) = Fe(t) - sum g_i m_i(t),    dm_i/dt = (Fe - m_i) / tau_i,

which is the convolution of dFe/dt with G(t) = 1 - sum g_i (1 - exp(-t / tau_i)).
Source: Fung, Biomechanics: Mechanical Properties of Living Tissues, sec. 7.6; the exact
update: Simo and Hughes, Computational Inelasticity, sec. 10.3. Between samples Fe is a
straight line; the update of m_i is exact for that. A needle that has lost contact
leaves Fe = 0 and F = 0, while m_i decays. The pressure in the eye is taken to relax as
the wall does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError


def lame_constants(
    youngs_modulus_pa: float, poisson_ratio: float
) -> tuple[float, float]:
    """Return lambda and mu in Pa.

    >>> lame_constants(2.5, 0.25)
    (1.0, 1.0)
    """
    E = youngs_modulus_pa
    nu = poisson_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


# largest exponent b Q: sums of squares of such stresses are finite; no tissue is e^300
# times as stiff
LARGEST_EXPONENT = 300.0


def strain_measure(excess: Floats, log_ratio: Floats, poisson_ratio: float) -> Floats:
    """Return Q, 0 without strain, by I1 - 3 (the sum of the squared stretches less 3)
    and ln J; shapes broadcast.
    """
    lame_ratio = 2.0 * poisson_ratio / (1.0 - 2.0 * poisson_ratio)
    return excess - 2.0 * log_ratio + lame_ratio * log_ratio**2


def growth(stiffening: float, strain: Floats) -> Floats:
    """Return exp(b Q), the factor on the stress; not a number beyond b Q = 300: a step
    that goes there is too long.

    >>> growth(10.0, np.array([0.0, 0.1, 31.0])).round(3)
    array([1.   , 2.718,   nan])
    """
    exponent = stiffening * strain
    return np.exp(np.where(exponent <= LARGEST_EXPONENT, exponent, np.nan))


# largest stretch of the circumference; the limit is reached below 1.5, and below 1.8 in
# tissue that stiffens
LARGEST_STRETCH = 3.0
STRETCHES = 20_001
NEWTON_STEPS = 40


@cache
def burst_tension(poisson_ratio: float, stiffening: float = 0.0) -> float:
    """Return the largest p R/(E t) of a thin sphere of undeformed radius R and
    thickness t; infinite without a limit.

    With the stretch L along the wall and L3 across it, J = L^2 L3: the stress across
    vanishes, mu (L3^2 - 1) + lambda ln J = 0, and p R/t = 2 (mu (L^2 - 1) + lambda ln
    J)/L^3 exp(b Q) has a first maximum. With only a little stiffening, b = 0.07, there
    is no maximum: such a sphere never bursts.

    >>> round(burst_tension(0.45), 3), burst_tension(0.45, stiffening=1.0)
    (0.416, inf)
    """
    lame_lambda, mu = lame_constants(1.0, poisson_ratio)
    stretch = np.linspace(1.0, LARGEST_STRETCH, STRETCHES)[1:]
    across = 1.0 / stretch

    for _ in range(NEWTON_STEPS):
        stress = mu * (across**2 - 1.0) + lame_lambda * np.log(stretch**2 * across)
        across = np.maximum(
            across - stress / (2.0 * mu * across + lame_lambda / across), 1e-3
        )

    log_ratio = np.log(stretch**2 * across)
    tension = 2.0 * (mu * (stretch**2 - 1.0) + lame_lambda * log_ratio) / stretch**3
    exponent = stiffening * strain_measure(
        2.0 * stretch**2 + across**2 - 3.0, log_ratio, poisson_ratio
    )
    # the logarithm does not overflow
    falling = np.flatnonzero(np.diff(exponent + np.log(tension)) < 0.0)

    return (
        float(tension[falling[0]] * np.exp(exponent[falling[0]]))
        if len(falling)
        else float("inf")
    )


@dataclass(frozen=True)
class PronySeries:
    """A relaxation function G: the share g_i of the force that is lost with the time
    constant tau_i, for each term.
    """

    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shares) != len(self.times_s):
            raise InputError(
                f"relaxation: {len(self.shares)} shares, {len(self.times_s)} times;"
                " give one time a share"
            )
        if (
            not all(0.0 <= share < 1.0 for share in self.shares)
            or not sum(self.shares) < 1.0
        ):
            raise InputError(
                f"relaxation: shares {self.shares}; each must be 0 or more, their sum"
                " below 1"
            )
        if not all(0.0 < time_s < np.inf for time_s in self.times_s):
            raise InputError(
                f"relaxation: times {self.times_s} s; must be above 0 and finite"
            )

    @property
    def terms(self) -> list[tuple[float, float]]:
        """Each share with its time constant in s, as files have them."""
        return list(zip(self.shares, self.times_s, strict=True))

    def left(self, held_s: Floats) -> Floats:
        """Return G, the share of a step's force that is left after each hold, shape of
        `held_s`.
        """
        lost = -np.expm1(-held_s[..., None] / np.array(self.times_s))
        return np.asarray(1.0 - lost @ np.array(self.shares), dtype=np.float64)

    def felt_along(
        self, corners_s: Sequence[float], elastic_n: Sequence[float], time_s: Floats
    ) -> Floats:
        """Return F at any times, shape of `time_s`, of an Fe that is straight between
        corners and constant beyond.

        The tissue is at rest before the first corner, where Fe is 0. Contact is not
        looked at: F may be below 0.
        """
        length_s = np.diff(corners_s)
        slopes = np.divide(
            np.diff(elastic_n),
            length_s,
            out=np.zeros_like(length_s),
            where=length_s > 0.0,
        )
        felt_n = np.zeros_like(time_s)

        for corner_s, change in zip(
            corners_s, np.diff(slopes, prepend=0.0, append=0.0), strict=True
        ):
            since_s = np.maximum(time_s - corner_s, 0.0)
            lost_s = sum(
                share * (since_s + tau_s * np.expm1(-since_s / tau_s))
                for share, tau_s in zip(self.shares, self.times_s, strict=True)
            )
            felt_n += change * (since_s - lost_s)

        return felt_n


ELASTIC = PronySeries((), ())


def line_weights(step_s: Floats, times_s: Sequence[float]) -> Floats:
    """Return the weights of Fe before a step, of m_i before it and of Fe after it,
    (step, 3, term); they add up to 1.

    With x = step / tau and q = (1 - exp(-x)) / x, they are q - exp(-x), exp(-x) and 1 -
    q.
    """
    x = step_s[:, None] / np.array(times_s)
    kept = np.exp(-x)
    short = x < 1e-3  # where 1 - q loses digits; the series' next term is x^4 / 120
    safe = np.where(short, 1.0, x)
    new = np.where(
        short, x * (1 / 2 - x * (1 / 6 - x / 24)), 1.0 + np.expm1(-safe) / safe
    )

    return np.stack([1.0 - kept - new, kept, new], axis=1)
