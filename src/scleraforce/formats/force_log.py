"""Force logs as robots and sensors write them: delimited text, any columns, with or without settings above them."""

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.formats.log_columns import LogColumn, columns_by_header, required_columns
from scleraforce.formats.stated_units import FORCE, TIME, TORQUE
from scleraforce.recording.delimited import fields_of, number
from scleraforce.recording.tables import ForceLog, check_samples
from scleraforce.whole_files import KINDS, read_text

__all__ = ["LogText", "numbers_of", "read_force_text", "read_log_text"]

SEPARATORS, SPACES = "\t;,", " "  # of the header that has none of the first; so many spaces are one separator
SEARCHED_LINES = 100  # for the header
# What ATI's Net F/T demo writes above the header.
STATED = {FORCE: r"Force Units:\s*([\w-]+)", TORQUE: r"Torque Units:\s*([\w-]+)"}
SAMPLE_RATE = r"RDT Sample Rate:\s*([\d.]+)"
COUNTER = "RDT Sequence"
ISO = "iso"  # the unit of dates and times
DATE = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
NANOSECONDS = 1_000_000_000.0


@dataclass(frozen=True)
class LogText:
    """A log as text: the lines above its header, the names of its columns, what separates them, the lines below."""

    path: Path
    above: tuple[str, ...]
    names: tuple[str, ...]
    separator: str
    lines: tuple[str, ...]

    @property
    def delimiter(self) -> str | None:
        """What separates the columns, as NumPy has it: None for any number of spaces."""
        return None if self.separator == SPACES else self.separator


def read_log_text(path: Path, least: int = 2) -> LogText:
    """Read a log and find its header: the first line with a name for each field of the line below.

    Args:
        path: of the file.
        least: so many fields of a line are numbers or dates.

    Raises:
        RecordingError: there is no header.
    """
    lines = read_text(path, KINDS["forces"]).splitlines()
    for nth, (line, below) in enumerate(pairwise(lines[:SEARCHED_LINES])):
        alone = SPACES if len(below.split()) > 1 else ","  # a single column's name may have spaces
        separator = next((mark for mark in SEPARATORS if mark in line), alone)
        bare = line.removeprefix("#").lstrip(" ")  # what NumPy's savetxt begins a header with
        names, fields = _fields(bare, separator), _fields(below, separator)
        if len(fields) != len(names) or any(number(name, separator) is not None for name in names):
            continue
        if sum(number(field, separator) is not None or DATE.match(field) is not None for field in fields) >= least:
            rest = tuple(text for text in lines[nth + 1 :] if text.strip())
            return LogText(path, tuple(lines[:nth]), names, separator, rest)
    raise RecordingError(f"{path}: no header: a line with the names of columns, above lines of numbers")


def read_force_text(text: LogText, told: Sequence[LogColumn]) -> tuple[ForceLog, tuple[LogColumn, ...]]:
    """Return a log in SI and the columns that it was read from.

    Args:
        text: of the log.
        told: columns that somebody stated; they come before what the header says.

    Raises:
        UnansweredError: neither says which the time is, or any force.
        RecordingError: a value is no number, or none that a sensor can give.
    """
    by_header = columns_by_header(text.names, _stated_units(text))
    if (rate := _first(SAMPLE_RATE, text.above)) and COUNTER in text.names:  # ATI's own clock has whole seconds
        by_header = [LogColumn("time_s", COUNTER, f"{rate}Hz"), *(c for c in by_header if c.ours != "time_s")]
    answered = {column.ours: column for column in (*by_header, *told)}
    columns = required_columns(text.path, answered.values(), text.names)
    places = [text.names.index(column.name) for column in columns]
    dated = columns[0].unit == ISO
    values_sc = numbers_of(text, places[1:] if dated else places)
    values_sc *= [column.factor for column in columns[1 if dated else 0 :]]
    time_s, wrench_sc = (_moments(text, places[0]), values_sc) if dated else (values_sc[:, 0], values_sc[:, 1:])
    log = ForceLog(time_s, wrench_sc, tuple(column.ours for column in columns[1:]))
    check_samples(log, text.path, lambda sample: f"{text.path}:{len(text.above) + 2 + sample}")
    return log, columns


def numbers_of(text: LogText, places: Sequence[int]) -> NDArray[np.float64]:
    """Return the columns at some places (sample, column); a fault is looked for only where NumPy finds one.

    Raises:
        RecordingError: naming the line and the column that is no number.
    """
    lines = text.lines if text.separator == "," else [line.replace(",", ".") for line in text.lines]
    try:
        found = np.loadtxt(
            lines, delimiter=text.delimiter, usecols=tuple(places), comments=None, quotechar='"', ndmin=2
        )
    except ValueError as fault:
        raise _bad_value(text, places) or RecordingError(f"{text.path}: {fault}") from fault
    return np.asarray(found, dtype=np.float64)


def _stated_units(text: LogText) -> dict[str, str]:
    found = {quantity: _first(pattern, text.above) for quantity, pattern in STATED.items()}
    return {quantity: unit for quantity, unit in found.items() if unit and quantity != TIME}


def _first(pattern: str, lines: Sequence[str]) -> str | None:
    return next((found[1] for line in lines if (found := re.search(pattern, line))), None)


def _fields(line: str, separator: str) -> tuple[str, ...]:
    if separator == SPACES:
        return tuple(line.split())
    return fields_of(line.rstrip(f" {separator}"), separator, "") if line.count('"') % 2 == 0 else ()


def _moments(text: LogText, place: int) -> NDArray[np.float64]:
    """Return dates and times in s since 1970; without a zone they are of UTC."""
    try:
        stamps = np.loadtxt(text.lines, delimiter=text.delimiter, usecols=place, dtype=str, quotechar='"', ndmin=1)
        with warnings.catch_warnings():  # NumPy warns that it keeps no zones; what a zone says is counted in
            warnings.simplefilter("ignore", UserWarning)
            return np.char.strip(stamps).astype("datetime64[ns]").astype(np.int64) / NANOSECONDS
    except ValueError as fault:
        raise RecordingError(f"{text.path}: {text.names[place]}: {fault}") from fault


def _bad_value(text: LogText, places: Sequence[int]) -> RecordingError | None:
    for line_number, line in enumerate(text.lines, start=len(text.above) + 2):
        fields = _fields(line, text.separator)
        if len(fields) <= max(places):
            found = f"{len(fields)} fields; the header has {len(text.names)}"
            return RecordingError(f"{text.path}:{line_number}: {found}")
        for place in places:
            if number(fields[place], text.separator) is None:
                name = text.names[place]
                return RecordingError(f"{text.path}:{line_number}: {name}: {fields[place]!r} is not a number")
    return None
