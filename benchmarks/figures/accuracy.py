"""How well forces and moduli are found: errors, intervals that hold, their width."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class ForceAnswer(Protocol):
    """An answer to a frame: a force and its interval in N, or None."""

    @property
    def force_n(self) -> float | None:
        """The force that was read."""

    @property
    def interval_n(self) -> tuple[float, float] | None:
        """The ends of its interval."""


@dataclass(frozen=True, eq=False)
class ReadForces:
    """Forces that were read beside the true ones, N.

    Attributes:
        true_n: (reading,).
        read_n: (reading,).
        interval_nb: lower and upper ends, (reading, 2).
    """

    true_n: Floats
    read_n: Floats
    interval_nb: Floats

    @property
    def errors_n(self) -> Floats:
        """Errors of the forces, (reading,)."""
        return self.read_n - self.true_n

    @property
    def holds(self) -> NDArray[np.bool_]:
        """Whether the interval contains the true force, (reading,)."""
        low_n, high_n = self.interval_nb.T
        return np.asarray((low_n <= self.true_n) & (self.true_n <= high_n))

    @property
    def widths_n(self) -> Floats:
        """Widths of the intervals, (reading,)."""
        low_n, high_n = self.interval_nb.T
        return np.asarray(high_n - low_n)


def read_forces(pairs: Iterable[tuple[ForceAnswer, float]]) -> ReadForces:
    """Return the forces of answers beside the true ones, N; answers without a force and
    an interval are left out.
    """
    known = [
        (true_n, answer.force_n, *answer.interval_n)
        for answer, true_n in pairs
        if answer.force_n is not None and answer.interval_n is not None
    ]
    values_nc = np.array(known).reshape(-1, 4)
    return ReadForces(values_nc[:, 0], values_nc[:, 1], values_nc[:, 2:])


def joined(parts: Sequence[ReadForces]) -> ReadForces:
    """Return several readings as one."""
    return ReadForces(
        np.concatenate([part.true_n for part in parts]),
        np.concatenate([part.read_n for part in parts]),
        np.concatenate([part.interval_nb for part in parts]),
    )


@dataclass(frozen=True, eq=False)
class FoundModuli:
    """Moduli that were found: errors and standard deviations, relative or of the
    logarithm, (eye,).
    """

    errors: Floats
    sds: Floats

    @property
    def within_two_sd(self) -> str:
        """Number of moduli within two standard deviations, of all."""
        hits = np.count_nonzero(np.abs(self.errors) < 2.0 * self.sds)
        return f"{hits} of {len(self.errors)}"


def found_moduli(pairs: Iterable[tuple[float, float]]) -> FoundModuli:
    """Return pairs of an error and a standard deviation as one record."""
    errors, sds = np.array(list(pairs)).T
    return FoundModuli(errors, sds)


def rms(values: ArrayLike) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(np.square(values))))


def percent(share: float, form: str = ".0f") -> str:
    """Return a share in percent."""
    return format(100.0 * share, form)
