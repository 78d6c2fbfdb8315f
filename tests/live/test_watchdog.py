"""The watchdog: its messages, its looks, the time in a header, its priority."""

import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import termios
from contextlib import suppress

import pytest
from small_monitor import Peer, small_monitor
from waiting import FUSE_S

import scleraforce.live.companions.watchdog as module
from scleraforce.base.errors import MessageError
from scleraforce.live.companions import watchdog
from scleraforce.live.companions.watchdog import MONITOR_PRIORITY, run_in_real_time
from scleraforce.live.decision.events import Cause
from scleraforce.live.network.openigtlink import Status, Text, encode


@pytest.fixture
def ends():
    """Both ends of a watchdog's channel: the monitor's, and its own."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    yield ours, theirs
    ours.close()
    theirs.close()


def watch(
    monkeypatch: pytest.MonkeyPatch, said: list[bytes | None]
) -> tuple[bool, int]:
    """Let a watchdog look at a monitor that says one thing before each look; return its
    verdict and the looks.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    looks = 0

    def look(readers, writers, others, within_s):  # type: ignore[no-untyped-def] # as that of select
        nonlocal looks
        assert within_s == watchdog.LOOK_S
        if looks < len(said) and (word := said[looks]):
            ours.send(word)
        looks += 1
        return select_select(readers, writers, others, 0.0)

    select_select = select.select
    with monkeypatch.context() as patch:
        patch.setattr(module.select, "select", look)
        planned = watchdog.Watchdog(theirs, os.getpid()).watch()

    assert ours.recv(16) == watchdog.ALIVE
    ours.close()
    theirs.close()
    return planned, looks


def test_a_monitor_that_says_nothing_for_a_tenth_of_a_second_hangs(
    monkeypatch,
):
    assert watch(monkeypatch, []) == (False, watchdog.MISSES)
    # As much again is left for the emergency to arrive within 200 ms.
    assert watchdog.MISSES * watchdog.LOOK_S <= 0.1
    quiet = [None] * (watchdog.MISSES - 1)
    counted_anew = [*quiet, b"B", *quiet, b"B", *quiet]
    assert watch(monkeypatch, counted_anew) == (False, 3 * watchdog.MISSES)
    assert watch(monkeypatch, [b"B", None, b"Q"]) == (True, 3)  # the end as planned


@pytest.mark.parametrize(
    ("said", "planned"),
    [
        ([b"V1 2", b"V2 3", b"B", b"Q"], True),
        ([b"V1 2", b"B"], False),
        ([b"V1 2", b"Q"], True),
        ([], False),
    ],
    ids=["ends as planned", "hangs", "ends before its first turn", "dies"],
)
def test_duty_begins_with_the_first_sign_of_life(monkeypatch, ends, said, planned):
    ours, theirs = ends
    for word in said:
        ours.send(word)
    if not said:
        ours.close()

    patience_s = []
    select_select = select.select

    def look(readers, writers, others, within_s):  # type: ignore[no-untyped-def] # as that of select
        patience_s.append(within_s)
        return select_select(readers, writers, others, 0.0)

    guard = watchdog.Watchdog(theirs, os.getpid())
    with monkeypatch.context() as patch:
        patch.setattr(module.select, "select", look)
        guard.await_duty()
        waits = len(patience_s)
        assert guard.watch() is planned

    assert all(
        wait_s > watchdog.LOOK_S * watchdog.MISSES for wait_s in patience_s[:waits]
    )
    assert all(wait_s == watchdog.LOOK_S for wait_s in patience_s[waits:])


def test_a_client_before_the_first_sign_of_life_begins_the_duty(ends):
    """The watchdog holds its socket then, and looks at the monitor."""
    ours, theirs = ends
    robot, client = socket.socketpair()
    socket.send_fds(ours, [b"C1"], [client.fileno()])
    client.close()

    guard = watchdog.Watchdog(theirs, os.getpid(), look_s=0.0)
    guard.await_duty()
    assert guard.watch() is False
    robot.setblocking(False)
    with pytest.raises(BlockingIOError):  # a closed one would be at its end
        robot.recv(1)

    ours.send(b"D1")
    assert guard.watch() is False
    assert robot.recv(1) == b""
    robot.close()


