"""A data set whose slices a Dask cluster makes: the bytes of one that processes make, whatever dies."""

import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from analytic_library import analytic_library
from effects import contents
from workers import NEEDS_DASK, Cluster

from scleraforce.cluster import cluster_workers
from scleraforce.learning.generate import generate_dataset
from scleraforce.study import DatasetGroup, MeshStudy, Study

pytestmark = [*NEEDS_DASK, pytest.mark.slow]

MODULUS_PA = 0.3e6
STUDY = Study(mesh=MeshStudy(divisions=4, level=0))
GROUPS = tuple(DatasetGroup(thickness_m=thickness_m, images=600, max_force_n=20e-3) for thickness_m in (5e-4, 8e-4))
STUDY = replace(STUDY, dataset=replace(STUDY.dataset, contacts=12, group=GROUPS))


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    yield made
    made.end()


def test_slices_are_the_same_on_a_cluster_that_loses_a_worker_and_after_ctrl_c(
    cluster: Cluster, tmp_path: Path
) -> None:
    victim, _ = cluster.worker(), cluster.worker()
    done: list[int] = []

    def interrupt(count: int) -> None:
        done.append(count)
        if sum(done) == 200:
            victim.send_signal(signal.SIGKILL)
        if sum(done) == 600:
            raise KeyboardInterrupt

    there, here = tmp_path / "there", tmp_path / "here"
    with pytest.raises(KeyboardInterrupt):
        generate_dataset(STUDY, there, workers=cluster_workers(cluster.address), progress=interrupt)
    assert victim.wait() == -signal.SIGKILL
    assert generate_dataset(STUDY, there, workers=cluster_workers(cluster.address)).simulated == 600
    generate_dataset(STUDY, here, workers=2)
    assert contents(there) == contents(here)


def test_slices_that_are_drawn_from_a_library_are_the_same_on_a_cluster(cluster: Cluster, tmp_path: Path) -> None:
    cluster.worker()
    library, there, here = analytic_library(), tmp_path / "there", tmp_path / "here"
    workers = cluster_workers(cluster.address)
    generate_dataset(STUDY, there, youngs_modulus_pa=MODULUS_PA, library=library, workers=workers)
    generate_dataset(STUDY, here, youngs_modulus_pa=MODULUS_PA, library=library)
    assert contents(there) == contents(here)
