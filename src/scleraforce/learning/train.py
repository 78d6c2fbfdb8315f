"""Train a network, measure it on unseen samples, and write its model folder."""

import platform
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce import __version__
from scleraforce.errors import DatasetError
from scleraforce.learning import cards, classifier, raw_reader, reader, wall_finder
from scleraforce.learning.dataset import Dataset
from scleraforce.learning.descent import READER_THREADS, chosen_device, onnx, torch
from scleraforce.learning.generate import check_library
from scleraforce.learning.samples import CHUNK, Source
from scleraforce.learning.virtual_eyes import measured_intervals, measuring
from scleraforce.library import Library, save_library
from scleraforce.library.files import StoredErrors
from scleraforce.models import LIBRARY_FILE, NETWORK_FILE, WALL_FINDER, check_place, network_session, write_folder
from scleraforce.processes import available_cores
from scleraforce.reader.kinds import RawReader
from scleraforce.reader.metrics import accuracy, confusion_matrix, recall
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import NetworkStudy, Study, format_study, study_hash
from scleraforce.units import from_si

Progress = Callable[[int], object] | None

DEFAULT_METHOD = "fit"  # nearer to the true force than the network on virtual eyes (docs/figures.md)
EYES = "virtual eyes of the library's walls"


Record = dict[str, Any]  # `model.json`


def train_classifier(
    dataset: Dataset,
    out: Path,
    network: NetworkStudy | None = None,
    search: bool = False,
    progress: Progress = None,
    youngs_modulus_pa: float | None = None,
    workers: int | None = None,
    device: str = "auto",
) -> Record:
    """Train the classifier on a data set and write its model folder; return what `model.json` keeps of it."""
    check_place(out)
    device = chosen_device(device)
    modulus_pa = dataset.youngs_modulus_pa if youngs_modulus_pa is None else youngs_modulus_pa
    study = replace(dataset.study, network=network or dataset.study.network)
    study = replace(study, eye=replace(study.eye, youngs_modulus_pa=modulus_pa))  # that its labels belong to
    classes = len(study.classes.bounds_n) + 1
    training, validation = split_samples(dataset, modulus_pa)
    candidates: tuple[classifier.Candidate, ...] = ()
    if search:
        candidates, sizes, fitted = classifier.search_sizes(
            study.network, training, validation, classes, progress, workers, device
        )
        study = replace(study, network=sizes)
    else:
        fitted = classifier.fit(study.network, training, validation, classes, progress, device)
    stored = classifier.with_half_weights(fitted.network)
    of_data = {"dataset_sha256": classifier.content_hash(training, validation), "class_bounds_mn": _bounds_mn(study)}
    of_data["youngs_modulus_mpa"] = f"{from_si(modulus_pa, 'mpa'):.6g}"
    provenance = _provenance("classifier", study, study.network.seed, classifier.CLASSIFIER_THREADS, device, **of_data)
    answers = stored.probabilities(validation.slices).argmax(axis=1)
    confusion = confusion_matrix(validation.target.tolist(), answers.tolist(), classes)
    reached = accuracy(confusion)
    record: Record = {
        "kind": "classifier",
        "provenance": provenance,
        "samples": {"training": len(training), "validation": len(validation)},
        "epochs": study.network.epochs,
        "metrics": {
            "validation_accuracy": reached.value,
            "validation_interval": reached.interval,
            "validation_loss": fitted.curves.validation_loss[-1],
            "validation_confusion": confusion.tolist(),
        },
        "curves": asdict(fitted.curves),
        "search": [asdict(entry) for entry in candidates],
    }
    card = cards.classifier_card(study, record, recall(confusion))
    write_folder(out, classifier.classifier_bytes(stored, study.slice, provenance), format_study(study), card, record)
    return record


def split_samples(dataset: Dataset, youngs_modulus_pa: float) -> tuple[classifier.Samples, classifier.Samples]:
    """Return the training and the validation samples of a data set, labelled for walls of a modulus."""
    parts = dataset.split()
    if not all(len(part) for part in parts):
        raise DatasetError(
            f"{dataset.path}: validation: {len(parts[1])} of {dataset.images} samples; training and validation need "
            "some each"
        )
    ratio = youngs_modulus_pa / dataset.youngs_modulus_pa
    target = classifier.classes_at_modulus(dataset.force_n, ratio, dataset.study.classes)
    training, validation = (classifier.Samples(dataset.slices[part], target[part]) for part in parts)
    return training, validation


def train_reader(
    library: Library,
    study: Study,
    out: Path,
    workers: int | None = None,
    progress: Progress = None,
    measured: Progress = None,
    device: str = "auto",
) -> Record:
    """Train the reader on a library and write its model folder."""
    check_place(out)
    check_library(library, study)
    device, own, (content, errors) = chosen_device(device), study.reader, _stored_library(library)
    source = Source.of(library, own, study.slice)
    fitted = reader.fit_reader(study, source.chunk, workers or _other_cores(), progress, device)
    provenance = _library_provenance("reader", study, own.seed, content, device)
    graph = reader.reader_bytes(fitted.network, study.slice, provenance)
    samples = own.epochs * _whole_chunks(study)
    record: Record = {
        "kind": "reader",
        "default": DEFAULT_METHOD,
        "provenance": provenance,
        "samples": {"training": samples, "validation": own.validation_samples},
        "epochs": own.epochs,
        "metrics": reader.measure_reader(fitted.network, source, study),
        "curves": {"training_loss": fitted.training_loss},
        "library": asdict(errors),
    }
    if own.interval_eyes:
        measure, cores = partial(measuring, study, library, graph), workers or available_cores()
        record["intervals"] = measured_intervals(measure, own.interval_eyes, cores, EYES, measured)
    write_folder(out, graph, format_study(study), cards.reader_card(study, record), record, {LIBRARY_FILE: content})
    return record


