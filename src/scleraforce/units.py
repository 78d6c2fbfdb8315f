"""Unit conversions for the edges of the program; everything inside is SI.

>>> round(mmhg_to_pa(2.0), 1)
266.6
"""

from math import pi

__all__ = ["SI_PER_UNIT", "STANDARD_GRAVITY_M_S2", "mmhg_to_pa", "n_to_mn", "pa_to_mmhg"]

STANDARD_GRAVITY_M_S2 = 9.80665

# Suffix of a name in human units -> (suffix in SI, factor).
SI_PER_UNIT: dict[str, tuple[str, float]] = {
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "mn": ("n", 1e-3),
    "mpa": ("pa", 1e6),
    "kpa": ("pa", 1e3),
    "mmhg": ("pa", 133.322387415),
    "deg": ("rad", pi / 180.0),
    "ms": ("s", 1e-3),
    "per_mm": ("per_m", 1e3),
    "mn_per_min": ("n_per_s", 1e-3 / 60.0),
    "mnm": ("nm", 1e-3),  # mN m in N m
    "percent": ("fraction", 1e-2),
    "mm2": ("m2", 1e-6),
    "kpa_per_mm": ("pa_per_m", 1e6),
    "mmhg13_per_ul": ("pa13_per_m3", 133.322387415 ** (1.0 / 3.0) * 1e9),  # mmHg^(1/3) per ul: of a sealed globe
}


def mmhg_to_pa(pressure_mmhg: float) -> float:
    """Return a pressure in Pa; the paper's 2 mmHg is about 266 Pa (sec. 2.2)."""
    return pressure_mmhg * SI_PER_UNIT["mmhg"][1]


def pa_to_mmhg(pressure_pa: float) -> float:
    """Return a pressure in mmHg.

    >>> round(pa_to_mmhg(mmhg_to_pa(15.0)), 9)
    15.0
    """
    return pressure_pa / SI_PER_UNIT["mmhg"][1]


def n_to_mn(force_n: float) -> float:
    """Return a force in mN."""
    return force_n * 1e3