SLOW_START = """
from scleraforce.live.companions.companion_processes import Guard

guard = Guard(1e-4)  # it would end a silent monitor after half a millisecond
sum(range(500_000))
guard.end()
print("served")
"""


def test_a_machine_that_delays_the_first_turn_does_not_cost_the_monitor():
    done = subprocess.run(
        [sys.executable, "-c", SLOW_START],
        capture_output=True,
        text=True,
        check=False,
        timeout=FUSE_S,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "served\n", "")


def test_a_monitor_that_never_begins_is_ended(monkeypatch, ends):
    monkeypatch.setattr(watchdog, "DUTY_S", 0.0)
    guard = watchdog.Watchdog(ends[1], os.getpid(), look_s=0.0)
    guard.await_duty()
    assert guard.watch() is False


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"X", b"B ", b"QQ", b"C", b"C-1", b"C1 ", b"C1\n", b"C" + b"1" * 19),
        *(b"V1", b"V1 ", b"V1 4", b"V1 2 ", b"D", b"Dx", b"C\xd9\xa1"),
        *(b"M1", b"M1 short", b"M4 " + b"x" * 100, b"M1 " + b"x" * 4096),
    ],
)
def test_other_bytes_are_refused(data):
    with pytest.raises(MessageError, match=f"{len(data)} bytes: not a message"):
        watchdog.parts_of(data)


def test_the_watchdog_needs_the_standard_library_alone():
    program = (
        "import sys; import scleraforce.live.companions.watchdog;sys.exit(str([name for name in"
        " ('numpy', 'cv2', 'json') if name in sys.modules] or ''))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        timeout=FUSE_S,
    )
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_stamp_changes_the_time_and_nothing_else_of_every_message(
    version,
):
    def both(time_s):
        messages = (Status(1), Text("WITHDRAW"))
        return bytearray(
            b"".join(
                encode(message, "ForceMonitor", version=version, time_s=time_s)
                for message in messages
            )
        )

    stamped = both(1.25)
    watchdog.stamp_time(stamped, 1.8e9 + 0.5)
    assert stamped == both(1.8e9 + 0.5)


def refuse(*_: object) -> None:
    raise PermissionError


def test_real_time_is_not_inherited_and_without_the_right_it_is_niceness(
    monkeypatch,
):
    asked = []
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", lambda *words: asked.append(words))
    assert run_in_real_time(MONITOR_PRIORITY) is False
    assert asked == [(os.PRIO_PROCESS, 0, -MONITOR_PRIORITY)]
    monkeypatch.setattr(os, "setpriority", refuse)
    assert run_in_real_time(MONITOR_PRIORITY) is False
    monkeypatch.setattr(
        os,
        "sched_setscheduler",
        lambda pid, kind, param: asked.append((pid, kind, param)),
    )
    assert run_in_real_time(3) is True
    kind = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    assert asked[1:] == [(0, kind, os.sched_param(3))]


def spoil(how: str, ours: int, theirs: int) -> None:
    match how:
        case "stopped":
            termios.tcflow(theirs, termios.TCOOFF)  # as Ctrl-S
        case "full":
            os.set_blocking(theirs, False)
            with suppress(BlockingIOError):
                while os.write(theirs, b"x" * 4096):  # nobody reads
                    pass

            os.set_blocking(theirs, True)
        case "closed":
            os.close(ours)


@pytest.mark.parametrize(
    "how",
    ["closed", "stopped", "full"],
)
@pytest.mark.slow
def test_the_emergency_continues_whatever_becomes_of_the_terminal(how):
    ours, theirs = pty.openpty()
    with small_monitor(errors=theirs) as running, Peer(running.port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))  # the watchdog knows it, too
        spoil(how, ours, theirs)
        os.kill(running.process.pid, signal.SIGKILL)
        robot.hear(lambda peer: emergencies(peer) >= 10)
        assert emergencies(robot) >= 10
        decision = json.loads(robot.texts("ForceDecision")[-1].text)
        assert (decision["code"], decision["cause"]) == (3, "WATCHDOG")

    os.close(theirs)
    if how != "closed":
        os.close(ours)


def emergencies(peer: Peer) -> int:
    """Return the number of emergencies that the watchdog sent."""
    return sum(status.subcode == Cause.WATCHDOG.value for status in peer.statuses())
