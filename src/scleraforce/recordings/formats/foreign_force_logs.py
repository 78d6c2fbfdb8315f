"""Force logs as robots and sensors write them: delimited text, any columns, with or
without settings above them.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, zip_longest
from math import isfinite
from pathlib import Path

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import InputError, RecordingError
from scleraforce.recordings import frame_and_force_tables, log_clocks
from scleraforce.recordings.formats import log_text
from scleraforce.recordings.formats.damaged_logs import without_broken_rows
from scleraforce.recordings.formats.log_text import (
    FORCE,
    TIME,
    TORQUE,
    quantity_of,
    unit_factor,
)
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    GROUPED,
    PLAIN_NUMBERS,
    WITHOUT_FORCE,
    ForceLog,
    TextTable,
    number,
)
from scleraforce.records.remark import Remark

PLUS = "+"  # between the two columns of one time
MENDED = "log-mended"  # the remark on how a log was read
STATUS = "status"  # our name of such a column
# How a column is read: ATI's status word, a flag of faults, a flag of validity. "any":
# all samples are taken.
STATUS_MEANINGS = ATI, GOOD_IF_ZERO, GOOD_IF_SET, ANY = "ati", "zero", "set", "any"
# Bits of ATI's status word (Net F/T, Axia) that leave the force valid: the summary,
# which repeats the others, and a latched condition of the user's own monitor (a
# threshold).
ATI_HARMLESS = 0x80010000
OF_SENSOR = (
    r"((is|sensor|ft|f/t|f_t|f[xyz]|m[xyz]|force|wrench|torque|device|data|sample|measurement|measured|reading|bota|ati|"
    r"rdt|daq|adc|amp|cable|gage|gauge|transducer)[ _-]*)*"
)
FAULTS = re.compile(
    OF_SENSOR + r"(status|error|fault|over[ _-]?load(ed)?|over[ _-]?range|over["
    r" _-]?flow|saturat(ed|ion)|clipp(ed|ing)|"
    r"invalid|alarm|out[ _-]of[ _-]range|disconnected)["
    r" _-]*(code|word|flags?|bits?|register)?"
)
VALIDITY = re.compile(OF_SENSOR + r"(valid|validity|ok|good|healthy)([ _-]*flag)?")
HEX = re.compile(r"[ _-]*[\[(]?hex\w*[\])]?$", re.IGNORECASE)
CLEAR_WORDS = {
    "",
    "ok",
    "good",
    "valid",
    "normal",
    "none",
    "false",
    "no",
    "no error",
    "f",
    "n",
}
SET_WORDS = {"ok", "good", "valid", "normal", "true", "yes", "t", "y"}


def _status_meaning(name: str, others: Sequence[str]) -> str | None:
    bare = HEX.sub("", name.strip().lower())
    if FAULTS.fullmatch(bare):
        of_ati = bare != name.strip().lower() and any(
            "sequence" in other.lower() for other in others
        )
        return ATI if of_ati else GOOD_IF_ZERO

    return GOOD_IF_SET if VALIDITY.fullmatch(bare) else None


def _faulty_samples(
    text: TextTable, column: "LogColumn"
) -> tuple[Flags, tuple[Remark, ...]]:
    name = column.name
    meaning = column.unit
    none = np.zeros(len(text.lines), dtype=bool)
    if meaning == ANY:
        return none, ()

    values, index = np.unique(
        np.char.strip(np.array(text.column(name))), return_inverse=True
    )
    in_hex = bool(HEX.search(name.strip()))

    codes = {str(value): _code(str(value), in_hex) for value in values}
    if any(isinstance(code, float) for code in codes.values()):
        # a measured quantity, like the error of a position
        words = f"{name}: not taken for the sensor's status, because it has fractions"
        return none, (Remark(MENDED, words),)

    faulty = np.array([_is_faulty(code, meaning) for code in codes.values()])[index]
    count = int(faulty.sum())
    first = int(np.argmax(faulty))
    found = f"{text.place(first)}: {name}: {str(values[index[first]])!r}"

    if count == len(faulty):
        way = f"if this column is not its status, give `columns={STATUS}={name}:{ANY}`"
        raise RecordingError(
            f"{found}, and every sample is flagged: it gave no force; {way}"
        )
    if count:
        flagged = (
            f"{count} of {len(faulty)} samples are flagged by the sensor and have no"
            " force"
        )
        words = f"{flagged}; the first is {found}"
        return faulty, (Remark(WITHOUT_FORCE, words),)

    harmless = ", ".join(
        value for value, code in codes.items() if meaning == ATI and code
    )
    words = (
        f"{name}: {harmless}: a summary or the user's own threshold, without a fault;"
        " its forces are kept"
    )

    return faulty, (Remark(MENDED, words),) if harmless else ()


def _code(text: str, in_hex: bool) -> int | float | str:
    try:
        if in_hex or text.lower().startswith("0x"):
            return int(text, 16)

        value = float(text.replace(",", "."))
        return (
            int(value)
            if value.is_integer()
            else value
            if isfinite(value)
            else text.lower()
        )
    except (ValueError, OverflowError):
        return text.lower()


def _is_faulty(code: int | float | str, meaning: str) -> bool:
    if meaning == GOOD_IF_SET:
        return code not in SET_WORDS if isinstance(code, str) else code == 0
    if isinstance(code, str):
        return code not in CLEAR_WORDS
    return bool(int(code) & ~ATI_HARMLESS) if meaning == ATI else code != 0


# fz: fz_n
SHORT_NAMES = {name.partition("_")[0]: name for name in FORCE_COLUMNS} | {
    STATUS: STATUS
}
# A unit in brackets, or after a mark or a blank: "Fz [mN]", "Force Z / mN", "FZ,mN",
# "fz_mN", "F_z in mN".
BRACKETS = re.compile(r"(?P<name>.*?)[\s_,:]*[\[({<](?P<unit>[^\])}>]+)[\])}>]\s*")
BEHIND_MARK = re.compile(
    r"(?P<name>.*?)(?:\s*[/,:;|_.-]\s*|\s+in\s+|_in_|\s+)(?P<unit>[^\s_/,:;|]+(?:[*.-][^\s_]+)?)\s*"
)
TIME_NAMES = {
    "time",
    "t",
    "timestamp",
    "host_time",
    "stamp",
    "elapsed",
    "elapsed_time",
    "time_stamp",
    "sample_time",
    "relative_time",
    "x_value",
    "zeit",
    "zeitstempel",
    "messzeit",
    "temps",
    "tiempo",
    "tempo",
    "header.stamp",
}
CLOCK_NAMES = TIME_NAMES | {
    "date",
    "datetime",
    "date_time",
    "date_and_time",
    "time_of_day",
    "clock",
    "datum",
    "datum_zeit",
    "datum_uhrzeit",
    "uhrzeit",
    "heure",
    "horodatage",
    "date_heure",
    "fecha",
    "hora",
}
# columns of `rostopic echo -p`: the stamp of the capture is in ns, all else in SI
ROS_STAMP = "field.header.stamp"
ROS_PREFIX = "field."
FORCE_WORDS = "force|kraft|effort|fuerza|forza|f"
TORQUE_WORDS = "torque|moment|drehmoment|couple|t|m"
BETWEEN = r"[ ._-]*(?:(?:in|along|axis|achse|richtung)[ ._-]*)?"
AXIS_NAMES = re.compile(
    rf"(?:(?P<what>{FORCE_WORDS}|{TORQUE_WORDS}){BETWEEN}(?P<axis>[xyz])|"
    r"(?P<axis_before>[xyz])[ ._-]*(?:(?:axis|achse)["
    rf" ._-]*)?(?P<what_after>{FORCE_WORDS}|{TORQUE_WORDS}))"
    r"(?:[ ._-]*(?:axis|achse|richtung))?"
)
FORCE_WORD = re.compile(FORCE_WORDS)
# Paths of fields of a ROS message, and the names that programs give to the arrival.
ROS_WRENCH = re.compile(
    r"(?:.*[./])?(?:wrench[./])(?P<what>force|torque)[./](?P<axis>[xyz])", re.IGNORECASE
)
STAMP = "stamp"
ROS_STAMP_PATH = re.compile(r"(?:.*[./])?header[./]stamp", re.IGNORECASE)
ROS_TIMES = ("time", "__time", "timestamp")
# Two columns of one time: "sec" and "nsec", "header.stamp.secs" and ".nsecs".
ENDS_STEM = r"(?P<stem>.*?)[\s._/(\[-]*"
WHOLE_SECONDS = re.compile(ENDS_STEM + r"(?:seconds?|secs?|s)[)\]]?\s*", re.IGNORECASE)
FRACTION = re.compile(
    ENDS_STEM + r"(?:(?P<ns>nano(?:_?sec(?:ond)?s?|s)?|nsecs?|ns)"
    r"|(?P<us>micro(?:_?sec(?:ond)?s?|s)?|[uµ]secs?|[uµ]s)"
    r"|(?P<ms>milli(?:_?sec(?:ond)?s?|s)?|msecs?|ms))[)\]]?\s*",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class LogColumn:
    """A column of a log: our name, its name there, its unit (of dates one of `CLOCKS`,
    or `STATUS_MEANINGS`).
    """

    ours: str
    name: str
    unit: str

    @property
    def factor(self) -> float:
        """The size of its unit in SI."""
        return unit_factor(self.unit, quantity_of(self.ours)) or 1.0

    def parts(self, names: Sequence[str]) -> tuple["LogColumn", ...]:
        """Return the columns of a log that it is the sum of: of a time in two columns
        sec+nsec in s+ns, else itself.
        """
        units = self.unit.split(PLUS)
        if self.name in names or len(units) != 2 or self.ours != "time_s":
            return (self,)

        for at in (at for at, mark in enumerate(self.name) if mark == PLUS):
            both = (self.name[:at], self.name[at + 1 :])
            if all(name in names for name in both):
                return tuple(
                    LogColumn("time_s", name, unit)
                    for name, unit in zip(both, units, strict=True)
                )

        return (self,)

    @property
    def short(self) -> str:
        """Our name of the column without its unit: time, fx, ..., tz, status."""
        return self.ours.partition("_")[0]

    def answer(self, unit: str | None = None) -> str:
        """Return the column, in its own unit or another, as `parse_column` reads it."""
        return f"{self.short}={self.name}:{unit or self.unit}"


def parse_column(text: str) -> LogColumn:
    """Return a column that somebody stated as COLUMN=NAME:UNIT, like fz=Force Z:mN."""
    short, equals, rest = text.partition("=")
    name, colon, unit = rest.rpartition(":")
    ours = SHORT_NAMES.get(short.strip().lower())
    unit = unit.strip()

    if not equals or not colon or ours is None or not name.strip():
        raise InputError(
            f"`columns`: {text!r}; give COLUMN=NAME:UNIT, like fz=Force Z:mN, of"
            f" {', '.join(SHORT_NAMES)}"
        )

    if ours == STATUS and unit not in STATUS_MEANINGS:
        raise InputError(
            f"`columns`: {text!r}: {unit!r} is not one of {', '.join(STATUS_MEANINGS)}"
            " (docs/formats.md)"
        )

    units = unit.split(PLUS) if ours == "time_s" and PLUS in name else [unit]
    is_clock = ours == "time_s" and log_text.is_clock(units[0])
    measured = units[1:] if is_clock or ours == STATUS else units
    if any(unit_factor(each, quantity_of(ours)) is None for each in measured):
        raise InputError(
            f"`columns`: {text!r}: {unit!r} is not a unit of {quantity_of(ours)}"
            " (docs/formats.md)"
        )

    return LogColumn(ours, name.strip(), unit)


def columns_by_header(
    names: Sequence[str], stated_units: dict[str, str], units: Sequence[str] = ()
) -> list[LogColumn]:
    """Return the columns that a header names; `stated_units` are above the header,
    `units` a line of their own.
    """
    if ROS_STAMP in names:
        names = [
            name for name in names if name == ROS_STAMP or name.startswith(ROS_PREFIX)
        ]
        stated_units = {FORCE: "N", TORQUE: "Nm", TIME: "ns"}
    elif found := _of_ros(names):
        return found

    each = zip_longest(names, units[: len(names)], fillvalue="")
    return [
        column
        for name, unit in each
        if (column := _by_name(name, unit, stated_units)) is not None
    ]


def _of_ros(names: Sequence[str]) -> list[LogColumn]:
    """Return the columns of a wrench by their paths in a ROS message, whose units are
    SI, as bagpy, PlotJuggler and rosbags write them; none in other logs.
    """
    forces = [
        LogColumn(
            SHORT_NAMES[found["what"][0].lower() + found["axis"].lower()],
            name,
            "N" if found["what"].lower() == "force" else "Nm",
        )
        for name in names
        if (found := ROS_WRENCH.fullmatch(name.strip()))
    ]
    if not any(quantity_of(column.ours) == FORCE for column in forces):
        return []

    stamps = [name for name in names if ROS_STAMP_PATH.fullmatch(name.strip())]
    arrivals = [name for name in names if name.strip().lower() in ROS_TIMES]
    pairs = [found for found in _pairs(names) if STAMP in found.name.lower()]
    times = [LogColumn("time_s", name, "s") for name in (*stamps, *arrivals)]

    return [*pairs, *times, *forces]


def _pairs(names: Sequence[str]) -> list[LogColumn]:
    """Return times of two columns, one of whole seconds and one of a fraction."""
    wholes = [found for name in names if (found := WHOLE_SECONDS.fullmatch(name))]
    fractions = [found for name in names if (found := FRACTION.fullmatch(name))]

    return [
        LogColumn("time_s", f"{whole[0]}{PLUS}{part[0]}", f"s{PLUS}{part.lastgroup}")
        for whole in wholes
        for part in fractions
        if whole["stem"].lower() == part["stem"].lower()
    ]


def _of_each_kind(
    path: Path, by_header: Sequence[LogColumn], given: Sequence[LogColumn]
) -> list[LogColumn]:
    """Return one column of each kind: the given one, else the header's; of two times
    the first.
    """
    answered = {column.ours: column for column in given if column.ours != STATUS}
    for column in by_header:
        other = answered.setdefault(column.ours, column)
        if other != column and other not in given and column.ours != "time_s":
            question = (
                f"{path}: {column.short}: is it {other.name!r} or {column.name!r}?"
            )
            raise UnansweredError("columns", question, f"{column.short}=NAME:UNIT")

    return list(answered.values())


def required_columns(
    path: Path, columns: Iterable[LogColumn], names: Sequence[str]
) -> tuple[LogColumn, ...]:
    """Return the columns but for the status, in our order; ask for the time and a force
    if they are missing.
    """
    columns = [*columns]
    listed = ", ".join(map(repr, names))
    found = {column.ours: column for column in columns}

    for column in [part for each in columns for part in each.parts(names)]:
        if column.name not in names:
            raise InputError(
                f"{path}: `columns`: no column {column.name!r}; there are {listed}"
            )
        if list(names).count(column.name) > 1:
            raise InputError(
                f"{path}: two columns are named {column.name!r}; rename one of them"
            )

    missing = {} if "time_s" in found else {"time=NAME:UNIT": "the time"}
    missing |= (
        {}
        if any(quantity_of(ours) == FORCE for ours in found)
        else {"fz=NAME:UNIT": "a force"}
    )
    if missing:
        question = (
            f"which column is {', and which '.join(missing.values())}, and in what"
            f" unit? There are {listed}"
        )
        raise UnansweredError("columns", f"{path}: {question}", *missing)

    return tuple(found[ours] for ours in FORCE_COLUMNS if ours in found)


def _by_name(name: str, unit: str, stated_units: dict[str, str]) -> LogColumn | None:
    bare = name.strip().removeprefix(ROS_PREFIX).removeprefix("wrench.")
    bracketed = BRACKETS.fullmatch(bare)
    marked = BEHIND_MARK.fullmatch(bare)
    parted = [(found["name"], found["unit"]) for found in (bracketed, marked) if found]

    for word, own in (*parted, (bare, unit)):
        if (ours := _ours(word)) is not None:
            for text in (own, unit, stated_units.get(quantity_of(ours), "")):
                if unit_factor(text, quantity_of(ours)) is not None:
                    return LogColumn(ours, name, text.strip())

    return None


def _ours(word: str) -> str | None:
    lower = word.strip().lower()
    if re.sub(r"[ -]", "_", lower) in TIME_NAMES:
        return "time_s"
    if (found := AXIS_NAMES.fullmatch(lower)) is None:
        return None

    what = found["what"] or found["what_after"]
    axis = found["axis"] or found["axis_before"]
    return SHORT_NAMES[("f" if FORCE_WORD.fullmatch(what) else "t") + axis]


# What ATI's Net F/T demo and its relatives write above the header.
STATED = {
    quantity: rf"(?i){quantity} units?\"?\s*[:=,;\t]+\s*\"?([\w*.-]+)"
    for quantity in (FORCE, TORQUE)
}
# A number with all possible marks between its thousands, so that "1,000" is not taken
# for 1.
WHOLE_NUMBER = r"\d(?:[\d.,'\u2019\s]*\d)?\.?(?:[eE][-+]?\d+)?"
COUNTS = {
    quantity: (
        rf"(?i)(counts?\s*(?:per|/)\s*(?:unit\s*)?{quantity})\"?\s*[:=,;\t]+\s*\"?({WHOLE_NUMBER})"
    )
    for quantity in (FORCE, TORQUE)
}
SAMPLE_RATE = rf"(RDT Sample Rate)\"?\s*[:=,;\t]+\s*\"?({WHOLE_NUMBER})"
COUNTER = "RDT Sequence"
# A factor between the numbers of a log and forces, which is not applied.
GAIN = re.compile(
    r"(?i)\b(?<!full[ -])"
    r"((?:scale|scaling|gain|sensitivity|multiplier|(?:conversion|calibration)["
    r" _-]?(?:factor|constant)|"
    rf"(?:lsb|counts?)\s*(?:per\b|/))[^:=;,\t]*)[:=;,\t]+\s*\"?([-+]?(?:{WHOLE_NUMBER}|\.\d+))"
)
RANGE = re.compile(
    r"(?i)\b(?:full[ -]?scale|range|capacity|rated (?:force|load)|max(?:imum|\.)?"
    r" (?:force|load))\b(.*)"
)
FORCE_IN_TEXT = re.compile(rf"(?i)({WHOLE_NUMBER})\s*(m?n|kn|gf|kgf|lbf)\b")


def read_force_text(
    text: TextTable, given: Sequence[LogColumn]
) -> tuple[ForceLog, tuple[LogColumn, ...]]:
    """Return a log in SI and its columns, `given` ones first; ask for missing ones and
    about contradictions.
    """
    stated = _stated_units(text)
    by_header = columns_by_header(text.names, stated, text.units)

    if COUNTER in text.names and (rate_hz := _stated_number(SAMPLE_RATE, text)):
        # ATI's own clock has whole seconds
        by_header = [
            LogColumn("time_s", COUNTER, f"{rate_hz:.12g}Hz"),
            *(c for c in by_header if c.ours != "time_s"),
        ]
    elif not any(column.ours == "time_s" for column in given):
        by_header = _with_best_time(text, by_header)

    answered = _of_each_kind(text.path, by_header, given)
    _check_units(text, [column for column in answered if column not in given], stated)
    flags = _flagged(text, given)
    time, *forces = columns = required_columns(
        text.path, [*answered, *flags], text.names
    )
    text, time_s, wrench_sc = _read_rows(text, time, forces, given)
    remarks = [Remark(MENDED, words) for words in text.notes]
    remarks += _overruled(by_header, given)
    remarks += frame_and_force_tables.gap_remarks(text.path, wrench_sc)

    for column in flags:
        faulty, of_status = _faulty_samples(text, column)
        wrench_sc = np.where(faulty[:, None], np.nan, wrench_sc)
        remarks += of_status

    time_s, mended = log_clocks.mended_times(time_s, text.place, time.factor)
    remarks += [Remark(MENDED, words) for words in mended]
    names = tuple(column.ours for column in forces)
    log = ForceLog(time_s, wrench_sc, names, tuple(remarks))
    return frame_and_force_tables.checked_samples(
        log, text.path, text.place, _range_n(text)
    ), (
        *columns,
        *flags,
    )


def _read_rows(
    text: TextTable,
    time: LogColumn,
    forces: Sequence[LogColumn],
    given: Sequence[LogColumn],
) -> tuple[TextTable, Floats, Floats]:
    """Return a log, its times in s and its forces in SI, shape (samples, columns); if
    rows are broken, of the whole ones alone.
    """
    try:
        time_s, wrench_sc, mark = _read_columns(text, time, forces, given)
    except UnansweredError:
        raise
    except RecordingError:
        whole = _whole_rows(text, time, forces)
        if len(whole.lines) == len(text.lines):
            raise

        text = whole
        time_s, wrench_sc, mark = _read_columns(text, time, forces, given)

    notes = text.notes
    if mark == ",":
        notes = (*notes, "numbers have decimal commas")

    empty = np.asarray(np.isnan(wrench_sc).all(axis=1))
    others = _of_other_clock(time_s, empty)
    if others.any():
        said = f"{others.sum()} of {len(others)} rows of {text.path.name} have no force"
        notes = (*notes, f"{said}, and others beside them: they are left out")
        kept = np.flatnonzero(~others)
        text = replace(
            text,
            lines=tuple(text.lines[line] for line in kept),
            numbers=tuple(text.numbers[line] for line in kept),
        )
        time_s, wrench_sc = time_s[kept], wrench_sc[kept]

    return replace(text, notes=notes), time_s, wrench_sc


# Programs that join signals of several rates (PlotJuggler, pandas) leave the cells of a
# force empty at the times of the others.
LEAST_JOINED = 0.2  # of the rows
LEAST_ROWS = 20
WIDEST_JOINED = 2.5  # times the usual step of the force


def _of_other_clock(time_s: Floats, empty: Flags) -> Flags:
    """Return the rows that have no force because they are of another signal's clock."""
    filled = np.flatnonzero(~empty)
    if empty.mean() < LEAST_JOINED or len(filled) < LEAST_ROWS:
        return np.zeros_like(empty)

    steps_s = np.diff(time_s[filled])
    widest_s = WIDEST_JOINED * float(np.median(steps_s))
    after = np.searchsorted(filled, np.arange(len(empty)))
    before_s = np.append(-np.inf, time_s[filled])[after]
    after_s = np.append(time_s[filled], np.inf)[after]
    # at the ends, near the first or the last force
    apart_s = np.where(np.isfinite(after_s - before_s), after_s - before_s, 0.0)
    at_end_s = np.minimum(time_s - before_s, after_s - time_s)

    return np.asarray(empty & (apart_s <= widest_s) & (at_end_s <= widest_s))


