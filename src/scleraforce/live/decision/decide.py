"""The decision: from a state, an event and the limits to the next state and the message
to the robot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import assert_never

from scleraforce.base.units import from_si
from scleraforce.live.decision import events
from scleraforce.live.decision.events import (
    Cause,
    FrameRead,
    MonitorEvent,
    Signal,
    State,
)
from scleraforce.live.decision.limits import (
    MonitorLimits,
    harm,
    lag_of,
    of_scale,
    sound_pixels,
    touches,
    unsound,
)
from scleraforce.live.decision.state import MonitorState, remember
from scleraforce.reading.force_trend import (
    OUTSIDE,
    TimeToBound,
    rise_of,
    risen_force,
    time_to_bound,
    unexplained_fall,
)
from scleraforce.records.verdict import Verdict, upper_end


@dataclass(frozen=True)
class Decision:
    """The message to the robot: `code` and `sub_code` of the STATUS, and its `message`.

    `cause` is the first one of a withdrawal, or `PIERCED` where it is only reported;
    `present_cause` and `present` are the present one; without one, None and "".
    `to_bound`: after a frame, when the force will reach the bound; None: not within 2
    s, or not known.
    """

    state: State
    cause: Cause | None
    message: str
    code: int
    sub_code: int
    present_cause: Cause | None = None
    present: str = ""
    to_bound: TimeToBound | None = None


@dataclass(frozen=True)
class _EventMeaning:
    """The meaning of an event; it has a `cause` with an alarm or if the wall is
    pierced, `to_bound` after a frame.
    """

    signal: Signal
    reason: str
    cause: Cause | None = None
    to_bound: TimeToBound | None = None


QUIET = _EventMeaning(Signal.QUIET, "")


def decide(
    state: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> tuple[MonitorState, Decision]:
    """Return the next state and the message to the robot.

    It never raises: an exception in here is a cause of a withdrawal like any other. At
    the start, the state is `MonitorState()`.
    """
    remembered, finding = _judged(state, event, limits)
    moved = _move(remembered, finding, limits)
    return moved, _decision(moved, finding)


@dataclass(frozen=True)
class PlanesState:
    """The state of each of several planes of a scanner, by name: the histories of one
    plane never mix with another's.

    The decision on the plane `leading` counts: the worst one, or the first that was
    latched until the reset.
    """

    states: Mapping[str, MonitorState]
    leading: str

    @classmethod
    def of(cls, names: Sequence[str]) -> "PlanesState":
        """Return the state at the start."""
        states = {
            name: MonitorState(reason=f"plane {name}: no good frame yet")
            for name in names
        }
        return cls(states, names[0])

    @property
    def lost(self) -> int:
        """Frames of all planes that were lost since the start."""
        return sum(state.lost for state in self.states.values())


def decide_planes(
    planes: PlanesState, event: MonitorEvent, limits: MonitorLimits
) -> tuple[PlanesState, Decision]:
    """Return the next state of several planes and the message to the robot: `decide`,
    on each plane.

    What is of one plane, such as a frame, is a tick for the others. A contact is that
    of all planes. A reset is granted if every plane grants it.
    """
    own = getattr(getattr(event, "read", event), "plane", None)
    if own not in planes.states and not isinstance(
        event, (events.Tick, events.Fault, events.Reset)
    ):
        event = events.Fault(
            getattr(event, "at_s", nan), Cause.EXCEPTION, f"a frame of plane {own}"
        )
        own = None

    findings = dict[str, _EventMeaning]()
    remembered = dict[str, MonitorState]()

    for name, state in planes.states.items():
        of_plane = event if own in (None, name) else events.Tick(event.at_s)
        remembered[name], finding = _judged(state, of_plane, limits)
        is_named = finding.reason and not isinstance(of_plane, events.Fault)
        findings[name] = (
            replace(finding, reason=f"plane {name}: {finding.reason}")
            if is_named
            else finding
        )

    if (
        isinstance(event, FrameRead)
        and own
        and event.verdict.usable
        and _in_contact(remembered[own])
    ):
        for name, other in remembered.items():
            if not _in_contact(other):
                remembered[name] = replace(other, touched=True, clear_s=None)

    refusal = next(
        (one for one in findings.values() if one.signal is not Signal.RESET_GRANTED),
        None,
    )
    if isinstance(event, events.Reset) and refusal:
        refused = _EventMeaning(Signal.RESET_REFUSED, refusal.reason)
        findings = {
            name: refused if one.signal is Signal.RESET_GRANTED else one
            for name, one in findings.items()
        }

    states = {
        name: _move(state, findings[name], limits) for name, state in remembered.items()
    }
    leading = _leading(states, planes.leading)
    each = states[leading], *states.values()
    doubted = max(
        each, key=lambda state: (bool(state.present_cause), bool(state.present_reason))
    )
    decision = replace(
        _decision(states[leading], findings[leading]),
        to_bound=findings[own].to_bound if own else None,
        present_cause=doubted.present_cause,
        present=doubted.present_reason,
    )

    return PlanesState(states, leading), decision


def _in_contact(state: MonitorState) -> bool:
    return state.touched and state.clear_s is None


def _leading(states: Mapping[str, MonitorState], before: str) -> str:
    """Return the plane whose decision counts; of planes in one state that of the
    largest force.
    """

    def rank(name: str) -> tuple[int, bool, int, float]:
        state = states[name]
        verdict = (
            state.frame.verdict if state.frame and state.frame.verdict.usable else None
        )
        stays = name == before and state.state in events.LATCHED
        force = (verdict.predicted, upper_end(verdict) or 0.0) if verdict else (-1, 0.0)

        return events.BY_SEVERITY.index(state.state), stays, *force

    return max(states, key=rank)


def _judged(
    state: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> tuple[MonitorState, _EventMeaning]:
    """Return the state that remembers an event, and its meaning."""
    try:
        remembered = remember(state, event, limits)
        return remembered, (
            _clock(state, event, limits)
            or _waiting(remembered, event, limits)
            or _meaning(state, remembered, event, limits)
        )
    except (
        Exception
    ) as error:  # any doubt ends in a withdrawal, also an object that is not an event
        return state, _alarm(Cause.EXCEPTION, f"{type(error).__name__}: {error}")


def _alarm(cause: Cause, reason: str) -> _EventMeaning:
    return _EventMeaning(Signal.ALARM, reason, cause)


def _clock(
    state: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> _EventMeaning | None:
    """Check the time of an event: is it finite, does it not go back, was there silence
    before it?
    """
    if not isfinite(event.at_s):
        return _alarm(Cause.NO_NUMBER, f"the time of an event is {event.at_s}")
    if state.at_s is not None and event.at_s < state.at_s:
        return _alarm(
            Cause.OUT_OF_ORDER,
            f"time went back by {from_si(state.at_s - event.at_s, 'ms'):.1f} ms",
        )

    silent_s = event.at_s - state.frame.since_s if state.frame else 0.0
    if state.state is not State.NOT_READY and not silent_s < limits.silence_s:
        if state.state is State.WITHDRAW and isinstance(event, events.Reset):
            return None  # refused, with its reason

        return _alarm(
            Cause.SILENCE, f"no frame for {from_si(limits.silence_s, 'ms'):.0f} ms"
        )

    return None


def _waiting(
    now: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> _EventMeaning | None:
    """Return the alarm for a second reader that stays away; before the first good frame
    there is no time limit.
    """
    waited_s = _waited(now, event.at_s)
    if (
        now.state is State.NOT_READY
        or waited_s < limits.opinion_s
        or isinstance(event, events.Reset)
    ):
        return None  # a reset is refused, with its reason

    return _alarm(
        Cause.NO_OPINION,
        f"no second opinion for {from_si(limits.opinion_s, 'ms'):.0f} ms",
    )


def _meaning(
    before: MonitorState, now: MonitorState, event: MonitorEvent, limits: MonitorLimits
) -> _EventMeaning:
    match event:
        case FrameRead():
            return _transport(before, now, event, limits) or _reading(
                now, event, limits
            )
        case events.SecondOpinion():
            if now.frame is None or not event.frame_id <= now.frame.frame_id:
                return _alarm(
                    Cause.OUT_OF_ORDER,
                    f"a second opinion on frame {event.frame_id}, which was not"
                    " read yet",
                )

            return _only_doubts(
                now,
                event.verdict,
                "second opinion",
                now.doubted,
                limits.unusable_opinions,
                limits,
            )
        case events.OvertakenRead(read=read):
            name = f"frame {read.frame_id}, overtaken"
            doubts = _only_doubts(
                now,
                read.verdict,
                name,
                now.unusable + 1,
                limits.unusable_frames,
                limits,
            )
            return doubts if doubts is not QUIET else _fallen(now, limits) or QUIET
        case events.Tick():
            return QUIET
        case events.Fault():
            return _alarm(event.cause, event.detail)
        case events.QueueLoss():
            return _loss(now, event, limits)
        case events.Reset():
            return _reset(now, event, limits)
        case _:
            assert_never(event)


def _transport(
    before: MonitorState, now: MonitorState, frame: FrameRead, limits: MonitorLimits
) -> _EventMeaning | None:
    """Return what is wrong with a frame before its reading counts: order, size, pixels,
    an old picture, delay.
    """
    if before.frame is not None and not frame.frame_id > before.frame.frame_id:
        return _alarm(
            Cause.OUT_OF_ORDER, f"frame {frame.frame_id} after {before.frame.frame_id}"
        )

    size = limits.size or before.size or frame.size
    if frame.size != size:
        return _alarm(Cause.SIZE, f"a frame of {frame.size} pixels, not {size}")

    scale_m = limits.scale_m or before.scale_m or frame.scale_m
    if not sound_pixels(frame.size, frame.scale_m) or not of_scale(
        frame.scale_m, scale_m, limits
    ):
        return _alarm(Cause.SCALE, f"pixels of {frame.scale_m} m, not {scale_m} m")
    if before.frame is not None and frame.pixel_type != before.frame.pixel_type:
        return _alarm(
            Cause.PIXEL_TYPE,
            f"pixels of type {frame.pixel_type}, {before.frame.pixel_type} before",
        )
    if now.repeats >= limits.frozen_frames:
        return _alarm(Cause.FROZEN, f"the same picture {now.repeats} times")
    if now.returns[-1] and sum(now.returns) >= limits.frozen_frames - 1:
        return _alarm(Cause.FROZEN, f"a picture of {frame.shown_back} frames ago")

    parts_s = frame.at_s - frame.since_s
    if not parts_s < limits.lag_s:
        parts_ms = from_si(parts_s, "ms")
        return _alarm(
            Cause.STALE,
            f"the first part of the frame came {parts_ms:.0f} ms before the last",
        )

    # which the quickest frames had
    lag_s = lag_of(frame)
    least = now.least_lag
    if lag_s is None or least is None or lag_s - least[1] < limits.lag_s:
        return None

    late_ms = from_si(lag_s - least[1], "ms")
    return _alarm(
        Cause.STALE, f"the frame is {late_ms:.0f} ms late after the time in its header"
    )


def _reading(
    now: MonitorState, frame: FrameRead, limits: MonitorLimits
) -> _EventMeaning:
    """Return the meaning of a frame's reading."""
    verdict = frame.verdict
    if wrong := unsound(verdict, limits):
        return _alarm(Cause.NO_NUMBER, wrong)
    if not verdict.usable:
        return _unusable(now, verdict.reason, now.unusable, limits.unusable_frames)

    upper_n = upper_end(verdict)
    rise = rise_of(now.history, limits.rate_frames)
    to_bound = None
    if upper_n is not None and verdict.force_n is not None and not now.pierced:
        to_bound = time_to_bound(rise, verdict.force_n, upper_n, limits.bound_n)

    harmful = harm(verdict, limits)
    fall = _fallen(now, limits)
    if fall and not (harmful and limits.reports_pierced):
        return fall
    if harmful:
        return _EventMeaning(Signal.ALARM, harmful[1], harmful[0], to_bound)

    if rise is not None and upper_n is not None and verdict.force_n is not None:
        risen_n = risen_force(rise, limits.reaction_s, limits.rate_deviations)
        if (
            risen_n is not None
            and risen_n + upper_n - verdict.force_n >= limits.bound_n
        ):
            within = (
                f"the bound is reached within {from_si(limits.reaction_s, 'ms'):.0f} ms"
            )
            return _EventMeaning(Signal.ALARM, within, Cause.RISING, to_bound)

    doubt = _doubt(now, frame.at_s, limits)
    signal = (
        Signal.HARMLESS
        if not doubt
        else Signal.TOLERATED
        if now.touched
        else Signal.UNJUDGED
    )

    return _EventMeaning(signal, doubt or "", to_bound=to_bound)


