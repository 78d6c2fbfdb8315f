"""What is known of a globe: open, sealed with some rigidity, or nothing. The rigidity is an unknown of fit and filter.

It is normal about a mean and lies between bounds. Before any frame of known force the mean and the standard deviation
are those of what may be; such frames move and narrow them.
"""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.globe import Globe, sealed_globe
from scleraforce.study.eye import RIGIDITY_LAWS, GlobeStudy
from scleraforce.units import to_si

Floats = NDArray[np.float64]
Kind = Literal["open", "sealed", "unknown"]

REFERENCE_RIGIDITY = to_si(0.03, "mmhg13_per_ul")  # of enucleated human eyes (van der Werff 1981), Pa^(1/3)/m^3
SLACKEST, STIFFEST = REFERENCE_RIGIDITY / 6.0, 2.0 * REFERENCE_RIGIDITY  # 0.005 and 0.06 mmHg^(1/3)/ul
STATED_SD, STATED_ENDS = 0.08, 1.3  # relative, of a rigidity that is told without its uncertainty
NINETY_PERCENT = 1.6449  # standard deviations to either side


@dataclass(frozen=True, kw_only=True)
class KnownGlobe:
    """A globe of which so much is known.

    `kind` is what was told of it. `lowest` and `highest` bound the rigidity k of the `law`; `mean` and `sd` say where
    it lies. All are Pa^(1/3)/m^3 and 0 for an open globe. `correlation` is that with the logarithm of the modulus that
    was estimated with it; `calibrated` says whether frames of known force have told these, `rigidity_told` whether k
    was told as a number.
    """

    kind: Kind
    lowest: float
    highest: float
    mean: float
    sd: float
    law: str = RIGIDITY_LAWS[0]
    correlation: float = 0.0
    calibrated: bool = False
    rigidity_told: bool = False

    @property
    def can_be_sealed(self) -> bool:
        """Whether the pressure may rise with the dent."""
        return self.highest > 0.0

    def globe(self, rigidity: Floats | float) -> Globe:
        """Return the globe, or as many, of a rigidity k, Pa^(1/3)/m^3; a little below 0 the law goes on."""
        return sealed_globe(rigidity, self.law)

    @property
    def band(self) -> tuple[float, float]:
        """The rigidities, Pa^(1/3)/m^3, between which k lies with 90 %."""
        ends = np.clip(self.mean + NINETY_PERCENT * self.sd * np.array([-1.0, 1.0]), self.lowest, self.highest)
        return float(ends[0]), float(ends[1])


OPEN = KnownGlobe(kind="open", lowest=0.0, highest=0.0, mean=0.0, sd=0.0)
UNKNOWN = KnownGlobe(kind="unknown", lowest=0.0, highest=STIFFEST, mean=0.5 * STIFFEST, sd=STIFFEST / sqrt(12.0))
SEALED = KnownGlobe(
    kind="sealed",
    lowest=SLACKEST,
    highest=STIFFEST,
    mean=0.5 * (SLACKEST + STIFFEST),
    sd=(STIFFEST - SLACKEST) / sqrt(12.0),
)


def known_globe(kind: str | None, rigidity_pa13_per_m3: float | None = None, law: str | None = None) -> KnownGlobe:
    """Return what is known of a globe of which this was told; None: nothing.

    Raises:
        StudyError: a kind that there is none of, or a rigidity that no globe has, as in a study file.

    >>> known_globe(None).kind, known_globe("open").can_be_sealed
    ('unknown', False)
    """
    if kind is None:
        return UNKNOWN
    if GlobeStudy().told(kind, rigidity_pa13_per_m3).kind == "open":
        return OPEN
    law = RIGIDITY_LAWS[0] if law is None else law
    if rigidity_pa13_per_m3 is None:
        return replace(SEALED, law=law)
    k = rigidity_pa13_per_m3
    ends = k / STATED_ENDS, k * STATED_ENDS
    return KnownGlobe(
        kind="sealed", lowest=ends[0], highest=ends[1], mean=k, sd=STATED_SD * k, law=law, rigidity_told=True
    )


def completed_globe(told: KnownGlobe | None, stated: KnownGlobe | None) -> KnownGlobe | None:
    """Return what was told of a globe, and what else was stated of one of the same kind; None: nothing.

    >>> k = 0.5 * REFERENCE_RIGIDITY
    >>> completed_globe(known_globe("sealed"), known_globe("sealed", k)).rigidity_told
    True
    >>> completed_globe(known_globe("open"), known_globe("sealed", k)).kind
    'open'
    """
    if told is None or stated is None or told.kind != stated.kind:
        return told or stated
    return replace(told, law=stated.law) if told.rigidity_told else stated
