"""Factors that stretch intervals about the median, so that 90 % of them hold over whole
eyes.

The uncertainty that a method states leaves out the errors of its own model. So its
intervals are measured on eyes that are not in its model (split-conformal prediction:
Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World, 2005; over groups of
frames that belong together: Dunn, Wasserman and Ramdas 2023). Each trait of a reading,
a cause of errors, has a factor, and the factors of its traits are multiplied.
`model.json` keeps the factors; without them intervals are not stretched. An eye whose
frames of known force scatter has wider intervals, too (`Setup.scatter`).

The score of a reading is the distance of the force from the median, over that of the
interval's end on that side. The score below which 90 % of the readings lie, every eye
weighing the same, makes 90 % of the intervals hold: the eyes are exchangeable, the
frames of one are not. With n eyes the share is 0.9 (n + 1)/n, as for a new eye.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import ModelError, StudyError
from scleraforce.fit.one_frame import BoundaryFit
from scleraforce.reading.answer import METHODS, Reading
from scleraforce.records.decoder import Source, decode_record
from scleraforce.records.fields import Unit
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy
from scleraforce.wall.wall import Segmentation

# by the kind of modulus, then by trait
Factors = Mapping[str, Mapping[str, float]]
FACTOR = Unit(low=5e-324, high=1e9, exact=True)  # any above 0

# kinds of modulus: a reading has one
OWN = "own E"
OTHER = "other E"
GLOBES = ("open", "sealed", "unknown")
TAUT = "taut"
# a reading has one; of the other traits it has none or some
GLOBE_TRAITS = (
    *GLOBES,
    TAUT,
)
UNEVEN = "uneven"
LIGHT = "light"
BEYOND = ("beyond", "far beyond")
SPARSE = "sparse"
OF_CALIBRATION = (*BEYOND, SPARSE)
NETWORK_TRAITS: Mapping[str, tuple[str, ...]] = {
    OWN: (*GLOBES, *OF_CALIBRATION),
    OTHER: GLOBES,
}
FIT_TRAITS: Mapping[str, tuple[str, ...]] = {
    OWN: (*GLOBE_TRAITS, UNEVEN, LIGHT, *OF_CALIBRATION),
    OTHER: (*GLOBE_TRAITS, UNEVEN, LIGHT),
}
# Of 140 virtual eyes of the library that were not declared open, calibrated on frames
# of their own, 90 % of the scores of even walls stayed below 0.6 at smaller tensions;
# of all walls below 1.6 at larger ones.
SLACK_TENSION = 0.05
LIGHTEST_N = 10e-3  # of other readings
# Of the largest force that an eye was calibrated on: up to 1.2 of it, 90 % of the
# scores of 82 virtual eyes, calibrated on three forces of up to 15 to 60 mN, stayed
# below 1.2, up to twice it below 1.3, beyond below 1.6 to 2.6.
BEYOND_FROM = 1.2, 2.0
# As a share of the largest force. Even shares of three leave 0.33; with three forces at
# random 0.98 of the intervals of eight virtual eyes held whose widest gap was below
# 0.4, and 0.76 of 81 others'.
SPARSE_FROM = 0.45
# Virtual eyes of the library's walls have no needle and no conjunctiva. With either,
# intervals were too narrow by these factors on twelve eyes each, computed in three
# dimensions: `python -m figures` with seed 20261130, 12 eyes and the groups
# needle,conjunctiva, which `make figures` does not draw.
NEEDLE_STRETCH = 1.18
CONJUNCTIVA_STRETCH = 1.14

LEVEL = 0.9
LEAST_N = 1e-6  # of a half interval
# factors: a few eyes must not promise more, nor say nothing
SMALLEST = 0.3
LARGEST = 20.0
# for 90 % of a new eye's readings: with fewer eyes no quantile promises as much
FEW_EYES = 9


def traits_of(
    setup: Setup, force_n: float, fit: BoundaryFit | None = None
) -> tuple[str, ...]:
    """Return the traits of a reading of a force, N, by the network, or with a fit by
    the fit.

    First the kind of modulus, then one of `GLOBE_TRAITS`, then the others. A modulus
    that was stated, is of other eyes or from shape alone is not the eye's own: no frame
    of known force has measured it.
    """
    globe = UNKNOWN if setup.eye.globe is None else setup.eye.globe
    is_own = setup.eye.modulus is not None and setup.eye.modulus.source == "own"
    traits = [OWN if is_own else OTHER, globe.kind]

    if fit is not None:
        traits[1] = (
            TAUT if globe.can_be_sealed and fit.tension > SLACK_TENSION else globe.kind
        )
        traits += [UNEVEN] * fit.is_uneven + [LIGHT] * (force_n < LIGHTEST_N)

    if is_own and setup.eye.discrepancy is not None:
        largest_n = setup.eye.discrepancy.largest_n
        gap = setup.eye.discrepancy.widest_gap

        beyond = (
            0
            if largest_n is None
            else sum(force_n > times * largest_n for times in BEYOND_FROM)
        )
        if beyond:
            traits.append(BEYOND[beyond - 1])
        elif gap is not None and gap > SPARSE_FROM:
            traits.append(SPARSE)

    return tuple(traits)


@dataclass(frozen=True)
class IntervalFactors:
    """Factors of the intervals of both methods, by the reading's traits; 1 for a trait
    without one.
    """

    network: Factors = field(default_factory=dict, metadata={"unit": FACTOR})
    fit: Factors = field(default_factory=dict, metadata={"unit": FACTOR})

    def of_network(self, setup: Setup, force_n: float) -> float:
        """Return the factor of the network's interval of a force, N."""
        return _product(self.network, traits_of(setup, force_n))

    def of_fit(self, setup: Setup, fit: BoundaryFit) -> float:
        """Return the factor of the interval of a fit."""
        return setup.eye.scatter * _product(
            self.fit, traits_of(setup, fit.force_n, fit)
        )


