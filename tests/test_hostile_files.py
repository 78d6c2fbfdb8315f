"""Damaged and hostile files end in one clear error: never a traceback, a hang, a lot of
memory or something written.

A fault is named with its kind and seed: `PYTHONPATH=benchmarks python
tests/support/hostile.py` (see there) repeats it.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hostile import KINDS, SPECIAL, write_whole_ones

pytest.importorskip("torch")

ROOT = Path(__file__).parents[1]
SEEDS = 300  # of each kind in `make slow`; fewer of slow kinds
SLOW = {"model record": 60, "network": 60, "npz": 60, "dataset": 40, "library": 15}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file or folder of each kind."""
    folder = tmp_path_factory.mktemp("hostile") / "whole"
    folder.mkdir()
    write_whole_ones(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_hundreds_of_mutations_end_well_or_in_one_line(whole: Path, kind: str) -> None:
    seeds = SLOW.get(kind, SEEDS)
    program = Path(__file__).parent / "support" / "hostile.py"
    done = subprocess.run(
        [sys.executable, program, whole, kind, "0", str(seeds)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": "benchmarks"},
        cwd=ROOT,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line for line in lines if line[1]] == []
    assert done.returncode == 0, (lines[-1:], done.stderr[-2000:])
    assert len(lines) == seeds + len(SPECIAL)
