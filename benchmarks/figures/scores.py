"""Scores of answers: the frames of `evaluate` against the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from scleraforce.base.units import from_si
from scleraforce.calibration.answer_metrics import Proportion, coverage_band
from scleraforce.calibration.evaluation import FrameAnswer
from scleraforce.records.study import ClassesStudy

DANGEROUS = 2  # the class of forces that hurt
# a force above the one must not be read, with confidence, as one below the other
HIGH_MN = 35.0
BOUND_MN = 30.0
LEVEL = 0.9
SMALLEST_MN = 1e-3


@dataclass(frozen=True)
class AnsweredFrame:
    """One frame of a virtual eye: its truth and an answer.

    `true_target` and `true_mn` are the simulated values. `in_window`: the wall's
    surface stays within the frame. Forces are in mN; `read_mn` and `interval_mn` may be
    None.
    """

    eye: str
    file: str
    true_target: int
    true_mn: float
    in_window: bool
    predicted: int
    usable: bool
    read_mn: float | None = None
    interval_mn: tuple[float, float] | None = None

    @property
    def right(self) -> bool:
        """True if the class is the true one."""
        return self.predicted == self.true_target


@dataclass(frozen=True)
class Scores:
    """The figures of a set of frames.

    All are against the truth. `as_harmless`: class 2 read as class 0. `unusable`: of
    the frames whose wall stays in the window; `refused_eyes` have no usable frame.
    `as_safe`: forces above 35 mN that are read as class 1 or 0 with an interval that
    ends below 30 mN. Errors in mN and coverage are over the usable frames with a force.
    `coverage_band` holds the coverage of other such eyes with 95 %, by drawing whole
    eyes anew; None without an interval. `width_mn`: median width of the intervals.
    `stretch`: the factor about the median that would make 90 % hold, with equal weight
    for every eye.
    """

    frames: int
    accuracy: Proportion
    as_harmless: int
    as_safe: Proportion
    unusable: Proportion
    refused_eyes: int
    mae_mn: float
    coverage: Proportion
    coverage_band: tuple[float, float] | None
    width_mn: float
    stretch: float


def answered_frame(
    answer: FrameAnswer, true_n: float, in_window: bool, classes: ClassesStudy
) -> AnsweredFrame | None:
    """Return a frame of `evaluate` with its truth; None where it does not count in an
    evaluation.

    Args:
        answer: of `evaluate`.
        true_n: the force that was put in, in N.
        in_window: whether the wall's surface stays within the frame.
        classes: the bounds of the force classes.
    """
    if answer.target is None or answer.excluded is not None:
        return None

    read = answer.answer
    return AnsweredFrame(
        eye=answer.eye,
        file=answer.file,
        true_target=classes.classify(true_n),
        true_mn=1e3 * true_n,
        in_window=in_window,
        predicted=read.predicted,
        usable=read.usable,
        read_mn=from_si(read.force_n, "mn"),
        interval_mn=(
            None
            if read.interval_n is None
            else (from_si(read.interval_n[0], "mn"), from_si(read.interval_n[1], "mn"))
        ),
    )


def score(frames: Sequence[AnsweredFrame]) -> Scores:
    """Return the figures of answers."""
    usable = [frame for frame in frames if frame.usable]
    dangerous = [frame for frame in frames if frame.true_target == DANGEROUS]
    seen = [frame for frame in frames if frame.in_window]
    errors = [
        abs(frame.read_mn - frame.true_mn)
        for frame in usable
        if frame.read_mn is not None
    ]
    held = [frame for frame in usable if frame.interval_mn is not None]
    ends = [frame.interval_mn for frame in held if frame.interval_mn]
    widths = [high - low for low, high in ends]
    covered = [_holds(frame) for frame in held]

    return Scores(
        frames=len(frames),
        accuracy=_share([frame.right for frame in frames]),
        as_harmless=sum(frame.predicted == 0 for frame in dangerous),
        as_safe=_share(
            [_as_safe(frame) for frame in frames if frame.true_mn > HIGH_MN]
        ),
        unusable=_share([not frame.usable for frame in seen]),
        refused_eyes=len(
            {frame.eye for frame in frames} - {frame.eye for frame in usable}
        ),
        mae_mn=float(np.mean(errors)) if errors else nan,
        coverage=_share(covered),
        coverage_band=coverage_band([frame.eye for frame in held], covered),
        width_mn=float(np.median(widths)) if widths else nan,
        stretch=_stretch(held),
    )


def _holds(frame: AnsweredFrame) -> bool:
    return (
        frame.interval_mn is not None
        and frame.interval_mn[0] <= frame.true_mn <= frame.interval_mn[1]
    )


def _as_safe(frame: AnsweredFrame) -> bool:
    return (
        frame.predicted < DANGEROUS
        and frame.interval_mn is not None
        and frame.interval_mn[1] < BOUND_MN
    )


def _stretch(frames: Sequence[AnsweredFrame]) -> float:
    """Return the factor of the intervals' halves with which 90 % of the frames of whole
    eyes hold; NaN: no frames.
    """
    scores = []
    eyes = []

    for frame in frames:
        if frame.interval_mn is not None and frame.read_mn is not None:
            low, high = frame.interval_mn
            half_mn = (
                high - frame.read_mn
                if frame.true_mn > frame.read_mn
                else frame.read_mn - low
            )
            scores.append(
                abs(frame.true_mn - frame.read_mn) / max(half_mn, SMALLEST_MN)
            )
            eyes.append(frame.eye)

    if not scores:
        return nan

    _, numbers = np.unique(eyes, return_inverse=True)
    weight = 1.0 / np.bincount(numbers)[numbers]
    order = np.argsort(scores)
    share = np.cumsum(weight[order]) / weight.sum()

    return float(np.asarray(scores)[order][np.searchsorted(share, LEVEL - 1e-9)])


def _share(hits: Sequence[bool]) -> Proportion:
    return Proportion(sum(hits), len(hits))
