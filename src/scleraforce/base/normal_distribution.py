"""Numbers of the normal distribution: quantiles, bounds, robust spreads,
correlations.
"""

import numpy as np

from scleraforce.base.arrays import Floats

# where two unknowns are as good as one, rounding puts their correlation beyond 1
MOST_CORRELATED = 1.0 - 1e-9


def correlation_of(covariance: Floats, first: int, second: int) -> float:
    """Return the correlation of two unknowns of a covariance (unknown, unknown), at
    most `MOST_CORRELATED`.
    """
    found = covariance[first, second] / np.sqrt(
        covariance[first, first] * covariance[second, second]
    )
    return float(np.clip(found, -MOST_CORRELATED, MOST_CORRELATED))


def within_bounds(
    mean: Floats, covariance: Floats, place: int, bounds: tuple[float, float]
) -> Floats:
    """Return the mean of normal unknowns (unknown,) given that one of them stays within
    its bounds.

    >>> mean, covariance = np.array([1.0, 3.0]), np.array([[4.0, 1.0], [1.0, 2.0]])
    >>> within_bounds(mean, covariance, 1, (0.0, 2.0)).tolist()
    [0.5, 2.0]
    """
    away = np.clip(mean[place], *bounds) - mean[place]
    moved: Floats = mean + away * covariance[:, place] / covariance[place, place]
    return moved


NINETY_PERCENT = 1.6449  # standard deviations to either side

# standard deviation of a normal distribution over the median of its size
NORMAL_MEDIAN = 1.4826


def robust_spread(size: Floats) -> float:
    """Return the standard deviation of residuals from the median of their size, which
    outliers do not move.
    """
    return NORMAL_MEDIAN * float(np.median(size))
