"""The monitor's benchmarks: each question prints a table at its smallest size, and what
they count.
"""

import doctest
import os
import re
import subprocess
import sys
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import markdown_tables
from monitor.scanner import OK, WITHDRAW, Frames
from monitor.session import LATE_FRAMES, Injector
from monitor.sessions import Outcome, Ramp, ramp_table
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.replay.scanner_player import StatusChange

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?")
REAL = {
    "session": "--frames 400 --rate-hz 200 --withdrawal-every 60",
    "faults": "--times 1 --deaths 1 --only silence checksum garbage",
    "hostile": "--connections 100 --at-once 20 --alone-s 1",
}
VIRTUAL = {
    "sessions": "--model {model} --kinds sealed --eyes 1 --seconds 1 --rates-mn-s 100",
    "bound": "{model} --eyes 1 --rates-mn-s 100",
    "pierced": "--sessions 2",
    "relaxing": "--eyes 1",
    "old-pictures": "{recording} --frames 20",
    "messages": "--messages 1000",
}


def asked(question: str, words: str, folder: Path, cache: dict[str, str]) -> None:
    """Ask a question, and check that it prints finite numbers."""
    given = words.format(model=folder / "reader", recording=folder / "eye")
    done = subprocess.run(
        [sys.executable, "-m", "monitor", question, *given.split()],
        capture_output=True,
        text=True,
        check=False,
        env=cache | {"PYTHONPATH": f"{BENCHMARKS}{os.pathsep}{BENCHMARKS.parent}/src"},
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if NUMBER.search(line)]
    assert any(row.startswith("|") for row in rows), done.stdout
    assert not re.search(r"\b(nan|inf)\b", done.stdout, re.IGNORECASE), done.stdout
    assert done.stderr in ("", "compiling, once: half a minute\n")  # in an empty cache


@pytest.mark.slow
@pytest.mark.parametrize("question", VIRTUAL)
def test_a_question_prints_a_table(
    question: str, folder: Path, environment: dict[str, str]
) -> None:
    asked(question, VIRTUAL[question], folder, environment)


@pytest.mark.slow
@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("question", REAL)
def test_a_question_to_a_running_monitor_prints_a_table(
    question: str, folder: Path, environment: dict[str, str]
) -> None:
    words = f"{{model}} {{recording}} {REAL[question]}"
    asked(question, words, folder, environment)


def test_tables_are_markdown() -> None:
    assert doctest.testmod(markdown_tables).failed == 0


def test_a_ramp_counts_as_stopped_only_below_the_bound_and_is_compared_with_the_same_ramp():
    declared = Outcome(
        ramps=[Ramp(0, 0.01, 28e-3, 0.2, "BOUND"), Ramp(1, 0.01, 31e-3, -0.1, "RISING")]
    )
    unknown = Outcome(ramps=[Ramp(0, 0.01, 22e-3, 0.8, "BOUND"), Ramp(1, 0.01)])
    table = ramp_table({"sealed": {"declared": declared, "unknown": unknown}})
    head, _, *rows = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in table.splitlines()
    )
    of_declared, of_unknown = (dict(zip(head, row, strict=True)) for row in rows)
    assert of_declared["stopped below 30 mN"] == "1 of 2"
    assert of_declared["at 10 mN/s"] == "28.00 / 29.50 / 31.00; -100 to 200 ms"
    assert of_unknown["stopped below 30 mN"] == "1 of 2"
    assert of_unknown["earlier than declared, mN"] == "6.00 / 6.00"
    assert of_unknown["causes"] == "1 BOUND, 1 never"


@pytest.mark.slow
def test_an_injected_withdrawal_is_in_time_late_or_lost_and_any_other_is_false(
    folder: Path,
) -> None:
    injector = Injector(Frames(folder / "eye"), every=1, seed=0)
    scanner = SimpleNamespace(code=OK)
    withdrawals = []

    def withdrawn(at_s: float, number: int) -> None:
        withdrawals.append(
            StatusChange(at_s=at_s, code=WITHDRAW, sub_code=0, message="so")
        )
        injector.hear(withdrawals, number, 0.0)

    assert injector.draw(scanner, 1) is not None
    injector.hear(withdrawals, 1, 10.0)
    assert injector.draw(scanner, 2) is None  # one at a time
    withdrawn(10.02, 2)
    assert injector.draw(scanner, 3) is not None
    for number in range(3, 4 + LATE_FRAMES):
        injector.hear(withdrawals, number, 20.0)

    withdrawn(30.0, 20)
    counted = {when: times for (_, when), times in injector.times.items()}
    assert counted == {"late": 1, "lost": 1}
    assert injector.delays_s == [pytest.approx(0.02)]
    assert injector.false == ["frame 20: so"]


@pytest.mark.slow
def test_the_way_to_and_fro_takes_steps_of_one_frame_and_shows_no_picture_again_soon(
    folder: Path,
) -> None:
    frames = Frames(folder / "eye")
    way = list(islice(frames.to_and_fro(), 400))
    assert set(np.abs(np.diff([index % len(frames.force_n) for index in way]))) == {1}
    remembered = MonitorLimits().shown_frames
    assert all(
        index not in way[max(now - remembered, 0) : now]
        for now, index in enumerate(way)
    )
