"""From nothing but a study to a model folder of kind "wall-finder": draw, train, measure, write."""

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.learning.fingerprint import finder_fingerprint
from scleraforce.learning.framework import onnx, torch
from scleraforce.learning.wall_finder.card import finder_card
from scleraforce.learning.wall_finder.graph import finder_onnx_bytes
from scleraforce.learning.wall_finder.measure import FinderMetrics, measure_finder
from scleraforce.learning.wall_finder.training import FINDER_THREADS, FittedFinder, fit_wall_finder
from scleraforce.models.folder import NETWORK_FILE, WALL_FINDER, check_place, write_folder
from scleraforce.models.session import network_session
from scleraforce.processes import available_cores
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study, format_study, study_hash


@dataclass(frozen=True)
class TrainedFinder:
    """What a training reached on scenes that it never saw, after how many batches of how many scenes."""

    metrics: FinderMetrics
    batches: int
    scenes: int


def train_wall_finder(
    study: Study, out: Path, workers: int | None = None, progress: Callable[[int], object] | None = None
) -> TrainedFinder:
    """Train the wall finder on drawn scenes and write its model folder.

    Args:
        study: with the `[scenes]` and the `[wall_finder]` to use.
        out: the folder to make; it must not exist.
        workers: processes, or those of a cluster, that draw; None: a process for each other core that this one may use.
        progress: called with 1 after each batch.

    Raises:
        ModelError: `out` exists or cannot be written.
        SolverError: the training diverged.
    """
    check_place(out)
    finder = study.wall_finder
    fitted = fit_wall_finder(study.scenes, finder, workers or max(1, available_cores() - 1), progress)
    provenance = _provenance(study)
    graph = finder_onnx_bytes(fitted.network, provenance)
    runs = WallFinder(network_session(graph, NETWORK_FILE, 1), finder, NETWORK_FILE)
    metrics = measure_finder(runs, study.scenes, finder.validation_scenes, finder.rows)
    record = _record(study, fitted, metrics, provenance)
    write_folder(out, graph, format_study(study), finder_card(study, record), record)
    return TrainedFinder(metrics, finder.batches, record["scenes"]["training"])


def _provenance(study: Study) -> dict[str, str]:
    """Return what `metadata_props` of the network says: the same for the same study and versions."""
    return {
        "kind": WALL_FINDER,
        "study_sha256": study_hash(study),
        "seed": str(study.wall_finder.seed),
        "scenes_seed": str(study.scenes.seed),
        "threads": str(FINDER_THREADS),
        "scleraforce": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
        "onnx": onnx.__version__,
    }


def _record(study: Study, fitted: FittedFinder, metrics: FinderMetrics, provenance: dict[str, str]) -> dict[str, Any]:
    """Return `model.json` without its hashes."""
    finder = study.wall_finder
    return {
        "kind": WALL_FINDER,
        "provenance": provenance,
        "scenes": {"training": finder.batches * finder.batch_size, "validation": finder.validation_scenes},
        "batches": finder.batches,
        "metrics": asdict(metrics),
        "curves": {"training_loss": fitted.training_loss},
        "fingerprint": finder_fingerprint(study),
    }
