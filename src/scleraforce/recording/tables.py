"""The two tables of a recording folder, `frames.csv` and `forces.csv`: read fast, and say where a fault is."""

import csv
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.whole_files import KINDS, read_text

__all__ = ["FORCE_COLUMNS", "MIN_SAMPLE_RATE_HZ", "ForceLog", "FrameEntry", "read_force_log", "read_frame_list"]

FORCE_COLUMNS = ("time_s", "fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
FRAME_COLUMNS = ("file", "time_s", "pierced")
MIN_SAMPLE_RATE_HZ = 100.0


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
    lines = read_text(path, KINDS["frames"]).splitlines()
    header = _header(path, lines, FRAME_COLUMNS, ("file", "time_s"))
    entries: list[FrameEntry] = []
    seen: dict[str, int] = {}
    for number, row in enumerate(csv.reader(lines[1:]), start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise RecordingError(f"{path}:{number}: {len(row)} fields; the header has {len(header)}")
        entry = _frame_entry(f"{path}:{number}", dict(zip(header, (field.strip() for field in row), strict=True)))
        if entry.file in seen:
            raise RecordingError(f"{path}:{number}: file: {entry.file} stands in line {seen[entry.file]} already")
        if entries and entry.time_s <= entries[-1].time_s:
            raise RecordingError(
                f"{path}:{number}: time_s: {entry.time_s:g} does not come after {entries[-1].time_s:g}; "
                "frames stand in the order of their times, and no two at one time"
            )
        seen[entry.file] = number
        entries.append(entry)
    if not entries:
        raise RecordingError(f"{path}: no frames; give a line for each frame")
    return tuple(entries)


def read_force_log(path: Path, axis: str) -> ForceLog:
    """Read forces.csv; `axis` (fx, fy or fz) must be among its columns.

    Raises:
        RecordingError: naming the file, the line and the field.
    """
    text = read_text(path, KINDS["forces"])
    header = _header(path, text.split("\n", 1)[0:1], FORCE_COLUMNS, ("time_s", f"{axis}_n"))
    lines = text.split("\n")[1:]
    if not any(map(str.strip, lines)):
        raise RecordingError(f"{path}: no samples below the header")
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
    except ValueError:
        _raise_bad_number(path, text, header)
        raise
    if table.shape[0] < 2 or table.shape[1] != len(header):
        raise RecordingError(f"{path}: {len(table)} samples of {table.shape[1]} fields; the header has {len(header)}")
    if not np.isfinite(table).all():
        sample, column = np.argwhere(~np.isfinite(table))[0]
        place = f"{path}:{_line_of_sample(text, int(sample))}: {header[column]}"
        raise RecordingError(f"{place}: {table[sample, column]} is not a finite number")
    time = header.index("time_s")
    _check_clock(path, text, table[:, time])
    columns = tuple(name for name in header if name != "time_s")
    return ForceLog(table[:, time].copy(), np.delete(table, time, axis=1), columns)


def _check_clock(path: Path, text: str, time_s: NDArray[np.float64]) -> None:
    steps_s = np.diff(time_s)
    if (steps_s <= 0.0).any():
        sample = int(np.argmax(steps_s <= 0.0)) + 1
        found = f"{time_s[sample]:g} does not come after {time_s[sample - 1]:g}"
        raise RecordingError(f"{path}:{_line_of_sample(text, sample)}: time_s: {found}; the clock must run forward")
    rate_hz = 1.0 / float(np.median(steps_s))
    if rate_hz < MIN_SAMPLE_RATE_HZ * 0.999:
        raise RecordingError(
            f"{path}: time_s: {rate_hz:.4g} samples a second; at least {MIN_SAMPLE_RATE_HZ:g} are needed"
        )


def _frame_entry(place: str, row: dict[str, str]) -> FrameEntry:
    file = row["file"]
    if not file or "\\" in file or PurePosixPath(file).is_absolute() or ".." in PurePosixPath(file).parts:
        raise RecordingError(f"{place}: file: {file!r} is not a name below frames/")
    pierced = row.get("pierced", "0")
    if pierced not in ("", "0", "1"):
        raise RecordingError(f"{place}: pierced: {pierced!r}; give 0 or 1")
    try:
        time_s = float(row["time_s"])
    except ValueError:
        time_s = float("nan")
    if not np.isfinite(time_s):
        raise RecordingError(f"{place}: time_s: {row['time_s']!r} is not a finite number")
    return FrameEntry(file, time_s, pierced == "1")


def _header(path: Path, lines: list[str], known: tuple[str, ...], required: tuple[str, ...]) -> list[str]:
    names = [name.strip() for name in lines[0].split(",")] if lines and lines[0].strip() else []
    if not names:
        raise RecordingError(f"{path}: empty; the first line names the columns: {','.join(known)}")
    for name in names:
        if name not in known:
            raise RecordingError(f"{path}:1: unknown column {name!r}; known: {', '.join(known)}")
        if names.count(name) > 1:
            raise RecordingError(f"{path}:1: column {name} stands there twice")
    for name in required:
        if name not in names:
            raise RecordingError(f"{path}:1: column {name} is missing; found: {', '.join(names)}")
    return names


def _raise_bad_number(path: Path, text: str, header: list[str]) -> None:
    """Find what NumPy could not read, and name its line and column."""
    for number, line in enumerate(text.split("\n")[1:], start=2):
        fields = line.split(",")
        if not line.strip():
            continue
        if len(fields) != len(header):
            raise RecordingError(f"{path}:{number}: {len(fields)} fields; the header has {len(header)}")
        for name, field in zip(header, fields, strict=True):
            try:
                float(field)
            except ValueError:
                raise RecordingError(f"{path}:{number}: {name}: {field.strip()!r} is not a number") from None


def _line_of_sample(text: str, sample: int) -> int:
    lines = [number for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
    return lines[sample + 1]
