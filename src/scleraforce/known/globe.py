"""What is known of a globe: open, sealed with some rigidity, or nothing. The rigidity is an unknown of fit and filter.

Its normal score z stands for it: k = low + (high - low) Phi(z), Phi the normal distribution. Before any frame z has the
mean 0 and the standard deviation 1, so that k is even between its bounds; frames of known force move and narrow z.
"""

from dataclasses import dataclass
from math import erf, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.globe import Globe, sealed_globe
from scleraforce.study.globe import RIGIDITY_LAWS
from scleraforce.units import to_si

__all__ = ["OPEN", "UNKNOWN", "KnownGlobe", "known_globe", "normal_distribution"]

Floats = NDArray[np.float64]
Kind = Literal["open", "sealed", "unknown"]

STIFFEST = to_si(0.06, "mmhg13_per_ul")  # twice van der Werff's mean of enucleated human eyes
SLACKEST = to_si(0.005, "mmhg13_per_ul")  # of a sealed globe: a sixth of it
STATED_SPREAD = 1.15  # a stated rigidity is right to this factor


@dataclass(frozen=True, kw_only=True)
class KnownGlobe:
    """A globe whose rigidity lies between two bounds.

    `kind` is what was told of it. `lowest` and `highest` bound the rigidity k of the `law`, Pa^(1/3)/m^3: both 0 for an
    open globe. `score_mean` and `score_sd` are of the normal score, `correlation` is its correlation with the logarithm
    of the modulus that was estimated with it; `calibrated` says whether frames of known force have told them.
    """

    kind: Kind
    lowest: float
    highest: float
    law: str = RIGIDITY_LAWS[0]
    score_mean: float = 0.0
    score_sd: float = 1.0
    correlation: float = 0.0
    calibrated: bool = False

    @property
    def can_be_sealed(self) -> bool:
        """Whether the pressure may rise with the dent."""
        return self.highest > 0.0

    def rigidity(self, score: Floats | float) -> Floats:
        """Return the rigidity k of normal scores, Pa^(1/3)/m^3.

        >>> bool(np.isclose(UNKNOWN.rigidity(0.0), to_si(0.03, "mmhg13_per_ul")))
        True
        """
        return self.lowest + (self.highest - self.lowest) * normal_distribution(score)

    def globe(self, score: Floats | float) -> Globe:
        """Return the globe, or as many, of normal scores."""
        return sealed_globe(self.rigidity(score), self.law)

    @property
    def band(self) -> tuple[float, float]:
        """The rigidities, Pa^(1/3)/m^3, between which k lies with 90 %."""
        low, high = self.rigidity(self.score_mean + 1.6449 * self.score_sd * np.array([-1.0, 1.0])).tolist()
        return low, high


OPEN = KnownGlobe(kind="open", lowest=0.0, highest=0.0)
UNKNOWN = KnownGlobe(kind="unknown", lowest=0.0, highest=STIFFEST)
SEALED = KnownGlobe(kind="sealed", lowest=SLACKEST, highest=STIFFEST)


def known_globe(kind: str | None, rigidity_pa13_per_m3: float | None = None, law: str | None = None) -> KnownGlobe:
    """Return what is known of a globe of which this was told; None: nothing.

    >>> known_globe(None).kind, known_globe("open").can_be_sealed
    ('unknown', False)
    """
    if kind == "open":
        return OPEN
    if kind is None:
        return UNKNOWN
    law = RIGIDITY_LAWS[0] if law is None else law
    if rigidity_pa13_per_m3 is None:
        return KnownGlobe(kind="sealed", lowest=SEALED.lowest, highest=SEALED.highest, law=law)
    k = rigidity_pa13_per_m3
    return KnownGlobe(kind="sealed", lowest=k / STATED_SPREAD, highest=k * STATED_SPREAD, law=law)


def normal_distribution(score: Floats | float) -> Floats:
    """Return Phi of scores: the share of a normal distribution below them (NumPy and the standard library only)."""
    scores = np.asarray(score, dtype=np.float64)
    values = [0.5 * (1.0 + erf(z / sqrt(2.0))) for z in scores.ravel().tolist()]
    return np.array(values).reshape(scores.shape)
