"""Plain content of files to records, with errors that name file, line and field; TOML
and back.
"""

import dataclasses  # whose `fields` would be hidden by the module of that name here
import re
import reprlib
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, is_dataclass, replace
from functools import cache, reduce
from itertools import repeat
from operator import or_
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from scleraforce.base.errors import StudyError
from scleraforce.base.plain_json import parse_json
from scleraforce.records.fields import (
    LINE,
    Choice,
    Range,
    TableForm,
    Unit,
    check_value,
    field_form,
    field_key,
    field_unit,
    in_files,
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


Path = tuple[str | int, ...]  # of a value: keys, and numbers of entries of lists


@dataclass(frozen=True)
class Source:
    """A file whose content is decoded: its name, and the lines of its keys if it is
    TOML, which people write: it has no key that a record lacks, and no long list. None:
    JSON.
    """

    name: str
    lines: Lines | None = None

    def place(self, path: Path, missing: bool = False) -> str:
        """Return file, line and path of a value, for messages; `missing`: its last key
        is not there.

        The line is that of the table where a key is missing, and 1 where it is not
        known; one that is missing in the file has none.
        """
        if self.lines is None:
            words = [f"[{key}]" if isinstance(key, int) else f".{key}" for key in path]
            text = "".join(words).removeprefix(".")
            if not text.isprintable():
                text = ascii(text)
            return f"{self.name}: {text}" if text else self.name

        keys = tuple(key for key in path if isinstance(key, str))
        text = ".".join(keys)
        keys = keys[:-1] if missing else keys
        if not keys:
            return f"{self.name}: {text}"

        nth = 1 + max((key for key in path if isinstance(key, int)), default=0)
        line = min(
            (self.lines[keys, of] for of in (0, nth) if (keys, of) in self.lines),
            default=1,
        )
        return f"{self.name}:{line}: {text}"


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

    return decode_record(kind, table, Source(name, _lines(text)))


def parse_json_record(kind: type[Record], text: str | bytes, name: str) -> Record:
    """Read a record from JSON, which a program has written: keys that it does not have
    are passed over.
    """
    try:
        content = parse_json(text)
    except ValueError as fault:
        raise StudyError(f"{name}: {fault}") from fault

    source = Source(name)
    return decode_record(kind, _table(content, source, ()), source)


def decode_record(
    kind: type[Record], table: Mapping[str, Any], source: Source, path: Path = ()
) -> Record:
    """Return the record of a table of a file; a field with a default may be missing.
    Raises a `StudyError` with the place of what is wrong.
    """
    plan = _plan(cast(type, kind))
    keys = plan.keys
    values: dict[str, Any] = {}
    formed: dict[str, dict[str, Any]] = {name: {} for name in plan.forms}
    if plan.tables:
        table = _without_tables(table, plan.tables, source, path)

    for key, value in table.items():
        known = keys.get(key)
        if known is not None:
            found = known.read(value, source, (*path, key))
            if known.own:
                values[known.name] = found
            else:
                formed[known.name][key] = found
        elif source.lines is not None:
            raise StudyError(
                f"{source.place((*path, key))}: unknown key; known here:"
                f" {', '.join(keys)}"
            )

    for key in plan.required:
        if key not in table:
            raise StudyError(f"{source.place((*path, key), missing=True)}: missing")
    values |= {name: value for key, name, value in plan.absent if key not in table}

    try:
        for name, form in plan.forms.items():
            values[name] = form.read(formed[name])

        return kind(**values)
    except StudyError as fault:
        name, _, rest = str(fault).partition(":")
        key = plan.key_of.get(name, name)
        known = keys.get(key)
        is_missing = known is not None and key not in table and not known.own
        place = source.place((*path, key), missing=is_missing)
        raise StudyError(f"{place}:{rest}" if rest else place) from None


# Returns a value of a file in SI and within its bounds.
Read = Callable[[Any, Source, Path], Any]


@dataclass(frozen=True)
class _Key:
    """A key of a table: the name of its field, and what reads its value; `own`: the
    field has no other key.
    """

    name: str
    read: Read
    own: bool


@dataclass(frozen=True)
class _Plan:
    """The table of a record: its keys in the order of fields, the forms of fields by
    their names, the key of each field that has one, the keys that it has to have, key,
    field and value of those whose absence says something, and tables in it that hold
    fields of the record.
    """

    keys: Mapping[str, _Key]
    forms: Mapping[str, TableForm]
    key_of: Mapping[str, str]
    required: tuple[str, ...]
    absent: tuple[tuple[str, str, float], ...]
    tables: frozenset[str]


@cache
def _plan(kind: type) -> _Plan:
    hints = get_type_hints(kind)
    items = [item for item in dataclasses.fields(kind) if in_files(item)]
    keys: dict[str, _Key] = {}
    forms: dict[str, TableForm] = {}
    required: list[str] = []
    absent: list[tuple[str, str, float]] = []

    for item in items:
        form = field_form(item)
        if form is not None:
            forms[item.name] = form
            required += form.needed
            for key, (hint, unit) in form.keys.items():
                keys[key] = _Key(item.name, _reader(key, hint, unit), own=False)
            continue

        key = field_key(item)
        read = _reader(key, hints[item.name], field_unit(item))
        keys[key] = _Key(item.name, read, own=True)
        has_default = item.default is not MISSING or item.default_factory is not MISSING
        if item.metadata.get("needed") or not has_default:
            required.append(key)
        if item.metadata.get("absent") is not None:
            absent.append((key, item.name, item.metadata["absent"]))

    names = Counter(known.name for known in keys.values())
    return _Plan(
        keys,
        forms,
        {known.name: key for key, known in keys.items() if names[known.name] == 1},
        tuple(required),
        tuple(absent),
        frozenset(key.partition(".")[0] for key in keys if "." in key),
    )


def _reader(key: str, hint: Any, unit: Unit) -> Read:
    """Return what reads the values of a key, by their type."""
    if isinstance(hint, UnionType) and NoneType in get_args(hint):
        kinds = [kind for kind in get_args(hint) if kind is not NoneType]
        read_known = _reader(key, reduce(or_, kinds), unit)
        return lambda value, source, path: (
            None if value is None else read_known(value, source, path)
        )

    if is_dataclass(hint):
        return lambda value, source, path: decode_record(
            cast(type, hint), _table(value, source, path), source, path
        )

    if hint is Any:
        return lambda value, _source, _path: value

    if get_origin(hint) is Mapping:
        read_entry = _reader(key, get_args(hint)[1], unit)
        return lambda value, source, path: {
            name: read_entry(entry, source, (*path, name))
            for name, entry in _table(value, source, path).items()
        }

    if get_origin(hint) is tuple:
        return _list_reader(key, hint, unit)
    if get_origin(hint) is Literal:
        return _value_reader(key, str, replace(unit, words=get_args(hint)))
    return _value_reader(key, hint, unit)


def _list_reader(key: str, hint: Any, unit: Unit) -> Read:
    kind, *others = get_args(hint)
    read_entry = _reader(key, kind, unit)
    are_tables = is_dataclass(kind)
    size = None if others == [Ellipsis] else 1 + len(others)

    def read(value: Any, source: Source, path: Path) -> Any:
        entries = _entries(value, source, path, dict if are_tables else object)
        if size is not None and len(entries) != size:
            raise StudyError(
                f"{source.place(path)}: expected {size} entries, found"
                f" {reprlib.repr(value)}"
            )
        if are_tables:
            places = [(*path, number) for number in range(len(entries))]
            return tuple(map(read_entry, entries, repeat(source), places))
        return tuple([read_entry(entry, source, path) for entry in entries])

    return read


def _value_reader(key: str, hint: Any, unit: Unit) -> Read:
    def read(value: Any, source: Source, path: Path) -> Any:
        found = map_numbers(_value(hint, value, source, path), unit.to_si)
        try:
            check_value(key, found, unit)
        except StudyError as fault:
            wrong = str(fault).removeprefix(key)
            raise StudyError(f"{source.place(path)}{wrong}") from None
        return found

    # Most values of large files are numbers within their bounds, and texts. Without
    # this, 12 eyes of 200 frames take 120 ms in place of 70.
    low = -MAX_WHOLE if unit.low is None else unit.low
    high = MAX_WHOLE if unit.high is None else min(unit.high, MAX_WHOLE)

    def read_number(value: Any, source: Source, path: Path) -> Any:
        if type(value) is hint and low <= value <= high:
            return unit.to_si(value) if unit.name else value
        return read(value, source, path)

    def read_text(value: Any, source: Source, path: Path) -> Any:
        if type(value) is str and LINE.match(value):
            return value
        return read(value, source, path)

    if hint in (float, int):
        return read_number
    return read_text if hint is str and not unit.words else read


def _without_tables(
    table: Mapping[str, Any], names: frozenset[str], source: Source, path: Path
) -> dict[str, Any]:
    """Return a table with the keys of tables in it, as "a.b", in place of these."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if key not in names:
            found[key] = value
            continue

        inner = _table(value, source, (*path, key))
        found |= {f"{key}.{name}": entry for name, entry in inner.items()}

    return found


def _table(value: Any, source: Source, path: Path) -> dict[str, Any]:
    if isinstance(value, dict):
        return value
    wanted = (
        f"a table [{path[-1]}]"
        if source.lines is not None
        else f"an object, found {reprlib.repr(value)}"
    )
    raise StudyError(f"{source.place(path)}: expected {wanted}")


def _value(hint: Any, value: Any, source: Source, path: Path) -> Any:
    if not (isinstance(hint, UnionType) and Range in get_args(hint)):
        return _scalar(hint, value, source, path)
    if not isinstance(value, dict):
        numbers = value if isinstance(value, list) else [value]
        numbers = _entries(numbers, source, path)
        return Choice(tuple(_scalar(float, number, source, path) for number in numbers))
    if set(value) != {"min", "max"}:
        raise StudyError(f"{source.place(path)}: a range is {{ min = a, max = b }}")

    return Range(
        **{end: _scalar(float, number, source, path) for end, number in value.items()}
    )


def format_record(record: Any) -> str:
    """Write a record of sections as TOML that `parse_record` reads back to an equal
    one; None is left out.
    """
    sections = [
        (field_key(item), getattr(record, item.name))
        for item in dataclasses.fields(record)
        if in_files(item)
    ]
    return (
        "\n\n".join(
            format_section(name, section)
            for name, section in sections
            if section is not None
        )
        + "\n"
    )


def _entries(value: Any, source: Source, path: Path, kind: type = object) -> list[Any]:
    """Return the entries of a list; those of TOML are of a kind, and not many."""
    if source.lines is None:
        if isinstance(value, list | tuple):  # a tuple: of what is to be a file
            return list(value)
        raise StudyError(
            f"{source.place(path)}: expected a list, found {reprlib.repr(value)}"
        )

    if not isinstance(value, list) or not all(
        isinstance(entry, kind) for entry in value
    ):
        names = ".".join(key for key in path if isinstance(key, str))
        wanted = f"a list of tables [[{names}]]" if kind is dict else "a list"
        raise StudyError(f"{source.place(path)}: expected {wanted}")
    if len(value) > MAX_ENTRIES:
        raise StudyError(
            f"{source.place(path)}: {len(value)} entries; at most {MAX_ENTRIES} are"
            " allowed"
        )

    return value


def _scalar(kind: type, value: Any, source: Source, path: Path) -> Any:
    if isinstance(value, int) and abs(value) > MAX_WHOLE:
        raise StudyError(
            f"{source.place(path)}: a number of more than"
            f" {len(str(MAX_WHOLE)) - 1} digits"
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
            f"{source.place(path)}: expected {names.get(kind, kind.__name__)}, found"
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


def format_section(name: str, record: Any, noted: bool = False) -> str:
    """Write a section as TOML; `noted`: with what each field means."""
    lines = [f"[{name}]"]
    groups = []

    for item in dataclasses.fields(record):
        value = getattr(record, item.name)
        if value is None:
            value = item.metadata.get("absent")
        form = field_form(item)
        if value is None or not in_files(item):
            continue

        if form is not None:
            written = form.write(value)
            lines += [
                _format_key(key, written[key], unit, noted)
                for key, (_, unit) in form.keys.items()
                if written.get(key) is not None
            ]
        elif isinstance(value, tuple) and value and is_dataclass(value[0]):
            groups += [
                format_section(f"[{name}.{field_key(item)}]", entry) for entry in value
            ]
        elif is_dataclass(value) and not isinstance(value, Choice | Range):
            groups.append(format_section(f"{name}.{field_key(item)}", value, noted))
        else:
            lines.append(_format_key(field_key(item), value, field_unit(item), noted))

    return "\n".join(["\n".join(lines), *groups])


def _format_key(key: str, value: Any, unit: Unit, noted: bool) -> str:
    """Write a value in SI in the unit of its key."""
    line = f"{key} = {_format_value(map_numbers(value, unit.from_si))}"
    return f"{line:<51} # {unit.note}" if noted and unit.note else line


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