def train_raw_reader(
    library: Library,
    study: Study,
    out: Path,
    workers: int | None = None,
    progress: Progress = None,
    learned: Progress = None,
    measured: Progress = None,
    device: str = "auto",
) -> Record:
    """Train the raw reader as `train_reader` does; `learned` is called with 1 after each batch of raw frames."""
    check_place(out)
    check_library(library, study)
    device, raw = chosen_device(device), study.raw_reader
    fitted = raw_reader.fit_raw_reader(library, study, workers or _other_cores(), progress, learned, device)
    metrics = raw_reader.measure_raw_reader(fitted.network, raw_reader.RawSource.of(library, study), study)
    provenance = _library_provenance(RawReader.kind, study, raw.seed, _stored_library(library)[0], device)
    graph = raw_reader.raw_reader_bytes(fitted.network, provenance)
    frames = raw.batches * raw.batch_size
    samples = {
        "slices": raw.slice_epochs * _whole_chunks(study), "training": frames, "validation": raw.validation_frames,
    }  # fmt: skip
    record: Record = {
        "kind": RawReader.kind,
        "provenance": provenance,
        "samples": samples,
        "batches": raw.batches,
        "metrics": metrics,
        "curves": {"training_loss": fitted.training_loss},
    }
    if raw.interval_eyes:
        measure, cores = partial(raw_reader.measuring_raw, study, library, graph), workers or available_cores()
        source = f"{EYES}, drawn as raw frames"
        record["intervals"] = measured_intervals(measure, raw.interval_eyes, cores, source, measured)
    write_folder(out, graph, format_study(study), cards.raw_reader_card(study, record), record)
    return record


def train_wall_finder(
    study: Study, out: Path, workers: int | None = None, progress: Progress = None, device: str = "auto"
) -> Record:
    """Train the wall finder on scenes that workers draw (a process on each other core), and write its model folder."""
    check_place(out)
    device = chosen_device(device)
    finder = study.wall_finder
    fitted = wall_finder.fit_wall_finder(study.scenes, finder, workers or _other_cores(), progress, device)
    provenance = _provenance(
        WALL_FINDER, study, finder.seed, READER_THREADS, device, scenes_seed=str(study.scenes.seed)
    )
    graph = wall_finder.finder_bytes(fitted.network, provenance)
    runs = WallFinder(network_session(graph, NETWORK_FILE, 1), finder, NETWORK_FILE)
    metrics = wall_finder.measure_finder(runs, study.scenes, finder.validation_scenes, finder.rows)
    scenes = finder.batches * finder.batch_size
    record: Record = {
        "kind": WALL_FINDER,
        "provenance": provenance,
        "scenes": {"training": scenes, "validation": finder.validation_scenes},
        "batches": finder.batches,
        "metrics": metrics,
        "curves": {"training_loss": fitted.training_loss},
    }
    write_folder(out, graph, format_study(study), cards.finder_card(study, record), record)
    return record


def _provenance(kind: str, study: Study, seed: int, threads: int, device: str, **more: str) -> dict[str, str]:
    """Return `metadata_props` of a network: the same for the same study, data and versions."""
    return {
        "kind": kind,
        "study_sha256": study_hash(study),
        "seed": str(seed),
        "threads": str(threads),
        "device": torch.cuda.get_device_name() if device == "cuda" else device,
        **more,
        "scleraforce": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "torch": torch.__version__,
        "onnx": onnx.__version__,
    }


def _library_provenance(kind: str, study: Study, seed: int, library: bytes, device: str) -> dict[str, str]:
    """Return the provenance of a network that learned from a library, as it is stored."""
    digest = sha256(library).hexdigest()
    more = {"library_sha256": digest, "class_bounds_mn": _bounds_mn(study)}
    return _provenance(kind, study, seed, READER_THREADS, device, **more)


def _bounds_mn(study: Study) -> str:
    return ", ".join(f"{from_si(bound, 'mn'):g}" for bound in study.classes.bounds_n)


def _stored_library(library: Library) -> tuple[bytes, StoredErrors]:
    """Return a library as a model folder has it, and its largest deviations from the computed one."""
    file = BytesIO()
    errors = save_library(library, file)
    return file.getvalue(), errors


def _other_cores() -> int:
    return max(1, available_cores() - 1)


def _whole_chunks(study: Study) -> int:
    """Return the samples of an epoch of slices: whole chunks of them are drawn."""
    return -(-study.reader.samples_per_epoch // CHUNK) * CHUNK
