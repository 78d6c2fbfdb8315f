"""Logs as text: the header, the separator, the fields of each line, and how programs write times and units."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.recording.scan import SECONDS
from scleraforce.recording.tables import PLAIN_NUMBERS, Table, decimal_mark, fields_of, is_number, number, without_cut
from scleraforce.units import STANDARD_GRAVITY_M_S2, to_si
from scleraforce.whole_files import KINDS, read_text

ISO, DAY_FIRST, MONTH_FIRST, NAMED, CLOCK = "iso", "dmy", "mdy", "date", "clock"
CLOCKS = (ISO, DAY_FIRST, MONTH_FIRST, NAMED, CLOCK)
DAY_S = 86_400
EPOCH_DAY = date(1970, 1, 1).toordinal()
MONTHS = {
    name: month
    for month, names in enumerate(
        ("jan", "feb fév fev", "mar mär mrz", "apr avr", "may mai", "jun juin", "jul juil", "aug aoû aou", "sep",
         "oct okt", "nov", "dec dez déc"), start=1,
    )
    for name in names.split()
}  # fmt: skip
TIME_OF_DAY = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(:(?P<second>\d\d)([.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
)
NUMBERS = r"(?P<first>\d{1,4})(?P<mark>[-/.])(?P<middle>\d{1,2})(?P=mark)(?P<last>\d{1,4})"
WORDS = (
    r"((?P<name>[^\W\d_]{3,9})\.?\s+(?P<day>\d{1,2})|(?P<day_before>\d{1,2})\.?[\s-]+(?P<name_after>[^\W\d_]{3,9})\.?)"
    r"[,\s-]+(?P<year>\d{4})"
)
DAY = re.compile(rf"\s*({NUMBERS}|{WORDS})\s*")
MOMENT = re.compile(rf"\s*(({NUMBERS}|{WORDS})[,\s]*T?\s*)?{TIME_OF_DAY}\s*")


def clock_of(text: str) -> str | None:
    """Return the notation of a date or time, None for other texts; "" if day and month may change places.

    >>> clock_of("2026-11-26 10:15"), clock_of("11/26/2026 10:15:30 PM"), clock_of("26.11.2026 10:15:30,25")
    ('iso', 'mdy', 'dmy')
    >>> clock_of("Nov 26, 2026, 3:04:00 PM"), clock_of("10:15:30.250"), clock_of("5/6/2026 10:15"), clock_of("1.5")
    ('date', 'clock', '', None)
    """
    found = MOMENT.fullmatch(text)
    if found is None:
        return None
    if found["name"] or found["name_after"]:
        return NAMED
    if not found["first"]:
        return CLOCK
    if len(found["first"]) == 4:
        return ISO
    if found["mark"] == "." or int(found["first"]) > 12:
        return DAY_FIRST
    return MONTH_FIRST if int(found["middle"]) > 12 else ""


def is_day(text: str) -> bool:
    """Return whether a text is a date without a time.

    >>> is_day("2026-11-26"), is_day("26. Nov 2026"), is_day("2026-11-26 10:15"), is_day("1.5")
    (True, True, False, False)
    """
    return DAY.fullmatch(text) is not None


def seconds_of(texts: Sequence[str], clock: str) -> NDArray[np.float64] | int:
    """Return dates and times in s since 1970, or times of day in s since the first midnight; the default zone is UTC.

    `clock` is their notation, one of `CLOCKS`. If a text has another, its place is returned instead.
    """
    days: dict[str, int] = {}
    time_s = np.empty(len(texts))
    for nth, text in enumerate(texts):
        found = MOMENT.fullmatch(text)
        if found is None:
            return nth
        try:
            written = text[: found.start("hour")]
            if written not in days:
                days[written] = _day(found, clock)
            time_s[nth] = days[written] * DAY_S + _of_day(found)
        except (ValueError, KeyError):
            return nth
    if clock == CLOCK:  # past midnight, the day begins anew
        time_s += DAY_S * np.concatenate([[0], np.cumsum(np.diff(time_s) < -DAY_S / 2)])
    return time_s


def _day(found: re.Match[str], clock: str) -> int:
    name = found["name"] or found["name_after"]
    if (clock == CLOCK) != (not name and not found["first"]) or (clock == NAMED) != bool(name):
        raise ValueError
    if clock == CLOCK:
        return 0
    if name:
        year, month, day = int(found["year"]), _month(name), int(found["day"] or found["day_before"])
    else:
        parts = [int(found[part]) for part in ("first", "middle", "last")]
        if (clock == ISO) != (len(found["first"]) == 4):
            raise ValueError
        year, month, day = (
            parts[place] for place in {ISO: (0, 1, 2), DAY_FIRST: (2, 1, 0), MONTH_FIRST: (2, 0, 1)}[clock]
        )
    return date(year + 2000 if year < 100 else year, month, day).toordinal() - EPOCH_DAY


def _month(name: str) -> int:
    short = name.lower()
    return next((MONTHS[short[:length]] for length in (4, 3) if short[:length] in MONTHS), 0)


def _of_day(found: re.Match[str]) -> float:
    hour, half = int(found["hour"]), found["half"]
    if half:
        if not 1 <= hour <= 12:
            raise ValueError
        hour = hour % 12 + (12 if half[0] in "pP" else 0)
    fraction = float(f"0.{found['fraction'] or 0}")
    if hour > 23 or int(found["minute"]) > 59:
        raise ValueError
    return hour * 3600 + int(found["minute"]) * 60 + int(found["second"] or 0) + fraction - _zone_s(found["zone"])


def _zone_s(zone: str | None) -> float:
    if zone is None or zone in ("Z", "UTC"):
        return 0.0
    sign = -1.0 if zone[0] == "-" else 1.0
    return sign * (int(zone[1:3]) * 3600 + int(zone[-2:]) * 60)


TIME, FORCE, TORQUE = "time", "force", "torque"
INCH_M = 0.0254
POUND_N = 0.45359237 * STANDARD_GRAVITY_M_S2

NEWTONS = {
    "n": 1.0, "newton": 1.0, "newtons": 1.0, "mn": to_si(1.0, "mn"), "millinewton": to_si(1.0, "mn"),
    "millinewtons": to_si(1.0, "mn"), "un": 1e-6, "µn": 1e-6, "kn": 1e3,
    "g": to_si(STANDARD_GRAVITY_M_S2, "mn"), "gf": to_si(STANDARD_GRAVITY_M_S2, "mn"), "kgf": STANDARD_GRAVITY_M_S2,
    "lbf": POUND_N, "lb": POUND_N,
}  # fmt: skip
NEWTON_METRES = {
    "nm": 1.0, "n-m": 1.0, "n*m": 1.0, "n.m": 1.0, "n m": 1.0, "mnm": to_si(1.0, "mnm"), "nmm": 1e-3, "n-mm": 1e-3,
    "ncm": 1e-2, "lbf-in": POUND_N * INCH_M, "in-lb": POUND_N * INCH_M,
}  # fmt: skip
UNITS = {TIME: SECONDS, FORCE: NEWTONS, TORQUE: NEWTON_METRES}
RATE = re.compile(r"([\d.]+)\s*hz", re.IGNORECASE)
PER_UNIT = re.compile(r"(\d+\.?\d*(?:[eE][+-]?\d+)?)\s*/\s*(.+)")


def quantity_of(column: str) -> str:
    """Return the quantity of one of our columns.

    >>> quantity_of("time_s"), quantity_of("fx_n"), quantity_of("tz_nm")
    ('time', 'force', 'torque')
    """
    return TIME if column == "time_s" else FORCE if column.startswith("f") else TORQUE


def unit_factor(unit: str, quantity: str) -> float | None:
    """Return the size of a unit in SI, None if it is not a unit of the quantity.

    A counter of samples has its rate as a unit of time; counts and volts have their number in one unit. "MN" is
    refused: it may mean mN.

    >>> unit_factor("mN", FORCE), unit_factor("mN", TORQUE), unit_factor("500 Hz", TIME), unit_factor("1000/mN", FORCE)
    (0.001, None, 0.002, 1e-06)
    """
    per_unit = PER_UNIT.fullmatch(unit.strip())
    if per_unit and quantity != TIME and float(per_unit[1]) > 0.0:
        whole = unit_factor(per_unit[2], quantity)
        return None if whole is None else whole / float(per_unit[1])
    rate = RATE.fullmatch(unit.strip())
    if rate and quantity == TIME and float(rate[1]) > 0.0:
        return 1.0 / float(rate[1])
    if unit.strip() == "MN":
        return None
    return UNITS[quantity].get(unit.strip().lower().replace("\N{GREEK SMALL LETTER MU}", "µ"))


def _is_unit(text: str) -> bool:
    """Return whether a text is a unit of time, force or torque.

    >>> _is_unit("mN"), _is_unit("Fz")
    (True, False)
    """
    return any(unit_factor(text, quantity) is not None for quantity in UNITS)


LABVIEW_MARK = "LabVIEW Measurement"
LABVIEW_END = "***End_of_Header***"
LABVIEW_SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass(frozen=True)
class _LabviewHeader:
    """The header of a LabVIEW measurement file; `units` of its channels may be empty, `after` is the next line."""

    separator: str
    mark: str
    units: tuple[str, ...]
    after: int


def _read_labview_header(path: Path, lines: Sequence[str]) -> _LabviewHeader:
    """Read the header of a LabVIEW measurement file with one segment and one column of times."""
    ends = [index for index, line in enumerate(lines) if line.strip().strip(",") == LABVIEW_END]
    if not ends:
        raise RecordingError(f"{path}: a LabVIEW measurement file without {LABVIEW_END}")
    head = lines[: ends[0]]
    stated = next((line.removeprefix("Separator").strip() for line in head if line.startswith("Separator")), "Tab")
    separator = LABVIEW_SEPARATORS.get(stated.strip(",").lower())
    if separator is None:
        raise RecordingError(f"{path}: Separator: {stated!r} is not read; export the file with Tab or Comma")
    stated_fields = _entries(head, separator)
    segments = ends[1:]
    if len(segments) > 1:
        raise RecordingError(
            f"{path}:{segments[1] + 1}: a second segment (Multi_Headings): its times begin anew; export each segment "
            "as a file of its own"
        )
    segment = _entries(lines[ends[0] + 1 : segments[0]], separator) if segments else {}
    columns = stated_fields.get("X_Columns", ("One",))[0].lower()
    channels = segment.get("Channels", ("1",))[0]
    if columns == "no" or (columns == "multi" and channels != "1"):
        raise RecordingError(
            f"{path}: X_Columns: {stated_fields['X_Columns'][0]} is not read; export the file with one column of times"
        )
    dimension = next((each for each in segment.get("X_Dimension", ()) if each), "Time")
    if dimension.lower() != "time":
        raise RecordingError(f"{path}: X_Dimension: {dimension!r}; the first column of a force log is the time")
    mark = stated_fields.get("Decimal_Separator", (".",))[0]
    if mark not in (".", ","):
        raise RecordingError(f"{path}: Decimal_Separator: {mark!r} is neither a point nor a comma")
    return _LabviewHeader(separator, mark, segment.get("Y_Unit_Label", ()), (segments or ends)[-1] + 1)


def _entries(lines: Sequence[str], separator: str) -> dict[str, tuple[str, ...]]:
    fields = [[field.strip() for field in line.split(separator)] for line in lines if line.strip()]
    return {name: tuple(values) or ("",) for name, *values in fields}


SEPARATORS, SPACES = "\t;,", " "  # of the header that has none of the first; any number of spaces is one separator
SEARCHED_LINES = 100  # for the header
# A point that may part thousands; "0.250" cannot.
POINT_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}", re.ASCII)


def read_log_text(path: Path, least: int = 2) -> Table:
    """Read a log and find its header: the first line with a name for each field of the line below.

    A line below has at least `least` numbers or dates. Names at the end may have no fields (a column of comments).
    """
    whole = read_text(path, KINDS["forces"])
    lines = whole.splitlines()
    if lines and lines[0].startswith(LABVIEW_MARK):
        text = _of_labview(path, lines)
    else:
        nth, separator, names = _header(path, lines, least)
        units, top = _units_line(lines, nth, separator, names)
        names = _fields(_unmarked(lines[top]), separator) if units else names
        text = _below(path, lines, top, nth + 1, separator, names, units)
    _check_counts(text)
    return text if whole.endswith(("\n", "\r")) else without_cut(text)


def numbers_of(
    text: Table, places: Sequence[int], gaps: Sequence[int] = (), mark: str | None = None
) -> NDArray[np.float64]:
    """Return the columns at some places (sample, column); a fault is looked for only if NumPy finds one.

    Columns at `gaps` may be empty or nan, which becomes NaN. The decimal mark follows from the numbers by default.
    """
    mark = mark or decimal_mark(text, places)
    lines = [line.replace(",", ".") for line in text.lines] if mark == "," else text.lines
    try:
        found = np.loadtxt(
            lines, delimiter=text.delimiter, usecols=tuple(places), comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        found = np.array([_row(text, line, places, gaps, mark) for line in range(len(text.lines))])
    values_sc: NDArray[np.float64] = np.asarray(found, dtype=np.float64)
    if mark == ".":
        _check_points(text, places, values_sc)
    return values_sc


def texts_of(text: Table, name: str) -> NDArray[np.str_]:
    """Return a column as text; empty on lines that end before it."""
    place = text.names.index(name)
    rows = (_fields(line, text.separator) for line in text.lines)
    return np.array([row[place] if len(row) > place else "" for row in rows])


def _header(path: Path, lines: Sequence[str], least: int) -> tuple[int, str, tuple[str, ...]]:
    """Return the index of the header, the separator and the names."""
    longer, shorter = None, None
    for nth, (line, below) in enumerate(pairwise(lines[:SEARCHED_LINES])):
        alone = SPACES if len(below.split()) > 1 else ","  # a single column's name may have spaces
        separator = next((mark for mark in SEPARATORS if mark in line), alone)
        bare = _unmarked(line)
        names, fields = _fields(bare, separator), _fields(below, separator)
        if separator == SPACES and len(names) > len(fields):  # names with a blank in them
            wide, bracketed = re.split(r" {2,}", bare.strip()), re.split(r" +(?![\[({<])", bare.strip())
            names = tuple(bracketed if len(bracketed) == len(fields) else wide)
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


def _unmarked(line: str) -> str:
    """Return a header without its comment mark: # of NumPy's savetxt, % of MATLAB and TeX."""
    return line.lstrip("#%").lstrip(" ")


