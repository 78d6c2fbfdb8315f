"""A monitor over real sockets: what clients hear, what withdraws, who disturbs nobody."""

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
from fake_monitor import HEARTBEAT_S
from numpy.typing import NDArray
from small_monitor import (
    FakeCompanion,
    Peer,
    Running,
    TurnedClock,
    frame_of,
    reset,
    serving,
    small_monitor,
)
from waiting import FUSE_S, alive, wait_until

from scleraforce.live.companions import process_messages
from scleraforce.live.companions.companion_processes import BLACK_BOX, CONSOLE, OPINION
from scleraforce.live.decision.events import Cause
from scleraforce.live.network.openigtlink import (
    Image,
    Query,
    Sensor,
    Status,
    Transform,
    encode,
)
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup

NAN = float("nan")


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


@pytest.mark.parametrize(
    ("force_un", "code", "cause", "words", "values"),
    [
        (
            12_345,
            1,
            None,
            "12.3 mN",
            (1, 0, 1, 0, 12.345e-3, 11.22775e-3, 13.46225e-3, 1),
        ),
        (rule.UNUSABLE, 3, "UNUSABLE", "no wall", (2, *[NAN] * 6, 0.0)),
        (rule.RAISES, 3, "EXCEPTION", "the reader broke", (*[NAN] * 7, 0.0)),
    ],
    ids=["read", "not usable", "not read"],
)
def test_every_frame_is_answered_with_a_status_a_string_and_a_sensor(
    scanner, force_un, code, cause, words, values
):
    """The SENSOR has frame, class, probabilities, force, interval, usable and code."""
    scanner.watch()
    scanner.heard.clear()
    scanner.show(0, frame_of(force_un, 1), time_s=2e9)
    scanner.hear(lambda peer: len({type(message) for _, message in peer.heard}) == 3)
    said = scanner.said()
    assert (said["frame"], said["frame_id"]) == (13, 2_000_000_000_000_000)
    assert (said["code"], said["cause"], said["usable"]) == (
        code,
        cause,
        bool(values[-1]),
    )
    (sensor,) = [
        message.values for _, message in scanner.heard if isinstance(message, Sensor)
    ]
    assert sensor == pytest.approx((13, *values, code), nan_ok=True)
    assert words in scanner.status.message


def test_a_client_that_reads_misses_no_reading(port, scanner, clock):
    with Peer(port) as robot:
        for heard in range(1, 30):  # Linux acknowledges at once only what comes first
            robot.hear(lambda peer: len(peer.statuses()) >= heard)  # noqa: B023 - called at once
            clock.turn(HEARTBEAT_S)

        scanner.watch(frames=30)
        robot.hear_readings(30)
        assert robot.said()["frame"] == 30


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_peer_is_answered_in_the_header_version_that_it_speaks(port, clock, version):
    with Peer(port, version, clock) as peer:
        peer.hear(lambda peer: bool(peer.versions))
        assert peer.versions == {1}
        peer.say(Query("STATUS"))
        peer.hear(lambda peer: version in peer.versions)
        peer.versions.clear()
        clock.turn(HEARTBEAT_S)
        peer.hear(lambda peer: bool(peer.versions))
        assert peer.versions == {version}


SIZE = (rule.COLUMNS, rule.ROWS, 1)


def part(pixels: NDArray[np.uint16], begin: int, end: int) -> Image:
    """The rows of a frame from `begin` to `end`."""
    return Image(pixels[None, begin:end], rule.MATRIX, SIZE, (0, begin, 0))


def wrong_checksum(peer: Peer) -> None:
    data = bytearray(
        encode(Image(frame_of(10_000, 7)[None], rule.MATRIX), "Scanner", time_s=2e9)
    )
    data[-1] ^= 1
    peer.link.sendall(data)


def overlapping(peer: Peer) -> None:
    for begin in (0, 1):
        peer.say(part(frame_of(10_000, 8), begin, begin + 2), time_s=2e9)


def flood(peer: Peer) -> None:
    """Many frames at once, from a scanner that has taken 10 ms for each before."""
    times_s = count(2e9)
    for _ in range(10):
        read = peer.readings()
        peer.show_together(
            *(10.0, 10.01, 10.02, 10.03),
            within_s=0.0,
            headers=lambda _: {"time_s": next(times_s)},
        )
        peer.hear_readings(read + 1)


