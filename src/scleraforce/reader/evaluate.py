"""An evaluation: a model's answers beside the measured forces, and the metrics (paper sec. 3.4, Table 3, Fig. 10)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan
from os import PathLike
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.forces import label_sds
from scleraforce.errors import CalibrationError, RecordingError
from scleraforce.known import Known, known_of_recording
from scleraforce.known.calibration_file import CalibrationSummary, foreign_modulus, known_of_eye
from scleraforce.models import model_name
from scleraforce.reader.answer import Answer
from scleraforce.reader.intervals import Score, score, traits_of
from scleraforce.reader.kinds import Reader
from scleraforce.reader.metrics import (
    ForceTrial,
    Proportion,
    accuracy,
    confusion_matrix,
    coverage,
    coverage_by_eye,
    mean_absolute_error,
    precision,
    recall,
)
from scleraforce.recording.folder import Recording, RecordingInfo, frame_digest, read_recording, true_forces
from scleraforce.recording.labels import Trial, label_frames, label_notes, log_doubts
from scleraforce.recording.pixels import PixelScale
from scleraforce.units import from_si


@dataclass(frozen=True, kw_only=True)
class FrameAnswer:
    """One frame: the measured force, and the answer of the model.

    `recording` is the path as given, `file` the frame's name. `measured_force_n` and `target` are None without a force
    log; `measured_force_sd_n` is the standard deviation of its error (`calibration.forces`). `true_force_n` is that of
    a virtual eye's `truth.json`, for comparison only. `excluded` says why a trial is left out of the metrics although
    it has a label (pierced, or above the study's largest force); `calibration` marks a frame that Young's modulus was
    fitted on, which is left out as well. The frame was read with `youngs_modulus_pa`, from `modulus_source`.
    """

    recording: str
    eye: str
    file: str
    answer: Answer
    measured_force_n: float | None = None
    target: int | None = None
    calibration: bool = False
    excluded: str | None = None
    youngs_modulus_pa: float | None = None
    modulus_source: str | None = None
    measured_force_sd_n: float | None = None
    true_force_n: float | None = None

    @property
    def scored(self) -> bool:
        """True if the frame counts in the metrics."""
        return self.target is not None and self.excluded is None and not self.calibration

    @property
    def misread(self) -> bool:
        """True if the frame has a label and the answer is another class."""
        return self.target is not None and self.answer.predicted != self.target

    def as_json(self) -> dict[str, Any]:
        """Return the frame as it stands in `evaluate --json`."""
        return {
            "recording": self.recording,
            "eye": self.eye,
            "file": self.file,
            "measured_force_mn": from_si(self.measured_force_n, "mn"),
            "measured_force_sd_mn": from_si(self.measured_force_sd_n, "mn"),
            "true_force_mn": from_si(self.true_force_n, "mn"),
            "target": self.target,
            **self.answer.as_json(),
            "calibration": self.calibration,
            "excluded": self.excluded,
            "youngs_modulus_mpa": from_si(self.youngs_modulus_pa, "mpa"),
            "modulus_source": self.modulus_source,
        }


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The answers of a model to the frames of one or more recordings, and the metrics over those that count.

    `bounds_n` are the class bounds of the model's study, `max_force_n` its largest force; `notes` are sentences that
    limit the result (a gap outside the training, frames without labels). `kind` is the model's.
    """

    model: str
    bounds_n: tuple[float, ...]
    max_force_n: float
    youngs_modulus_pa: float
    frames: tuple[FrameAnswer, ...]
    notes: tuple[str, ...] = ()
    kind: str = "classifier"

    @property
    def reads_force(self) -> bool:
        """True if the model reads forces, not classes alone."""
        return self.kind != "classifier"

    @cached_property
    def scored(self) -> tuple[FrameAnswer, ...]:
        """The frames that count."""
        return tuple(frame for frame in self.frames if frame.scored)

    @cached_property
    def usable(self) -> "Evaluation":
        """The same evaluation, of the usable frames alone."""
        return replace(self, frames=tuple(frame for frame in self.frames if frame.answer.usable))

    @cached_property
    def confusion(self) -> NDArray[np.int64]:
        """Trials by target (row) and predicted (column) class, shape (classes, classes)."""
        targets = [frame.target for frame in self.scored if frame.target is not None]
        return confusion_matrix(targets, [frame.answer.predicted for frame in self.scored], len(self.bounds_n) + 1)

    @cached_property
    def forces(self) -> tuple[ForceTrial, ...]:
        """Measured and read force of each usable frame that counts; empty with a classifier."""
        return tuple(self._trials(lambda frame: (frame.measured_force_n, frame.measured_force_sd_n or 0.0)))

    @cached_property
    def true_forces(self) -> tuple[ForceTrial, ...]:
        """True and read force of each usable frame that counts and whose true force is known."""
        return tuple(self._trials(lambda frame: (frame.true_force_n, 0.0)))

    def _trials(self, measured: Callable[[FrameAnswer], tuple[float | None, float]]) -> Iterator[ForceTrial]:
        """Yield the frames that count and have both a read force and one to compare it with, N, and its SD, N."""
        for frame in self.scored:
            force_n, sd_n = measured(frame)
            read = frame.answer
            if force_n is not None and read.force_n is not None and read.interval_n is not None:
                yield ForceTrial(
                    eye=frame.eye,
                    measured_n=force_n,
                    read_n=read.force_n,
                    interval_n=read.interval_n,
                    measured_sd_n=sd_n,
                )

    @property
    def mae_n(self) -> float:
        """Mean absolute error of the force over `forces`, N; NaN if there are none."""
        return mean_absolute_error(self.forces)

    @property
    def coverage(self) -> Proportion:
        """Share of `forces` whose 90 % interval and label agree, the label's own error included."""
        return coverage(self.forces)

    @property
    def true_coverage(self) -> Proportion:
        """Share of `true_forces` in their 90 % intervals."""
        return coverage(self.true_forces)

    @property
    def label_sd_n(self) -> float:
        """Median standard deviation of the labels of `forces`, N; NaN if there are none."""
        return median([trial.measured_sd_n for trial in self.forces]) if self.forces else nan

    @property
    def accuracy(self) -> Proportion:
        """Share of right answers."""
        return accuracy(self.confusion)

    @property
    def recall(self) -> tuple[Proportion, ...]:
        """Share of each target class that was recognised (rows; the paper's Table 3 calls it precision)."""
        return recall(self.confusion)

    @property
    def precision(self) -> tuple[Proportion, ...]:
        """Share of each predicted class that was right (columns; the paper's Table 3 calls it recall)."""
        return precision(self.confusion)

    def as_json(self) -> dict[str, Any]:
        """Return the result of `evaluate --json`; undefined figures are NaN (printed as null)."""
        return {
            "model": self.model,
            "kind": self.kind,
            **self._metrics(),
            "mae_mn": from_si(self.mae_n, "mn"),
            "coverage": self.coverage.value,
            "coverage_interval": self.coverage.interval,
            "coverage_by_eye": {eye: one.value for eye, one in coverage_by_eye(self.forces).items()},
            "label_sd_mn": from_si(self.label_sd_n, "mn"),
            "truth": "truth.json" if self.true_forces else None,
            "true_mae_mn": from_si(mean_absolute_error(self.true_forces), "mn"),
            "true_coverage": self.true_coverage.value,
            "true_coverage_interval": self.true_coverage.interval,
            "true_coverage_by_eye": {eye: one.value for eye, one in coverage_by_eye(self.true_forces).items()},
            "usable": self.usable._metrics(),
            "notes": self.notes,
            "frames": [frame.as_json() for frame in self.frames],
        }

    def _metrics(self) -> dict[str, Any]:
        return {
            "scored": len(self.scored),
            "accuracy": self.accuracy.value,
            "confusion": self.confusion.tolist(),
            "recall": [share.value for share in self.recall],
            "precision": [share.value for share in self.precision],
            "intervals": {
                "accuracy": self.accuracy.interval,
                "recall": [share.interval for share in self.recall],
                "precision": [share.interval for share in self.precision],
            },
        }


FOREIGN = ("the modulus is the population's, not this eye's own",)


def evaluate_recordings(
    reader: Reader,
    recordings: Sequence[Recording | str | PathLike[str]],
    calibration: CalibrationSummary | None = None,
    progress: Callable[[int], object] | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs, and a virtual eye's with its `truth.json`.

    Args:
        reader: the model.
        recordings: recordings, or their folders; each once.
        calibration: of the eyes; frames that it used are marked and not scored. A reader reads an eye of the
            calibration with its own modulus, others with the population's.
        progress: called with 1 after each frame.

    Raises:
        RecordingError: a recording cannot be used, or is given twice.
        FrameError: a frame cannot be read.
        CalibrationError: the calibration cannot be used with this model.
    """
    paths = [entry.path if isinstance(entry, Recording) else Path(entry) for entry in recordings]
    for number, path in enumerate(paths):
        if path.resolve() in {before.resolve() for before in paths[:number]}:
            raise RecordingError(f"{path}: given twice; give each recording once")
    if calibration is not None and reader.fixed_modulus_pa is None and calibration.mechanics == "linear":
        raise CalibrationError(
            f"{calibration.path}: mechanics: linear; {reader.path} reads with finite strain: calibrate with "
            "--mechanics finite-strain"
        )
    opened = [entry if isinstance(entry, Recording) else read_recording(entry) for entry in recordings]
    frames: list[FrameAnswer] = []
    notes = list(_notes(reader, opened, calibration))
    study = reader.study
    for recording in opened:
        trials = label_frames(recording, study.classes, study.needle.max_force_n)
        answers = tuple(_answers(reader, recording, trials, calibration, progress))
        doubts = (*label_notes(recording, trials), *_doubts(reader, recording, answers))
        notes += (f"{recording.path}: {doubt}" for doubt in doubts)
        frames += answers
    return Evaluation(
        model=model_name(reader.path),
        bounds_n=study.classes.bounds_n,
        max_force_n=study.needle.max_force_n,
        youngs_modulus_pa=study.eye.youngs_modulus_pa,
        frames=tuple(frames),
        notes=tuple(notes),
        kind=reader.kind,
    )


def _doubts(reader: Reader, recording: Recording, answers: Sequence[FrameAnswer]) -> tuple[str, ...]:
    """Return sentences on a force log that contradicts the answers."""
    classes = reader.study.classes
    if reader.reads_force:
        return log_doubts(recording, classes, [frame.answer.force_n for frame in answers], in_newtons=True)
    read = [frame.answer.predicted if frame.answer.usable else None for frame in answers]
    return log_doubts(recording, classes, read)


def _notes(reader: Reader, recordings: Sequence[Recording], summary: CalibrationSummary | None) -> Iterator[str]:
    if summary is not None and reader.fixed_modulus_pa is not None:
        yield (
            f"{reader.path}: a classifier reads every eye with the modulus it was trained for, "
            f"{from_si(reader.fixed_modulus_pa, 'mpa'):.3g} MPa; {summary.path} only marks frames"
        )
    for recording in recordings:
        info = recording.info
        for sentence in reader.limits(_known(info, summary), info.oct, info.needle.gauge):
            yield f"{recording.path}: {sentence}"
        if recording.forces is None:
            yield f"{recording.path}: no forces.csv: its frames are read, but not scored"
        foreign = _foreign(reader, recording, summary)
        if foreign:
            yield f"{recording.path}: {foreign}"


def _foreign(reader: Reader, recording: Recording, summary: CalibrationSummary | None) -> str | None:
    """Return a sentence if an eye is read with the modulus of others although a calibration is given."""
    if summary is None or reader.fixed_modulus_pa is not None:
        return None
    return foreign_modulus(summary, recording.info.eye.id)


def _answers(
    reader: Reader,
    recording: Recording,
    trials: Sequence[Trial],
    summary: CalibrationSummary | None,
    progress: Callable[[int], object] | None,
) -> Iterator[FrameAnswer]:
    """Answer each frame of a recording, in its order."""
    eye = recording.info.eye.id
    scale = PixelScale.of(recording.info.oct)
    known = _known(recording.info, summary)
    modulus = (known.modulus.mean_pa, known.modulus.source) if known.modulus else (None, None)
    modulus_pa, source = modulus if reader.fixed_modulus_pa is None else (reader.fixed_modulus_pa, "trained")
    digests = frozenset[str]() if summary is None else summary.digests
    doubts = FOREIGN if _foreign(reader, recording, summary) else ()
    sds_n = label_sds(recording, trials)
    true_n = true_forces(recording.path) if (recording.path / "truth.json").exists() else {}
    for entry, trial, sd_n in zip(recording.frames, trials, sds_n, strict=True):
        pixels = recording.frame(entry)
        answer = reader.read(pixels, scale, known)
        yield FrameAnswer(
            recording=str(recording.path),
            eye=eye,
            file=entry.file,
            measured_force_n=trial.measured_force_n,
            measured_force_sd_n=sd_n,
            true_force_n=true_n.get(entry.file),
            target=trial.target,
            calibration=frame_digest(pixels) in digests,
            excluded=trial.excluded,
            youngs_modulus_pa=modulus_pa,
            modulus_source=source,
            answer=replace(answer, warnings=(*answer.warnings, *doubts)),
        )
        if progress:
            progress(1)


def _known(info: RecordingInfo, summary: CalibrationSummary | None) -> Known:
    known = known_of_recording(info)
    return known if summary is None else known_of_eye(known, summary, info.eye.id)


def recording_scores(
    reader: Reader,
    recording: Recording,
    summary: CalibrationSummary,
    progress: Callable[[int], object] | None = None,
) -> Iterator[Score]:
    """Score both methods' readings of the frames of a recording that its eye was not calibrated on.

    Scores refer to the reader's present intervals. `progress` is called with 1 after each frame.

    Raises:
        FrameError: a frame cannot be read.
    """
    study, eye = reader.study, recording.info.eye.id
    known = _known(recording.info, summary)
    scale = PixelScale.of(recording.info.oct)
    trials = label_frames(recording, study.classes, study.needle.max_force_n)
    for entry, trial in zip(recording.frames, trials, strict=True):
        pixels = recording.frame(entry)
        force_n = trial.measured_force_n if trial.excluded is None else None
        if force_n is not None and frame_digest(pixels) not in summary.digests:
            answer = reader.read(pixels, scale, known)
            for method, reading in answer.readings if answer.usable else ():
                traits = traits_of(known, reading.force_n, answer.fit if method == "fit" else None)
                yield Score(method, traits, eye, score(reading, force_n))
        if progress:
            progress(1)
