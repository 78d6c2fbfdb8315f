"""How units are handed out to processes; `tests/dataset` and `tests/library` show the processes at work."""

import os
import subprocess
import sys
from collections import deque
from pathlib import Path

from scleraforce.processes import next_unit, split_runs

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


def test_no_module_of_the_current_folder_runs_in_a_worker(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    for name in ("signal", "json", "numpy", "multiprocessing", "pickle", "struct"):
        (tmp_path / "here" / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    safe = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, str(program)], cwd=tmp_path / "here", env=safe, capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("[(0, 0), (1, 2), (2, 4)]\n", "")
    assert not (tmp_path / "ran").exists()
