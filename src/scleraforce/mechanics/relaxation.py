"""Tissue that relaxes: the force that a sensor feels, from the elastic force that the wall's shape shows, and back.

Quasi-linear viscoelasticity: the shape at a time is that of an elastic force Fe(t), and the sensor feels

    F(t) = Fe(t) - sum g_i m_i(t),    dm_i/dt = (Fe - m_i) / tau_i,

which is the convolution of dFe/dt with G(t) = 1 - sum g_i (1 - exp(-t / tau_i)). Source: Fung, Biomechanics: Mechanical
Properties of Living Tissues, sec. 7.6; the exact update: Simo and Hughes, Computational Inelasticity, sec. 10.3.
Between samples Fe is a straight line; the update of m_i is exact for that. A needle that has lost contact leaves Fe = 0
and F = 0, while m_i decays. The pressure in the eye is taken to relax as the wall does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scleraforce.arrays import Flags, Floats
from scleraforce.errors import InputError


@dataclass(frozen=True)
class PronySeries:
    """A relaxation function G: the share g_i of the force that is lost with the time constant tau_i, for each term."""

    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shares) != len(self.times_s):
            raise InputError(f"relaxation: {len(self.shares)} shares, {len(self.times_s)} times; give one time a share")
        if not all(0.0 <= share < 1.0 for share in self.shares) or not sum(self.shares) < 1.0:
            raise InputError(f"relaxation: shares {self.shares}; each must be 0 or more, their sum below 1")
        if not all(0.0 < time_s < np.inf for time_s in self.times_s):
            raise InputError(f"relaxation: times {self.times_s} s; must be above 0 and finite")

    @property
    def terms(self) -> list[tuple[float, float]]:
        """Each share with its time constant in s, as files have them."""
        return list(zip(self.shares, self.times_s, strict=True))

    def left(self, held_s: Floats) -> Floats:
        """Return G, the share of a step's force that is left after each hold, shape of `held_s`."""
        lost = -np.expm1(-held_s[..., None] / np.array(self.times_s))
        return np.asarray(1.0 - lost @ np.array(self.shares), dtype=np.float64)

    def felt_along(self, corners_s: Sequence[float], elastic_n: Sequence[float], time_s: Floats) -> Floats:
        """Return F at any times, shape of `time_s`, of an Fe that is straight between corners and constant beyond.

        The tissue is at rest before the first corner, where Fe is 0. Contact is not looked at: F may be below 0.
        """
        length_s = np.diff(corners_s)
        slopes = np.divide(np.diff(elastic_n), length_s, out=np.zeros_like(length_s), where=length_s > 0.0)
        felt_n = np.zeros_like(time_s)
        for corner_s, change in zip(corners_s, np.diff(slopes, prepend=0.0, append=0.0), strict=True):
            since_s = np.maximum(time_s - corner_s, 0.0)
            lost_s = sum(
                share * (since_s + tau_s * np.expm1(-since_s / tau_s))
                for share, tau_s in zip(self.shares, self.times_s, strict=True)
            )
            felt_n += change * (since_s - lost_s)
        return felt_n


ELASTIC = PronySeries((), ())


def driven_back(
    felt_n: Floats, time_s: Floats, contact: Flags, shares: Floats, times_s: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return Fe (candidate, sample) and every m_i (candidate, sample, term) from F (sample,), at rest before it.

    `shares` (candidate, term). Fe is 0 where `contact` is False: nothing pulls there.
    """
    memory, elastic_n = np.zeros(shares.shape), np.zeros(len(shares))
    found_n, memories_n = np.zeros((len(shares), len(felt_n))), np.zeros((len(shares), len(felt_n), len(times_s)))
    for index, (old, kept, new) in enumerate(line_weights(np.diff(time_s, prepend=time_s[:1]), times_s)):
        come = kept * memory + old * elastic_n[:, None]
        lag_n = (shares * come).sum(axis=1)
        elastic_n = (felt_n[index] + lag_n) / (1.0 - shares @ new) if contact[index] else np.zeros(len(shares))
        memory = come + new * elastic_n[:, None]
        found_n[:, index], memories_n[:, index] = elastic_n, memory
    return found_n, memories_n


def line_weights(step_s: Floats, times_s: Sequence[float]) -> Floats:
    """Return the weights of Fe before a step, of m_i before it and of Fe after it, (step, 3, term); they add up to 1.

    With x = step / tau and q = (1 - exp(-x)) / x, they are q - exp(-x), exp(-x) and 1 - q.
    """
    x = step_s[:, None] / np.array(times_s)
    kept = np.exp(-x)
    short = x < 1e-3  # where 1 - q loses digits; the series' next term is x^4 / 120
    safe = np.where(short, 1.0, x)
    new = np.where(short, x * (1 / 2 - x * (1 / 6 - x / 24)), 1.0 + np.expm1(-safe) / safe)
    return np.stack([1.0 - kept - new, kept, new], axis=1)
