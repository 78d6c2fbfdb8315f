"""What a process asks the system for, and what it does without."""

import os

import pytest

from scleraforce.service.priority import MONITOR_PRIORITY, OPINION_PRIORITY, WATCHDOG_PRIORITY, run_in_real_time


def refuse(*_: object) -> None:
    raise PermissionError


def test_without_the_right_to_real_time_it_is_as_nice_as_the_system_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int, int]] = []
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", lambda *words: asked.append(words))
    assert run_in_real_time(MONITOR_PRIORITY) is False
    assert asked == [(os.PRIO_PROCESS, 0, -MONITOR_PRIORITY)]
    monkeypatch.setattr(os, "setpriority", refuse)
    assert run_in_real_time(MONITOR_PRIORITY) is False


def test_with_the_right_it_is_in_real_time_and_its_children_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda pid, policy, param: asked.append((pid, policy, param.sched_priority))
    )
    monkeypatch.setattr(os, "setpriority", refuse)
    assert run_in_real_time(OPINION_PRIORITY) is True
    assert asked == [(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, OPINION_PRIORITY)]
    assert OPINION_PRIORITY < MONITOR_PRIORITY < WATCHDOG_PRIORITY
