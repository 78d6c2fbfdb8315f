"""Write a recording folder as its frames and forces come, so that it can be read at any time, also after a crash.

Two things make that so. A frame's line comes after the whole file. And no line lies across two pages of memory, so a
process that is killed leaves whole lines only: the last line of a page fills it, with zeros behind its time's decimals.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.png import PngBuffer
from scleraforce.recording.tables import MIN_SAMPLE_RATE_HZ
from scleraforce.study.toml import format_record

FORCE_STEP_S = 0.01  # of the log that `ForceWriter` takes
FIELD_BYTES = 16  # of a table at most, with the separator
PAGE_BYTES = 4096


class RecordingWriter:
    """Writes recording.toml, frames/ and frames.csv of a new folder.

    Args:
        folder: must not exist.
        info: what recording.toml says.
        comment: a line at its top.

    Raises:
        OSError: it exists, or cannot be written; so do the methods.
    """

    def __init__(self, folder: Path, info: RecordingInfo, comment: str) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        (folder / "frames").mkdir()
        _write(folder / "recording.toml", f"# {comment}\n\n{format_record(info)}".encode())
        self._png = PngBuffer(info.oct.rows, info.oct.columns)
        self._table = _Table(folder / "frames.csv", ("file", "time_s"))

    def add(self, file: str, time_s: float, pixels: NDArray[np.uint16]) -> None:
        """Add a frame (row, column) that comes after the others."""
        _write(self.folder / "frames" / file, self._png.encode(pixels))
        self._table.add({"file": file, "time_s": f"{time_s:.6f}"})

    def close(self) -> None:
        """Close what is open."""
        self._table.close()


class ForceWriter:
    """Writes a force log as it comes: `forces.csv` while `read_recording` takes it, else `robot_forces.csv`.

    It takes logs of at least two samples, more than half of which come within 1 / `MIN_SAMPLE_RATE_HZ` of the last.

    Args:
        folder: of the recording.
        columns: beside the time, like `fz_n`.
    """

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        self._fast, self._slow = folder / "forces.csv", folder / "robot_forces.csv"
        self._columns = tuple(columns)
        self._table = _Table(self._slow, ("time_s", *columns))
        self._is_fast = False
        self._steps = self._short_steps = 0
        self._last_s: float | None = None

    def add(self, time_s: float, values: Sequence[float]) -> None:
        """Add a sample at a multiple of half of `FORCE_STEP_S` that comes after the others."""
        named = {name: f"{value:.8g}" for name, value in zip(self._columns, values, strict=True)}
        self._table.add({"time_s": f"{time_s:.3f}", **named})
        if self._last_s is not None:
            self._steps += 1
            self._short_steps += time_s - self._last_s < 1.0 / MIN_SAMPLE_RATE_HZ + FORCE_STEP_S / 2
        self._last_s = time_s
        if (2 * self._short_steps > self._steps) != self._is_fast:
            self.set_aside() if self._is_fast else self._slow.rename(self._fast)
            self._is_fast = not self._is_fast

    def set_aside(self) -> None:
        """Name the file so that `read_recording` leaves it alone."""
        if self._fast.exists():
            self._fast.rename(self._slow)

    def close(self) -> None:
        """Close what is open."""
        self._table.close()


class _Table:
    """A table with a column `time_s` to which lines are appended, each by one write."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        self._longest = FIELD_BYTES * len(names)
        header = (",".join(names) + "\n").encode()
        _write_all(self._file, header)
        self._page_left = PAGE_BYTES - len(header)

    def add(self, row: Mapping[str, str]) -> None:
        """Add a line; what would not leave room for another one in the page fills it."""
        left = (self._page_left - len(_line(row))) % PAGE_BYTES
        if left < self._longest:
            row, left = {**row, "time_s": row["time_s"] + "0" * left}, PAGE_BYTES
        _write_all(self._file, _line(row))
        self._page_left = left

    def close(self) -> None:
        os.close(self._file)


def _line(row: Mapping[str, str]) -> bytes:
    return (",".join(row.values()) + "\n").encode()


def _write(path: Path, data: bytes | memoryview) -> None:
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    try:
        _write_all(file, data)
    except BaseException:
        path.unlink()  # on a full disk, what is half makes room for the tables
        raise
    finally:
        os.close(file)


def _write_all(file: int, data: bytes | memoryview) -> None:
    while data:
        data = data[os.write(file, data) :]
