"""The server over real sockets, in a process of its own: what clients hear, what
withdraws, who disturbs nobody.
"""

import json
import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from typing import Any

import numpy as np
import pytest
import small_monitor as rule
from small_monitor import (
    FakeCompanion,
    Peer,
    Running,
    TurnedClock,
    frame_of,
    serving,
    small_monitor,
)
from waiting import FUSE_S, alive, wait_until

from scleraforce.live.companions import process_messages
from scleraforce.live.companions.companion_processes import (
    BLACK_BOX,
    CONSOLE,
    OPINION,
    Companions,
)
from scleraforce.live.decision.events import Cause
from scleraforce.live.monitor_server import HEARTBEAT_S
from scleraforce.live.monitor_session import MonitorSession, ReceivedFrame
from scleraforce.live.network.openigtlink import (
    Image,
    Query,
    Sensor,
    Status,
    Transform,
    encode,
)
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup


@pytest.fixture
def clock() -> TurnedClock:
    return TurnedClock()


@pytest.fixture
def port(clock: TurnedClock) -> Iterator[int]:
    with serving(clock=clock) as port:
        yield port


@pytest.fixture
def scanner(port: int, clock: TurnedClock) -> Iterator[Peer]:
    with Peer(port, clock=clock) as peer:
        yield peer


def reset(port: int, token: str = rule.TOKEN) -> tuple[bool, str]:
    return ask_reset("127.0.0.1", port, token, within_s=FUSE_S)


def test_before_a_good_frame_the_answer_is_not_ready_again_and_again(
    scanner: Peer, clock: TurnedClock
) -> None:
    for heard in range(1, 7):
        scanner.hear(lambda peer: len(peer.statuses()) >= heard)  # noqa: B023 - called at once
        clock.turn(HEARTBEAT_S)
    assert {status.code for status in scanner.statuses()} == {13}


def test_every_frame_is_answered_with_a_status_a_string_and_a_sensor(
    scanner: Peer,
) -> None:
    scanner.watch()
    scanner.heard.clear()
    scanner.show(12.345, time_s=2e9)
    scanner.hear(lambda peer: len({type(message) for _, message in peer.heard}) == 3)
    (text,) = [json.loads(message.text) for message in scanner.texts()]
    assert (text["class"], text["state"], text["frame_id"]) == (
        1,
        "WATCHING",
        2_000_000_000_000_000,
    )
    assert text["force_mn"] == pytest.approx(12.345)
    (sensor,) = [
        message.values for _, message in scanner.heard if isinstance(message, Sensor)
    ]
    assert sensor == pytest.approx(
        (
            text["frame"],
            1,
            0,
            1,
            0,
            12.345e-3,
            0.95 * 12.345e-3 - 0.5e-3,
            1.05 * 12.345e-3 + 0.5e-3,
            1,
            1,
        )
    )
    assert "12.3 mN" in scanner.statuses()[-1].message


def test_a_client_that_reads_misses_no_reading(
    port: int, scanner: Peer, clock: TurnedClock
) -> None:
    with Peer(port) as robot:
        for heard in range(1, 30):  # Linux acknowledges at once only what comes first
            robot.hear(lambda peer: len(peer.statuses()) >= heard)  # noqa: B023 - called at once
            clock.turn(HEARTBEAT_S)

        scanner.watch(frames=30)
        robot.hear(lambda peer: peer.readings() == 30)
        assert [json.loads(message.text)["frame"] for message in robot.texts()] == [
            *range(1, 31)
        ]


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_peer_is_answered_in_the_header_version_that_it_speaks(
    port: int, clock: TurnedClock, version: int
) -> None:
    with Peer(port, version, clock) as peer:
        peer.hear(lambda peer: bool(peer.versions))
        assert peer.versions == {1}
        peer.say(Query("STATUS"))
        peer.hear(lambda peer: version in peer.versions)
        peer.versions.clear()
        clock.turn(HEARTBEAT_S)
        peer.hear(lambda peer: bool(peer.versions))
        assert peer.versions == {version}


def send_together(peer: Peer, forces_un: list[int], first: int = 0) -> None:
    """Send a few frames, no more than a socket holds, of which the server sees none
    before all have come.
    """
    images = [
        Image(frame_of(force_un, 1000 + n)[None], rule.MATRIX)
        for n, force_un in enumerate(forces_un, first)
    ]
    assert peer.clock

    with peer.clock.held():
        peer.link.sendall(
            b"".join(
                encode(image, "Scanner", time_s=2e9 + n)
                for n, image in enumerate(images, first)
            )
        )
        peer.deliver()


