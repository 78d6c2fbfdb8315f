"""The two tables of a recording folder, `frames.csv` and `forces.csv`: read fast, and say where a fault is."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.recording.delimited import Table, fields_of, number, read_table
from scleraforce.whole_files import KINDS

__all__ = [
    "FORCE_COLUMNS",
    "MIN_SAMPLE_RATE_HZ",
    "ForceLog",
    "FrameEntry",
    "check_samples",
    "read_force_log",
    "read_frame_list",
]

FORCE_COLUMNS = ("time_s", "fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
FRAME_COLUMNS = ("file", "time_s", "pierced")
MIN_SAMPLE_RATE_HZ = 100.0
# Beyond, a number is damage: 300 years (clocks may count from 1970), and a thousand times what such a sensor bears.
LARGEST_TIME_S, LARGEST_FORCE_N = 1e10, 1e6


@dataclass(frozen=True)
class FrameEntry:
    """A line of frames.csv: name below `frames/`, time on the log's clock, whether the needle had pierced."""

    file: str
    time_s: float
    pierced: bool = False


@dataclass(frozen=True)
class ForceLog:
    """A force log: `time_s` (samples,), increasing, and the other columns of the file: forces in N, torques in N m.

    `wrench_sc` has shape (samples, columns); `columns` are their names, like `fz_n`.
    """

    time_s: NDArray[np.float64]
    wrench_sc: NDArray[np.float64]
    columns: tuple[str, ...]

    @property
    def sample_rate_hz(self) -> float:
        """Samples a second, from the median interval."""
        return 1.0 / float(np.median(np.diff(self.time_s)))

    def force_n(self, axis: str) -> NDArray[np.float64]:
        """Return the force along fx, fy or fz in N, shape (samples,)."""
        return self.wrench_sc[:, self.columns.index(f"{axis}_n")]


def read_frame_list(path: Path) -> tuple[FrameEntry, ...]:
    """Read frames.csv, in its order.

    Raises:
        RecordingError: naming the file, the line and the field.
    """
    table = read_table(path, KINDS["frames"], FRAME_COLUMNS, ("file", "time_s"))
    entries: list[FrameEntry] = []
    seen: dict[str, str] = {}
    for index, line in enumerate(table.lines):
        if not line:
            continue
        place = table.place(index)
        entry = _frame_entry(place, _row(table, index), table.separator)
        if entry.file in seen:
            raise RecordingError(f"{place}: file: {entry.file} stands in line {seen[entry.file]} already")
        if entries and entry.time_s <= entries[-1].time_s:
            raise RecordingError(
                f"{place}: time_s: {entry.time_s:g} does not come after {entries[-1].time_s:g}; "
                "frames stand in the order of their times, and no two at one time"
            )
        seen[entry.file] = place.rsplit(":", 1)[1]
        entries.append(entry)
    if not entries:
        raise RecordingError(f"{path}: no frames; give a line for each frame")
    return tuple(entries)


def read_force_log(path: Path, axis: str) -> ForceLog:
    """Read forces.csv; `axis` (fx, fy or fz) must be among its columns.

    Raises:
        RecordingError: naming the file, the line and the field.
    """
    table = read_table(path, KINDS["forces"], FORCE_COLUMNS, ("time_s", f"{axis}_n"))
    values_sc = _numbers(table)
    time = table.columns.index("time_s")
    columns = tuple(name for name in table.columns if name != "time_s")
    log = ForceLog(values_sc[:, time].copy(), np.delete(values_sc, time, axis=1), columns)
    check_samples(log, path, lambda sample: _place_of_sample(table, sample))
    return log


def check_samples(log: ForceLog, path: Path, place: Callable[[int], str]) -> None:
    """Check that a log has numbers that a sensor can give, and a clock that runs forward and fast enough.

    Args:
        log: what was read.
        path: of its file.
        place: where in it a sample stands, by its number.

    Raises:
        RecordingError: naming the place and the column.
    """
    if len(log.time_s) < 2:
        raise RecordingError(f"{path}: fewer than two samples of the force")
    _check_range(log, place)
    _check_clock(log.time_s, path, place)


def _numbers(table: Table) -> NDArray[np.float64]:
    """Return the numbers of a table (sample, column); NumPy reads them, ten times as fast as Python would."""
    lines = table.lines
    if not any(lines):
        raise RecordingError(f"{table.path}: no samples below the header")
    if table.separator != "," and any("," in line for line in lines):
        lines = _with_points(table)
    open_quote = next((index for index, line in enumerate(lines) if '"' in line and line.count('"') % 2), None)
    if open_quote is not None:  # NumPy would read on to the next one, over lines
        fields_of(lines[open_quote], table.separator, table.place(open_quote))
    try:
        found = np.loadtxt(lines, delimiter=table.separator, ndmin=2, comments=None, quotechar='"')
    except ValueError as fault:
        _raise_bad_number(table)
        raise RecordingError(f"{table.path}: {fault}") from fault
    if found.shape[0] < 2 or found.shape[1] != len(table.columns):
        shape = f"{found.shape[0]} samples of {found.shape[1]} fields"
        raise RecordingError(f"{table.path}: {shape}; the header has {len(table.columns)}{_of_commas(table)}")
    return np.asarray(found, dtype=np.float64)


