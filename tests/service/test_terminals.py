"""Terminals that were stopped or closed: nobody waits for them, and no companion of the monitor hears of them."""

import os
import pty
import signal
import termios
from contextlib import suppress

import pytest
from small_monitor import Peer, small_monitor

from scleraforce.monitor.transitions import Cause


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


@pytest.mark.parametrize("how", ["closed", *(pytest.param(how, marks=pytest.mark.slow) for how in ("stopped", "full"))])
def test_the_emergency_goes_on_whatever_becomes_of_the_terminal(how: str) -> None:
    ours, theirs = pty.openpty()
    with small_monitor(errors=theirs) as running, Peer(running.port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))  # the watchdog knows it, too
        spoil(how, ours, theirs)
        os.kill(running.process.pid, signal.SIGKILL)
        robot.hear(lambda peer: emergencies(peer) >= 10)
        assert emergencies(robot) >= 10
    os.close(theirs)
    if how != "closed":
        os.close(ours)


def emergencies(peer: Peer) -> int:
    """How many the watchdog sent."""
    return sum(status.subcode == Cause.WATCHDOG.value for status in peer.statuses())


def test_the_watchdog_says_in_the_terminal_what_it_did() -> None:
    read, write = os.pipe()
    with small_monitor(errors=write) as running, Peer(running.port) as robot:
        os.close(write)
        robot.hear(lambda peer: bool(peer.statuses()))  # the watchdog knows it, too
        os.kill(running.process.pid, signal.SIGKILL)
        said = os.read(read, 1000).decode()
    assert said == "watchdog: the monitor hung or died and was ended; clients ordered to withdraw: 1\n"
    os.close(read)


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGHUP,
        *(pytest.param(number, marks=pytest.mark.slow) for number in (signal.SIGQUIT, signal.SIGINT, signal.SIGTERM)),
    ],
)
def test_the_watchdog_ends_with_the_monitor_alone(number: signal.Signals) -> None:
    with small_monitor() as running, Peer(running.port) as scanner:
        assert (
            os.getsid(running.watchdog_pid) == running.watchdog_pid
        )  # Ctrl-Z and a hangup go to the terminal's session
        os.kill(running.watchdog_pid, number)
        scanner.watch()
        scanner.read(10.0)
        assert scanner.statuses()[-1].code == 1
