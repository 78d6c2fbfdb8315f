"""Logs as text: the header, the separator, the fields of each line, and how programs
write times and units.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import date, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import RecordingError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2, to_si
from scleraforce.recordings.formats.damaged_logs import (
    decoded_log,
    without_broken_lines,
)
from scleraforce.recordings.formats.picture_streams import SECONDS
from scleraforce.recordings.frame_and_force_tables import (
    SPACES,
    TextTable,
    check_field_counts,
    fields_of,
    is_number,
)

ISO = "iso"
DAY_FIRST = "dmy"
MONTH_FIRST = "mdy"
NAMED = "date"
CLOCK = "clock"
MINUTES = "mmss"  # minutes, seconds and their fraction, without the hour
DURATION = "duration"  # of MATLAB ("0.005 sec") and pandas ("0 days 00:00:00.005000")
CLOCKS = (ISO, DAY_FIRST, MONTH_FIRST, NAMED, CLOCK, MINUTES, DURATION)
DAY_S = 86_400
HOUR_S = 3_600
# Timecode, whose last part counts the frames of a second; 100 are hundredths.
FRAME_RATE = re.compile(r"(\d+(?:\.\d+)?)\s*fps", re.IGNORECASE)
FRAME_RATES = (24, 25, 30, 48, 50, 60, 100)
OF_TIMECODE = "fps"
TIMECODE = re.compile(
    r"\s*(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)[:;](?P<frame>\d\d)\s*"
)
OF_DURATION = re.compile(
    r"\s*(?:(?P<seconds>\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)\s*(?:s|secs?|seconds?)"
    r"|(?P<days>\d+) days?"
    r"(?: (?P<hour>\d+):(?P<minute>\d\d):(?P<second>\d\d(?:\.\d+)?))?)\s*",
    re.IGNORECASE,
)
OF_MINUTES = re.compile(
    r"\s*(?P<minute>\d{1,2}):(?P<second>\d\d)[.,](?P<fraction>\d+)\s*"
)
MONTHS = {
    name: month
    for month, names in enumerate(
        (
            "jan",
            "feb fév fev",
            "mar mär mrz",
            "apr avr",
            "may mai",
            "jun juin",
            "jul juil",
            "aug aoû aou",
            "sep",
            "oct okt",
            "nov",
            "dec dez déc",
        ),
        start=1,
    )
    for name in names.split()
}
TIME_OF_DAY = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(:(?P<second>\d\d)([.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
)
NUMBERS = (
    r"(?P<first>\d{1,4})(?P<mark>[-/.])(?P<middle>\d{1,2})(?P=mark)(?P<last>\d{1,4})"
)
WORDS = (
    r"((?P<name>[^\W\d_]{3,9})\.?\s+(?P<day>\d{1,2})|(?P<day_before>\d{1,2})\.?[\s-]+(?P<name_after>[^\W\d_]{3,9})\.?)"
    r"[,\s-]+(?P<year>\d{4})"
)
DAY = re.compile(rf"\s*({NUMBERS}|{WORDS})\s*")
MOMENT = re.compile(rf"\s*(({NUMBERS}|{WORDS})[,\s]*T?\s*)?{TIME_OF_DAY}\s*")


def clock_of(text: str) -> str | None:
    """Return the notation of a date or time, None for other texts; "" if day and month
    may change places, `OF_TIMECODE` without the rate of its frames.
    """
    if TIMECODE.fullmatch(text):
        return OF_TIMECODE
    if OF_MINUTES.fullmatch(text):
        return MINUTES
    if OF_DURATION.fullmatch(text):
        return DURATION

    found = MOMENT.fullmatch(text)
    if found is None:
        return None
    if kind := _kind(found):
        return kind
    if found["mark"] == "." or int(found["first"]) > 12:
        return DAY_FIRST

    return MONTH_FIRST if int(found["middle"]) > 12 else ""


def _kind(found: re.Match[str]) -> str:
    """Return the notation of a moment, "" for `DAY_FIRST` or `MONTH_FIRST`."""
    if found["name"] or found["name_after"]:
        return NAMED
    return CLOCK if not found["first"] else ISO if len(found["first"]) == 4 else ""


def is_clock(unit: str) -> bool:
    """Return whether a unit of time is a notation of dates or of the time of day."""
    return unit in CLOCKS or FRAME_RATE.fullmatch(unit) is not None


def frame_rate(texts: Sequence[str]) -> int | None:
    """Return the frames a second that timecodes count, None if it is not certain."""
    frames = [
        int(found["frame"]) for text in texts if (found := TIMECODE.fullmatch(text))
    ]
    rate = max(frames, default=0) + 1
    return rate if rate in FRAME_RATES else None


def seconds_of(texts: Sequence[str], clock: str) -> Floats | int:
    """Return dates in s since 1970 (UTC by default), times of day since midnight; or
    the place of another clock's.
    """
    rate = FRAME_RATE.fullmatch(clock)
    if rate or clock == MINUTES:
        return _short_seconds(texts, float(rate[1]) if rate else None)
    if clock == DURATION:
        return _durations(texts)

    time_s = np.empty(len(texts))
    for nth, text in enumerate(texts):
        found = MOMENT.fullmatch(text)
        if found is None or _kind(found) not in (
            clock,
            *([""] if clock in (DAY_FIRST, MONTH_FIRST) else []),
        ):
            return nth

        try:
            time_s[nth] = _seconds(found, clock)
        except ValueError:
            return nth

    if clock == CLOCK:  # past midnight, the day begins anew
        time_s += DAY_S * np.concatenate([[0], np.cumsum(np.diff(time_s) < -DAY_S / 2)])

    return time_s


def _durations(texts: Sequence[str]) -> Floats | int:
    time_s = np.empty(len(texts))
    for nth, text in enumerate(texts):
        found = OF_DURATION.fullmatch(text)
        if found is None:
            return nth

        part = found.groupdict(default="0")
        time_s[nth] = (
            float(part["seconds"].replace(",", "."))
            + DAY_S * int(part["days"])
            + HOUR_S * int(part["hour"])
            + 60 * int(part["minute"])
            + float(part["second"])
        )

    return time_s


def _short_seconds(texts: Sequence[str], rate: float | None) -> Floats | int:
    """Return timecodes of a rate, or minutes and seconds (None), in s that count on."""
    time_s = np.empty(len(texts))
    for nth, text in enumerate(texts):
        found = (TIMECODE if rate else OF_MINUTES).fullmatch(text)
        if found is None:
            return nth

        part = found.groupdict()
        of_second = (
            int(part["frame"]) / rate if rate else float(f"0.{part['fraction']}")
        )
        if of_second >= 1.0 or int(part["second"]) > 59 or int(part["minute"]) > 59:
            return nth

        time_s[nth] = (
            HOUR_S * int(part.get("hour") or 0)
            + 60 * int(part["minute"])
            + int(part["second"])
            + of_second
        )

    period_s = DAY_S if rate else HOUR_S
    turns = np.cumsum(np.diff(time_s, prepend=time_s[:1]) < -period_s / 2)
    return np.asarray(time_s + period_s * turns)


def _seconds(found: re.Match[str], clock: str) -> float:
    hour = int(found["hour"])
    half = found["half"]
    zone = (found["zone"] or "Z").replace("UTC", "Z")
    if half and not 1 <= hour <= 12:
        raise ValueError

    hour = hour % 12 + (12 if half[0] in "pP" else 0) if half else hour
    time = f"{hour:02}:{found['minute']}:{found['second'] or '00'}{zone}"
    return datetime.fromisoformat(f"{_day(found, clock)}T{time}").timestamp() + float(
        f"0.{found['fraction'] or 0}"
    )


def _day(found: re.Match[str], clock: str) -> date:
    if clock == CLOCK:
        return date(1970, 1, 1)

    if clock == NAMED:
        name = (found["name"] or found["name_after"]).lower()
        month = MONTHS.get(name[:4], MONTHS.get(name[:3], 0))
        return date(int(found["year"]), month, int(found["day"] or found["day_before"]))

    order = "ymd" if clock == ISO else clock
    parts = dict(
        zip(
            order,
            (int(found[part]) for part in ("first", "middle", "last")),
            strict=True,
        )
    )

    return date(parts["y"] + (2000 if parts["y"] < 100 else 0), parts["m"], parts["d"])


TIME = "time"
FORCE = "force"
TORQUE = "torque"
INCH_M = 0.0254
POUND_N = 0.45359237 * STANDARD_GRAVITY_M_S2

NEWTONS = {
    "n": 1.0,
    "newton": 1.0,
    "newtons": 1.0,
    "mn": to_si(1.0, "mn"),
    "millinewton": to_si(1.0, "mn"),
    "millinewtons": to_si(1.0, "mn"),
    "un": 1e-6,
    "µn": 1e-6,
    "kn": 1e3,
    "g": to_si(STANDARD_GRAVITY_M_S2, "mn"),
    "gf": to_si(STANDARD_GRAVITY_M_S2, "mn"),
    "kgf": STANDARD_GRAVITY_M_S2,
    "lbf": POUND_N,
    "lb": POUND_N,
}
NEWTON_METRES = {
    "nm": 1.0,
    "n-m": 1.0,
    "n*m": 1.0,
    "n.m": 1.0,
    "n m": 1.0,
    "mnm": to_si(1.0, "mnm"),
    "nmm": 1e-3,
    "n-mm": 1e-3,
    "ncm": 1e-2,
    "lbf-in": POUND_N * INCH_M,
    "in-lb": POUND_N * INCH_M,
}
UNITS = {TIME: SECONDS, FORCE: NEWTONS, TORQUE: NEWTON_METRES}
RATE = re.compile(r"([\d.]+)\s*hz", re.IGNORECASE)
PER_UNIT = re.compile(r"(\d+\.?\d*(?:[eE][+-]?\d+)?)\s*/\s*(.+)")


def quantity_of(column: str) -> str:
    """Return the quantity of one of our columns."""
    return TIME if column == "time_s" else FORCE if column.startswith("f") else TORQUE


def unit_factor(unit: str, quantity: str) -> float | None:
    """Return the size of a unit in SI, None if it is not a unit of the quantity.

    A counter of samples has its rate as a unit of time; counts and volts have their
    number in one unit. "MN" is refused: it may mean mN.

    >>> unit_factor("mN", FORCE), unit_factor("mN", TORQUE)
    (0.001, None)
    >>> unit_factor("500 Hz", TIME), unit_factor("1000/mN", FORCE)
    (0.002, 1e-06)
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

    return UNITS[quantity].get(
        unit.strip().lower().replace("\N{GREEK SMALL LETTER MU}", "µ")
    )


