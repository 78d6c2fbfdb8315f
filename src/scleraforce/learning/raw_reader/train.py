"""From a library to a model folder of kind "raw-reader": train, measure on frames that were never seen, write."""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.learning.framework import onnx, torch
from scleraforce.learning.raw_reader.card import raw_reader_card
from scleraforce.learning.raw_reader.graph import raw_reader_onnx_bytes
from scleraforce.learning.raw_reader.intervals import measured_raw_intervals
from scleraforce.learning.raw_reader.measure import measure_raw_reader
from scleraforce.learning.raw_reader.samples import RawSource
from scleraforce.learning.raw_reader.training import FittedRawReader, fit_raw_reader
from scleraforce.learning.reader.draws import CHUNK
from scleraforce.learning.reader.train import check_library, stored_library
from scleraforce.learning.reader.training import READER_THREADS, ReaderMetrics
from scleraforce.library import Library
from scleraforce.models.writing import check_place, write_folder
from scleraforce.processes import available_cores
from scleraforce.reader.raw_reader import RawReader
from scleraforce.study import Study, format_study, study_hash
from scleraforce.units import from_si

__all__ = ["TrainedRawReader", "train_raw_reader"]


@dataclass(frozen=True)
class TrainedRawReader:
    """What a training reached on its validation frames, after how many batches of how many frames."""

    metrics: ReaderMetrics
    batches: int
    frames: int


def train_raw_reader(
    library: Library,
    study: Study,
    out: Path,
    workers: int | None = None,
    progress: Callable[[int], object] | None = None,
    learned: Callable[[int], object] | None = None,
    measured: Callable[[int], object] | None = None,
) -> TrainedRawReader:
    """Train the raw reader on a library and write its model folder.

    Args:
        library: of responses.
        study: with the `[raw_reader]`, `[reader]` and `[phantom]` to use; the library has to be one of its eyes.
        out: the folder to make; it must not exist.
        workers: processes that draw samples; None: one for each other core that this process may use.
        progress: called with 1 after each epoch of slices.
        learned: called with 1 after each batch of raw frames.
        measured: called with 1 after each of the eyes that the intervals are measured on.

    Raises:
        ModelError: `out` exists or cannot be written.
        InputError: the library is of other eyes than the study, or does not hold those of `[reader]`.
        SolverError: the training diverged.
    """
    check_place(out)
    check_library(library, study)
    fitted = fit_raw_reader(library, study, workers or max(1, available_cores() - 1), progress, learned)
    metrics = measure_raw_reader(fitted.network, RawSource.of(library, study), study)
    provenance = _provenance(study, library)
    graph = raw_reader_onnx_bytes(fitted.network, provenance)
    record = _record(study, fitted, metrics, provenance)
    if study.raw_reader.interval_eyes:
        record["intervals"] = measured_raw_intervals(study, library, graph, workers or available_cores(), measured)
    write_folder(out, graph, format_study(study), raw_reader_card(study, record), record)
    return TrainedRawReader(metrics, study.raw_reader.batches, record["samples"]["training"])


def _provenance(study: Study, library: Library) -> dict[str, str]:
    """Return what `metadata_props` of the network says: the same for the same study, library and versions."""
    return {
        "kind": RawReader.kind,
        "study_sha256": study_hash(study),
        "library_sha256": sha256(stored_library(library)[0]).hexdigest(),
        "seed": str(study.raw_reader.seed),
        "threads": str(READER_THREADS),
        "class_bounds_mn": ", ".join(f"{from_si(bound, 'mn'):g}" for bound in study.classes.bounds_n),
        "scleraforce": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
        "onnx": onnx.__version__,
    }


def _record(
    study: Study, fitted: FittedRawReader, metrics: ReaderMetrics, provenance: dict[str, str]
) -> dict[str, Any]:
    """Return `model.json` without its hashes."""
    raw = study.raw_reader
    return {
        "kind": RawReader.kind,
        "provenance": provenance,
        "samples": {
            "slices": raw.slice_epochs * -(-study.reader.samples_per_epoch // CHUNK) * CHUNK,
            "training": raw.batches * raw.batch_size,
            "validation": raw.validation_frames,
        },
        "batches": raw.batches,
        "metrics": {
            "validation_accuracy": metrics.accuracy,
            "validation_interval": metrics.interval,
            "validation_confusion": metrics.confusion,
            "mae_mn": from_si(metrics.mae_n, "mn"),
            "coverage": metrics.coverage,
            "lateral_mae_mm": from_si(metrics.lateral_mae_m, "mm"),
        },
        "curves": {"training_loss": fitted.training_loss},
    }
