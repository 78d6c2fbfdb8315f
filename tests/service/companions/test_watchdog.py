"""The watchdog's patience: counted in looks, not in time."""

import os
import select
import socket

import pytest

import scleraforce.service.companions.watchdog as module
from scleraforce.service.companions.watchdog import ALIVE, LOOK_S, MISSES, Watchdog


def watch(monkeypatch: pytest.MonkeyPatch, said: list[bytes | None]) -> tuple[bool, int]:
    """Let a watchdog look at a monitor that says one thing before each look; return its verdict and the looks."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    looks = 0

    def look(readers, writers, others, within_s):  # type: ignore[no-untyped-def] # as that of select
        nonlocal looks
        assert within_s == LOOK_S
        if looks < len(said) and (word := said[looks]):
            ours.send(word)
        looks += 1
        return select_select(readers, writers, others, 0.0)

    select_select = select.select
    monkeypatch.setattr(module.select, "select", look)
    planned = Watchdog(theirs, os.getpid()).watch()
    assert ours.recv(16) == ALIVE
    ours.close()
    theirs.close()
    return planned, looks


def test_a_monitor_that_says_nothing_for_a_tenth_of_a_second_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watch(monkeypatch, []) == (False, MISSES)
    assert MISSES * LOOK_S <= 0.1  # which leaves as much again for the emergency to arrive within 200 ms


def test_each_sign_of_life_begins_the_count_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    quiet: list[bytes | None] = [None] * (MISSES - 1)
    assert watch(monkeypatch, [*quiet, b"B", *quiet, b"B", *quiet]) == (False, 3 * MISSES)


def test_a_monitor_that_ends_as_planned_does_not_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watch(monkeypatch, [b"B", None, b"Q"]) == (True, 3)
