"""Tables of a recording folder as people have them: what editors, robots and spreadsheets make of a CSV file.

The header decides what separates the columns: commas, semicolons or tabs. Names and values may stand in quotes, lines
may end in separators that nothing follows. Where commas do not separate columns, they may stand for decimal points.
"""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import RecordingError
from scleraforce.whole_files import FileKind, read_text

__all__ = ["Table", "fields_of", "number", "read_table"]

SEPARATORS = ";\t,"
NUMBER = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*", re.ASCII)


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


def number(text: str, separator: str = ",") -> float | None:
    """Return a decimal number in ASCII, None where it is none; a comma that does not separate is a decimal point.

    >>> number("-1.5e-3"), number("0,25", ";"), number("1_000"), number("0,25")
    (-0.0015, 0.25, None, None)
    """
    if separator != "," and "." not in text:
        text = text.replace(",", ".")
    return float(text) if NUMBER.fullmatch(text) else None


def _bare(line: str, separator: str) -> str:
    """Return a line without what spreadsheets append: separators of columns that are empty all the way down."""
    return line.rstrip(f" \t{separator}")
