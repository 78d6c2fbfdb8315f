"""A tiny model folder with known weights."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from scleraforce.records.study import SliceStudy, Study, format_study, study_hash


@dataclass(frozen=True)
class TinyModel:
    """The folder, and the network in it."""

    path: Path
    network: object
    study: Study


def write_tiny_model(path: Path, study: Study, hidden: int = 40) -> TinyModel:
    """Write a model with random weights for a study; its validation figures are made
    up.
    """
    pytest.importorskip("torch")
    from scleraforce.lab.training.classifier_training import (
        TrainedNetwork,
        classifier_bytes,
        with_half_weights,
    )
    from scleraforce.records.model_folder import write_folder

    rng = np.random.default_rng(5)
    pixels = study.slice.rows * study.slice.columns
    sizes = [(hidden, pixels), (hidden, hidden), (3, hidden)]
    weights = tuple(
        rng.normal(size=size).astype(np.float32)
        * np.sqrt(4.0 / size[1], dtype=np.float32)
        for size in sizes
    )
    biases = tuple(
        rng.normal(0.0, 0.1, size=size[0]).astype(np.float32) for size in sizes
    )
    network = with_half_weights(
        TrainedNetwork(
            rng.uniform(0.0, 0.3, pixels).astype(np.float32), weights, biases
        )
    )
    graph = classifier_bytes(network, study.slice, {"study_sha256": study_hash(study)})
    write_folder(
        path,
        graph,
        format_study(study),
        "# card\n",
        {"kind": "classifier", "metrics": {}},
    )

    return TinyModel(path, network, study)


@pytest.fixture(scope="session")
def write_model() -> Callable[[Path, Study], TinyModel]:
    """Return the function that writes a model with random weights."""
    return write_tiny_model


@pytest.fixture
def tiny_model(tmp_path: Path) -> TinyModel:
    """A model that reads 8 x 10 slices."""
    return write_tiny_model(
        tmp_path / "model", replace(Study(), slice=SliceStudy(columns=10, rows=8))
    )