def _read_columns(
    text: TextTable,
    time: LogColumn,
    forces: Sequence[LogColumn],
    given: Sequence[LogColumn],
) -> tuple[Floats, Floats, str]:
    """Return times in s, forces in SI, shape (samples, columns), and the decimal
    mark.
    """
    clock, *parts = time.parts(text.names)
    dated = log_text.is_clock(clock.unit)
    counted = [*parts] if dated else [clock, *parts]
    read = [*counted, *forces]

    places = [text.names.index(column.name) for column in read]
    mark = frame_and_force_tables.decimal_mark(text, places)
    values_sc = frame_and_force_tables.numbers_of(
        text, places, gaps=places[len(counted) :], mark=mark
    )
    _check_whole(text, forces, values_sc[:, len(counted) :], given)
    values_sc *= [column.factor for column in read]
    time_s = values_sc[:, : len(counted)].sum(axis=1)
    if dated:
        time_s = time_s + _dated(text, clock)

    wrench_sc = values_sc[:, len(counted) :]
    return time_s, np.where(np.isinf(wrench_sc), np.nan, wrench_sc), mark


def _dated(text: TextTable, time: LogColumn) -> Floats:
    moments = text.column(time.name)
    time_s = log_text.seconds_of(moments, time.unit)
    if isinstance(time_s, int):
        raise RecordingError(
            f"{text.place(time_s)}: {time.name}: {moments[time_s]!r} is not a time"
            f" ({time.unit})"
        )

    return time_s


