"""Force logs as robots and sensors write them: delimited text, any columns, with or without settings above them."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError, RecordingError
from scleraforce.formats.clock_times import CLOCKS, clock_of, seconds_of
from scleraforce.formats.labview import MARK, read_labview_header
from scleraforce.formats.log_columns import (
    LogColumn,
    clock_columns,
    columns_by_header,
    of_each_kind,
    required_columns,
)
from scleraforce.formats.sample_status import STATUS, faulty_samples, status_meaning
from scleraforce.formats.scan import UnansweredError
from scleraforce.formats.stated_units import FORCE, TORQUE, is_unit, quantity_of, unit_factor
from scleraforce.recording.delimited import decimal_mark, fields_of, is_number, number
from scleraforce.recording.tables import ForceLog, checked_samples, gap_notes
from scleraforce.whole_files import KINDS, read_text

__all__ = ["LogText", "numbers_of", "read_force_text", "read_log_text"]

SEPARATORS, SPACES = "\t;,", " "  # of the header that has none of the first; so many spaces are one separator
SEARCHED_LINES = 100  # for the header
# What ATI's Net F/T demo and its relatives write above the header.
STATED = {quantity: rf"(?i){quantity} units?\"?\s*[:=,;\t]+\s*\"?([\w*.-]+)" for quantity in (FORCE, TORQUE)}
COUNTS = {
    quantity: rf"(?i)counts?\s*(?:per|/)\s*(?:unit\s*)?{quantity}\"?\s*[:=,;\t]+\s*\"?([\d.eE+]+)"
    for quantity in (FORCE, TORQUE)
}
SAMPLE_RATE = r"RDT Sample Rate\"?\s*[:=,;\t]+\s*\"?([\d.]+)"
COUNTER = "RDT Sequence"
# A factor between the numbers of a log and forces, which is not applied.
GAIN = re.compile(
    r"(?i)\b(?<!full[ -])"
    r"((?:scale|scaling|gain|sensitivity|multiplier|(?:conversion|calibration)[ _-]?(?:factor|constant)|"
    r"(?:lsb|counts?)\s*(?:per\b|/))[^:=;,\t]*)[:=;,\t]+\s*\"?([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
)
RANGE = re.compile(r"(?i)\b(?:full[ -]?scale|range|capacity|rated (?:force|load)|max(?:imum|\.)? (?:force|load))\b(.*)")
FORCE_IN_TEXT = re.compile(r"(?i)([\d.]+(?:e[-+]?\d+)?)\s*(m?n|kn|gf|kgf|lbf)\b")


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


def read_force_text(text: LogText, told: Sequence[LogColumn]) -> tuple[ForceLog, tuple[LogColumn, ...]]:
    """Return a log in SI and the columns that it was read from.

    Args:
        text: of the log.
        told: columns that somebody stated; they take precedence over what the header says.

    Raises:
        UnansweredError: neither says which the time is, or any force, or the header contradicts the numbers.
        RecordingError: a value is no number, or none that a sensor can give.
    """
    stated = _stated_units(text)
    by_header = columns_by_header(text.names, stated, text.units)
    if (rate := _first(SAMPLE_RATE, text.above)) and COUNTER in text.names:  # ATI's own clock has whole seconds
        by_header = [LogColumn("time_s", COUNTER, f"{rate}Hz"), *(c for c in by_header if c.ours != "time_s")]
    elif not any(column.ours == "time_s" for column in (*by_header, *told)):
        by_header += _clock_column(text)
    answered = of_each_kind(text.path, by_header, told)
    _check_units(text, [column for column in answered if column not in told], stated)
    columns = required_columns(text.path, answered, text.names)
    places = [text.names.index(column.name) for column in columns]
    dated = columns[0].unit in CLOCKS
    read = places[1:] if dated else places
    mark = _mark(text, read)
    values_sc = numbers_of(text, read, gaps=places[1:], mark=mark)
    _check_whole(text, columns[1:], values_sc[:, -len(columns) + 1 :], told)
    values_sc *= [column.factor for column in columns[1 if dated else 0 :]]
    time_s, wrench_sc = (_moments(text, columns[0]), values_sc) if dated else (values_sc[:, 0], values_sc[:, 1:])
    notes = ["numbers have decimal commas"] if mark == "," else []
    notes += [*_overruled(by_header, told), *gap_notes(text.path, wrench_sc)]
    flags = _flagged(text, told)
    faulty = np.zeros(len(text.lines), dtype=bool)
    for column in flags:
        found, said = faulty_samples(column.name, column.unit, _texts(text, column.name), text.place)
        faulty |= found
        notes += said
    wrench_sc = np.where(faulty[:, None], np.nan, wrench_sc)
    log = ForceLog(time_s, wrench_sc, tuple(column.ours for column in columns[1:]), tuple(notes))
    return checked_samples(log, text.path, text.place, _range_n(text)), (*columns, *flags)


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
    mark = mark or _mark(text, places)
    lines = [line.replace(",", ".") for line in text.lines] if mark == "," else text.lines
    try:
        found = np.loadtxt(
            lines, delimiter=text.delimiter, usecols=tuple(places), comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        found = np.array([_row(text, line, places, gaps, mark) for line in range(len(text.lines))])
    return np.asarray(found, dtype=np.float64)


def _mark(text: LogText, places: Sequence[int]) -> str:
    return decimal_mark(text.lines, text.separator, text.names, places, text.place, text.mark)


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


def _stated_units(text: LogText) -> dict[str, str]:
    """Return the units of force and torque by the lines above the header; of counts, how many are one unit."""
    units = {quantity: unit for quantity, pattern in STATED.items() if (unit := _first(pattern, text.above))}
    counts = {quantity: _first(pattern, text.above) for quantity, pattern in COUNTS.items()}
    return {quantity: f"{float(count):.12g}/{unit}" if (count := counts[quantity]) else unit
            for quantity, unit in units.items()}  # fmt: skip


def _check_units(text: LogText, columns: Sequence[LogColumn], stated: dict[str, str]) -> None:
    """Ask where the file states two units of a column, or a factor that is not applied.

    Args:
        text: of the log.
        columns: that the header answers for.
        stated: units by the lines above it.

    Raises:
        UnansweredError: naming both readings.
    """
    forces = [column for column in columns if column.ours != "time_s"]
    for column in columns:
        quantity, place = quantity_of(column.ours), text.names.index(column.name)
        for other in (stated.get(quantity, ""), text.units[place] if text.units else ""):
            factor = unit_factor(other, quantity)
            if factor is not None and not np.isclose(factor, column.factor, rtol=1e-9):
                raise _question(f"{text.path}: {column.name!r} is in {column.unit} by its name", column, other, columns)
    counted = {quantity_of(column.ours) for column in forces if "/" in column.unit}
    for nth, line in enumerate(text.above, start=1):
        found = GAIN.search(line)
        applied = any(re.search(COUNTS[quantity], line) for quantity in counted)
        if forces and found and not applied and float(found[2]) != 1.0:
            said = f"{text.path}:{nth}: {found[1].strip()}: {found[2]} is not applied to {forces[0].name!r}"
            raise _question(said, forces[0], f"1000/{forces[0].unit}", forces)


def _check_whole(
    text: LogText, columns: Sequence[LogColumn], values_sc: NDArray[np.float64], told: Sequence[LogColumn]
) -> None:
    """Ask where the header states counts and a number is not whole.

    Raises:
        UnansweredError: naming both readings.
    """
    counted = [column for column in columns if "/" in column.unit and column not in told]
    for column, values in zip(columns, values_sc.T, strict=True):
        broken = np.isfinite(values) & (values != np.rint(values))
        if column in counted and broken.any():
            line, (count, unit) = int(np.argmax(broken)), column.unit.split("/")
            found = f"{text.place(line)}: {column.name}: {values[line]:g} is not a count"
            raise _question(f"{found}, but the header states {count} per {unit}", column, unit, counted)


def _question(said: str, column: LogColumn, other: str, columns: Sequence[LogColumn]) -> UnansweredError:
    """Return the question in which of two units columns are, with one of them as the example."""
    short = f"{column.ours.partition('_')[0]}={column.name}"
    forms = (f"{each.ours.partition('_')[0]}={each.name}:UNIT" for each in columns)
    return UnansweredError("--column", f"{said}: {short}:{column.unit} or {short}:{other}?", *forms)


def _range_n(text: LogText) -> float | None:
    """Return the largest force of the sensor by the lines above the header, None where they do not state it."""
    stated = [each for line in text.above if (found := RANGE.search(line)) for each in FORCE_IN_TEXT.findall(found[1])]
    return max((float(size) * (unit_factor(unit, FORCE) or 0.0) for size, unit in stated), default=0.0) or None


def _flagged(text: LogText, told: Sequence[LogColumn]) -> tuple[LogColumn, ...]:
    """Return the columns of the sensor's status.

    Raises:
        InputError: one that was stated is not in the log.
    """
    stated = {column.name: column for column in told if column.ours == STATUS}
    missing = next((name for name in stated if name not in text.names), None)
    if missing is not None:
        raise InputError(f"{text.path}: --column: no column {missing!r}; there are {', '.join(map(repr, text.names))}")
    named = {name: LogColumn(STATUS, name, meaning) for name in text.names
             if (meaning := status_meaning(name, text.names))}  # fmt: skip
    return tuple((named | stated).values())


def _overruled(by_header: Sequence[LogColumn], told: Sequence[LogColumn]) -> tuple[str, ...]:
    """Return sentences on columns that were stated in another unit than the header's."""
    return tuple(
        f"{said.name}: read in {said.unit} (--column), where the log states {own.unit}"
        for said in told
        for own in by_header
        if (own.ours, own.name) == (said.ours, said.name) and not np.isclose(own.factor, said.factor, rtol=1e-9)
    )