def wrong_checksum(peer: Peer) -> None:
    data = bytearray(
        encode(Image(frame_of(10_000, 7)[None], rule.MATRIX), "Scanner", time_s=2e9)
    )
    data[-1] ^= 1
    peer.link.sendall(data)


def cut_short(peer: Peer) -> None:
    peer.say(
        Image(
            np.zeros((1, 2, 2), np.uint16),
            rule.MATRIX,
            (rule.COLUMNS, rule.ROWS, 1),
            (0, 0, 0),
        )
    )
    peer.say(
        Image(
            np.zeros((1, 2, 2), np.uint16),
            rule.MATRIX,
            (rule.COLUMNS, rule.ROWS, 1),
            (1, 0, 0),
        )
    )


def flood(peer: Peer) -> None:
    """Many frames at once, from a scanner that has taken 10 ms for each before."""
    for first in range(0, 40, 4):
        read = peer.readings()
        send_together(peer, [10_000 + n for n in range(4)], first)
        peer.hear(lambda peer: peer.readings() > read)  # noqa: B023 - called at once


def scaled(peer: Peer) -> None:
    peer.say(
        Image(frame_of(10_000, 7)[None], (rule.MATRIX[0] * 1.02, *rule.MATRIX[1:]))
    )


def half(peer: Peer) -> None:
    peer.link.sendall(
        encode(Image(frame_of(10_000, 7)[None], rule.MATRIX), "Scanner", time_s=2e9)[
            :500
        ]
    )


def frozen(peer: Peer) -> None:
    for _ in range(3):
        peer.read(10.0, frame_of(10_000, 5))


def stale(peer: Peer) -> None:
    assert peer.clock
    begin_s = peer.clock()
    for number in range(20):
        peer.clock.turn(0.05)
        peer.read(10.0, time_s=begin_s + 0.001 * (number + 1))


def silence(peer: Peer) -> None:
    assert peer.clock
    peer.clock.turn(0.6)


FAULTS: dict[str, tuple[Callable[[Peer], object], Cause]] = {
    "class 2": (lambda peer: peer.show(35.0), Cause.DANGEROUS_CLASS),
    "not usable": (
        lambda peer: peer.show(0, frame_of(rule.UNUSABLE, 1)),
        Cause.UNUSABLE,
    ),
    "an exception of the reader": (
        lambda peer: peer.show(0, frame_of(rule.RAISES, 1)),
        Cause.EXCEPTION,
    ),
    "silence": (silence, Cause.SILENCE),
    "half a frame": (lambda peer: (half(peer), silence(peer)), Cause.SILENCE),
    "frozen": (frozen, Cause.FROZEN),
    "stale": (stale, Cause.STALE),
    "out of order": (lambda peer: peer.show(10.0, time_s=1e9), Cause.OUT_OF_ORDER),
    "another size": (
        lambda peer: peer.show(10.0, frame_of(10_000, 3)[:-1]),
        Cause.SIZE,
    ),
    "another scale": (scaled, Cause.SCALE),
    "checksum": (wrong_checksum, Cause.CHECKSUM),
    "overlapping parts": (cut_short, Cause.BAD_IMAGE),
    "garbage": (lambda peer: peer.link.sendall(b"\xff" * 100), Cause.BAD_IMAGE),
    "too many at once": (flood, Cause.QUEUE_BEHIND),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_withdraws_and_says_why_to_everybody(
    port: int, scanner: Peer, fault: str
) -> None:
    inject, cause = FAULTS[fault]
    with Peer(port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))
        scanner.watch()
        robot.hear(lambda peer: peer.readings() == 12)
        assert robot.statuses()[-1].code == 1
        inject(scanner)
        status = robot.wait_for_code(3)

    assert (status.subcode, status.name) == (cause.value, cause.name), status.message


