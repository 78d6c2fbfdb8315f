"""One reading by itself: whether its numbers are sound, whether it is harmful, whether the needle touches."""

from math import isfinite

from scleraforce.monitor.causes import Cause
from scleraforce.monitor.events import FrameRead, SecondOpinion
from scleraforce.monitor.limits import MonitorLimits
from scleraforce.units import from_si

Reading = FrameRead | SecondOpinion

PROBABILITY_SLACK = 1e-3  # single precision, summed


def unsound(reading: Reading, limits: MonitorLimits) -> str | None:
    """Return what in a reading is not a finite number, is missing or contradicts itself; None if it is sound."""
    interval_n, shares = reading.interval_n, reading.probabilities
    numbers = (reading.force_n, *(interval_n or ()), *(shares or ()))
    if not all(number is None or isfinite(number) for number in numbers):
        return "a reading with NaN or infinity"
    if not reading.usable:
        return None
    if shares is None or not 0 <= reading.predicted < len(shares) or not all(0 <= share <= 1 for share in shares):
        return f"probabilities {shares} of class {reading.predicted}"
    if not abs(sum(shares) - 1) <= PROBABILITY_SLACK:
        return f"probabilities that sum to {sum(shares):g}"
    if (reading.force_n is None) != (interval_n is None) or (limits.reads_force and reading.force_n is None):
        return "a reading without its force or its interval"
    return "an interval upside down" if interval_n is not None and not interval_n[0] <= interval_n[1] else None


def harm(reading: Reading, limits: MonitorLimits) -> tuple[Cause, str] | None:
    """Return the cause of a withdrawal in a usable, sound reading, with its reason; None if there is none."""
    if reading.predicted >= limits.withdraw_class:
        return Cause.DANGEROUS_CLASS, f"class {reading.predicted}"
    upper_n = upper_end(reading)
    if upper_n is not None and upper_n >= limits.bound_n:
        upper_mn, bound_mn = from_si(upper_n, "mn"), from_si(limits.bound_n, "mn")
        return Cause.BOUND, f"up to {upper_mn:.1f} mN, the bound is {bound_mn:.1f} mN"
    return None


def upper_end(reading: Reading) -> float | None:
    """Return the largest force that the reading allows, N; None with a classifier."""
    if reading.force_n is None or reading.interval_n is None:
        return None
    return max(reading.force_n, reading.interval_n[1])


def touches(reading: Reading, limits: MonitorLimits) -> bool:
    """Return whether a usable, sound reading shows contact."""
    return reading.predicted > 0 if reading.force_n is None else reading.force_n > limits.contact_n


def lag_of(frame: FrameRead) -> float | None:
    """Return how long after its stated time a frame came, s, on two clocks that need not agree; None if not stated."""
    return None if frame.sent_s is None else frame.at_s - frame.sent_s


def of_scale(scale_m: tuple[float, float], stated_m: tuple[float, float], limits: MonitorLimits) -> bool:
    """Return whether pixels have the stated size; False if a number is NaN."""
    return all(
        abs(found - stated) <= limits.scale_tolerance * stated for found, stated in zip(scale_m, stated_m, strict=True)
    )


def sound_pixels(size: tuple[int, int], scale_m: tuple[float, float]) -> bool:
    """Return whether a frame has pixels, and these have a size."""
    return all(isfinite(value) and value > 0 for value in (*size, *scale_m))
