"""Fields of a record, in SI: their keys in files and the unit of these (`radius_m` in
mm is `radius_mm`), bounds in it, checks.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, MISSING, Field, dataclass, field, fields
from functools import cache
from math import isfinite, log, nan
from numbers import Real
from sys import float_info
from typing import Any, TypeVar, get_type_hints

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import SI_PER_UNIT, HumanUnit, from_si, to_si

# text of one line, which may have letters of any language
LINE = re.compile(r"[^\x00-\x1f\x7f-\xa0\xad\u2028\u2029\ud800-\udfff]*\Z")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Choice:
    """One of `values`, all equally likely."""

    values: tuple[float, ...]

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` independent values, shape (count,)."""
        return rng.choice(np.asarray(self.values, dtype=np.float64), size=count)


@dataclass(frozen=True, kw_only=True)
class Range:
    """Uniform between `min` and `max`."""

    min: float
    max: float

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.min, self.max

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` independent values, shape (count,)."""
        return rng.uniform(self.min, self.max, size=count)


Sampled = Choice | Range


def fixed(value: float) -> Choice:
    """Return the sampled value that is always `value`."""
    return Choice((value,))


def draw(values: Sampled, rng: np.random.Generator) -> float:
    """Draw one value."""
    return float(values.sample(rng, 1)[0])


@dataclass(frozen=True)
class Unit:
    """A field's unit in TOML (None: SI or a plain number), bounds in that unit, allowed
    words.
    """

    name: HumanUnit | None = None
    _: KW_ONLY
    low: float | None = None
    high: float | None = None
    words: tuple[str, ...] = ()
    listed: bool = False  # a list of whole numbers, at least one
    note: str = field(default="", repr=False)  # what a study file says beside the key
    # a program has written it: its conversion is not rounded, its bounds have no slack
    exact: bool = field(default=False, repr=False)
    is_line: bool = field(default=False, repr=False)  # text without a line break

    def to_si(self, value: float) -> float:
        """Return a human value in SI, free of the last bit's rounding unless `exact`:
        400 um is 0.0004 m.
        """
        if self.name is None:
            return value
        found = to_si(value, self.name)
        return found if self.exact else float(f"{found:.15g}")

    def from_si(self, value: float) -> float:
        """Return an SI value in the human unit, free of the rounding of `to_si` unless
        `exact`: 58 deg come back as 58 deg.
        """
        if self.name is None:
            return value
        found = from_si(value, self.name)
        return found if self.exact else float(f"{found:.14g}")


@dataclass(frozen=True)
class TableForm:
    """How a field stands in a table of a file, where that is not one key of the field's
    own name and unit.

    `keys`: each key with the type of its value, as a hint, and its unit. `read` returns
    the field, of the values that are there by key, in SI and within the bounds of their
    units; it is called even where none is there. `write` returns the values of a field
    that is not None by key, in SI; None for a key that is left out. A file has to have
    the `needed` keys.
    """

    keys: Mapping[str, tuple[Any, Unit]]
    read: Callable[[Mapping[str, Any]], Any]
    write: Callable[[Any], Mapping[str, Any]]
    needed: tuple[str, ...] = ()


# A needle's force: the largest force of a study, more than a sclera bears before it is
# pierced.
NEEDLE_FORCE = Unit("mn", low=0.0, high=1000.0)
# Quantities of an eye, its needle and its pictures, with their possible values, ex vivo
# and in life. Options, keys of files and arguments of these names, in any unit, are
# checked against them (`allowed_bounds`).
QUANTITIES: Mapping[str, Unit] = {
    "thickness": Unit("um", low=100.0, high=3000.0),
    "youngs_modulus": Unit("mpa", low=0.001, high=50.0),
    "iop": Unit("mmhg", low=0.0, high=110.0),
    "gap": Unit("mm", low=0.0, high=10.0),
    "rigidity": Unit("mmhg13_per_ul", low=1e-4, high=1.0),
    "polar_angle": Unit("deg", low=0.0, high=90.0),
    "lean": Unit("deg", low=0.0, high=75.0),
    "width": Unit("mm", low=0.01, high=100.0),
    "depth": Unit("mm", low=0.01, high=100.0),
    "force": NEEDLE_FORCE,
    "displacement": Unit("mm", low=0.0, high=10.0),
}
WIDEST = 1e-4  # of the largest value: the smallest plausible value where 0 is allowed
# Units that are taken for one another, by the suffix of a key: each with its name and
# its size in SI.
_METRES = {"um": ("µm", 1e-6), "mm": ("mm", 1e-3), "m": ("m", 1.0)}
_PASCALS = {"pa": ("Pa", 1.0), "kpa": ("kPa", 1e3), "mpa": ("MPa", 1e6)}
_NEWTONS = {"un": ("µN", 1e-6), "mn": ("mN", 1e-3), "n": ("N", 1.0)}
_ANGLES = {"deg": ("°", SI_PER_UNIT["deg"][1]), "rad": ("rad", 1.0)}
_MERCURY = {"mmhg": ("mmHg", SI_PER_UNIT["mmhg"][1])}


def quantity(
    default: Any,
    unit: HumanUnit | None = None,
    low: float | None = None,
    high: float | None = None,
    note: str = "",
    *,
    key: str | None = None,
    absent: float | None = None,
) -> Any:
    """Declare a field: `default` and bounds in the human `unit`; a Choice or tuple of
    integers is a list of such. `key`: that of files, where it is not of the field's
    name; in "a.b", b is a key of the table a. `absent`: what a file without the key
    says, in SI; None: the default.
    """
    numbers = default.values if isinstance(default, Choice) else default
    listed = (
        isinstance(numbers, tuple)
        and numbers != ()
        and all(isinstance(each, int) for each in numbers)
    )
    spec = Unit(unit, low=low, high=high, listed=listed, note=note)

    return field(
        default=map_numbers(default, spec.to_si),
        metadata={"unit": spec, "key": key, "absent": absent},
    )


def option(default: str | None, *words: str, key: str | None = None) -> Any:
    """Declare a field that holds one of `words`; None if it may be left out. `key`:
    that of files, where it is not the field's name.
    """
    return field(default=default, metadata={"unit": Unit(words=words), "key": key})


def required(
    *words: str,
    low: float | None = None,
    high: float | None = None,
    key: str | None = None,
) -> Any:
    """Declare an SI field without a default: one of `words`, or a value between the
    bounds if they are given; `key` as in `quantity`.
    """
    spec = Unit(low=low, high=high, words=words)
    return field(metadata={"unit": spec, "key": key})


def computed(
    low: float | None,
    high: float | None,
    unit: HumanUnit | None = None,
    default: Any = MISSING,
    *,
    key: str | None = None,
) -> Any:
    """Declare a field that files have from a program: bounds in the human `unit`, which
    is converted without rounding; default in SI; `key` as in `quantity`.
    """
    spec = Unit(unit, low=low, high=high, exact=True)
    return field(default=default, metadata={"unit": spec, "key": key})


def one_line(default: Any = MISSING) -> Any:
    """Declare a field of text, or of several, without line breaks and the like."""
    return field(default=default, metadata={"unit": Unit(is_line=True)})


def needed(
    *, low: float | None = None, high: float | None = None, key: str | None = None
) -> Any:
    """Declare a field that files have to have, and that is None where a caller does not
    declare it.
    """
    spec = Unit(low=low, high=high)
    return field(default=None, metadata={"unit": spec, "key": key, "needed": True})


def formed(form: TableForm, default: Any = None) -> Any:
    """Declare a field that stands in files under the keys of a form."""
    return field(default=default, metadata={"form": form})


def not_in_files(default: Any = None) -> Any:
    """Declare a field that no file has."""
    return field(default=default, metadata={"form": None})


def declared(value: Value | None, name: str) -> Value:
    """Return a value that has to be declared; raises `InputError` with its name."""
    if value is None:
        raise InputError(f"{name}: not declared; give it")
    return value


def field_form(item: Field[Any]) -> TableForm | None:
    """Return the form of a field; None for one with a key of its own."""
    form: TableForm | None = item.metadata.get("form")
    return form


def in_files(item: Field[Any]) -> bool:
    """Return whether files have a field."""
    return "form" not in item.metadata or item.metadata["form"] is not None


def field_unit(item: Field[Any]) -> Unit:
    """Return the unit record of a dataclass field, a plain one by default."""
    unit: Unit = item.metadata.get("unit", Unit())
    return unit


@cache
def field_key(item: Field[Any]) -> str:
    """Return the key of a dataclass field in files: `radius_m` declared in mm is
    `radius_mm`, unless it was declared with a key.
    """
    unit = field_unit(item)
    if key := item.metadata.get("key"):
        return str(key)
    if unit.name is None:
        return item.name
    return item.name.removesuffix("_" + SI_PER_UNIT[unit.name][0]) + "_" + unit.name


def map_numbers(value: Any, change: Callable[[float], float]) -> Any:
    """Apply `change` to every number in a field's value (nested tuples, Choice and
    Range included).
    """
    if isinstance(value, Choice):
        return Choice(tuple(float(change(v)) for v in value.values))
    if isinstance(value, Range):
        return Range(min=float(change(value.min)), max=float(change(value.max)))
    if isinstance(value, tuple):
        return tuple(map_numbers(v, change) for v in value)
    if isinstance(value, float) or (
        isinstance(value, int) and not isinstance(value, bool)
    ):
        return change(value)

    return value


def _numbers_in(value: Any) -> list[float]:
    found: list[float] = []
    map_numbers(value, lambda number: found.append(number) or number)  # type: ignore[func-returns-value]
    return found


def _texts_in(value: Any) -> list[str]:
    if isinstance(value, tuple):
        return [text for each in value for text in _texts_in(each)]
    return [] if value is None else [value]


LARGEST = float_info.max


def check_fields(record: Any) -> None:
    """Check every field of a record against its bounds and words."""
    for name, key, unit, low, high, whole in _bounds_of(record.__class__):
        value = getattr(record, name)
        if value is None or (type(value) is float and low <= value <= high):
            continue  # the usual case, as records are made for each frame
        if whole is not None:
            value = _number(key, value, whole)
        check_value(key, value, unit)


def _number(key: str, value: object, whole: bool) -> float:
    """Return a number of any type, as NumPy's; raises a `StudyError` for what is
    none, or not a whole one.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise StudyError(
            f"{key}: found {type(value).__name__} {value!r:.40}; give a number"
        )
    number = float(value)
    if whole and number % 1.0:
        raise StudyError(f"{key}: {number:g}; give a whole number")
    return number


@cache
def _bounds_of(
    kind: type,
) -> tuple[tuple[str, str, Unit, float, float, bool | None], ...]:
    """Return name, key and unit of each field of a record, its bounds in SI, and
    whether its numbers are whole.

    The bounds are NaN, which nothing is within, where a value has to be looked at; the
    last is None of a field that holds more than one number.
    """
    hints = get_type_hints(kind)
    numbers = {float: False, float | None: False, int: True, int | None: True}
    found = []
    for item in fields(kind):
        unit = field_unit(item)
        low = -LARGEST if unit.low is None else unit.to_si(unit.low)
        high = LARGEST if unit.high is None else unit.to_si(unit.high)
        whole = numbers.get(hints[item.name])
        if unit.words or unit.listed or whole:
            low = high = nan
        # of a value in SI the name of its field, else the key whose unit it is in
        key = item.name if unit.name is None else field_key(item)
        found.append((item.name, key, unit, low, high, whole))
    return tuple(found)


def check_kind(name: str, value: object, kind: type, example: str) -> None:
    """Raise a `StudyError` unless the value of a field is a record of a kind, or
    None.
    """
    if value is not None and not isinstance(value, kind):
        raise StudyError(
            f"{name}: found {type(value).__name__} {value!r:.40}; give a"
            f" {kind.__name__}, like {example}"
        )


def check_value(key: str, value: Any, unit: Unit) -> None:
    """Check the value of a key, in SI, against the bounds and words of its unit."""
    if unit.words and value is not None and value not in unit.words:
        raise StudyError(f"{key}: {value!r} is not one of {', '.join(unit.words)}")
    if unit.is_line and not all(LINE.match(text) for text in _texts_in(value)):
        raise StudyError(f"{key}: expected a text of one line, found {value!r:.60}")
    if isinstance(value, Range) and value.min > value.max:
        raise StudyError(f"{key}: min is larger than max")
    if (isinstance(value, Choice) and not value.values) or (
        unit.listed and value == ()
    ):
        raise StudyError(f"{key}: an empty list; give at least one value")
    if unit.listed and (
        isinstance(value, Range) or any(number % 1.0 for number in _numbers_in(value))
    ):
        raise StudyError(f"{key}: give a list of whole numbers, like [0, 1, 2]")

    for number in _numbers_in(value):
        check_number(key, unit.from_si(number), unit)


class StudySection:
    """A section of a study: every field is within its bounds from the start, and they
    fit together (`_check`).
    """

    def __post_init__(self) -> None:
        check_fields(self)
        self._check()

    def _check(self) -> None:
        """Raise a `StudyError` if fields do not fit together."""


def check_number(key: str, number: float, unit: Unit) -> None:
    """Check one number, in the unit of its key."""
    slack = 0.0 if unit.exact else 1e-9 * max(abs(number), 1.0)
    if not isfinite(number):
        raise StudyError(f"{key}: {number} is not a finite number")

    for end, side, words in (
        (unit.low, -1.0, "below the smallest"),
        (unit.high, 1.0, "above the largest"),
    ):
        if end is not None and side * (number - end) > slack:
            raise StudyError(
                f"{key}: {number:g} is {words} allowed value"
                f" {end:g}{did_you_mean(key, number, unit)}"
            )


def check_quantity(key: str, number: float) -> None:
    """Check a number of `QUANTITIES`, in the unit of its key.

    >>> check_quantity("thickness_um", 0.65)
    Traceback (most recent call last):
    scleraforce.base.errors.StudyError: thickness_um: 0.65 is below the smallest \
allowed value 100; did you mean 650 µm (0.65 mm)?
    """
    check_number(key, number, allowed_bounds(key))


def allowed_bounds(key: str) -> Unit:
    """Return the bounds of one of `QUANTITIES` in the unit of a key; the unit of the
    result has no name.

    >>> allowed_bounds("thickness_m"), allowed_bounds("iop_mmhg").high
    (Unit(name=None, low=0.0001, high=0.003, words=(), listed=False), 110.0)
    """
    name = next(
        name for name in QUANTITIES if key == name or key.startswith(f"{name}_")
    )
    spec = QUANTITIES[name]
    suffix = key[len(name) + 1 :]
    assert spec.name is not None

    if suffix in ("", spec.name):
        return Unit(low=spec.low, high=spec.high)

    assert suffix == SI_PER_UNIT[spec.name][0], f"{key}: give it in {spec.name} or SI"
    assert spec.low is not None and spec.high is not None  # noqa: PT018
    return Unit(low=spec.to_si(spec.low), high=spec.to_si(spec.high))


def did_you_mean(key: str, number: float, unit: Unit) -> str:
    """Return "; did you mean ...?" if a number outside its bounds is inside them in a
    unit that is often mixed up.

    >>> did_you_mean("youngs_modulus_mpa", 300.0, allowed_bounds("youngs_modulus_mpa"))
    '; did you mean 0.3 MPa (300 kPa)?'
    """
    suffix = key.rpartition("_")[2]
    pressures = _MERCURY | _PASCALS if "iop" in key else _PASCALS
    family = next(
        (units for units in (_METRES, pressures, _NEWTONS, _ANGLES) if suffix in units),
        {},
    )

    if unit.high is None:
        return ""

    low = max(unit.low or 0.0, WIDEST * unit.high)
    high = unit.high
    values = {
        name: number * size / family[suffix][1]
        for other, (name, size) in family.items()
        if other != suffix
    }

    inside = {name: value for name, value in values.items() if low <= value <= high}
    if not inside:
        return ""

    # the middle is likeliest
    name = min(inside, key=lambda name: abs(log(inside[name] ** 2 / (low * high))))
    return f"; did you mean {inside[name]:.4g} {family[suffix][0]} ({number:g} {name})?"


LONGEST_ID = 200


def optional_quantity(
    name: str, unit: HumanUnit | None = None, *, key: str | None = None
) -> Any:
    """Return a field that may be missing, within the bounds allowed for its name
    (`allowed_bounds`); `key` as in `quantity`.
    """
    bounds = allowed_bounds(name)
    return quantity(None, unit, bounds.low, bounds.high, key=key)


def name_fault(name: str, what: str = "eye") -> str | None:
    """Return why a text cannot name an eye or a plane in a table, log or message, None
    if it can.
    """
    if not name.strip():
        return f"empty; give the {what} a name"
    if not name.isprintable():
        return (
            f"{name[:LONGEST_ID]!r} has a line break or another unprintable character;"
            " give a name of one line"
        )
    if len(name) > LONGEST_ID:
        return f"{len(name)} characters; give the {what} a name of at most {LONGEST_ID}"

    return None