def _whole_rows(
    text: TextTable, time: LogColumn, forces: Sequence[LogColumn]
) -> TextTable:
    clock, *_ = time.parts(text.names)
    dated = log_text.is_clock(clock.unit)

    def is_time(cell: str) -> bool:
        if dated:
            return log_text.clock_of(cell) is not None
        return number(cell, ",") is not None

    def is_force(cell: str) -> bool:
        return number(cell, ",") is not None

    return without_broken_rows(
        text,
        text.names.index(clock.name),
        [text.names.index(column.name) for column in forces],
        is_time,
        is_force,
    )


SAMPLED_ROWS = 2000  # by which columns of times are compared


def _with_best_time(text: TextTable, by_header: Sequence[LogColumn]) -> list[LogColumn]:
    """Return columns with one time: the first whose stamps differ from row to row, of
    two columns if the second is a fraction of a second.
    """
    stated = [column for column in by_header if column.ours == "time_s"]
    others = [column for column in by_header if column.ours != "time_s"]
    pairs = [
        column for column in stated if len(column.parts(text.names)) > 1
    ] or _pairs(text.names)
    times = [pair for pair in pairs if _is_sum(text, pair)]
    times += [column for column in stated if column not in pairs]

    if not times:
        times = [_with_fraction(text, column) for column in _clock_column(text)]
    if len(times) < 2:
        return [*times, *others]

    finest = next((each for each in times if _differs(text, each)), times[0])
    return [finest, *others]


