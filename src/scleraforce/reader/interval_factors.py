"""By how much intervals are stretched about the median, so that 90 % of them hold over whole eyes.

What a method says of its own uncertainty leaves out what its model leaves out. So its intervals are measured on eyes
that are not in its model (split-conformal prediction: Vovk, Gammerman and Shafer, Algorithmic Learning in a Random
World, 2005; over groups of frames that belong together: Dunn, Wasserman and Ramdas 2023). Each trait of a reading
(`interval_traits`) has a factor, and those of its traits are multiplied. `model.json` keeps the factors; a model
without them has intervals as its methods say. Before that, an eye whose calibration left its frames of known force
scattered has wider intervals than another (`Known.scatter`).
"""

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, prod
from typing import Any

from scleraforce.errors import ModelError
from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.known.eye import Known
from scleraforce.reader.interval_traits import FIT_TRAITS, NETWORK_TRAITS, traits_of
from scleraforce.segmentation.steps import Segmentation
from scleraforce.study import ReaderStudy

Factors = Mapping[str, Mapping[str, float]]  # by whose modulus, then by trait

# Virtual eyes of the library's walls have no needle and no conjunctiva. With either, intervals were too narrow by so
# much on twelve eyes each, computed in three dimensions: `python -m figures --seed 20261130 --eyes 12 --groups
# needle,conjunctiva`, which is no draw of `make figures`; with the factors of that day, a tenth to a quarter larger.
NEEDLE_STRETCH, CONJUNCTIVA_STRETCH = 1.18, 1.14


@dataclass(frozen=True)
class IntervalFactors:
    """Factors of the intervals of both methods, by the reading's traits; 1 where a trait has none."""

    network: Factors = field(default_factory=dict)
    fit: Factors = field(default_factory=dict)

    def of_network(self, known: Known, force_n: float) -> float:
        """Return the factor of the network's interval of a force, N."""
        return _product(self.network, traits_of(known, force_n))

    def of_fit(self, known: Known, fit: BoundaryFit) -> float:
        """Return the factor of the interval of a fit."""
        return known.scatter * _product(self.fit, traits_of(known, fit.force_n, fit))


NO_FACTORS = IntervalFactors()


def frame_stretch(wall: Segmentation, known: Known, trained: ReaderStudy) -> float:
    """Return by how much more the fit's interval is stretched beside a needle, and under a conjunctiva.

    Args:
        wall: as it was seen.
        known: of the eye; a gap below those of the training is beside the needle, whether that is seen or not.
        trained: on what the model was.
    """
    beside = wall.needle is not None or (known.gap_m is not None and known.gap_m < trained.gap_m.bounds[0])
    return (NEEDLE_STRETCH if beside else 1.0) * (1.0 if wall.conjunctiva_m is None else CONJUNCTIVA_STRETCH)


def parse_factors(record: Mapping[str, Any], place: str) -> IntervalFactors:
    """Return the factors of a model's record; none where it has no `intervals`.

    Args:
        record: of `model.json`.
        place: the file, for messages.

    Raises:
        ModelError: they are not what they should be.
    """
    intervals = record.get("intervals")
    if intervals is None:
        return NO_FACTORS
    if not isinstance(intervals, dict):
        raise ModelError(f"{place}: intervals: found {reprlib.repr(intervals)}, expected an object")
    return IntervalFactors(
        _factors(intervals.get("network", {}), NETWORK_TRAITS, f"{place}: intervals.network"),
        _factors(intervals.get("fit", {}), FIT_TRAITS, f"{place}: intervals.fit"),
    )


def _product(factors: Factors, traits: tuple[str, ...]) -> float:
    """Return the product of the factors of a reading's traits."""
    modulus, *others = traits
    given = factors.get(modulus, {})
    return prod(given.get(trait, 1.0) for trait in others)


def _factors(values: object, traits: Mapping[str, tuple[str, ...]], place: str) -> Factors:
    """Return the factors of one method's traits."""
    if not isinstance(values, dict) or not set(values) <= set(traits):
        found = f"found {reprlib.repr(values)}, expected factors of {' and '.join(traits)}"
        raise ModelError(f"{place}: {found}; a model of an earlier version has to be made anew")
    return {modulus: _of_modulus(given, traits[modulus], f"{place}: {modulus}") for modulus, given in values.items()}


def _of_modulus(given: object, traits: tuple[str, ...], place: str) -> dict[str, float]:
    """Return the factors of the traits of readings with one kind of modulus."""
    if not isinstance(given, dict) or not set(given) <= set(traits):
        raise ModelError(f"{place}: found {reprlib.repr(given)}, expected factors of {', '.join(traits)}")
    for trait, value in given.items():
        if type(value) not in (int, float) or not isfinite(value) or not value > 0.0:
            raise ModelError(f"{place}, {trait}: found {reprlib.repr(value)}, expected a number above 0")
    return {trait: float(value) for trait, value in given.items()}
