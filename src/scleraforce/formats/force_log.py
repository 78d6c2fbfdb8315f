"""Force logs as robots and sensors write them: delimited text, any columns, with or without settings above them."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError, RecordingError
from scleraforce.formats.clock_times import CLOCKS, clock_of, seconds_of
from scleraforce.formats.log_columns import (
    LogColumn,
    clock_columns,
    columns_by_header,
    of_each_kind,
    required_columns,
)
from scleraforce.formats.log_text import LogText, mark_of, numbers_of, texts_of
from scleraforce.formats.sample_status import STATUS, faulty_samples, status_meaning
from scleraforce.formats.scan import UnansweredError
from scleraforce.formats.stated_units import FORCE, TORQUE, quantity_of, unit_factor
from scleraforce.recording.tables import ForceLog, checked_samples, gap_notes

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
    mark = mark_of(text, read)
    values_sc = numbers_of(text, read, gaps=places[1:], mark=mark)
    _check_whole(text, columns[1:], values_sc[:, -len(columns) + 1 :], told)
    values_sc *= [column.factor for column in columns[1 if dated else 0 :]]
    time_s, wrench_sc = (_moments(text, columns[0]), values_sc) if dated else (values_sc[:, 0], values_sc[:, 1:])
    notes = ["numbers have decimal commas"] if mark == "," else []
    notes += [*_overruled(by_header, told), *gap_notes(text.path, wrench_sc)]
    flags = _flagged(text, told)
    faulty = np.zeros(len(text.lines), dtype=bool)
    for column in flags:
        found, said = faulty_samples(column.name, column.unit, texts_of(text, column.name), text.place)
        faulty |= found
        notes += said
    wrench_sc = np.where(faulty[:, None], np.nan, wrench_sc)
    log = ForceLog(time_s, wrench_sc, tuple(column.ours for column in columns[1:]), tuple(notes))
    return checked_samples(log, text.path, text.place, _range_n(text)), (*columns, *flags)


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


def _clock_column(text: LogText) -> list[LogColumn]:
    """Return the column of dates or times of day, where one has such a name.

    Raises:
        UnansweredError: day and month may change places.
    """
    for name in clock_columns(text.names):
        found = dict.fromkeys(clock_of(moment) for moment in texts_of(text, name).tolist())
        if None in found:
            continue
        known = [clock for clock in found if clock]
        if known:
            return [LogColumn("time_s", name, known[0])]
        if found:
            example = str(texts_of(text, name)[0])
            raise UnansweredError(
                "--column",
                f"{text.path}: {name}: {example!r}: is the day or the month first? time={name}:dmy says the day, "
                f"time={name}:mdy the month",
                "time=NAME:UNIT",
            )
    return []


def _moments(text: LogText, column: LogColumn) -> NDArray[np.float64]:
    """Return dates and times in s since 1970; without a zone they are of UTC."""
    texts = texts_of(text, column.name).tolist()
    found = seconds_of(texts, column.unit)
    if isinstance(found, int):
        raise RecordingError(f"{text.place(found)}: {column.name}: {texts[found]!r} is not a time ({column.unit})")
    return found
