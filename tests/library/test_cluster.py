"""A library built by a real Dask cluster on this machine: its own processes, one of them killed half-way."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from analytic_library import no_solution, no_worker, solve_analytic, solve_slowly
from folder_contents import contents

from scleraforce.errors import InputError, SolverError
from scleraforce.library import cluster as cluster_module
from scleraforce.library.build import build_library
from scleraforce.study import LibraryStudy, Range, Study

pytestmark = [
    pytest.mark.skipif(find_spec("distributed") is None, reason="the extra [cluster] is not installed"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]

STUDY = Study(library=LibraryStudy(thicknesses=4, tensions=5, tips=6, elements=16))
SUPPORT = Path(__file__).parents[1] / "support"
THREADS = 2  # of a worker: results must not depend on them


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        file = folder / "scheduler.json"
        self.start("scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", file)
        self.address = self.wait(lambda: json.loads(file.read_text())["address"])

    def start(self, kind, *options):
        environment = os.environ | {"PYTHONPATH": str(SUPPORT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"}
        log = (self.folder / f"{kind}{len(self.processes)}.log").open("w")
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *map(str, options)]
        self.processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=self.folder))
        log.close()
        return self.processes[-1]

    def worker(self, nanny="--no-nanny"):
        options = (nanny, "--nthreads", THREADS, "--no-dashboard", "--host", "127.0.0.1")
        return self.start("worker", self.address, *options)

    @staticmethod
    def wait(found, seconds=60.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                return found()
            except (OSError, ValueError, KeyError):
                time.sleep(0.05)
        raise AssertionError("the scheduler did not start")

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    yield made
    made.end()


@pytest.mark.slow
def test_a_worker_killed_half_way_changes_no_byte(cluster, tmp_path):
    victim, _ = cluster.worker(), cluster.worker()
    done = []

    def kill_half_way(count):
        done.append(count)
        if sum(done) == 8:
            victim.send_signal(signal.SIGKILL)

    result = build_library(
        STUDY, tmp_path / "cluster", scheduler=cluster.address, progress=kill_half_way, solve=solve_slowly
    )
    assert victim.wait() == -signal.SIGKILL
    assert result.solved == sum(done) == 180
    build_library(STUDY, tmp_path / "here", workers=2, solve=solve_analytic)
    assert contents(tmp_path / "cluster") == contents(tmp_path / "here")


@pytest.mark.long
@pytest.mark.slow
def test_real_paths_are_the_same_on_a_cluster_and_on_processes(cluster, tmp_path):
    cluster.worker()
    grid = LibraryStudy(thickness_m=Range(min=0.5e-3, max=0.8e-3), thicknesses=4, tensions=4, tips=5, max_tip_m=2e-3)
    build_library(Study(library=grid), tmp_path / "cluster", scheduler=cluster.address)
    build_library(Study(library=grid), tmp_path / "here", workers=2)
    assert contents(tmp_path / "cluster") == contents(tmp_path / "here")


@pytest.mark.slow
@pytest.mark.long
def test_what_fails_on_the_cluster_fails_here(cluster, tmp_path):
    cluster.worker("--nanny")  # starts a worker anew after each death
    with pytest.raises(SolverError, match=r"path \d+ of 180: no equilibrium"):
        build_library(STUDY, tmp_path / "a", scheduler=cluster.address, solve=no_solution)
    with pytest.raises(SolverError, match="die one after the other"):
        build_library(STUDY, tmp_path / "b", scheduler=cluster.address, solve=no_worker)


def test_no_scheduler_is_bad_input(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster_module, "CONNECT_S", 0.5)
    with pytest.raises(InputError, match=re.escape("no Dask scheduler answers at tcp://127.0.0.1:9")):
        build_library(STUDY, tmp_path / "library", scheduler="tcp://127.0.0.1:9", solve=solve_analytic)
    with pytest.raises(InputError, match="workers: 2 with --scheduler"):
        build_library(STUDY, tmp_path / "other", scheduler="tcp://127.0.0.1:9", workers=2)
