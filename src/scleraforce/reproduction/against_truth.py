"""Forces that were read of virtual eyes beside the true ones, which a force log only approaches."""

from collections.abc import Sequence
from pathlib import Path

from scleraforce.laboratory.phantom import true_forces
from scleraforce.reader.evaluation import Evaluation
from scleraforce.reader.metrics import ForceTrial, coverage_band, coverage_by_eye


def against_truth(evaluation: Evaluation) -> tuple[ForceTrial, ...]:
    """Return the frames of `evaluation.forces` with the true force in the place of the logged one.

    Raises:
        RecordingError: a recording is not of a virtual eye, or its `truth.json` cannot be read.
    """
    true = {path: true_forces(Path(path)) for path in {frame.recording for frame in evaluation.scored}}
    return tuple(
        ForceTrial(
            eye=frame.eye,
            measured_n=true[frame.recording][frame.file],
            read_n=frame.predicted_force_n,
            interval_n=frame.interval_n,
        )
        for frame in evaluation.scored
        if frame.predicted_force_n is not None and frame.interval_n is not None
    )


def band_of(trials: Sequence[ForceTrial]) -> tuple[float, float] | None:
    """Return between which coverages other such eyes lie (`metrics.coverage_band`); None: no trials."""
    return coverage_band([trial.eye for trial in trials], [trial.covered for trial in trials])


def held_by_eye(trials: Sequence[ForceTrial]) -> str:
    """Say how many forces the intervals of each eye hold."""
    return ", ".join(f"{held.hits} of {held.total} of {eye}" for eye, held in coverage_by_eye(trials).items())
