"""The monitor that users start, before the scanner of `python -m monitor session`."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from scleraforce.records.model_folder import SHIPPED_READER
from speed.children import command_seconds
from speed.parts.frame import CRUDE
from speed.parts.recording import made_recording
from speed.record import Row
from speed.run import Run

LOOPS = 4
# 500 answers a second
GOAL_MS = 2.0
GOAL_MB = 300.0
PLACES = {"a free machine": 0, "four busy loops beside it": LOOPS}
ROLES = "monitor", "second opinion"
SETTINGS = """`python -m monitor session --shared --remote` plays 1,000 frames a
second, 512 x 512 pixels of 16 bits, below 25 mN, from a process with priority, as if
the scanner were another machine. The monitor is the command that users start, with its
second opinion and black box, on no core of its own, with real-time priority where the
machine grants it. Every withdrawal is false; 500 answers a second are 2 ms for each.
Memory is resident (RSS) at the end of such a session, shared libraries included, beside
the proportional share (PSS). The last 1,200 frames, 630 MB, are shared memory that no
process maps."""


def monitor_session(run: Run, frames: int, *options: str) -> dict[str, Any]:
    """Play frames to a monitor; return the figures of the session."""
    file = run.folder / "session.json"
    command = [sys.executable, "-m", "monitor", "session", str(SHIPPED_READER)]
    command += [str(made_recording(run)), "--frames", str(frames)]
    command_seconds([*command, "--json", str(file), *options], heard=True)
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def session_rows(run: Run, crude_ms: float) -> list[Row]:
    """Play a session on the free machine, and one beside busy loops; `crude_ms`: what
    plain median and Otsu of a frame takes.
    """
    rows = []
    found = dict[str, Any]()
    options = ["--shared", "--remote", "--rate-hz", "1000"]
    for place, loops in PLACES.items():
        with busy(loops):
            found = monitor_session(run, run.count(15_000, 1000), *options)

        answers_per_s = found["session"]["answers a second"]
        rows.append(
            Row(
                what=f"1,000 frames a second, {place}: time for each answer",
                unit="ms",
                value=1e3 / answers_per_s,
                beside=CRUDE,
                beside_value=crude_ms,
                goal=None if loops else GOAL_MS,
                more={
                    "answers a second": answers_per_s,
                    "false withdrawals": float(found["session"]["false withdrawals"]),
                },
            )
        )

    for role in ROLES:
        held = found["processes"][role]
        rows.append(
            Row(
                what=f"{role}: memory",
                unit="MB",
                value=1.024e-3 * held["rss_kb"],
                goal=GOAL_MB,
                more={"PSS, MB": 1.024e-3 * held["pss_kb"]},
            )
        )

    return rows


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Run loops that do nothing, each in a process."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