def scaled(peer: Peer) -> None:
    matrix = (rule.MATRIX[0] * 1.02, *rule.MATRIX[1:])
    peer.say(Image(frame_of(10_000, 7)[None], matrix))


def half(peer: Peer) -> None:
    whole = encode(Image(frame_of(10_000, 7)[None], rule.MATRIX), "Scanner", time_s=2e9)
    peer.link.sendall(whole[:500])
    silence(peer)


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


def small_before_another(peer: Peer) -> None:
    """A frame that cannot be right counts also if a newer one comes with it."""
    images = [Image(frame_of(10_000, 4)[None, :rows], rule.MATRIX) for rows in (-1, 64)]
    data = [encode(image, "Scanner", time_s=2e9 + n) for n, image in enumerate(images)]
    peer.link.sendall(b"".join(data))


FAULTS = {
    "class 2": (lambda peer: peer.show(35.0), Cause.DANGEROUS_CLASS),
    "silence": (silence, Cause.SILENCE),
    "half a frame": (half, Cause.SILENCE),
    "frozen": (frozen, Cause.FROZEN),
    "stale": (stale, Cause.STALE),
    "out of order": (lambda peer: peer.show(10.0, time_s=1e9), Cause.OUT_OF_ORDER),
    "another size": (small_before_another, Cause.SIZE),
    "another scale": (scaled, Cause.SCALE),
    "checksum": (wrong_checksum, Cause.CHECKSUM),
    "overlapping parts": (overlapping, Cause.BAD_IMAGE),
    "garbage": (lambda peer: peer.link.sendall(b"\xff" * 100), Cause.BAD_IMAGE),
    "too many at once": (flood, Cause.QUEUE_BEHIND),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_withdraws_and_says_why_to_everybody(port, scanner, fault):
    inject, cause = FAULTS[fault]
    with Peer(port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))
        scanner.watch()
        robot.hear_readings(12)
        assert robot.status.code == 1
        inject(scanner)
        status = robot.wait_for_code(3)

    assert (status.subcode, status.name) == (cause.value, cause.name), status.message


def test_no_frame_mixes_parts_from_before_and_after_a_damaged_message(
    scanner,
):
    scanner.watch()
    frames = scanner.said()["frame"]
    whole = frame_of(10_000, 9)
    scanner.say(part(whole, 0, 32), time_s=2e9)
    wrong_checksum(scanner)
    scanner.say(part(whole, 32, 64), time_s=2e9)
    scanner.read(10.0, time_s=2e9 + 1)
    # the damaged one has no number
    assert scanner.said()["frame"] == frames + 1


def test_an_old_picture_with_one_fresh_row_is_not_a_frame(scanner, clock):
    """Its last part alone was asked for its time: 344 OKs at 35 mN."""
    scanner.watch(10.0)
    whole = frame_of(10_000, 999)
    scanner.say(part(whole, 0, 63), time_s=clock() - 5.0)
    scanner.say(part(whole, 63, 64), time_s=clock())
    assert scanner.wait_for_code(3).name == "BAD_IMAGE"


@pytest.mark.parametrize(
    ("cause", "force_un"),
    [(Cause.DANGEROUS_CLASS, 35_000), (Cause.EXCEPTION, rule.RAISES)],
)
def test_a_frame_that_newer_ones_overtook_is_read_after_them(scanner, cause, force_un):
    scanner.watch()
    read = scanner.readings()
    scanner.show_together(force_un / 1e3, 10.01, 10.02)
    assert scanner.wait_for_code(3).subcode == cause.value
    assert scanner.readings() == read + 1  # the newest is answered, and first
    last = scanner.said()
    assert (last["state"], last["overtaken"], last["lost"]) == ("WATCHING", 2, 0)


def test_overtaken_frames_wait_for_a_newer_one_without_a_cause(
    clock,
):
    order = []

    def read(pixels, scale):
        order.append(int(pixels[0, 0]))
        if order == [10_020]:
            scanner.show(10.03, time_s=3e9)
            scanner.deliver()  # it waits when the server looks next
        return rule.read(pixels, scale)

    with serving(rule=read, clock=clock) as port, Peer(port, clock=clock) as scanner:
        scanner.watch()
        order.clear()
        scanner.show_together(10.0, 10.01, 10.02)
        wait_until(lambda: len(order) == 4)
        assert order == [10_020, 10_030, 10_000, 10_010]
        scanner.read(10.0, time_s=4e9)
        last = scanner.said()
        assert (last["state"], last["overtaken"], last["lost"]) == ("WATCHING", 2, 0)


