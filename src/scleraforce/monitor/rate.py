"""The force when the robot will have reacted: a robust slope and its uncertainty.

It is in plain Python, which for ten points takes a tenth of the time of NumPy's calls while the robot waits.
"""

from itertools import combinations
from math import inf, sqrt
from statistics import fmean, median

NOISE_WINDOWS = 5  # times the frames of the slope are kept, to estimate the noise
LEAST_PAIRS = 4
MAD_TO_SD = 1.4826  # of a normal distribution


def risen_force(
    history: tuple[tuple[float, float], ...], ahead_s: float, deviations: float, frames: int
) -> float | None:
    """Return the force after `ahead_s` at the least slope that the last frames allow; None if it does not rise.

    `history` has time (s) and force (N) of the last frames, oldest first; fewer than `frames` of them show no slope.

    The slope is the median of all pairs' slopes (Theil 1950, Sen 1968), so a single outlier does not turn it. Its
    standard deviation is that of a straight-line fit, and `deviations` of them are subtracted. Ten residuals estimate
    the noise badly, now and then much too low by chance. So the noise is at least that of the second differences, which
    are free of a steady rise, over all frames kept. If the rise slows down, a line predicts too much; then the
    prediction of a parabola through the slopes of the two halves counts, if it is less.

    >>> ramp = tuple((0.01 * i, 0.02 * 0.01 * i) for i in range(10))
    >>> round(risen_force(ramp, 0.1, 3.0, 10), 6)
    0.0038
    """
    if len(history) < frames:
        return None
    now_s = history[-1][0]
    points = [(at_s - now_s, force_n) for at_s, force_n in history[-frames:]]
    slope = _slope(points)
    if slope is None or slope <= 0.0:
        return None
    offsets_n = [force_n - slope * at_s for at_s, force_n in points]
    now_n = median(offsets_n)
    off_n = median([abs(offset_n - now_n) for offset_n in offsets_n])
    forces_n = [force_n for _, force_n in history]
    bends_n = [abs(a - 2.0 * b + c) for a, b, c in zip(forces_n, forces_n[1:], forces_n[2:], strict=False)]
    sd_n = MAD_TO_SD * max(off_n, median(bends_n) / sqrt(6.0))  # a second difference has six variances
    middle_s = fmean([at_s for at_s, _ in points])
    spread = sqrt(sum((at_s - middle_s) ** 2 for at_s, _ in points))
    least = slope - deviations * sd_n / spread
    if least <= 0.0:
        return None
    slowing_n = _slowing_force(points, ahead_s)
    return None if slowing_n is None else min(now_n + least * ahead_s, slowing_n)


def _slowing_force(points: list[tuple[float, float]], ahead_s: float) -> float | None:
    """Return the force that a slowing rise reaches within `ahead_s`, at most its top; infinity if it keeps its slope.

    None: it has passed its top. Times count from now, so the points have negative ones.
    """
    half = len(points) // 2 + 1
    early, late = _slope(points[:half]), _slope(points[-half:])
    if early is None or late is None or late >= early:
        return inf
    early_s, late_s = (fmean([at_s for at_s, _ in part]) for part in (points[:half], points[-half:]))
    bend = (late - early) / (late_s - early_s)
    slope = late - bend * late_s
    if slope <= 0.0:
        return None
    now_n = median([force_n - slope * at_s - 0.5 * bend * at_s**2 for at_s, force_n in points[-half:]])
    rising_s = min(ahead_s, -slope / bend)
    return now_n + slope * rising_s + 0.5 * bend * rising_s**2


def _slope(points: list[tuple[float, float]]) -> float | None:
    """Return the median slope of all pairs; None if too few pairs differ in time."""
    slopes = [
        (later_n - earlier_n) / (later_s - earlier_s)
        for (earlier_s, earlier_n), (later_s, later_n) in combinations(points, 2)
        if later_s > earlier_s
    ]
    return median(slopes) if len(slopes) >= LEAST_PAIRS else None
