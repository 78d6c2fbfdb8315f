"""Metrics of an evaluation: confusion matrix, recall, precision, accuracy, errors and
coverage of forces.

The names are the standard ones. The paper's Table 3 calls the row-wise figure
"precision" and the column-wise figure "recall"; here recall is row-wise (share of a
class's trials that were recognised) and precision column-wise (share of a class's
answers that were right).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, nan, sqrt
from statistics import NormalDist, fmean, stdev

import numpy as np

from scleraforce.base.arrays import Bytes, Flags, Integers

# standard deviations from the mean to either end of a normal distribution's 90 %
# interval
SDS_OF_INTERVAL = NormalDist().inv_cdf(0.95)
# standard deviations to either end of the range of 95 % of all differences
LIMIT_SDS = NormalDist().inv_cdf(0.975)
SHARED_ERROR = (
    "Frames of one eye share the error of its calibration, so they hold or miss"
    " together: 90 % is the mean of many eyes; of single ones, from less than half to"
    " all hold."
)
# bootstrap samples of the eyes, their seed, and the band that is stated, percent
RESAMPLES = 2000
RESAMPLING_SEED = 20_261_122
BAND = (2.5, 97.5)


def dice(found: Flags | Bytes, true: Flags | Bytes) -> float:
    """Return the Dice coefficient of two masks, twice the common area over the sum of
    both; 1 if both are empty.
    """
    a = found > 0
    b = true > 0
    total = np.count_nonzero(a) + np.count_nonzero(b)
    return 2.0 * np.count_nonzero(a & b) / total if total else 1.0


@dataclass(frozen=True)
class Proportion:
    """`hits` out of `total`, with its value and 95 % Wilson interval (NaN where `total`
    is 0).
    """

    hits: int
    total: int

    @property
    def value(self) -> float:
        """The share of hits."""
        return self.hits / self.total if self.total else nan

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of Wilson's score interval, 95 % (Wilson 1927)."""
        if self.total == 0:
            return nan, nan

        z = NormalDist().inv_cdf(0.5 + 0.95 / 2)
        weight = z * z / self.total
        centre = (self.value + weight / 2) / (1 + weight)
        half = (
            z
            / (1 + weight)
            * sqrt(
                self.value * (1 - self.value) / self.total + weight / (4 * self.total)
            )
        )

        return max(0.0, centre - half), min(1.0, centre + half)

    def words(self, nothing: str = "-") -> str:
        """Return the value with its interval as text; `nothing` where `total` is 0.

        >>> Proportion(42, 45).words()
        '0.93 (0.82 to 0.98)'
        """
        low, high = self.interval
        return f"{self.value:.2f} ({low:.2f} to {high:.2f})" if self.total else nothing


def confusion_matrix(
    target: Sequence[int], predicted: Sequence[int], classes: int = 3
) -> Integers:
    """Count the trials by target (row) and predicted (column) class, shape (classes,
    classes).
    """
    if len(target) != len(predicted):
        raise ValueError(f"{len(target)} targets but {len(predicted)} predictions")
    if any(not 0 <= label < classes for label in (*target, *predicted)):
        raise ValueError(f"a class outside 0 to {classes - 1}")

    counts = np.zeros((classes, classes), dtype=np.int64)
    np.add.at(
        counts,
        (np.asarray(target, dtype=np.intp), np.asarray(predicted, dtype=np.intp)),
        1,
    )

    return counts


def accuracy(confusion: Integers) -> Proportion:
    """Return the share of right answers."""
    return Proportion(int(np.trace(confusion)), int(confusion.sum()))


def recall(confusion: Integers) -> tuple[Proportion, ...]:
    """Return, for each target class (row), the share that was recognised."""
    return _shares(confusion, confusion.sum(axis=1))


def precision(confusion: Integers) -> tuple[Proportion, ...]:
    """Return, for each predicted class (column), the share that was right."""
    return _shares(confusion, confusion.sum(axis=0))


