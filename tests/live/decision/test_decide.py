"""The decision: the table is total, each cause withdraws at once and latches, and noise
does not cry wolf.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from scleraforce.base.errors import InputError
from scleraforce.live.decision.decide import (
    Decision,
    PlanesState,
    decide,
    decide_planes,
)
from scleraforce.live.decision.events import (
    Cause,
    Fault,
    FrameRead,
    MonitorEvent,
    OvertakenRead,
    QueueLoss,
    Reset,
    SecondOpinion,
    State,
    Tick,
)
from scleraforce.live.decision.limits import MonitorLimits, of_scale
from scleraforce.live.decision.state import MonitorState
from scleraforce.reading import force_trend
from scleraforce.records.verdict import Verdict

LIMITS = MonitorLimits()
NAN = float("nan")


def frame(
    number: int,
    force_n: float = 0.01,
    at_s: float | None = None,
    half_n: float = 1.5e-3,
) -> FrameRead:
    """A sound reading; at 100 Hz where no time is given."""
    shares = (1.0, 0.0, 0.0) if force_n < 5e-3 else (0.0, 1.0, 0.0)
    verdict = Verdict(
        predicted=0 if force_n < 5e-3 else 1,
        probabilities=shares,
        usable=True,
        reason=None,
        force_n=force_n,
        interval_n=(force_n - half_n, force_n + half_n),
    )
    at_s = 0.01 * number if at_s is None else at_s

    return FrameRead(
        at_s=at_s,
        frame_id=number,
        verdict=verdict,
        shown_back=0,
        size=(512, 512),
        scale_m=(1e-5, 5e-6),
    )


def readings(first: int, after: int, force_n: float = 0.01) -> list[FrameRead]:
    """Sound readings of one force."""
    return [frame(number, force_n) for number in range(first, after)]


Read = TypeVar("Read", FrameRead, SecondOpinion)


def judged(event: Read, **fields: Any) -> Read:
    """An event with other fields of its verdict."""
    return replace(event, verdict=replace(event.verdict, **fields))


REFUSED = {
    "usable": False,
    "predicted": 2,
    "probabilities": None,
    "force_n": None,
    "interval_n": None,
}


def unusable(number: int) -> FrameRead:
    return judged(frame(number), reason="no wall", **REFUSED)


def opinion(
    number: int, force_n: float = 0.01, at_s: float | None = None
) -> SecondOpinion:
    """A sound opinion on a frame, 5 ms after it where no time is given."""
    seen = frame(number, force_n)
    at_s = seen.at_s + 0.005 if at_s is None else at_s
    return SecondOpinion(at_s=at_s, frame_id=number, verdict=seen.verdict)


def no_opinion(number: int) -> SecondOpinion:
    return judged(opinion(number), reason="no wall was found", **REFUSED)


def both(*numbers: int, force_n: float = 0.01) -> list[MonitorEvent]:
    """Frames, each with its opinion."""
    return [
        event for n in numbers for event in (frame(n, force_n), opinion(n, force_n))
    ]


def play(
    events: Sequence[MonitorEvent],
    state: MonitorState | None = None,
    limits: MonitorLimits = LIMITS,
) -> MonitorState:
    state = state or MonitorState()
    for event in events:
        state, _ = decide(state, event, limits)
    return state


OK = State.WATCHING


def order(
    events: Sequence[MonitorEvent],
    state: MonitorState | None = None,
    limits: MonitorLimits = LIMITS,
) -> Cause | State:
    """Return the cause of a withdrawal after some events, or else the state; from
    `watching` on.
    """
    after = play(events, state or watching(), limits)
    return after.cause or after.state


def watching(force_n: float = 0.01) -> MonitorState:
    state = play(readings(1, 6, force_n=force_n))
    assert state.state is State.WATCHING
    return state


def withdrawn() -> MonitorState:
    return play([Fault(0.051, Cause.CHECKSUM, "CRC")], watching())


REPORTS = replace(LIMITS, reports_pierced=True)
THROUGH = [*readings(2, 5, force_n=0.024), frame(5, 0.007), frame(6, 0.0071)]


def pierced() -> MonitorState:
    """The state after a wall was pierced, reported only."""
    state = play(
        [
            replace(one, at_s=one.at_s - 0.01, frame_id=one.frame_id - 1)
            for one in THROUGH
        ],
        limits=REPORTS,
    )
    assert state.state is State.PIERCED

    return state


STATES = {
    State.NOT_READY: MonitorState,
    State.WATCHING: watching,
    State.PIERCED: pierced,
    State.WITHDRAW: withdrawn,
}
WRONG_NUMBERS = [
    {"force_n": NAN},
    {"interval_n": (0.0, NAN)},
    {"interval_n": (0.0, float("inf"))},
    {"interval_n": (0.02, 0.01)},
    {"probabilities": (NAN, 0.5, 0.5)},
    {"probabilities": None},
    {"probabilities": (0.5, 0.3, 0.1)},
    {"predicted": -1},
    {"force_n": None, "interval_n": None},
    {"usable": False, "force_n": NAN},
    {"elastic_force_n": NAN},
]
VERDICTS = [  # of any reader, each with the cause in it
    ({"predicted": 2, "probabilities": (0.0, 0.0, 1.0)}, Cause.DANGEROUS_CLASS),
    ({"force_n": 0.031, "interval_n": (0.0295, 0.0325)}, Cause.BOUND),
    ({"force_n": 0.0286, "interval_n": (0.0271, 0.0301)}, Cause.BOUND),
    *((wrong, Cause.NO_NUMBER) for wrong in WRONG_NUMBERS),
]
ALARMS = [
    *((judged(frame(6), **said), cause) for said, cause in VERDICTS),
    (Fault(0.06, Cause.CHECKSUM, "CRC"), Cause.CHECKSUM),
    (Fault(0.06, Cause.EXCEPTION, "ValueError"), Cause.EXCEPTION),
    (Fault(0.06, Cause.BAD_IMAGE, "short"), Cause.BAD_IMAGE),
    (QueueLoss(at_s=0.06, lost=5, unread_s=0.05, row=1), Cause.QUEUE_BEHIND),
    (QueueLoss(at_s=0.06, lost=0, unread_s=0.01, row=1), Cause.QUEUE_BEHIND),
    (QueueLoss(at_s=0.06, lost=1, unread_s=0.0, row=1), Cause.QUEUE_BEHIND),
    (QueueLoss(at_s=0.06, lost=NAN, unread_s=0.01, row=1), Cause.QUEUE_BEHIND),
    (frame(6, at_s=NAN), Cause.NO_NUMBER),
    (Tick(NAN), Cause.NO_NUMBER),
    ("nonsense", Cause.EXCEPTION),
    (replace(frame(6), scale_m=(NAN, 5e-6)), Cause.SCALE),
    (opinion(7, at_s=0.06), Cause.OUT_OF_ORDER),
    (opinion(5, at_s=NAN), Cause.NO_NUMBER),
]
AFTER_A_FRAME = [
    (Tick(0.1501), Cause.SILENCE),
    (frame(6, at_s=0.1501), Cause.SILENCE),
    (Reset(0.1501), Cause.SILENCE),
    (unusable(6), Cause.UNUSABLE),
    (frame(5, at_s=0.06), Cause.OUT_OF_ORDER),
    (frame(3, at_s=0.06), Cause.OUT_OF_ORDER),
    (Tick(0.03), Cause.OUT_OF_ORDER),
    (replace(frame(6), size=(512, 511)), Cause.SIZE),
    (replace(frame(6), scale_m=(1.1e-5, 5e-6)), Cause.SCALE),
    (replace(frame(6), scale_m=(1e-5, 5.1e-6)), Cause.SCALE),
]
OPINIONS = [
    *((judged(opinion(5), **said), cause) for said, cause in VERDICTS),
    (opinion(5, at_s=0.03), Cause.OUT_OF_ORDER),
]
OVERTAKEN = [
    (OvertakenRead(0.0505, judged(frame(4), **said)), cause) for said, cause in VERDICTS
]
SIGNALS = {
    "harmless frame": [frame(6)],
    "unusable frame, tolerated": [frame(6), unusable(7)],
    "unusable frame before contact": [unusable(6)],
    "nothing new": [Tick(0.06)],
    "cause of a withdrawal": [Fault(0.06, Cause.EXCEPTION, "error")],
    "wall pierced, to be reported only": [
        *map(frame, range(6, 9), [0.024] * 3),
        frame(9, 0.007),
        frame(10, 0.0071),
    ],
    "reset after fresh harmless frames": [*map(frame, range(6, 11)), Reset(0.105)],
    "reset, refused": [Reset(0.06)],
}
CODES = {"NOT_READY": 13, "WATCHING": 1, "PIERCED": 14, "WITHDRAW": 3}
PAGE = Path(__file__).parents[3] / "docs" / "monitor_decision.md"
# the diagram of the page: (before, signal) to after
MOVES = {
    (before, signal): State[after]
    for before, after, signal in re.findall(
        r"^    (\w+) --> (\w+): (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
}


def test_only_a_granted_reset_leaves_a_withdrawal_and_every_alarm_leads_there():
    alarm = "cause of a withdrawal"
    granted = "reset after fresh harmless frames"
    assert {signal for _, signal in MOVES} <= SIGNALS.keys()
    assert {signal for before, signal in MOVES if before == "WITHDRAW"} == {granted}
    assert {signal for before, signal in MOVES if before == "PIERCED"} == {
        granted,
        alarm,
    }
    assert {
        before for before, signal in MOVES if signal == alarm
    } == State.__members__.keys() - {"WITHDRAW"}
    assert {signal for (_, signal), after in MOVES.items() if after is OK} == {
        "harmless frame",
        granted,
    }


@pytest.mark.parametrize(
    ("before", "signal"),
    [*product(State, SIGNALS)],
    ids=lambda one: getattr(one, "name", one),
)
def test_decide_follows_the_diagram(before, signal):
    state = STATES[before]()
    *events, last = SIGNALS[signal]
    limits = {
        "unusable frame, tolerated": replace(REPORTS, unusable_frames=2),
        "wall pierced, to be reported only": REPORTS,
    }.get(signal, LIMITS)

    if signal == "unusable frame before contact":
        state = replace(state, touched=False)
    if before in (State.WATCHING, State.PIERCED) and signal == "reset, refused":
        state = replace(state, fresh=1)

    state = play(events, state, limits)
    # NOT_READY cannot meet what needs frames: it is WATCHING by then
    here = state.state
    after, decision = decide(state, last, limits)
    assert after.state is MOVES.get((here.name, signal), here)
    assert decision.code == CODES[after.state.name]


@pytest.mark.parametrize("before", State)
@pytest.mark.parametrize(("event", "cause"), ALARMS)
def test_each_cause_withdraws_at_once_in_every_state(event, cause, before):
    state, decision = decide(STATES[before](), event, LIMITS)
    assert (decision.state, decision.code) == (State.WITHDRAW, 3)
    assert decision.cause is (Cause.CHECKSUM if before is State.WITHDRAW else cause)
    assert decision.sub_code == decision.cause.value
    assert state.fresh == 0


@pytest.mark.parametrize(("event", "cause"), AFTER_A_FRAME)
def test_each_cause_withdraws_after_a_frame(event, cause):
    assert order([event]) is cause


def shown(backs: Sequence[int]) -> list[MonitorEvent]:
    """Frames from 6 on, each with how many frames ago its picture was shown last."""
    return [replace(frame(6 + n), shown_back=back) for n, back in enumerate(backs)]


def test_the_same_picture_three_times_is_frozen():
    assert order(shown([0, 1])) is OK
    assert order(shown([0, 1, 1])) is Cause.FROZEN
    # each twice: a scanner of half the rate
    assert order(shown([0, 1] * 40)) is OK


def test_old_pictures_in_turns_are_frozen_with_the_second_one():
    for pictures in (2, 3, 10, 49):
        assert order(shown([0] * 60 + [pictures])) is OK
        assert order(shown([0] * 60 + [pictures] * 2)) is Cause.FROZEN

    # An old picture between live ones: the second time within the window.
    assert order(shown([0, 2, 0, 2])) is Cause.FROZEN
    assert order(shown([0, 2, *[0] * 47, 2])) is Cause.FROZEN
    assert order(shown([0, 2, *[0] * 50, 2, 0])) is OK


def reset_after(events: Sequence[MonitorEvent], state: MonitorState) -> Decision:
    """Return the answer to a reset just after some events."""
    state = play(events, state)
    return decide(state, Reset(state.at_s or 0.0), LIMITS)[1]


def late(
    lags_s: Sequence[float], ahead_s: float = 1.8e9, rate_hz: float = 100.0
) -> list[MonitorEvent]:
    """Frames from 6 on, each so long after the time that its sender states, whose clock
    is ahead.
    """
    times_s = [0.05 + (n + 1) / rate_hz for n in range(len(lags_s))]
    return [
        replace(frame(6 + n, at_s=at_s), sent_s=at_s - lag_s + ahead_s)
        for n, (at_s, lag_s) in enumerate(zip(times_s, lags_s, strict=True))
    ]


@pytest.mark.parametrize("ahead_s", [0.0, 1.8e9, -1e6])
def test_frames_that_come_much_later_than_the_quickest_one_are_stale(
    ahead_s,
):
    jitter = [0.003, 0.02, 0.08, 0.002, 0.1, 0.004]
    assert order(late(jitter * 50, ahead_s)) is OK
    assert order(late([*jitter, 0.105], ahead_s)) is Cause.STALE
    queue = [0.005 + 0.001 * n for n in range(120)]
    assert order(late(queue[:98], ahead_s)) is OK
    assert order(late(queue, ahead_s)) is Cause.STALE


def test_frames_may_state_no_time_and_none_that_is_no_number():
    assert order(readings(6, 40)) is OK
    no_number = replace(frame(12), sent_s=NAN)
    assert order([*late([0.005] * 5), no_number]) is Cause.STALE


@pytest.mark.slow
def test_a_clock_may_drift_for_hours_and_a_queue_that_grows_faster_is_stale():
    patient = replace(LIMITS, silence_s=2.0)

    def hours(drift, count):
        lags_s = [drift * second for second in range(round(3600 * count))]
        return play(late(lags_s, rate_hz=1.0), watching(), patient)

    for drift in (0.9e-4, -0.9e-4, -0.5):
        assert hours(drift, 2.0).state is State.WATCHING

    assert hours(3e-4, 0.1).state is State.WATCHING  # 72 ms
    assert hours(3e-4, 0.2).cause is Cause.STALE


def test_what_stays_late_gets_no_reset_and_a_clock_set_ahead_is_the_new_measure():
    for before, cause in ((watching(), Cause.STALE), (withdrawn(), Cause.CHECKSUM)):
        refused = reset_after(late([0.005] * 5 + [3.0] * 20), before)
        assert (refused.code, refused.sub_code) == (3, cause.value)
        # what is wrong now, not the first cause
        assert "late after the time in its header" in refused.message
        assert "0 of 5 came" in refused.message

    assert order(late([0.005] * 5 + [-2.0] * 20)) is OK
    assert order(late([0.005] * 5 + [-2.0] * 20 + [-1.89])) is Cause.STALE


def test_one_frame_from_the_future_makes_no_other_late():
    for future in ([-3600.0], [-3600.0, -0.09], [-0.09]):
        assert order(late([0.005] * 5 + future + [0.08] * 30)) is OK

    assert order(late([-3600.0, *[0.005] * 30])) is OK
    assert order(late([0.005] * 5 + [-3600.0] + [0.005] * 5 + [0.12])) is Cause.STALE


def test_one_unread_frame_far_ahead_is_not_waited_for_for_ever():
    expects = replace(LIMITS, expects_opinion=True)
    state = play(both(*range(1, 6)), limits=expects)
    events = [
        replace(frame(6), frame_id=10**6),
        *readings(7, 12),
        replace(opinion(8), frame_id=9),
    ]
    waiting = play(events, state, expects).unanswered
    assert [number for number, _ in waiting] == [10, 11]
    thinned = replace(state, unanswered=((10**6, 0.06), (7, 0.07), (9, 0.09)))
    assert [
        number
        for number, _ in play(
            [opinion(8)], replace(thinned, frame=frame(9)), expects
        ).unanswered
    ] == [9]


@pytest.mark.parametrize(("first", "begun"), [(1, MonitorState), (6, watching)])
@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ({"frame_id": 2 * 10**15}, Cause.OUT_OF_ORDER),
        ({"at_s": 1e9}, Cause.SILENCE),
        ({"size": (512, 500)}, Cause.SIZE),
        ({"scale_m": (2e-5, 5e-6)}, Cause.SCALE),
        ({"pixel_type": "uint8"}, Cause.PIXEL_TYPE),
    ],
)
def test_one_wrong_frame_withdraws_and_makes_no_later_reset_impossible(
    wrong, cause, first, begun
):
    state = play([replace(frame(first), **wrong), frame(first + 1)], begun())
    assert first == 1 or state.cause is cause
    assert state.state is State.WITHDRAW
    assert reset_after(readings(8, 13), state).code == 1


def test_a_size_and_a_scale_that_are_declared_stay_declared():
    for limits in (
        replace(LIMITS, size=(512, 511)),
        replace(LIMITS, scale_m=(2e-5, 5e-6)),
    ):
        state = play(readings(1, 12), limits=limits)
        assert decide(state, Reset(0.115), limits)[1].code == 3


def test_pixel_types_in_turns_are_a_cause_with_each_change():
    turns = [
        replace(frame(n), pixel_type=("uint8", "uint16")[n % 2]) for n in range(6, 30)
    ]
    state = play(
        turns, replace(watching(), frame=replace(frame(5), pixel_type="uint16"))
    )
    assert state.cause is Cause.PIXEL_TYPE
    assert state.fresh == 0


def test_the_present_cause_is_given_beside_the_first_one():
    state = play([Tick(0.2)], watching())
    assert (state.cause, state.present_cause) == (Cause.SILENCE, Cause.SILENCE)
    state, decision = decide(play([frame(20, 0.039)], state), frame(21, 0.039), LIMITS)
    assert (decision.cause, decision.present_cause) == (Cause.SILENCE, Cause.BOUND)
    assert "39.0 mN" not in decision.present
    assert "up to 40.5 mN" in decision.present
    state, decision = decide(state, Tick(0.211), LIMITS)
    assert decision.present_cause is Cause.BOUND
    _, decision = decide(state, frame(22), LIMITS)
    assert (decision.cause, decision.present_cause, decision.present) == (
        Cause.SILENCE,
        None,
        "",
    )


def test_losses_add_up_within_the_window_and_are_forgotten_after_it():
    def losing(every):
        events = []
        for n in range(6, 300):
            events += [frame(n)] + (
                [QueueLoss(at_s=0.01 * n, lost=1, unread_s=0.01, row=n)]
                if n % every == 0
                else []
            )

        return events

    assert order(losing(10)) is Cause.QUEUE_BEHIND
    state = play(losing(25), watching())
    assert state.state is State.WATCHING
    assert state.lost == 11


@pytest.mark.parametrize("interval_s", [0.02, 0.01, 0.001])
def test_losses_are_limited_in_time_whatever_the_frame_rate(interval_s):
    before = replace(watching(), at_s=0.051)

    def losses(count, lost, row, step_s):
        unread_s = lost * interval_s
        return [
            QueueLoss(
                at_s=0.052 + step_s * n, lost=lost, unread_s=unread_s, row=row * n
            )
            for n in range(round(count))
        ]

    in_row = losses(0.04 / interval_s + 1, 1, 0, 1e-5)
    assert order(in_row[:-1], before) is OK
    assert order(in_row, before) is Cause.QUEUE_BEHIND
    lost = max(1, round(0.004 / interval_s))  # of a row that counts
    apart = losses(0.08 / interval_s / lost, lost, 1, 1e-4)
    assert order(apart, before) is OK
    again = replace(apart[0], row=99, at_s=0.07)
    assert order([*apart, again], before) is Cause.QUEUE_BEHIND


def test_short_rows_do_not_count_while_ten_readings_come_within_the_reaction_time():
    """At 1,000 frames a second: of each `lost + 1` frames one is read; from four lost
    ones on they count.
    """

    def losing(lost, parts, limits=LIMITS, interval_s=0.001):
        events = []
        for n in range(600 // (lost + 1)):
            at_s = 0.051 + interval_s * (lost + 1) * n
            part = QueueLoss(
                at_s=at_s,
                lost=lost // parts,
                unread_s=interval_s * (lost // parts),
                row=n,
            )
            events += [replace(frame(6 + n), at_s=at_s), *[part] * parts]

        return play(events, watching(), limits)

    for lost in (1, 2, 3):
        assert losing(lost, 1).state is losing(lost, lost).state is State.WATCHING

    assert (
        losing(4, 1).cause
        is losing(4, 2).cause
        is losing(4, 4).cause
        is Cause.QUEUE_BEHIND
    )
    # the interval is a mean of arrivals, and somewhat longer on a busy machine
    assert losing(3, 1, interval_s=1.03e-3).state is State.WATCHING
    assert losing(3, 1, interval_s=1.1e-3).cause is Cause.QUEUE_BEHIND
    assert losing(1, 1, replace(LIMITS, reaction_s=0.01)).cause is Cause.QUEUE_BEHIND
    (_, in_parts), (_, at_once) = (
        losing(6, parts, replace(LIMITS, loss_in_window_s=1.0)).losses[-1]
        for parts in (3, 1)
    )
    assert in_parts == pytest.approx(at_once)


def test_a_row_that_counts_is_forgotten_while_short_ones_follow():
    long = QueueLoss(at_s=0.052, lost=30, unread_s=0.03, row=1)
    events = [replace(long, at_s=0.052 + 0.6 * n, row=n) for n in range(6)]
    frames = [replace(frame(6 + n), at_s=0.053 + 0.01 * n) for n in range(360)]
    short = [
        replace(long, at_s=at.at_s, lost=1, unread_s=0.001, row=100 + n)
        for n, at in enumerate(frames)
    ]
    both = sorted([*events, *frames, *short], key=lambda event: event.at_s)
    assert order(both) is OK


def test_what_is_remembered_of_losses_stays_short_and_is_never_forgotten_too_early():
    # so that each loss counts
    loose = replace(LIMITS, loss_in_window_s=10.0, reaction_s=1e-4)
    state = watching()

    for n in range(2500):
        at_s = 0.06 + 5e-4 * n
        loss = QueueLoss(at_s=at_s, lost=1, unread_s=1e-4, row=n)
        state = play([replace(frame(6 + n), at_s=at_s), loss], state, loose)
        expected_s = 1e-4 * min(n + 1, 2000)
        held_s = sum(unread_s for _, unread_s in state.losses)
        assert expected_s - 1e-9 <= held_s <= expected_s + 100 * 1e-4 + 1e-9
        assert len(state.losses) <= 21


def test_before_the_first_good_frame_nothing_is_ok():
    loss = QueueLoss(at_s=6.02, lost=1, unread_s=0.01, row=1)
    assert (
        order(
            [Tick(0.0), unusable(1), Tick(5.0), unusable(600), Reset(6.01), loss],
            MonitorState(),
        )
        is State.NOT_READY
    )


def test_an_unusable_frame_before_contact_is_not_ok_but_needs_no_reset():
    state = play([unusable(6)], watching(force_n=1e-3))
    assert state.state is State.NOT_READY
    assert order([frame(7, 1e-3)], state) is OK


OPINED = MonitorLimits(expects_opinion=True)


def not_ready() -> MonitorState:
    """After frames that cannot be judged."""
    return play([unusable(n) for n in range(1, 6)])


@pytest.mark.parametrize("limits", [LIMITS, OPINED])
@pytest.mark.parametrize("before", [not_ready, watching, withdrawn])
@pytest.mark.parametrize(("event", "cause"), [*OPINIONS, *OVERTAKEN])
def test_a_second_opinion_withdraws_at_once_in_every_state(
    event,
    cause,
    before,
    limits,
):
    """So does the reading of an overtaken frame."""
    state, decision = decide(before(), event, limits)
    assert decision.code == 3
    assert decision.cause is (Cause.CHECKSUM if before is withdrawn else cause)
    assert state.fresh == 0


def test_an_overtaken_frame_that_cannot_be_judged_counts_with_the_answered_ones():
    late = OvertakenRead(0.0755, unusable(4))
    twice = replace(LIMITS, unusable_frames=2)
    assert order([late]) is Cause.UNUSABLE
    assert order([late], not_ready()) is State.NOT_READY
    assert order([late], limits=twice) is OK
    assert order([unusable(6), late], limits=twice) is Cause.UNUSABLE


def test_a_harmless_overtaken_frame_changes_the_histories_and_an_opinion_no_state():
    for before in (not_ready, watching, withdrawn):
        state = before()
        after = play([OvertakenRead(0.0515, frame(4, 0.011))], state)
        same = {"history": state.history, "dents": state.dents}
        assert replace(after, **same) == replace(state, at_s=0.0515)
        assert after.history == tuple(sorted([*state.history, (0.04, 0.011)]))
        assert [dent.at_s for dent in after.dents] == [
            at_s for at_s, _ in after.history
        ]
        assert play([opinion(5, at_s=0.0505)], state, OPINED).state is state.state


def test_opinions_that_cannot_judge_withdraw_after_contact_and_wait_before_it():
    state = play([no_opinion(5), frame(6), no_opinion(6), frame(7)], watching())
    assert state.state is State.WATCHING
    assert order([no_opinion(7)], state) is Cause.UNUSABLE
    assert order([opinion(7), frame(8), no_opinion(8)], state) is OK
    before = play([no_opinion(5)], watching(force_n=1e-3))
    assert before.state is State.NOT_READY
    assert order([frame(6, 1e-3), frame(7, 1e-3)], before) is State.NOT_READY, (
        "the network alone is not enough"
    )
    assert order([frame(6, 1e-3), opinion(6, 1e-3), frame(7, 1e-3)], before) is OK


def test_opinions_that_cannot_judge_have_a_count_of_their_own():
    limits = MonitorLimits(unusable_frames=2, unusable_opinions=2)
    state = play([no_opinion(5), unusable(6)], watching(), limits)
    assert state.state is State.WATCHING
    assert (
        order([replace(no_opinion(6), at_s=0.065)], state, limits=limits)
        is Cause.UNUSABLE
    )
    again = play([frame(7), opinion(7), frame(8), no_opinion(8)], state, limits)
    assert again.state is State.WATCHING


def test_contact_that_only_the_second_opinion_sees_is_contact():
    state = watching(force_n=1e-3)
    assert order([unusable(6)], state) is State.NOT_READY
    assert order([opinion(5, 0.003), unusable(6)], state) is Cause.UNUSABLE


def test_nothing_is_ok_before_the_first_opinion_where_one_is_expected():
    state = play(readings(1, 300), limits=OPINED)
    assert (state.state, state.reason) == (
        State.NOT_READY,
        "the second opinion has not answered yet",
    )
    assert order([opinion(299), frame(300)], state, OPINED) is OK
    assert order(readings(1, 300), MonitorState()) is OK


@pytest.mark.parametrize(
    ("came", "asked_s", "words"),
    [
        ([], 20.0, "refused: no frame for 19.9 s; 5 harmless frames in a row are"),
        (
            [frame(2000), frame(2001)],
            20.02,
            "0 of 5 came; the second opinion has not answered",
        ),
        ([*both(2000, 2001), frame(2002)], 20.03, "2 of 5 came"),
        ([frame(2000), frame(2001, 0.045)], 20.02, "0 of 5 came; up to 46.5 mN"),
    ],
    ids=["frames have ended", "no opinion", "too few", "harmful"],
)
def test_a_refused_reset_says_what_is_missing(came, asked_s, words):
    """After a replay had ended, it blamed the second opinion, which had nothing to
    read.
    """
    ended = play([*both(*range(1, 11)), Tick(0.21)], limits=OPINED)
    assert (ended.state, ended.cause) == (State.WITHDRAW, Cause.SILENCE)
    _, decision = decide(play(came, ended, OPINED), Reset(asked_s), OPINED)
    assert decision.code == 3
    assert words in decision.message


def test_a_reset_before_any_frame_says_so():
    withdrawn_before = play([Fault(0.01, Cause.EXCEPTION, "the disk is full")])
    _, decision = decide(withdrawn_before, Reset(0.02), LIMITS)
    assert "reset refused: no frame has come yet" in decision.message


def test_after_a_pause_before_contact_an_old_opinion_does_not_count():
    """The last frame before the pause got none: that is not a cause, but nothing is OK
    before the next opinion.
    """
    before = play([*both(1, 2, force_n=1e-3), unusable(3)], limits=OPINED)
    assert before.state is State.NOT_READY
    after = readings(1000, 1005)
    assert order(after, before, OPINED) is State.NOT_READY
    assert order([*after, opinion(1004), frame(1005)], before, OPINED) is OK


def test_a_second_reader_that_has_gone_is_a_cause():
    for kind in ("frame", "tick"):
        state = play(both(*range(1, 11)), limits=OPINED)
        assert state.state is State.WATCHING
        # the first that gets none comes at 0.11 s
        frames = readings(11, 61)
        assert order(frames, state, OPINED) is OK
        last = frame(61) if kind == "frame" else Tick(0.61)
        assert order([*frames, last], state, OPINED) is Cause.NO_OPINION
        assert order([*frames, last], state) is OK, "where none is expected"


def test_an_opinion_answers_for_all_frames_up_to_its_own():
    events = []
    for n in range(1, 1000):
        events.append(frame(n))
        if n % 45 == 0:
            events.append(opinion(n - 2, at_s=0.01 * n + 0.005))

    state = play(events, limits=OPINED)
    assert state.state is State.WATCHING
    assert state.unanswered[0][0] == 989
    assert order(events[:-30], MonitorState(), OPINED) is OK


def test_what_waits_for_an_opinion_does_not_grow_and_keeps_the_oldest():
    state = MonitorState()
    for n in range(1, 500):
        state, _ = decide(state, frame(n), OPINED)
        assert len(state.unanswered) <= 128
    assert state.unanswered[0][0] == 1


def test_a_reset_needs_the_second_opinion_too():
    state = play(
        [*both(*range(1, 6)), Fault(0.056, Cause.CHECKSUM, "CRC")], limits=OPINED
    )
    alone = readings(6, 16)
    assert order([*alone, Reset(0.151)], state, OPINED) is Cause.CHECKSUM
    agreed = [*both(*range(6, 12)), Reset(0.116)]
    assert order(agreed, state, OPINED) is OK
    assert (
        order(
            [*agreed[:-1], replace(no_opinion(11), at_s=0.1155), agreed[-1]],
            state,
            limits=OPINED,
        )
        is Cause.CHECKSUM
    )
    overdue = [*both(*range(6, 12)), *readings(12, 70), Reset(0.691)]
    assert order(overdue, state, OPINED) is Cause.CHECKSUM


def test_a_client_that_starts_counting_again_can_be_reset():
    for limits in (LIMITS, OPINED):
        state = play(
            [*readings(1, 6), Fault(0.051, Cause.CHECKSUM, "CRC")],
            limits=limits,
        )
        for n in range(1, 9):
            at_s = 0.06 + 0.01 * n
            opined = [opinion(n, at_s=at_s + 0.005)] if limits is OPINED else []
            state = play([frame(n, at_s=at_s), *opined], state, limits)

        after = play([Reset(0.146)], state, limits)
        assert (after.state, after.unanswered) == (State.WATCHING, ())


def test_a_needle_that_is_lifted_off_may_be_placed_anew():
    lifted = [frame(n, 3e-4) for n in range(6, 57)]
    assert order([*lifted, unusable(57)], watching(4e-3)) is State.NOT_READY
    assert order([*lifted[:-1], unusable(56)], watching(4e-3)) is Cause.UNUSABLE, (
        "half a second is needed"
    )
    assert (
        order(
            [*lifted[:30], frame(36, 2.1e-3), *lifted[31:], unusable(57)],
            watching(4e-3),
        )
        is Cause.UNUSABLE
    )
    seen = opinion(30, 2.1e-3, at_s=0.305)
    assert (
        order([*lifted[:25], seen, *lifted[25:], unusable(57)], watching(4e-3))
        is Cause.UNUSABLE
    )
    assert (
        order([*lifted, frame(57), unusable(58)], watching(4e-3)) is Cause.UNUSABLE
    ), "it touches again"


def test_a_bad_first_frame_does_not_set_size_and_scale():
    small = replace(unusable(1), size=(100, 100), scale_m=(1.0, 1.0))
    state = play([small, frame(2), frame(3)])
    assert (state.state, state.size, state.scale_m) == (
        State.WATCHING,
        (512, 512),
        (1e-5, 5e-6),
    )
    assert order([replace(frame(4), size=(100, 100))], state) is Cause.SIZE
    assert (
        order([replace(frame(1), scale_m=(0.0, 1e-5))], MonitorState()) is Cause.SCALE
    )


def test_a_classifier_reads_no_force():
    read = judged(frame(1), force_n=None, interval_n=None)
    limits = MonitorLimits(reads_force=False)
    assert order([read], MonitorState(), limits=limits) is OK
    assert order([read, unusable(2)], MonitorState(), limits=limits) is Cause.UNUSABLE


def test_a_reset_needs_fresh_harmless_frames_in_a_row():
    fresh = readings(6, 11)
    assert order([Reset(0.052)], withdrawn()) is Cause.CHECKSUM
    assert order([*fresh[:4], Reset(0.091)], withdrawn()) is Cause.CHECKSUM
    assert order([*fresh, Reset(0.101)], withdrawn()) is OK
    assert (
        order([*fresh[:4], unusable(10), frame(11), Reset(0.111)], withdrawn())
        is Cause.CHECKSUM
    )
    assert (
        order([*fresh[:4], frame(10, 0.029), Reset(0.101)], withdrawn())
        is Cause.CHECKSUM
    )
    assert (
        order(
            [*fresh, Fault(0.101, Cause.EXCEPTION, "error"), Reset(0.102)], withdrawn()
        )
        is Cause.CHECKSUM
    )
    assert order([*fresh, Reset(0.2001)], withdrawn()) is Cause.CHECKSUM, (
        "the frames are not fresh any more"
    )


def test_after_the_reset_it_watches_as_before():
    state = play([*readings(6, 11), Reset(0.101)], withdrawn())
    assert (state.cause, state.fresh, state.touched) == (None, 0, True)

    for event, cause in (
        (frame(11, 0.031), Cause.BOUND),
        (unusable(11), Cause.UNUSABLE),
        (Tick(0.21), Cause.SILENCE),
    ):
        assert play([event], state).cause is cause


DIRTY = [event for event, _ in (*ALARMS, *AFTER_A_FRAME, *OPINIONS, *OVERTAKEN)]


@st.composite
def sequences(draw: st.DrawFn) -> list[MonitorEvent]:
    """Frames, ticks, resets and faults in any order, at increasing times."""
    events: list[MonitorEvent] = []
    now_s = 0.0

    for number in range(1, draw(st.integers(5, 60))):
        now_s += draw(st.sampled_from([0.001, 0.01, 0.01, 0.01, 0.11]))
        force_n = draw(st.sampled_from([0.001, 0.01, 0.01, 0.02, 0.02, 0.029, NAN]))
        plain = frame(number, force_n, now_s)
        seen = [
            opinion(number - 1, 0.01, now_s),
            replace(no_opinion(number - 1), at_s=now_s),
        ]
        choices: list[MonitorEvent] = [
            *[plain] * 8,
            *seen * 2,
            Tick(now_s),
            Reset(now_s),
        ]
        choices += [
            replace(unusable(number), at_s=now_s),
            QueueLoss(at_s=now_s, lost=1, unread_s=0.01, row=1),
        ]
        choices += [
            OvertakenRead(now_s, frame(number - 1)),
            OvertakenRead(now_s, unusable(number - 1)),
        ]
        events.append(draw(st.sampled_from([*choices, draw(st.sampled_from(DIRTY))])))

    return events


def harmless(event: MonitorEvent) -> bool:
    interval_n = (
        event.verdict.interval_n
        if isinstance(event, FrameRead) and event.verdict.usable
        else None
    )
    return interval_n is not None and interval_n[1] < 0.03


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(sequences(), st.sampled_from([LIMITS, OPINED, REPORTS]))
def test_no_sequence_ends_a_withdrawal_without_a_reset_or_is_ok_before_a_good_frame(
    events, limits
):
    latched = (State.PIERCED, State.WITHDRAW)
    state = MonitorState()
    good = False
    seen = False

    for event in events:
        before = state
        state, decision = decide(state, event, limits)
        seen = seen or (isinstance(event, SecondOpinion) and event.verdict.usable)
        assert seen or not limits.expects_opinion or decision.code != 1
        good = good or harmless(event)
        assert good or decision.code != 1

        if before.state in latched and state.state not in latched:
            assert isinstance(event, Reset)
            assert before.fresh >= LIMITS.fresh_frames

        assert (decision.code in (3, 14)) == (decision.cause is not None)
        assert len(state.history) <= 5 * LIMITS.rate_frames
        assert len(state.losses) <= 21
        if isinstance(event, FrameRead) and not harmless(event):
            assert decision.code != 1


def sessions(seed: int, seconds: float) -> Decision:
    """A slow wander of the true force between 0 and 25 mN, read at 100 Hz with
    noise.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(1, int(100 * seconds)) / 100
    periods_s = rng.uniform(4.0, 20.0, 3)
    wander = np.mean(
        [
            np.sin(2 * np.pi * time_s / period + rng.uniform(0, 6))
            for period in periods_s
        ],
        axis=0,
    )
    force_n = 12.5e-3 * (1 + wander) + rng.normal(0, 0.5e-3, len(time_s))
    state = MonitorState()

    for number, value in enumerate(force_n, 1):
        state, decision = decide(state, frame(number, float(value)), LIMITS)
        if decision.code == 3:
            break

    return decision


