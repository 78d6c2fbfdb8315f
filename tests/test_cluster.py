"""Units of work on a real Dask cluster of this machine, whose parts are killed."""

import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from workers import NEEDS_DASK, Cluster, ends_its_process, named_threads, no_preparation, slowly_tripled

from scleraforce import cluster as cluster_module
from scleraforce.cluster import ClusterWorkers, cluster_workers
from scleraforce.errors import InputError, SolverError
from scleraforce.processes import work_in_order, work_units

pytestmark = NEEDS_DASK


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster of two workers that come back after each death."""
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    made.worker("--nanny")
    made.worker("--nanny")
    yield made
    made.end()


@pytest.fixture
def mortal(tmp_path: Path) -> Iterator[Cluster]:
    """A cluster whose parts a test kills; it has no workers yet."""
    made = Cluster(tmp_path)
    yield made
    made.end()


@pytest.mark.slow
def test_units_are_done_once_each_and_in_order_where_that_is_asked_for(cluster: Cluster) -> None:
    workers = cluster_workers(cluster.address)
    assert dict(work_units(slowly_tripled, range(5, 12), workers)) == {unit: 3 * unit for unit in range(5, 12)}
    assert list(work_in_order(slowly_tripled, range(12, 5, -1), workers, ahead=3)) == [36 - 3 * n for n in range(7)]
    assert list(work_units(slowly_tripled, [], workers)) == []
    assert list(work_in_order(slowly_tripled, [], workers, ahead=3)) == []


@pytest.mark.slow
def test_units_that_are_many_are_handed_out_a_few_at_a_time(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    handed_out: list[int] = []
    submit = cluster_module._Session.submit

    def handing_out(session: cluster_module._Session, unit: int) -> object:
        handed_out.append(unit)
        return submit(session, unit)

    monkeypatch.setattr(cluster_module, "LEAST_AHEAD", 2)
    monkeypatch.setattr(cluster_module, "AHEAD", 1)
    monkeypatch.setattr(cluster_module._Session, "submit", handing_out)
    workers = cluster_workers(cluster.address)
    found = {}
    for unit, result in work_units(slowly_tripled, range(20), workers):
        assert len(handed_out) - len(found) <= max(2, workers)
        found[unit] = result
    assert found == {unit: 3 * unit for unit in range(20)}


@pytest.mark.slow
def test_each_thread_of_a_worker_prepares_for_itself_and_once(cluster: Cluster) -> None:
    told = dict(work_units(named_threads, range(40), cluster_workers(cluster.address))).values()
    assert all(prepared == does for prepared, _, does in told)
    assert len({preparation for _, preparation, _ in told}) == len({does for *_, does in told})


@pytest.mark.slow
def test_what_fails_there_fails_here(cluster: Cluster) -> None:
    workers = cluster_workers(cluster.address)
    with pytest.raises(InputError, match="this eye is too small"):
        list(work_units(no_preparation, range(3), workers))
    with pytest.raises(InputError, match="this eye is too small"):
        list(work_in_order(no_preparation, range(3), workers, ahead=2))
    with pytest.raises(SolverError, match="die one after the other"):
        list(work_units(ends_its_process, [7], workers))


@pytest.mark.slow
def test_another_version_there_is_told(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "_version", lambda: "0.0.1")
    with pytest.raises(InputError, match=r"a worker has scleraforce \d.*, this process 0\.0\.1; install the same"):
        list(work_units(slowly_tripled, [1], cluster_workers(cluster.address)))


@pytest.mark.slow
def test_work_waits_for_workers_and_outlives_one(mortal: Cluster) -> None:
    workers = cluster_workers(mortal.address)
    assert isinstance(workers, ClusterWorkers)
    assert workers == 1
    victim, _ = mortal.worker(), mortal.worker()
    results = []
    for result in work_in_order(slowly_tripled, range(60), workers, ahead=20):
        results.append(result)
        if len(results) == 5:
            victim.send_signal(signal.SIGKILL)
    assert results == [3 * unit for unit in range(60)]
    assert victim.wait() == -signal.SIGKILL


@pytest.mark.slow
def test_a_scheduler_that_ends_is_one_clear_error(mortal: Cluster) -> None:
    mortal.worker()
    done = work_units(slowly_tripled, range(10_000), cluster_workers(mortal.address))
    next(done)
    mortal.scheduler.kill()
    with pytest.raises(SolverError, match="the scheduler has ended"):
        list(done)


@pytest.mark.slow
def test_work_that_is_left_is_taken_back(cluster: Cluster) -> None:
    workers = cluster_workers(cluster.address)
    work = work_units(slowly_tripled, range(10_000), workers)
    next(work)
    work.close()
    start = time.monotonic()
    assert dict(work_units(slowly_tripled, [1], workers)) == {1: 3}
    assert time.monotonic() - start < 20.0  # those that were handed out before would take minutes


def test_no_scheduler_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "CONNECT_S", 0.5)
    with pytest.raises(InputError, match=re.escape("no Dask scheduler answers at tcp://127.0.0.1:9")):
        cluster_workers("tcp://127.0.0.1:9")