LABVIEW_MARK = "LabVIEW Measurement"
LABVIEW_END = "***End_of_Header***"
LABVIEW_SEPARATORS = {"tab": "\t", "comma": ","}
SEARCHED_LINES = 100  # for the header
ROW_NUMBERS = ""  # the name of a column of them
DIGITS = "+-.0123456789"


def read_log_text(path: Path, least: int = 2) -> TextTable:
    """Read a log; its header is the first line with names for the fields below, `least`
    of them numbers or dates.
    """
    whole, notes = decoded_log(path)
    lines = whole.splitlines()
    text = (
        _of_labview(path, lines)
        if whole.startswith(LABVIEW_MARK)
        else _of_lines(path, lines, least)
    )
    text = replace(text, notes=notes)
    if least > 1:  # the rows of a table of files may be remarks
        headers = {text.names, text.units} - {()}
        text = without_broken_lines(
            text,
            lambda line: (
                line.strip()[:1] not in DIGITS
                and _names(line, text.separator) in headers
            ),
            whole.endswith(("\n", "\r")),
        )

    check_field_counts(text)

    return text


def _of_labview(path: Path, lines: Sequence[str]) -> TextTable:
    ends = [
        index
        for index, line in enumerate(lines)
        if line.strip().strip(",") == LABVIEW_END
    ]
    if not ends:
        raise RecordingError(
            f"{path}: a LabVIEW measurement file without {LABVIEW_END}"
        )
    if len(ends) > 2:
        way = "export each to a file of its own"
        raise RecordingError(
            f"{path}:{ends[2] + 1}: a second segment (Multi_Headings); {way}"
        )

    named = (
        line.removeprefix("Separator").strip()
        for line in lines[: ends[0]]
        if line.startswith("Separator")
    )
    stated = next(named, "Tab")

    separator = LABVIEW_SEPARATORS.get(stated.strip(",").lower())
    if separator is None:
        raise RecordingError(
            f"{path}: Separator: {stated!r} is not read; export the file with Tab or"
            " Comma"
        )

    head = _entries(lines[: ends[0]], separator)
    top = ends[-1] + 1
    segment = _entries(lines[ends[0] + 1 : ends[1]], separator) if ends[1:] else {}

    columns = head.get("X_Columns", ("One",))[0]
    if columns.lower() == "no" or (
        columns.lower() == "multi" and segment.get("Channels", ("1",))[0] != "1"
    ):
        raise RecordingError(
            f"{path}: X_Columns: {columns} is not read; export the file with one column"
            " of times"
        )

    dimension = next((each for each in segment.get("X_Dimension", ()) if each), "Time")
    if dimension.lower() != "time":
        raise RecordingError(
            f"{path}: X_Dimension: {dimension!r}; the first column of a force log is"
            " the time"
        )

    mark = head.get("Decimal_Separator", (".",))[0]
    if mark not in (".", ","):
        raise RecordingError(
            f"{path}: Decimal_Separator: {mark!r} is neither a point nor a comma"
        )
    if top >= len(lines):
        raise RecordingError(f"{path}: no columns below the header")

    names = _names(lines[top], separator)
    units = ("s", *segment.get("Y_Unit_Label", ()), *[""] * len(names))[: len(names)]
    return _below(
        TextTable(path=path, names=names, separator=separator, units=units, mark=mark),
        lines,
        top,
        top + 1,
    )


