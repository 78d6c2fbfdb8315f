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


# Misfits below it are a noise that was underestimated.
DIVERGED_SD = 3.0
DIVERGENCE_PROBABILITY = 1e-6  # of a false alarm, were the model right


def is_beyond_chance(squares: float, count: int) -> bool:
    """Return True if `count` squared residuals, in standard deviations, sum up to more
    than 9 each, and to more than chance gives.

    >>> is_beyond_chance(40.0, 3), is_beyond_chance(200.0, 40)
    (True, False)
    """
    if not squares > count * DIVERGED_SD**2:
        return False

    # 110 ms: not for a model that keeps to its frames
    from scipy.special import chdtri

    return bool(squares > chdtri(count, DIVERGENCE_PROBABILITY))
