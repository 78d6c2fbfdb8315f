"""TOML to records and back, with errors that name the field and its line."""

import dataclasses  # whose `fields` would be hidden by the module of that name here
import re
import reprlib
import tomllib
from collections import Counter
from dataclasses import MISSING, is_dataclass
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from scleraforce.base.errors import StudyError
from scleraforce.records.fields import (
    Choice,
    Range,
    field_key,
    field_unit,
    map_numbers,
)

Record = TypeVar("Record")

# Of keys and tables, by their path and the number of the table of its name of a key, 0
# outside of any.
Lines = dict[tuple[tuple[str, ...], int], int]

MAX_ENTRIES = 1000  # of a list
MAX_WHOLE = 10**15  # what a float holds exactly

# Most parts of a dotted key. The time to parse one grows with the square of their
# number; ours have two.
DEPTH = 20
PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DEEP_KEY = re.compile(rf"(?<![\w-]){PART}(?:[ \t]*+\.[ \t]*+{PART}){{{DEPTH}}}")


def parse_record(kind: type[Record], text: str, name: str) -> Record:
    """Read a record of sections from TOML; a field with a default, or that can be None,
    may be missing.
    """
    if deep := DEEP_KEY.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise StudyError(f"{name}:{line}: a key of more than {DEPTH} parts")

    try:
        table = tomllib.loads(text)
    except ValueError as fault:
        # tomllib.TOMLDecodeError, and what Python says of numbers of thousands of
        # digits
        raise StudyError(f"{name}: not TOML: {fault}") from fault
    except RecursionError as fault:
        raise StudyError(f"{name}: not TOML: nested too deep") from fault

    record = _record(kind, table, (), _lines(text), name)
    assert isinstance(record, kind)
    return record


def format_record(record: Any) -> str:
    """Write a record of sections as TOML that `parse_record` reads back to an equal
    one; None is left out.
    """
    sections = [
        (item.name, getattr(record, item.name)) for item in dataclasses.fields(record)
    ]
    return (
        "\n\n".join(
            format_section(name, section)
            for name, section in sections
            if section is not None
        )
        + "\n"
    )


def _record(
    kind: type,
    table: dict[str, Any],
    path: tuple[str, ...],
    lines: Lines,
    name: str,
    nth: int = 1,
) -> object:
    hints = get_type_hints(kind)
    known = {field_key(item): item for item in dataclasses.fields(kind)}
    values: dict[str, Any] = {}

    for key, value in table.items():
        place = f"{name}:{_line(lines, (*path, key), nth)}: {'.'.join((*path, key))}"
        if key not in known:
            raise StudyError(f"{place}: unknown key; known here: {', '.join(known)}")

        item = known[key]
        hint = hints[item.name]
        if (
            isinstance(hint, UnionType)
            and len(kinds := [kind for kind in get_args(hint) if kind is not NoneType])
            == 1
        ):
            hint = kinds[0]

        if is_dataclass(hint):
            if not isinstance(value, dict):
                raise StudyError(f"{place}: expected a table [{key}]")

            values[item.name] = _record(hint, value, (*path, key), lines, name)  # type: ignore[arg-type]  # a class
        elif get_origin(hint) is tuple and is_dataclass(get_args(hint)[0]):
            tables = _entries(
                value, place, f"a list of tables [[{'.'.join((*path, key))}]]", dict
            )
            values[item.name] = tuple(
                _record(get_args(hint)[0], entry, (*path, key), lines, name, number)
                for number, entry in enumerate(tables, start=1)
            )
        else:
            values[item.name] = map_numbers(
                _value(hint, value, place), field_unit(item).to_si
            )

    for key, item in known.items():
        if (
            item.name not in values
            and item.default is MISSING
            and item.default_factory is MISSING
        ):
            place = f"{name}:{_line(lines, path, nth)}" if path else name
            raise StudyError(f"{place}: {'.'.join((*path, key))}: missing")

    try:
        return kind(**values)
    except StudyError as fault:
        key = str(fault).partition(":")[0]
        raise StudyError(
            f"{name}:{_line(lines, (*path, key), nth)}: {'.'.join((*path, ''))}{fault}"
        ) from None


