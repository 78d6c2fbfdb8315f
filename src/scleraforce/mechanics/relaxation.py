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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError

Floats = NDArray[np.float64]


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

    def felt(self, elastic_n: Floats, time_s: Floats) -> Floats:
        """Return F at each sample, (samples,), from Fe; the tissue is at rest before the first sample, Fe starts there.

        Where Fe is 0 or the wall no longer pushes back (F would be below 0), contact is lost.
        """
        memory, felt_n = np.zeros(len(self.shares)), np.zeros_like(elastic_n)
        for index, (old, kept, new) in enumerate(self._weights(time_s)):
            before_n = elastic_n[index - 1] if index and felt_n[index - 1] > 0.0 else 0.0
            come = kept * memory + old * before_n
            felt_n[index] = max(elastic_n[index] - self.shares @ (come + new * elastic_n[index]), 0.0)
            memory = come + new * (elastic_n[index] if felt_n[index] > 0.0 else 0.0)
        return felt_n

    def elastic(self, felt_n: Floats, time_s: Floats, contact: NDArray[np.bool_]) -> Floats:
        """Return Fe at each sample, (samples,), from F: the inverse of `felt`. Fe is 0 where `contact` is False."""
        memory, elastic_n = np.zeros(len(self.shares)), np.zeros_like(felt_n)
        for index, (old, kept, new) in enumerate(self._weights(time_s)):
            come = kept * memory + old * (elastic_n[index - 1] if index else 0.0)
            if contact[index]:
                elastic_n[index] = (felt_n[index] + self.shares @ come) / (1.0 - self.shares @ new)
            memory = come + new * elastic_n[index]
        return elastic_n

    def _weights(self, time_s: Floats) -> Floats:
        """Return the weights of an update to each sample, (sample, 3, term); nothing passes before the first."""
        return line_weights(np.diff(time_s, prepend=time_s[:1]), self.times_s)


ELASTIC = PronySeries((), ())


class Memory(NamedTuple):
    """Bounds of each m_i, (terms,), in N. They do not depend on the shares g_i."""

    smallest_n: Floats
    largest_n: Floats

    def felt(self, elastic_n: tuple[float, float], shares: tuple[Floats, Floats]) -> tuple[float, float]:
        """Return the bounds of F from the bounds of Fe and of each g_i, (terms,); not below 0."""
        low_n = elastic_n[0] - float(shares[1] @ self.largest_n)
        return max(low_n, 0.0), max(elastic_n[1] - float(shares[0] @ self.smallest_n), 0.0)


def unknown_memory(terms: int, largest_n: float) -> Memory:
    """Return the bounds of an unknown history in which Fe was never above `largest_n`."""
    return Memory(np.zeros(terms), np.full(terms, largest_n))


def after_gap(memory: Memory, gap_s: float, elastic_n: tuple[float, float], times_s: tuple[float, ...]) -> Memory:
    """Return the bounds after a gap in which Fe was anywhere between two bounds; a constant Fe reaches each."""
    kept = np.exp(-gap_s / np.array(times_s))
    smallest_n, largest_n = (
        kept * old + (1.0 - kept) * extreme for old, extreme in zip(memory, elastic_n, strict=True)
    )
    return Memory(smallest_n, largest_n)


def after_line(
    memory: Memory,
    step_s: float,
    elastic_n: tuple[float, float],
    now_n: tuple[float, float],
    times_s: tuple[float, ...],
) -> Memory:
    """Return the bounds after a step in which Fe changed linearly, from bounds before it to bounds after it."""
    old, kept, new = line_weights(np.array([step_s]), times_s)[0]
    smallest_n, largest_n = (
        kept * come + old * before + new * now for come, before, now in zip(memory, elastic_n, now_n, strict=True)
    )
    return Memory(smallest_n, largest_n)


def line_weights(step_s: Floats, times_s: tuple[float, ...]) -> Floats:
    """Return the weights of Fe before a step, of m_i before it and of Fe after it, (step, 3, term); they add up to 1.

    With x = step / tau and q = (1 - exp(-x)) / x, they are q - exp(-x), exp(-x) and 1 - q.
    """
    x = step_s[:, None] / np.array(times_s)
    kept = np.exp(-x)
    short = x < 1e-3  # where 1 - q loses digits; the series' next term is x^4 / 120
    safe = np.where(short, 1.0, x)
    new = np.where(short, x * (1 / 2 - x * (1 / 6 - x / 24)), 1.0 + np.expm1(-safe) / safe)
    return np.stack([1.0 - kept - new, kept, new], axis=1)