def test_noise_below_25_mn_does_not_cry_wolf():
    assert all(sessions(seed, 4.0).code == 1 for seed in range(5))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_no_session_of_60_s_below_25_mn_is_withdrawn_from(seed):
    assert sessions(seed, 60.0).code == 1


def force_at_withdrawal(rate_n_s: float, seed: int) -> tuple[float, Cause | None]:
    rng = np.random.default_rng(seed)
    for number in range(1, 5000):
        if number == 1:
            state = MonitorState()
        true_n = rate_n_s * 0.01 * number
        state, decision = decide(
            state, frame(number, true_n + rng.normal(0, 0.5e-3)), LIMITS
        )
        if decision.code == 3:
            return true_n, decision.cause

    raise AssertionError("no withdrawal")


def test_ramps_are_withdrawn_from_before_the_bound():
    for rate_mn_s in (5, 10, 20, 50, 100):
        forces_n = [force_at_withdrawal(rate_mn_s * 1e-3, seed)[0] for seed in range(5)]
        assert 0.02 < min(forces_n) <= max(forces_n) <= LIMITS.bound_n


def test_a_steep_ramp_is_foreseen():
    assert force_at_withdrawal(0.1, 0)[1] is Cause.RISING


def risen_force(
    history: tuple[tuple[float, float], ...], ahead_s: float, deviations: float
) -> float | None:
    line = force_trend.rise_of(history, 10)
    return None if line is None else force_trend.risen_force(line, ahead_s, deviations)