def _fallen(now: MonitorState, limits: MonitorLimits) -> _EventMeaning | None:
    """Return the meaning of a fall of the dent that nothing explains; None without one.

    A fall in a gap that may have been a withdrawal is none where a withdrawal was
    ordered.
    """
    fall = unexplained_fall(now.dents, limits)
    if fall is None:
        return None

    from_mn = from_si(fall.from_n, "mn")
    to_mn = from_si(fall.to_n, "mn")
    within_ms = from_si(fall.within_s, "ms")
    words = (
        f"the dent fell from {from_mn:.1f} to {to_mn:.1f} mN within {within_ms:.0f} ms"
    )
    if fall.pierced:
        signal = Signal.PIERCED if limits.reports_pierced else Signal.ALARM
        return _EventMeaning(signal, f"pierced: {words}", Cause.PIERCED)
    if now.state in events.LATCHED:
        return None

    unseen_ms = from_si(fall.unseen_s, "ms")
    reason = f"{words}, {unseen_ms:.0f} ms of it unseen: withdrawn or pierced"
    return _EventMeaning(Signal.ALARM, reason, Cause.UNSEEN_FALL)


def _only_doubts(
    now: MonitorState,
    verdict: Verdict,
    name: str,
    in_row: int,
    most: int,
    limits: MonitorLimits,
) -> _EventMeaning:
    """Return the meaning of a verdict that can only add a doubt; `in_row` unusable ones
    in a row end with this one.
    """
    if wrong := unsound(verdict, limits):
        return _alarm(Cause.NO_NUMBER, f"{name}: {wrong}")
    if not verdict.usable:
        return _unusable(
            now, f"{name}: {verdict.reason or 'cannot be judged'}", in_row, most
        )

    harmful = harm(verdict, limits)
    return _alarm(harmful[0], f"{name}: {harmful[1]}") if harmful else QUIET