def test_a_withdrawal_stays_until_the_operators_reset_on_fresh_harmless_frames(
    port, scanner
):
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


def test_another_who_sends_images_is_refused_while_the_scanner_sends(port, scanner):
    scanner.watch()
    with Peer(port) as other:
        other.show(40.0)
        scanner.watch()
    assert {status.code for status in scanner.statuses()[-5:]} == {1}


RUDENESS = {
    "garbage": b"\xff" * 1000,
    "http": b"GET / HTTP/1.1\r\n\r\n" * 9,
    "zeros": b"\0" * 58,
    "wrong checksum": encode(Status(1), "X")[:-1] + b"\1",
    "half": b"half a header",
    "others' messages": encode(Transform((1.0,) * 12), "Probe")
    + encode(Sensor((0.01, NAN)), "RobotForce")
    + encode(Status(13, message="of the peer"), "Robot")
    + encode(Query("CAPABIL"), "Robot"),
}


def test_what_others_do_wrong_disturbs_nobody(port, scanner):
    scanner.watch()
    with ExitStack() as stack:
        for rudeness in RUDENESS.values():
            rude = socket.create_connection(("127.0.0.1", port))
            stack.enter_context(rude).sendall(rudeness)
            scanner.watch(frames=3)

    scanner.link.sendall(RUDENESS["others' messages"])
    scanner.watch(frames=3)


class Noting(rule.NoGuard):
    """Counts the signs of life, and notes whose version was heard."""

    def __init__(self, when_heard: Callable[[int], object] = lambda _: None) -> None:
        self.beats = 0
        self.when_heard = when_heard

    def beat(self, _now_s: float) -> None:
        self.beats += 1

    def version(self, client: int, _version: int) -> None:
        self.when_heard(client)


def test_the_watchdog_hears_of_each_frame_of_a_backlog(clock):
    """Sixteen large ones in one turn, with one sign of life, cost a monitor its
    life.
    """
    guard = Noting()
    heard = []

    def read(pixels, scale):
        heard.append(guard.beats)
        return rule.read(pixels, scale)

    with (
        serving(guard=guard, rule=read, clock=clock) as port,
        Peer(port, clock=clock) as scanner,
    ):
        scanner.watch()
        with clock.held():
            scanner.show_together(*(10.0 + 0.01 * number for number in range(5)))
            heard.clear()
            before = guard.beats
        scanner.hear_readings(12 + 1)
        assert heard[0] - before >= 5


def crowd_of(stack: ExitStack, port: int, count: int) -> list[Peer]:
    """Peers that have each heard a STATUS."""
    peers = [stack.enter_context(Peer(port)) for _ in range(count)]
    for peer in peers:
        peer.hear(lambda peer: bool(peer.statuses()))
    return peers


def test_others_have_two_milliseconds_a_turn_and_who_has_waited_longest_is_first(
    clock,
):
    order = []

    def hear(client):
        order.append(client)
        clock.turn(1.1e-3)
        if len(order) == 1:
            scanner.show(10.0)
            scanner.deliver()

    def read(pixels, scale):
        order.append("frame")
        return rule.read(pixels, scale)

    def ask(peers, version):
        for peer in peers:
            peer.version = version
        with clock.held():
            for peer in peers:
                peer.say(Query("STATUS"))
                peer.deliver()
            order.clear()
        wait_until(lambda: sum(who != "frame" for who in order) == len(peers))

    guard = Noting(hear)
    with serving(guard=guard, rule=read, clock=clock) as port, ExitStack() as stack:
        scanner = stack.enter_context(Peer(port, clock=clock))
        scanner.watch()
        peers = crowd_of(stack, port, 5)
        ask(peers, 2)
        assert order.index("frame") <= 2
        ask(peers[:2], 3)
        ask(peers, 1)
        assert order.index(6) < order.index(3)


def test_half_a_message_does_not_stay_for_ever(clock):
    with serving(message_s=0.2, clock=clock) as port, Peer(port) as slow:
        slow.link.sendall(b"\0\1half")
        while not slow.closed:
            clock.turn(0.1)
            slow.hear(within_s=0.02)