def _with_points(table: Table) -> tuple[str, ...]:
    """Return lines with decimal commas as lines with decimal points."""
    for index, line in enumerate(table.lines):
        if "." in line:
            raise RecordingError(
                f"{table.place(index)}: a decimal point, where other numbers of the file have decimal commas; "
                "write all numbers alike, without signs between thousands"
            )
    return tuple(line.replace(",", ".") for line in table.lines)


def _check_range(log: ForceLog, place: Callable[[int], str]) -> None:
    columns, values_sc = ("time_s", *log.columns), np.column_stack([log.time_s, log.wrench_sc])
    largest_c = np.array([LARGEST_TIME_S, *[LARGEST_FORCE_N] * len(log.columns)])
    bad = ~(np.abs(values_sc) <= largest_c)  # a NaN is bad as well
    if not bad.any():
        return
    sample, column = np.argwhere(bad)[0]
    value = values_sc[sample, column]
    fault = f"is beyond {largest_c[column]:g}" if np.isfinite(value) else "is not a finite number"
    raise RecordingError(f"{place(int(sample))}: {columns[column]}: {value:g} {fault}")


def _check_clock(time_s: NDArray[np.float64], path: Path, place: Callable[[int], str]) -> None:
    steps_s = np.diff(time_s)
    if (steps_s <= 0.0).any():
        sample = int(np.argmax(steps_s <= 0.0)) + 1
        found = f"{time_s[sample]:.12g} does not come after {time_s[sample - 1]:.12g}"
        raise RecordingError(f"{place(sample)}: time_s: {found}; the clock must run forward")
    rate_hz = 1.0 / float(np.median(steps_s))
    if rate_hz < MIN_SAMPLE_RATE_HZ * 0.999:
        raise RecordingError(
            f"{path}: time_s: {rate_hz:.4g} samples a second; at least {MIN_SAMPLE_RATE_HZ:g} are needed "
            "(times are in seconds)"
        )


def _row(table: Table, index: int) -> dict[str, str]:
    """Return the fields of a line by their columns."""
    fields = fields_of(table.lines[index], table.separator, table.place(index))
    # A separator at the end of a line is taken for a spreadsheet's: what may be missing there is empty.
    missing = len(table.columns) - len(fields)
    if missing < 0 or any(name != "pierced" for name in table.columns[len(fields) :]):
        found = f"{len(fields)} fields; the header has {len(table.columns)}"
        raise RecordingError(f"{table.place(index)}: {found}{_of_commas(table)}")
    return dict(zip(table.columns, (*fields, *[""] * missing), strict=True))


def _of_commas(table: Table) -> str:
    return "; with decimal commas, columns are separated by semicolons" if table.separator == "," else ""


def _frame_entry(place: str, row: dict[str, str], separator: str) -> FrameEntry:
    file = row["file"]
    inside = not PurePosixPath(file).is_absolute() and ".." not in PurePosixPath(file).parts
    if not file or "\\" in file or not file.isprintable() or not inside:
        raise RecordingError(f"{place}: file: {file!r} is not a name below frames/")
    pierced = row.get("pierced", "0")
    if pierced not in ("", "0", "1"):
        raise RecordingError(f"{place}: pierced: {pierced!r}; give 0 or 1")
    time_s = number(row["time_s"], separator)
    if time_s is None or not abs(time_s) <= LARGEST_TIME_S:
        raise RecordingError(f"{place}: time_s: {row['time_s']!r} is not a finite number of seconds")
    return FrameEntry(file, time_s, pierced == "1")


def _raise_bad_number(table: Table) -> None:
    """Find what NumPy could not read, and name its line and column."""
    for index, line in enumerate(table.lines):
        if not line:
            continue
        fields = fields_of(line, table.separator, table.place(index))
        if len(fields) != len(table.columns):
            found = f"{len(fields)} fields; the header has {len(table.columns)}"
            raise RecordingError(f"{table.place(index)}: {found}{_of_commas(table)}")
        for name, field in zip(table.columns, fields, strict=True):
            if number(field, table.separator) is None:
                raise RecordingError(f"{table.place(index)}: {name}: {field!r} is not a number")


def _place_of_sample(table: Table, sample: int) -> str:
    return table.place([index for index, line in enumerate(table.lines) if line][sample])
