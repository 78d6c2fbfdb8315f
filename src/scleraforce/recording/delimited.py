"""Tables of a recording folder as people have them: what editors, robots and spreadsheets make of a CSV file.

The header decides what separates the columns: commas, semicolons or tabs. Names and values may stand in quotes, lines
may end in separators that nothing follows. Where commas do not separate columns, they may stand for decimal points.
"""

import csv
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import RecordingError
from scleraforce.whole_files import FileKind, read_text

SEPARATORS = ";\t,"
NUMBER = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*", re.ASCII)
PLAIN_NUMBERS = "write all numbers with decimal points, and nothing between thousands"
# A comma that may part thousands; "0,250" cannot, for no group of thousands begins with 0.
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII)


@dataclass(frozen=True)
class Table:
    """A table: its columns in order, the lines below the header (the first is the file's line 2), what separates."""

    path: Path
    columns: tuple[str, ...]
    lines: tuple[str, ...]
    separator: str

    def place(self, line: int) -> str:
        """Return where the line of an index stands, for messages."""
        return f"{self.path}:{line + 2}"


def read_table(path: Path, kind: FileKind, known: tuple[str, ...], required: tuple[str, ...]) -> Table:
    """Read a table and check its header.

    Args:
        path: the file.
        kind: of the file.
        known: columns that it may have.
        required: columns that it must have.

    Raises:
        RecordingError: naming the file, the line and the field.
    """
    header, *lines = read_text(path, kind).splitlines() or [""]
    separator = next((mark for mark in SEPARATORS if mark in header), ",")
    names = fields_of(_bare(header, separator), separator, f"{path}:1")
    if not any(names):
        raise RecordingError(f"{path}: empty; the first line names the columns: {','.join(known)}")
    for name in names:
        if name not in known:
            raise RecordingError(f"{path}:1: unknown column {name!r}; known: {', '.join(known)}")
        if names.count(name) > 1:
            raise RecordingError(f"{path}:1: column {name} stands there twice")
    for name in required:
        if name not in names:
            raise RecordingError(f"{path}:1: column {name} is missing; found: {', '.join(names)}")
    return Table(path, names, tuple(_bare(line, separator) for line in lines), separator)


def fields_of(line: str, separator: str, place: str) -> tuple[str, ...]:
    """Return the fields of one line, free of quotes and of spaces about them; `place` stands in messages.

    Raises:
        RecordingError: quotes that do not end on the line.
    """
    try:
        row = next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True), [])
    except csv.Error as fault:
        raise RecordingError(f"{place}: {fault}; each line is a row of its own, and quotes end on it") from fault
    return tuple(field.strip() for field in row)


def number(text: str, mark: str = ".") -> float | None:
    """Return a decimal number in ASCII, or None; `mark` is the decimal mark, a point or a comma.

    >>> number("-1.5e-3"), number("0,25", ","), number("1_000"), number("0,25")
    (-0.0015, 0.25, None, None)
    """
    if mark == "," and "." not in text:
        text = text.replace(",", ".")
    return float(text) if NUMBER.fullmatch(text) else None


def is_number(text: str) -> bool:
    """Return whether a text is a number, whatever its commas mean."""
    return number(text, ",") is not None or GROUPED.fullmatch(text.strip()) is not None


def decimal_mark(
    lines: Sequence[str],
    separator: str,
    names: Sequence[str],
    read: Collection[int],
    place: Callable[[int], str],
    stated: str | None = None,
) -> str:
    """Return the decimal mark of a table's numbers, "." or ","; a comma is one only where the table proves it.

    It does by a comma that cannot part thousands (0,25 or 1,5), without a number that has a point.

    Args:
        lines: below the header.
        separator: of the columns; " " stands for any number of blanks.
        names: of the columns.
        read: places of the columns whose numbers are used; the others only bear witness.
        place: where the line of an index stands, for messages.
        stated: the mark that the file itself states.

    Raises:
        RecordingError: a number may be read in two ways.
    """
    if separator == "," or not any("," in line for line in lines):
        return "."
    comma: tuple[int, int, str] | None = None
    pointed, proven = stated == ".", stated == ","
    no_point = not any("." in line for line in lines)
    for index, line in enumerate(lines):
        if no_point and proven and comma is not None:
            break
        fields = fields_of(line, separator, place(index)) if '"' in line else line.split(separator.strip(" ") or None)
        for column, text in enumerate(fields):
            field = text.strip()
            if not is_number(field):
                continue
            pointed |= "." in field
            proven |= "," in field and not GROUPED.fullmatch(field)
            if field.count(",") > 1 and column in read:
                raise RecordingError(f"{place(index)}: {field!r} has commas between thousands; {PLAIN_NUMBERS}")
            if comma is None and "," in field and column in read:
                comma = index, column, field
    if comma is None:
        return "."
    if proven and not pointed:
        return ","
    index, column, field = comma
    name = names[column] if column < len(names) else f"column {column + 1}"
    why = "other numbers have decimal points" if pointed else "every comma has three digits behind it"
    readings = (
        f"{field.replace(',', '.', 1)} with a decimal comma, or {field.replace(',', '')} with one between thousands"
    )
    raise RecordingError(f"{place(index)}: {name}: {field!r} is {readings} ({why}); {PLAIN_NUMBERS}")


def _bare(line: str, separator: str) -> str:
    """Return a line without what spreadsheets append: separators of columns that are empty all the way down."""
    return line.rstrip(f" \t{separator}")