def test_a_rise_that_slows_down_is_not_foretold_from_how_it_began():
    # 50 mN/s, then a hold
    slowing = tuple((0.01 * n, 0.02 + 0.05 * 0.01 * min(n, 5)) for n in range(10))
    assert risen_force(slowing, 0.05, 3.0) is None
    # 100, in the end 28 mN/s
    bending = tuple((0.01 * n, 0.02 + 1e-3 * n - 4e-5 * n * n) for n in range(10))
    steady = tuple((0.01 * n, 0.02 + 1e-3 * n) for n in range(10))
    assert risen_force(steady, 0.05, 0.0) == pytest.approx(0.034)
    # the parabola's top
    assert risen_force(bending, 0.05, 0.0) == pytest.approx(
        0.02 + 12.5e-3 - 4e-5 * 12.5**2
    )
    # on the way to it
    assert risen_force(bending, 0.02, 0.0) == pytest.approx(0.02 + 11e-3 - 4e-5 * 11**2)


def test_a_rise_that_quickens_is_foretold_by_its_line_and_one_wild_frame_hides_no_rise():
    quickening = tuple((0.01 * n, 0.02 + 2e-4 * n + 4e-5 * n * n) for n in range(10))
    line = risen_force(quickening, 0.05, 0.0)
    assert line is not None
    assert line > quickening[-1][1] + 0.05 * 0.03
    steep = [(0.01 * n, 0.02 + 1e-3 * n) for n in range(10)]

    for place in range(10):
        wild = [
            (at_s, force_n - 8e-3 * (n == place))
            for n, (at_s, force_n) in enumerate(steep)
        ]
        assert risen_force(tuple(wild), 0.05, 0.0) == pytest.approx(0.034, abs=0.3e-3)


