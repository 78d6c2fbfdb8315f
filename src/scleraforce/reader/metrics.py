"""How often a classifier is right: confusion matrix, recall, precision, accuracy, and how sure one can be of them.

The names are the standard ones. The paper's Table 3 calls the row-wise figure "precision" and the column-wise figure
"recall"; here recall is row-wise (of the trials of a class, how many were recognised) and precision column-wise (of
the answers of a class, how many were right).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

RESAMPLES, RESAMPLING_SEED, BAND = 2000, 20_261_122, (2.5, 97.5)  # of the eyes; percent


def wilson_interval(hits: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return Wilson's score interval of a proportion (Wilson 1927; NaN, NaN where `total` is 0).

    >>> low, high = wilson_interval(42, 45)
    >>> round(low, 2), round(high, 2)
    (0.82, 0.98)
    """
    if total == 0:
        return nan, nan
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share, weight = hits / total, z * z / total
    centre = (share + weight / 2) / (1 + weight)
    half = z / (1 + weight) * sqrt(share * (1 - share) / total + weight / (4 * total))
    return max(0.0, centre - half), min(1.0, centre + half)


@dataclass(frozen=True)
class Proportion:
    """`hits` out of `total`, with its value and 95 % Wilson interval (NaN where `total` is 0).

    >>> Proportion(14, 15).value
    0.9333333333333333
    """

    hits: int
    total: int

    @property
    def value(self) -> float:
        """The share of hits."""
        return self.hits / self.total if self.total else nan

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % Wilson interval."""
        return wilson_interval(self.hits, self.total)


def confusion_matrix(target: Sequence[int], predicted: Sequence[int], classes: int = 3) -> NDArray[np.int64]:
    """Count the trials by target (row) and predicted (column) class, shape (classes, classes).

    >>> confusion_matrix([0, 1, 1], [0, 1, 2]).tolist()
    [[1, 0, 0], [0, 1, 1], [0, 0, 0]]

    Raises:
        ValueError: the sequences differ in length, or a class lies outside 0 to classes - 1.
    """
    if len(target) != len(predicted):
        raise ValueError(f"{len(target)} targets but {len(predicted)} predictions")
    if any(not 0 <= label < classes for label in (*target, *predicted)):
        raise ValueError(f"a class outside 0 to {classes - 1}")
    counts = np.zeros((classes, classes), dtype=np.int64)
    np.add.at(counts, (np.asarray(target, dtype=np.intp), np.asarray(predicted, dtype=np.intp)), 1)
    return counts


def accuracy(confusion: NDArray[np.int64]) -> Proportion:
    """Return the share of right answers."""
    return Proportion(int(np.trace(confusion)), int(confusion.sum()))


def recall(confusion: NDArray[np.int64]) -> tuple[Proportion, ...]:
    """Return, for each target class (row), the share that was recognised."""
    return _shares(confusion, confusion.sum(axis=1))


def precision(confusion: NDArray[np.int64]) -> tuple[Proportion, ...]:
    """Return, for each predicted class (column), the share that was right."""
    return _shares(confusion, confusion.sum(axis=0))


@dataclass(frozen=True, kw_only=True)
class ForceTrial:
    """A trial's eye, its measured and read force, N, and the interval that was read."""

    eye: str
    measured_n: float
    read_n: float
    interval_n: tuple[float, float]

    @property
    def covered(self) -> bool:
        """Whether the measured force lies in the interval."""
        low, high = self.interval_n
        return low <= self.measured_n <= high


def mean_absolute_error(trials: Sequence[ForceTrial]) -> float:
    """Return the mean absolute error, N; NaN where there is no trial.

    >>> from dataclasses import replace
    >>> trial = ForceTrial(eye="a", measured_n=0.25, read_n=0.5, interval_n=(0.0, 1.0))
    >>> mean_absolute_error([trial, replace(trial, measured_n=1.0)])
    0.375
    """
    return sum(abs(trial.read_n - trial.measured_n) for trial in trials) / len(trials) if trials else nan


def coverage(trials: Sequence[ForceTrial]) -> Proportion:
    """Return the share of trials whose measured force lies in its interval.

    >>> from dataclasses import replace
    >>> trial = ForceTrial(eye="a", measured_n=1.0, read_n=0.9, interval_n=(0.8, 1.2))
    >>> coverage([trial, replace(trial, measured_n=3.0)]).value
    0.5
    """
    return Proportion(sum(trial.covered for trial in trials), len(trials))


def coverage_by_eye(trials: Sequence[ForceTrial]) -> dict[str, Proportion]:
    """Return the coverage of each eye's trials."""
    eyes = dict.fromkeys(trial.eye for trial in trials)
    return {eye: coverage([trial for trial in trials if trial.eye == eye]) for eye in eyes}


def coverage_band(eyes: Sequence[str], covered: Sequence[bool]) -> tuple[float, float] | None:
    """Return between which shares of covered frames lie with 95 %, by a bootstrap over whole eyes; None: no frames.

    Frames of one eye share its errors, so eyes are drawn anew, not frames.

    Args:
        eyes: the eye of each frame.
        covered: whether its interval holds.
    """
    if not eyes:
        return None
    _, numbers = np.unique(eyes, return_inverse=True)
    hits_e, frames_e = np.bincount(numbers, weights=np.asarray(covered)), np.bincount(numbers)
    rng = np.random.default_rng(RESAMPLING_SEED)
    drawn_re = rng.integers(len(frames_e), size=(RESAMPLES, len(frames_e)))
    low, high = np.percentile(hits_e[drawn_re].sum(axis=1) / frames_e[drawn_re].sum(axis=1), BAND)
    return float(low), float(high)


def _shares(confusion: NDArray[np.int64], totals: NDArray[np.int64]) -> tuple[Proportion, ...]:
    return tuple(Proportion(int(hits), int(total)) for hits, total in zip(np.diag(confusion), totals, strict=True))