def _units_line(lines: Sequence[str], nth: int, separator: str, names: tuple[str, ...]) -> tuple[tuple[str, ...], int]:
    """Return the units and the index of the names above them, if the line above the numbers has only units."""
    units = tuple(name.strip(" []()") for name in names)
    above = _fields(_unmarked(lines[nth - 1]), separator) if nth else ()
    if sum(map(_is_unit, units)) < 2 or len(above) != len(names):
        return (), nth
    return units, nth - 1


def _of_labview(path: Path, lines: list[str]) -> Table:
    header = _read_labview_header(path, lines)
    if header.after >= len(lines):
        raise RecordingError(f"{path}: no columns below the header")
    names = _fields(lines[header.after], header.separator)
    units = ("s", *header.units, *[""] * len(names))[: len(names)]
    text = _below(path, lines, header.after, header.after + 1, header.separator, names, units)
    return replace(text, mark=header.mark)


def _below(
    path: Path, lines: list[str], top: int, first: int, separator: str, names: tuple[str, ...], units: tuple[str, ...]
) -> Table:
    rest = [(line, nth) for nth, line in enumerate(lines[first:], start=first + 1) if line.strip()]
    texts, numbers = zip(*rest, strict=True) if rest else ((), ())
    return Table(
        path=path, names=names, separator=separator, lines=texts, numbers=numbers, above=tuple(lines[:top]), units=units
    )


