"""The limits beyond which the monitor withdraws, and one verdict or frame judged by
itself.
"""

from dataclasses import dataclass, fields
from math import inf, isfinite

from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.live.decision.events import SLACK_S, Cause, FrameRead, QueueLoss
from scleraforce.reading.force_trend import TrendLimits
from scleraforce.records.verdict import Verdict, upper_end

LEAST = {"rate_frames": 4, "frozen_frames": 2}  # of the other counts, 1
# relative, of a scanner's measured interval: frames arrive late on a busy machine
INTERVAL_ERROR = 0.05
MAY_BE_ZERO = ("rate_deviations", "lag_drift", "eye_m_s", "travel_lag_s")


@dataclass(frozen=True, kw_only=True)
class MonitorLimits(TrendLimits):
    """Limits of the decision, in SI; docs/monitor_decision.md explains each.

    `size` and `scale_m` are the study's; None takes the last sound frame's.
    `reads_force` is False with a classifier, which gives no force; otherwise a frame
    without a force is a cause. `expects_opinion` is True if another process gives
    second opinions: then nothing is OK before the first one, and an overdue one is a
    cause. Losses are limited by the time that the lost frames represent, so that the
    limits fit any frame rate. `reports_pierced` is True if a pierced wall is not to end
    in a withdrawal. A limit that lets everything pass, or nothing, is an InputError.
    """

    withdraw_class: int = 2
    bound_n: float = 0.03
    contact_n: float = 2e-3
    lifted_s: float = 0.5
    unusable_frames: int = 1
    unusable_opinions: int = 3
    silence_s: float = 0.1
    frozen_frames: int = 3
    shown_frames: int = 50
    lag_s: float = 0.1
    lag_drift: float = 1e-4
    catch_up_s: float = 0.1
    loss_in_window_s: float = 0.08
    loss_window_s: float = 1.0
    fresh_frames: int = 5
    size: tuple[int, int] | None = None
    scale_m: tuple[float, float] | None = None
    scale_tolerance: float = 1e-3
    reads_force: bool = True
    expects_opinion: bool = False
    opinion_s: float = 0.5
    reports_pierced: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.type is int:
                _check(field.name, getattr(self, field.name), LEAST.get(field.name, 1))
            elif field.type is float:
                _check(
                    field.name,
                    getattr(self, field.name),
                    0,
                    strictly=field.name not in MAY_BE_ZERO,
                )

        if self.contact_n >= self.bound_n:
            raise InputError(
                f"monitor: contact_n is {self.contact_n:g}, must be below bound_n,"
                f" {self.bound_n:g}"
            )

        for value in (*(self.size or ()), *(self.scale_m or ())):
            _check("size, scale_m", value, 0, strictly=True)

    def counted_loss(self, before_s: float, loss: QueueLoss) -> float:
        """Return what a loss adds to the time unread within the window, s, after
        `before_s` of the same row.

        A row counts as a whole once `RISING`, by the slope of `rate_frames` readings,
        may come late: while that many come within the reaction time and the longest
        stretch that may go unread, a withdrawal is later by one of their gaps at most,
        4 ms. A scanner of 100 Hz that loses nothing has gaps of 10 ms. So shorter rows
        never count, nor do rows that are longer by the error of the interval alone:
        three frames of a scanner of 1,000 Hz whose interval is measured as 1.01 ms.
        """
        interval_s = loss.unread_s / loss.lost if loss.lost >= 1 else inf
        most_s = (1.0 + INTERVAL_ERROR) * self.short_gap_s - interval_s + SLACK_S
        if before_s + loss.unread_s <= most_s:
            return 0.0

        return loss.unread_s if before_s > most_s else before_s + loss.unread_s


def _check(name: str, value: float, least: float, strictly: bool = False) -> None:
    if isfinite(value) and (value > least if strictly else value >= least):
        return
    raise InputError(
        f"monitor: {name} is {value}, must be {'more than' if strictly else 'at least'}"
        f" {least:g}"
    )


PROBABILITY_SLACK = 1e-3  # single precision, summed


def unsound(verdict: Verdict, limits: MonitorLimits) -> str | None:
    """Return the fault of a verdict: a number that is missing, not finite or
    contradicts others; None if sound.
    """
    interval_n = verdict.interval_n
    shares = verdict.probabilities

    numbers = (
        verdict.force_n,
        verdict.elastic_force_n,
        *(interval_n or ()),
        *(shares or ()),
    )
    if not all(number is None or isfinite(number) for number in numbers):
        return "a reading with NaN or infinity"
    if not verdict.usable:
        return None
    if (
        shares is None
        or not 0 <= verdict.predicted < len(shares)
        or not all(0 <= share <= 1 for share in shares)
    ):
        return f"probabilities {shares} of class {verdict.predicted}"
    if not abs(sum(shares) - 1) <= PROBABILITY_SLACK:
        return f"probabilities that sum to {sum(shares):g}"
    if (verdict.force_n is None) != (interval_n is None) or (
        limits.reads_force and verdict.force_n is None
    ):
        return "a reading without its force or its interval"

    return (
        "an interval upside down"
        if interval_n is not None and not interval_n[0] <= interval_n[1]
        else None
    )


def harm(verdict: Verdict, limits: MonitorLimits) -> tuple[Cause, str] | None:
    """Return the cause of a withdrawal in a usable, sound verdict, with its reason;
    None if it is harmless.
    """
    if verdict.predicted >= limits.withdraw_class:
        return Cause.DANGEROUS_CLASS, f"class {verdict.predicted}"

    upper_n = upper_end(verdict)
    if upper_n is not None and upper_n >= limits.bound_n:
        upper_mn = from_si(upper_n, "mn")
        bound_mn = from_si(limits.bound_n, "mn")
        return Cause.BOUND, f"up to {upper_mn:.1f} mN, the bound is {bound_mn:.1f} mN"

    return None


def touches(verdict: Verdict, limits: MonitorLimits) -> bool:
    """Return whether a usable, sound verdict shows contact: a dent does, also where the
    force on it has relaxed.
    """
    force_n = (
        verdict.force_n if verdict.elastic_force_n is None else verdict.elastic_force_n
    )
    return verdict.predicted > 0 if force_n is None else force_n > limits.contact_n


def lag_of(frame: FrameRead) -> float | None:
    """Return how long after its stated time a frame came, s, on two clocks that need
    not agree; None if not stated.
    """
    return None if frame.sent_s is None else frame.at_s - frame.sent_s


def of_scale(
    scale_m: tuple[float, float], stated_m: tuple[float, float], limits: MonitorLimits
) -> bool:
    """Return whether pixels have the stated size; False if a number is NaN."""
    pairs_m = zip(scale_m, stated_m, strict=True)
    return all(
        abs(found_m - stated_m) <= limits.scale_tolerance * stated_m
        for found_m, stated_m in pairs_m
    )


def sound_pixels(size: tuple[int, int], scale_m: tuple[float, float]) -> bool:
    """Return whether a frame has pixels, and these have a size."""
    return all(isfinite(value) and value > 0 for value in (*size, *scale_m))
