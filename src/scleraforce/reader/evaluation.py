"""An evaluation: a model's answers beside the measured forces, and the metrics (paper sec. 3.4, Table 3, Fig. 10)."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.reader.metrics import (
    ForceTrial,
    Proportion,
    accuracy,
    confusion_matrix,
    coverage,
    mean_absolute_error,
    precision,
    recall,
)
from scleraforce.segmentation.needle import SeenNeedle, needle_entry
from scleraforce.units import from_si


@dataclass(frozen=True, kw_only=True)
class FrameAnswer:
    """One frame: what was measured, what the model said.

    `recording` is the path as given, `file` the frame's name. `measured_force_n` and `target` are None where there is
    no force log. A frame that is not `usable` is never shown to the network: its `predicted` class is 2 (withdraw),
    its `probabilities` None, and `reason` says why. `excluded` says why a trial is left out of the metrics although
    it has a label (pierced, or over the study's largest force); `calibration` marks a frame that Young's modulus was
    fitted on, which is left out as well. `iop_at_dent_pa` is the pressure in the eye under the needle;
    `needle` the one seen in the picture, `conjunctiva_m` the median thickness of a layer over the wall.
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
    predicted_force_n: float | None = None
    interval_n: tuple[float, float] | None = None
    contact_m: float | None = None
    iop_at_dent_pa: float | None = None
    needle: SeenNeedle | None = None
    conjunctiva_m: float | None = None
    warnings: tuple[str, ...] = ()
    can_calibrate: bool = False
    youngs_modulus_pa: float | None = None
    modulus_source: str | None = None

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
            "measured_force_mn": from_si(self.measured_force_n, "mn"),
            "target": self.target,
            "predicted": self.predicted,
            "probabilities": self.probabilities,
            "predicted_force_mn": from_si(self.predicted_force_n, "mn"),
            "interval_mn": None if self.interval_n is None else [from_si(end, "mn") for end in self.interval_n],
            "contact_mm": from_si(self.contact_m, "mm"),
            "pressure_pa": self.iop_at_dent_pa,
            "pressure_mmhg": from_si(self.iop_at_dent_pa, "mmhg"),
            "needle": needle_entry(self.needle),
            "conjunctiva_um": from_si(self.conjunctiva_m, "um"),
            "usable": self.usable,
            "reason": self.reason,
            "warnings": self.warnings,
            "can_calibrate": self.can_calibrate,
            "calibration": self.calibration,
            "excluded": self.excluded,
            "youngs_modulus_mpa": from_si(self.youngs_modulus_pa, "mpa"),
            "modulus_source": self.modulus_source,
        }


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The answers of a model to the frames of one or more recordings, and the metrics over those that count.

    `bounds_n` are the class bounds of the model's study, `max_force_n` its largest force; `notes` are sentences on
    what limits the result (a gap that the model was not trained on, frames without labels). `kind` is the model's.
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
        """Whether the model reads forces, not classes alone."""
        return self.kind != "classifier"

    @cached_property
    def scored(self) -> tuple[FrameAnswer, ...]:
        """The frames that count."""
        return tuple(frame for frame in self.frames if frame.scored)

    @cached_property
    def usable(self) -> "Evaluation":
        """The same evaluation, of the usable frames alone."""
        return replace(self, frames=tuple(frame for frame in self.frames if frame.usable))

    @cached_property
    def confusion(self) -> NDArray[np.int64]:
        """Trials by target (row) and predicted (column) class, shape (classes, classes)."""
        targets = [frame.target for frame in self.scored if frame.target is not None]
        return confusion_matrix(targets, [frame.predicted for frame in self.scored], len(self.bounds_n) + 1)

    @cached_property
    def forces(self) -> tuple[ForceTrial, ...]:
        """Measured and read force of each usable frame that counts; none with a classifier."""
        return tuple(
            ForceTrial(
                eye=frame.eye,
                measured_n=frame.measured_force_n,
                read_n=frame.predicted_force_n,
                interval_n=frame.interval_n,
            )
            for frame in self.scored
            if frame.measured_force_n is not None and frame.predicted_force_n is not None and frame.interval_n
        )

    @property
    def mae_n(self) -> float:
        """Mean absolute error of the force over `forces`, N; NaN where there is none."""
        return mean_absolute_error(self.forces)

    @property
    def coverage(self) -> Proportion:
        """Share of `forces` whose measured force lies in the 90 % interval."""
        return coverage(self.forces)

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
            "kind": self.kind,
            **self._metrics(),
            "mae_mn": from_si(self.mae_n, "mn"),
            "coverage": self.coverage.value,
            "coverage_interval": self.coverage.interval,
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
