"""Train a network, measure it on unseen samples, and write its model folder, with the
card of its kind (cards.toml).
"""

import platform
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from functools import partial
from hashlib import sha256
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from scleraforce.base.errors import DatasetError
from scleraforce.base.onnx_network import network_session
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.base.worker_processes import available_cores
from scleraforce.calibration.answer_metrics import accuracy, confusion_matrix, recall
from scleraforce.lab.training import (
    classifier_training,
    force_reader_training,
    raw_reader_training,
    wall_network_training,
)
from scleraforce.lab.training.gradient_descent import (
    READER_THREADS,
    Progress,
    chosen_device,
    loss_curve,
    onnx,
    torch,
)
from scleraforce.lab.training.interval_measurement import measured_intervals, measuring
from scleraforce.lab.training.reader_samples import CHUNK, SampleSource
from scleraforce.lab.training.slice_dataset import Dataset, check_library
from scleraforce.library import Library, save_library
from scleraforce.reading.reading_models import RawReader
from scleraforce.records.fields import field_key, field_unit, map_numbers
from scleraforce.records.model_folder import (
    LIBRARY_FILE,
    NETWORK_FILE,
    WALL_FINDER,
    check_place,
    write_folder,
)
from scleraforce.records.study import (
    Choice,
    NetworkStudy,
    Range,
    Study,
    format_study,
    study_hash,
)
from scleraforce.wall.wall_network import WallFinder

Record = dict[str, Any]  # `model.json`

# nearer to the true force than the network on virtual eyes (docs/figures.md)
DEFAULT_METHOD = "fit"
EYES = "virtual eyes of the library's walls"


