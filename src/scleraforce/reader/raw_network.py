"""The raw reader's network: a reduced frame and what is known of the eye in, a histogram of F/E and the contact out."""

import onnxruntime  # type: ignore[import-untyped]  # it ships no types

from scleraforce.known.eye import Known
from scleraforce.reader.interval_factors import NO_FACTORS, IntervalFactors
from scleraforce.reader.needle_gap import read_by_fit
from scleraforce.reader.readings import Reading
from scleraforce.reader.told_network import Seen, ToldNetwork
from scleraforce.segmentation.grid import Float
from scleraforce.segmentation.wall_finder import FINDER_FRAMES
from scleraforce.study import Study


class OnnxRawNetwork(ToldNetwork):
    """The network that sees reduced frames (`FrameWindow.reduced`), float32 (n, row, column), of eyes with gaps from 0.

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
        sees = Seen(FINDER_FRAMES, "tensor(float)", (study.raw_reader.rows, study.raw_reader.columns))
        super().__init__(session, study, read_by_fit(study.reader), place, factors, sees)

    def read(self, frame: Float, known: Known) -> Reading:
        """Return what the network reads in a reduced frame (row, column)."""
        return self.read_pictures(frame[None], known)