def _is_sum(text: TextTable, pair: LogColumn) -> bool:
    """Return whether a pair's first column counts whole units and its second one the
    fraction.
    """
    clock, part = pair.parts(text.names)
    fractions_s = part.factor * _sampled(text, part.name)
    inside = bool(((fractions_s >= 0.0) & (fractions_s < 1.0)).all())
    if log_text.is_clock(clock.unit):
        return inside and len(set(fractions_s.tolist())) > 1

    wholes = _sampled(text, clock.name)
    return inside and bool((wholes == np.rint(wholes)).all())


def _with_fraction(text: TextTable, clock: LogColumn) -> LogColumn:
    """Return a time of day with the column of its fractions, if there is one."""
    for name in text.names:
        found = FRACTION.fullmatch(name)
        if name == clock.name or found is None:
            continue

        both = f"{clock.name}{PLUS}{name}"
        pair = LogColumn("time_s", both, f"{clock.unit}{PLUS}{found.lastgroup}")
        if _is_sum(text, pair):
            return pair

    return clock


def _differs(text: TextTable, time: LogColumn) -> bool:
    """Return whether most rows have another time than the row before."""
    columns = [text.names.index(part.name) for part in time.parts(text.names)]
    rows = [
        tuple(row[at] if at < len(row) else "" for at in columns)
        for row in map(text.fields, range(min(SAMPLED_ROWS, len(text.lines))))
    ]
    same = sum(mine == last for mine, last in pairwise(rows))

    return 2 * same < len(rows)


