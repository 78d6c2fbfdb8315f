"""The tables of a recording, `frames.csv` and `forces.csv`: read fast, and faults named
by their place.
"""

import csv
import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import RecordingError, StudyError
from scleraforce.base.whole_files import KINDS, FileKind, read_text
from scleraforce.recordings.dead_sensor import no_values
from scleraforce.records.decoder import Source, decode_record
from scleraforce.records.fields import (
    Unit,
    allowed_bounds,
    check_number,
    computed,
)
from scleraforce.records.remark import Remark, sentences

# any number of spaces is one separator
SEPARATORS = ";\t,"
SPACES = " "
NUMBER = re.compile(r"[ \t]*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?[ \t]*", re.ASCII)
# What programs write for a number that does not exist.
NO_NUMBERS = (
    *("", "nan", "na", "n/a", "#n/a", "null", "none", "<na>", "nat", "-", "--", "---"),
    *("inf", "+inf", "-inf", "infinity", "-infinity", "-nan", "nan(ind)", "-nan(ind)"),
    *("#nv", "#num!", "#value!", "1.#qnan", "1.#inf", "-1.#ind"),
)
PLAIN_NUMBERS = "write all numbers with decimal points, and nothing between thousands"
# A comma that may part thousands; "0,250" cannot, for no group of thousands begins with
# 0.
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII)
POINT_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """A table as text."""

    path: Path
    names: tuple[str, ...]
    separator: str
    lines: tuple[str, ...] = ()  # below the header, without blank ones
    numbers: tuple[int, ...] = ()  # of these lines in the file, from 1
    above: tuple[str, ...] = ()  # lines above the header
    units: tuple[str, ...] = ()  # of the columns, from a line of their own
    mark: str | None = None  # the stated decimal mark
    notes: tuple[str, ...] = ()  # on how it was read, and lines that were left out

    @property
    def delimiter(self) -> str | None:
        """The separator for NumPy: None for any number of spaces."""
        return None if self.separator == SPACES else self.separator

    def place(self, line: int) -> str:
        """Return the file and line number of the line with an index, for messages."""
        return f"{self.path}:{self.numbers[line]}"

    def fields(self, line: int) -> tuple[str, ...]:
        """Return the fields of the line with an index, without empty ones at its
        end.
        """
        text = self.lines[line]
        return fields_of(
            text.rstrip(f" {self.separator}"), self.separator, self.place(line)
        )

    def column(self, name: str) -> list[str]:
        """Return a column as text; empty on lines that end before it."""
        at = self.names.index(name)
        return [
            row[at] if len(row) > at else ""
            for row in map(self.fields, range(len(self.lines)))
        ]


def read_table(
    path: Path, kind: FileKind, known: tuple[str, ...], required: tuple[str, ...]
) -> TextTable:
    """Return a table of a recording, whose first line names its columns: some of
    `known`, and all `required` ones.
    """
    header, *lines = read_text(path, kind).splitlines() or [""]
    separator = next((mark for mark in SEPARATORS if mark in header), ",")

    names = fields_of(header.rstrip(f" \t{separator}"), separator, f"{path}:1")
    if not any(names):
        raise RecordingError(
            f"{path}: empty; the first line names the columns: {','.join(known)}"
        )
    if unknown := [name for name in names if name not in known]:
        raise RecordingError(
            f"{path}:1: unknown column {unknown[0]!r}; known: {', '.join(known)}"
        )
    if twice := [name for name in names if names.count(name) > 1]:
        raise RecordingError(f"{path}:1: two columns are named {twice[0]}")
    if missing := [name for name in required if name not in names]:
        raise RecordingError(
            f"{path}:1: column {missing[0]} is missing; found: {', '.join(names)}"
        )

    bare = {
        nth: text
        for nth, line in enumerate(lines, start=2)
        if (text := line.rstrip(f" \t{separator}"))
    }
    table = TextTable(
        path=path,
        names=names,
        separator=separator,
        lines=tuple(bare.values()),
        numbers=tuple(bare),
    )
    # A separator at the end of a line of frames.csv is taken for a spreadsheet's: an
    # empty field is cut.
    check_field_counts(
        table,
        1 + max(map(names.index, required)) if kind == KINDS["frames"] else len(names),
    )

    return table


