"""Read and write a study as TOML; an unknown key, a wrong type or a value out of bounds is an error with its line."""

import hashlib
import re
import reprlib
import tomllib
from collections import Counter
from dataclasses import MISSING, fields, is_dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from scleraforce.errors import StudyError
from scleraforce.study.fields import Choice, Range, field_key, field_unit, map_numbers
from scleraforce.study.records import Study
from scleraforce.study.scenes import ScenesStudy
from scleraforce.whole_files import KINDS, read_text

Record = TypeVar("Record")
# Of keys and tables, by their path and the number of the table of its name of a key, 0 outside of any.
Lines = dict[tuple[tuple[str, ...], int], int]

MAX_ENTRIES = 1000  # of a list
MAX_WHOLE = 10**15  # what a float holds exactly

# Studies to begin from, by name: their files beside this one. The first is the default, the paper's.
PRESETS = ("ex-vivo", "living")
PRESET_FILES = dict(zip(PRESETS, ("paper.toml", "living.toml"), strict=True))


SCENES_TABLE = "[scenes]"  # in a preset: stands for all of its keys, which are explained in `scenes`


def preset_toml(name: str) -> str:
    """Return the text of a preset.

    >>> parse_study(preset_toml("living")).eye.youngs_modulus_pa
    1800000.0
    """
    text = files("scleraforce.study").joinpath(PRESET_FILES[name]).read_text(encoding="utf-8")
    return text.replace(SCENES_TABLE, _format_section("scenes", ScenesStudy(), noted=True))


def read_study(path: str | PathLike[str]) -> Study:
    """Read a study file.

    Raises:
        StudyError: the file is missing or not TOML, or a key or value in it cannot be used.

    >>> import scleraforce as sf
    >>> sf.read_study("study.toml").eye.radius_m
    0.012
    """
    return parse_study(read_text(Path(path), KINDS["study"]), str(path))


def parse_study(text: str, name: str = "study") -> Study:
    r"""Read a study from TOML text; `name` is for messages.

    >>> import scleraforce as sf
    >>> sf.parse_study('[eye]\nradius_mm = 11.0').eye.radius_m
    0.011

    Raises:
        StudyError: naming the file, the line and the key.
    """
    return parse_record(Study, text, name)


def parse_record(kind: type[Record], text: str, name: str) -> Record:
    """Read a record of sections from TOML; a field with a default, or that can be None, may be missing."""
    try:
        table = tomllib.loads(text)
    except ValueError as fault:  # tomllib.TOMLDecodeError, and what Python says of numbers of thousands of digits
        raise StudyError(f"{name}: not TOML: {fault}") from fault
    except RecursionError as fault:
        raise StudyError(f"{name}: not TOML: nested too deep") from fault
    record = _record(kind, table, (), _lines(text), name)
    assert isinstance(record, kind)
    return record


def format_study(study: Study) -> str:
    """Write a study as TOML that `parse_study` reads back to an equal record."""
    return format_record(study)


def format_record(record: Any) -> str:
    """Write a record of sections as TOML that `parse_record` reads back to an equal one; None is left out."""
    sections = [(item.name, getattr(record, item.name)) for item in fields(record)]
    return "\n\n".join(_format_section(name, section) for name, section in sections if section is not None) + "\n"


def study_hash(study: Study) -> str:
    """Return the SHA-256 of a study's canonical TOML, in hexadecimal."""
    return hashlib.sha256(format_study(study).encode()).hexdigest()


