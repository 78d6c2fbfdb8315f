"""What the networks that read a force share: what they see and what they are told in, a histogram of F/E out."""

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
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
from scleraforce.reader.interval_factors import IntervalFactors
from scleraforce.reader.readings import Reading
from scleraforce.study import ReaderStudy, Study
from scleraforce.study.eye import RIGIDITY_LAWS

TOLD = "given"
HISTOGRAM, CONTACT = OUTPUTS = ["histogram", "contact_m"]
EYES = 16  # of which it is kept what the network is told


class Seen(NamedTuple):
    """The first input of a network: its name, its type in ONNX, and the shape of one picture."""

    name: str
    kind: str
    shape: tuple[int, ...]


class _Prepared(NamedTuple):
    """What a network is told of an eye, (1, len(GIVEN)), the modulus in it, Pa, and the factor of a force's interval.

    `edges_m2`: of the bins of F/E, with the eye's discrepancy of the force.
    """

    given: NDArray[np.float32]
    modulus_pa: float
    factor_of: Callable[[float], float]
    edges_m2: list[float]


class ToldNetwork:
    """A network that ONNX Runtime runs.

    Inputs: pictures (n, ...), and `given` float32 (n, len(GIVEN)). Outputs: `histogram` float32 (n, bin), the
    probability of bins of F/E, E the modulus that it was told, and `contact_m` float32 (n,), the needle's place from
    the picture's middle.
    """

    def __init__(
        self,
        session: onnxruntime.InferenceSession,
        study: Study,
        trained: ReaderStudy,
        place: str,
        factors: IntervalFactors,
        sees: Seen,
    ) -> None:
        """Check a network that was trained on `trained`, and that sees such pictures.

        Raises:
            ModelError: it has other inputs or outputs; names `place`.
        """
        self._session, self._place, self._factors, self._sees = session, place, factors, sees
        self._trained, self._bounds_n = trained, study.classes.bounds_n
        self._edges_m2 = ratio_edges(trained.bins, trained.max_force_ratio)
        self._told = lru_cache(maxsize=EYES)(self._prepared)
        inputs = {sees.name: (sees.kind, list(sees.shape)), TOLD: ("tensor(float)", [len(GIVEN)])}
        outputs = {HISTOGRAM: ("tensor(float)", [trained.bins]), CONTACT: ("tensor(float)", list[int]())}
        check_interface(session, inputs, outputs, place)

    @property
    def provenance(self) -> Mapping[str, str]:
        """What the network's file says about its making."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def read_pictures(self, pictures: NDArray[Any], known: Known) -> Reading:
        """Return what the network reads in pictures of one wall (picture, ...): the mean of its histograms."""
        given, modulus_pa, factor_of, edges_m2 = self._told(known)
        inputs: dict[str, NDArray[Any]] = {
            self._sees.name: np.ascontiguousarray(pictures),
            TOLD: np.repeat(given, len(pictures), axis=0),
        }
        histogram, contact_m = run_network(self._session, OUTPUTS, inputs, self._place)
        if histogram.shape != (len(pictures), len(self._edges_m2) - 1) or contact_m.shape != (len(pictures),):
            found = f"{histogram.shape} and {contact_m.shape} to {len(pictures)} {self._sees.name}"
            raise ModelError(f"{self._place}: answers {found}")
        mean = histogram.mean(axis=0).tolist()
        force = single_force(mean, edges_m2, modulus_pa, self._bounds_n, factor_of)
        return Reading(
            probabilities=force.probabilities,
            force_n=force.median_n,
            interval_n=force.interval_n,
            contact_m=float(contact_m.mean()),
        )

    def _prepared(self, known: Known) -> _Prepared:
        told = told_of(known)
        modulus_pa = float(told_modulus(told, self._trained)[0][0])
        discrepancy = known.discrepancy or NO_DISCREPANCY
        edges_m2 = discrepancy.corrected_n(modulus_pa * self._edges_m2) / modulus_pa
        given = given_inputs(told, self._trained)
        return _Prepared(given, modulus_pa, partial(self._factors.of_network, known), edges_m2.tolist())


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
        known.stiffening or 0.0,
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