def check_field_counts(table: TextTable, least: int | None = None) -> None:
    """Refuse a line with more fields than the header, or with fewer than `least` (None:
    as most lines have).
    """
    names = len(table.names)
    counts = field_counts(table)
    least = (
        Counter(counts).most_common(1)[0][0] if least is None and counts else least or 0
    )

    for line, count in enumerate(counts):
        if not least <= count <= names:
            most = f", most lines {least}" if count < least < names else ""
            hint = (
                "; with decimal commas, columns are separated by semicolons"
                if table.separator == "," and count > names
                else ""
            )
            raise RecordingError(
                f"{table.place(line)}: {count} fields; the header has"
                f" {names}{most}{hint}"
            )


def field_counts(table: TextTable) -> list[int]:
    """Return the number of fields of each line, without empty ones behind the last
    column.
    """
    return [_count(table, line) for line in range(len(table.lines))]


def _count(table: TextTable, line: int) -> int:
    """Return the number of fields of a line, without empty ones behind the last
    column.
    """
    text = table.lines[line]
    names = len(table.names)

    separator = table.separator
    if '"' in text or separator == SPACES:
        fields = fields_of(text, separator, table.place(line))
        filled = max(
            (nth for nth, field in enumerate(fields, start=1) if field), default=0
        )

        return len(fields) if len(fields) <= names else max(names, filled)

    count = text.count(separator) + 1
    return (
        count
        if count <= names
        else max(names, text.rstrip(f" \t{separator}").count(separator) + 1)
    )


def fields_of(line: str, separator: str, place: str) -> tuple[str, ...]:
    """Return the fields of one line, without quotes and without spaces around them;
    `place` is for messages.
    """
    if separator == SPACES:
        return tuple(line.split())

    try:
        row = next(
            csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True),
            [],
        )
    except csv.Error as fault:
        raise RecordingError(
            f"{place}: {fault}; each line is a row of its own, and quotes end on it"
        ) from fault

    return tuple(field.strip() for field in row)


def number(text: str, mark: str = ".") -> float | None:
    """Return a decimal number in ASCII, or None; `mark` is the decimal mark, a point or
    a comma.
    """
    if mark == "," and "." not in text:
        text = text.replace(",", ".")
    return float(text) if NUMBER.fullmatch(text) else None


def is_number(text: str) -> bool:
    """Return whether a text is a number, whatever its commas mean."""
    return number(text, ",") is not None or GROUPED.fullmatch(text.strip()) is not None


def decimal_mark(table: TextTable, read: Collection[int]) -> str:
    """Return the decimal mark of a table's numbers, "." or ","; a comma is one only if
    the table proves it.

    The proof is a comma that cannot part thousands (0,25 or 1,5), without a number that
    has a point. Columns outside `read` only bear witness. A number with two possible
    readings is refused.
    """
    lines = table.lines
    place = table.place
    if table.separator == "," or not any("," in line for line in lines):
        return "."

    comma: tuple[int, int, str] | None = None
    pointed = table.mark == "."
    proven = table.mark == ","
    no_point = not any("." in line for line in lines)

    for index, line in enumerate(lines):
        if no_point and proven and comma is not None:
            break

        fields = (
            fields_of(line, table.separator, place(index))
            if '"' in line
            else line.split(table.delimiter)
        )
        for column, field in enumerate(map(str.strip, fields)):
            if not is_number(field):
                continue

            pointed |= "." in field
            proven |= "," in field and not GROUPED.fullmatch(field)

            if field.count(",") > 1 and column in read:
                raise RecordingError(
                    f"{place(index)}: {field!r} has commas between thousands;"
                    f" {PLAIN_NUMBERS}"
                )

            if comma is None and "," in field and column in read:
                comma = index, column, field

    if comma is None:
        return "."
    if proven and not pointed:
        return ","

    index, column, field = comma
    name = table.names[column] if column < len(table.names) else f"column {column + 1}"
    why = (
        "other numbers have decimal points"
        if pointed
        else "every comma has three digits behind it"
    )
    one = field.replace(",", ".", 1)
    other = field.replace(",", "")
    readings = f"{one} with a decimal comma, or {other} with one between thousands"
    raise RecordingError(
        f"{place(index)}: {name}: {field!r} is {readings} ({why}); {PLAIN_NUMBERS}"
    )


