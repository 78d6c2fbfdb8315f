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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Final, Literal

import numpy as np

from scleraforce.base.arrays import Floats, Number
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.normal_distribution import MOST_CORRELATED, NINETY_PERCENT
from scleraforce.base.units import to_si
from scleraforce.records.fields import (
    TableForm,
    Unit,
    allowed_bounds,
    check_quantity,
    check_value,
    computed,
    not_in_files,
    option,
)
from scleraforce.records.study_of_eye import GLOBES, RIGIDITY_LAWS, GlobeStudy

Values = Floats | float

# where a logarithmic law is as steep as the cube-root law of its k
SAME_SLOPE_PA = to_si(15.0, "mmhg")


def level_of(pressure: Number, is_logarithmic: bool) -> Number:
    """Return the level of a pressure, which is linear in the volume: its cube root or
    logarithm.

    `library.sealed_eye` compiles this function and the two below.
    """
    level: Number = np.log(pressure) if is_logarithmic else np.cbrt(pressure)
    return level


def level_growth(level: Values, is_logarithmic: bool) -> Values:
    """Return the derivative of the level by the logarithm of the pressure."""
    return 1.0 if is_logarithmic else level / 3.0


def pressure_of_level(level: Number, is_logarithmic: bool) -> Number:
    """Return the pressure of a level; never below 0."""
    pressure: Number = np.exp(level) if is_logarithmic else np.maximum(level, 0.0) ** 3
    return pressure


@dataclass(frozen=True)
class PressureLaw:
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

    def over(self, youngs_modulus_pa: Values) -> "PressureLaw":
        """Return the same globe where pressures are given over a modulus, P/E.

        >>> globe = sealed_law(0.15e9)
        >>> in_mpa = globe.over(1e6).pressure(266e-6, 1e-8)
        >>> bool(np.isclose(1e6 * in_mpa, globe.pressure(266.0, 1e-8)))
        True
        """
        return (
            replace(self, rate=self.rate / np.cbrt(youngs_modulus_pa))
            if self.law == RIGIDITY_LAWS[0]
            else self
        )

    @property
    def is_logarithmic(self) -> bool:
        """Return whether the level is the logarithm of the pressure."""
        return self.law == RIGIDITY_LAWS[1]

    def level(self, pressure: Values) -> Floats:
        """Return the level of a pressure (`level_of`)."""
        return level_of(np.asarray(pressure), self.is_logarithmic)

    def level_slope(self, pressure: Values) -> Floats:
        """Return the derivative of the level by the pressure."""
        growth = level_growth(self.level(pressure), self.is_logarithmic)
        return np.asarray(growth / pressure)

    def pressure(self, resting: Values, displaced_m3: Values) -> Floats:
        """Return the pressure when a dent displaces a volume, in the unit of the
        resting pressure; never below 0.
        """
        level = self.level(resting) + self.rate * displaced_m3
        return np.asarray(pressure_of_level(level, self.is_logarithmic))

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


CONSTANT_PRESSURE = PressureLaw()


def sealed_law(
    rigidity_pa13_per_m3: Values, law: str = RIGIDITY_LAWS[0]
) -> PressureLaw:
    """Return a sealed globe of a finite rigidity k, in Pa^(1/3)/m^3; of 0, an open
    one.
    """
    return PressureLaw(
        law,
        rigidity_pa13_per_m3
        * (3.0 / np.cbrt(SAME_SLOPE_PA) if law == RIGIDITY_LAWS[1] else 1.0),
    )


def study_law(globe: GlobeStudy) -> PressureLaw:
    """Return the globe of a study."""
    return (
        sealed_law(globe.rigidity_pa13_per_m3, globe.rigidity_law)
        if globe.kind == "sealed"
        else CONSTANT_PRESSURE
    )


