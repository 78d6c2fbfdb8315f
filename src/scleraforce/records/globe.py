"""The globe as a closed vessel: how the eye pressure rises with the volume that a dent
displaces.

An open globe (infused or vented) keeps its pressure. A sealed one follows a measured
law, which includes the give of the whole shell. With dV the volume between the undented
wall and the dented one, both at the pressure P,

    cube root:    P^(1/3) = P0^(1/3) + k dV
    logarithmic:  ln P = ln P0 + K dV

The cube root is van der Werff's (1981), k = 0.03 mmHg^(1/3)/ul in enucleated human
eyes; the logarithm is Friedenwald's (1937), who counts in log10: K / ln 10 = 0.0215 per
ul.

The rigidity is k for both laws: for a logarithmic one, the k with the same slope at 15
mmHg, K = 3 k / (15 mmHg)^(1/3); 0.0215 per ul is 0.041.

From a globe that leaks a volume W comes out, dW/dt = (dV - W) / tau, and dV - W raises
the pressure. At any time it is a globe that does not leak, with a resting pressure that
W has lowered.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Final, Literal

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError
from scleraforce.base.normal_distribution import MOST_CORRELATED, NINETY_PERCENT
from scleraforce.base.units import to_si
from scleraforce.records.fields import computed, option
from scleraforce.records.study_of_eye import RIGIDITY_LAWS, GlobeStudy

Values = Floats | float

# where a logarithmic law is as steep as the cube-root law of its k
SAME_SLOPE_PA = to_si(15.0, "mmhg")


@dataclass(frozen=True)
class Globe:
    """The rise of the pressure with the displaced volume; open where `rate` is 0.
    Numbers and arrays broadcast.

    `law` is the `level` of the pressure that is linear in the volume; `rate` is of the
    level, Pa^(1/3)/m^3 or 1/m^3, an array of several globes. No globe has a rate below
    0, but a search for one that is nearly open needs both sides.
    """

    law: str = "cube-root"
    rate: Values = 0.0

    def __post_init__(self) -> None:
        if self.law not in RIGIDITY_LAWS:
            raise InputError(
                f"rigidity law: {self.law!r} is not one of {', '.join(RIGIDITY_LAWS)}"
            )
        if not np.all(np.isfinite(self.rate)):
            raise InputError(
                f"rigidity: {np.asarray(self.rate)}; must be a finite number"
            )

    @property
    def is_sealed(self) -> bool:
        """Return whether the pressure follows the volume."""
        return bool(np.any(np.asarray(self.rate) != 0.0))

    def over(self, youngs_modulus_pa: Values) -> "Globe":
        """Return the same globe where pressures are given over a modulus, P/E.

        >>> globe = sealed_globe(0.15e9)
        >>> in_mpa = globe.over(1e6).pressure(266e-6, 1e-8)
        >>> bool(np.isclose(1e6 * in_mpa, globe.pressure(266.0, 1e-8)))
        True
        """
        return (
            replace(self, rate=self.rate / np.cbrt(youngs_modulus_pa))
            if self.law == RIGIDITY_LAWS[0]
            else self
        )

    def level(self, pressure: Values) -> Floats:
        """Return the level, which is linear in the volume: the pressure's cube root or
        logarithm.
        """
        return np.asarray(
            np.log(pressure) if self.law == RIGIDITY_LAWS[1] else np.cbrt(pressure)
        )

    def level_slope(self, pressure: Values) -> Floats:
        """Return the derivative of the level by the pressure."""
        return np.asarray(
            1.0
            / (
                pressure
                if self.law == RIGIDITY_LAWS[1]
                else 3.0 * np.cbrt(pressure) ** 2
            )
        )

    def pressure(self, resting: Values, displaced_m3: Values) -> Floats:
        """Return the pressure when a dent displaces a volume, in the unit of the
        resting pressure; never below 0.
        """
        if self.law == RIGIDITY_LAWS[1]:
            return np.asarray(resting * np.exp(self.rate * displaced_m3))
        return np.asarray(
            np.maximum(np.cbrt(resting) + self.rate * displaced_m3, 0.0) ** 3
        )

    def stiffness(self, pressure: Values) -> Floats:
        """Return dP/dV at a pressure, in its unit over m^3."""
        return np.asarray(self.rate / self.level_slope(pressure))

    def leaked_m3(
        self,
        resting: float,
        leak_steps: float,
        forces_n: Floats,
        pressed: Callable[[float, float], float],
    ) -> Floats:
        """Return the volume that has leaked under forces of an even clock, (sample,); a
        sealed globe's.

        `leak_steps`: time constant over the step. `pressed` gives the pressure under a
        force after a leak, m^3.
        """
        leaked_m3 = [0.0]
        share = -float(np.expm1(-1.0 / leak_steps))
        for force_n in forces_n[:-1].tolist():
            raising_m3 = self.displaced_m3(resting, pressed(force_n, leaked_m3[-1]))
            leaked_m3.append(leaked_m3[-1] + share * float(raising_m3))
        return np.array(leaked_m3)

    def displaced_m3(self, resting: Values, pressure: Values) -> Floats:
        """Return the volume whose displacement brings the resting pressure to another;
        in sealed globes only.
        """
        return np.asarray((self.level(pressure) - self.level(resting)) / self.rate)


OPEN_GLOBE = Globe()


def sealed_globe(rigidity_pa13_per_m3: Values, law: str = RIGIDITY_LAWS[0]) -> Globe:
    """Return a sealed globe of a finite rigidity k, in Pa^(1/3)/m^3; of 0, an open
    one.
    """
    return Globe(
        law,
        rigidity_pa13_per_m3
        * (3.0 / np.cbrt(SAME_SLOPE_PA) if law == RIGIDITY_LAWS[1] else 1.0),
    )


def study_globe(globe: GlobeStudy) -> Globe:
    """Return the globe of a study."""
    return (
        sealed_globe(globe.rigidity_pa13_per_m3, globe.rigidity_law)
        if globe.kind == "sealed"
        else OPEN_GLOBE
    )


Kind = Literal["open", "sealed", "unknown"]

# rigidity of enucleated human eyes (van der Werff 1981), Pa^(1/3)/m^3
REFERENCE_RIGIDITY = to_si(0.03, "mmhg13_per_ul")

# 0.005 and 0.06 mmHg^(1/3)/ul
SLACKEST = REFERENCE_RIGIDITY / 6.0

STIFFEST = 2.0 * REFERENCE_RIGIDITY

# relative, of a rigidity that is given without its uncertainty
STATED_SD = 0.08

STATED_ENDS = 1.3


STIFFEST_IN_FILES = 2.0  # mmHg^(1/3) per ul


def _rigidity(name: str, low: float) -> Any:
    """Declare a rigidity, Pa^(1/3)/m^3, which files have in a table with others."""
    unit: Final = "mmhg13_per_ul"
    return computed(low, STIFFEST_IN_FILES, unit, key=f"rigidity_{unit}.{name}")


@dataclass(frozen=True, kw_only=True)
class KnownGlobe:
    """The known inputs of a globe.

    `kind` is the declared one. `lowest` and `highest` bound the rigidity k of the
    `law`; `mean` and `sd` describe it. All are Pa^(1/3)/m^3 and 0 for an open globe.
    `correlation` is that with the logarithm of the modulus that was estimated with it;
    `calibrated`: it is from frames of known force; `rigidity_told`: k was given as a
    number.
    """

    kind: Kind
    lowest: float = _rigidity("lowest", 0.0)
    highest: float = _rigidity("highest", 0.0)
    mean: float = _rigidity("mean", -STIFFEST_IN_FILES)
    sd: float = _rigidity("sd", 0.0)
    law: str = option(RIGIDITY_LAWS[0], *RIGIDITY_LAWS, key="rigidity_law")
    correlation: float = computed(-MOST_CORRELATED, MOST_CORRELATED, default=0.0)
    calibrated: bool = False
    rigidity_told: bool = False

    @property
    def can_be_sealed(self) -> bool:
        """True if the pressure may rise with the dent."""
        return self.highest > 0.0

    def globe(self, rigidity: Floats | float) -> Globe:
        """Return the globe of one or n rigidities k, Pa^(1/3)/m^3; the law continues a
        little below 0.
        """
        return sealed_globe(rigidity, self.law)

    @property
    def band(self) -> tuple[float, float]:
        """The rigidities, Pa^(1/3)/m^3, between which k lies with 90 %."""
        ends = np.clip(
            self.mean + NINETY_PERCENT * self.sd * np.array([-1.0, 1.0]),
            self.lowest,
            self.highest,
        )
        return float(ends[0]), float(ends[1])


OPEN = KnownGlobe(kind="open", lowest=0.0, highest=0.0, mean=0.0, sd=0.0)

UNKNOWN = KnownGlobe(
    kind="unknown",
    lowest=0.0,
    highest=STIFFEST,
    mean=0.5 * STIFFEST,
    sd=STIFFEST / sqrt(12.0),
)

_MIDDLE = 0.5 * (SLACKEST + STIFFEST)

_EVEN_SD = (STIFFEST - SLACKEST) / sqrt(12.0)

SEALED = KnownGlobe(
    kind="sealed", lowest=SLACKEST, highest=STIFFEST, mean=_MIDDLE, sd=_EVEN_SD
)


def known_globe(
    kind: str | None, rigidity_pa13_per_m3: float | None = None, law: str | None = None
) -> KnownGlobe:
    """Return the globe of a declared kind and rigidity; None: unknown. Raises
    `StudyError` as for a study file.

    >>> known_globe(None).kind, known_globe("open").can_be_sealed
    ('unknown', False)
    """
    if kind is None:
        return UNKNOWN
    if GlobeStudy().with_known(kind, rigidity_pa13_per_m3).kind == "open":
        return OPEN

    law = RIGIDITY_LAWS[0] if law is None else law
    if rigidity_pa13_per_m3 is None:
        return replace(SEALED, law=law)

    k = rigidity_pa13_per_m3
    stated = replace(
        SEALED,
        lowest=k / STATED_ENDS,
        highest=k * STATED_ENDS,
        mean=k,
        sd=STATED_SD * k,
    )

    return replace(stated, law=law, rigidity_told=True)
