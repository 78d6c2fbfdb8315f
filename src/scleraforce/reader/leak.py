"""A leaking eye in a sequence of frames: its pressure without the needle changes with the volume that has leaked.

In a dense sequence the dent stays as it was from frame to frame. In a longer gap nothing shows what the needle did: the
second dent is taken to have been there for half of it, or for the time since its push if that is known, and the first
one for half of the rest. Before the first frame nothing has leaked.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp

from scleraforce.known import Known
from scleraforce.reader.answer import Answer
from scleraforce.reader.felt import DENSE_S

READINGS = 3  # of a frame after a longer gap, whose own dent decides on what has leaked


@dataclass(frozen=True)
class Leak:
    """The volume that has leaked from an eye by its last frame, at `time_s`, and its dent's, m^3."""

    known: Known
    leaked_m3: float = 0.0
    dent_m3: float = 0.0
    time_s: float | None = None

    def read(
        self, read: Callable[[Known], tuple[Answer, ...]], time_s: float, held_s: float | None
    ) -> tuple[tuple[Answer, ...], "Leak"]:
        """Return the answers of one time, read at the resting pressure that the leak leaves, and the leak by then."""
        known, globe, iop_pa = self.known, self.known.globe, self.known.iop_pa
        if known.leak_time_s is None or globe is None or iop_pa is None or globe.mean <= 0.0:
            return read(known), self
        law, gap_s = globe.globe(globe.mean), 0.0 if self.time_s is None else max(time_s - self.time_s, 0.0)
        dense = gap_s <= DENSE_S
        held_s = gap_s if dense else min(0.5 * gap_s if held_s is None else held_s, gap_s)
        left_s = 0.5 * (gap_s - held_s)
        before_m3 = self._after(self._after(self.leaked_m3, self.dent_m3, left_s), 0.0, left_s)
        dent_m3 = self.dent_m3
        for _ in range(1 if dense else READINGS):
            leaked_m3 = self._after(before_m3, dent_m3, held_s)
            answers = read(replace(known, iop_pa=float(law.pressure(iop_pa, -leaked_m3))))
            pressure_pa = answers[0].iop_at_dent_pa
            if pressure_pa is None:  # nothing shows that the dent is there still
                dent_m3 = 0.0
                break
            dent_m3 = leaked_m3 + float(law.displaced_m3(iop_pa, pressure_pa))
        return answers, replace(self, leaked_m3=leaked_m3, dent_m3=dent_m3, time_s=time_s)

    def _after(self, leaked_m3: float, dent_m3: float, passed_s: float) -> float:
        return dent_m3 + (leaked_m3 - dent_m3) * exp(-passed_s / (self.known.leak_time_s or 1.0))
