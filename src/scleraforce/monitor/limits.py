"""The limits beyond which the monitor withdraws."""

from dataclasses import dataclass
from math import isfinite

from scleraforce.errors import InputError

COUNTS = (
    "withdraw_class",
    "unusable_frames",
    "unusable_opinions",
    "frozen_frames",
    "shown_frames",
    "rate_frames",
    "fresh_frames",
)
POSITIVE = (
    "bound_n",
    "contact_n",
    "reaction_s",
    "silence_s",
    "catch_up_s",
    "loss_in_row_s",
    "loss_in_window_s",
    "loss_window_s",
    "scale_tolerance",
    "opinion_s",
    "lifted_s",
    "lag_s",
)


@dataclass(frozen=True, kw_only=True)
class MonitorLimits:
    """Limits of the decision, in SI; docs/monitor_decision.md explains each.

    `size` and `scale_m` are the study's; None takes those of the last sound frame. `reads_force` is False with a
    classifier, which gives no force; otherwise a frame without a force is a cause. `expects_opinion` is True if another
    process gives second opinions: then nothing is OK before the first one, and an overdue one is a cause.
    Losses are limited by the time for which the lost frames stand, so that the limits fit any frame rate.

    Raises:
        InputError: a limit that lets everything pass, or nothing.
    """

    withdraw_class: int = 2
    bound_n: float = 0.03
    contact_n: float = 2e-3
    lifted_s: float = 0.5
    reaction_s: float = 0.05
    rate_frames: int = 10
    rate_deviations: float = 3.0
    unusable_frames: int = 1
    unusable_opinions: int = 3
    silence_s: float = 0.1
    frozen_frames: int = 3
    shown_frames: int = 50
    lag_s: float = 0.1
    lag_drift: float = 1e-4
    catch_up_s: float = 0.1
    loss_in_row_s: float = 0.04
    loss_in_window_s: float = 0.08
    loss_window_s: float = 1.0
    fresh_frames: int = 5
    size: tuple[int, int] | None = None
    scale_m: tuple[float, float] | None = None
    scale_tolerance: float = 1e-3
    reads_force: bool = True
    expects_opinion: bool = False
    opinion_s: float = 0.5

    def __post_init__(self) -> None:
        for name in COUNTS:
            _check(name, getattr(self, name), 1)
        for name in POSITIVE:
            _check(name, getattr(self, name), 0, strictly=True)
        _check("rate_deviations", self.rate_deviations, 0)
        _check("lag_drift", self.lag_drift, 0)
        _check("rate_frames", self.rate_frames, 4)
        _check("frozen_frames", self.frozen_frames, 2)
        if self.contact_n >= self.bound_n:
            raise InputError(f"monitor: contact_n is {self.contact_n:g}, must be below bound_n, {self.bound_n:g}")
        for value in (*(self.size or ()), *(self.scale_m or ())):
            _check("size, scale_m", value, 0, strictly=True)


def _check(name: str, value: float, least: float, strictly: bool = False) -> None:
    if isfinite(value) and (value > least if strictly else value >= least):
        return
    raise InputError(f"monitor: {name} is {value}, must be {'more than' if strictly else 'at least'} {least:g}")
