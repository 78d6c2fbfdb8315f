"""A value that was measured on one frame, with its uncertainty; or why it could not be."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value in SI and its standard error; `at_most`: it is an upper bound."""

    value: float
    error: float
    at_most: bool = False


@dataclass(frozen=True)
class Unmeasured:
    """Why a value could not be measured."""

    reason: str


def fitted(value: float, error: float, most: float, reason: str) -> Estimate | Unmeasured:
    """Return what a fit found, where its standard error is at most so large; else why that is no measurement."""
    if isfinite(value) and isfinite(error) and error <= most:
        return Estimate(value=float(value), error=float(error))
    return Unmeasured(reason)


def level_db(intensity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return intensities in dB."""
    levels: NDArray[np.float64] = 10.0 * np.log10(np.maximum(intensity, 1e-12))
    return levels
