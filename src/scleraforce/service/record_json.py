"""Frozen records as JSON objects and back, checked field by field; anything else raises MessageError.

A field may hold a `bool`, `int`, `float`, `str`, `Path`, one of some words (`Literal`), another record, a tuple of one
of these, or any of them or None. JSON has a list for a tuple and a text for a path. Numbers may be NaN or infinite:
receivers check them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from scleraforce.errors import MessageError, ScleraforceError

Record = TypeVar("Record")
Conversion = Callable[[Any], Any]

SHOWN = 60  # characters of a value, in a message


def record_as_json(record: Any) -> dict[str, Any]:
    """Return a record as a JSON object: its fields by name. A record in it with an `as_json` makes its own object.

    Raises:
        MessageError: a field holds a value of another type than it states; the message names it.

    >>> from scleraforce.recording.pixels import PixelScale
    >>> record_as_json(PixelScale(lateral_m=29e-6, depth_m=8e-6))
    {'lateral_m': 2.9e-05, 'depth_m': 8e-06, 'refractive_index': 1.0}
    """
    found: dict[str, Any] = {}
    for name, form in _forms(record.__class__).items():
        value = getattr(record, name)
        found[name] = value if type(value) in form.plain else _named(name, form.write, value)
    return found


def record_of_json(kind: type[Record], value: Any) -> Record:
    """Return the record of a JSON object, which must have each field of `kind` and no other.

    A record in it with a `from_json` reads its own object.

    Raises:
        MessageError: a field is missing, unknown, of another type or beyond its bounds; the message names it.

    >>> from scleraforce.recording.pixels import PixelScale
    >>> record_of_json(PixelScale, {"lateral_m": 2, "depth_m": "8", "refractive_index": 1.0})
    Traceback (most recent call last):
    scleraforce.errors.MessageError: depth_m: '8'; must be a number
    """
    record: Any = kind  # mypy takes no class as hashable
    forms = _forms(record)
    if not isinstance(value, dict) or value.keys() != forms.keys():
        raise MessageError(_wrong_keys(forms, value))
    found: dict[str, Any] = {}
    for name, form in forms.items():
        entry = value[name]
        found[name] = entry if type(entry) in form.plain else _named(name, form.read, entry)
    try:
        return kind(**found)
    except (ScleraforceError, ValueError, OverflowError) as fault:  # a record checks its bounds by itself
        raise MessageError(str(fault)) from fault


@dataclass(frozen=True)
class _Form:
    """How a type stands in JSON.

    Attributes:
        plain: types of values that are the same in both.
        write: makes JSON of any other value, or raises MessageError.
        read: likewise, of JSON.
    """

    plain: frozenset[type]
    write: Conversion
    read: Conversion


@cache
def _forms(kind: type[Any]) -> Mapping[str, _Form]:
    """Return the form of each field of a record."""
    hints = get_type_hints(kind)
    return MappingProxyType({field.name: _form(hints[field.name]) for field in fields(kind)})


def _form(hint: Any) -> _Form:
    """Return the form of a type of field."""
    arguments = get_args(hint)
    if isinstance(hint, UnionType):
        (one,) = (_form(argument) for argument in arguments if argument is not NoneType)
        return replace(one, plain=one.plain | {NoneType})
    if get_origin(hint) is tuple and arguments[-1] is Ellipsis:
        return _list_form(_form(arguments[0]), None)
    if get_origin(hint) is tuple:
        (one,) = (_form(argument) for argument in set(arguments))
        return _list_form(one, len(arguments))
    if get_origin(hint) is Literal:
        return _word_form(arguments)
    return _record_form(hint) if is_dataclass(hint) else FORMS[hint]


def _word_form(words: tuple[str, ...]) -> _Form:
    """Return the form of a text that is one of some words."""

    def checked(value: Any) -> str:
        if isinstance(value, str) and value in words:
            return value
        raise MessageError(f"{_shown(value)}; must be {', '.join(words[:-1])} or {words[-1]}")

    return _Form(frozenset(), checked, checked)


def _list_form(one: _Form, length: int | None) -> _Form:
    """Return the form of a tuple, of any length for None."""
    lists = "a list" if length is None else f"a list of {length}"

    def converted(values: Any, convert: Conversion) -> tuple[Any, ...]:
        if not isinstance(values, (tuple, list)) or len(values) != (len(values) if length is None else length):
            raise MessageError(f"{_shown(values)}; must be {lists}")
        if set(map(type, values)) <= one.plain:
            return tuple(values)
        return tuple([value if type(value) in one.plain else convert(value) for value in values])

    return _Form(frozenset(), lambda values: converted(values, one.write), lambda values: converted(values, one.read))


def _record_form(kind: Any) -> _Form:
    as_json = getattr(kind, "as_json", record_as_json)
    from_json = getattr(kind, "from_json", None) or (lambda value: record_of_json(kind, value))

    def write(value: Any) -> Any:
        if not isinstance(value, kind):
            raise MessageError(f"{_shown(value)}; must be a record {kind.__name__}")
        return as_json(value)

    return _Form(frozenset(), write, from_json)


def _bool(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    raise MessageError(f"{_shown(value)}; must be true or false")


def _int(value: Any) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    raise MessageError(f"{_shown(value)}; must be an integer")


def _float(value: Any) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    raise MessageError(f"{_shown(value)}; must be a number")


def _str(value: Any) -> str:
    if isinstance(value, str):
        return value
    raise MessageError(f"{_shown(value)}; must be a text")


def _path_text(value: Any) -> str:
    if isinstance(value, Path):
        return str(value)
    raise MessageError(f"{_shown(value)}; must be a path")


FORMS: Mapping[type, _Form] = MappingProxyType(
    {
        bool: _Form(frozenset({bool}), _bool, _bool),
        int: _Form(frozenset({int}), _int, _int),
        float: _Form(frozenset({float}), _float, _float),
        str: _Form(frozenset({str}), _str, _str),
        Path: _Form(frozenset(), _path_text, lambda value: Path(_str(value))),
    }
)


def _named(name: str, convert: Conversion, value: Any) -> Any:
    """Convert a value of a field; name the field in a MessageError."""
    try:
        return convert(value)
    except MessageError as fault:
        raise MessageError(f"{name}: {fault}") from fault


def _wrong_keys(expected: Mapping[str, _Form], value: Any) -> str:
    if not isinstance(value, dict):
        return f"{_shown(value)}; must be an object"
    missing = ", ".join(name for name in expected if name not in value)
    unknown = ", ".join(_shown(name) for name in value if name not in expected)
    return "; ".join(f"{what} {names}" for what, names in (("without", missing), ("unknown:", unknown)) if names)


def _shown(value: Any) -> str:
    """Return a value for a message, cut where it is long."""
    if isinstance(value, (list, tuple, dict)):
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value)}"
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
