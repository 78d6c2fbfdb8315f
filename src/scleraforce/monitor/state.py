"""The state of the monitor between two events, and its update by the next one."""

from dataclasses import dataclass, replace
from math import isfinite

from scleraforce.monitor.causes import Cause
from scleraforce.monitor.events import FrameRead, MonitorEvent, QueueLoss, SecondOpinion
from scleraforce.monitor.limits import MonitorLimits
from scleraforce.monitor.rate import NOISE_WINDOWS
from scleraforce.monitor.soundness import lag_of, sound_pixels, touches, unsound
from scleraforce.monitor.transitions import State

LOSS_PARTS = 20  # of the window, in each of which losses are summed up
MOST_UNANSWERED = 128  # frames whose times are kept; more are thinned


@dataclass(frozen=True, kw_only=True)
class MonitorState:
    """All that the monitor remembers: a few hundred numbers at most.

    `cause` and `reason` are those of the first cause of a withdrawal, kept until the reset. `history` has (time, force)
    of the last frames with sound numbers. `repeats` counts the frames in a row with one picture; `returns` tells for
    each of the last frames whether its picture came back after others. `least_lag` is (time, lag): the least delay
    since the time that the sender states, on two clocks that need not agree, plus their possible drift. `losses` has
    (time, time that the lost frames stand for) of the losses within the window, summed up over twentieths of it; `lost`
    counts all lost frames since the start, and `lost_in_row_s` is what those of `lost_row`, the last row with a loss,
    stand for. `fresh` counts the harmless frames in a row. `touched` is True after contact; `clear_s` is the time
    of the first frame of the present run without contact. `opinion` is the last second opinion since the last cause,
    `doubted` counts those in a row that could not judge their frame, and `unanswered` has (frame, time) of the frames
    without one, oldest first, thinned if there are many.
    """

    state: State = State.NOT_READY
    cause: Cause | None = None
    reason: str = "no good frame yet"
    at_s: float | None = None
    frame: FrameRead | None = None
    size: tuple[int, int] | None = None
    scale_m: tuple[float, float] | None = None
    repeats: int = 0
    returns: tuple[bool, ...] = ()
    least_lag: tuple[float, float] | None = None
    touched: bool = False
    clear_s: float | None = None
    unusable: int = 0
    history: tuple[tuple[float, float], ...] = ()
    losses: tuple[tuple[float, float], ...] = ()
    lost: int = 0
    lost_in_row_s: float = 0.0
    lost_row: int = 0
    fresh: int = 0
    opinion: SecondOpinion | None = None
    doubted: int = 0
    unanswered: tuple[tuple[int, float], ...] = ()


def remember(state: MonitorState, event: MonitorEvent, limits: MonitorLimits) -> MonitorState:
    """Return the state updated by an event, before its meaning is decided.

    Args:
        state: the state so far.
        event: what happened.
        limits: of the decision: how much is kept, and what counts as contact.
    """
    at_s = max(event.at_s, state.at_s or event.at_s) if isfinite(event.at_s) else state.at_s
    state = replace(state, at_s=at_s)
    if isinstance(event, QueueLoss):
        return replace(
            state,
            losses=_losses(state.losses, event, limits.loss_window_s),
            lost=state.lost + event.lost,
            lost_in_row_s=event.unread_s + (state.lost_in_row_s if event.row == state.lost_row else 0.0),
            lost_row=event.row,
        )
    if isinstance(event, SecondOpinion):
        return _remember_opinion(state, event, limits)
    return _remember_frame(state, event, limits) if isinstance(event, FrameRead) else state


def _losses(
    losses: tuple[tuple[float, float], ...], event: QueueLoss, window_s: float
) -> tuple[tuple[float, float], ...]:
    """Return the losses within the window; those of the same twentieth of it are one, at the time of the last."""
    recent = tuple(loss for loss in losses if event.at_s - loss[0] < window_s)
    part_s = window_s / LOSS_PARTS
    if recent and recent[-1][0] // part_s == event.at_s // part_s:
        return (*recent[:-1], (event.at_s, recent[-1][1] + event.unread_s))
    return (*recent, (event.at_s, event.unread_s))


def _remember_frame(state: MonitorState, frame: FrameRead, limits: MonitorLimits) -> MonitorState:
    waiting = (*state.unanswered, (frame.frame_id, frame.at_s)) if limits.expects_opinion else ()
    state = replace(
        state,
        frame=frame,
        size=limits.size or state.size,
        scale_m=limits.scale_m or state.scale_m,
        repeats=state.repeats + 1 if frame.shown_back == 1 else 1,
        returns=(*state.returns, frame.shown_back > 1)[-limits.shown_frames :],
        least_lag=_least_lag(state.least_lag, frame, limits),
        unusable=0 if frame.usable else state.unusable + 1,
        unanswered=waiting if len(waiting) <= MOST_UNANSWERED else waiting[::2],
    )
    if not frame.usable or unsound(frame, limits):
        return replace(state, clear_s=None)
    if sound_pixels(frame.size, frame.scale_m):
        state = replace(state, size=state.size or frame.size, scale_m=state.scale_m or frame.scale_m)
    state = _remember_contact(state, frame, limits)
    if frame.force_n is None:
        return state
    return replace(state, history=(*state.history, (frame.at_s, frame.force_n))[-NOISE_WINDOWS * limits.rate_frames :])


def _least_lag(
    least: tuple[float, float] | None, frame: FrameRead, limits: MonitorLimits
) -> tuple[float, float] | None:
    """Return the least lag so far; it rises with the possible drift between two clocks."""
    lag_s = lag_of(frame)
    if lag_s is None or not isfinite(lag_s):
        return least
    if least is None:
        return frame.at_s, lag_s
    return frame.at_s, min(lag_s, least[1] + limits.lag_drift * max(0.0, frame.at_s - least[0]))


def _remember_contact(state: MonitorState, frame: FrameRead, limits: MonitorLimits) -> MonitorState:
    """Contact begins with one frame and ends after `lifted_s` of sound frames without contact."""
    if touches(frame, limits):
        return replace(state, touched=True, clear_s=None)
    since_s = frame.at_s if state.clear_s is None else state.clear_s
    return replace(state, touched=state.touched and frame.at_s - since_s < limits.lifted_s, clear_s=since_s)


def _remember_opinion(state: MonitorState, opinion: SecondOpinion, limits: MonitorLimits) -> MonitorState:
    state = replace(
        state,
        opinion=opinion,
        doubted=0 if opinion.usable else state.doubted + 1,
        unanswered=_unanswered(state.unanswered, opinion.frame_id),
    )
    if not opinion.usable or unsound(opinion, limits):
        return replace(state, clear_s=None)
    return replace(state, touched=True, clear_s=None) if touches(opinion, limits) else state


def _unanswered(waiting: tuple[tuple[int, float], ...], frame_id: int) -> tuple[tuple[int, float], ...]:
    """Return the frames after the one that is answered; a client may have started to count anew."""
    places = [place for place, (waiting_id, _) in enumerate(waiting) if waiting_id == frame_id]
    if places:
        return waiting[places[-1] + 1 :]
    return tuple(entry for entry in waiting if entry[0] > frame_id)
