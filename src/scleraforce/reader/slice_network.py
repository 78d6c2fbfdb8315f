"""The reader's network: a slice and what is known of the eye in, a histogram of F/E and the contact's place out."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.errors import ModelError
from scleraforce.eye.globe import SAME_SLOPE_PA
from scleraforce.known.discrepancy import NO_DISCREPANCY
from scleraforce.known.eye import Known
from scleraforce.known.globe import UNKNOWN
from scleraforce.models.session import check_interface, run_network
from scleraforce.reader.force_distribution import ratio_edges, single_force
from scleraforce.reader.given import GIVEN, Told, given_inputs, told_modulus
from scleraforce.reader.interval_factors import NO_FACTORS, IntervalFactors
from scleraforce.reader.readings import Reading
from scleraforce.study import ReaderStudy, Study
from scleraforce.study.globe import RIGIDITY_LAWS

__all__ = ["CONTACT", "HISTOGRAM", "INPUTS", "OnnxSliceNetwork", "Prepared", "prepared", "told_of"]

SLICES, TOLD = INPUTS = ("slices", "given")
HISTOGRAM, CONTACT = OUTPUTS = ["histogram", "contact_m"]
EYES = 16  # of which it is kept what the network is told


class OnnxSliceNetwork:
    """A network that ONNX Runtime runs.

    Inputs: `slices` uint8 (n, row, column) and `given` float32 (n, len(GIVEN)). Outputs: `histogram` float32 (n, bin),
    the probability of bins of F/E, E the modulus that it was told, and `contact_m` float32 (n,), the needle's place
    from the slice's middle.

    Raises:
        ModelError: the network has other inputs or outputs than its study asks for; names `place`.
    """

    def __init__(
        self,
        session: onnxruntime.InferenceSession,
        study: Study,
        place: str,
        factors: IntervalFactors = NO_FACTORS,
    ) -> None:
        self._session, self._study, self._place, self._factors = session, study, place, factors
        self._edges_m2 = ratio_edges(study.reader.bins, study.reader.max_force_ratio)
        self._told = lru_cache(maxsize=EYES)(self._prepared)
        self._check()

    @property
    def provenance(self) -> Mapping[str, str]:
        """What the network's file says about its making."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading:
        """Return what the network reads in slices of one wall (slice, row, column): the mean of its histograms."""
        given, modulus_pa, factor, edges_m2 = self._told(known)
        inputs: dict[str, NDArray[Any]] = {
            SLICES: np.ascontiguousarray(cuts),
            TOLD: np.repeat(given, len(cuts), axis=0),
        }
        histogram, contact_m = run_network(self._session, OUTPUTS, inputs, self._place)
        if histogram.shape != (len(cuts), len(self._edges_m2) - 1) or contact_m.shape != (len(cuts),):
            raise ModelError(f"{self._place}: answers {histogram.shape} and {contact_m.shape} to {len(cuts)} slices")
        mean = histogram.mean(axis=0).tolist()
        force = single_force(mean, edges_m2, modulus_pa, self._study.classes.bounds_n, factor)
        return Reading(
            probabilities=force.probabilities,
            force_n=force.median_n,
            interval_n=force.interval_n,
            contact_m=float(contact_m.mean()),
        )

    def _prepared(self, known: Known) -> "Prepared":
        return prepared(known, self._study.reader, self._edges_m2, self._factors)

    def _check(self) -> None:
        rows, columns = self._study.slice.rows, self._study.slice.columns
        inputs = {SLICES: ("tensor(uint8)", [rows, columns]), TOLD: ("tensor(float)", [len(GIVEN)])}
        outputs = {HISTOGRAM: ("tensor(float)", [self._study.reader.bins]), CONTACT: ("tensor(float)", [])}
        check_interface(self._session, inputs, outputs, self._place)


class Prepared(NamedTuple):
    """What a network is told of an eye, (1, len(GIVEN)), the modulus in it, Pa, and the factor of its intervals.

    `edges_m2`: of the bins of F/E, with the eye's discrepancy of the force.
    """

    given: NDArray[np.float32]
    modulus_pa: float
    factor: float
    edges_m2: list[float]


def prepared(known: Known, trained: ReaderStudy, edges_m2: NDArray[np.float64], factors: IntervalFactors) -> Prepared:
    """Return what a network is told of an eye.

    Args:
        known: of the eye.
        trained: on what the network was.
        edges_m2: of its bins of F/E.
        factors: of its intervals.
    """
    told = told_of(known)
    modulus_pa = float(told_modulus(told, trained)[0][0])
    discrepancy = known.discrepancy or NO_DISCREPANCY
    edges = discrepancy.corrected_n(modulus_pa * edges_m2) / modulus_pa
    return Prepared(given_inputs(told, trained), modulus_pa, factors.of_network(known), edges.tolist())


def told_of(known: Known) -> Told:
    """Return what is known of one eye as the network's training put it, arrays (1,), NaN where it is not known."""
    modulus = known.modulus
    values = (
        modulus.mean_pa if modulus else None,
        modulus.relative_sd if modulus else None,
        known.iop_pa,
        known.thickness_m,
        known.gap_m,
        *_rigidity_band(known),
        known.polar_rad,
        known.direction_rad,
    )
    return Told(*(np.array([np.nan if value is None else value]) for value in values))


def _rigidity_band(known: Known) -> tuple[float, float]:
    """Return the band of a globe's rigidity by the cube-root law, as steep at the resting pressure as its own law."""
    globe = UNKNOWN if known.globe is None else known.globe
    if globe.law == RIGIDITY_LAWS[0]:
        return globe.band
    low, high = globe.band
    factor = 1.0 if known.iop_pa is None else float(np.cbrt(known.iop_pa / SAME_SLOPE_PA))
    return low * factor, high * factor