def numbers_of(
    table: TextTable,
    places: Sequence[int],
    gaps: Sequence[int] = (),
    mark: str | None = None,
    ours: bool = False,
) -> Floats:
    """Return columns (sample, column) of a table with checked counts of fields; at
    `gaps`, nan or nothing is NaN.

    In `ours`, a table of a recording, nothing is not a gap, and a point is a decimal
    one.
    """
    mark = mark or decimal_mark(table, places)
    if not table.lines:
        raise RecordingError(f"{table.path}: no samples below the header")

    lines = (
        [line.replace(",", ".") for line in table.lines] if mark == "," else table.lines
    )
    form: dict[str, Any] = {
        "delimiter": table.delimiter,
        "comments": None,
        "quotechar": '"',
        "ndmin": 2,
    }

    try:  # NumPy is ten times as fast as Python
        values_sc = np.loadtxt(lines, usecols=tuple(places), dtype=np.float64, **form)
    except ValueError:
        empty = ("nan",) if ours else NO_NUMBERS
        values_sc = np.array(
            [
                _row_numbers(table, line, places, gaps, mark, empty)
                for line in range(len(lines))
            ]
        )

    if mark == "." and not ours:
        _check_points(table, places, values_sc)

    return values_sc


def _check_points(table: TextTable, places: Sequence[int], values_sc: Floats) -> None:
    """Refuse a column whose points may part thousands: -15.000 beside 998, and three
    digits behind every point.
    """
    for place, values in zip(places, values_sc.T, strict=True):
        size = np.abs(values[np.isfinite(values)])
        whole = size == np.rint(size)
        if (
            whole.all()
            or not whole.any()
            or size.max() >= 1000.0
            or (size[~whole] < 1.0).any()
        ):
            continue

        texts = table.column(table.names[place])
        pointed = [line for line, field in enumerate(texts) if "." in field]
        if len(pointed) == len(texts) or not all(
            POINT_GROUPED.fullmatch(texts[line]) for line in pointed
        ):
            continue

        found = (
            f"{table.place(pointed[0])}: {table.names[place]}:"
            f" {(field := texts[pointed[0]])!r}"
        )
        readings = (
            f"{float(field):g} with a decimal point, or {field.replace('.', '')} with"
            " one between thousands"
        )
        why = "every point has three digits behind it, other numbers have none"
        raise RecordingError(f"{found} is {readings} ({why}); {PLAIN_NUMBERS}")


def _row_numbers(
    table: TextTable,
    line: int,
    places: Sequence[int],
    gaps: Sequence[int],
    mark: str,
    empty: Sequence[str],
) -> list[float]:
    fields = table.fields(line)
    values = []

    for place in places:
        field = fields[place] if place < len(fields) else ""
        value = number(field, mark)
        if value is None and not (place in gaps and field.lower() in empty):
            hint = (
                "; write nan where the sensor gave no force"
                if place in gaps and not field
                else ""
            )
            raise RecordingError(
                f"{table.place(line)}: {table.names[place]}: {field!r} is not a"
                f" number{hint}"
            )

        values.append(np.nan if value is None else value)

    return values