def _doubt(now: MonitorState, at_s: float, limits: MonitorLimits) -> str | None:
    """Return the doubt that the second opinions leave; a cause in the last one has led
    to a withdrawal already.
    """
    if now.opinion is None:
        return (
            "the second opinion has not answered yet"
            if limits.expects_opinion
            else None
        )
    if not now.opinion.verdict.usable:
        return f"second opinion: {now.opinion.verdict.reason or 'cannot be judged'}"

    return (
        "the second opinion is not recent"
        if _waited(now, at_s) >= limits.opinion_s
        else None
    )


def _waited(now: MonitorState, at_s: float) -> float:
    """Return how long the oldest frame without a second opinion has waited, s."""
    return at_s - now.unanswered[0][1] if now.unanswered else 0.0


def _unusable(
    now: MonitorState, reason: str | None, in_row: int, most: int
) -> _EventMeaning:
    reason = reason or "the frame cannot be judged"
    if not now.touched:
        return _EventMeaning(Signal.UNJUDGED, reason)
    if in_row >= most:
        return _alarm(Cause.UNUSABLE, reason)
    return _EventMeaning(Signal.TOLERATED, reason)


def _loss(
    now: MonitorState, event: events.QueueLoss, limits: MonitorLimits
) -> _EventMeaning:
    if not (event.lost >= 1 and event.unread_s > 0.0):
        return _alarm(
            Cause.QUEUE_BEHIND, f"a loss of {event.lost} frames, {event.unread_s} s"
        )

    within_s = sum(unread_s for _, unread_s in now.losses)
    most_in_row_s = limits.loss_in_row_s + events.SLACK_S
    most_s = limits.loss_in_window_s + events.SLACK_S
    if now.lost_in_row_s <= most_in_row_s and within_s <= most_s:
        return QUIET

    row_ms = from_si(now.lost_in_row_s, "ms")
    within_ms = from_si(within_s, "ms")
    return _alarm(
        Cause.QUEUE_BEHIND,
        f"{row_ms:.0f} ms of frames lost in a row, {within_ms:.0f} ms within the"
        " window",
    )