def _sampled(text: TextTable, name: str) -> Floats:
    """Return the first numbers of a column, NaN for other cells."""
    at = text.names.index(name)
    rows = map(text.fields, range(min(SAMPLED_ROWS, len(text.lines))))
    cells = [number(row[at], ",") if at < len(row) else None for row in rows]
    return np.array([np.nan if cell is None else cell for cell in cells])


def _stated_units(text: TextTable) -> dict[str, str]:
    units = {
        quantity: found[1]
        for quantity, pattern in STATED.items()
        for line in reversed(text.above)
        if (found := re.search(pattern, line))
    }
    counts = {
        quantity: _stated_number(pattern, text) for quantity, pattern in COUNTS.items()
    }

    return {
        quantity: (
            f"{count:.12g}/{unit}" if (count := counts[quantity]) is not None else unit
        )
        for quantity, unit in units.items()
    }


def _check_units(
    text: TextTable, columns: Sequence[LogColumn], stated: dict[str, str]
) -> None:
    """Ask about a column with two units, or with a factor that is not applied; `stated`
    units are above the header.
    """
    forces = [column for column in columns if column.ours != "time_s"]
    own = dict(zip_longest(text.names, text.units, fillvalue=""))

    for column in columns:
        for other in (
            stated.get(quantity_of(column.ours), ""),
            own.get(column.name, ""),
        ):
            factor = unit_factor(other, quantity_of(column.ours))
            if factor is not None and not np.isclose(factor, column.factor, rtol=1e-9):
                raise _question(
                    f"{text.path}: {column.name!r} is in {column.unit} by its name",
                    column,
                    other,
                    columns,
                )

    counted = {quantity_of(column.ours) for column in forces if "/" in column.unit}
    for nth, line in enumerate(text.above, start=1):
        found = GAIN.search(line)
        applied = any(re.search(COUNTS[quantity], line) for quantity in counted)
        if forces and found and not applied and number(found[2]) != 1.0:
            said = (
                f"{text.path}:{nth}: {found[1].strip()}: {found[2]} is not applied to"
                f" {forces[0].name!r}"
            )
            raise _question(said, forces[0], f"1000/{forces[0].unit}", forces)


