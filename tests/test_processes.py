"""How units are handed out to processes; `tests/dataset` and `tests/library` show the processes at work."""

import multiprocessing
import os
import subprocess
import sys
import time
from collections import deque
from functools import partial
from multiprocessing import resource_tracker, spawn
from pathlib import Path

import pytest
from workers import fails_oddly, leave_a_mark_for_each, no_preparation, tripled

from scleraforce.errors import InputError, SolverError
from scleraforce.processes import next_unit, split_runs, work_in_order, work_units

HEAVY = partial(tripled, bytes(2**20))  # more than a pipe holds

PROGRAM = """
from scleraforce.processes import work_units

def double():
    return lambda unit: 2 * unit

if __name__ == "__main__":
    print(sorted(work_units(double, range(3), 1)))
"""


def test_units_are_handed_out_in_contiguous_runs_and_the_idle_help_at_the_far_end():
    runs = split_runs(range(6), 2)
    assert [next_unit(runs, 0) for _ in range(5)] == [0, 1, 2, 5, 4]
    assert [next_unit(runs, 1), next_unit(runs, 1)] == [3, None]
    assert split_runs([7], 4) == [deque([7])]


@pytest.fixture
def no_interpreter():
    """Where workers cannot be started: another user's interpreter, for one, cannot be read."""
    resource_tracker.ensure_running()
    before = spawn.get_executable()
    spawn.set_executable("/bin/false")
    yield
    spawn.set_executable(before)


@pytest.mark.parametrize("work", [work_units, partial(work_in_order, ahead=2)], ids=["any order", "in order"])
@pytest.mark.usefixtures("no_interpreter")
def test_workers_that_die_at_their_start_are_an_error_and_not_a_hang(work):
    with pytest.raises(SolverError, match="a worker ended with code 1"):
        list(work(HEAVY, range(3), 2))
    assert not multiprocessing.active_children()


def test_what_a_preparation_raises_reaches_the_caller():
    with pytest.raises(InputError, match="this eye is too small"):
        list(work_units(no_preparation, range(3), 1))


def test_an_exception_that_cannot_be_sent_is_told():
    with pytest.raises(SolverError, match="OddError in a worker: 7 and this"):
        list(work_units(fails_oddly, [7], 1))


def test_results_come_in_order_whatever_the_workers_do():
    assert list(work_in_order(HEAVY, range(5, 12), 2, ahead=3)) == [3 * unit for unit in range(5, 12)]
    assert list(work_in_order(HEAVY, [], 2, ahead=3)) == []


def test_a_worker_goes_on_while_the_caller_has_a_result(tmp_path: Path) -> None:
    results = work_in_order(partial(leave_a_mark_for_each, tmp_path), range(4), 1, ahead=2)
    for unit in results:
        following, deadline = tmp_path / str(unit + 1), time.monotonic() + 300.0
        while unit < 3 and not following.exists():
            assert time.monotonic() < deadline, f"{following.name} waits until the caller comes back"
            time.sleep(0.01)


def test_no_module_of_the_current_folder_runs_in_a_worker(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    for name in ("signal", "json", "numpy", "multiprocessing", "pickle", "struct"):
        (tmp_path / "here" / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    safe = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, str(program)], cwd=tmp_path / "here", env=safe, capture_output=True, text=True, timeout=300
    )
    assert (done.stdout, done.stderr) == ("[(0, 0), (1, 2), (2, 4)]\n", "")
    assert not (tmp_path / "ran").exists()
