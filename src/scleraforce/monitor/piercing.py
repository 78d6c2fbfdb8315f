"""A fast fall of the dent that no withdrawal of the needle explains: the needle has gone through the wall."""

from math import sqrt
from statistics import median
from typing import NamedTuple

from scleraforce.monitor.limits import MonitorLimits

MAD_TO_SD = 1.4826  # of a normal distribution
OUTSIDE = 2  # readings on either side of a fall: a single wild one is not a fall


class Dent(NamedTuple):
    """A frame's dent as its elastic force, and the needle's last stated travel, `age_s` before the frame, if any."""

    at_s: float
    force_n: float
    travel_m: float | None = None
    age_s: float = 0.0


class Fall(NamedTuple):
    """A fall of the dent's force, from a level to another, within a time."""

    from_n: float
    to_n: float
    within_s: float


def unexplained_fall(dents: tuple[Dent, ...], limits: MonitorLimits) -> Fall | None:
    """Return a fall that ends with the last two dents, oldest first, and that no withdrawal explains; else None.

    The level before is the lower of two neighbouring readings, the level after the higher of the last two, so neither
    a single reading nor a steady retraction passes for a fall: between the inner two of these, it takes as much time as
    the needle needs at `retraction_m_s`, on a wall of `stiffness_n_m`.
    """
    left_n = max(dent.force_n for dent in dents[-OUTSIDE:]) if len(dents) >= 2 * OUTSIDE else 0.0
    for place in range(len(dents) - OUTSIDE - 1, OUTSIDE - 2, -1):
        within_s = dents[-OUTSIDE].at_s - dents[place].at_s
        if within_s > limits.fall_s:
            break
        level_n = min(dents[place - 1].force_n, dents[place].force_n)
        least_n = max(limits.fall_share * level_n, limits.fall_n)
        if level_n - left_n >= least_n and level_n - left_n >= limits.fall_n + _explained_n(dents, place, limits):
            return Fall(level_n, left_n, within_s)
    return None


def _explained_n(dents: tuple[Dent, ...], place: int, limits: MonitorLimits) -> float:
    """Return how far the force can fall from the dent at a place to the last but one, N: withdrawal, eye and noise."""
    high, low = dents[place], dents[-OUTSIDE]
    within_s = low.at_s - high.at_s
    back_m = limits.retraction_m_s * within_s
    if high.travel_m is not None and low.travel_m is not None:
        earlier = [dent.travel_m for dent in dents[: place + 1] if high.at_s - dent.at_s <= limits.travel_lag_s]
        later = [dent.travel_m for dent in dents[place:]]
        before, after = ([there_m for there_m in places_m if there_m is not None] for places_m in (earlier, later))
        unseen_m = limits.retraction_m_s * (high.age_s + low.age_s)
        back_m = min(back_m, max(max(before) - min(after), 0.0) + unseen_m)
    moved_n = limits.stiffness_n_m * (back_m + limits.eye_m_s * within_s)
    return moved_n + limits.rate_deviations * noise_n([dent.force_n for dent in dents[: place + 1]])


def noise_n(forces_n: list[float]) -> float:
    """Return the standard deviation of readings, from their second differences, which are free of a steady change.

    Fewer than three show none.
    """
    bends_n = [abs(a - 2.0 * b + c) for a, b, c in zip(forces_n, forces_n[1:], forces_n[2:], strict=False)]
    return MAD_TO_SD * median(bends_n or [0.0]) / sqrt(6.0)  # a second difference has six variances
