"""Each eye read with a modulus that it had no part in: the mean of the other eyes' means.

The paper reads its eyes with the mean modulus of the very eyes that it tests. Linear mechanics allows a fair figure for
little: the slice of a force F on a wall of modulus E is that of F E'/E on a wall of E' (under pressure and weight that
scale alike, which bend the wall far less than the needle). So the slices that are there are labelled anew for E', and
a network is trained on them.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scleraforce.calibration.result import Calibration
from scleraforce.dataset import Dataset
from scleraforce.learning.classifier.network import TrainedNetwork
from scleraforce.learning.classifier.train import split_samples
from scleraforce.learning.classifier.training import fit
from scleraforce.reader.evaluate import Evaluation
from scleraforce.reader.metrics import Proportion
from scleraforce.report.answered_frame import look_at
from scleraforce.whole_files import KINDS, read_text, write_whole

EPOCHS = 4  # at most: these networks answer a few frames each


@dataclass(frozen=True)
class LeftOut:
    """An eye, the mean modulus of the others, and how many of its trials were read right with it."""

    eye: str
    youngs_modulus_pa: float
    accuracy: Proportion


def read_left_out(
    dataset: Dataset, calibration: Calibration, evaluation: Evaluation, progress: Callable[[int], None]
) -> tuple[LeftOut, ...]:
    """Read the trials of each calibrated eye with a network for the mean modulus of the others.

    Args:
        dataset: the slices, simulated at `dataset.youngs_modulus_pa`.
        calibration: the eyes.
        evaluation: the trials, answered with the mean of all; an unusable frame keeps its answer.
        progress: called with 1 after each epoch of each network.
    """
    network = replace(dataset.study.network, epochs=min(EPOCHS, dataset.study.network.epochs))
    results = []
    for eye in calibration.eyes:
        modulus_pa = calibration.left_out(eye)
        training, validation = split_samples(dataset, modulus_pa)
        fitted = fit(network, training, validation, len(evaluation.bounds_n) + 1, progress)
        results.append(LeftOut(eye, modulus_pa, _score(fitted.network, evaluation, eye, dataset)))
    return tuple(results)


def write_left_out(results: Sequence[LeftOut], path: Path) -> None:
    """Write the results as JSON."""
    rows = [
        {
            "eye": one.eye,
            "youngs_modulus_pa": one.youngs_modulus_pa,
            "right": one.accuracy.hits,
            "of": one.accuracy.total,
        }
        for one in results
    ]
    write_whole(json.dumps(rows, indent=2) + "\n", path)


def read_left_out_file(path: Path) -> tuple[LeftOut, ...]:
    """Read what `write_left_out` wrote."""
    rows = json.loads(read_text(path, KINDS["result"]))
    return tuple(LeftOut(row["eye"], row["youngs_modulus_pa"], Proportion(row["right"], row["of"])) for row in rows)


def _score(network: TrainedNetwork, evaluation: Evaluation, eye: str, dataset: Dataset) -> Proportion:
    """Count the right answers of a network to an eye's trials."""
    trials = [frame for frame in evaluation.scored if frame.eye == eye]
    readable = [frame for frame in trials if frame.usable]
    right = sum(frame.predicted == frame.target for frame in trials if not frame.usable)
    if readable:
        slices = np.stack([look_at(frame).slice(dataset.study.slice) for frame in readable])
        answers = network.probabilities(slices).argmax(axis=1)
        right += sum(int(answer) == frame.target for answer, frame in zip(answers, readable, strict=True))
    return Proportion(right, len(trials))
