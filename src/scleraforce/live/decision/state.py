"""The state of the monitor between two events, and its update by the next one."""

from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any, TypeVar

from scleraforce.live.decision.events import (
    Cause,
    FrameRead,
    MonitorEvent,
    OvertakenRead,
    QueueLoss,
    SecondOpinion,
    State,
)
from scleraforce.live.decision.limits import (
    MonitorLimits,
    lag_of,
    of_scale,
    sound_pixels,
    touches,
    unsound,
)
from scleraforce.reading.force_trend import DENTS, NOISE_WINDOWS, DentForce

Timed = TypeVar("Timed", bound=tuple[Any, ...])  # its time comes first
LOSS_PARTS = 20  # of the window, in each of which losses are summed up
MOST_UNANSWERED = 128  # frames whose times are kept; more are thinned
# number of last frames of which the third quickest counts: no frame alone decides what
# is late
LAGS = 20
QUICKEST = 3


@dataclass(frozen=True, kw_only=True)
class MonitorState:
    """All that the monitor remembers: a few hundred numbers at most.

    `cause` and `reason`: the first cause of a withdrawal, until the reset;
    `present_cause` and `present_reason`: the last cause or doubt, until a harmless
    frame. `size` and `scale_m` are the study's, or the last sound frames': a change is
    a cause once. `history` has (time, force) of the last frames with sound numbers,
    `dents` their dents, both in the order of time and of frames since `counts_since_s`,
    when a fall was found or a reset granted; `pierced` says that the wall was pierced
    since the last reset. `repeats` counts the frames in a row with one picture;
    `returns` says of each of the last frames whether its picture came back after
    others. `lags` are the last delays since the time that the sender states, on two
    clocks that need not agree; `least_lag` is (time, lag): the least so far of the
    third quickest of 20, plus the clocks' possible drift. `losses` has (time, time that
    the lost frames stand for) within the window, summed up over twentieths of it,
    without the short rows that `MonitorLimits.counted_loss` leaves out; `lost` counts
    all lost frames since the start, and `lost_in_row_s` is the time that the frames of
    `lost_row`, the last row with a loss, stand for. `fresh` counts the harmless frames
    in a row. `touched` is True after contact; `clear_s` is the time of the first frame
    of the present run without contact. `opinion` is the last second opinion since the
    last cause, `doubted` counts the unusable ones in a row, and `unanswered` has
    (frame, time) of the frames without one, oldest first, thinned if there are many.
    """

    state: State = State.NOT_READY
    cause: Cause | None = None
    reason: str = "no good frame yet"
    present_cause: Cause | None = None
    present_reason: str = ""
    at_s: float | None = None
    frame: FrameRead | None = None
    size: tuple[int, int] | None = None
    scale_m: tuple[float, float] | None = None
    repeats: int = 0
    returns: tuple[bool, ...] = ()
    lags: tuple[float, ...] = ()
    least_lag: tuple[float, float] | None = None
    touched: bool = False
    clear_s: float | None = None
    unusable: int = 0
    history: tuple[tuple[float, float], ...] = ()
    dents: tuple[DentForce, ...] = ()
    counts_since_s: float = -inf
    pierced: str = ""
    losses: tuple[tuple[float, float], ...] = ()
    lost: int = 0
    lost_in_row_s: float = 0.0
    lost_row: int = 0
    fresh: int = 0
    opinion: SecondOpinion | None = None
    doubted: int = 0
    unanswered: tuple[tuple[int, float], ...] = ()


