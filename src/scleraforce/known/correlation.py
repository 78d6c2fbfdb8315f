"""Unknowns that were found together: their correlation, and what bounds of one say of the others."""

import numpy as np
from numpy.typing import NDArray

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


def within_bounds(
    mean: NDArray[np.float64], covariance: NDArray[np.float64], place: int, bounds: tuple[float, float]
) -> NDArray[np.float64]:
    """Return the mean of unknowns (unknown,) where one of them stays within its bounds: given the bound, if it left.

    Args:
        mean: of normal unknowns (unknown,).
        covariance: of them (unknown, unknown).
        place: of the one.
        bounds: its least and its largest value.

    >>> within_bounds(np.array([1.0, 3.0]), np.array([[4.0, 1.0], [1.0, 2.0]]), 1, (0.0, 2.0)).tolist()
    [0.5, 2.0]
    """
    away = np.clip(mean[place], *bounds) - mean[place]
    moved: NDArray[np.float64] = mean + away * covariance[:, place] / covariance[place, place]
    return moved