@contextmanager
def beside(
    clock: TurnedClock, *names: str, **settings: Any
) -> Iterator[tuple[int, Peer, dict[str, FakeCompanion]]]:
    """Run a server beside companions of these names; gives its port, a scanner that it
    watches, and the companions.
    """
    companions = {name: FakeCompanion() for name in names}
    with (
        serving(companions, clock=clock, **settings) as port,
        Peer(port, clock=clock) as scanner,
    ):
        scanner.watch()
        yield port, scanner, companions


def test_the_pose_of_the_needle_is_its_travel_along_its_own_axis_while_it_is_recent(
    clock,
):
    pose = Transform((0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8, 3.0, 50.0, 4.0))
    with beside(clock, BLACK_BOX) as (_, scanner, companions):
        scanner.say(pose, "Probe")
        scanner.read(10.0)
        scanner.say(pose, "NeedlePose")
        scanner.read(10.0)
        clock.turn(0.08)
        scanner.read(10.0)
        clock.turn(0.45)
        scanner.read(10.0)
        decided = companions[BLACK_BOX].told(process_messages.Decided, 16)

    travels_m = [one.travel_m for one in decided if one.entry.frame is not None]
    assert travels_m == [None] * 13 + [pytest.approx(0.005)] * 2 + [None]


def test_a_crowd_that_says_nothing_locks_out_neither_the_operator_nor_a_scanner(
    clock,
):
    with serving(clients=20, clock=clock) as port, ExitStack() as stack:
        crowd = crowd_of(stack, port, 30)
        with Peer(port, clock=clock) as scanner:
            scanner.withdraw()
            crowd += [stack.enter_context(Peer(port)) for _ in range(30)]
            scanner.show(10.0)
            assert reset(port)[0] is True
            scanner.watch()

        assert all(peer.statuses()[0].code == 13 for peer in crowd[:18])


def gone(peer: Peer, frame: int) -> bool:
    """Read what has come; return whether the connection has ended before this frame was
    read.
    """
    peer.hear(lambda peer: peer.readings() > 0 and peer.said()["frame"] >= frame)
    return peer.closed


def test_who_was_there_first_and_the_scanner_keep_their_places(
    clock,
):
    with serving(clients=20, clock=clock) as port, ExitStack() as stack:
        first = [stack.enter_context(Peer(port)) for _ in range(17)]
        with Peer(port, clock=clock) as scanner:
            scanner.watch()
            crowd = crowd_of(stack, port, 30)
            scanner.watch()
            assert not any(gone(peer, 24) for peer in first)
            assert [gone(peer, 24) for peer in crowd] == [True] * 28 + [False] * 2


def kill(number: signal.Signals) -> Callable[[Running, Peer], None]:
    return lambda running, _: os.kill(running.process.pid, number)


DEATHS = {
    "killed": kill(signal.SIGKILL),
    "stopped": kill(signal.SIGSTOP),
    "a tight loop": lambda _, scanner: scanner.show(0, frame_of(rule.HANGS, 1)),
}


LOOK_S = 1.0  # so that the watchdog bears five seconds, and is heard every half one


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
    death,
):
    with small_monitor(look_s=LOOK_S) as running:
        with Peer(running.port) as scanner, Peer(running.port, version=2) as robot:
            robot.say(Query("STATUS"))
            robot.hear(lambda peer: peer.versions == {1, 2})
            scanner.watch()
            robot.hear_readings(12)
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


def test_a_watchdog_that_dies_is_a_cause_and_no_reset_helps():
    with small_monitor(look_s=LOOK_S) as running, Peer(running.port) as scanner:
        scanner.watch()
        os.kill(running.watchdog_pid, signal.SIGKILL)
        assert "watchdog" in scanner.wait_for_code(3).message
        for _ in range(8):
            scanner.read(10.0)
        assert reset(running.port)[0] is False


def test_the_end_as_planned_withdraws_and_leaves_no_process():
    with small_monitor() as running, Peer(running.port) as scanner:
        scanner.watch()
        running.process.terminate()
        assert "the monitor ends" in scanner.wait_for_code(3).message
        assert running.process.wait(FUSE_S) == 0
        wait_until(lambda: not alive(running.watchdog_pid))


@pytest.mark.slow
def test_a_watchdog_that_is_stopped_is_a_cause():
    with small_monitor(look_s=0.4) as running, Peer(running.port) as scanner:
        scanner.watch()
        os.kill(running.watchdog_pid, signal.SIGSTOP)

        try:
            assert (
                "the watchdog has not answered for 10 s"
                in scanner.wait_for_code(3).message
            )
            scanner.read(10.0)
            assert scanner.status.code == 3
        finally:
            os.kill(running.watchdog_pid, signal.SIGCONT)


