"""Which column of a force log is which, and in what unit: as its header says, or as somebody answered."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import InputError
from scleraforce.formats.scan import UnansweredError
from scleraforce.formats.stated_units import FORCE, TIME, TORQUE, quantity_of, unit_factor
from scleraforce.recording.tables import FORCE_COLUMNS

__all__ = ["LogColumn", "columns_by_header", "parse_column", "required_columns"]

SHORT_NAMES = {name.partition("_")[0]: name for name in FORCE_COLUMNS}  # fz: fz_n
WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]+)[\])]\s*")
TIME_NAMES = {"time", "t", "timestamp", "host_time", "stamp", "elapsed", "elapsed_time", "time_stamp"}
ROS_STAMP, ROS_PREFIX = "field.header.stamp", "field."  # of `rostopic echo -p`: capture, in ns; SI otherwise
AXIS_NAMES = re.compile(r"(?P<what>force|torque|moment|f|t|m)[ ._]?(?P<axis>[xyz])")


@dataclass(frozen=True)
class LogColumn:
    """A column of a log: which of ours it is, its name there, its unit ("iso": a date and time)."""

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
    ours = SHORT_NAMES.get(short.strip().lower())
    if not equals or not colon or ours is None or not name.strip():
        raise InputError(f"--column: {text!r}; give COLUMN=NAME:UNIT, like fz=Force Z:mN, of {', '.join(SHORT_NAMES)}")
    iso = ours == "time_s" and unit.strip() == "iso"
    if not iso and unit_factor(unit, quantity_of(ours)) is None:
        raise InputError(f"--column: {text!r}: {unit!r} is no unit of {quantity_of(ours)} (docs/formats.md)")
    return LogColumn(ours, name.strip(), unit.strip())


def columns_by_header(names: Sequence[str], stated_units: dict[str, str]) -> list[LogColumn]:
    """Return the columns that a header names with their units.

    Args:
        names: in their order; of two that say the same, the first counts.
        stated_units: of force, torque and time where lines above the header state them.

    >>> [column.answer() for column in columns_by_header(["Time (ms)", "Fz [N]", "Temp (C)"], {})]
    ['time=Time (ms):ms', 'fz=Fz [N]:N']
    """
    if ROS_STAMP in names:
        names = [name for name in names if name == ROS_STAMP or name.startswith(ROS_PREFIX)]
        stated_units = {FORCE: "N", TORQUE: "Nm", TIME: "ns"}
    found: dict[str, LogColumn] = {}
    for name in names:
        column = _by_name(name, stated_units)
        if column is not None:
            found.setdefault(column.ours, column)
    return list(found.values())


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


def _by_name(name: str, stated_units: dict[str, str]) -> LogColumn | None:
    """Return the column of ours that a name with a unit stands for, None where it is none or has no unit."""
    bracketed = WITH_UNIT.fullmatch(name)
    bare = (bracketed["name"] if bracketed else name).strip().lower()
    bare = bare.removeprefix(ROS_PREFIX).removeprefix("wrench.")
    units = [bracketed["unit"]] if bracketed else []
    stem, _, ending = bare.rpartition("_")
    candidates = [(bare, units)] if bracketed else [(stem, [ending]), (bare, [])]
    for word, unit in candidates:
        ours = _ours(word)
        if ours is None:
            continue
        quantity = quantity_of(ours)
        for text in (*unit, *([stated_units[quantity]] if quantity in stated_units else [])):
            if unit_factor(text, quantity) is not None:
                return LogColumn(ours, name, text)
    return None


def _ours(word: str) -> str | None:
    """Return our column of a word.

    >>> _ours("force_z"), _ours("mx"), _ours("timestamp"), _ours("temperature")
    ('fz_n', 'tx_nm', 'time_s', None)
    """
    if word in TIME_NAMES or word == "header.stamp":
        return "time_s"
    axis = AXIS_NAMES.fullmatch(word)
    return SHORT_NAMES[("f" if axis["what"].startswith("f") else "t") + axis["axis"]] if axis else None
