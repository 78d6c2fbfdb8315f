"""Frames to decisions without sockets: numbers, orders, what raises, what is
counted.
"""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from small_monitor import (
    COLUMNS,
    RAISES,
    READ_ENTRY,
    ROWS,
    SCALE_M,
    TICK_ENTRY,
    UNUSABLE,
    frame_of,
    read,
    reader_of,
    verdict,
)

from scleraforce.live.companions.process_messages import Entry
from scleraforce.live.connected_clients import reading_messages
from scleraforce.live.decision.events import FrameRead, OvertakenRead, Reset, Tick
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_session import (
    MOST_FRAMES,
    DeferredFrames,
    FramePace,
    MonitorSession,
    ReceivedFrame,
)
from scleraforce.live.network.scanner_frame import ScannerFrame
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.records.eye import Eye
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import Relaxation

SCALE = {"lateral_m": SCALE_M[0], "depth_m": SCALE_M[1]}
LIMITS = MonitorLimits(size=(ROWS, COLUMNS), scale_m=SCALE_M)
READER = reader_of(read)


class Clock:
    """A clock that a test turns."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def begun(limits: MonitorLimits = LIMITS) -> tuple[Clock, MonitorSession]:
    clock = Clock()
    return clock, MonitorSession(READER, limits, clock, clock)


def take(
    session: MonitorSession,
    clock: Clock,
    force_un: int,
    sender_id: int,
    sender: int = 1,
) -> None:
    clock.now_s += 0.01
    image = ScannerFrame(frame_of(force_un, sender_id), **SCALE)
    session.take_frame(session.frame(image, sender_id, sender, clock.now_s))


def test_a_sender_that_counts_back_is_out_of_order_and_one_that_takes_over_counts_anew():
    clock, session = begun()
    for sender_id in (70, 71, 80):
        take(session, clock, 10_000, sender_id)

    take(session, clock, 10_010, 5, sender=2)
    take(session, clock, 10_020, 6, sender=2)
    assert session.decision.code == 1
    take(session, clock, 10_030, 6, sender=2)
    assert session.decision.cause.name == "OUT_OF_ORDER"
    first = MonitorSession(READER, LIMITS, clock, clock)
    take(first, clock, 10_000, 71)
    take(first, clock, 10_000, 70)
    assert "frame 70 after 71" in first.decision.message


def test_one_number_far_ahead_makes_no_later_frame_a_misfit() -> None:
    clock, session = begun()
    for sender_id in (70, 2 * 10**15, 71):
        take(session, clock, 10_000 + sender_id % 100, sender_id)

    assert session.decision.cause.name == "OUT_OF_ORDER"
    image = ScannerFrame(frame_of(10_050, 1), **SCALE)
    assert not session.frame(image, 72, 1, clock.now_s).misfit
    assert session.frame(replace(image, sent_type="uint8"), 73, 1, clock.now_s).misfit


def test_a_learned_eye_moves_the_stiffness_of_punctures_and_no_other_limit() -> None:
    clock = Clock()
    stiffnesses_n_m = iter((70.0, None, 120.0))
    reader = reader_of(read, stiffness_n_m=lambda: next(stiffnesses_n_m))
    session = MonitorSession(reader, LIMITS, clock, clock)
    found = list[float]()

    for _ in range(3):
        session.learned(Eye(), 1)
        found.append(session.limits.stiffness_n_m)

    assert found == [70.0, 70.0, 120.0]
    assert replace(session.limits, stiffness_n_m=LIMITS.stiffness_n_m) == LIMITS


def test_what_is_wrong_now_and_since_when_is_in_each_entry() -> None:
    clock, session = begun()
    take(session, clock, 10_000, 1)
    assert session.entry("frame", clock.now_s).withdrawn_s is None
    clock.now_s += 0.2
    session.take(Tick(clock.now_s))
    began_s = clock.now_s
    take(session, clock, 10_001, 2)
    take(session, clock, 39_000, 3)
    entry = session.entry("frame", clock.now_s)
    assert (entry.cause, entry.present_cause, entry.withdrawn_s) == (
        "SILENCE",
        "DANGEROUS_CLASS",
        began_s,
    )
    take(session, clock, 10_003, 4)
    entry = session.entry("frame", clock.now_s)
    assert (entry.cause, entry.present_cause, entry.present) == ("SILENCE", None, "")
    # of an event that is not a frame
    assert (entry.frame, entry.verdict) == (
        None,
        None,
    )


def test_a_puncture_that_is_only_reported_does_not_count_as_a_withdrawal_and_a_later_cause_does():
    clock, session = begun(replace(LIMITS, reports_pierced=True))
    for sender_id, force_un in enumerate((24_000, 24_001, 24_002, 7_000, 7_001), 1):
        take(session, clock, force_un, sender_id)

    entry = session.entry("frame", clock.now_s)
    assert (entry.state, entry.code, entry.cause, entry.withdrawn_s) == (
        "PIERCED",
        14,
        "PIERCED",
        None,
    )
    assert session.withdrawals == []
    clock.now_s += 0.2
    session.take(Tick(clock.now_s))
    entry = session.entry("tick", clock.now_s)
    assert (entry.cause, entry.withdrawn_s) == ("SILENCE", clock.now_s)
    assert [one["cause"] for one in session.withdrawals] == ["SILENCE"]


def test_frames_have_the_travel_that_was_stated_last_and_its_age() -> None:
    clock, session = begun()
    image = ScannerFrame(frame_of(10_000, 1), **SCALE)
    assert session.frame(image, 1, 1, clock.now_s).unread.travel_m is None
    session.travelled(0.002, clock.now_s)
    fresh = session.frame(image, 2, 1, clock.now_s + 0.004).unread
    assert (fresh.travel_m, fresh.travel_age_s) == pytest.approx((0.002, 0.004))
    assert session.frame(image, 3, 1, clock.now_s + 0.11).unread.travel_m is None, (
        "too old"
    )

    for back_m, code in (
        (0.0, 3),
        (0.0005, 1),
    ):
        # what the needle went back explains the fall, or not
        limits = replace(LIMITS, retraction_m_s=0.05)
        session = MonitorSession(READER, limits, clock, clock)
        for sender_id, force_un in enumerate(
            (24_000, 24_001, 24_002, 24_003, 7_000, 7_001), 1
        ):
            session.travelled(
                0.002 - back_m * max(sender_id - 4, 0), clock.now_s + 0.01
            )
            take(session, clock, force_un, sender_id)

        assert session.decision.code == code


def test_a_reader_that_raises_is_a_withdrawal_with_its_words_and_no_reading() -> None:
    clock, session = begun()
    take(session, clock, 10_000, 1)
    take(session, clock, RAISES, 2)
    assert (session.decision.code, session.decision.cause.name) == (3, "EXCEPTION")
    assert "RuntimeError: the reader broke" in session.decision.message
    assert session.answer is None


def test_a_frame_of_another_size_is_not_read() -> None:
    def never(*_: object) -> None:
        raise AssertionError

    clock = Clock()
    session = MonitorSession(reader_of(never), LIMITS, clock, clock)
    image = ScannerFrame(np.zeros((ROWS, COLUMNS + 1), np.uint16), **SCALE)
    session.take_frame(session.frame(image, 1, 1, 100.01))
    assert session.decision.cause.name == "SIZE"


def defer(
    session: MonitorSession, clock: Clock, forces_un: list[int], first: int
) -> None:
    """Let frames wait that came together, numbered from `first`."""
    frames = []
    for n, force_un in enumerate(forces_un):
        image = ScannerFrame(frame_of(force_un, first + n), **SCALE)
        frames.append(session.frame(image, first + n, 1, clock.now_s))
    for frame in frames:
        session.defer(frame, frames[-1])


def test_frames_that_came_together_are_read_oldest_first_and_counted() -> None:
    clock, session = begun()
    take(session, clock, 10_000, 1)
    defer(session, clock, [10_010, 10_020, 10_030], 2)
    read_again = [session.catch_up() for _ in range(3)]
    assert [
        event.read.frame_id for event in read_again if isinstance(event, OvertakenRead)
    ] == [2, 3, 4]
    assert not session.behind
    assert (session.summary()["overtaken"], session.summary()["lost"]) == (3, 0)
    assert session.entry("tick", clock.now_s).overtaken == 3


HEADER_S = {
    "as taken": lambda n: 5000.0 + 0.01 * n,
    "none": lambda _: None,
    "in other units": lambda n: 5000.0 + 10.0 * n,
    "always the same": lambda _: 5000.0,
}


@pytest.mark.parametrize("header", HEADER_S)
def test_a_bunch_is_in_the_order_of_time_and_hides_no_puncture(header: str) -> None:
    """Four frames of 10 ms at once, none lost: the second one shows the fall."""
    clock, session = begun(replace(LIMITS, stiffness_n_m=30.0))
    for number in range(1, 21):
        take(session, clock, 21_000 + number % 3, number)

    clock.now_s += 0.04
    frames = [
        session.frame(
            ScannerFrame(frame_of(force_un, number), **SCALE),
            number,
            1,
            clock.now_s,
            HEADER_S[header](number),
        )
        for number, force_un in enumerate((21_002, 8_000, 8_010, 8_020), 21)
    ]
    for frame in frames[:-1]:
        session.defer(frame, frames[-1])
    session.take_frame(frames[-1])
    assert session.decision.code == 1  # one frame may be wild

    taken_s = list[float]()
    while session.behind:
        event = session.catch_up()
        assert isinstance(event, OvertakenRead)
        taken_s.append(event.read.since_s - clock.now_s)
        session.take(event)

    assert taken_s == pytest.approx([-0.03, -0.02, -0.01], abs=1.1e-3)
    assert session.decision.cause.name == "PIERCED"


def test_a_bunch_of_a_fast_withdrawal_is_no_puncture() -> None:
    """5 mm/s on 30 N/m: all frames of the bunch came at one time, but were not taken at
    one.
    """
    clock, session = begun(replace(LIMITS, stiffness_n_m=30.0))
    for number in range(1, 21):
        take(session, clock, 21_000 + number % 3, number)

    clock.now_s += 0.04
    defer(session, clock, [19_500, 18_000, 16_500, 15_000], 21)
    newest = ScannerFrame(frame_of(15_000, 24), **SCALE)
    session.take_frame(session.frame(newest, 25, 1, clock.now_s))
    while session.behind:
        session.take(session.catch_up())
    assert session.decision.code == 1


def test_a_frame_is_as_old_as_its_oldest_part() -> None:
    clock, session = begun()
    for number in range(1, 6):
        take(session, clock, 10_000 + number, number)

    clock.now_s += 0.05
    image = ScannerFrame(frame_of(10_000, 6), **SCALE, begun_s=clock.now_s - 0.04)
    session.take_frame(session.frame(image, 6, 1, clock.now_s))
    assert session.decision.code == 1
    session.take(Tick(clock.now_s + 0.059))
    assert session.decision.code == 1
    session.take(Tick(clock.now_s + 0.0601))
    assert session.decision.cause.name == "SILENCE"

    clock, session = begun()
    image = replace(image, begun_s=clock.now_s - 5.0)
    session.take_frame(session.frame(image, 1, 1, clock.now_s))
    assert session.decision.cause.name == "STALE"
    assert "first part of the frame came 5000 ms before" in session.decision.message


def test_a_frame_that_was_not_read_in_time_is_lost_and_stands_for_the_scanners_interval():
    clock, session = begun()
    for number in range(1, 31):
        clock.now_s += 0.01
        take(session, clock, 10_000 + number, number)  # every 20 ms

    defer(session, clock, [10_010, 10_020], 31)
    clock.now_s += LIMITS.catch_up_s
    assert session.losses(clock.now_s) == []
    clock.now_s += 0.001
    (loss,) = session.losses(clock.now_s)
    assert (loss.at_s, loss.lost, loss.row) == (clock.now_s, 2, 32)
    assert loss.unread_s == pytest.approx(0.04, abs=1e-3)
    assert not session.behind


def test_a_bunch_of_more_than_the_time_to_catch_up_is_a_loss_at_once_and_its_newest_frames_are_read():
    clock, session = begun()
    for number in range(1, 301):
        take(session, clock, 10_000 + number, number)  # every 10 ms

    defer(session, clock, [10_000] * 15, 301)
    (loss,) = session.losses(clock.now_s)
    assert loss.lost == 5  # the frames of a bunch shorten the mean, but little
    event = session.catch_up()
    assert isinstance(event, OvertakenRead)
    assert event.read.frame_id == 306


def deferred(number: int, at_s: float, interval_s: float = 0.01) -> ReceivedFrame:
    image = ScannerFrame(frame_of(0, number), **SCALE)
    unread = FrameRead(
        at_s=at_s,
        frame_id=number,
        verdict=verdict(),
        shown_back=0,
        size=(1, 1),
        scale_m=SCALE_M,
    )

    return ReceivedFrame(
        number=number,
        sender_id=number,
        interval_s=interval_s,
        image=image,
        misfit=False,
        unread=unread,
        memory=READER.start(monitored=True),
    )


def test_a_flood_is_a_loss_even_if_every_frame_is_read_at_once_and_a_steady_stream_is_not():
    flood = DeferredFrames(0.1)
    steady = DeferredFrames(0.1)
    lost = []

    for number in range(30):
        flood.add(deferred(number, 10.0 + 1e-4 * number), number // 10)
        lost += flood.lose(10.0 + 1e-4 * number)
        if len(flood):
            flood.take()

        steady.add(deferred(number, 10.0 + 0.01 * number), number)
        assert steady.lose(10.0 + 0.01 * number) == []
        steady.take()

    assert 19 <= sum(loss.lost for loss in lost) <= 20


def test_a_flood_of_frames_that_stand_for_no_time_fills_no_memory() -> None:
    waiting = DeferredFrames(0.1)
    for number in range(MOST_FRAMES + 7):
        waiting.add(deferred(number, 10.0, 1e-6), number // 5)
    losses = [(loss.row, loss.lost, loss.unread_s) for loss in waiting.lose(10.0)]
    assert losses == [(0, 5, pytest.approx(5e-6)), (1, 2, pytest.approx(2e-6))]
    assert (len(waiting), waiting.take().number) == (MOST_FRAMES, 7)


def test_the_first_frames_stand_for_the_interval_of_the_times_in_their_headers():
    """They may come in one bunch, or after a pause of the scanner, so that their
    arrivals tell nothing.
    """
    fast, slow, paused, mixed, wrong, counted = (FramePace(0.1) for _ in range(6))
    assert [fast.arrived(5.0, 7.0 + 1e-3 * n) for n in range(4)] == pytest.approx(
        [0.01, 1e-3, 1e-3, 1e-3]
    )
    assert [slow.arrived(5.0, 7.0 + 0.4 * n) for n in range(4)] == pytest.approx(
        [0.01, 0.01, 0.1, 0.1]
    )
    stamps = [7.0, 7.06, *(7.06 + 1e-3 * n for n in range(1, 4))]
    assert [paused.arrived(5.0, at) for at in stamps] == pytest.approx(
        [0.01, 0.01, 0.01, 1e-3, 1e-3]
    )
    stamps = [None, 7.0, 7.002, None, 7.1, 7.103, 7.104]
    assert [mixed.arrived(5.0, at) for at in stamps] == pytest.approx(
        [0.01, 0.01, 2e-3, 2e-3, 2e-3, 3e-3, 2e-3]
    )
    assert [wrong.arrived(5.0, at) for at in (7.0, 7.0, 6.0)] == [0.01] * 3
    assert [counted.arrived(5.0, 1e-6 * n) for n in range(3)] == pytest.approx(
        [0.01, 1e-3, 1e-3]
    )
    later = FramePace(0.1)
    arrived_s = [
        later.arrived(at_s)
        for at_s in (*(0.01 * n for n in range(1, 101)), 60.0, 60.01)
    ]
    # a pause counts as a silence
    assert arrived_s[-1] == pytest.approx((99 * 0.01 + 0.1) / 100)


def test_a_bunch_at_the_start_is_a_loss_for_as_long_as_its_frames_stand_for() -> None:
    """Ten frames of a scanner of 1000 Hz are 10 ms, and not the 100 ms of an unknown
    scanner.
    """
    lost_s = []
    for sent_s in ([100.0 + 1e-3 * n for n in range(10)], [None] * 10):
        clock = Clock()
        session = MonitorSession(READER, LIMITS, clock, clock)
        frames = [
            session.frame(
                ScannerFrame(frame_of(10_000, n), **SCALE), n, 1, clock.now_s, at
            )
            for n, at in enumerate(sent_s, start=1)
        ]

        for frame in frames[:-1]:
            session.defer(frame, frames[-1])

        clock.now_s += LIMITS.catch_up_s + 0.001
        lost_s += [loss.unread_s for loss in session.losses(clock.now_s)]

    assert lost_s == pytest.approx([0.01 + 8 * 1e-3, 0.09])


def test_nan_and_infinity_are_null_everywhere():
    nan = float("nan")
    inf = float("inf")
    entry = replace(
        READ_ENTRY,
        verdict=verdict(nan, (-inf, 13.5), probabilities=(nan, inf, 0.5)),
        latency_ms=inf,
    )
    # NaN and Infinity are not JSON
    record = json.loads(json.dumps(entry.as_json()), parse_constant=pytest.fail)
    assert record["force_mn"] is record["latency_ms"] is None
    assert record["interval_mn"] == [None, 13.5]
    assert record["probabilities"] == [None, None, 0.5]


def test_a_frame_that_was_not_read_is_not_usable_and_another_event_is_neither():
    record = replace(READ_ENTRY, verdict=None).as_json()
    assert (record["usable"], record["class"], record["force_mn"]) == (
        False,
        None,
        None,
    )
    assert Entry.from_json(record) == replace(READ_ENTRY, verdict=None)
    assert TICK_ENTRY.as_json()["usable"] is None


def test_the_sensor_holds_frame_class_probabilities_force_interval_usable_and_code():
    devices, (text, sensor) = zip(*reading_messages(READ_ENTRY), strict=True)
    assert devices == ("ForceReading", "ForceReading")
    assert text.text == json.dumps(READ_ENTRY.as_json())
    assert sensor.values == pytest.approx(
        (3, 1, 0.0, 0.75, 0.25, 0.0125, 0.011, 0.0135, 1, 1)
    )
    dark = replace(
        READ_ENTRY,
        verdict=verdict(predicted=2, usable=False, reason="dark", probabilities=None),
    )
    assert [str(value) for value in reading_messages(dark)[1][1].values] == [
        "3.0",
        "2.0",
        *["nan"] * 6,
        "0.0",
        "1.0",
    ]
    unread = reading_messages(replace(READ_ENTRY, verdict=None))[1][1].values
    assert [str(value) for value in unread] == ["3.0", *["nan"] * 7, "0.0", "1.0"]


TISSUE = Setup(eye=Eye(relaxation=Relaxation.declared([[0.3, 1.0]])))
RELAXING = TissueMemory.monitored(TISSUE, 60e-3)
CLASSES_N = (5e-3, 30e-3)


def relaxing(clock: Clock) -> MonitorSession:
    return MonitorSession(reader_of(read, TISSUE), LIMITS, clock, clock)


def felt(
    history: TissueMemory, forces_un: Sequence[int], begun_s: float
) -> tuple[list[float], TissueMemory]:
    """Forces of frames, one each 10 ms, by the tissue's memory alone."""
    forces_n = []
    for number, force_un in enumerate(forces_un, 1):
        elastic = read(frame_of(force_un, number), PixelScale(**SCALE))
        answer, history = history.read(elastic, CLASSES_N, begun_s + 0.01 * number)
        forces_n.append(answer.force_n)
    return forces_n, history