def test_ten_frames_in_a_line_by_chance_do_not_rise_steeply_after_rough_ones():
    rng = np.random.default_rng(0)
    line = tuple((0.4 + 0.01 * n, 0.02 + 0.05 * 0.01 * n) for n in range(10))
    rough = tuple((0.01 * n, 0.02 + float(rng.normal(0.0, 0.9e-3))) for n in range(40))
    alone = risen_force(line, 0.05, 3.0)
    after = risen_force(rough + line, 0.05, 3.0)
    assert alone == pytest.approx(0.027)
    assert after is None or after < 0.0265
    assert risen_force(line[:9], 0.05, 3.0) is None, "too few frames"
    assert risen_force(((0.0, 1.0),) * 10, 0.1, 3.0) is None, "no time passes"


def bound_ms(
    forces_mn: list[float], interval_s: float = 0.01, share: float = 0.9
) -> tuple[float | None, ...]:
    """Early end, median and late end of the time until 30 mN; forces are a share of the
    upper end.
    """
    line = force_trend.rise_of(
        [(n * interval_s, force_mn * 1e-3) for n, force_mn in enumerate(forces_mn)], 10
    )
    found = force_trend.time_to_bound(
        line, forces_mn[-1] * 1e-3, forces_mn[-1] * 1e-3 / share, LIMITS.bound_n
    )

    return (
        (None, None, None)
        if found is None
        else tuple(at and at * 1e3 for at in vars(found).values())
    )