def _record(kind: type, table: dict[str, Any], path: tuple[str, ...], lines: Lines, name: str, nth: int = 1) -> object:
    hints = get_type_hints(kind)
    known = {field_key(item): item for item in fields(kind)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        place = f"{name}:{_line(lines, (*path, key), nth)}: {'.'.join((*path, key))}"
        if key not in known:
            raise StudyError(f"{place}: unknown key; known here: {', '.join(known)}")
        item = known[key]
        hint = hints[item.name]
        if isinstance(hint, UnionType) and len(kinds := [kind for kind in get_args(hint) if kind is not NoneType]) == 1:
            hint = kinds[0]
        if is_dataclass(hint):
            if not isinstance(value, dict):
                raise StudyError(f"{place}: expected a table [{key}]")
            values[item.name] = _record(hint, value, (*path, key), lines, name)  # type: ignore[arg-type]  # a class
        elif get_origin(hint) is tuple and is_dataclass(get_args(hint)[0]):
            values[item.name] = _records(get_args(hint)[0], value, (*path, key), lines, name, place)
        else:
            values[item.name] = map_numbers(_value(hint, value, place), field_unit(item).to_si)
    missing = [
        key
        for key, item in known.items()
        if item.name not in values and item.default is MISSING and item.default_factory is MISSING
    ]
    if missing:
        place = f"{name}:{_line(lines, path, nth)}" if path else name
        raise StudyError(f"{place}: {'.'.join((*path, missing[0]))}: missing")
    try:
        return kind(**values)
    except StudyError as fault:
        key = str(fault).partition(":")[0]
        raise StudyError(f"{name}:{_line(lines, (*path, key), nth)}: {'.'.join((*path, ''))}{fault}") from None


def _records(kind: Any, value: Any, path: tuple[str, ...], lines: Lines, name: str, place: str) -> tuple[object, ...]:
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise StudyError(f"{place}: expected a list of tables [[{'.'.join(path)}]]")
    _check_length(value, place)
    return tuple(_record(kind, entry, path, lines, name, nth) for nth, entry in enumerate(value, start=1))


def _value(hint: Any, value: Any, place: str) -> Any:
    if isinstance(hint, UnionType) and Range in get_args(hint):
        return _sampled(value, place)
    if get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise StudyError(f"{place}: expected a list")
        _check_length(value, place)
        return tuple(_value(get_args(hint)[0], entry, place) for entry in value)
    return _scalar(hint, value, place)


def _sampled(value: Any, place: str) -> Choice | Range:
    if isinstance(value, dict):
        if set(value) != {"min", "max"}:
            raise StudyError(f"{place}: a range is {{ min = a, max = b }}")
        return Range(min=_scalar(float, value["min"], place), max=_scalar(float, value["max"], place))
    entries = value if isinstance(value, list) else [value]
    _check_length(entries, place)
    return Choice(tuple(_scalar(float, entry, place) for entry in entries))


def _check_length(entries: list[Any], place: str) -> None:
    if len(entries) > MAX_ENTRIES:
        raise StudyError(f"{place}: {len(entries)} entries; at most {MAX_ENTRIES} are allowed")


def _scalar(kind: type, value: Any, place: str) -> Any:
    if isinstance(value, int) and abs(value) > MAX_WHOLE:
        raise StudyError(f"{place}: a number of more than {len(str(MAX_WHOLE)) - 1} digits")
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        names = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
        raise StudyError(f"{place}: expected {names.get(kind, kind.__name__)}, found {reprlib.repr(value)}")
    return value


def _lines(text: str) -> Lines:
    """Return the lines of all keys and tables of TOML text, in one pass; the first of one name."""
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
    """Return the line of a key or table, in the nth table of its name (1 if it is not known)."""
    return min((lines[path, table] for table in (0, nth) if (path, table) in lines), default=1)


def _format_section(name: str, record: Any, noted: bool = False) -> str:
    lines, groups = [f"[{name}]"], []
    for item in fields(record):
        value = getattr(record, item.name)
        if isinstance(value, tuple) and value and is_dataclass(value[0]):
            groups += [_format_section(f"[{name}.{item.name}]", entry) for entry in value]
        elif is_dataclass(value) and not isinstance(value, Choice | Range):
            groups.append(_format_section(f"{name}.{item.name}", value, noted))
        elif value is not None:
            unit = field_unit(item)
            line = f"{field_key(item)} = {_format_value(map_numbers(value, unit.from_si))}"
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
