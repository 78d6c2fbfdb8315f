"""How far the force will have risen when the robot has reacted: a robust slope and its doubt."""

from math import sqrt

import numpy as np

__all__ = ["risen_force"]

LEAST_POINTS = 4
MAD_TO_SD = 1.4826  # of a normal distribution


def risen_force(history: tuple[tuple[float, float], ...], ahead_s: float, deviations: float) -> float | None:
    """Return the force after `ahead_s` at the least slope that the last frames allow; None where it does not rise.

    The slope is the median of those between all pairs (Theil 1950, Sen 1968): a single wild frame does not turn it.
    Its standard deviation is a straight line's, from the median absolute residual; `deviations` of them are taken off.

    Args:
        history: (time, force) of the last frames, s and N, oldest first.
        ahead_s: the robot's reaction time, s.
        deviations: standard deviations of the slope that are taken off before it counts.

    >>> ramp = tuple((0.01 * i, 0.02 * 0.01 * i) for i in range(10))
    >>> round(risen_force(ramp, 0.1, 3.0), 6)
    0.0038
    """
    if len(history) < LEAST_POINTS:
        return None
    time_s, force_n = np.array(history).T
    time_s = time_s - time_s[-1]
    first, second = np.triu_indices(len(time_s), 1)
    apart = time_s[second] > time_s[first]
    if np.count_nonzero(apart) < LEAST_POINTS:
        return None
    first, second = first[apart], second[apart]
    slope = float(np.median((force_n[second] - force_n[first]) / (time_s[second] - time_s[first])))
    offset = force_n - slope * time_s
    now_n = float(np.median(offset))
    sd_n = MAD_TO_SD * float(np.median(np.abs(offset - now_n)))
    least = slope - deviations * sd_n / sqrt(float(np.sum((time_s - time_s.mean()) ** 2)))
    return now_n + least * ahead_s if least > 0 else None
