"""The raw reader's network: a reduced frame and what is known of the eye in, a histogram of F/E and the contact out."""

from collections.abc import Mapping
from functools import lru_cache

import onnxruntime  # type: ignore[import-untyped]  # it ships no types

from scleraforce.known.eye import Known
from scleraforce.models.session import check_interface, run_network
from scleraforce.reader.force_distribution import ratio_edges, single_force
from scleraforce.reader.given import GIVEN
from scleraforce.reader.interval_factors import NO_FACTORS, IntervalFactors
from scleraforce.reader.needle_gap import read_by_fit
from scleraforce.reader.readings import Reading
from scleraforce.reader.slice_network import CONTACT, HISTOGRAM, INPUTS, Prepared, prepared
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.wall_finder import FINDER_FRAMES
from scleraforce.study import Study

__all__ = ["OnnxRawNetwork"]

TOLD = INPUTS[1]
EYES = 16  # of which it is kept what the network is told


class OnnxRawNetwork:
    """A network that ONNX Runtime runs.

    Inputs: `frames` float32 (n, row, column), as of `FrameWindow.reduced`, and `given` float32 (n, len(GIVEN)), of eyes
    with gaps from 0. Outputs: those of `OnnxSliceNetwork`.

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
        self._trained = read_by_fit(study.reader)
        self._edges_m2 = ratio_edges(study.reader.bins, study.reader.max_force_ratio)
        self._told = lru_cache(maxsize=EYES)(self._prepared)
        raw = study.raw_reader
        inputs = {FINDER_FRAMES: ("tensor(float)", [raw.rows, raw.columns]), TOLD: ("tensor(float)", [len(GIVEN)])}
        outputs = {HISTOGRAM: ("tensor(float)", [study.reader.bins]), CONTACT: ("tensor(float)", list[int]())}
        check_interface(session, inputs, outputs, place)

    @property
    def provenance(self) -> Mapping[str, str]:
        """What the network's file says about its making."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def read(self, frame: Float, known: Known) -> Reading:
        """Return what the network reads in a reduced frame (row, column)."""
        given, modulus_pa, factor, edges_m2 = self._told(known)
        histogram, contact_m = run_network(
            self._session, [HISTOGRAM, CONTACT], {FINDER_FRAMES: frame[None], TOLD: given}, self._place
        )
        force = single_force(histogram[0].tolist(), edges_m2, modulus_pa, self._study.classes.bounds_n, factor)
        return Reading(
            probabilities=force.probabilities,
            force_n=force.median_n,
            interval_n=force.interval_n,
            contact_m=float(contact_m[0]),
        )

    def _prepared(self, known: Known) -> Prepared:
        return prepared(known, self._trained, self._edges_m2, self._factors)
