"""What a model says about recordings, beside what their force logs say (paper sec. 3.4, Table 3, Fig. 10)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.reader.metrics import Proportion, accuracy, confusion_matrix, precision, recall
from scleraforce.units import n_to_mn

__all__ = ["Evaluation", "FrameAnswer"]


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
