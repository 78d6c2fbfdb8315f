"""Which column of a force log is which, and in what unit: as its header says, or as somebody answered."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from scleraforce.errors import InputError
from scleraforce.formats.clock_times import CLOCKS
from scleraforce.formats.sample_status import STATUS, STATUS_MEANINGS
from scleraforce.formats.scan import UnansweredError
from scleraforce.formats.stated_units import FORCE, TIME, TORQUE, quantity_of, unit_factor
from scleraforce.recording.tables import FORCE_COLUMNS

SHORT_NAMES = {name.partition("_")[0]: name for name in FORCE_COLUMNS} | {STATUS: STATUS}  # fz: fz_n
# A unit in brackets, or after a mark or a blank: "Fz [mN]", "Force Z / mN", "FZ,mN", "fz_mN", "F_z in mN".
BRACKETS = re.compile(r"(?P<name>.*?)[\s_,:]*[\[({<](?P<unit>[^\])}>]+)[\])}>]\s*")
BEHIND_MARK = re.compile(
    r"(?P<name>.*?)(?:\s*[/,:;|_.-]\s*|\s+in\s+|_in_|\s+)(?P<unit>[^\s_/,:;|]+(?:[*.-][^\s_]+)?)\s*"
)
TIME_NAMES = {
    "time", "t", "timestamp", "host_time", "stamp", "elapsed", "elapsed_time", "time_stamp", "sample_time",
    "relative_time", "x_value", "zeit", "zeitstempel", "messzeit", "temps", "tiempo", "tempo", "header.stamp",
}  # fmt: skip
CLOCK_NAMES = TIME_NAMES | {
    "date", "datetime", "date_time", "date_and_time", "time_of_day", "clock", "datum", "datum_zeit", "datum_uhrzeit",
    "uhrzeit", "heure", "horodatage", "date_heure", "fecha", "hora",
}  # fmt: skip
ROS_STAMP, ROS_PREFIX = "field.header.stamp", "field."  # of `rostopic echo -p`: capture, in ns; SI otherwise
FORCE_WORDS, TORQUE_WORDS = "force|kraft|effort|fuerza|forza|f", "torque|moment|drehmoment|couple|t|m"
BETWEEN = r"[ ._-]*(?:(?:in|along|axis|achse|richtung)[ ._-]*)?"
AXIS_NAMES = re.compile(
    rf"(?:(?P<what>{FORCE_WORDS}|{TORQUE_WORDS}){BETWEEN}(?P<axis>[xyz])|"
    rf"(?P<axis_before>[xyz])[ ._-]*(?:(?:axis|achse)[ ._-]*)?(?P<what_after>{FORCE_WORDS}|{TORQUE_WORDS}))"
    r"(?:[ ._-]*(?:axis|achse|richtung))?"
)
FORCE_WORD = re.compile(FORCE_WORDS)


@dataclass(frozen=True)
class LogColumn:
    """A column of a log: which of ours it is, its name there, its unit.

    Dates and times of day have one of `CLOCKS` for a unit, the sensor's status one of `STATUS_MEANINGS`.
    """

    ours: str
    name: str
    unit: str

    @property
    def factor(self) -> float:
        """How many of SI one of its unit is."""
        return unit_factor(self.unit, quantity_of(self.ours)) or 1.0

    def answer(self) -> str:
        """Return the column as `parse_column` reads it."""
        return f"{self.ours.partition('_')[0]}={self.name}:{self.unit}"


def parse_column(text: str) -> LogColumn:
    """Return a column that somebody stated as COLUMN=NAME:UNIT.

    >>> parse_column("fz=Force Z:mN")
    LogColumn(ours='fz_n', name='Force Z', unit='mN')

    Raises:
        InputError: it is of another form, or the unit is not known.
    """
    short, equals, rest = text.partition("=")
    name, colon, unit = rest.rpartition(":")
    ours, unit = SHORT_NAMES.get(short.strip().lower()), unit.strip()
    if not equals or not colon or ours is None or not name.strip():
        raise InputError(f"--column: {text!r}; give COLUMN=NAME:UNIT, like fz=Force Z:mN, of {', '.join(SHORT_NAMES)}")
    words = {"time_s": CLOCKS, STATUS: STATUS_MEANINGS}.get(ours, ())
    if ours == STATUS and unit not in words:
        raise InputError(f"--column: {text!r}: {unit!r} is not one of {', '.join(words)} (docs/formats.md)")
    if unit not in words and unit_factor(unit, quantity_of(ours)) is None:
        raise InputError(f"--column: {text!r}: {unit!r} is no unit of {quantity_of(ours)} (docs/formats.md)")
    return LogColumn(ours, name.strip(), unit)


def columns_by_header(names: Sequence[str], stated_units: dict[str, str], units: Sequence[str] = ()) -> list[LogColumn]:
    """Return the columns that a header names with their units, in their order.

    Args:
        names: of the columns.
        stated_units: of force, torque and time where lines above the header state them.
        units: of the columns where a line of its own states them.

    >>> [column.answer() for column in columns_by_header(["Time (ms)", "Fz [N]", "Temp (C)"], {})]
    ['time=Time (ms):ms', 'fz=Fz [N]:N']
    """
    if ROS_STAMP in names:
        names = [name for name in names if name == ROS_STAMP or name.startswith(ROS_PREFIX)]
        stated_units = {FORCE: "N", TORQUE: "Nm", TIME: "ns"}
    each = zip_longest(names, units[: len(names)], fillvalue="")
    return [column for name, unit in each if (column := _by_name(name, unit, stated_units)) is not None]


def of_each_kind(path: Path, by_header: Sequence[LogColumn], told: Sequence[LogColumn]) -> list[LogColumn]:
    """Return one column of each kind: the one that was stated, else that of the header; of two times the first.

    Raises:
        UnansweredError: two columns of the header are the same force.
    """
    answered = {column.ours: column for column in told if column.ours != STATUS}
    for column in by_header:
        other = answered.setdefault(column.ours, column)
        if other != column and other not in told and column.ours != "time_s":
            short = column.ours.partition("_")[0]
            raise UnansweredError(
                "--column", f"{path}: {short}: is it {other.name!r} or {column.name!r}?", f"{short}=NAME:UNIT"
            )
    return list(answered.values())


def clock_columns(names: Sequence[str]) -> list[str]:
    """Return the names that dates and times of day have.

    >>> clock_columns(["Date/Time", "Fz [N]", "Uhrzeit", "Time (UTC)"])
    ['Date/Time', 'Uhrzeit', 'Time (UTC)']
    """
    return [
        name
        for name in names
        if re.sub(r"[\W_]+", "_", BRACKETS.sub(r"\g<name>", name)).lower().strip("_") in CLOCK_NAMES
    ]


def required_columns(path: Path, columns: Iterable[LogColumn], names: Sequence[str]) -> tuple[LogColumn, ...]:
    """Return the columns, in our order, where the time and a force are among them.

    Raises:
        UnansweredError: they are not; the question lists the names.
        InputError: a column is not in the log.
    """
    found = {column.ours: column for column in columns}
    listed = ", ".join(repr(name) for name in names)
    for column in found.values():
        if column.name not in names:
            raise InputError(f"{path}: --column: no column {column.name!r}; there are {listed}")
        if list(names).count(column.name) > 1:
            raise InputError(f"{path}: two columns are named {column.name!r}; rename one of them")
    missing = [word for word, there in (("time", "time_s" in found), ("fz", _has_force(found))) if not there]
    if missing:
        what = "the time" if missing == ["time"] else "a force" if missing == ["fz"] else "the time, and which a force"
        raise UnansweredError(
            "--column",
            f"{path}: which column is {what}, and in what unit? There are {listed}",
            *(f"{short}=NAME:UNIT" for short in missing),
        )
    return tuple(found[ours] for ours in FORCE_COLUMNS if ours in found)


def _has_force(found: dict[str, LogColumn]) -> bool:
    return any(quantity_of(ours) == FORCE for ours in found)


def _by_name(name: str, unit: str, stated_units: dict[str, str]) -> LogColumn | None:
    """Return the column of ours that a name with a unit stands for, None where it is none or has no unit."""
    bare = name.strip().removeprefix(ROS_PREFIX).removeprefix("wrench.")
    bracketed, marked = BRACKETS.fullmatch(bare), BEHIND_MARK.fullmatch(bare)
    parted = [(found["name"], found["unit"]) for found in (bracketed, marked) if found]
    for word, own in (*parted, (bare, unit)):
        ours = _ours(word)
        if ours is None:
            continue
        quantity = quantity_of(ours)
        for text in (own, *([unit] if unit else []), *([stated_units[quantity]] if quantity in stated_units else [])):
            if text and unit_factor(text, quantity) is not None:
                return LogColumn(ours, name, text.strip())
    return None


def _ours(word: str) -> str | None:
    """Return our column of a word.

    >>> _ours("force_z"), _ours("Mx"), _ours("Kraft Z"), _ours("z-force"), _ours("timestamp"), _ours("temperature")
    ('fz_n', 'tx_nm', 'fz_n', 'fz_n', 'time_s', None)
    """
    lower = word.strip().lower()
    if re.sub(r"[ -]", "_", lower) in TIME_NAMES:
        return "time_s"
    found = AXIS_NAMES.fullmatch(lower)
    if found is None:
        return None
    what, axis = found["what"] or found["what_after"], found["axis"] or found["axis_before"]
    return SHORT_NAMES[("f" if FORCE_WORD.fullmatch(what) else "t") + axis]
