"""The verdict on a frame, as the monitor judges and sends it, and its largest force."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The answer of a model to a frame: what is decided, sent, logged and shown.

    If the frame is not `usable`, `reason` says why and `predicted`, the class, does not
    count. A classifier gives no `force_n` and no 90 % `interval_n`. Only tissue that
    relaxes has an `elastic_force_n`: the force that makes such a dent at once, while
    `force_n` is on the needle now. Numbers may be NaN: the decision checks them.
    """

    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None
    force_n: float | None
    interval_n: tuple[float, float] | None
    elastic_force_n: float | None = None


def upper_end(verdict: Verdict) -> float | None:
    """Return the largest force that the verdict allows, N; None with a classifier."""
    if verdict.force_n is None or verdict.interval_n is None:
        return None
    return max(verdict.force_n, verdict.interval_n[1])