def test_the_time_until_the_bound_of_a_straight_rise_is_exact_but_for_the_error_of_its_slope():
    # 50 mN/s to 15.5 mN; 27 mN have an upper end of 30
    steady = [10.0 + 0.5 * n for n in range(12)]
    slopes = 50.0 * (1.0 + 1.645 * 0.15 * np.array([1.0, 0.0, -1.0]))
    middle_mn = steady[-1] - 4.5 * 0.5
    assert bound_ms(steady) == pytest.approx(
        1e3 * (27.0 - middle_mn) / slopes - 45.0, rel=1e-6
    )
    assert bound_ms(steady, share=0.7)[1] == pytest.approx(1e3 * (21.0 - 15.5) / 50.0)
    assert bound_ms(steady, interval_s=0.12)[1] is None, "2.8 s away"
    assert bound_ms(steady, interval_s=0.3, share=0.53) == (
        None,
        None,
        None,
    ), "the frames span 2.7 s"
    assert (
        bound_ms(steady[:9])
        == bound_ms(steady[::-1])
        == bound_ms([20.0] * 12)
        == (None, None, None)
    )
    assert bound_ms([0.0] * 12, share=1.0 / 3.0) == (
        None,
        None,
        None,
    ), "no contact, and no force"
    assert bound_ms(steady[:9], share=0.4) == (0.0, 0.0, 0.0), "reached already"
    assert bound_ms([*(22.7 + 0.5 * n for n in range(11)), 26.5]) == (
        0.0,
        0.0,
        0.0,
    ), "the line has reached it"