def test_a_session_gives_the_felt_force_that_an_evaluation_of_its_frames_gives():
    clock = Clock()
    forces_un = [0] * 5 + [20_000 + number for number in range(100)]
    session = relaxing(clock)
    read_n = []

    for number, force_un in enumerate(forces_un, 1):
        take(session, clock, force_un, number)
        read_n.append(session.answer.force_n)
        assert session.answer.elastic_force_n == pytest.approx(1e-6 * force_un)

    assert read_n == pytest.approx(felt(RELAXING, forces_un, 100.0)[0], abs=1e-12)
    assert read_n[-1] == pytest.approx(
        0.02 * (1.0 - 0.3 * (1.0 - np.exp(-1.0))), rel=0.01
    )


def test_the_history_runs_on_through_a_withdrawal_and_a_reset_and_a_restart_has_none():
    clock = Clock()
    forces_un = [20_000 + number for number in range(100)]
    session = relaxing(clock)
    for number, force_un in enumerate(forces_un, 1):
        take(session, clock, force_un, number)

    take(session, clock, UNUSABLE, 101)
    assert session.decision.cause.name == "UNUSABLE"
    for number in range(102, 112):
        take(session, clock, 20_000 + number, number)

    session.take(Reset(clock.now_s))
    assert session.decision.code == 1
    take(session, clock, 20_200, 112)
    unusable_one = [*forces_un, UNUSABLE, *range(20_102, 20_112), 20_200]
    assert session.answer.force_n == pytest.approx(
        felt(RELAXING, unusable_one, 100.0)[0][-1], abs=1e-12
    )
    restarted = relaxing(clock)
    take(restarted, clock, 20_201, 113)
    width_n = session.answer.interval_n[1] - session.answer.interval_n[0]
    assert (
        restarted.answer.interval_n[1] - restarted.answer.interval_n[0] > 1.5 * width_n
    )
    assert restarted.answer.force_n > session.answer.force_n  # the safe side