def _reset(
    now: MonitorState, event: events.Reset, limits: MonitorLimits
) -> _EventMeaning:
    """Grant a reset only on fresh frames: harmless to both readers, in a row, the last
    one recent.
    """
    missing = _missing_for_reset(now, event.at_s, limits)
    if missing:
        return _EventMeaning(Signal.RESET_REFUSED, f"reset refused: {missing}")
    return _EventMeaning(Signal.RESET_GRANTED, "")


def _missing_for_reset(now: MonitorState, at_s: float, limits: MonitorLimits) -> str:
    """Return what a reset still needs, or "": frames first, since without them no
    opinion can come.
    """
    needed = "harmless frames in a row are needed"
    if now.frame is None:
        return f"no frame has come yet; {limits.fresh_frames} {needed}"

    silent_s = at_s - now.frame.since_s
    if not silent_s < limits.silence_s:
        return f"no frame for {silent_s:.1f} s; {limits.fresh_frames} {needed}"
    if now.fresh < limits.fresh_frames:
        reason = f"; {now.present_reason}" if now.present_reason else ""
        return f"{needed}, {now.fresh} of {limits.fresh_frames} came{reason}"

    return _doubt(now, at_s, limits) or ""


def _move(
    state: MonitorState, finding: _EventMeaning, limits: MonitorLimits
) -> MonitorState:
    """Follow the table; the first cause stays until the reset."""
    after = events.TRANSITIONS[state.state, finding.signal]
    fresh = {
        Signal.HARMLESS: state.fresh + 1,
        Signal.QUIET: state.fresh,
        Signal.RESET_REFUSED: state.fresh,
    }
    cause = state.cause
    reason = state.reason

    if after not in events.LATCHED:
        reason = "" if after is State.WATCHING else finding.reason or reason
    elif state.state is not after:
        cause = finding.cause
        reason = finding.reason

    keeps = finding.signal in (Signal.QUIET, Signal.RESET_REFUSED)
    pierced = state.pierced
    dents = state.dents
    counts_since_s = state.counts_since_s

    if finding.cause in (Cause.PIERCED, Cause.UNSEEN_FALL):  # a fall is found once
        dents = dents[-OUTSIDE:]
        counts_since_s = dents[0].at_s
    if finding.cause is Cause.PIERCED:  # harmless frames do not mend it
        pierced = finding.reason

    moved = replace(
        state,
        state=after,
        fresh=fresh.get(finding.signal, 0),
        opinion=None if finding.cause else state.opinion,
        cause=cause,
        reason=reason,
        pierced=pierced,
        dents=dents,
        counts_since_s=counts_since_s,
        present_cause=(
            state.present_cause
            if keeps
            else finding.cause or (Cause.PIERCED if pierced else None)
        ),
        present_reason=state.present_reason if keeps else finding.reason or pierced,
    )
    leaves = state.state in events.LATCHED and after is State.WATCHING

    return _released(moved, state, limits) if leaves else moved