def test_the_interval_of_the_time_until_the_bound_holds_where_readings_err_alike():
    rng = np.random.default_rng(5)
    inside = []
    medians = []

    for _ in range(600):
        slope = rng.uniform(0.1, 0.6)
        sd = rng.uniform(0.05, 0.3)
        left_mn = rng.uniform(3.0, 12.0)
        # neighbours err alike
        err = np.convolve(rng.normal(0.0, sd, 53), np.full(4, 0.5), "valid")
        readings_mn = (
            27.0 - left_mn + slope * rng.normal(1.0, 0.15) * np.arange(-49.0, 1.0) + err
        )
        early, median, late = bound_ms(readings_mn.tolist())

        true_ms = 10.0 * left_mn / slope
        if true_ms < 2000.0:
            inside.append(
                (np.inf if early is None else early)
                <= true_ms
                <= (np.inf if late is None else late)
            )
            medians.append((np.inf if median is None else median) < true_ms)

    assert 0.86 < np.mean(inside) < 0.97
    assert 0.43 < np.mean(medians) < 0.57


def test_a_decision_on_a_frame_says_when_the_bound_is_reached():
    state = watching()
    for number in range(6, 30):
        state, decision = decide(state, frame(number, 0.01 + 1e-4 * number), LIMITS)

    force_n = 0.01 + 29e-4
    left_n = LIMITS.bound_n * force_n / (force_n + 1.5e-3) - force_n
    assert decision.to_bound is not None
    assert decision.to_bound.median_s == pytest.approx(left_n / 0.01, rel=1e-6)
    assert decide(state, Tick(0.295), LIMITS)[1].to_bound is None
    assert decide(state, frame(30, 0.0299), LIMITS)[1].to_bound.late_s == 0.0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("bound_n", NAN),
        ("bound_n", 0.0),
        ("bound_n", 1e-3),
        ("fresh_frames", 0),
        ("unusable_frames", 0),
        ("unusable_opinions", 0),
        ("silence_s", -1.0),
        ("reaction_s", float("inf")),
        ("frozen_frames", 1),
        ("rate_frames", 3),
        ("lag_drift", -1e-4),
        ("scale_tolerance", 0.0),
        ("size", (0, 512)),
    ],
)
def test_limits_that_pass_everything_or_nothing_are_refused(field, value):
    with pytest.raises(InputError, match=r"monitor: "):
        MonitorLimits(**{field: value})


@pytest.mark.parametrize(
    ("share", "same"),
    [
        (1.009, True),
        (0.991, True),
        *((share, False) for share in (1.011, 0.989, -1.0, NAN, float("inf"))),
    ],
)
def test_a_scale_within_the_tolerance_is_the_stated_one_and_no_number_never_is(
    share, same
):
    limits = MonitorLimits(scale_tolerance=0.01)
    for changed_m in ((share * 1e-5, 5e-6), (1e-5, share * 5e-6)):
        assert of_scale(changed_m, (1e-5, 5e-6), limits) is same


def test_a_dent_is_contact_also_where_the_force_on_it_has_relaxed():
    relaxed = [
        judged(frame(number, 0.5e-3), elastic_force_n=4e-3) for number in range(6, 66)
    ]
    assert order([*relaxed, unusable(66)]) is Cause.UNUSABLE
    lifted = [judged(one, elastic_force_n=0.5e-3) for one in relaxed]
    assert order([*lifted, unusable(66)], watching(4e-3)) is State.NOT_READY


def needle_goes(
    forces_n: Sequence[float],
    rate_hz: float = 100.0,
    travel_m: Sequence[float] | None = None,
    half_n: float = 1e-3,
) -> list[FrameRead]:
    """Frames from 1 on with these forces, and the travel if it is known."""
    where_m = travel_m or len(forces_n) * [None]
    return [
        replace(
            frame(n, force_n, n / rate_hz, half_n), travel_m=there_m, travel_age_s=0.001
        )
        for n, (force_n, there_m) in enumerate(zip(forces_n, where_m, strict=True), 1)
    ]


HELD = [0.024] * 8
THROUGH_N = [*HELD, 0.007, 0.0072, 0.0074]


def test_a_fall_that_no_retraction_explains_is_pierced_with_the_second_frame_after_it():
    for rate_hz in (70.0, 100.0, 400.0):
        # one frame may be wild
        assert order(needle_goes(THROUGH_N[:9], rate_hz), MonitorState()) is OK
        state = play(needle_goes(THROUGH_N[:10], rate_hz))
        assert (state.state, state.cause) == (State.WITHDRAW, Cause.PIERCED)
        assert state.reason.startswith(
            "pierced: the dent fell from 24.0 to 7.2 mN within "
        )

    between = [*HELD, 0.015, 0.007, 0.0072]  # a frame in the middle of the fall
    assert order(needle_goes(between), MonitorState()) is Cause.PIERCED
    # the frames are too far apart to tell it from a withdrawal
    assert order(needle_goes(THROUGH_N, 25.0), MonitorState()) is Cause.UNSEEN_FALL


def test_what_withdraws_the_needle_or_is_one_frame_is_not_pierced():
    steepest = LIMITS.stiffness_n_m * (LIMITS.retraction_m_s + LIMITS.eye_m_s)  # N/s
    for rate_hz in (20.0, 60.0, 100.0, 400.0, 1000.0):
        fallen_n = [
            max(0.024 - steepest * n / rate_hz, 0.0) for n in range(int(0.1 * rate_hz))
        ]
        assert (
            order(needle_goes([*HELD, *fallen_n], rate_hz, half_n=5e-4), MonitorState())
            is OK
        )

    for wild in ([0.003], [0.028]):
        assert (
            order(needle_goes([*HELD, *wild, *HELD, *wild, *HELD]), MonitorState())
            is OK
        )


def behind_a_gap(
    before_n: Sequence[float], gap_s: float, after_n: Sequence[float], **fields: Any
) -> list[FrameRead]:
    """Frames at 100 Hz with a gap; `fields` are of those after it."""
    before = needle_goes(before_n)
    begun_s = before[-1].at_s + gap_s
    after = [
        replace(frame(100 + n, force_n), at_s=begun_s + 0.01 * n, **fields)
        for n, force_n in enumerate(after_n)
    ]
    return [*before, *after]


GAPS_S = [0.016, 0.02, 0.03, 0.035, 0.05, 0.07, 0.099]
FALLEN_N = [0.008, 0.0082, 0.0079]


@pytest.mark.parametrize("gap_s", GAPS_S)
@pytest.mark.parametrize("limits", [LIMITS, REPORTS])
def test_a_fall_in_a_gap_is_not_ok_whatever_its_length(limits, gap_s):
    """With the second frame after it. It was seen behind gaps of up to 30 ms only."""
    frames = behind_a_gap([0.021] * 12, gap_s, FALLEN_N)
    assert order(frames[:-2], MonitorState(), limits=limits) is OK
    state = play(frames[:-1], limits=limits)
    assert (state.state, state.cause) == (State.WITHDRAW, Cause.UNSEEN_FALL)
    assert "from 21.0 to 8.2 mN" in state.reason
    assert state.reason.endswith("ms of it unseen: withdrawn or pierced")


