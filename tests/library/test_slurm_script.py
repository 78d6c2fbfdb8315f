"""The SLURM job of the cluster page, with a substitute for `srun` that starts its
command on this machine.
"""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from waiting import LIMIT_S

from scleraforce.library.library_store import open_library

SCRIPT = Path(__file__).parents[2] / "examples" / "cluster" / "library.sbatch"
STUDY = """
[mesh]
core = 4
rings = 6
[library]
thicknesses = 4
tensions = 4
tips = 6
elements = 8
stiffenings = 1
"""


def run(folder: Path, tasks: int) -> "subprocess.CompletedProcess[str]":
    (folder / "bin").mkdir(exist_ok=True)
    srun = folder / "bin" / "srun"
    srun.write_text('#!/bin/bash\nwhile [[ $1 == --* ]]; do shift; done\nexec "$@"\n')
    srun.chmod(0o755)
    (folder / "study.toml").write_text(STUDY)
    path = f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {
        "PATH": path,
        "SLURM_NTASKS": str(tasks),
        "SLURM_JOB_ID": "7",
    }

    return subprocess.run(
        ["bash", SCRIPT, "study.toml", "responses"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT_S,
    )


def test_fewer_than_three_tasks_are_refused(tmp_path):
    done = run(tmp_path, 2)
    assert (done.returncode, done.stderr) == (
        2,
        "error: --ntasks=2: at least 3: a scheduler, a worker, and what writes\n",
    )


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("distributed") is None, reason="the extra [cluster] is not installed"
)
def test_the_job_makes_a_library_and_leaves_nothing_else(tmp_path):
    done = run(tmp_path, 4)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("responses: ")
    assert len(open_library(tmp_path / "responses").thickness_m) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "bin",
        "responses",
        "study.toml",
    ]