Kind = Literal["open", "sealed", "unknown"]
# A recording states a globe by its kind, and of a sealed one what was measured.
KIND_KEY = "globe"
RIGIDITY_KEY = "rigidity_mmhg13_per_ul"
LAW_KEY = "rigidity_law"
LEAK_KEY = "leak_time_s"
_LEAK = Unit(low=1.0, high=1e6)

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
class Globe:
    """How an eye's pressure follows its needle, as far as that is known.

    `kind`: "open" (infused or vented: the pressure stays), "sealed", or "unknown"
    (a reading spans both). The rigidity k of the `law` lies between `lowest` and
    `highest`, with `mean` and `sd`; all are Pa^(1/3)/m^3 and 0 for an open globe.
    `correlation` is that with the logarithm of the modulus that was estimated with it;
    `calibrated`: it is from frames of known force; `rigidity_told`: k was given as a
    number. `leak_time_s`: time constant in which the displaced volume leaves a sealed
    globe; None: not declared, read as one that does not leak.

    >>> import scleraforce as sf
    >>> sf.Globe.declared("sealed").can_be_sealed
    True
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
    leak_time_s: float | None = not_in_files()

    def __post_init__(self) -> None:
        if self.kind not in (*GLOBES, "unknown"):
            raise StudyError(
                f"globe: {self.kind!r} is not one of {', '.join(GLOBES)}, unknown"
            )
        if self.law not in RIGIDITY_LAWS:
            raise StudyError(
                f"{LAW_KEY}: {self.law!r} is not one of {', '.join(RIGIDITY_LAWS)}"
            )
        if not self.lowest <= self.highest or not self.sd >= 0.0:
            raise StudyError(f"{RIGIDITY_KEY}: lowest above highest, or sd not above 0")
        if self.leak_time_s is not None:
            check_value(LEAK_KEY, self.leak_time_s, _LEAK)

    @property
    def can_be_sealed(self) -> bool:
        """True if the pressure may rise with the dent."""
        return self.highest > 0.0

    def pressure_law(self, rigidity: Floats | float) -> PressureLaw:
        """Return the law of one or n rigidities k, Pa^(1/3)/m^3; it continues a little
        below 0.
        """
        return sealed_law(rigidity, self.law)

    @property
    def band(self) -> tuple[float, float]:
        """The rigidities, Pa^(1/3)/m^3, between which k lies with 90 %."""
        ends = np.clip(
            self.mean + NINETY_PERCENT * self.sd * np.array([-1.0, 1.0]),
            self.lowest,
            self.highest,
        )
        return float(ends[0]), float(ends[1])

    def as_declared(self) -> "Globe | None":
        """Return what was declared of the globe, without the findings of a calibration;
        None: it was not declared.

        >>> replace(SEALED, mean=1e8, sd=1e6, calibrated=True).as_declared() == SEALED
        True
        """
        if self.kind == "unknown":
            return None
        told = self.rigidity_told and not self.calibrated
        k = self.mean if told else None
        return Globe.declared(self.kind, k, self.law, self.leak_time_s)

    @classmethod
    def declared(
        cls,
        kind: str | None,
        rigidity_pa13_per_m3: float | None = None,
        law: str | None = None,
        leak_time_s: float | None = None,
    ) -> "Globe":
        """Return the globe of a declared kind and rigidity; a kind of None: unknown.

        Raises:
            StudyError: no such kind, or a rigidity that is out of bounds or of a globe
                that is not sealed.

        >>> Globe.declared(None).kind, Globe.declared("open").can_be_sealed
        ('unknown', False)
        """
        if kind is not None and kind not in GLOBES:
            raise StudyError(f"globe: {kind!r} is not one of {', '.join(GLOBES)}")
        if rigidity_pa13_per_m3 is not None and kind != "sealed":
            raise StudyError(
                "rigidity_pa13_per_m3: of a sealed globe; declare the globe sealed, or"
                " leave the rigidity out"
            )
        if leak_time_s is not None and kind != "sealed":
            raise StudyError(
                f"{LEAK_KEY}: of a sealed globe; declare the globe sealed, or leave it"
                " out"
            )
        if rigidity_pa13_per_m3 is not None:
            check_quantity("rigidity_pa13_per_m3", rigidity_pa13_per_m3)
        if kind is None:
            return UNKNOWN
        if kind == "open":
            return OPEN

        law = RIGIDITY_LAWS[0] if law is None else law
        sealed = replace(SEALED, law=law, leak_time_s=leak_time_s)
        if rigidity_pa13_per_m3 is None:
            return sealed

        k = rigidity_pa13_per_m3
        return replace(
            sealed,
            lowest=k / STATED_ENDS,
            highest=k * STATED_ENDS,
            mean=k,
            sd=STATED_SD * k,
            rigidity_told=True,
        )


OPEN = Globe(kind="open", lowest=0.0, highest=0.0, mean=0.0, sd=0.0)

UNKNOWN = Globe(
    kind="unknown",
    lowest=0.0,
    highest=STIFFEST,
    mean=0.5 * STIFFEST,
    sd=STIFFEST / sqrt(12.0),
)

_MIDDLE = 0.5 * (SLACKEST + STIFFEST)

_EVEN_SD = (STIFFEST - SLACKEST) / sqrt(12.0)

SEALED = Globe(
    kind="sealed", lowest=SLACKEST, highest=STIFFEST, mean=_MIDDLE, sd=_EVEN_SD
)


def _read_globe(stated: Mapping[str, Any]) -> Globe | None:
    kind = stated.get(KIND_KEY)
    for key in (RIGIDITY_KEY, LAW_KEY, LEAK_KEY):
        if key in stated and kind != "sealed":
            found = "missing" if kind is None else f'"{kind}"'
            raise StudyError(
                f"{key}: of a sealed globe, globe is {found};"
                ' write globe = "sealed", or leave it out'
            )

    if kind is None:
        return None
    return Globe.declared(
        kind, stated.get(RIGIDITY_KEY), stated.get(LAW_KEY), stated.get(LEAK_KEY)
    )


def _write_globe(globe: Globe | None) -> Mapping[str, Any]:
    """Return what was declared of a globe, without the findings of a calibration."""
    if globe is None or globe.kind == "unknown":
        return {}
    if globe.kind == "open":
        return {KIND_KEY: "open"}

    told = globe.rigidity_told and not globe.calibrated
    return {
        KIND_KEY: "sealed",
        RIGIDITY_KEY: globe.mean if told else None,
        LAW_KEY: globe.law if told or globe.law != RIGIDITY_LAWS[0] else None,
        LEAK_KEY: globe.leak_time_s,
    }


_RIGIDITY = allowed_bounds("rigidity")
GLOBE_FORM = TableForm(
    {
        KIND_KEY: (str, Unit(words=GLOBES)),
        RIGIDITY_KEY: (
            float,
            Unit("mmhg13_per_ul", low=_RIGIDITY.low, high=_RIGIDITY.high),
        ),
        LAW_KEY: (str, Unit(words=RIGIDITY_LAWS)),
        LEAK_KEY: (float, _LEAK),
    },
    _read_globe,
    _write_globe,
)