NO_FACTORS = IntervalFactors()


def _product(factors: Factors, traits: tuple[str, ...]) -> float:
    modulus, *others = traits
    given = factors.get(modulus, {})
    return prod(given.get(trait, 1.0) for trait in others)


def frame_stretch(wall: Segmentation, setup: Setup, trained: ReaderStudy) -> float:
    """Return the further factor of the fit's interval beside a needle, and under a
    conjunctiva.

    A gap below the training's is beside the needle, seen or not.
    """
    beside = wall.needle is not None or (
        setup.needle.gap_m is not None and setup.needle.gap_m < trained.gap_m.bounds[0]
    )
    return (NEEDLE_STRETCH if beside else 1.0) * (
        1.0 if wall.conjunctiva_m is None else CONJUNCTIVA_STRETCH
    )


@dataclass(frozen=True)
class _WithIntervals:
    """The part of a model's record that has factors."""

    intervals: IntervalFactors | None = None


def parse_factors(record: Mapping[str, Any], place: str) -> IntervalFactors:
    """Return the factors of a model's record, `NO_FACTORS` without `intervals`; raises
    `ModelError` naming `place`.
    """
    try:
        found = decode_record(_WithIntervals, record, Source(place))
    except StudyError as fault:
        raise ModelError(
            f"{fault}; a model of an earlier version has to be made anew"
        ) from fault

    factors = found.intervals or NO_FACTORS
    for method, allowed in (("network", NETWORK_TRAITS), ("fit", FIT_TRAITS)):
        for modulus, given in getattr(factors, method).items():
            if modulus not in allowed or not set(given) <= set(allowed[modulus]):
                wanted = ", ".join(allowed.get(modulus, allowed))
                at = (
                    f"{place}: intervals.{method}: {modulus!r:.40}: found"
                    f" {', '.join(given)!r:.80}"
                )
                raise ModelError(f"{at}, expected factors of {wanted}")

    return factors


@dataclass(frozen=True)
class IntervalScore:
    """The score of one reading: by which method, of which traits (`traits_of`) and
    which eye.
    """

    method: str
    traits: tuple[str, ...]
    eye: str
    score: float


@dataclass(frozen=True)
class IntervalStretch:
    """The readings of a method with one kind of modulus, and the factor that stretches
    their intervals.

    `held`: the share of the readings whose interval held the force before. The factors
    of their `globes`, of `GLOBE_TRAITS`, grow by `factor`.
    """

    method: str
    modulus: str
    globes: tuple[str, ...]
    eyes: int
    readings: int
    held: float
    factor: float


