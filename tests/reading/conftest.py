"""A tiny model folder with known weights."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from small_models import write_classifier
from small_recordings import write_places

from scleraforce.records.study import SliceStudy, Study


@dataclass(frozen=True)
class TinyModel:
    """The folder, and the weights (pixel, class) and biases (class,) of its network."""

    path: Path
    weights: np.ndarray
    biases: np.ndarray


@pytest.fixture(scope="session")
def write_model() -> Callable[[Path, Study], TinyModel]:
    """Return the function that writes a classifier with random weights."""
    pytest.importorskip("onnx")
    return lambda path, study: TinyModel(path, *write_classifier(path, study))


@pytest.fixture(scope="session")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("places"))


@pytest.fixture
def tiny_model(write_model, tmp_path: Path) -> TinyModel:
    """A model that reads 8 x 10 slices."""
    study = replace(Study(), slice=SliceStudy(columns=10, rows=8))
    return write_model(tmp_path / "model", study)
