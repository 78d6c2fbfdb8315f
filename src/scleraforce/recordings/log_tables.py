"""What a table of text holds before its import: a force log or times of frames, the
columns of a log, and the units that they may have.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.foreign_force_logs import (
    BEHIND_MARK,
    BRACKETS,
    CLOCK_NAMES,
    STATUS,
    STATUS_MEANINGS,
    LogColumn,
    columns_by_header,
)
from scleraforce.recordings.formats.log_text import (
    CLOCKS,
    FORCE,
    TIME,
    TORQUE,
    clock_of,
    quantity_of,
    read_log_text,
    unit_factor,
)
from scleraforce.recordings.frame_and_force_tables import TextTable
from scleraforce.recordings.frame_names import SUFFIX
from scleraforce.recordings.frame_times import read_times
from scleraforce.recordings.source_files import TEXT_NAMES, files_of

# A larger table is taken for a log unread: reading takes 0.9 s for each MiB, and the
# times of 40,000 frames need no more.
MOST_TIMES_BYTES = 2**20
# Beside names and times: those of a recording's own frames.csv, and plain numbers.
OF_FRAMES = ("pierced", "plane", "travel_m", "held_s", "iop_pa")
NUMBERS = ("#", "id", "index", "n", "no", "no.", "nr", "nr.", "number")
# The quantity of each column of a log, by its short name, and the units to choose from.
QUANTITY_OF: Mapping[str, str] = MappingProxyType(
    {
        TIME: TIME,
        **dict.fromkeys(("fx", "fy", "fz"), FORCE),
        **dict.fromkeys(("tx", "ty", "tz"), TORQUE),
        STATUS: STATUS,
    }
)
UNITS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        TIME: ("s", "ms", "us", "ns", *CLOCKS),
        FORCE: ("N", "mN", "uN", "kN", "g", "kgf", "lbf"),
        TORQUE: ("Nm", "mNm", "Nmm", "Ncm"),
        STATUS: STATUS_MEANINGS,
    }
)


@dataclass(frozen=True)
class NamedColumn:
    """A column of a log: its name, the unit that the header or its first value states
    ("": none), and its first value.
    """

    name: str
    unit: str
    first: str


@dataclass(frozen=True)
class LogTable:
    """The columns of a force log, and those that its header names as time or force."""

    columns: tuple[NamedColumn, ...]
    read: tuple[LogColumn, ...]


def first_log(sources: Sequence[Path]) -> Path | None:
    """Return the first file of sources that is a log by its name, None without one."""
    files = files_of(sources)
    return next(
        (path for path in files if path.name.lower().endswith(TEXT_NAMES)), None
    )


def read_log_table(path: Path) -> LogTable:
    """Return the columns of a force log of text; raises `InputError`."""
    table = read_log_text(path)
    names = tuple(dict.fromkeys(table.names))
    return LogTable(
        tuple(_column(table, name) for name in names),
        tuple(columns_by_header(table.names, {}, table.units)),
    )


def _column(table: TextTable, name: str) -> NamedColumn:
    first = next(iter(table.column(name)), "").strip()
    place = table.names.index(name)
    own_line = table.units[place] if place < len(table.units) else ""
    matches = (BRACKETS.fullmatch(name), BEHIND_MARK.fullmatch(name))
    stated = [own_line, *(found["unit"] for found in matches if found)]
    units = [unit.strip() for unit in stated if _is_unit(unit)]

    return NamedColumn(name, (units or [clock_of(first) or ""])[0], first)


def _is_unit(text: str) -> bool:
    return any(
        unit_factor(text, quantity) is not None for quantity in (TIME, FORCE, TORQUE)
    )


def holds_times(path: Path) -> bool:
    """Return whether a table has times of frames and no forces: a column of times, and
    beside it names or numbers of files at most.
    """
    try:
        if path.stat().st_size > MOST_TIMES_BYTES:
            return False
        table = read_log_text(path, least=1)
        by_header = columns_by_header(table.names, {}, table.units)
        if any(quantity_of(column.ours) != TIME for column in by_header):
            return False
        times = read_times(path)
    except (InputError, OSError):
        return False

    if times.names and all(SUFFIX.search(name.strip()) for name in times.names):
        return True

    of_time = {column.name for column in by_header}
    known = {*of_time, times.column, *OF_FRAMES}
    others = {name.strip().lower() for name in table.names if name not in known}
    return others <= CLOCK_NAMES | {*NUMBERS}
