"""Correlation of two unknowns that were found together, as far from one as arithmetic needs it."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_CORRELATED", "correlation_of"]

MOST_CORRELATED = 1.0 - 1e-9  # where two unknowns are as good as one, rounding puts their correlation beyond 1


def correlation_of(covariance: NDArray[np.float64], first: int, second: int) -> float:
    """Return the correlation of two unknowns of a covariance (unknown, unknown), never beyond `MOST_CORRELATED`.

    >>> correlation_of(np.array([[4.0, 1.0], [1.0, 1.0]]), 0, 1)
    0.5
    >>> correlation_of(np.array([[1.0, -1.1], [-1.1, 1.0]]), 0, 1) == -MOST_CORRELATED
    True
    """
    found = covariance[first, second] / np.sqrt(covariance[first, first] * covariance[second, second])
    return float(np.clip(found, -MOST_CORRELATED, MOST_CORRELATED))