def test_the_operator_hears_of_each_change_of_state_once(clock):
    lines = []
    with (
        serving(note=lines.append, clock=clock) as port,
        Peer(port, clock=clock) as scanner,
    ):
        scanner.watch()
        for force_mn in (40.0, 41.0, 42.0):
            scanner.read(force_mn)

    changes = [line for line in lines if "WATCHING: " in line or "WITHDRAW: " in line]
    assert [line.split()[1] for line in changes] == ["WATCHING:", "WITHDRAW:"]
    assert "class 2" in changes[1]


def test_the_second_opinion_is_asked_about_each_frame_and_what_it_says_counts(
    clock,
):
    with beside(clock, OPINION) as (_, scanner, companions):
        questions = companions[OPINION].told(process_messages.OpinionAsked, 12)
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
        assert status.name == "DANGEROUS_CLASS"
        assert "second opinion" in status.message
        scanner.read(10.0)  # it is harmless, and the withdrawal is held
        asked = companions[OPINION].told(process_messages.OpinionAsked, 13)
        assert not asked[-1].teaches


def test_what_the_second_opinion_remarks_is_logged_and_told_to_the_console_once(
    clock,
):
    differ = Remark("methods-disagree", "they differ")
    leans = Remark("lean-contradicted", "it leans", ("lean_rad",))
    with beside(clock, OPINION, BLACK_BOX, CONSOLE) as (_, scanner, companions):
        for remarks in ((differ,), (differ, leans), (leans,)):
            companions[OPINION].says(
                process_messages.OpinionGiven(
                    order=1, verdict=rule.verdict(9.0, (8.0, 10.0)), remarks=remarks
                )
            )

        def shown():
            clock.turn(0.05)
            scanner.read(10.0)
            rates = companions[CONSOLE].told(process_messages.Rates)
            return bool(rates) and rates[-1].remarks == (differ, leans)

        wait_until(shown)
        noted = [
            note.text for note in companions[BLACK_BOX].told(process_messages.Note)
        ]
        assert [text for text in noted if "second opinion" in text] == [
            "second opinion: methods-disagree: they differ",
            "second opinion: lean-contradicted: it leans",
        ]


def test_what_was_learned_of_the_eye_is_in_each_later_reading_and_ends_no_withdrawal(
    clock,
):
    with beside(clock, OPINION) as (_, scanner, companions):
        assert scanner.said()["modulus_mpa"] is None
        scanner.read(39.0)
        known = Setup(
            eye=Eye(modulus=Modulus(mean_pa=0.3e6, sd_pa=0.02e6, source="shape"))
        )
        companions[OPINION].says(
            process_messages.EyeLearned(setup=known, frames=7, fault="")
        )

        def learned():
            scanner.read(10.0)
            said = scanner.said()
            found = [said[f"modulus_{name}"] for name in ("mpa", "sd_mpa", "frames")]
            return found == pytest.approx([0.3, 0.02, 7])

        wait_until(learned)
        assert scanner.status.code == 3


def test_a_companion_that_fails_is_a_cause_until_it_says_that_this_is_over(clock):
    with beside(clock, BLACK_BOX) as (port, scanner, companions):
        box = companions[BLACK_BOX]
        box.says(process_messages.SelfReport(detail="log: no space left"))
        status = scanner.watch_until(3)
        assert status.name == "EXCEPTION"
        assert "black box: log: no space left" in status.message

        for over in (False, True):
            if over:
                box.says(process_messages.Alive(faults=()))
            for _ in range(8):
                scanner.read(10.0)

            assert reset(port)[0] is over


@pytest.mark.slow
def test_clients_that_flood_the_log_take_nothing_of_the_decisions_and_the_log_says_what_it_left_out(
    clock,
):
    wrong = encode(Status(1), "X")[:-1] + b"\1"
    flood = (encode(Sensor((0.01,)), "RobotForce") * 20 + wrong) * 5

    with beside(clock, BLACK_BOX) as (port, scanner, companions), Peer(port) as rude:
        box = companions[BLACK_BOX]

        def dropped():
            scanner.watch(frames=3)
            notes = box.told(process_messages.Note)
            return any("were dropped" in note.text for note in notes)

        for _ in range(20):
            rude.link.sendall(flood)
            dropped()

        wait_until(lambda: dropped() and len(box.decisions()) >= 60)
        entries = [entry.number for entry in box.decisions()]
        assert entries == list(range(1, len(entries) + 1))
        notes = box.told(process_messages.Note)
        assert 10 <= sum("checksum" in note.text for note in notes) < 40
        assert len(box.told(process_messages.ForceHeard)) >= 100