def _check_whole(
    text: TextTable,
    columns: Sequence[LogColumn],
    values_sc: Floats,
    given: Sequence[LogColumn],
) -> None:
    counted = [
        column for column in columns if "/" in column.unit and column not in given
    ]
    for column, values in zip(columns, values_sc.T, strict=True):
        broken = np.isfinite(values) & (values != np.rint(values))
        if column in counted and broken.any():
            line = int(np.argmax(broken))
            count, unit = column.unit.split("/")
            found = (
                f"{text.place(line)}: {column.name}: {values[line]:g} is not a count"
            )
            raise _question(
                f"{found}, but the header states {count} per {unit}",
                column,
                unit,
                counted,
            )


def _question(
    said: str, column: LogColumn, other: str, columns: Sequence[LogColumn]
) -> UnansweredError:
    forms = (each.answer("UNIT") for each in columns)
    return UnansweredError(
        "columns", f"{said}: {column.answer()} or {column.answer(other)}?", *forms
    )


def _range_n(text: TextTable) -> float:
    stated = [
        each
        for line in text.above
        if (found := RANGE.search(line))
        for each in FORCE_IN_TEXT.findall(found[1])
    ]
    sizes_n = [
        (number(size, ",") or 0.0) * (unit_factor(unit, FORCE) or 0.0)
        for size, unit in stated
    ]

    return max(sizes_n, default=0.0) or np.inf


