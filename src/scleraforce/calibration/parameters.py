"""Uncertain parameters: their prior, and the change of variable that keeps them positive.

The filter works on coordinates that are Gaussian. A positive parameter is lognormal: its coordinate is
ln(value / unit), with the moments matched to the prior that is asked for. Unchanged (the paper's choice), the
coordinate is value / unit; the unit, the prior's mean, only keeps the coordinates of order one.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One uncertain parameter: its name, the mean and standard deviation of its prior (SI).

    `positive`: it is lognormal. `either_sign`: there are eyes also where it is not above 0.
    """

    name: str
    _: KW_ONLY
    mean: float
    sd: float
    positive: bool = True
    either_sign: bool = False

    def __post_init__(self) -> None:
        if not (self.sd > 0 and self.mean != 0 and (self.mean > 0 or not self.positive)):
            raise ValueError(f"{self.name}: a prior needs a mean that is not zero and a positive standard deviation")


@dataclass(frozen=True)
class ParameterSpace:
    """The uncertain parameters of a filter, in their order.

    >>> space = ParameterSpace((Parameter("youngs_modulus_pa", mean=0.49e6, sd=0.34e6),))
    >>> mean, covariance = space.prior()
    >>> [round(float(v[0])) for v in space.moments(mean, covariance)]
    [490000, 340000]
    """

    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(entry.name for entry in self.parameters)

    def prior(self) -> tuple[Vector, Vector]:
        """Return mean (p,) and covariance (p, p) of the prior in the filter's coordinates."""
        means, variances = [], []
        for entry in self.parameters:
            ratio = (entry.sd / entry.mean) ** 2
            means.append(-log(1 + ratio) / 2 if entry.positive else 1.0)
            variances.append(log(1 + ratio) if entry.positive else ratio)
        return np.array(means), np.diag(variances)

    def values(self, coordinates: Vector) -> Vector:
        """Return the parameters (..., p) in SI for coordinates (..., p)."""
        scaled = np.where(self._positive, np.exp(np.where(self._positive, coordinates, 0.0)), coordinates)
        return scaled * self._units

    def exist(self, values: Vector) -> NDArray[np.bool_]:
        """Return for which rows of values (..., p), SI, there is such an eye."""
        free = np.array([entry.either_sign for entry in self.parameters])
        return np.asarray((np.isfinite(values) & ((values > 0) | free)).all(axis=-1))

    def moments(self, mean: Vector, covariance: Vector) -> tuple[Vector, Vector]:
        """Return means (p,) and standard deviations (p,) in SI of coordinates with the given Gaussian."""
        variance = np.diag(covariance)
        lognormal_mean = np.exp(np.where(self._positive, mean + variance / 2, 0.0))
        lognormal_sd = lognormal_mean * np.sqrt(np.expm1(np.where(self._positive, variance, 0.0)))
        means = np.where(self._positive, lognormal_mean, mean)
        sds = np.where(self._positive, lognormal_sd, np.sqrt(variance))
        return means * self._units, sds * np.abs(self._units)

    def interval(self, mean: Vector, covariance: Vector, sds: float) -> tuple[Vector, Vector]:
        """Return the ends (p,), in SI, of the band of `sds` standard deviations about the coordinates' mean."""
        half = sds * np.sqrt(np.diag(covariance))
        return self.values(mean - half), self.values(mean + half)

    @property
    def _positive(self) -> NDArray[np.bool_]:
        return np.array([entry.positive for entry in self.parameters])

    @property
    def _units(self) -> Vector:
        return np.array([entry.mean for entry in self.parameters])


def spread(values: Sequence[float]) -> tuple[float, float | None]:
    """Return mean and sample standard deviation; a single value says nothing of a spread: None."""
    mean = sum(values) / len(values)
    return mean, sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1)) if len(values) > 1 else None
