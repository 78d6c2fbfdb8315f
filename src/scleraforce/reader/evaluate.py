"""What a model says about recordings, beside what their force logs say (paper sec. 3.4, Table 3, Fig. 10)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.summary import read_calibration
from scleraforce.errors import RecordingError
from scleraforce.imaging.segmentation import PixelScale, Segmenter
from scleraforce.reader.answers import answer_frame
from scleraforce.reader.limits import limits
from scleraforce.reader.metrics import Proportion, accuracy, confusion_matrix, precision, recall
from scleraforce.reader.model import ForceReader
from scleraforce.recording.files import Recording, read_recording
from scleraforce.recording.labels import label_frames
from scleraforce.units import n_to_mn

__all__ = ["Evaluation", "FrameAnswer", "evaluate_recordings"]


@dataclass(frozen=True)
class FrameAnswer:
    """One frame: what was measured, what the model said.

    `recording` is the path as given, `file` the frame's name. `measured_force_n` and `target` are None where there is
    no force log. A frame that is not `usable` is never shown to the network: its `predicted` class is 2 (withdraw),
    its `probabilities` None, and `reason` says why. `excluded` says why a trial is left out of the metrics although
    it has a label (pierced, or over the study's largest force); `calibration` marks a frame that Young's modulus was
    fitted on, which is left out as well.
    """

    recording: str
    eye: str
    file: str
    measured_force_n: float | None
    target: int | None
    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None = None
    calibration: bool = False
    excluded: str | None = None

    @property
    def scored(self) -> bool:
        """Whether the frame counts in the metrics."""
        return self.target is not None and self.excluded is None and not self.calibration

    def as_json(self) -> dict[str, Any]:
        """Return the frame as it stands in `evaluate --json`."""
        return {
            "recording": self.recording,
            "eye": self.eye,
            "file": self.file,
            "measured_force_mn": None if self.measured_force_n is None else n_to_mn(self.measured_force_n),
            "target": self.target,
            "predicted": self.predicted,
            "probabilities": self.probabilities,
            "usable": self.usable,
            "reason": self.reason,
            "calibration": self.calibration,
            "excluded": self.excluded,
        }


@dataclass(frozen=True)
class Evaluation:
    """The answers of a model to the frames of one or more recordings, and the metrics over those that count.

    `bounds_n` are the class bounds of the model's study, `max_force_n` its largest force; `notes` are sentences on
    what limits the result (a gap that the model was not trained on, frames without labels).
    """

    model: str
    bounds_n: tuple[float, ...]
    max_force_n: float
    youngs_modulus_pa: float
    frames: tuple[FrameAnswer, ...]
    notes: tuple[str, ...] = ()

    @cached_property
    def scored(self) -> tuple[FrameAnswer, ...]:
        """The frames that count."""
        return tuple(frame for frame in self.frames if frame.scored)

    @cached_property
    def confusion(self) -> NDArray[np.int64]:
        """Trials by target (row) and predicted (column) class, shape (classes, classes)."""
        targets = [frame.target for frame in self.scored if frame.target is not None]
        return confusion_matrix(targets, [frame.predicted for frame in self.scored], len(self.bounds_n) + 1)

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
        """Return the result of `evaluate --json`; figures that are undefined are NaN (printed as null)."""
        return {
            "model": self.model,
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
            "notes": self.notes,
            "frames": [frame.as_json() for frame in self.frames],
        }


def evaluate_recordings(
    reader: ForceReader,
    paths: Sequence[Path],
    calibration: Path | None = None,
    progress: Callable[[int], object] | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs.

    Args:
        reader: the model.
        paths: recording folders; each once.
        calibration: the file of `scleraforce calibrate`; the frames that it used are marked and not scored.
        progress: called with 1 after each frame.

    Raises:
        RecordingError: a recording cannot be used, or is given twice.
        FrameError: a frame cannot be read.
        CalibrationError: the calibration file cannot be used.
    """
    _refuse_twice(paths)
    used = frozenset[tuple[str, str]]() if calibration is None else read_calibration(calibration).frames
    recordings = [read_recording(path) for path in paths]
    frames: list[FrameAnswer] = []
    for path, recording in zip(paths, recordings, strict=True):
        frames += _answers(reader, str(path), recording, used, progress)
    study = reader.study
    return Evaluation(
        model=str(reader.path),
        bounds_n=study.classes.bounds_n,
        max_force_n=study.needle.max_force_n,
        youngs_modulus_pa=study.eye.youngs_modulus_pa,
        frames=tuple(frames),
        notes=tuple(note for pair in zip(paths, recordings, strict=True) for note in limits(study, *pair)),
    )


def _refuse_twice(paths: Sequence[Path]) -> None:
    """A recording that counted twice would narrow the intervals without cause."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise RecordingError(f"{path}: given twice; give each recording once")
        seen.add(path.resolve())


def _answers(
    reader: ForceReader,
    given: str,
    recording: Recording,
    used: frozenset[tuple[str, str]],
    progress: Callable[[int], object] | None,
) -> Iterator[FrameAnswer]:
    """Answer each frame of a recording, in its order."""
    study, oct_info, eye = reader.study, recording.info.oct, recording.info.eye.id
    scale = PixelScale(oct_info.width_m / oct_info.columns, oct_info.depth_m / oct_info.rows)
    segmenter = Segmenter(oct_info.refractive_index)
    trials = label_frames(recording, study.classes, study.needle.max_force_n)
    for entry, trial in zip(recording.frames, trials, strict=True):
        answer = answer_frame(reader, segmenter, recording.frame(entry), scale, oct_info.refractive_index)
        yield FrameAnswer(
            recording=given,
            eye=eye,
            file=entry.file,
            measured_force_n=trial.measured_force_n,
            target=trial.target,
            predicted=answer.predicted,
            probabilities=answer.probabilities,
            usable=answer.usable,
            reason=answer.reason,
            calibration=(eye, entry.file) in used,
            excluded=trial.excluded,
        )
        if progress:
            progress(1)