def _value(hint: Any, value: Any, place: str) -> Any:
    if get_origin(hint) is tuple:
        return tuple(
            _value(get_args(hint)[0], entry, place) for entry in _entries(value, place)
        )
    if not (isinstance(hint, UnionType) and Range in get_args(hint)):
        return _scalar(hint, value, place)
    if not isinstance(value, dict):
        return Choice(
            _value(
                tuple[float, ...], value if isinstance(value, list) else [value], place
            )
        )
    if set(value) != {"min", "max"}:
        raise StudyError(f"{place}: a range is {{ min = a, max = b }}")

    return Range(
        **{end: _scalar(float, number, place) for end, number in value.items()}
    )


def _entries(
    value: Any, place: str, wanted: str = "a list", kind: type = object
) -> list[Any]:
    """Return the entries of a list, each of a kind."""
    if not isinstance(value, list) or not all(
        isinstance(entry, kind) for entry in value
    ):
        raise StudyError(f"{place}: expected {wanted}")
    if len(value) > MAX_ENTRIES:
        raise StudyError(
            f"{place}: {len(value)} entries; at most {MAX_ENTRIES} are allowed"
        )

    return value


def _scalar(kind: type, value: Any, place: str) -> Any:
    if isinstance(value, int) and abs(value) > MAX_WHOLE:
        raise StudyError(
            f"{place}: a number of more than {len(str(MAX_WHOLE)) - 1} digits"
        )
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        names = {
            float: "a number",
            int: "a whole number",
            str: "a text",
            bool: "true or false",
        }
        raise StudyError(
            f"{place}: expected {names.get(kind, kind.__name__)}, found"
            f" {reprlib.repr(value)}"
        )

    return value


def _lines(text: str) -> Lines:
    """Return the lines of all keys and tables of TOML text, in one pass; the first of
    one name.
    """
    table: tuple[str, ...] = ()
    seen: Counter[tuple[str, ...]] = Counter()
    found: Lines = {}

    for number, line in enumerate(text.splitlines(), start=1):
        if header := re.match(r"\s*\[\[?\s*([\w.\- ]+?)\s*\]\]?", line):
            table = tuple(part.strip() for part in header[1].split("."))
            seen[table] += 1
            found.setdefault((table, 0), number)
        if key := re.match(r"\s*([\w.\-]+)\s*=", line):
            found.setdefault(((*table, *key[1].split(".")), seen[table]), number)

    return found


def _line(lines: Lines, path: tuple[str, ...], nth: int) -> int:
    """Return the line of a key or table, in the nth table of its name (1 if it is not
    known).
    """
    return min(
        (lines[path, table] for table in (0, nth) if (path, table) in lines), default=1
    )


def format_section(name: str, record: Any, noted: bool = False) -> str:
    """Write a section as TOML; `noted`: with what each field means."""
    lines = [f"[{name}]"]
    groups = []

    for item in dataclasses.fields(record):
        value = getattr(record, item.name)
        if isinstance(value, tuple) and value and is_dataclass(value[0]):
            groups += [
                format_section(f"[{name}.{item.name}]", entry) for entry in value
            ]
        elif is_dataclass(value) and not isinstance(value, Choice | Range):
            groups.append(format_section(f"{name}.{item.name}", value, noted))
        elif value is not None:
            unit = field_unit(item)
            line = (
                f"{field_key(item)} = {_format_value(map_numbers(value, unit.from_si))}"
            )
            lines.append(f"{line:<51} # {unit.note}" if noted and unit.note else line)

    return "\n".join(["\n".join(lines), *groups])


def _format_value(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        case Range():
            return f"{{ min = {value.min!r}, max = {value.max!r} }}"
        case Choice():
            return _format_value(value.values)
        case tuple():
            return "[" + ", ".join(_format_value(entry) for entry in value) + "]"
        case _:
            return repr(value)