def test_old_pictures_leave_gaps_and_overtaken_frames_have_the_history_before_them():
    clock = Clock()
    session = relaxing(clock)
    for number in range(1, 51):
        take(session, clock, 20_000 + number, number)

    forces_un = [20_000 + number for number in range(1, 51)]
    clock.now_s += 0.01
    old = ScannerFrame(frame_of(20_050, 50), **SCALE)
    session.take_frame(session.frame(old, 51, 1, clock.now_s))
    clock.now_s += 0.01
    overtaken, newest = (
        session.frame(
            ScannerFrame(frame_of(20_052 + number, 52 + number), **SCALE),
            52 + number,
            1,
            clock.now_s,
        )
        for number in (0, 1)
    )
    session.defer(overtaken, newest)
    session.take_frame(newest)
    _, before = felt(RELAXING, forces_un, 100.0)

    for force_un, one in (
        (20_052, session.catch_up().read.verdict),
        (20_053, session.answer.verdict),
    ):
        expected, _ = before.read(
            read(frame_of(force_un, 0), PixelScale(**SCALE)), CLASSES_N, clock.now_s
        )
        assert one.force_n == pytest.approx(expected.force_n, abs=1e-12)
        assert one.interval_n == pytest.approx(expected.interval_n, abs=1e-12)


