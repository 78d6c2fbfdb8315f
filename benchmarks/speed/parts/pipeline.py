"""The reproduction and the tests, which take minutes and are run on demand."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from time import perf_counter

from monitor.real_monitor import scleraforce
from scleraforce.base.worker_processes import available_cores
from speed.children import command_seconds
from speed.record import Row, Table
from speed.run import QUICK_STUDY, ROOT, Run

REPRODUCE_GOAL_S = 240.0
TESTS_GOAL_S = 120.0
STATE = ROOT / "out" / "reproduce" / "reproduce.json"
SETTINGS = "Each once, on all cores, after installation."
QUICK_TEST = "tests/base/test_whole_files.py"


def measure(run: Run) -> Table:
    """Run what was asked for; say where the rest is from."""
    return Table(
        "The whole pipeline and the tests", SETTINGS, (_reproduce(run), _tests(run))
    )


def _reproduce(run: Run) -> Row:
    row = _not_run("reproduce", REPRODUCE_GOAL_S)
    if run.full("reproduce"):
        study = ["--study", str(QUICK_STUDY), "--train"] if run.quick else []
        out = str(run.folder / "reproduce")
        seconds = command_seconds(
            scleraforce("reproduce", "--out", out, *study), heard=True
        )
        return replace(row, value=seconds, settings=f"{available_cores()} processes")

    if STATE.exists():
        done = json.loads(STATE.read_text(encoding="utf-8"))
        day = datetime.fromtimestamp(STATE.stat().st_mtime, UTC)
        return replace(
            row,
            value=sum(done["seconds"].values()),
            settings="the last one; --reproduce runs it",
            source=f"{STATE.relative_to(ROOT)}, {day:%-d %B %Y}",
        )

    return row


def _tests(run: Run) -> Row:
    row = _not_run("tests", TESTS_GOAL_S)
    if not run.full("tests"):
        return row

    chosen = [QUICK_TEST] if run.quick else ["-n", "2", "--dist", "worksteal"]
    start = perf_counter()
    subprocess.run(
        [sys.executable, "-m", "pytest", *chosen],
        cwd=ROOT,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        stdout=sys.stderr,
        check=True,
    )
    seconds = perf_counter() - start
    usual = "two processes, as `make test` starts them"
    words = f"{QUICK_TEST} alone" if run.quick else usual
    return replace(row, value=seconds, settings=words)


def _not_run(option: str, goal_s: float) -> Row:
    return Row(
        what="`make test`" if option == "tests" else "`make reproduce`",
        value=None,
        unit="s",
        goal=goal_s,
        settings=f"not run; --{option} runs it",
    )
