"""From a library to a model folder of kind "reader": train, measure on samples that were never seen, write."""

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.errors import InputError
from scleraforce.learning.fingerprint import interval_fingerprint, reader_fingerprint
from scleraforce.learning.framework import onnx, torch
from scleraforce.learning.reader.card import reader_card
from scleraforce.learning.reader.draws import CHUNK, Source
from scleraforce.learning.reader.graph import reader_onnx_bytes
from scleraforce.learning.reader.intervals import measured_intervals
from scleraforce.learning.reader.training import READER_THREADS, FittedReader, ReaderMetrics, fit_reader
from scleraforce.library import Library, load_library, save_library
from scleraforce.library.files import StoredErrors
from scleraforce.models.folder import LIBRARY_FILE, check_place, write_folder
from scleraforce.processes import available_cores
from scleraforce.study import Study, format_study, study_hash
from scleraforce.units import from_si

DEFAULT_METHOD = "fit"  # nearer to the true force than the network on virtual eyes (docs/figures.md)


@dataclass(frozen=True)
class TrainedReader:
    """What a training reached on its validation samples, after how many epochs of how many samples."""

    metrics: ReaderMetrics
    epochs: int
    samples: int


def train_reader(
    library: Library,
    study: Study,
    out: Path,
    workers: int | None = None,
    progress: Callable[[int], object] | None = None,
    measured: Callable[[int], object] | None = None,
) -> TrainedReader:
    """Train the reader on a library and write its model folder.

    Args:
        library: of responses.
        study: with the `[reader]` to use; the library has to be one of its eyes.
        out: the folder to make; it must not exist.
        workers: processes that draw samples; None: one for each other core that this process may use.
        progress: called with 1 after each epoch.
        measured: called with 1 after each of the eyes that the intervals are measured on.

    Raises:
        ModelError: `out` exists or cannot be written.
        InputError: the library is of other eyes than the study, does not hold those of `[reader]`, or is too large.
        SolverError: the training diverged.
    """
    check_place(out)
    check_library(library, study)
    content, errors = stored_library(library)
    stored = load_library(LIBRARY_FILE, content)
    fingerprint = reader_fingerprint(study, stored)
    source = Source.of(library, study.reader, study.slice)
    fitted = fit_reader(study, source, workers or max(1, available_cores() - 1), progress)
    provenance = provenance_of("reader", study, study.reader.seed, content)
    graph = reader_onnx_bytes(fitted.network, study.slice.rows, study.slice.columns, provenance)
    record = {**_record(study, fitted, provenance), "library": asdict(errors)}
    if study.reader.interval_eyes:
        record["intervals"] = measured_intervals(study, library, graph, workers or available_cores(), measured)
        fingerprint |= interval_fingerprint(study, stored, graph)
    record["fingerprint"] = fingerprint
    write_folder(out, graph, format_study(study), reader_card(study, record), record, {LIBRARY_FILE: content})
    return TrainedReader(fitted.metrics, study.reader.epochs, record["samples"]["training"])


def check_library(library: Library, study: Study) -> None:
    """Refuse a library of other eyes: its answers would be wrong without a sign of it."""
    compared = (
        ("radius", library.radius_m, study.eye.radius_m),
        ("Poisson's ratio", library.poisson_ratio, study.eye.poisson_ratio),
        ("needle radius", library.needle_radius_m, study.needle.outer_diameter_m / 2),
    )
    for name, found, wanted in compared:
        if not np.isclose(found, wanted, rtol=1e-9, atol=0.0):
            raise InputError(f"library: {name} {found:g}, the study has {wanted:g}; make a library of this study")


def stored_library(library: Library) -> tuple[bytes, StoredErrors]:
    """Return a library as a model folder has it, and by how much that differs from what was computed."""
    file = BytesIO()
    errors = save_library(library, file)
    return file.getvalue(), errors


def provenance_of(kind: str, study: Study, seed: int, library: bytes) -> dict[str, str]:
    """Return what `metadata_props` of a network says: the same for the same study, library and versions.

    Args:
        kind: of the model.
        study: of the training.
        seed: of the training.
        library: as it is stored.
    """
    return {
        "kind": kind,
        "study_sha256": study_hash(study),
        "library_sha256": sha256(library).hexdigest(),
        "seed": str(seed),
        "threads": str(READER_THREADS),
        "class_bounds_mn": ", ".join(f"{from_si(bound, 'mn'):g}" for bound in study.classes.bounds_n),
        "scleraforce": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
        "onnx": onnx.__version__,
    }


def _record(study: Study, fitted: FittedReader, provenance: dict[str, str]) -> dict[str, Any]:
    """Return `model.json` without its hashes."""
    reader = study.reader
    return {
        "kind": "reader",
        "default": DEFAULT_METHOD,
        "provenance": provenance,
        "samples": {
            "training": reader.epochs * -(-reader.samples_per_epoch // CHUNK) * CHUNK,
            "validation": reader.validation_samples,
        },
        "epochs": reader.epochs,
        "metrics": metrics_record(fitted.metrics),
        "curves": asdict(fitted.curves),
    }


def metrics_record(metrics: ReaderMetrics) -> dict[str, Any]:
    """Return `metrics` of `model.json`."""
    return {
        "validation_accuracy": metrics.accuracy,
        "validation_interval": metrics.interval,
        "validation_confusion": metrics.confusion,
        "mae_mn": from_si(metrics.mae_n, "mn"),
        "coverage": metrics.coverage,
        "lateral_mae_mm": from_si(metrics.lateral_mae_m, "mm"),
    }