CROSS = ("along", "across")


def cross(**limits: float) -> tuple[Clock, MonitorSession]:
    clock = Clock()
    return clock, MonitorSession(
        dict.fromkeys(CROSS, READER), replace(LIMITS, **limits), clock, clock
    )


def of_plane(
    session: MonitorSession,
    clock: Clock,
    plane: str,
    number: int,
    force_un: int = 10_000,
    **sent: float,
) -> ReceivedFrame:
    image = ScannerFrame(
        frame_of(force_un, 1000 * CROSS.index(plane) + number), **SCALE
    )
    return session.frame(image, number, 1, clock.now_s, plane=plane, **sent)


def test_planes_may_count_their_frames_alone_or_together_and_each_has_its_own_pace_and_queue():
    for numbers in ((1, 1), (1, 2)):
        clock, session = cross()
        for turn in range(300):
            clock.now_s += 0.01
            for plane, number in zip(CROSS, numbers, strict=True):
                session.take_frame(
                    of_plane(
                        session, clock, plane, number + 2 * turn, sent_s=clock.now_s
                    )
                )

        assert (session.decision.code, session.entry("tick", clock.now_s).lost) == (
            1,
            0,
        )
        frames = [
            of_plane(session, clock, plane, 700 + turn)
            for turn in range(15)
            for plane in CROSS
        ]
        assert frames[-1].interval_s == pytest.approx(0.01, abs=1e-3), (
            "of a plane, not of all frames"
        )

        for frame in frames:
            session.defer(
                frame, next(one for one in frames[-2:] if one.plane == frame.plane)
            )

        losses = session.losses(clock.now_s)
        assert sorted((loss.plane, loss.lost) for loss in losses) == [
            ("across", 5),
            ("along", 5),
        ]
        read_again = [session.catch_up().read.plane for _ in range(20)]
        assert read_again == [*CROSS] * 10, "the oldest first"
        assert not session.behind


