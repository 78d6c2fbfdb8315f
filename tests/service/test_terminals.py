"""Terminals that were stopped or closed: nothing of the monitor waits for them, and none of its companions hears them."""

import os
import pty
import signal
import termios
from collections.abc import Callable

import pytest
from peer import Peer, small_monitor

from scleraforce.monitor.causes import Cause


def stopped(ours: int, theirs: int) -> None:
    termios.tcflow(theirs, termios.TCOOFF)  # as Ctrl-S


def full(ours: int, theirs: int) -> None:
    os.set_blocking(theirs, False)
    try:
        while os.write(theirs, b"x" * 4096):  # nobody reads
            pass
    except BlockingIOError:
        os.set_blocking(theirs, True)


def closed(ours: int, theirs: int) -> None:
    os.close(ours)


@pytest.mark.parametrize("terminal", [stopped, full, closed])
def test_the_emergency_goes_on_whatever_becomes_of_the_terminal(terminal: Callable[[int, int], None]) -> None:
    ours, theirs = pty.openpty()
    with small_monitor(errors=theirs) as running, Peer(running.port) as robot:
        robot.hear(0.1)
        terminal(ours, theirs)
        os.kill(running.process.pid, signal.SIGKILL)
        emergencies = 10
        robot.hear(10.0, lambda peer: count(peer) >= emergencies)
        assert count(robot) >= emergencies
    os.close(theirs)
    if terminal is not closed:
        os.close(ours)


def count(peer: Peer) -> int:
    """Of emergencies that the watchdog sent."""
    return sum(status.subcode == Cause.WATCHDOG.value for status in peer.statuses())


def test_the_watchdog_says_in_the_terminal_what_it_did() -> None:
    read, write = os.pipe()
    with small_monitor(errors=write) as running, Peer(running.port) as robot:
        os.close(write)
        robot.hear(0.1)
        os.kill(running.process.pid, signal.SIGKILL)
        said = os.read(read, 1000).decode()
    assert said == "watchdog: the monitor hung or died and was ended; clients told to withdraw: 1\n"
    os.close(read)


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT, signal.SIGINT, signal.SIGTERM])
def test_the_watchdog_ends_with_the_monitor_alone(number: signal.Signals) -> None:
    with small_monitor() as running, Peer(running.port) as scanner:
        assert (
            os.getsid(running.watchdog_pid) == running.watchdog_pid
        )  # Ctrl-Z and a hangup go to the terminal's session
        os.kill(running.watchdog_pid, number)
        scanner.watch()
        scanner.hear(0.1)
        assert scanner.statuses()[-1].code == 1