def _first(pattern: str, lines: Sequence[str]) -> str | None:
    return next((found[1] for line in lines if (found := re.search(pattern, line))), None)


def _fields(line: str, separator: str) -> tuple[str, ...]:
    if separator == SPACES:
        return tuple(line.split())
    return fields_of(line.rstrip(f" {separator}"), separator, "") if line.count('"') % 2 == 0 else ()


def _texts(text: LogText, name: str) -> NDArray[np.str_]:
    """Return a column as text; empty where a line ends before it."""
    place = text.names.index(name)
    rows = (_fields(line, text.separator) for line in text.lines)
    return np.array([row[place] if len(row) > place else "" for row in rows])


def _clock_column(text: LogText) -> list[LogColumn]:
    """Return the column of dates or times of day, where one has such a name.

    Raises:
        UnansweredError: day and month may change places.
    """
    for name in clock_columns(text.names):
        found = dict.fromkeys(clock_of(moment) for moment in _texts(text, name).tolist())
        if None in found:
            continue
        known = [clock for clock in found if clock]
        if known:
            return [LogColumn("time_s", name, known[0])]
        if found:
            example = str(_texts(text, name)[0])
            raise UnansweredError(
                "--column",
                f"{text.path}: {name}: {example!r}: is the day or the month first? time={name}:dmy says the day, "
                f"time={name}:mdy the month",
                "time=NAME:UNIT",
            )
    return []


def _moments(text: LogText, column: LogColumn) -> NDArray[np.float64]:
    """Return dates and times in s since 1970; without a zone they are of UTC."""
    texts = _texts(text, column.name).tolist()
    found = seconds_of(texts, column.unit)
    if isinstance(found, int):
        raise RecordingError(f"{text.place(found)}: {column.name}: {texts[found]!r} is not a time ({column.unit})")
    return found


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