def test_no_gap_hides_a_puncture():
    """Levels from 6 mN, friction up to 45 %, readings with a noise of 0.1 mN. In one of
    some thousand, noise looks like a withdrawal that goes on behind the gap.
    """
    rng = np.random.default_rng(203)
    causes = []
    for _ in range(200):
        gap_s = rng.uniform(0.016, 0.099)
        level_n = rng.uniform(0.006, 0.025)
        left_n = rng.uniform(0.0, 0.45) * level_n
        before_n = level_n + 1e-4 * rng.standard_normal(20)
        after_n = np.abs(left_n + 1e-4 * rng.standard_normal(3))
        frames = behind_a_gap(before_n.tolist(), gap_s, after_n.tolist())
        causes.append(play(frames).cause)

    assert set(causes) == {Cause.UNSEEN_FALL, Cause.PIERCED}


@pytest.mark.parametrize("gap_s", GAPS_S)
@pytest.mark.parametrize("rate_n_s", [0.02, 0.1, 0.3])
def test_a_withdrawal_that_is_seen_on_either_side_explains_a_fall_in_a_gap(
    rate_n_s, gap_s
):
    """It goes on through the gap, begins in it, or ends in it."""
    before_n = [0.025 - rate_n_s * 0.01 * n for n in range(3)]
    left_n = before_n[-1] - rate_n_s * gap_s
    after_n = [max(left_n - rate_n_s * 0.01 * n, 0.0) for n in range(5)]
    held = [0.025] * 10
    assert order(behind_a_gap([*held, *before_n], gap_s, after_n), MonitorState()) is OK
    begins_n = [max(0.025 - rate_n_s * (gap_s + 0.01 * n), 0.0) for n in range(3)]
    if begins_n[-1]:
        assert order(behind_a_gap(held, gap_s, begins_n), MonitorState()) is OK
    ends_n = [max(left_n, 0.0)] * 3
    assert order(behind_a_gap([*held, *before_n], gap_s, ends_n), MonitorState()) is OK


def test_a_step_after_a_gap_is_no_withdrawal_that_is_seen():
    """The second half of a puncture may be: the next frames must show it, too."""
    frames = behind_a_gap([0.021] * 12, 0.05, [0.015, 0.008, 0.0081])
    assert play(frames).cause in (Cause.UNSEEN_FALL, Cause.PIERCED)


@pytest.mark.parametrize("gap_s", GAPS_S)
@pytest.mark.parametrize(
    ("back_m", "age_s", "fell"),
    [(0.0, 0.001, True), (2e-4, 0.001, False), (0.0, 0.09, True)],
    ids=["held", "withdrawn", "long not stated"],
)
def test_stated_travel_explains_a_fall_in_a_gap_or_not(back_m, age_s, fell, gap_s):
    """13 mN on a wall of 100 N/m take 130 um."""
    moved = {"travel_m": 1e-3 - back_m, "travel_age_s": age_s}
    frames = behind_a_gap([0.021] * 12, gap_s, FALLEN_N, **moved)
    frames[:12] = [
        replace(one, travel_m=1e-3, travel_age_s=0.001) for one in frames[:12]
    ]
    found = play(frames).cause
    assert found in ((Cause.UNSEEN_FALL, Cause.PIERCED) if fell else (None,))


def test_travel_rules_out_a_withdrawal_across_a_gap():
    """A soft wall, on which the eye's own motion makes little force."""
    soft = replace(LIMITS, stiffness_n_m=30.0)
    held = {"travel_m": 1e-3, "travel_age_s": 0.001}
    frames = [
        replace(one, **held) for one in behind_a_gap([0.021] * 12, 0.05, FALLEN_N)
    ]
    assert order(frames, MonitorState(), limits=soft) is Cause.PIERCED


@pytest.mark.parametrize("puncture", range(1, 4))
def test_overtaken_frames_show_a_fall_in_the_order_of_time(puncture):
    """Four frames come together: the newest is answered first, the others after it."""
    forces_n = [0.021] * puncture + [0.008] * (4 - puncture)
    late = [
        replace(frame(12 + n, force_n), at_s=0.16, taken_s=0.12 + 0.01 * n)
        for n, force_n in enumerate(forces_n)
    ]
    soft = replace(LIMITS, stiffness_n_m=30.0)
    events = [*needle_goes([0.021] * 11), late[-1]]
    events += [OvertakenRead(0.161 + 0.001 * n, one) for n, one in enumerate(late[:-1])]
    if puncture == 3:
        events.append(replace(frame(16, 0.008), at_s=0.17))
    state = play(events, limits=soft)
    assert [dent.at_s for dent in state.dents] == sorted(d.at_s for d in state.dents)
    assert state.cause is Cause.PIERCED


def test_a_picture_that_was_shown_before_hides_no_gap():
    frames = needle_goes([0.021] * 12)
    old = [replace(frame(n, 0.021), shown_back=back) for n, back in ((13, 1), (14, 2))]
    after = [frame(n, 0.008) for n in (15, 16)]
    assert order([*frames, *old, *after], MonitorState()) is Cause.UNSEEN_FALL


def test_where_the_needle_is_withdrawn_anyway_a_fall_in_a_gap_is_none():
    ordered = play([*needle_goes([0.021] * 12), Fault(0.121, Cause.CHECKSUM, "CRC")])
    fallen = behind_a_gap([0.021] * 12, 0.05, FALLEN_N)[12:]
    _, decision = decide(play(fallen, ordered), Tick(0.2), LIMITS)
    assert (decision.cause, decision.present_cause) == (Cause.CHECKSUM, None)


def test_after_the_reset_frames_from_before_it_make_no_fall():
    state = play(behind_a_gap([0.021] * 12, 0.05, FALLEN_N))
    fresh = [replace(frame(200 + n, 0.008), at_s=0.2 + 0.01 * n) for n in range(6)]
    state = play([*fresh, Reset(0.2505)], state)
    assert state.state is State.WATCHING
    early = replace(frame(110, 0.021), at_s=0.2, taken_s=0.19)
    assert order([OvertakenRead(0.251, early)], state) is OK


def test_travel_explains_a_fall_or_not():
    # such a robot needs its travel: without it all may be a retraction
    fast = replace(LIMITS, retraction_m_s=0.05)
    on_m = [1e-4 * n for n in range(11)]
    back_m = [1e-3 - 5e-4 * max(n - 7, 0) for n in range(11)]
    assert order(needle_goes(THROUGH_N), MonitorState(), limits=fast) is OK
    assert (
        order(needle_goes(THROUGH_N, travel_m=on_m), MonitorState(), limits=fast)
        is Cause.PIERCED
    )
    assert (
        order(needle_goes(THROUGH_N, travel_m=back_m), MonitorState(), limits=fast)
        is OK
    )
    # pictures come later than the robot says
    early_m = [1e-3 - 5e-4 * min(max(n - 5, 0), 3) for n in range(11)]
    assert (
        order(needle_goes(THROUGH_N, travel_m=early_m), MonitorState(), limits=fast)
        is OK
    )
    old = [
        replace(one, travel_age_s=0.02) for one in needle_goes(THROUGH_N, travel_m=on_m)
    ]
    # 20 ms ago; it may have withdrawn since
    assert order(old, MonitorState(), limits=fast) is OK
    unknown = needle_goes(THROUGH_N, travel_m=[NAN] * 11)
    assert order(unknown, MonitorState()) is Cause.PIERCED


def test_of_tissue_that_relaxes_the_dent_counts():
    # the force relaxes, the dent stays
    held = [judged(one, elastic_force_n=0.024) for one in needle_goes(THROUGH_N)]
    assert order(held, MonitorState()) is OK
    sprung = [
        judged(one, elastic_force_n=one.verdict.force_n * 1.2)
        for one in needle_goes(THROUGH_N)
    ]
    assert order(sprung, MonitorState()) is Cause.PIERCED


def test_after_it_nothing_is_ok_until_the_reset_and_the_cause_stays_in_view():
    fresh = readings(6, 206, force_n=0.007)
    for limits, state, code in (
        (LIMITS, State.WITHDRAW, 3),
        (REPORTS, State.PIERCED, 14),
    ):
        now = play([frame(1, 0.024), *THROUGH], limits=limits)
        for event in fresh[1:]:
            now, decision = decide(now, event, limits)
            assert (decision.state, decision.code, decision.sub_code) == (
                state,
                code,
                116,
            )
            assert decision.present_cause is Cause.PIERCED

        after, decision = decide(now, Reset(2.0501), limits)
        assert (after.state, decision.code, decision.cause, decision.present_cause) == (
            State.WATCHING,
            1,
            None,
            None,
        )
        _, again = decide(after, replace(frame(206, 0.007), at_s=2.06), limits)
        assert again.code == 1

    soon = [*fresh[1 : 1 + REPORTS.fresh_frames], Reset(0.1201)]  # a fall is found once
    assert (
        order(soon, play([frame(1, 0.024), *THROUGH], limits=REPORTS), limits=REPORTS)
        is OK
    )


