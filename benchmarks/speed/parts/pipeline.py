"""The reproduction and the tests, which take minutes and are run on demand."""

import json
import os
import subprocess
import sys
from datetime import UTC, datetime
from time import perf_counter

from scleraforce.base.worker_processes import available_cores
from speed.children import scleraforce
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
    what = "`make reproduce`"
    if run.full("reproduce"):
        study = ["--study", str(QUICK_STUDY), "--train"] if run.quick else []
        start = perf_counter()
        subprocess.run(
            scleraforce("reproduce", "--out", str(run.folder / "reproduce"), *study),
            stdout=sys.stderr,
            check=True,
        )
        seconds = perf_counter() - start
        source = ""
        words = f"{available_cores()} processes"
    elif STATE.exists():
        seconds = sum(json.loads(STATE.read_text(encoding="utf-8"))["seconds"].values())
        day = datetime.fromtimestamp(STATE.stat().st_mtime, UTC)
        source = f"{STATE.relative_to(ROOT)}, {day:%-d %B %Y}"
        words = "the last one; --reproduce runs it"
    else:
        return Row(
            what=what,
            value=None,
            unit="s",
            goal=REPRODUCE_GOAL_S,
            settings="not run; --reproduce runs it",
        )

    return Row(
        what=what,
        value=seconds,
        unit="s",
        goal=REPRODUCE_GOAL_S,
        settings=words,
        source=source,
    )


def _tests(run: Run) -> Row:
    what = "`make test`"
    if not run.full("tests"):
        return Row(
            what=what,
            value=None,
            unit="s",
            goal=TESTS_GOAL_S,
            settings="not run; --tests runs it",
        )

    start = perf_counter()
    chosen = [QUICK_TEST] if run.quick else ["-n", "2", "--dist", "worksteal"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(
        [sys.executable, "-m", "pytest", *chosen],
        cwd=ROOT,
        env=environment,
        stdout=sys.stderr,
        check=True,
    )
    words = (
        f"{QUICK_TEST} alone"
        if run.quick
        else "two processes, as `make test` starts them"
    )

    return Row(
        what=what,
        value=perf_counter() - start,
        unit="s",
        goal=TESTS_GOAL_S,
        settings=words,
    )