def _entries(lines: Sequence[str], separator: str) -> dict[str, tuple[str, ...]]:
    fields = [
        [field.strip() for field in line.split(separator)]
        for line in lines
        if line.strip()
    ]
    return {name: tuple(values) or ("",) for name, *values in fields}


def _of_lines(path: Path, lines: Sequence[str], least: int) -> TextTable:
    longer = None
    shorter = None

    for nth, (line, below) in enumerate(pairwise(lines[:SEARCHED_LINES])):
        # a single column's name may have spaces
        alone = SPACES if len(below.split()) > 1 else ","
        separator = next((mark for mark in "\t;," if mark in line), alone)
        names = _names(line, separator)

        fields = _names(below, separator, marks="")
        if separator == SPACES and len(names) > len(fields):
            # names with a blank in them
            bare = line.lstrip("#%").strip()
            wide = re.split(r" {2,}", bare)
            bracketed = re.split(r" +(?![\[({<])", bare)
            names = tuple(bracketed if len(bracketed) == len(fields) else wide)

        if not names or any(is_number(name) for name in names):
            continue
        if (
            sum(is_number(field) or clock_of(field) is not None for field in fields)
            < least
        ):
            continue
        if len(fields) == len(names) + 1 and _are_row_numbers(
            lines[nth + 1 :], separator
        ):
            names = (ROW_NUMBERS, *names)  # of pandas and R, without a name
        if len(names) < len(fields):
            shorter = shorter or (
                f"{path}:{nth + 2}: {len(fields)} fields; the header above has"
                f" {len(names)} names"
            )
            continue

        longer = longer or (nth, separator, names)
        if len(fields) == len(names):
            longer = nth, separator, names
            break

    if longer is None:
        raise RecordingError(
            shorter
            or (
                f"{path}: no header: a line with the names of columns, above lines of"
                " numbers"
            )
        )

    top, separator, names = longer
    # The line above the numbers may have only units, with the names above them.
    units = tuple(name.strip(" []()") for name in names)
    above = _names(lines[top - 1], separator) if top else ()

    known = [
        unit
        for unit in units
        if any(unit_factor(unit, quantity) is not None for quantity in UNITS)
    ]
    if len(known) < 2 or len(above) != len(names):
        return _below(
            TextTable(path=path, names=names, separator=separator), lines, top, top + 1
        )

    return _below(
        TextTable(path=path, names=above, separator=separator, units=units),
        lines,
        top - 1,
        top + 1,
    )


def _are_row_numbers(lines: Sequence[str], separator: str) -> bool:
    firsts = [_names(line, separator, marks="")[:1] for line in lines[:3]]
    from_zero = [(f"{nth}",) for nth in range(len(firsts))]
    from_one = [(f"{nth + 1}",) for nth in range(len(firsts))]
    return firsts in (from_zero, from_one)


def _names(line: str, separator: str, marks: str = "#%") -> tuple[str, ...]:
    """Return the fields of a line without its comment mark: # of NumPy's savetxt, % of
    MATLAB and TeX; () if it has none.
    """
    bare = line.lstrip(marks).lstrip(" ") if marks else line
    if separator != SPACES and bare.count('"') % 2:
        return ()

    try:
        return fields_of(bare.rstrip(f" {separator}"), separator, "header")
    except RecordingError:  # a remark, not names: above them there may be anything
        return ()


def _below(table: TextTable, lines: Sequence[str], top: int, first: int) -> TextTable:
    rest = {
        nth: line
        for nth, line in enumerate(lines[first:], start=first + 1)
        if line.strip()
    }
    return replace(
        table, lines=tuple(rest.values()), numbers=tuple(rest), above=tuple(lines[:top])
    )
