"""A force reader whose network reads the same whatever it sees, beside a real fit."""

from pathlib import Path

import numpy as np
from analytic_frames import LIBRARY, STUDY

from scleraforce.known.eye import Known
from scleraforce.reader.answer import Reading
from scleraforce.reader.kinds import ForceReader

FIVE_MN = Reading(probabilities=(0.1, 0.8, 0.1), force_n=0.005, interval_n=(0.004, 0.006), contact_m=0.3e-3)


class FixedNetwork:
    """Reads the same whatever it sees, and keeps what it was shown."""

    provenance: dict[str, str] = {}  # noqa: RUF012 - a stand-in

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        self.shown: list[tuple[np.ndarray, Known]] = []

    def read(self, cuts: np.ndarray, known: Known) -> Reading:
        self.shown.append((cuts, known))
        return self.reading


def force_reader(reading: Reading = FIVE_MN, default: str = "fit") -> ForceReader:
    return ForceReader(Path("model"), STUDY, {}, FixedNetwork(reading), LIBRARY, default)
