"""Units as programs call them, and how many of SI one of them is."""

import re

from scleraforce.recording.scan import SECONDS
from scleraforce.units import STANDARD_GRAVITY_M_S2, to_si

TIME, FORCE, TORQUE = "time", "force", "torque"
INCH_M = 0.0254
POUND_N = 0.45359237 * STANDARD_GRAVITY_M_S2

NEWTONS = {
    "n": 1.0, "newton": 1.0, "newtons": 1.0, "mn": to_si(1.0, "mn"), "millinewton": to_si(1.0, "mn"),
    "millinewtons": to_si(1.0, "mn"), "un": 1e-6, "µn": 1e-6, "kn": 1e3,
    "g": to_si(STANDARD_GRAVITY_M_S2, "mn"), "gf": to_si(STANDARD_GRAVITY_M_S2, "mn"), "kgf": STANDARD_GRAVITY_M_S2,
    "lbf": POUND_N, "lb": POUND_N,
}  # fmt: skip
NEWTON_METRES = {
    "nm": 1.0, "n-m": 1.0, "n*m": 1.0, "n.m": 1.0, "n m": 1.0, "mnm": to_si(1.0, "mnm"), "nmm": 1e-3, "n-mm": 1e-3,
    "ncm": 1e-2, "lbf-in": POUND_N * INCH_M, "in-lb": POUND_N * INCH_M,
}  # fmt: skip
UNITS = {TIME: SECONDS, FORCE: NEWTONS, TORQUE: NEWTON_METRES}
RATE = re.compile(r"([\d.]+)\s*hz", re.IGNORECASE)
PER_UNIT = re.compile(r"(\d+\.?\d*(?:[eE][+-]?\d+)?)\s*/\s*(.+)")


def quantity_of(column: str) -> str:
    """Return what a column of ours is.

    >>> quantity_of("time_s"), quantity_of("fx_n"), quantity_of("tz_nm")
    ('time', 'force', 'torque')
    """
    return TIME if column == "time_s" else FORCE if column.startswith("f") else TORQUE


def unit_factor(unit: str, quantity: str) -> float | None:
    """Return how many of SI a unit is, None where it is none of the quantity.

    Counters of samples have a unit of time as well: their rate. Counts and volts have how many of them are one unit.
    "MN" is none: nobody can say whether it means mN.

    >>> unit_factor("mN", FORCE), unit_factor("mN", TORQUE), unit_factor("500 Hz", TIME), unit_factor("1000/mN", FORCE)
    (0.001, None, 0.002, 1e-06)
    """
    per_unit = PER_UNIT.fullmatch(unit.strip())
    if per_unit and quantity != TIME and float(per_unit[1]) > 0.0:
        whole = unit_factor(per_unit[2], quantity)
        return None if whole is None else whole / float(per_unit[1])
    rate = RATE.fullmatch(unit.strip())
    if rate and quantity == TIME and float(rate[1]) > 0.0:
        return 1.0 / float(rate[1])
    if unit.strip() == "MN":
        return None
    return UNITS[quantity].get(unit.strip().lower().replace("\N{GREEK SMALL LETTER MU}", "µ"))


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of time, force or torque.

    >>> is_unit("mN"), is_unit("Fz")
    (True, False)
    """
    return any(unit_factor(text, quantity) is not None for quantity in UNITS)