FORCE_COLUMNS = ("time_s", "fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
GOOD_SAMPLE_RATE_HZ = 100.0
# A push takes 0.2 s or more: at fewer samples a second it has less than four, and a
# clock in ms is read as one in s.
MIN_SAMPLE_RATE_HZ = 20.0
# Beyond, a number is damage: 300 years (clocks may count from 1970), and a thousand
# times what such a sensor bears.
LARGEST_TIME_S = 1e10
LARGEST_FORCE = 1e6  # N, and N m of a torque
TIME = Unit(low=-LARGEST_TIME_S, high=LARGEST_TIME_S, exact=True)
FORCE = Unit(low=-LARGEST_FORCE, high=LARGEST_FORCE, exact=True)
# A sample is not a force beyond 1,000 times the median distance from the log's median
# (or the sensor's step, if that is larger), but never below 3 N: no needle pushes an
# eye by more, and on a quiet log 60 mN are 1,000 times its noise.
IMPLAUSIBLE_RATIO = 1000.0
LEAST_IMPLAUSIBLE_N = 3.0
# different values of a log that tell the sensor's step: rest, a push and a burst are
# three
LEAST_LEVELS = 4
# share of implausible samples above which the log's usual size is in doubt
MOST_IMPLAUSIBLE = 1.0 / 3.0


@dataclass(frozen=True)
class FrameEntry:
    """A line of frames.csv: name below `frames/`, time on the log's clock, whether the
    needle had pierced, if stated.

    `travel_m`: the needle's travel along its axis, inwards, from any start. `held_s`:
    the time since the needle's push, which it has held since. `plane`: the name of the
    frame's plane, if there are several. `iop_pa`: the pressure without the needle, if
    it was changed. None: not known.
    """

    file: str
    time_s: float = computed(-LARGEST_TIME_S, LARGEST_TIME_S)
    pierced: bool | None = None
    travel_m: float | None = computed(-1.0, 1.0, default=None)
    held_s: float | None = computed(0.0, LARGEST_TIME_S, default=None)
    plane: str | None = None
    iop_pa: float | None = computed(1.0, allowed_bounds("iop_pa").high, default=None)

    def __post_init__(self) -> None:
        path = PurePosixPath(self.file)
        if (
            not self.file
            or "\\" in self.file
            or not self.file.isprintable()
            or path.is_absolute()
            or ".." in path.parts
        ):
            raise StudyError(f"file: {self.file!r} is not a name below frames/")


FRAME_COLUMNS = tuple(item.name for item in fields(FrameEntry))
FRAME_NUMBERS = ("time_s", "travel_m", "held_s", "iop_pa")


@dataclass(frozen=True)
class ForceLog:
    """A force log: `time_s` (samples,), increasing, and the other columns of the file:
    forces in N, torques in N m.

    `wrench_sc` has shape (samples, columns), NaN where the sensor gave no force;
    `columns` are their names, like `fz_n`; `remarks` say how it was read, which samples
    have no force, and whether its rate is low.
    """

    time_s: Floats
    wrench_sc: Floats
    columns: tuple[str, ...]
    remarks: tuple[Remark, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the remarks."""
        return sentences(self.remarks)

    @cached_property
    def sample_rate_hz(self) -> float:
        """Samples a second, from the median interval."""
        return 1.0 / float(np.median(np.diff(self.time_s)))

    def force_n(self, axis: str) -> Floats:
        """Return the force along fx, fy or fz in N, shape (samples,)."""
        return self.wrench_sc[:, self.columns.index(f"{axis}_n")]

    def known(self, axis: str) -> "ForceLog":
        """Return the samples that have a force along fx, fy or fz."""
        known = np.isfinite(self.force_n(axis))
        return replace(self, time_s=self.time_s[known], wrench_sc=self.wrench_sc[known])


def read_frame_list(path: Path) -> tuple[FrameEntry, ...]:
    """Read frames.csv, in its order."""
    table = read_table(path, KINDS["frames"], FRAME_COLUMNS, ("file", "time_s"))
    mark = decimal_mark(
        table,
        [at for at, name in enumerate(table.names) if name in FRAME_NUMBERS],
    )
    entries: list[FrameEntry] = []
    seen = dict[str, int]()
    planes = set[tuple[float, str | None]]()

    for index, line in enumerate(table.numbers):
        place = table.place(index)
        entry = _frame_entry(
            place, dict(zip(table.names, table.fields(index), strict=False)), mark
        )
        if seen.setdefault(entry.file, line) != line:
            raise RecordingError(
                f"{place}: file: {entry.file} is in line {seen[entry.file]} already"
            )

        last_s = entries[-1].time_s if entries else -np.inf
        if (
            entry.time_s == last_s
            and entry.plane is not None
            and (last_s, entry.plane) in planes
        ):
            raise RecordingError(
                f"{place}: plane: {entry.plane!r} has a frame at {entry.time_s:g} s"
                " already"
            )

        planes.add((entry.time_s, entry.plane))
        if entry.time_s < last_s or (
            entry.time_s == last_s and (last_s, None) in planes
        ):
            found = f"{entry.time_s:g} does not come after {last_s:g}"
            raise RecordingError(
                f"{place}: time_s: {found}; frames are in the order of their times, one"
                " at a time"
            )

        entries.append(entry)

    if not entries:
        raise RecordingError(f"{path}: no frames; give a line for each frame")

    return tuple(
        entry for moment in moments_of(entries) for entry in _of_moment(path, moment)
    )


def moments_of(frames: Sequence[FrameEntry]) -> tuple[tuple[FrameEntry, ...], ...]:
    """Return frames in their order, grouped by their time: one, or one of each
    plane.
    """
    return tuple(
        tuple(group) for _, group in groupby(frames, lambda entry: entry.time_s)
    )


def _of_moment(path: Path, entries: Sequence[FrameEntry]) -> Sequence[FrameEntry]:
    """Return the frames of one moment: there is one needle, which has pierced if a
    plane says so, and one pressure.
    """
    for name in ("held_s", "iop_pa"):
        found = sorted(
            {value for entry in entries if (value := getattr(entry, name)) is not None}
        )
        if len(found) > 1:
            differ = " and ".join(f"{value:g}" for value in found)
            raise RecordingError(
                f"{path}: {name}: {differ} at {entries[0].time_s:g} s; planes of one"
                " moment have one"
            )

    pierced = any(entry.pierced for entry in entries)
    return [replace(entry, pierced=True) for entry in entries] if pierced else entries


def read_force_log(path: Path, axis: str, range_n: float = np.inf) -> ForceLog:
    """Read forces.csv; `axis` (fx, fy or fz) must be among its columns.

    `range_n` is the sensor's stated range, infinite without one.
    """
    table = read_table(path, KINDS["forces"], FORCE_COLUMNS, ("time_s", f"{axis}_n"))
    columns = tuple(name for name in table.names if name != "time_s")
    forces = [table.names.index(name) for name in columns]
    values_sc = numbers_of(
        table, [table.names.index("time_s"), *forces], gaps=forces, ours=True
    )
    log = ForceLog(values_sc[:, 0].copy(), values_sc[:, 1:], columns)

    log = checked_samples(
        replace(log, remarks=gap_remarks(path, log.force_n(axis))),
        path,
        table.place,
        range_n,
    )
    if not np.isfinite(log.force_n(axis)).any():
        raise RecordingError(f"{path}: {axis}_n: no sample has a force; all are nan")

    return log


def checked_samples(
    log: ForceLog, path: Path, place: Callable[[int], str], range_n: float = np.inf
) -> ForceLog:
    """Return a log with NaN for samples that are implausible or no measurements, and
    remarks; refuse a bad clock, or too many implausible ones.
    """
    if len(log.time_s) < 2:
        raise RecordingError(f"{path}: fewer than two samples of the force")

    rate_hz = _checked_rate(log, path, place)
    remarks = list(log.remarks)
    wrench_sc = _without_implausible(log, place, range_n, remarks)
    for found in no_values(wrench_sc, log.columns, log.time_s, range_n):
        wrench_sc = np.where(found.samples[:, None], np.nan, wrench_sc)
        count = f"{found.samples.sum()} of {len(found.samples)} samples"
        first = place(int(np.argmax(found.samples)))
        words = (
            f"{count} are no measurements and have no force: {found.words}; the first"
            f" is {first}"
        )
        remarks.append(Remark(WITHOUT_FORCE, words))

    if rate_hz < GOOD_SAMPLE_RATE_HZ * 0.999:
        noise = (
            f"the noise of a label is {np.sqrt(GOOD_SAMPLE_RATE_HZ / rate_hz):.2g}"
            " times as large"
        )
        vibration = f"vibration faster than {rate_hz / 2:.3g} Hz is taken for force"
        said = (
            f"{rate_hz:.4g} samples a second, {GOOD_SAMPLE_RATE_HZ:g} are recommended"
        )
        words = f"{path.name}: {said}: {noise}, and {vibration}"
        remarks.append(Remark("log-slow", words))

    return replace(log, wrench_sc=wrench_sc, remarks=tuple(remarks))


WITHOUT_FORCE = "samples-without-force"


def gap_remarks(path: Path, forces: Floats) -> tuple[Remark, ...]:
    """Return a remark on the samples (sample, ...) of a file that have no force."""
    missing = int(np.isnan(forces.reshape(len(forces), -1)).any(axis=1).sum())
    words = f"{path.name}: {missing} of {len(forces)} samples have no force (nan)"
    return (Remark(WITHOUT_FORCE, words),) if missing else ()


def _without_implausible(
    log: ForceLog, place: Callable[[int], str], range_n: float, remarks: list[Remark]
) -> Floats:
    beyond = np.zeros(log.wrench_sc.shape, dtype=bool)
    limits_n = {}

    for column, name in enumerate(log.columns):
        force_n = log.wrench_sc[:, column]
        known_n = force_n[np.isfinite(force_n)]
        if not name.endswith("_n") or not len(known_n):
            continue

        middle_n = float(np.median(known_n))
        levels_n = np.unique(known_n)
        step_n = (
            float(np.diff(levels_n).min()) if len(levels_n) >= LEAST_LEVELS else 0.0
        )
        typical_n = max(float(np.median(np.abs(known_n - middle_n))), step_n)
        limits_n[column] = limit_n = max(
            IMPLAUSIBLE_RATIO * typical_n, LEAST_IMPLAUSIBLE_N
        )
        beyond[:, column] = (np.abs(force_n - middle_n) > limit_n) | (
            np.abs(force_n) > range_n
        )

    if not beyond.any():
        return log.wrench_sc

    flagged: Flags = np.asarray(beyond.any(axis=1))
    sample, column = np.argwhere(beyond)[0].tolist()
    value_n = log.wrench_sc[sample, column]
    beside = f"{limits_n[column]:.3g} N off its median is the most"
    why = f"the sensor's range is {range_n:g} N" if abs(value_n) > range_n else beside
    found = f"{log.columns[column]}: {value_n:.4g} N ({why})"
    count = f"{flagged.sum()} of {len(flagged)} samples"

    if flagged.mean() > MOST_IMPLAUSIBLE:
        raise RecordingError(
            f"{place(sample)}: {found}; {count} are implausible: check the unit and the"
            " sensor"
        )

    words = (
        f"{count} are implausible and have no force; the first is {place(sample)}:"
        f" {found}; is it in N?"
    )
    remarks.append(Remark(WITHOUT_FORCE, words))
    return np.where(flagged[:, None], np.nan, log.wrench_sc)


def _checked_rate(log: ForceLog, path: Path, place: Callable[[int], str]) -> float:
    """Return the samples a second; more than half of the steps are as short as that
    rate's. Check all numbers.
    """
    columns = ("time_s", *log.columns)
    values_sc = np.column_stack([log.time_s, log.wrench_sc])
    largest_c = np.array([LARGEST_TIME_S, *[LARGEST_FORCE] * len(log.columns)])
    # a NaN is bad as well: of a time; of a force it says that there is none
    bad = ~(np.abs(values_sc) <= largest_c)
    bad[:, 1:] &= ~np.isnan(log.wrench_sc)

    for sample, column in np.argwhere(bad)[:1].tolist():
        unit = FORCE if column else TIME
        try:
            check_number(columns[column], values_sc[sample, column], unit)
        except StudyError as fault:
            raise RecordingError(f"{place(sample)}: {fault}") from None

    steps_s = np.diff(log.time_s)
    if (steps_s <= 0.0).any():
        sample = int(np.argmax(steps_s <= 0.0)) + 1
        found = (
            f"{log.time_s[sample]:.12g} does not come after"
            f" {log.time_s[sample - 1]:.12g}"
        )
        raise RecordingError(
            f"{place(sample)}: time_s: {found}; the clock must run forward:"
            " `scleraforce import` mends stamps that repeat and counters that overflow"
        )

    rate_hz = 1.0 / float(np.quantile(steps_s, 0.5, method="higher"))
    if rate_hz < MIN_SAMPLE_RATE_HZ * 0.999:
        needed = (
            f"at least {MIN_SAMPLE_RATE_HZ:g} are needed to follow a push of 0.2 s"
            " (times are in seconds)"
        )
        raise RecordingError(
            f"{path}: time_s: {rate_hz:.4g} samples a second; {needed}"
        )

    return rate_hz


def _frame_entry(place: str, row: dict[str, str], mark: str) -> FrameEntry:
    given: dict[str, Any] = {name: text for name, text in row.items() if text}
    given.setdefault("file", "")
    for name in given.keys() & FRAME_NUMBERS:
        found = number(given[name], mark)
        given[name] = given[name] if found is None else found

    if "pierced" in given:
        if given["pierced"] not in ("0", "1"):
            raise RecordingError(f"{place}: pierced: {given['pierced']!r}; give 0 or 1")
        given["pierced"] = given["pierced"] == "1"

    try:
        return decode_record(FrameEntry, given, Source(place))
    except StudyError as fault:
        raise RecordingError(str(fault)) from None