def _flagged(text: TextTable, given: Sequence[LogColumn]) -> tuple[LogColumn, ...]:
    meanings = {name: _status_meaning(name, text.names) for name in text.names}
    named = {
        name: LogColumn(STATUS, name, meaning)
        for name, meaning in meanings.items()
        if meaning
    }

    return tuple(
        (
            named | {column.name: column for column in given if column.ours == STATUS}
        ).values()
    )


def _overruled(
    by_header: Sequence[LogColumn], given: Sequence[LogColumn]
) -> tuple[Remark, ...]:
    pairs = [
        (said, own)
        for said in given
        for own in by_header
        if (own.ours, own.name) == (said.ours, said.name)
    ]
    differ = [
        (said, own)
        for said, own in pairs
        if not np.isclose(own.factor, said.factor, rtol=1e-9)
    ]

    sentences = (
        f"{a.name}: read in {a.unit} (`columns`), where the log states {b.unit}"
        for a, b in differ
    )
    return tuple(
        Remark("source-contradicted", words, ("columns",)) for words in sentences
    )


def _stated_number(pattern: str, text: TextTable) -> float | None:
    """Return the number that a line above the header states, None without such a line;
    "1,000" is refused.
    """
    for nth, line in enumerate(text.above, start=1):
        if found := re.search(pattern, line):
            value = None if GROUPED.fullmatch(found[2]) else number(found[2], ",")
            if value is None:
                raise RecordingError(
                    f"{text.path}:{nth}: {found[1]}: {found[2]!r} is not a number;"
                    f" {PLAIN_NUMBERS}"
                )

            return value

    return None


