"""One verdict by itself: sound numbers, harm, contact; and the size, scale and delay of a frame."""

from math import isfinite

from scleraforce.monitor.causes import Cause
from scleraforce.monitor.events import FrameRead, Verdict
from scleraforce.monitor.limits import MonitorLimits
from scleraforce.units import from_si

PROBABILITY_SLACK = 1e-3  # single precision, summed


def unsound(verdict: Verdict, limits: MonitorLimits) -> str | None:
    """Return the fault of a verdict: a number that is missing, not finite or contradicts others; None if sound."""
    interval_n, shares = verdict.interval_n, verdict.probabilities
    numbers = (verdict.force_n, *(interval_n or ()), *(shares or ()))
    if not all(number is None or isfinite(number) for number in numbers):
        return "a reading with NaN or infinity"
    if not verdict.usable:
        return None
    if shares is None or not 0 <= verdict.predicted < len(shares) or not all(0 <= share <= 1 for share in shares):
        return f"probabilities {shares} of class {verdict.predicted}"
    if not abs(sum(shares) - 1) <= PROBABILITY_SLACK:
        return f"probabilities that sum to {sum(shares):g}"
    if (verdict.force_n is None) != (interval_n is None) or (limits.reads_force and verdict.force_n is None):
        return "a reading without its force or its interval"
    return "an interval upside down" if interval_n is not None and not interval_n[0] <= interval_n[1] else None


def harm(verdict: Verdict, limits: MonitorLimits) -> tuple[Cause, str] | None:
    """Return the cause of a withdrawal in a usable, sound verdict, with its reason; None if it is harmless."""
    if verdict.predicted >= limits.withdraw_class:
        return Cause.DANGEROUS_CLASS, f"class {verdict.predicted}"
    upper_n = upper_end(verdict)
    if upper_n is not None and upper_n >= limits.bound_n:
        upper_mn, bound_mn = from_si(upper_n, "mn"), from_si(limits.bound_n, "mn")
        return Cause.BOUND, f"up to {upper_mn:.1f} mN, the bound is {bound_mn:.1f} mN"
    return None


def upper_end(verdict: Verdict) -> float | None:
    """Return the largest force that the verdict allows, N; None with a classifier."""
    if verdict.force_n is None or verdict.interval_n is None:
        return None
    return max(verdict.force_n, verdict.interval_n[1])


def touches(verdict: Verdict, limits: MonitorLimits) -> bool:
    """Return whether a usable, sound verdict shows contact."""
    return verdict.predicted > 0 if verdict.force_n is None else verdict.force_n > limits.contact_n


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