@dataclass(frozen=True, kw_only=True)
class ForceTrial:
    """A trial's eye, its measured and read force, N, and the 90 % interval that was
    read.

    `measured_sd_n`: standard deviation of the measured force's error, N; 0 for a true
    force.
    """

    eye: str
    measured_n: float
    read_n: float
    interval_n: tuple[float, float]
    measured_sd_n: float = 0.0

    @property
    def covered(self) -> bool:
        """True if the interval and the measured force agree at 90 %.

        Their errors are independent: each half of the interval and 1.645 standard
        deviations of the measured force add in squares. So 90 % of normal readings with
        correct intervals agree, whatever the error of the measured forces; a measured
        force without error has to lie in the interval.
        """
        low, high = self.interval_n
        wide = SDS_OF_INTERVAL * self.measured_sd_n
        above = self.measured_n - self.read_n
        if not wide:
            return low <= self.measured_n <= high

        return (
            -hypot(self.read_n - low, wide) <= above <= hypot(high - self.read_n, wide)
        )


def mean_absolute_error(trials: Sequence[ForceTrial]) -> float:
    """Return the mean absolute error, N; NaN without trials."""
    return (
        sum(abs(trial.read_n - trial.measured_n) for trial in trials) / len(trials)
        if trials
        else nan
    )


def agreement(trials: Sequence[ForceTrial]) -> tuple[float, float, float]:
    """Return the mean of read minus measured force and its limits of agreement, N; the
    limits of one trial are NaN.

    The limits are 1.96 standard deviations to either side of the mean (Bland and Altman
    1986).
    """
    off_n = [trial.read_n - trial.measured_n for trial in trials]
    middle_n = fmean(off_n)
    reach_n = LIMIT_SDS * stdev(off_n) if len(off_n) > 1 else nan
    return middle_n, middle_n - reach_n, middle_n + reach_n


def coverage(trials: Sequence[ForceTrial]) -> Proportion:
    """Return the share of trials whose interval and measured force agree
    (`ForceTrial.covered`).
    """
    return Proportion(sum(trial.covered for trial in trials), len(trials))


def coverage_by_eye(trials: Sequence[ForceTrial]) -> dict[str, Proportion]:
    """Return the coverage of each eye's trials."""
    eyes = dict.fromkeys(trial.eye for trial in trials)
    return {
        eye: coverage([trial for trial in trials if trial.eye == eye]) for eye in eyes
    }


def coverage_band(
    eyes: Sequence[str], covered: Sequence[bool]
) -> tuple[float, float] | None:
    """Return the 95 % band of the share of covered frames, by a bootstrap over whole
    eyes; None without frames.

    Frames of one eye share its errors, so eyes are resampled, not frames.
    """
    if not eyes:
        return None

    _, numbers = np.unique(eyes, return_inverse=True)
    hits_e = np.bincount(numbers, weights=np.asarray(covered))
    frames_e = np.bincount(numbers)
    rng = np.random.default_rng(RESAMPLING_SEED)
    drawn_re = rng.integers(len(frames_e), size=(RESAMPLES, len(frames_e)))
    low, high = np.percentile(
        hits_e[drawn_re].sum(axis=1) / frames_e[drawn_re].sum(axis=1), BAND
    )

    return float(low), float(high)


def band_of(trials: Sequence[ForceTrial]) -> tuple[float, float] | None:
    """Return the 95 % band of the coverage of other such eyes (`coverage_band`); None
    without trials.
    """
    return coverage_band(
        [trial.eye for trial in trials], [trial.covered for trial in trials]
    )


def held_by_eye(trials: Sequence[ForceTrial]) -> str:
    """Return the number of forces that the intervals of each eye hold, in words: '1 of
    1 of a'.
    """
    return ", ".join(
        f"{held.hits} of {held.total} of {eye}"
        for eye, held in coverage_by_eye(trials).items()
    )


def _shares(confusion: Integers, totals: Integers) -> tuple[Proportion, ...]:
    return tuple(
        Proportion(int(hits), int(total))
        for hits, total in zip(np.diag(confusion), totals, strict=True)
    )
