"""A library built by a real Dask cluster on this machine: its own processes, one of them killed half-way."""

import signal

import pytest
from analytic_library import no_solution, no_worker, solve_analytic, solve_slowly
from effects import contents
from workers import NEEDS_DASK, Cluster

from scleraforce.cluster import cluster_workers
from scleraforce.errors import SolverError
from scleraforce.library.build import build_library
from scleraforce.study import LibraryStudy, Study

pytestmark = NEEDS_DASK

STUDY = Study(library=LibraryStudy(thicknesses=4, tensions=5, tips=6, elements=16))


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

    workers = cluster_workers(cluster.address)
    result = build_library(STUDY, tmp_path / "cluster", workers=workers, progress=kill_half_way, solve=solve_slowly)
    assert victim.wait() == -signal.SIGKILL
    assert result.solved == sum(done) == 260
    build_library(STUDY, tmp_path / "here", workers=2, solve=solve_analytic)
    assert contents(tmp_path / "cluster") == contents(tmp_path / "here")


@pytest.mark.slow
@pytest.mark.long
def test_what_fails_on_the_cluster_fails_here(cluster, tmp_path):
    cluster.worker("--nanny")  # starts a worker anew after each death
    with pytest.raises(SolverError, match=r"path \d+ of 260: no equilibrium"):
        build_library(STUDY, tmp_path / "a", workers=cluster_workers(cluster.address), solve=no_solution)
    with pytest.raises(SolverError, match="die one after the other"):
        build_library(STUDY, tmp_path / "b", workers=cluster_workers(cluster.address), solve=no_worker)
