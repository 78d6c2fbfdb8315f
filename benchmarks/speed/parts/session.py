"""A scanner of 1,000 frames a second, also beside other work; the memory of the running
monitor.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from scleraforce.records.model_folder import SHIPPED_READER
from speed.parts.recording import made_recording
from speed.record import Row
from speed.run import ROOT, Run

LOOPS = 4
# 500 answers a second
GOAL_MS = 2.0
GOAL_MB = 300.0
PLACES = {"a free machine": 0, "four busy loops beside it": LOOPS}
ROLES = "monitor", "second opinion"
SETTINGS = """`benchmarks/bench_monitor.py session --remote` plays 1,000 frames a
second, 512 x 512 pixels of 16 bits, below 25 mN, from a process with priority, as if
the scanner were another machine. The monitor is the command that users start, with its
second opinion and black box, on no core of its own, with real-time priority where the
machine grants it. Every withdrawal is false; 500 answers a second are 2 ms for each.
Memory is resident (RSS) at the end of such a session, shared libraries included, beside
the proportional share (PSS). The last 1,200 frames, 630 MB, are shared memory that no
process maps."""


def session_rows(run: Run) -> list[Row]:
    """Play a session on the free machine, and one beside busy loops."""
    rows = []
    found = dict[str, Any]()

    for place, loops in PLACES.items():
        with busy(loops):
            found = _session(run, f"session-{loops}.json")

        rows.append(
            Row(
                what=f"1,000 frames a second, {place}: time for each answer",
                unit="ms",
                value=1e3 / found["answered_per_s"],
                goal=None if loops else GOAL_MS,
                more={
                    "answers a second": found["answered_per_s"],
                    "false withdrawals": float(len(found["withdrawals"])),
                },
            )
        )

    for role in ROLES:
        rss_mb, pss_mb = found["memory_mb"][role]
        rows.append(
            Row(
                what=f"{role}: memory",
                unit="MB",
                value=rss_mb,
                goal=GOAL_MB,
                more={"PSS, MB": pss_mb},
            )
        )

    return rows


def _session(run: Run, name: str) -> dict[str, Any]:
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "bench_monitor.py"),
        "session",
        str(SHIPPED_READER),
    ]
    command += [
        str(made_recording(run)),
        "--remote",
        "--seconds",
        str(run.count(15, 1)),
        "--json",
        str(run.folder / name),
    ]
    subprocess.run(command, stdout=sys.stderr, check=True)
    found: dict[str, Any] = json.loads((run.folder / name).read_text(encoding="utf-8"))

    return found


@contextmanager
def busy(loops: int) -> Iterator[None]:
    """Run loops that do nothing, each in a process."""
    processes = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(loops)
    ]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
