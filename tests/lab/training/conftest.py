"""A small network, and the library whose walls it sees."""

from importlib.util import find_spec

import pytest
from analytic_library import analytic_library

from scleraforce.library import Library
from scleraforce.records.study import NetworkStudy

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


@pytest.fixture
def small() -> NetworkStudy:
    """A network that trains in a moment."""
    return NetworkStudy(
        hidden=(24, 16), dropout=0.3, learning_rate=0.1, batch_size=32, epochs=4
    )


@pytest.fixture(scope="session")
def library() -> Library:
    return analytic_library(thicknesses=5, ratios=5, tips=24)
