"""Fields of a study record: units, bounds and their check, in one place for all sections.

A record keeps SI; a field made by `quantity` knows the human unit of its TOML key. `radius_m` with unit `mm` is
`radius_mm` in the file, and its bounds are given and reported in that unit.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, Field, dataclass, field, fields
from functools import cache
from math import isfinite
from typing import Any

from scleraforce.errors import StudyError
from scleraforce.study.sampled import Choice, Range
from scleraforce.units import SI_PER_UNIT, HumanUnit, from_si, to_si


@dataclass(frozen=True)
class Unit:
    """How a field reads in TOML: its unit (None: as it is), bounds in that unit, allowed words."""

    name: HumanUnit | None = None
    _: KW_ONLY
    low: float | None = None
    high: float | None = None
    words: tuple[str, ...] = ()

    def to_si(self, value: float) -> float:
        """Return a human value in SI, free of the last bit's rounding: 400 um is 0.0004 m."""
        return float(f"{to_si(value, self.name):.15g}") if self.name else value

    def from_si(self, value: float) -> float:
        """Return an SI value in the human unit, free of the rounding of `to_si`: 58 deg come back as 58 deg."""
        return float(f"{from_si(value, self.name):.14g}") if self.name else value


PLAIN = Unit()  # of a field that declares none
# Of a needle's force: what every force of a study may be at most, and more than a sclera bears before it is pierced.
NEEDLE_FORCE = Unit("mn", low=0.0, high=1000.0)


def quantity(default: Any, unit: HumanUnit | None = None, low: float | None = None, high: float | None = None) -> Any:
    """Declare a field: `default` in the human `unit` (a number, tuple, Choice or Range), bounds in the same unit."""
    spec = Unit(unit, low=low, high=high)
    return field(default=map_numbers(default, spec.to_si), metadata={"unit": spec})


def option(default: str | None, *words: str) -> Any:
    """Declare a field that holds one of `words`; None where it may be left out."""
    return field(default=default, metadata={"unit": Unit(words=words)})


def required(*words: str, low: float | None = None, high: float | None = None) -> Any:
    """Declare an SI field without a default: one of `words`, or a value between the bounds where they are given."""
    return field(metadata={"unit": Unit(low=low, high=high, words=words)})


def field_unit(item: Field[Any]) -> Unit:
    """Return the unit record of a dataclass field (a plain one where none was declared)."""
    unit: Unit = item.metadata.get("unit", PLAIN)
    return unit


@cache
def field_key(item: Field[Any]) -> str:
    """Return the TOML key of a dataclass field: `radius_m` declared in mm is `radius_mm`."""
    unit = field_unit(item)
    if unit.name is None:
        return item.name
    return item.name.removesuffix("_" + SI_PER_UNIT[unit.name][0]) + "_" + unit.name


def map_numbers(value: Any, change: Callable[[float], float]) -> Any:
    """Apply `change` to every number in a field's value (nested tuples, Choice and Range included)."""
    if isinstance(value, Choice):
        return Choice(tuple(float(change(v)) for v in value.values))
    if isinstance(value, Range):
        return Range(min=float(change(value.min)), max=float(change(value.max)))
    if isinstance(value, tuple):
        return tuple(map_numbers(v, change) for v in value)
    if isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool)):
        return change(value)
    return value


def _numbers_in(value: Any) -> list[float]:
    """Return every number in a field's value."""
    found: list[float] = []

    def keep(number: float) -> float:
        found.append(number)
        return number

    map_numbers(value, keep)
    return found


def check_fields(record: Any) -> None:
    """Check every field of a record against its bounds and words.

    Raises:
        StudyError: naming the TOML key, what was found and what is allowed.
    """
    for item in fields(record):
        unit, value = field_unit(item), getattr(record, item.name)
        if unit.words and value is not None and value not in unit.words:
            raise StudyError(f"{field_key(item)}: {value!r} is not one of {', '.join(unit.words)}")
        if isinstance(value, Range) and value.min > value.max:
            raise StudyError(f"{field_key(item)}: min is larger than max")
        if isinstance(value, Choice) and not value.values:
            raise StudyError(f"{field_key(item)}: an empty list; give at least one value")
        for number in _numbers_in(value):
            check_number(field_key(item), unit.from_si(number), unit)


def check_number(key: str, number: float, unit: Unit) -> None:
    """Check one number, in the unit of its key."""
    slack = 1e-9 * max(abs(number), 1.0)
    if not isfinite(number):
        raise StudyError(f"{key}: {number} is not a finite number")
    if unit.low is not None and number < unit.low - slack:
        raise StudyError(f"{key}: {number:g} is below the smallest allowed value {unit.low:g}")
    if unit.high is not None and number > unit.high + slack:
        raise StudyError(f"{key}: {number:g} is above the largest allowed value {unit.high:g}")
