"""The reader's network: a slice and what is known of the eye in, a histogram of F/E and the contact's place out."""

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.known.eye import Known
from scleraforce.reader.interval_factors import NO_FACTORS, IntervalFactors
from scleraforce.reader.readings import Reading
from scleraforce.reader.told_network import Seen, ToldNetwork
from scleraforce.study import Study

SLICES = "slices"


class OnnxSliceNetwork(ToldNetwork):
    """The network that sees slices, uint8 (n, row, column).

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
        sees = Seen(SLICES, "tensor(uint8)", (study.slice.rows, study.slice.columns))
        super().__init__(session, study, study.reader, place, factors, sees)

    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading:
        """Return what the network reads in slices of one wall (slice, row, column): the mean of its histograms."""
        return self.read_pictures(cuts, known)
