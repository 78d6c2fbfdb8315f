"""Tables of an evaluation: the confusion matrix with recall and precision, and every frame's answer."""

from collections.abc import Sequence
from math import isnan

import numpy as np
from numpy.typing import NDArray

from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.metrics import Proportion, precision, recall
from scleraforce.report.html import Html, table
from scleraforce.units import from_si

NOTHING = "\N{EN DASH}"  # in a cell that has no value
NO_BREAK = "\N{NO-BREAK SPACE}"


def share(proportion: Proportion) -> str:
    """Return a proportion with its 95 % Wilson interval as text.

    >>> share(Proportion(42, 45))
    '0.93 (0.82 to 0.98)'
    """
    if isnan(proportion.value):
        return NOTHING
    low, high = proportion.interval
    return f"{proportion.value:.2f} ({low:.2f} to {high:.2f})"


def class_names(bounds_n: Sequence[float]) -> tuple[str, str, str]:
    """Return the classes with their bounds.

    >>> class_names((0.005, 0.03))
    ('class 0: below 5 mN', 'class 1: 5 to 30 mN', 'class 2: above 30 mN')
    """
    low, high = (f"{from_si(bound, 'mn'):g}" for bound in bounds_n)
    return f"class 0: below {low} mN", f"class 1: {low} to {high} mN", f"class 2: above {high} mN"


def confusion_table(confusion: NDArray[np.int64], bounds_n: Sequence[float], caption: str) -> Html:
    """Return a confusion matrix, rows targets, with recall and precision; misread trials stand out."""
    names = class_names(bounds_n)
    rows = [
        [f"target {name}", *counts.tolist(), share(found)]
        for name, counts, found in zip(names, confusion, recall(confusion), strict=True)
    ]
    rows.append(["precision", *(share(right) for right in precision(confusion)), ""])
    wrong = [(r, c + 1) for r, c in np.argwhere(confusion > 0).tolist() if r != c]
    head = ["", *(f"predicted {number}" for number in range(len(names))), "recall"]
    return table(head, rows, caption, wrong)


def frame_table(evaluation: Evaluation, frames: Sequence[FrameAnswer], caption: str) -> Html:
    """Return one row a frame: what was measured, what was read, and the remarks.

    Where the frames are of several eyes, each is named with its eye.
    """
    several = len({frame.eye for frame in frames}) > 1
    with_force = evaluation.reads_force
    rows = [
        [
            f"{frame.eye}/{frame.file}" if several else frame.file,
            _measured(frame),
            NOTHING if frame.target is None else frame.target,
            frame.predicted,
            *(_read_force(frame) if with_force else []),
            *_probabilities(frame, len(evaluation.bounds_n) + 1),
            _remark(frame),
        ]
        for frame in frames
    ]
    wrong = [(r, 3) for r, f in enumerate(frames) if f.target is not None and f.predicted != f.target]
    classes = [f"p({number})" for number in range(len(evaluation.bounds_n) + 1)]
    read = ["read [mN]", "90 % [mN]"] if with_force else []
    head = ["frame", "force [mN]", "target", "predicted", *read, *classes, "remark"]
    return table(head, rows, caption, wrong, remarks=True)


def _measured(frame: FrameAnswer) -> str:
    if frame.measured_force_n is None:
        return NOTHING
    force = f"{from_si(frame.measured_force_n, 'mn'):.1f}"
    if frame.measured_force_sd_n is None:
        return force
    return f"{force}{NO_BREAK}±{NO_BREAK}{from_si(frame.measured_force_sd_n, 'mn'):.1f}"


def _read_force(frame: FrameAnswer) -> list[str]:
    if frame.predicted_force_n is None or frame.interval_n is None:
        return [NOTHING, NOTHING]
    low_mn, high_mn = (from_si(end, "mn") for end in frame.interval_n)
    return [f"{from_si(frame.predicted_force_n, 'mn'):.1f}", f"{low_mn:.1f}{NO_BREAK}to{NO_BREAK}{high_mn:.1f}"]


def _probabilities(frame: FrameAnswer, classes: int) -> list[str]:
    if frame.probabilities is None:
        return [NOTHING] * classes
    return [f"{probability:.3f}" for probability in frame.probabilities]


def _remark(frame: FrameAnswer) -> str:
    remarks = [] if frame.usable else [f"not usable ({frame.reason})" if frame.reason else "not usable"]
    if frame.calibration:
        remarks.append("Young's modulus was fitted on it: not counted")
    if frame.excluded:
        remarks.append(f"not counted: {frame.excluded}")
    remarks += frame.warnings
    return "; ".join(remarks)
