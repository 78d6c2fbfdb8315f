"""Unit conversions for the edges of the program; everything inside is SI.

>>> round(to_si(2.0, "mmhg"), 1)
266.6
>>> from_si(5e-4, "um")
500.0
"""

from math import isclose, pi
from typing import TYPE_CHECKING, Any, Literal, TypeVar

if TYPE_CHECKING:
    from numpy.typing import NDArray

STANDARD_GRAVITY_M_S2 = 9.80665

HumanUnit = Literal[
    "mm",
    "um",
    "mn",
    "mpa",
    "kpa",
    "mmhg",
    "deg",
    "ms",
    "us",
    "per_mm",
    "mn_per_s",
    "mn_per_min",
    "mnm",
    "percent",
    "mm2",
    "kpa_per_mm",
    "mmhg13_per_ul",
    "mb",
    "gb",
]

# Suffix of a name in human units -> (suffix in SI, factor).
SI_PER_UNIT: dict[HumanUnit, tuple[str, float]] = {
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "mn": ("n", 1e-3),
    "mpa": ("pa", 1e6),
    "kpa": ("pa", 1e3),
    "mmhg": ("pa", 133.322387415),
    "deg": ("rad", pi / 180.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "per_mm": ("per_m", 1e3),
    "mn_per_s": ("n_per_s", 1e-3),
    "mn_per_min": ("n_per_s", 1e-3 / 60.0),
    "mnm": ("nm", 1e-3),  # mN m in N m
    "percent": ("fraction", 1e-2),
    "mm2": ("m2", 1e-6),
    "kpa_per_mm": ("pa_per_m", 1e6),
    "mmhg13_per_ul": (
        "pa13_per_m3",
        133.322387415 ** (1.0 / 3.0) * 1e9,
    ),  # mmHg^(1/3) per ul: of a sealed globe
    "mb": ("bytes", 1e6),
    "gb": ("bytes", 1e9),
}

# How many of a unit make one of SI, where that is a whole number. A division by it
# rounds once, as a product with 1e-6, itself rounded, does not: 400 * 1e-6 is
# 0.00039999999999999996.
_UNITS_IN_SI = {
    unit: float(round(1.0 / factor))
    for unit, (_, factor) in SI_PER_UNIT.items()
    if isclose(1.0 / factor, round(1.0 / factor))
}

# A number, an array of any shape, or None for what is not known.
Value = TypeVar("Value", float, float | None, "NDArray[Any]")


def to_si(value: Value, unit: HumanUnit) -> Value:
    """Return a number or an array, in a human unit, in SI; None stays None.

    >>> to_si(0.7, "mm"), to_si(0.25, "mpa"), to_si(None, "mmhg")
    (0.0007, 250000.0, None)
    """
    if value is None:
        return value
    count = _UNITS_IN_SI.get(unit)
    return value * SI_PER_UNIT[unit][1] if count is None else value / count


def from_si(value: Value, unit: HumanUnit) -> Value:
    """Return a number or an array, in SI, in a human unit; None stays None.

    >>> from_si(0.0007, "mm"), from_si(250e3, "mpa")
    (0.7, 0.25)
    >>> round(from_si(to_si(15.0, "mmhg"), "mmhg"), 9)
    15.0
    """
    if value is None:
        return value
    count = _UNITS_IN_SI.get(unit)
    return value / SI_PER_UNIT[unit][1] if count is None else value * count