@pytest.mark.parametrize(
    ("stamped", "apart_s", "lost", "apart"),
    [
        (True, 0.0, 0, 0),
        (True, 0.009, 0, 0),
        (False, 0.001, 0, 0),
        (False, 0.005, 0, 1),
        (False, 0.0099, 0, 1),
        (True, 0.0, 101, 0),
        (False, 0.0, 101, 0),
    ],
)
def test_a_moment_is_one_time_stamp_or_less_than_one_interval(
    stamped: bool, apart_s: float, lost: int, apart: int
) -> None:
    """Frames of two planes, one of which may be lost; the frames of a moment are as
    many turns `apart`.
    """
    clock, session = cross()
    begun_s = clock.now_s
    together = list[int]()

    for number in range(1, 200):
        turn, place = divmod(number, 2)
        clock.now_s = begun_s + 0.01 * turn + apart_s * place
        frame = of_plane(
            session,
            clock,
            CROSS[place],
            number,
            sent_s=begun_s + 0.01 * turn if stamped else None,
        )

        moment = session.moment(frame) if number != lost else ()
        if len(moment) == 2:
            together.append(abs(moment[1].sender_id // 2 - moment[0].sender_id // 2))

    assert set(together[-40:]) == {apart}
    assert len(together) >= 95


def test_a_picture_under_two_names_is_frozen() -> None:
    clock, session = cross()
    for number in range(1, 12):
        clock.now_s += 0.01
        for plane in CROSS:
            image = ScannerFrame(frame_of(10_000, number), **SCALE)
            session.take_frame(
                session.frame(image, number, 1, clock.now_s, plane=plane)
            )

        assert (session.decision.code == 3) == (number >= 2)

    assert session.decision.cause.name == "FROZEN"
    assert "plane across: a picture of 2 frames ago" in session.decision.message


def test_tissue_that_relaxes_has_a_history_in_each_plane() -> None:
    clock = Clock()
    forces_un = {"along": 12_000, "across": 20_000}
    readers = dict.fromkeys(CROSS, reader_of(read, TISSUE))
    session = MonitorSession(readers, LIMITS, clock, clock)
    read_n = dict[str, list[float]](along=[], across=[])

    for number in range(1, 80):
        clock.now_s += 0.01
        for plane in CROSS:
            session.take_frame(
                of_plane(session, clock, plane, number, forces_un[plane])
            )
            read_n[plane].append(session.answer.force_n)

    for plane, force_un in forces_un.items():
        assert read_n[plane] == pytest.approx(
            felt(RELAXING, [force_un] * 79, 100.0)[0], abs=1e-12
        )

    assert session.decision.cause is None


def test_an_entry_of_several_planes_has_the_frames_and_what_all_show_and_another_has_no_such_keys():
    clock, session = cross()
    session.read_together(verdict(12.0, (11.0, 13.0)), (0.1e-3, -0.2e-3, 1e-3))
    frame = of_plane(session, clock, "across", 1)
    session.take_frame(frame)
    record = session.entry("frame", clock.now_s, frame, 0.0).as_json()
    assert (
        record["plane"],
        record["planes_force_mn"],
        record["planes_interval_mn"],
    ) == ("across", 12.0, [11.0, 13.0])
    assert record["contact_xyz_mm"] == pytest.approx((0.1, -0.2, 1.0))
    assert Entry.from_json(record).plane == "across"
    session.read_together(verdict(usable=False, predicted=2), None)
    assert (
        not {"planes_force_mn", "contact_xyz_mm"}
        & session.entry("tick", clock.now_s).as_json().keys()
    )
    assert not {"plane", "contact_xyz_mm"} & READ_ENTRY.as_json().keys()
