"""Training the reader on the study's library: to the end, or a stated part of it."""

from dataclasses import replace
from time import perf_counter
from typing import Any

from scleraforce.library import Library
from scleraforce.library.library_store import build_library, open_library
from scleraforce.records.study import Study
from speed.parts.axisymmetric import LIBRARY
from speed.record import Row, Table
from speed.run import Run

GOAL_S = 180.0
INTERVALS_GOAL_S = 60.0
# of the part
EPOCHS = 3
EYES = 12
SETTINGS = """`train --kind reader` of the paper's study on its library, which is there
already: epochs of samples that are drawn beside, half of them mirror images, then the
virtual eyes that intervals are measured on. Nothing else trains such a reader."""


def measure(run: Run) -> Table:
    """Train the reader."""
    study = run.study
    library = _library(run)
    parts = replace(
        study.reader, epochs=EPOCHS, interval_eyes=min(EYES, study.reader.interval_eyes)
    )
    full = "training" in run.options
    began_s, epochs_s, eyes_s, end_s, trained = _marks(
        study if full else replace(study, reader=parts), library, run
    )
    sizes = (
        f"{study.reader.epochs} epochs of {study.reader.samples_per_epoch:,} samples, "
        f"{study.reader.interval_eyes} eyes"
    )

    if full:
        seconds = end_s - began_s
        words = f"{sizes}: done to the end"
    else:
        seconds = whole_seconds(study, began_s, epochs_s, eyes_s, end_s)
        words = (
            f"{sizes}: estimated from {len(epochs_s)} epochs and {len(eyes_s)} eyes;"
            " --training does all"
        )

    each = {"an epoch, s": _each(epochs_s), "an eye, s": _each(eyes_s)}
    accuracy = (
        {"right class, %": 100.0 * trained["metrics"]["validation_accuracy"]}
        if full
        else {}
    )
    row = Row(
        what="the reader, default training",
        value=seconds,
        unit="s",
        goal=GOAL_S,
        settings=words,
        more=each | accuracy,
    )
    eyes = study.reader.interval_eyes
    intervals = Row(
        what=f"intervals of {eyes} virtual eyes",
        value=eyes * _each(eyes_s),
        unit="s",
        goal=INTERVALS_GOAL_S,
        settings=f"a part of the training above: of {len(eyes_s)} eyes",
    )

    return Table("Training the reader", SETTINGS, (row, intervals))


def whole_seconds(
    study: Study,
    began_s: float,
    epochs_s: list[float],
    eyes_s: list[float],
    end_s: float,
) -> float:
    """Return what the whole training would take, of the times when epochs and eyes of a
    shorter one were done.

    What is done once, before, between and after them, counts once.

    >>> small = Study()
    >>> small = replace(small, reader=replace(small.reader, epochs=10, interval_eyes=4))
    >>> whole_seconds(small, 0.0, [3.0, 5.0, 7.0], [10.0, 11.0], 12.0)
    28.0
    """
    epoch_s = _each(epochs_s)
    eye_s = _each(eyes_s)
    once_s = end_s - began_s - len(epochs_s) * epoch_s - len(eyes_s) * eye_s
    return once_s + study.reader.epochs * epoch_s + study.reader.interval_eyes * eye_s


def _each(marks_s: list[float]) -> float:
    """Return the time of one, the first left out: processes start before it."""
    return (marks_s[-1] - marks_s[0]) / (len(marks_s) - 1)


def _marks(
    study: Study, library: Library, run: Run
) -> tuple[float, list[float], list[float], float, Any]:
    """Train; return when it began, when each epoch and each eye was done, when it
    ended, and what it reached.
    """
    from scleraforce.lab.training.trained_models import train_reader

    epochs_s: list[float] = []
    eyes_s: list[float] = []
    began_s = perf_counter()
    trained = train_reader(
        library,
        study,
        run.folder / "reader",
        progress=lambda _: epochs_s.append(perf_counter()),
        measured=lambda _: eyes_s.append(perf_counter()),
    )

    return began_s, epochs_s, eyes_s, perf_counter(), trained


def _library(run: Run) -> Library:
    """Return the library of this run; make it where its part was not run."""
    path = run.folder / LIBRARY
    if not path.exists():
        build_library(run.study, path)
    return open_library(path)