def score_reading(
    method: str,
    reading: Reading,
    setup: Setup,
    eye: str,
    force_n: float,
    fit: BoundaryFit | None = None,
) -> IntervalScore:
    """Return the score of a method's reading of an eye under a force, N; `fit`: the
    fit's own.

    It is the distance of the force from the median, over that of the interval's end on
    that side.
    """
    end_n = reading.interval_n[1 if force_n > reading.force_n else 0]
    distance = abs(force_n - reading.force_n) / max(
        abs(end_n - reading.force_n), LEAST_N
    )
    return IntervalScore(method, traits_of(setup, reading.force_n, fit), eye, distance)


def eye_count(scores: Iterable[IntervalScore]) -> int:
    """Return the number of eyes among scores."""
    return len({entry.eye for entry in scores})


def weights_of_eyes(scores: Sequence[IntervalScore]) -> Floats:
    """Return the weight of each score, of sum 1: every eye weighs the same."""
    names, eye, count = np.unique(
        [entry.eye for entry in scores], return_inverse=True, return_counts=True
    )
    return (1.0 / (count * len(names)))[eye]


def share_of_new_eye(eyes: int) -> float:
    """Return the share of the scores of n eyes that has to be held for 90 % of a new
    eye's.
    """
    return min(1.0, LEVEL * (eyes + 1) / eyes)


def conformal_quantile(scores: Sequence[IntervalScore]) -> float:
    """Return the score below which 90 % of the readings of a new eye lie."""
    values = np.array([entry.score for entry in scores])
    order = np.argsort(values)
    held = np.cumsum(weights_of_eyes(scores)[order])
    wanted = share_of_new_eye(eye_count(scores))
    place = min(int(np.searchsorted(held, wanted * (1.0 - 1e-12))), len(values) - 1)
    return float(np.clip(values[order][place], SMALLEST, LARGEST))


def of_each_modulus(
    scores: Iterable[IntervalScore],
) -> dict[tuple[str, str], list[IntervalScore]]:
    """Return the scores by method and kind of modulus."""
    found: dict[tuple[str, str], list[IntervalScore]] = {}
    for entry in scores:
        found.setdefault((entry.method, entry.traits[0]), []).append(entry)
    return dict(sorted(found.items()))


def intervals_record(
    scores: Sequence[IntervalScore], factors: Mapping[str, Factors], source: str
) -> dict[str, Any]:
    """Return `intervals` of `model.json`: the factors of both methods, and their
    source.
    """
    return {
        "level": LEVEL,
        "source": source,
        "eyes": eye_count(scores),
        "readings": len(scores),
        **factors,
    }


def find_stretches(scores: Iterable[IntervalScore]) -> tuple[IntervalStretch, ...]:
    """Return the factors by which intervals have to be stretched to hold on the eyes of
    some scores.

    One for all readings with one kind of modulus: a user's eyes are too few to tell
    their traits apart. Fewer eyes than `FEW_EYES` only widen: that these did well does
    not say that others will.
    """
    found = list[IntervalStretch]()
    for (method, modulus), entries in of_each_modulus(scores).items():
        eyes = eye_count(entries)
        factor = conformal_quantile(entries)
        globes = tuple(
            globe
            for globe in GLOBE_TRAITS
            if any(globe in entry.traits for entry in entries)
        )
        factor = max(factor, 1.0) if eyes < FEW_EYES else factor
        held = sum(entry.score <= 1.0 for entry in entries) / len(entries)
        found.append(
            IntervalStretch(method, modulus, globes, eyes, len(entries), held, factor)
        )

    return tuple(found)


def stretched_factors(
    before: IntervalFactors, changes: Iterable[IntervalStretch]
) -> Mapping[str, Factors]:
    """Return the factors of both methods multiplied by stretches; factors of other
    traits stay.
    """
    after = {
        method: {
            modulus: dict(given) for modulus, given in getattr(before, method).items()
        }
        for method in METHODS
    }
    for change in changes:
        given = after[change.method].setdefault(change.modulus, {})
        given |= {
            globe: round(given.get(globe, 1.0) * change.factor, 4)
            for globe in change.globes
        }

    return after