FEW_ROWS = 3  # that have no time: remarks at the end
MOST_ROWS = 0.01


def _timecode(path: Path, name: str, moments: Sequence[str]) -> LogColumn:
    rate = log_text.frame_rate(moments)
    if rate is None:
        question = (
            "how many frames a second does its last part count? 25fps, or 100fps of"
            f" hundredths: time={name}:25fps"
        )
        raise UnansweredError(
            "columns", f"{path}: {name}: {moments[0]!r}: {question}", "time=NAME:UNIT"
        )

    return LogColumn("time_s", name, f"{rate}fps")


def _clock_column(text: TextTable) -> list[LogColumn]:
    for name in text.names:
        if (
            re.sub(r"[\W_]+", "_", BRACKETS.sub(r"\g<name>", name)).lower().strip("_")
            not in CLOCK_NAMES
        ):
            continue

        moments = text.column(name)
        counts = Counter(map(log_text.clock_of, moments))
        if counts.pop(None, 0) > max(FEW_ROWS, MOST_ROWS * len(moments)):
            continue

        found = dict.fromkeys(counts)
        if log_text.OF_TIMECODE in found:
            return [_timecode(text.path, name, moments)]
        if known := [clock for clock in found if clock]:
            return [LogColumn("time_s", name, known[0])]
        if found:
            question = (
                f"is the day or the month first? time={name}:dmy says the day,"
                f" time={name}:mdy the month"
            )
            raise UnansweredError(
                "columns",
                f"{text.path}: {name}: {moments[0]!r}: {question}",
                "time=NAME:UNIT",
            )

    return []