def _released(
    moved: MonitorState, before: MonitorState, limits: MonitorLimits
) -> MonitorState:
    """End what was latched: nothing from before its fresh frames counts any more."""
    seen = [one.verdict for one in (before.frame, before.opinion) if one]
    history = before.history[-before.fresh :]
    since_s = history[0][0] if history else before.counts_since_s

    return replace(
        moved,
        cause=None,
        reason="",
        unusable=0,
        doubted=0,
        losses=(),
        lost_in_row_s=0.0,
        pierced="",
        touched=before.frame is None
        or any(touches(verdict, limits) for verdict in seen),
        history=history,
        dents=tuple(dent for dent in before.dents if dent.at_s >= since_s),
        counts_since_s=since_s,
        present_cause=None,
        present_reason="",
    )


def _decision(state: MonitorState, finding: _EventMeaning) -> Decision:
    words = [state.reason] if state.reason else []
    if state.frame is not None and state.frame.verdict.usable:
        words.append(f"class {state.frame.verdict.predicted}")
        if state.frame.verdict.force_n is not None:
            words.append(f"{from_si(state.frame.verdict.force_n, 'mn'):.1f} mN")

    if finding.reason and finding.reason not in words:
        words.append(finding.reason)

    message = f"{state.state.name}: {'; '.join(words)}" if words else state.state.name
    sub_code = state.cause.value if state.cause else 0
    present = (state.present_cause, state.present_reason)
    return Decision(
        state.state,
        state.cause,
        message,
        state.state.value,
        sub_code,
        *present,
        finding.to_bound,
    )