def train_classifier(
    dataset: Dataset,
    out: Path,
    network: NetworkStudy | None = None,
    search: bool = False,
    progress: Progress = None,
    youngs_modulus_pa: float | None = None,
    workers: int | None = None,
    device: str = "auto",
    threads: int = classifier_training.CLASSIFIER_THREADS,
) -> Record:
    """Train the classifier on a data set and write its model folder; return what
    `model.json` keeps of it.

    `threads` are of each training; another number sums in another order.
    """
    check_place(out)
    device = chosen_device(device)
    modulus_pa = (
        dataset.youngs_modulus_pa if youngs_modulus_pa is None else youngs_modulus_pa
    )
    study = replace(dataset.study, network=network or dataset.study.network)
    # that its labels belong to
    study = replace(study, eye=replace(study.eye, youngs_modulus_pa=modulus_pa))
    classes = len(study.classes.bounds_n) + 1
    samples = training, validation = split_samples(dataset, modulus_pa)
    candidates: tuple[classifier_training.Candidate, ...] = ()

    if search:
        candidates, sizes, fitted = classifier_training.search_sizes(
            study.network, *samples, classes, progress, workers, device, threads
        )
        study = replace(study, network=sizes)
    else:
        fitted = classifier_training.fit_classifier(
            study.network, *samples, classes, progress, device, threads
        )

    stored = classifier_training.with_half_weights(fitted)
    of_data = {
        "dataset_sha256": classifier_training.content_hash(*samples),
        "class_bounds_mn": _bounds_mn(study),
        "youngs_modulus_mpa": f"{from_si(modulus_pa, 'mpa'):.6g}",
    }
    provenance = _provenance(
        "classifier", study, study.network.seed, device, of_data, threads
    )
    answers = stored.probabilities(validation.slices).argmax(axis=1)
    confusion = confusion_matrix(validation.target.tolist(), answers.tolist(), classes)
    reached = accuracy(confusion)
    record = {
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
    graph = classifier_training.classifier_bytes(stored, study.slice, provenance)
    pixels = study.slice.rows * study.slice.columns
    words = {
        "sizes": "-".join(map(str, (pixels, *study.network.hidden, classes))),
        "mirrored": (
            ";\nhalf of the slices shown with left and right exchanged"
            if study.network.mirror
            else ""
        ),
        "recall": ", ".join(f"{share.value:.2%}" for share in recall(confusion)),
    }

    return _written(out, study, graph, provenance, record, words)


def split_samples(
    dataset: Dataset, youngs_modulus_pa: float
) -> tuple[classifier_training.Samples, classifier_training.Samples]:
    """Return the training and the validation samples of a data set, labelled for walls
    of a modulus.
    """
    parts = dataset.split()
    if not all(len(part) for part in parts):
        raise DatasetError(
            f"{dataset.path}: validation: {len(parts[1])} of {dataset.images} samples;"
            " training and validation need some each"
        )

    ratio = youngs_modulus_pa / dataset.youngs_modulus_pa
    target = classifier_training.classes_at_modulus(
        dataset.force_n, ratio, dataset.study.classes
    )
    training, validation = (
        classifier_training.Samples(dataset.slices[part], target[part])
        for part in parts
    )

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
    device = chosen_device(device)
    own = study.reader
    stored = BytesIO()
    errors = save_library(library, stored)
    source = SampleSource(library, own, study.slice)
    fitted = force_reader_training.fit_reader(
        study, source.chunk, workers or _other_cores(), progress, device
    )
    provenance = _provenance(
        "reader", study, own.seed, device, _of_library(stored, study)
    )
    graph = force_reader_training.force_bytes(fitted.network, provenance)
    record = {
        "default": DEFAULT_METHOD,
        "samples": {
            "training": own.epochs * _whole_chunks(study),
            "validation": own.validation_samples,
        },
        "epochs": own.epochs,
        "metrics": force_reader_training.measure_reader(fitted.network, source, study),
        "curves": {"training_loss": fitted.training_loss},
        "library": asdict(errors),
    }
    measure = partial(measuring, study, library, graph)
    cores = workers or available_cores()
    record |= measured_intervals(measure, own.interval_eyes, cores, EYES, measured)
    curves_um = {"curves_um": from_si(errors.curves_m, "um")}

    return _written(
        out,
        study,
        graph,
        provenance,
        record,
        curves_um,
        {LIBRARY_FILE: stored.getvalue()},
    )


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
    """Train the raw reader as `train_reader` does; `learned` is called with 1 after
    each batch of raw frames.
    """
    check_place(out)
    check_library(library, study)
    device = chosen_device(device)
    raw = study.raw_reader
    stored = BytesIO()
    save_library(library, stored)
    fitted = raw_reader_training.fit_raw_reader(
        library, study, workers or _other_cores(), progress, learned, device
    )
    provenance = _provenance(
        RawReader.kind, study, raw.seed, device, _of_library(stored, study)
    )
    graph = force_reader_training.force_bytes(fitted.network, provenance)
    frames = raw.batches * raw.batch_size
    slices = raw.slice_epochs * _whole_chunks(study)
    record = {
        "samples": {
            "slices": slices,
            "training": frames,
            "validation": raw.validation_frames,
        },
        "batches": raw.batches,
        "metrics": raw_reader_training.measure_raw_reader(
            fitted.network, raw_reader_training.RawSource(library, study), study
        ),
        "curves": {"training_loss": loss_curve(fitted.training_loss)},
    }
    measure = partial(raw_reader_training.measuring_raw, study, library, graph)
    cores = workers or available_cores()
    record |= measured_intervals(
        measure, raw.interval_eyes, cores, f"{EYES}, drawn as raw frames", measured
    )
    window_mm = {
        "width_mm": from_si(raw.rows * raw.row_m, "mm"),
        "depth_mm": from_si(raw.columns * raw.column_m, "mm"),
    }

    return _written(out, study, graph, provenance, record, window_mm)


def train_wall_finder(
    study: Study,
    out: Path,
    workers: int | None = None,
    progress: Progress = None,
    device: str = "auto",
) -> Record:
    """Train the wall finder on scenes that workers draw (a process on each other core),
    and write its model folder.
    """
    check_place(out)
    device = chosen_device(device)
    finder = study.wall_finder
    fitted = wall_network_training.fit_wall_finder(
        study, workers or _other_cores(), progress, device
    )
    provenance = _provenance(
        WALL_FINDER, study, finder.seed, device, {"scenes_seed": str(study.scenes.seed)}
    )
    graph = wall_network_training.finder_bytes(fitted.network, provenance)
    runs = WallFinder(network_session(graph, NETWORK_FILE, 1), finder, NETWORK_FILE)
    record = {
        "scenes": {
            "training": finder.batches * finder.batch_size,
            "validation": finder.validation_scenes,
        },
        "batches": finder.batches,
        "metrics": wall_network_training.measure_finder(runs, study),
        "curves": {"training_loss": loss_curve(fitted.training_loss)},
    }

    return _written(out, study, graph, provenance, record)


def _provenance(
    kind: str,
    study: Study,
    seed: int,
    device: str,
    more: Mapping[str, str],
    threads: int = READER_THREADS,
) -> dict[str, str]:
    """Return `metadata_props` of a network: the same for the same study, data and
    versions.
    """
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


def _of_library(stored: BytesIO, study: Study) -> dict[str, str]:
    """Return what identifies the library, as it is stored, that a network learned
    from.
    """
    return {
        "library_sha256": sha256(stored.getvalue()).hexdigest(),
        "class_bounds_mn": _bounds_mn(study),
    }


def _bounds_mn(study: Study) -> str:
    return ", ".join(f"{from_si(bound, 'mn'):g}" for bound in study.classes.bounds_n)


def _other_cores() -> int:
    return max(1, available_cores() - 1)


def _whole_chunks(study: Study) -> int:
    """Return the samples of an epoch of slices: whole chunks of them are drawn."""
    return -(-study.reader.samples_per_epoch // CHUNK) * CHUNK


def _written(
    out: Path,
    study: Study,
    graph: bytes,
    provenance: Mapping[str, str],
    found: Mapping[str, Any],
    words: Mapping[str, Any] = MappingProxyType({}),
    more: Mapping[str, bytes] = MappingProxyType({}),
) -> Record:
    """Write a model folder; its card is the template of its kind, filled from the
    study, the record and `words`.
    """
    kind = provenance["kind"]
    cut = study.slice
    record: Record = {"kind": kind, "provenance": provenance, **found}
    texts = tomllib.loads(
        files("scleraforce.lab.training")
        .joinpath("cards.toml")
        .read_text(encoding="utf-8")
    )
    intervals = (
        texts["intervals"]
        .get(kind, {})
        .get("measured" if "intervals" in record else "unmeasured", "")
    )
    low_mn, high_mn = (from_si(bound, "mn") for bound in study.classes.bounds_n)
    sections = {
        "reader": study.reader,
        RawReader.kind: study.raw_reader,
        WALL_FINDER: study.scenes.window,
    }
    ranges = _ranges(sections[kind]) if kind in sections else _ranges_of_classes(study)
    card = {
        **texts,
        **record,
        **words,
        "study": study,
        "measured": intervals.format(**record),
        "pixels": (
            f"{cut.rows} x {cut.columns} pixels of {from_si(cut.pixel_m, 'mm'):g} mm"
        ),
        "low_mn": low_mn,
        "high_mn": high_mn,
        "table": "\n".join(
            [
                "| | |",
                "|---|---|",
                *(f"| {name} | {value} |" for name, value in ranges.items()),
            ]
        ),
    }
    write_folder(
        out, graph, format_study(study), texts[kind].format_map(card), record, more
    )

    return record


def _ranges_of_classes(study: Study) -> dict[str, str]:
    """Return what a classifier's slices are drawn from: walls of the data set's groups,
    and other values' ranges.
    """
    walls = {
        f"wall of {from_si(group.thickness_m, 'um'):g} µm": (
            f"{group.images} images, 0 to {from_si(group.max_force_n, 'mn'):g} mN"
        )
        for group in study.dataset.group
    }
    ranges = {**_ranges(study.eye), **_ranges(study.needle), **_ranges(study.dataset)}
    ranges.pop("`thickness_um`")  # of the groups' walls

    return {**walls, **ranges}


def _ranges(section: Any) -> dict[str, str]:
    """Return the values of a study's section, in its keys' units, by key; without
    sections within it.
    """
    found = {}
    for item in fields(section):
        value = map_numbers(getattr(section, item.name), field_unit(item).from_si)
        values = (
            value.values
            if isinstance(value, Choice)
            else value
            if isinstance(value, tuple)
            else (value,)
        )

        if isinstance(value, Range):
            found[f"`{field_key(item)}`"] = " to ".join(
                dict.fromkeys(f"{end:.6g}" for end in value.bounds)
            )
        elif all(isinstance(each, int | float) for each in values):
            found[f"`{field_key(item)}`"] = ", ".join(f"{each:.6g}" for each in values)

    return found