def _check_counts(text: Table) -> None:
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


def _check_points(text: Table, places: Sequence[int], values_sc: NDArray[np.float64]) -> None:
    """Refuse a column whose points may part thousands: -15.000 beside 998, and three digits behind every point."""
    for place, values in zip(places, values_sc.T, strict=True):
        size = np.abs(values[np.isfinite(values)])
        whole = size == np.rint(size)
        if whole.all() or not whole.any() or size.max() >= 1000.0 or (size[~whole] < 1.0).any():
            continue
        texts = [_fields(line, text.separator)[place] for line in text.lines]
        pointed = [line for line, field in enumerate(texts) if "." in field]
        if len(pointed) == len(texts) or not all(POINT_GROUPED.fullmatch(texts[line]) for line in pointed):
            continue
        field = texts[pointed[0]]
        raise RecordingError(
            f"{text.place(pointed[0])}: {text.names[place]}: {field!r} is {float(field):g} with a decimal point, or "
            f"{field.replace('.', '')} with one between thousands (every point has three digits behind it, and other "
            f"numbers have none); {PLAIN_NUMBERS}"
        )


def _row(text: Table, line: int, places: Sequence[int], gaps: Sequence[int], mark: str) -> list[float]:
    """Return the numbers of one line; an empty field or nan at one of `gaps` is NaN."""
    fields = _fields(text.lines[line], text.separator)
    values = []
    for place in places:
        field = fields[place] if place < len(fields) else ""
        value = number(field, mark)
        if value is None and not (place in gaps and field.lower() in ("", "nan")):
            raise RecordingError(f"{text.place(line)}: {text.names[place]}: {field!r} is not a number")
        values.append(np.nan if value is None else value)
    return values
