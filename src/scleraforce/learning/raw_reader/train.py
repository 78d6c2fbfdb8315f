"""From a library to a model folder of kind "raw-reader": train, measure on frames that were never seen, write."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scleraforce.learning.raw_reader.card import raw_reader_card
from scleraforce.learning.raw_reader.graph import raw_reader_onnx_bytes
from scleraforce.learning.raw_reader.intervals import measured_raw_intervals
from scleraforce.learning.raw_reader.measure import measure_raw_reader
from scleraforce.learning.raw_reader.samples import RawSource
from scleraforce.learning.raw_reader.training import FittedRawReader, fit_raw_reader
from scleraforce.learning.reader.draws import CHUNK
from scleraforce.learning.reader.train import check_library, metrics_record, provenance_of, stored_library
from scleraforce.learning.reader.training import ReaderMetrics
from scleraforce.library import Library
from scleraforce.models.folder import check_place, write_folder
from scleraforce.processes import available_cores
from scleraforce.reader.kinds import RawReader
from scleraforce.study import Study, format_study


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
    content, _ = stored_library(library)
    provenance = provenance_of(RawReader.kind, study, study.raw_reader.seed, content)
    graph = raw_reader_onnx_bytes(fitted.network, provenance)
    record = _record(study, fitted, metrics, provenance)
    if study.raw_reader.interval_eyes:
        record["intervals"] = measured_raw_intervals(study, library, graph, workers or available_cores(), measured)
    write_folder(out, graph, format_study(study), raw_reader_card(study, record), record)
    return TrainedRawReader(metrics, study.raw_reader.batches, record["samples"]["training"])


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
        "metrics": metrics_record(metrics),
        "curves": {"training_loss": fitted.training_loss},
    }
