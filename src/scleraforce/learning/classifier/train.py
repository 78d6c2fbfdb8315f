"""From a data set to a model folder: train, validate through ONNX Runtime, write."""

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.dataset.store import Dataset
from scleraforce.errors import DatasetError
from scleraforce.learning.classifier.card import model_card
from scleraforce.learning.classifier.graph import onnx_bytes
from scleraforce.learning.classifier.half_weights import stored_as_half, with_half_weights
from scleraforce.learning.classifier.samples import Samples, classes_at_modulus, content_hash
from scleraforce.learning.classifier.search import Candidate, search_sizes
from scleraforce.learning.classifier.training import CLASSIFIER_THREADS, Curves, Fitted, fit
from scleraforce.learning.fingerprint import classifier_fingerprint
from scleraforce.learning.framework import onnx, torch
from scleraforce.models.folder import check_place, write_folder
from scleraforce.reader.metrics import accuracy, confusion_matrix, recall
from scleraforce.study import NetworkStudy, Study, format_study, study_hash
from scleraforce.units import from_si


@dataclass(frozen=True)
class Trained:
    """What a training reached; `candidates` are those of the grid search (empty without one)."""

    validation_accuracy: float
    validation_interval: tuple[float, float]
    network: NetworkStudy
    curves: Curves
    candidates: tuple[Candidate, ...] = ()


def train_classifier(
    dataset: Dataset,
    out: Path,
    network: NetworkStudy | None = None,
    search: bool = False,
    progress: Callable[[int], object] | None = None,
    youngs_modulus_pa: float | None = None,
    workers: int | None = None,
) -> Trained:
    """Train the classifier on a data set and write its model folder.

    Args:
        dataset: an opened data set.
        out: the folder to make; it must not exist.
        network: sizes and training, where they are to differ from those in the data set's study.
        search: try every size of the grid instead, and keep the best.
        progress: called with 1 after each epoch (of each size).
        youngs_modulus_pa: label the slices for walls of this modulus (`classes_at_modulus`); None: as simulated.
        workers: that try the sizes (`search_sizes`).

    Raises:
        ModelError: `out` exists or cannot be written.
        DatasetError: there is nothing to train or to validate on.
        SolverError: the training diverged.
    """
    check_place(out)
    modulus_pa = dataset.youngs_modulus_pa if youngs_modulus_pa is None else youngs_modulus_pa
    study = _trained_study(dataset, network, modulus_pa)
    classes = len(study.classes.bounds_n) + 1
    training, validation = split_samples(dataset, modulus_pa)
    if search:
        found = search_sizes(study.network, training, validation, classes, progress, workers)
        study, fitted, candidates = replace(study, network=found.study), found.fitted, found.candidates
    else:
        fitted, candidates = fit(study.network, training, validation, classes, progress), ()
    fitted = replace(fitted, network=with_half_weights(fitted.network))
    provenance = _provenance(study, training, validation)
    record, card = _describe(study, fitted, training, validation, provenance)
    graph = stored_as_half(onnx_bytes(fitted.network, study.slice.rows, study.slice.columns, provenance))
    write_folder(out, graph, format_study(study), card, {**record, "search": [asdict(entry) for entry in candidates]})
    metrics = record["metrics"]
    accuracy_value, interval = metrics["validation_accuracy"], metrics["validation_interval"]
    return Trained(accuracy_value, interval, study.network, fitted.curves, candidates)


def split_samples(dataset: Dataset, youngs_modulus_pa: float) -> tuple[Samples, Samples]:
    """Return the training and the validation samples of a data set, labelled for walls of a modulus.

    They share no contact. At the data set's own modulus the labels are those of its forces.

    Raises:
        DatasetError: one of them is empty.
    """
    parts = dataset.split()
    if not all(len(part) for part in parts):
        raise DatasetError(
            f"{dataset.path}: validation: {len(parts[1])} of {dataset.images} samples; training and validation need "
            "some each"
        )
    ratio = youngs_modulus_pa / dataset.youngs_modulus_pa
    target = classes_at_modulus(dataset.force_n, ratio, dataset.study.classes)
    training, validation = (Samples(dataset.slices[part], target[part]) for part in parts)
    return training, validation


def _trained_study(dataset: Dataset, network: NetworkStudy | None, youngs_modulus_pa: float) -> Study:
    """Return the study that goes with the model: with the modulus that its labels belong to."""
    study = replace(dataset.study, network=network or dataset.study.network)
    return replace(study, eye=replace(study.eye, youngs_modulus_pa=youngs_modulus_pa))


def _provenance(study: Study, training: Samples, validation: Samples) -> dict[str, str]:
    """Return what `metadata_props` of the network says: the same for the same study, data and versions."""
    return {
        "kind": "classifier",
        "study_sha256": study_hash(study),
        "dataset_sha256": content_hash(training, validation),
        "seed": str(study.network.seed),
        "threads": str(CLASSIFIER_THREADS),
        "class_bounds_mn": ", ".join(f"{from_si(bound, 'mn'):g}" for bound in study.classes.bounds_n),
        "youngs_modulus_mpa": f"{from_si(study.eye.youngs_modulus_pa, 'mpa'):.6g}",
        "scleraforce": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
        "onnx": onnx.__version__,
    }


def _describe(
    study: Study, fitted: Fitted, training: Samples, validation: Samples, provenance: dict[str, str]
) -> tuple[dict[str, Any], str]:
    """Return `model.json` (without hashes) and the model card."""
    curves, bounds = fitted.curves, study.classes.bounds_n
    answers = fitted.network.probabilities(validation.slices).argmax(axis=1)
    confusion = confusion_matrix(validation.target.tolist(), answers.tolist(), len(bounds) + 1)
    metrics = {
        "validation_accuracy": accuracy(confusion).value,
        "validation_interval": accuracy(confusion).interval,
        "validation_loss": curves.validation_loss[-1],
        "validation_confusion": confusion.tolist(),
    }
    record = {
        "kind": "classifier",
        "provenance": provenance,
        "samples": {"training": len(training), "validation": len(validation)},
        "epochs": study.network.epochs,
        "metrics": metrics,
        "curves": asdict(curves),
        "fingerprint": classifier_fingerprint(study),
    }
    return record, model_card(study, record, (len(training), len(validation)), recall(confusion))