def remember(
    state: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> MonitorState:
    """Return the state updated by an event, before its meaning is decided; one copy of
    it, as each takes 10 µs.
    """
    if isinstance(event, FrameRead):
        return _remember_frame(state, event, limits)

    state = replace(state, at_s=_time_of(state, event))
    if isinstance(event, OvertakenRead):
        verdict = event.read.verdict
        if not verdict.usable or unsound(verdict, limits):
            return state
        history, dents = _histories(state, event.read, limits)
        return replace(state, history=history, dents=dents)
    if isinstance(event, QueueLoss):
        before_s = state.lost_in_row_s if event.row == state.lost_row else 0.0
        row_s = before_s + event.unread_s
        counted_s = limits.counted_loss(before_s, event)
        losses = _losses(state.losses, event.at_s, counted_s, limits.loss_window_s)
        lost = state.lost + event.lost

        return replace(
            state, losses=losses, lost=lost, lost_in_row_s=row_s, lost_row=event.row
        )

    return (
        _remember_opinion(state, event, limits)
        if isinstance(event, SecondOpinion)
        else state
    )


def _time_of(state: MonitorState, event: MonitorEvent) -> float | None:
    return event.at_s if isfinite(event.at_s) else state.at_s


def _losses(
    losses: tuple[tuple[float, float], ...],
    at_s: float,
    unread_s: float,
    window_s: float,
) -> tuple[tuple[float, float], ...]:
    """Return the losses within the window; all losses in one twentieth of it are one,
    at the time of the last.
    """
    recent = tuple(loss for loss in losses if at_s - loss[0] < window_s)
    part_s = window_s / LOSS_PARTS
    if not unread_s:
        return recent
    if recent and recent[-1][0] // part_s == at_s // part_s:
        return (*recent[:-1], (at_s, recent[-1][1] + unread_s))

    return (*recent, (at_s, unread_s))


def _remember_frame(
    state: MonitorState, frame: FrameRead, limits: MonitorLimits
) -> MonitorState:
    waiting = (
        (*state.unanswered, (frame.frame_id, frame.at_s))
        if limits.expects_opinion
        else ()
    )
    lag_s = lag_of(frame)
    lags = (
        state.lags
        if lag_s is None or not isfinite(lag_s)
        else (*state.lags, lag_s)[-LAGS:]
    )
    size = limits.size or state.size
    scale_m = limits.scale_m or state.scale_m
    touched = state.touched
    clear_s = None
    history = state.history
    dents = state.dents

    if frame.verdict.usable and not unsound(frame.verdict, limits):
        if sound_pixels(frame.size, frame.scale_m):
            same = scale_m is not None and of_scale(frame.scale_m, scale_m, limits)
            size = limits.size or frame.size
            scale_m = limits.scale_m or (scale_m if same else frame.scale_m)

        touched, clear_s = _contact(state, frame, limits)
        history, dents = _histories(state, frame, limits)

    return replace(
        state,
        at_s=_time_of(state, frame),
        frame=frame,
        size=size,
        scale_m=scale_m,
        touched=touched,
        clear_s=clear_s,
        history=history,
        dents=dents,
        repeats=state.repeats + 1 if frame.shown_back == 1 else 1,
        returns=(*state.returns, frame.shown_back > 1)[-limits.shown_frames :],
        lags=lags,
        least_lag=_least_lag(state.least_lag, lags, frame.at_s, limits),
        unusable=0 if frame.verdict.usable else state.unusable + 1,
        unanswered=waiting if len(waiting) <= MOST_UNANSWERED else waiting[::2],
    )


def _histories(
    state: MonitorState, frame: FrameRead, limits: MonitorLimits
) -> tuple[tuple[tuple[float, float], ...], tuple[DentForce, ...]]:
    """Return `history` and `dents` with a sound reading, in the order of time; a
    picture that was shown before is no dent.
    """
    history = state.history
    dents = state.dents
    force_n = frame.verdict.force_n
    if force_n is None or frame.since_s < state.counts_since_s:
        return history, dents

    history = _inserted(history, (frame.since_s, force_n))
    history = history[-NOISE_WINDOWS * limits.rate_frames :]
    if frame.shown_back == 0:
        dents = _inserted(dents, _dent(frame, force_n))[-DENTS:]

    return history, dents


def _inserted(entries: tuple[Timed, ...], entry: Timed) -> tuple[Timed, ...]:
    """Return entries in the order of time with one more in its place."""
    place = len(entries)
    while place and entries[place - 1][0] > entry[0]:
        place -= 1
    return (*entries[:place], entry, *entries[place:])


def _dent(frame: FrameRead, force_n: float) -> DentForce:
    elastic_n = frame.verdict.elastic_force_n
    travel_m = frame.travel_m
    known = travel_m is not None and isfinite(travel_m) and frame.travel_age_s >= 0.0
    dent_n = force_n if elastic_n is None else elastic_n
    return DentForce(
        frame.since_s, dent_n, travel_m if known else None, frame.travel_age_s
    )


def _least_lag(
    least: tuple[float, float] | None,
    lags: tuple[float, ...],
    at_s: float,
    limits: MonitorLimits,
) -> tuple[float, float] | None:
    """Return the least lag that several of 20 frames had so far; it rises with the
    clocks' possible drift.
    """
    if len(lags) < QUICKEST:
        return least
    quick_s = sorted(lags)[QUICKEST - 1]
    if least is None:
        return at_s, quick_s
    return at_s, min(quick_s, least[1] + limits.lag_drift * max(0.0, at_s - least[0]))


def _contact(
    state: MonitorState, frame: FrameRead, limits: MonitorLimits
) -> tuple[bool, float | None]:
    """Contact begins with one frame and ends after `lifted_s` of sound frames without
    contact.
    """
    if touches(frame.verdict, limits):
        return True, None
    since_s = frame.at_s if state.clear_s is None else state.clear_s
    return state.touched and frame.at_s - since_s < limits.lifted_s, since_s


def _remember_opinion(
    state: MonitorState, opinion: SecondOpinion, limits: MonitorLimits
) -> MonitorState:
    state = replace(
        state,
        opinion=opinion,
        doubted=0 if opinion.verdict.usable else state.doubted + 1,
        unanswered=_unanswered(state.unanswered, opinion.frame_id),
    )
    if not opinion.verdict.usable or unsound(opinion.verdict, limits):
        return replace(state, clear_s=None)

    return (
        replace(state, touched=True, clear_s=None)
        if touches(opinion.verdict, limits)
        else state
    )


def _unanswered(
    waiting: tuple[tuple[int, float], ...], frame_id: int
) -> tuple[tuple[int, float], ...]:
    """Return the frames after the one that is answered, or after the last one before
    it, whatever their numbers are.
    """
    places = [
        place for place, (waiting_id, _) in enumerate(waiting) if waiting_id == frame_id
    ]
    places = places or [
        place for place, (waiting_id, _) in enumerate(waiting) if waiting_id < frame_id
    ]

    return waiting[places[-1] + 1 :] if places else waiting