def test_what_is_only_reported_suppresses_no_other_cause():
    bound, decision = decide(pierced(), frame(6, 0.0295), REPORTS)
    assert (decision.code, decision.cause) == (3, Cause.BOUND)
    _, decision = decide(pierced(), Tick(1.0), REPORTS)
    assert (decision.code, decision.cause) == (3, Cause.SILENCE)
    withdrawn_first = play(readings(7, 9, force_n=0.007), bound, REPORTS)
    assert (withdrawn_first.state, withdrawn_first.present_cause) == (
        State.WITHDRAW,
        Cause.PIERCED,
    )


def test_before_a_reset_that_follows_it_the_second_opinion_counts_anew():
    limits = replace(OPINED, reports_pierced=True)
    state = play(
        [*both(1, 2, 3, 4, force_n=0.024), *both(5, force_n=0.007), frame(6, 0.007)],
        limits=limits,
    )
    assert state.state is State.PIERCED
    frames = readings(7, 13, force_n=0.007)
    assert order([*frames, Reset(0.121)], state, limits) is Cause.PIERCED
    assert (
        order([*both(*range(7, 13), force_n=0.007), Reset(0.126)], state, limits=limits)
        is OK
    )


CROSS = ("along", "across")


def of_plane(plane: str, event: Any) -> Any:
    return replace(event, plane=plane)


def play_planes(
    planed: Sequence[MonitorEvent],
    planes: PlanesState | None = None,
    limits: MonitorLimits = LIMITS,
) -> tuple[PlanesState, Decision]:
    planes = planes or PlanesState.of(CROSS)
    for event in planed:
        planes, decision = decide_planes(planes, event, limits)
    return planes, decision


def cross(
    numbers: Sequence[int], along_n: float = 0.01, across_n: float = 0.01
) -> list[FrameRead]:
    """Frames of both planes at 100 Hz, each plane with a force."""
    forces_n = zip(CROSS, (along_n, across_n), strict=True)
    return [
        of_plane(plane, frame(n, force_n))
        for n, (plane, force_n) in product(numbers, forces_n)
    ]


def test_nothing_is_ok_before_every_plane_has_sent_a_frame_in_any_order():
    for first in CROSS:
        planes, decision = play_planes([of_plane(first, frame(n)) for n in range(1, 9)])
        missing = next(plane for plane in CROSS if plane != first)
        assert decision.state is State.NOT_READY
        assert f"plane {missing}: no good frame yet" in decision.message
        _, decision = play_planes([of_plane(missing, frame(9))], planes)
        assert decision.code == 1


def test_a_constant_difference_between_planes_neither_rises_nor_pierces_and_the_worst_one_counts():
    """Frames of the planes come in blocks of eight, which in one history would rise by
    12 mN and fall again.
    """
    forces_n = {"along": 0.012, "across": 0.024}
    blocks = [plane for _ in range(10) for plane in CROSS for _ in range(8)]
    turns = [
        of_plane(plane, frame(n, forces_n[plane], 0.005 * n))
        for n, plane in enumerate(blocks, 1)
    ]
    planes = PlanesState.of(CROSS)

    for event in turns:
        planes, decision = decide_planes(planes, event, LIMITS)
        assert decision.cause is None

    assert decision.message == "WATCHING: class 1; 24.0 mN"
    alone = play([replace(event, plane=None) for event in turns])
    assert alone.cause in (
        Cause.RISING,
        Cause.PIERCED,
    ), "the same frames of one plane are a cause"


@pytest.mark.parametrize("plane", CROSS)
def test_each_plane_rises_and_is_pierced_by_its_own_frames(plane):
    rising = [
        of_plane(name, frame(n, 0.012 + (name == plane) * 0.0005 * n))
        for n in range(1, 30)
        for name in CROSS
    ]
    _, decision = play_planes(rising)
    assert decision.cause is Cause.RISING
    assert f"plane {plane}: " in decision.message
    fell = [
        of_plane(
            name,
            replace(one, verdict=one.verdict if name == plane else frame(1).verdict),
        )
        for one in THROUGH
        for name in CROSS
    ]
    _, decision = play_planes(fell)
    assert decision.cause is Cause.PIERCED
    assert f"plane {plane}: pierced" in decision.message


@pytest.mark.parametrize("silent", CROSS)
def test_a_plane_that_falls_silent_is_a_cause_although_the_other_sends(
    silent,
):
    planes, decision = play_planes(cross(range(1, 6)))
    assert decision.code == 1
    other = next(plane for plane in CROSS if plane != silent)
    _, decision = play_planes([of_plane(other, frame(n)) for n in range(6, 15)], planes)
    assert decision.code == 1
    _, decision = play_planes([of_plane(other, frame(n)) for n in range(6, 17)], planes)
    assert decision.cause is Cause.SILENCE
    assert decision.message.startswith(f"WITHDRAW: plane {silent}: no frame for 100 ms")


def test_a_withdrawal_of_one_plane_is_everybodys_until_all_grant_the_reset():
    withdrawn, decision = play_planes(
        [*cross(range(1, 6)), of_plane("across", frame(6, 0.031))]
    )
    assert decision.cause in (Cause.BOUND, Cause.RISING)
    first = decision.message.partition(";")[0]
    held, decision = play_planes(
        [of_plane("along", frame(6, 0.031)), *cross(range(7, 11))], withdrawn
    )
    assert decision.message.startswith(first), (
        "the first cause stays, although the other plane withdraws as well"
    )
    _, decision = play_planes([Reset(0.105)], held)
    assert decision.code == 3
    assert "reset refused" in decision.message
    fresh, _ = play_planes([*cross(range(11, 13)), of_plane("along", frame(13))], held)
    _, decision = play_planes([of_plane("across", unusable(13)), Reset(0.135)], fresh)
    assert decision.code == 3
    assert "plane across: reset refused" in decision.message
    _, decision = play_planes([of_plane("across", frame(13)), Reset(0.135)], fresh)
    assert decision.code == 1
    bears = replace(LIMITS, unusable_frames=2)
    doubted, _ = play_planes(
        [of_plane("along", frame(6, 0.031)), *cross(range(7, 13))],
        play_planes(cross([5]))[0],
        bears,
    )
    _, decision = play_planes(
        [of_plane("across", unusable(13)), Reset(0.135)], doubted, bears
    )
    assert decision.code == 3
    assert "plane across: reset refused" in decision.message


def test_a_contact_that_one_plane_shows_is_that_of_all():
    begun = cross(range(1, 6), along_n=0.004, across_n=0.0)
    for frames, cause in (
        (begun, Cause.UNUSABLE),
        (cross(range(1, 6), 0.0, 0.0), None),
    ):
        planes, _ = play_planes(frames)
        _, decision = play_planes([of_plane("across", unusable(6))], planes)
        assert (decision.cause, decision.code != 1) == (cause, True)

    lifted, _ = play_planes([*begun, *cross(range(6, 70), 0.0, 0.0)])
    _, decision = play_planes([of_plane("across", unusable(70))], lifted)
    assert decision.state is State.NOT_READY, (
        "it ends with the last frame that shows it"
    )


def test_each_planes_opinions_are_its_own_and_what_is_of_no_plane_withdraws():
    limits = replace(LIMITS, expects_opinion=True)
    planes, decision = play_planes(
        [*cross(range(1, 6)), of_plane("along", opinion(5)), *cross([6])], limits=limits
    )
    assert (decision.state, decision.message) == (
        State.NOT_READY,
        (
            "NOT_READY: plane across: the second opinion has not answered yet; class 1;"
            " 10.0 mN"
        ),
    )
    watching, decision = play_planes(
        [of_plane("across", opinion(6)), *cross([7])], planes, limits
    )
    assert decision.code == 1
    doubts = [of_plane("across", replace(no_opinion(n), at_s=0.08)) for n in (4, 5, 6)]
    _, decision = play_planes(doubts, watching, limits)
    assert decision.cause is Cause.UNUSABLE
    assert "plane across: second opinion" in decision.message

    for stray in (
        frame(8),
        of_plane("up", frame(8)),
        of_plane("up", opinion(6)),
        OvertakenRead(0.08, frame(7)),
        object(),
    ):
        _, decision = play_planes([stray], watching, limits)
        assert decision.state is State.WITHDRAW

    _, decision = play_planes(
        [OvertakenRead(0.08, of_plane("across", frame(6, 0.031)))], watching, limits
    )
    assert decision.cause is Cause.BOUND
    assert "plane across: frame 6, overtaken: up to" in decision.message
    _, decision = play_planes([Fault(0.08, Cause.CHECKSUM, "CRC")], watching, limits)
    assert decision.message.startswith("WITHDRAW: CRC;")
