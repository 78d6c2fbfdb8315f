"""Logs as text: which line is the header, what separates the columns, and whether each line has its fields."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.formats.clock_times import clock_of
from scleraforce.formats.labview import MARK, read_labview_header
from scleraforce.formats.stated_units import is_unit
from scleraforce.recording.delimited import decimal_mark, fields_of, is_number, number
from scleraforce.whole_files import KINDS, read_text

SEPARATORS, SPACES = "\t;,", " "  # of the header that has none of the first; so many spaces are one separator
SEARCHED_LINES = 100  # for the header


@dataclass(frozen=True)
class LogText:
    """A log as text.

    Attributes:
        path: of the file.
        above: the lines above the header.
        names: of the columns.
        units: of the columns where a line of its own states them; else empty.
        separator: of the columns.
        lines: below the header, those that are not blank.
        numbers: of these lines, in the file.
        mark: the decimal mark that the file states, None where it does not.
    """

    path: Path
    above: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    separator: str
    lines: tuple[str, ...]
    numbers: tuple[int, ...]
    mark: str | None = None

    @property
    def delimiter(self) -> str | None:
        """What separates the columns, as NumPy has it: None for any number of spaces."""
        return None if self.separator == SPACES else self.separator

    def place(self, line: int) -> str:
        """Return where the line of an index stands, for messages."""
        return f"{self.path}:{self.numbers[line]}"


def read_log_text(path: Path, least: int = 2) -> LogText:
    """Read a log and find its header: the first line with a name for each field of the line below.

    Names at the end may have no fields (a column of comments).

    Args:
        path: of the file.
        least: so many fields of a line are numbers or dates.

    Raises:
        RecordingError: there is no header, or a line has more fields than names, or fewer than other lines.
    """
    lines = read_text(path, KINDS["forces"]).splitlines()
    if lines and lines[0].startswith(MARK):
        text = _of_labview(path, lines)
    else:
        nth, separator, names = _header(path, lines, least)
        units, top = _units_line(lines, nth, separator, names)
        names = _fields(lines[top], separator) if units else names
        text = _below(path, lines, top, nth + 1, separator, names, units)
    _check_counts(text)
    return text


def numbers_of(
    text: LogText, places: Sequence[int], gaps: Sequence[int] = (), mark: str | None = None
) -> NDArray[np.float64]:
    """Return the columns at some places (sample, column); a fault is looked for only where NumPy finds one.

    Args:
        text: of the log.
        places: of the columns.
        gaps: places of the columns that may be empty or nan: NaN.
        mark: the decimal mark; None: by the numbers.

    Raises:
        RecordingError: naming the line and the column that is no number.
    """
    mark = mark or mark_of(text, places)
    lines = [line.replace(",", ".") for line in text.lines] if mark == "," else text.lines
    try:
        found = np.loadtxt(
            lines, delimiter=text.delimiter, usecols=tuple(places), comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        found = np.array([_row(text, line, places, gaps, mark) for line in range(len(text.lines))])
    return np.asarray(found, dtype=np.float64)


def mark_of(text: LogText, places: Sequence[int]) -> str:
    """Return the decimal mark of the numbers at some places; see `decimal_mark`."""
    return decimal_mark(text.lines, text.separator, text.names, places, text.place, text.mark)


def texts_of(text: LogText, name: str) -> NDArray[np.str_]:
    """Return a column as text; empty where a line ends before it."""
    place = text.names.index(name)
    rows = (_fields(line, text.separator) for line in text.lines)
    return np.array([row[place] if len(row) > place else "" for row in rows])


def _header(path: Path, lines: Sequence[str], least: int) -> tuple[int, str, tuple[str, ...]]:
    """Return the index of the header, the separator and the names."""
    longer, shorter = None, None
    for nth, (line, below) in enumerate(pairwise(lines[:SEARCHED_LINES])):
        alone = SPACES if len(below.split()) > 1 else ","  # a single column's name may have spaces
        separator = next((mark for mark in SEPARATORS if mark in line), alone)
        bare = line.removeprefix("#").lstrip(" ")  # what NumPy's savetxt begins a header with
        names, fields = _fields(bare, separator), _fields(below, separator)
        if separator == SPACES and len(names) > len(fields):  # names with a blank in them
            names = tuple(re.split(r" {2,}", bare.strip()))
        if not names or any(is_number(name) for name in names):
            continue
        if sum(is_number(field) or clock_of(field) is not None for field in fields) < least:
            continue
        if len(fields) == len(names):
            return nth, separator, names
        if len(names) > len(fields):
            longer = longer or (nth, separator, names)
        else:
            shorter = shorter or f"{path}:{nth + 2}: {len(fields)} fields; the header above has {len(names)} names"
    if longer is not None:
        return longer
    raise RecordingError(shorter or f"{path}: no header: a line with the names of columns, above lines of numbers")


def _units_line(lines: Sequence[str], nth: int, separator: str, names: tuple[str, ...]) -> tuple[tuple[str, ...], int]:
    """Return the units and the index of the names above them, where the line above the numbers has units only."""
    units = tuple(name.strip(" []()") for name in names)
    above = _fields(lines[nth - 1].removeprefix("#").lstrip(" "), separator) if nth else ()
    if sum(map(is_unit, units)) < 2 or len(above) != len(names):
        return (), nth
    return units, nth - 1


def _of_labview(path: Path, lines: list[str]) -> LogText:
    header = read_labview_header(path, lines)
    if header.after >= len(lines):
        raise RecordingError(f"{path}: no columns below the header")
    names = _fields(lines[header.after], header.separator)
    units = ("s", *header.units, *[""] * len(names))[: len(names)]
    text = _below(path, lines, header.after, header.after + 1, header.separator, names, units)
    return replace(text, mark=header.mark)


def _below(
    path: Path, lines: list[str], top: int, first: int, separator: str, names: tuple[str, ...], units: tuple[str, ...]
) -> LogText:
    rest = [(line, nth) for nth, line in enumerate(lines[first:], start=first + 1) if line.strip()]
    texts, numbers = zip(*rest, strict=True) if rest else ((), ())
    return LogText(path, tuple(lines[:top]), names, units, separator, texts, numbers)


def _check_counts(text: LogText) -> None:
    """Check that each line has as many fields as the others, and no more than there are names."""
    counts = [_count(line, text.separator, len(text.names)) for line in text.lines]
    if not counts:
        return
    usual = Counter(counts).most_common(1)[0][0]
    for line, count in enumerate(counts):
        if count > len(text.names) or count < usual:
            others = f"the header has {len(text.names)} names" + (
                "" if usual == len(text.names) else f", most lines {usual}"
            )
            raise RecordingError(f"{text.place(line)}: {count} fields; {others}")


def _count(line: str, separator: str, names: int) -> int:
    """Return the number of fields, without empty ones behind the last name."""
    if separator == SPACES:
        return len(line.split())
    if '"' in line:
        fields = fields_of(line, separator, "")
        return (
            len(fields)
            if len(fields) <= names
            else max(names, 1 + max((k for k, f in enumerate(fields) if f), default=0))
        )
    count = line.count(separator) + 1
    return count if count <= names else max(names, line.rstrip(f" \t{separator}").count(separator) + 1)


def _fields(line: str, separator: str) -> tuple[str, ...]:
    if separator == SPACES:
        return tuple(line.split())
    return fields_of(line.rstrip(f" {separator}"), separator, "") if line.count('"') % 2 == 0 else ()


def _row(text: LogText, line: int, places: Sequence[int], gaps: Sequence[int], mark: str) -> list[float]:
    """Return the numbers of one line; an empty field or nan at one of `gaps` is NaN.

    Raises:
        RecordingError: naming the line and the column that is no number.
    """
    fields = _fields(text.lines[line], text.separator)
    values = []
    for place in places:
        field = fields[place] if place < len(fields) else ""
        value = number(field, mark)
        if value is None and not (place in gaps and field.lower() in ("", "nan")):
            raise RecordingError(f"{text.place(line)}: {text.names[place]}: {field!r} is not a number")
        values.append(np.nan if value is None else value)
    return values
