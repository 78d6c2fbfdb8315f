"""Networks made with a Dask cluster: the numbers of this machine."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from small_models import SMALL_STUDY
from workers import NEEDS_DASK, Cluster

from scleraforce.base.worker_processes import cluster_workers
from scleraforce.lab.training.classifier_training import (
    CLASSIFIER_THREADS,
    Samples,
    search_sizes,
)
from scleraforce.lab.training.wall_network_training import fit_wall_finder
from scleraforce.records.study import NetworkStudy

pytestmark = [*NEEDS_DASK, pytest.mark.slow]


@pytest.fixture(autouse=True)
def threads_of_a_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train here on as many threads as workers do: sums in another order differ in the
    last bit.
    """
    monkeypatch.setattr(
        "scleraforce.lab.training.classifier_training.CLASSIFIER_THREADS",
        CLASSIFIER_THREADS,
    )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    yield made
    made.end()


def test_a_search_on_a_cluster_finds_what_one_here_finds(cluster):
    cluster.worker()  # of two threads, which share PyTorch's random numbers
    rng = np.random.default_rng(0)
    training, validation = (
        Samples(
            255 * rng.integers(0, 2, (count, 6, 9), dtype=np.uint8),
            rng.integers(0, 3, count),
        )
        for count in (400, 100)
    )
    study = NetworkStudy(
        search_widths=(5, 9, 12),
        search_depths=(1, 2),
        epochs=3,
        batch_size=50,
        learning_rate=0.05,
    )
    ticks: list[int] = []
    workers = cluster_workers(cluster.address)
    there = search_sizes(
        study, training, validation, progress=ticks.append, workers=workers
    )
    here = search_sizes(study, training, validation)
    assert ticks == [3] * 6
    assert there[:2] == here[:2]
    np.testing.assert_equal(asdict(there[2]), asdict(here[2]))


def test_a_wall_finder_learns_the_same_from_scenes_that_a_cluster_draws(
    cluster,
):
    cluster.worker()
    study = replace(
        SMALL_STUDY, wall_finder=replace(SMALL_STUDY.wall_finder, batches=12)
    )
    there, here = (
        fit_wall_finder(study, workers)
        for workers in (cluster_workers(cluster.address), 1)
    )
    assert there.training_loss == here.training_loss
    assert all(
        map(
            torch.equal,
            there.network.state_dict().values(),
            here.network.state_dict().values(),
        )
    )