def test_no_frame_mixes_parts_from_before_and_after_a_damaged_message(
    scanner: Peer,
) -> None:
    scanner.watch()
    frames = json.loads(scanner.texts()[-1].text)["frame"]
    whole = frame_of(10_000, 9)
    upper, lower = (
        Image(
            whole[None, rows],
            rule.MATRIX,
            (rule.COLUMNS, rule.ROWS, 1),
            (0, rows.start, 0),
        )
        for rows in (slice(0, rule.ROWS // 2), slice(rule.ROWS // 2, rule.ROWS))
    )
    scanner.say(upper)
    wrong_checksum(scanner)
    scanner.say(lower)
    scanner.read(10.0)
    # the damaged one has no number
    assert json.loads(scanner.texts()[-1].text)["frame"] == frames + 1


def test_a_frame_that_cannot_be_right_counts_also_where_a_newer_one_came_with_it(
    scanner: Peer,
) -> None:
    scanner.watch()
    small, newer = (
        Image(frame_of(force_un, 4)[None, :rows], rule.MATRIX)
        for force_un, rows in ((10_000, -1), (10_010, rule.ROWS))
    )
    scanner.link.sendall(
        encode(small, "Scanner", time_s=2e9) + encode(newer, "Scanner", time_s=2e9 + 1)
    )
    assert scanner.wait_for_code(3).subcode == Cause.SIZE.value


@pytest.mark.parametrize(
    ("cause", "force_un"),
    [(Cause.DANGEROUS_CLASS, 35_000), (Cause.EXCEPTION, rule.RAISES)],
)
def test_a_frame_that_newer_ones_overtook_is_read_after_them(
    scanner: Peer, cause: Cause, force_un: int
) -> None:
    scanner.watch()
    read = scanner.readings()
    send_together(scanner, [force_un, 10_010, 10_020])
    assert scanner.wait_for_code(3).subcode == cause.value
    assert scanner.readings() == read + 1  # the newest is answered, and first
    last = json.loads(scanner.texts()[-1].text)
    assert (last["state"], last["overtaken"], last["lost"]) == ("WATCHING", 2, 0)


def test_overtaken_frames_wait_for_a_newer_one_without_a_cause(
    scanner: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = list[int]()
    read_frame = MonitorSession._read_frame

    def read(session: MonitorSession, frame: ReceivedFrame) -> object:
        order.append(frame.number)
        if frame.number == 15:
            scanner.show(10.03, time_s=3e9)
            scanner.deliver()  # it waits when the server looks next
        return read_frame(session, frame)

    scanner.watch()
    monkeypatch.setattr(MonitorSession, "_read_frame", read)
    send_together(scanner, [10_000, 10_010, 10_020])  # frames 13 to 15
    wait_until(lambda: len(order) == 4)
    assert order == [15, 16, 13, 14]
    scanner.read(10.0, time_s=4e9)
    last = json.loads(scanner.texts()[-1].text)
    assert (last["state"], last["overtaken"], last["lost"]) == ("WATCHING", 2, 0)


def test_a_withdrawal_stays_until_the_operators_reset_on_fresh_harmless_frames(
    port: int, scanner: Peer
) -> None:
    scanner.watch()
    scanner.show(40.0)
    scanner.wait_for_code(3)
    assert reset(port)[0] is False  # no frame is fresh

    for _ in range(8):
        scanner.read(10.0)

    assert {status.code for status in scanner.statuses()[-6:]} == {3}
    granted, message = reset(port, "wrong")
    assert not granted
    assert "token" in message
    assert reset(port)[0] is True
    scanner.heard.clear()
    scanner.show(10.0)
    assert scanner.wait_for_code(1).subcode == 0


def test_another_who_sends_images_is_refused_while_the_scanner_sends(
    port: int, scanner: Peer
) -> None:
    scanner.watch()
    with Peer(port) as other:
        other.show(40.0)
        scanner.watch()
    assert {status.code for status in scanner.statuses()[-5:]} == {1}


def test_another_becomes_the_scanner_when_the_first_has_left(port: int) -> None:
    with Peer(port) as first:
        first.show(0.1, time_s=2e9)
        first.wait_for_code(1)
    with Peer(port) as second, Peer(port) as robot:
        second.show(40.0)
        assert robot.wait_for_code(3)


@pytest.mark.parametrize(
    "rudeness",
    [
        b"\xff" * 1000,
        b"GET / HTTP/1.1\r\n\r\n" * 9,
        b"\0" * 58,
        encode(Status(1), "X")[:-1] + b"\1",
        b"half a header",
    ],
    ids=["garbage", "http", "zeros", "wrong checksum", "half"],
)
def test_what_others_do_wrong_disturbs_nobody(
    port: int, scanner: Peer, rudeness: bytes
) -> None:
    scanner.watch()
    with socket.create_connection(("127.0.0.1", port)) as rude:
        rude.sendall(rudeness)
        scanner.watch()
    scanner.watch()


class CountingGuard(rule.NoGuard):
    """Counts the signs of life."""

    beats = 0

    def beat(self, _now_s: float) -> None:
        self.beats += 1


def test_the_watchdog_hears_of_each_frame_of_a_backlog() -> None:
    """Sixteen large ones in one turn, with one sign of life, cost a monitor its
    life.
    """
    guard = CountingGuard()
    server, port = rule.small_server(guard, Companions({}), clock=TurnedClock())  # type: ignore[arg-type] # no Guard
    frames = 5

    with Peer(port) as scanner:
        wait_until(lambda: server._turn(0.1) or len(list(server._clients)) == 1)
        for number in range(frames):
            scanner.show(10.0 + 0.01 * number)
        scanner.deliver()
        before = guard.beats
        server._turn(0.1)
        assert server.session.behind
        assert guard.beats - before >= frames
        server.close()


def test_others_have_two_milliseconds_a_turn_and_who_has_waited_longest_is_first(
    monkeypatch,
) -> None:
    server, port = rule.small_server(rule.NoGuard(), Companions({}))  # type: ignore[arg-type] # no Guard
    heard = list[int]()
    now_s = count(10.0, 1.1e-3)
    hear = server._hear
    monkeypatch.setattr(server.session, "clock", lambda: next(now_s))
    monkeypatch.setattr(
        server, "_hear", lambda client: (heard.append(client.number), hear(client))
    )

    with ExitStack() as stack:
        peers = [stack.enter_context(Peer(port)) for _ in range(5)]
        wait_until(lambda: server._turn(0.1) or len(list(server._clients)) == 5)

        for _ in range(3):
            for peer in peers:
                peer.say(Query("STATUS"))
                peer.deliver()

            server._turn(0.1)

        # each takes two looks at this clock, 2.2 ms
        assert len(heard) == len(set(heard)) == 3
        server.close()


def test_half_a_message_does_not_stay_for_ever(clock: TurnedClock) -> None:
    with serving(message_s=0.2, clock=clock) as port, Peer(port) as slow:
        slow.link.sendall(b"\0\1half")
        while not slow.closed:
            clock.turn(0.1)
            slow.hear(within_s=0.02)


def test_the_pose_of_the_needle_is_its_travel_along_its_own_axis(
    scanner: Peer, monkeypatch
) -> None:
    travels_m: list[float] = []
    monkeypatch.setattr(
        MonitorSession,
        "travelled",
        lambda _, travel_m, at_s: travels_m.append(travel_m) if at_s else None,
    )
    pose = Transform((0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8, 3.0, 50.0, 4.0))
    scanner.say(pose, "Probe")
    scanner.say(pose, "NeedlePose")
    scanner.read(10.0)
    assert travels_m == pytest.approx([0.005])


def test_the_black_box_hears_of_a_frames_travel_while_it_is_recent(
    clock: TurnedClock,
) -> None:
    with beside(clock, BLACK_BOX) as (_, scanner, companions):
        scanner.say(
            Transform((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 4.0)),
            "NeedlePose",
        )
        scanner.read(10.0)
        heard: list[process_messages.CompanionMessage] = []
        wait_until(
            lambda: (
                heard.extend(companions[BLACK_BOX].theirs.receive())
                or _travels_m(heard)[-1:] == [0.004]
            )
        )
        assert _travels_m(heard)[:-1] == [None] * (len(_travels_m(heard)) - 1)


def _travels_m(heard: list[process_messages.CompanionMessage]) -> list[float | None]:
    return [
        one.travel_m
        for one in heard
        if isinstance(one, process_messages.Decided) and one.entry.frame is not None
    ]


def test_other_messages_are_read_over(scanner: Peer) -> None:
    scanner.watch()
    for _ in range(6):
        scanner.say(Transform((1.0,) * 12), "Probe")
        scanner.say(Sensor((0.01, float("nan"))), "RobotForce")
        scanner.say(Status(13, message="of the peer"), "Robot")
        scanner.say(Query("CAPABIL"), "Robot")
        scanner.read(10.0)

    assert scanner.statuses()[-1].code == 1


def test_a_crowd_that_says_nothing_locks_out_neither_the_operator_nor_a_scanner(
    clock: TurnedClock,
) -> None:
    with serving(clients=20, clock=clock) as port, ExitStack() as stack:
        crowd = [stack.enter_context(Peer(port)) for _ in range(30)]
        for peer in crowd:
            peer.hear(lambda peer: bool(peer.statuses()))

        with Peer(port, clock=clock) as scanner:
            scanner.watch()
            scanner.show(40.0)
            scanner.wait_for_code(3)
            for _ in range(8):
                scanner.read(10.0)

            crowd += [stack.enter_context(Peer(port)) for _ in range(30)]
            scanner.show(10.0)
            assert reset(port)[0] is True
            scanner.watch()

        assert all(peer.statuses()[0].code == 13 for peer in crowd[:18])


def gone(peer: Peer, frame: int) -> bool:
    """Read what has come; return whether the connection has ended before this frame was
    read.
    """
    peer.hear(
        lambda peer: any(
            f'"frame": {frame},' in message.text for message in peer.texts()
        )
    )
    return peer.closed


def test_who_was_there_first_and_the_scanner_keep_their_places(
    clock: TurnedClock,
) -> None:
    with serving(clients=20, clock=clock) as port, ExitStack() as stack:
        first = [stack.enter_context(Peer(port)) for _ in range(17)]
        with Peer(port, clock=clock) as scanner:
            scanner.watch()
            crowd = [stack.enter_context(Peer(port)) for _ in range(30)]
            for peer in crowd:
                peer.hear(lambda peer: bool(peer.statuses()))

            scanner.watch()
            assert not any(gone(peer, 24) for peer in first)
            assert [gone(peer, 24) for peer in crowd] == [True] * 28 + [False] * 2


def kill(number: signal.Signals) -> Callable[[Running, Peer], None]:
    return lambda running, _: os.kill(running.process.pid, number)


DEATHS: dict[str, Callable[[Running, Peer], None]] = {
    "killed": kill(signal.SIGKILL),
    "stopped": kill(signal.SIGSTOP),
    "a tight loop": lambda _, scanner: scanner.show(0, frame_of(rule.HANGS, 1)),
}


LOOK_S = 1.0  # so that the watchdog bears five seconds


@pytest.mark.parametrize(
    "death",
    [
        "killed",
        *(
            pytest.param(death, marks=pytest.mark.slow)
            for death in ("stopped", "a tight loop")
        ),
    ],
)
def test_the_watchdog_tells_everybody_when_the_monitor_hangs_or_dies(
    death: str,
) -> None:
    with small_monitor(look_s=LOOK_S) as running:
        with Peer(running.port) as scanner, Peer(running.port, version=2) as robot:
            robot.say(Query("STATUS"))
            robot.hear(lambda peer: peer.versions == {1, 2})
            scanner.watch()
            robot.hear(lambda peer: peer.readings() == 12)
            robot.versions.clear()
            DEATHS[death](running, scanner)

            for peer in (robot, scanner):
                status = peer.wait_for_code(3)
                assert (status.subcode, status.name) == (
                    Cause.WATCHDOG.value,
                    "WATCHDOG",
                )

            heard = len(robot.statuses())
            robot.hear(lambda peer: len(peer.statuses()) >= heard + 5)
            # never OK again
            assert {status.code for status in robot.statuses()[heard:]} == {3}
            assert robot.versions == {2}

        # it ends when the last client has left
        wait_until(lambda: not alive(running.watchdog_pid))
        assert running.process.wait(FUSE_S) == -signal.SIGKILL


def test_a_watchdog_that_dies_is_a_cause_and_no_reset_helps() -> None:
    with small_monitor() as running, Peer(running.port) as scanner:
        scanner.watch()
        os.kill(running.watchdog_pid, signal.SIGKILL)
        status = scanner.wait_for_code(3)
        assert "watchdog" in status.message

        for _ in range(8):
            scanner.read(10.0)

        assert reset(running.port)[0] is False


@pytest.mark.slow
def test_a_watchdog_that_is_stopped_is_a_cause() -> None:
    with small_monitor(look_s=0.4) as running, Peer(running.port) as scanner:
        scanner.watch()
        os.kill(running.watchdog_pid, signal.SIGSTOP)

        try:
            assert (
                "the watchdog has not answered for 10 s"
                in scanner.wait_for_code(3).message
            )
            scanner.read(10.0)
            assert scanner.statuses()[-1].code == 3
        finally:
            os.kill(running.watchdog_pid, signal.SIGCONT)


def test_the_end_as_planned_withdraws_and_leaves_no_process() -> None:
    with small_monitor() as running, Peer(running.port) as scanner:
        scanner.watch()
        assert running.process.stdin
        running.process.stdin.close()
        assert "the monitor ends" in scanner.wait_for_code(3).message
        assert running.process.wait(FUSE_S) == 0
        wait_until(lambda: not alive(running.watchdog_pid))


def test_the_operator_hears_of_each_change_of_state_once(clock: TurnedClock) -> None:
    lines: list[str] = []
    with (
        serving(note=lines.append, clock=clock) as port,
        Peer(port, clock=clock) as scanner,
    ):
        scanner.watch()
        for force_mn in (40.0, 41.0, 42.0):
            scanner.read(force_mn)

    states = [line.split()[1] for line in lines]
    assert states == ["WATCHING:", "WITHDRAW:"]
    assert "class 2" in lines[1]


@contextmanager
def beside(
    clock: TurnedClock, *names: str
) -> Iterator[tuple[int, Peer, dict[str, FakeCompanion]]]:
    """Run a server beside companions of these names; gives its port, a scanner that it
    watches, and the companions.
    """
    companions = {name: FakeCompanion() for name in names}
    with (
        serving(Companions(companions), clock=clock) as port,
        Peer(port, clock=clock) as scanner,
    ):
        scanner.watch()
        yield port, scanner, companions

    for companion in companions.values():
        companion.end()


def test_the_second_opinion_is_asked_about_each_frame_and_what_it_says_counts(
    clock: TurnedClock,
) -> None:
    with beside(clock, OPINION) as (_, scanner, companions):
        asked: list[process_messages.CompanionMessage] = []
        wait_until(
            lambda: (
                asked.extend(companions[OPINION].theirs.receive()) or len(asked) >= 12
            )
        )
        questions = [
            message
            for message in asked
            if isinstance(message, process_messages.OpinionAsked)
        ]
        assert [question.number for question in questions] == list(range(1, 13))
        assert questions[-1].teaches
        opinion = process_messages.OpinionGiven(
            order=questions[-1].order,
            verdict=rule.verdict(
                31.0, (30.0, 32.0), predicted=2, probabilities=(0.0, 0.0, 1.0)
            ),
        )
        companions[OPINION].says(opinion)
        status = scanner.wait_for_code(3)
        assert (status.name, "second opinion" in status.message) == (
            "DANGEROUS_CLASS",
            True,
        )
        scanner.read(10.0)  # it is harmless, and the withdrawal is held
        wait_until(
            lambda: (
                asked.extend(companions[OPINION].theirs.receive()) or len(asked) >= 13
            )
        )
        assert not asked[-1].teaches  # type: ignore[union-attr]


def test_what_the_second_opinion_remarks_is_logged_and_told_to_the_console_once(
    clock: TurnedClock,
) -> None:
    differ = Remark("methods-disagree", "they differ")
    leans = Remark("lean-contradicted", "it leans", ("lean_rad",))
    with beside(clock, OPINION, BLACK_BOX, CONSOLE) as (_, scanner, companions):
        for remarks in ((differ,), (differ, leans), (leans,)):
            companions[OPINION].says(
                process_messages.OpinionGiven(
                    order=1, verdict=rule.verdict(9.0, (8.0, 10.0)), remarks=remarks
                )
            )

        told: list[process_messages.CompanionMessage] = []

        def shown() -> bool:
            scanner.read(10.0)
            told.extend(companions[CONSOLE].theirs.receive())
            rates = [one for one in told if isinstance(one, process_messages.Rates)]
            return bool(rates) and rates[-1].remarks == (differ, leans)

        wait_until(shown)
        noted = [
            message.text
            for message in companions[BLACK_BOX].theirs.receive()
            if isinstance(message, process_messages.Note)
        ]
        assert [text for text in noted if "second opinion" in text] == [
            "second opinion: methods-disagree: they differ",
            "second opinion: lean-contradicted: it leans",
        ]


def test_what_was_learned_of_the_eye_is_in_each_later_reading_and_ends_no_withdrawal(
    clock: TurnedClock,
) -> None:
    with beside(clock, OPINION) as (_, scanner, companions):
        assert json.loads(scanner.texts()[-1].text)["modulus_mpa"] is None
        scanner.read(39.0)
        known = Setup(
            eye=Eye(modulus=Modulus(mean_pa=0.3e6, sd_pa=0.02e6, source="shape"))
        )
        companions[OPINION].says(
            process_messages.EyeLearned(setup=known, frames=7, fault="")
        )

        def learned() -> bool:
            scanner.read(10.0)
            said = json.loads(scanner.texts()[-1].text)
            found = [said[f"modulus_{name}"] for name in ("mpa", "sd_mpa", "frames")]
            return found == pytest.approx([0.3, 0.02, 7])

        wait_until(learned)
        assert scanner.statuses()[-1].code == 3


@pytest.mark.parametrize("name", [BLACK_BOX, OPINION])
def test_a_companion_that_fails_is_a_cause_until_it_says_that_this_is_over(
    name: str, clock: TurnedClock
) -> None:
    with beside(clock, name) as (port, scanner, companions):
        companions[name].says(process_messages.SelfReport(detail="log: no space left"))
        status = scanner.watch_until(3)
        assert (status.name, f"{name}: log: no space left" in status.message) == (
            "EXCEPTION",
            True,
        )

        for over in (False, True):
            if over:
                companions[name].says(process_messages.Alive(faults=()))
            for _ in range(8):
                scanner.read(10.0)

            assert reset(port)[0] is over


@pytest.mark.slow
def test_clients_that_flood_the_log_take_nothing_of_the_decisions_and_the_log_says_what_it_left_out(
    clock: TurnedClock,
) -> None:
    wrong = encode(Status(1), "X")[:-1] + b"\1"
    heard: list[process_messages.CompanionMessage] = []

    with beside(clock, BLACK_BOX) as (port, scanner, companions), Peer(port) as rude:
        box = companions[BLACK_BOX]
        for _ in range(20):
            rude.link.sendall((encode(Sensor((0.01,)), "RobotForce") * 20 + wrong) * 5)
            scanner.watch(frames=3)
            heard += box.theirs.receive()

        while (
            not any("were dropped" in str(one) for one in heard)
            or sum(isinstance(one, process_messages.Decided) for one in heard) < 60
        ):
            scanner.watch(frames=3)
            heard += box.theirs.receive()

    entries = [
        message.entry.number
        for message in heard
        if isinstance(message, process_messages.Decided)
    ]
    assert entries == list(range(1, len(entries) + 1))
    assert len(entries) >= 60
    checksums = [
        message
        for message in heard
        if isinstance(message, process_messages.Note) and "checksum" in message.text
    ]
    assert 10 <= len(checksums) < 40
    assert (
        sum(isinstance(message, process_messages.ForceHeard) for message in heard)
        >= 100
    )


@pytest.mark.slow
def test_while_no_frames_come_the_console_gets_the_state_again_and_the_log_has_no_gaps(
    clock: TurnedClock,
) -> None:
    logged = list[process_messages.Entry]()
    shown = list[process_messages.Entry]()

    with beside(clock, BLACK_BOX, CONSOLE) as (_, _, companions):

        def withdrawn_and_repeated() -> bool:
            clock.turn(HEARTBEAT_S)
            for name, entries in ((BLACK_BOX, logged), (CONSOLE, shown)):
                heard = companions[name].theirs.receive()
                entries += [
                    message.entry
                    for message in heard
                    if isinstance(message, process_messages.Decided)
                ]

            return (
                sum(
                    entry.event == "again" and entry.state == "WITHDRAW"
                    for entry in shown
                )
                >= 2
            )

        wait_until(withdrawn_and_repeated)

    assert [entry.number for entry in logged] == list(range(1, len(logged) + 1))
    assert logged[-1].state == "WITHDRAW"
    # a silence is logged once, however long it lasts
    assert sum(entry.event == "tick" for entry in logged) == 1
    again = [entry for entry in shown if entry.event == "again"]
    assert (again[-1].state, again[-1].number, again[-1].frame) == (
        "WITHDRAW",
        logged[-1].number,
        None,
    )


CROSS = ("along", "across")


def test_frames_of_planes_are_known_by_their_device_and_each_moment_is_asked_about_once(
    clock: TurnedClock,
) -> None:
    companions = {name: FakeCompanion() for name in (OPINION, BLACK_BOX)}
    with (
        serving(Companions(companions), clock=clock, planes=CROSS) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        for _ in range(3):
            scanner.read(10.0, device="across")
            assert scanner.statuses()[-1].code == 13, (
                "the other plane has sent nothing yet"
            )

        for number in range(12):
            for plane in CROSS:
                scanner.read(10.0, device=plane, time_s=2e9 + 0.02 * number)

        assert scanner.statuses()[-1].code == 1
        assert [json.loads(text.text)["plane"] for text in scanner.texts()[-4:]] == [
            *CROSS
        ] * 2
        asked = list[Any]()
        wait_until(
            lambda: (
                asked.extend(companions[OPINION].theirs.receive()) or len(asked) >= 12
            )
        )
        assert [tuple(name for name, *_ in one.planes) for one in asked] == [CROSS] * 12
        heard = companions[BLACK_BOX].theirs.receive()
        decided = [
            one
            for one in heard
            if isinstance(one, process_messages.Decided) and one.entry.frame
        ]
        assert [one.moment for one in decided[-4:]] == [24, 24, 26, 26]
        (_, _, order), (_, _, other) = asked[-1].planes
        contact_m = (1e-4, 2e-4, 1e-3)

        for plane, of_plane in zip(CROSS, (order, other), strict=True):
            given = process_messages.OpinionGiven(
                order=of_plane,
                verdict=rule.verdict(9.0, (8.0, 10.0)),
                plane=plane,
                contact_m=contact_m,
            )
            companions[OPINION].says(given)

        later_s = count(2e9 + 1.0, 0.02)

        def read_together() -> bool:
            for plane in CROSS:
                scanner.read(10.0, device=plane, time_s=next(later_s))
            return json.loads(scanner.texts()[-1].text).get(
                "contact_xyz_mm"
            ) == pytest.approx([0.1, 0.2, 1.0])

        wait_until(read_together)
        scanner.show(10.0, device="Scanner")
        status = scanner.wait_for_code(3)
        words = "IMAGE of device 'Scanner': must be a plane's name: along, across"
        assert (status.name, words in status.message) == ("BAD_IMAGE", True)

    for companion in companions.values():
        companion.end()


def test_of_frames_that_came_together_the_newest_of_each_plane_is_answered_first(
    clock: TurnedClock,
) -> None:
    with (
        serving(clock=clock, planes=CROSS) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        for number in range(4):
            for plane in CROSS:
                scanner.read(10.0, device=plane, message_id=number + 1)

        images = [
            encode(
                Image(frame_of(10_000 + n, n)[None], rule.MATRIX),
                plane,
                version=2,
                time_s=2e9,
                message_id=n,
            )
            for n in range(11, 14)
            for plane in CROSS
        ]
        with clock.held():
            scanner.link.sendall(b"".join(images))
            scanner.deliver()

        scanner.hear(lambda peer: peer.readings() >= 10)
        texts = [json.loads(text.text) for text in scanner.texts()[-2:]]
        assert [
            (text["plane"], text["frame_id"], text["overtaken"]) for text in texts
        ] == [
            ("along", 13, 4),
            ("across", 13, 4),
        ]
        assert scanner.statuses()[-1].code == 1


def test_an_old_picture_with_one_fresh_row_is_not_a_frame(clock: TurnedClock) -> None:
    """Its last part alone was asked for its time: 344 OKs at 35 mN."""
    with serving(clock=clock) as port, Peer(port, version=2, clock=clock) as scanner:
        scanner.watch(10.0)
        whole = frame_of(10_000, 999)
        size = (rule.COLUMNS, rule.ROWS, 1)
        last = rule.ROWS - 1
        for row, end, age_s in ((0, last, 5.0), (last, rule.ROWS, 0.0)):
            part = Image(whole[None, row:end], rule.MATRIX, size, (0, row, 0))
            scanner.say(part, time_s=clock() - age_s)
        assert scanner.wait_for_code(3).name == "BAD_IMAGE"


def test_parts_of_images_of_two_planes_may_come_in_turns(clock: TurnedClock) -> None:
    with (
        serving(clock=clock, planes=CROSS) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        whole = frame_of(10_000, 1)
        for first in (0, rule.ROWS // 2):
            for plane in CROSS:
                part = whole[None, first : first + rule.ROWS // 2] + np.uint16(
                    plane == "across"
                )
                image = Image(
                    part, rule.MATRIX, (rule.COLUMNS, rule.ROWS, 1), (0, first, 0)
                )
                scanner.say(image, plane, message_id=1, time_s=1.8e9)

        scanner.hear(lambda peer: peer.readings() >= 2)
        assert scanner.statuses()[-1].code == 1
