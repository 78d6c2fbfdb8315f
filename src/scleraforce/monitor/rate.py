"""How far the force will have risen when the robot has reacted: a robust slope and its doubt.

In plain Python: for ten points that takes a tenth of what NumPy's calls cost, and the robot waits.
"""

from itertools import combinations
from math import sqrt
from statistics import fmean, median

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
    now_s = history[-1][0]
    points = [(at_s - now_s, force_n) for at_s, force_n in history]
    slopes = [
        (later_n - earlier_n) / (later_s - earlier_s)
        for (earlier_s, earlier_n), (later_s, later_n) in combinations(points, 2)
        if later_s > earlier_s
    ]
    if len(slopes) < LEAST_POINTS:
        return None
    slope = median(slopes)
    offsets = [force_n - slope * at_s for at_s, force_n in points]
    now_n = median(offsets)
    sd_n = MAD_TO_SD * median([abs(offset - now_n) for offset in offsets])
    middle_s = fmean([at_s for at_s, _ in points])
    spread = sqrt(sum((at_s - middle_s) ** 2 for at_s, _ in points))
    least = slope - deviations * sd_n / spread
    return now_n + least * ahead_s if least > 0 else None
