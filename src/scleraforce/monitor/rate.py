"""How far the force will have risen when the robot has reacted: a robust slope and its doubt.

In plain Python: for ten points that takes a tenth of what NumPy's calls cost, and the robot waits.
"""

from dataclasses import dataclass
from itertools import combinations
from math import sqrt
from statistics import fmean, median

__all__ = ["NOISE_WINDOWS", "risen_force"]

NOISE_WINDOWS = 5  # of the slope's frames: so many are kept to know the noise
LEAST_PAIRS = 4
MAD_TO_SD = 1.4826  # of a normal distribution


def risen_force(
    history: tuple[tuple[float, float], ...], ahead_s: float, deviations: float, frames: int
) -> float | None:
    """Return the force after `ahead_s` at the least slope that the last frames allow; None where it does not rise.

    The slope is the median of those between all pairs (Theil 1950, Sen 1968): a single wild frame does not turn it.
    Its standard deviation is a straight line's; `deviations` of them are taken off. Ten residuals tell too little of
    the noise, by chance much too little now and then: it is no less than that of the second differences (which a
    steady rise leaves out) of all that is kept. Where the force slows down, a line through all of them foretells too
    much: the last of them, half and one, have a line of their own, and the smaller force counts.

    Args:
        history: (time, force) of the last frames, s and N, oldest first.
        ahead_s: the robot's reaction time, s.
        deviations: standard deviations of the slope that are taken off before it counts.
        frames: over which the slope is taken; with fewer there is none.

    >>> ramp = tuple((0.01 * i, 0.02 * 0.01 * i) for i in range(10))
    >>> round(risen_force(ramp, 0.1, 3.0, 10), 6)
    0.0038
    """
    if len(history) < frames:
        return None
    now_s = history[-1][0]
    points = [(at_s - now_s, force_n) for at_s, force_n in history[-frames:]]
    line, latest = _line(points), _line(points[-(frames // 2 + 1) :])
    if line is None or latest is None or min(line.slope, latest.slope) <= 0.0:
        return None
    forces_n = [force_n for _, force_n in history]
    bends_n = [abs(a - 2.0 * b + c) for a, b, c in zip(forces_n, forces_n[1:], forces_n[2:], strict=False)]
    sd_n = MAD_TO_SD * max(line.off_n, median(bends_n) / sqrt(6.0))  # a second difference has six variances
    middle_s = fmean([at_s for at_s, _ in points])
    spread = sqrt(sum((at_s - middle_s) ** 2 for at_s, _ in points))
    least = line.slope - deviations * sd_n / spread
    if least <= 0.0:
        return None
    return min(line.now_n + least * ahead_s, latest.now_n + latest.slope * ahead_s)


@dataclass(frozen=True)
class _Line:
    """A robust line: its slope, its force now (time 0), the median distance of the points from it."""

    slope: float
    now_n: float
    off_n: float


def _line(points: list[tuple[float, float]]) -> _Line | None:
    """Return the line whose slope is the median of all pairs'; None where too few of them have different times."""
    slopes = [
        (later_n - earlier_n) / (later_s - earlier_s)
        for (earlier_s, earlier_n), (later_s, later_n) in combinations(points, 2)
        if later_s > earlier_s
    ]
    if len(slopes) < LEAST_PAIRS:
        return None
    slope = median(slopes)
    offsets = [force_n - slope * at_s for at_s, force_n in points]
    now_n = median(offsets)
    return _Line(slope, now_n, median([abs(offset - now_n) for offset in offsets]))