@pytest.mark.slow
def test_while_no_frames_come_the_console_gets_the_state_again_and_the_log_has_no_gaps(
    clock,
):
    with beside(clock, BLACK_BOX, CONSOLE) as (_, _, companions):
        again = []

        def repeated():
            clock.turn(HEARTBEAT_S)
            shown = companions[CONSOLE].decisions()
            again[:] = [
                one for one in shown if (one.event, one.state) == ("again", "WITHDRAW")
            ]
            return len(again) >= 2

        wait_until(repeated)
        logged = companions[BLACK_BOX].decisions()

    assert [entry.number for entry in logged] == list(range(1, len(logged) + 1))
    # a silence is logged once, however long it lasts
    assert [entry.event for entry in logged].count("tick") == 1
    assert logged[-1].state == "WITHDRAW"
    assert (again[-1].number, again[-1].frame) == (logged[-1].number, None)


CROSS = ("along", "across")


@pytest.fixture
def cross(clock: TurnedClock) -> Iterator[Peer]:
    """The scanner of a server of two planes."""
    with (
        serving(clock=clock, planes=CROSS) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        yield scanner


def test_frames_of_planes_are_known_by_their_device_and_each_moment_is_asked_about_once(
    clock,
):
    companions = {name: FakeCompanion() for name in (OPINION, BLACK_BOX)}
    contact_m = (1e-4, 2e-4, 1e-3)
    times_s = count(2e9, 0.02)

    with (
        serving(companions, clock=clock, planes=CROSS) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        for _ in range(3):
            scanner.read(10.0, device="across")
            assert scanner.status.code == 13, "the other plane has sent nothing yet"

        def moment():
            time_s = next(times_s)
            for plane in CROSS:
                scanner.read(10.0, device=plane, time_s=time_s)
            return scanner.said()

        for _ in range(12):
            assert moment()["plane"] == "across"

        assert scanner.status.code == 1
        asked = companions[OPINION].told(process_messages.OpinionAsked, 12)
        assert [tuple(name for name, *_ in one.planes) for one in asked] == [CROSS] * 12
        decided = companions[BLACK_BOX].told(process_messages.Decided, 27)
        assert [one.moment for one in decided if one.entry.frame][-4:] == [
            24,
            24,
            26,
            26,
        ]
        for plane, _, order in asked[-1].planes:
            given = process_messages.OpinionGiven(
                order=order,
                verdict=rule.verdict(9.0, (8.0, 10.0)),
                plane=plane,
                contact_m=contact_m,
            )
            companions[OPINION].says(given)

        wait_until(lambda: "contact_xyz_mm" in moment())
        said = scanner.said()
        assert said["contact_xyz_mm"] == pytest.approx([0.1, 0.2, 1.0])
        assert (said["planes_force_mn"], said["planes_interval_mn"]) == (9.0, [8, 10])
        scanner.show(10.0, device="Scanner")
        status = scanner.wait_for_code(3)
        assert status.name == "BAD_IMAGE"
        assert "device 'Scanner': must be a plane's name" in status.message


def test_of_frames_that_came_together_the_newest_of_each_plane_is_answered_first(
    cross,
):
    def header(place):
        return {"device": CROSS[place % 2 - 1], "message_id": 11 + (place - 1) // 2}

    for number in range(4):
        for plane in CROSS:
            cross.read(10.0, device=plane, message_id=number + 1)

    cross.show_together(*[10.0] * 6, headers=header)
    cross.hear_readings(10)
    texts = [json.loads(text.text) for text in cross.texts()[-2:]]
    assert [(text["plane"], text["frame_id"], text["overtaken"]) for text in texts] == [
        ("along", 13, 4),
        ("across", 13, 4),
    ]
    assert cross.status.code == 1


def test_parts_of_images_of_two_planes_may_come_in_turns(cross):
    for begin in (0, 32):
        for place, plane in enumerate(CROSS):
            whole = frame_of(10_000, place) + np.uint16(place)
            cross.say(part(whole, begin, begin + 32), plane, message_id=1, time_s=1.8e9)

    cross.hear_readings(2)
    assert cross.status.code == 1
