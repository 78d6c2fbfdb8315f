"""The first state on a load path that carries a force.

Where a wall softens so far that the force falls along the path, loading jumps from the peak over the valley behind it,
and never sees the states between. A path is the force at increasing tips with its slope there; between two tips it is
a cubic (Hermite).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_STEPS = 50  # bisections of an interval of 0.25 mm end far below a rounding error of its ends
CONVERGED = 1e-13  # of an interval


def first_crossing(tip_m: Floats, force_sd: Floats, slope_sd: Floats, wanted_s: Floats) -> Floats:
    """Return the smallest tip at which each path carries its force; NaN where it never does.

    Args:
        tip_m: increasing tips (tip,), m.
        force_sd: force at them (sample, tip).
        slope_sd: its derivative by the tip (sample, tip).
        wanted_s: the force to find, in the same unit (sample,).

    Returns:
        The tips (sample,), m; the first tip where already that carries more.
    """
    cubic = _cubics(np.diff(tip_m), force_sd, slope_sd)
    peak_place, peak = _peaks(cubic)
    reached = np.maximum(peak, force_sd[:, 1:]) >= wanted_s[:, None]
    interval = np.argmax(reached, axis=1)
    sample = np.arange(len(wanted_s))
    coefficients = tuple(part[sample, interval] for part in cubic)
    place = _rising_root(coefficients, wanted_s, peak_place[sample, interval])
    tip = tip_m[interval] + place * np.diff(tip_m)[interval]
    tip = np.where(force_sd[:, 0] >= wanted_s, tip_m[0], tip)
    found: Floats = np.where(reached.any(axis=1), tip, np.nan)
    return found


def _cubics(step: Floats, force: Floats, slope: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Coefficients of 1, x, x^2, x^3 in every interval, x from 0 to 1, each (sample, interval)."""
    start, end = slope[:, :-1] * step, slope[:, 1:] * step
    rise = np.diff(force, axis=1)
    return force[:, :-1], start, 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise


def _rising_root(cubic: tuple[Floats, ...], wanted: Floats, high: Floats) -> Floats:
    """Place between 0 and `high` where cubics reach a value from below: Newton's steps, bisection where they leave."""
    low, place = np.zeros_like(high), 0.5 * high
    for _ in range(MOST_STEPS):
        over = _value(cubic, place) - wanted
        under = over < 0.0
        low, high = np.where(under, place, low), np.where(under, high, place)
        slope = (3.0 * cubic[3] * place + 2.0 * cubic[2]) * place + cubic[1]
        step = place - np.divide(over, slope, out=np.full_like(over, np.inf), where=slope != 0.0)
        following = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        moved = np.abs(following - place).max(initial=0.0)
        place = following
        if moved < CONVERGED:
            break
    return place


def _value(cubic: tuple[Floats, ...], x: Floats) -> Floats:
    value: Floats = ((cubic[3] * x + cubic[2]) * x + cubic[1]) * x + cubic[0]
    return value


def _peaks(cubic: tuple[Floats, Floats, Floats, Floats]) -> tuple[Floats, Floats]:
    """Place in 0 to 1 and value of the largest force in every interval (sample, interval)."""
    _, b, c, d = cubic
    # The maximum of the cubic is the root of b + 2 c x + 3 d x^2 where the curvature is negative, in the form that
    # does not cancel: x = b / (-c + sqrt(c^2 - 3 b d)). No such root, or one outside: the larger end.
    under = c * c - 3.0 * b * d
    divisor = np.sqrt(np.maximum(under, 0.0)) - c
    x = np.divide(b, divisor, out=np.ones_like(b), where=divisor > 0.0)
    inside = (under > 0.0) & (x > 0.0) & (x < 1.0)
    place = np.where(inside & (_value(cubic, np.where(inside, x, 1.0)) > _value(cubic, np.ones_like(x))), x, 1.0)
    return place, _value(cubic, place)
