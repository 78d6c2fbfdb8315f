"""Samples that a small network can learn: a bar whose depth is the force."""

from importlib.util import find_spec

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.lab.training.classifier_training import Samples
from scleraforce.library import Library
from scleraforce.records.study import NetworkStudy

ROWS = 12
COLUMNS = 10

if find_spec("torch") is None:  # the extra `train` is not installed
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Train on one thread: for networks as small as these, a second costs more than it
    brings on a busy machine.
    """
    monkeypatch.setattr(
        "scleraforce.lab.training.classifier_training.CLASSIFIER_THREADS", 1
    )


def make_bars(count: int, seed: int) -> Samples:
    """Slices of 12 x 10 pixels with a bar two rows thick; its depth, 0 to 8 rows,
    decides the class; some speckle.
    """
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 9, size=count)
    row = np.arange(ROWS)[:, None]
    below = row - depth[:, None, None]
    bars = ((below >= 0) & (below < 2)) ^ (rng.random((count, ROWS, COLUMNS)) < 0.1)
    bars[:, -1] = False  # a row that never varies

    return Samples(
        np.broadcast_to(bars, (count, ROWS, COLUMNS)).astype(np.uint8) * np.uint8(255),
        depth // 3,
    )


@pytest.fixture(scope="session")
def bars() -> tuple[Samples, Samples]:
    """Training and validation samples."""
    return make_bars(600, 1), make_bars(200, 2)


@pytest.fixture
def small() -> NetworkStudy:
    """A network that trains in a moment."""
    return NetworkStudy(
        hidden=(24, 16), dropout=0.3, learning_rate=0.1, batch_size=32, epochs=4
    )


@pytest.fixture(scope="session")
def library() -> Library:
    return analytic_library(thicknesses=5, ratios=5, tips=24)
