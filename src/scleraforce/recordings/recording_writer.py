"""Write a recording frame by frame: its frames as PNG, uncompressed as time is short
while a monitor runs.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path, PurePath

import cv2
import numpy as np

from scleraforce.base.arrays import Counts
from scleraforce.base.errors import RecordingError
from scleraforce.recordings.frame_and_force_tables import MIN_SAMPLE_RATE_HZ, ForceLog
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.decoder import format_record
from scleraforce.records.recording_info import RecordingInfo

# Speckle hardly shrinks: compressing takes 10 times as long and saves a quarter
# (docs/black_box.md).
UNCOMPRESSED = (
    cv2.IMWRITE_PNG_COMPRESSION,
    0,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_NONE,
)
FORCE_STEP_S = 0.01  # of the log that `ForceWriter` takes
FIELD_BYTES = 16  # of a table at most, with the separator
PAGE_BYTES = 4096


class RecordingWriter:
    """Writer of recording.toml, which begins with `comment`, frames/ and frames.csv of
    a new folder.

    `more` are columns of frames.csv beside file and time.
    """

    def __init__(
        self,
        folder: Path,
        info: RecordingInfo,
        comment: str,
        more: tuple[str, ...] = (),
    ) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        (folder / "frames").mkdir()
        _write(
            folder / "recording.toml", f"# {comment}\n\n{format_record(info)}".encode()
        )
        self._table = _TableFile(folder / "frames.csv", ("file", "time_s", *more))

    def add(
        self, file: str, time_s: float, pixels: Counts, more: Sequence[str] = ()
    ) -> None:
        """Add a frame (row, column) that is not earlier than the others, and its values
        of the other columns.
        """
        png = cv2.imencode(".png", np.asarray(pixels, np.uint16), UNCOMPRESSED)[1]
        _write(self.folder / "frames" / file, png.data)
        self._table.add(file, f"{time_s:.6f}", *more)

    def close(self) -> None:
        """Close the table."""
        self._table.close()


class ForceWriter:
    """Writer of `forces.csv` while `read_recording` takes the samples, else of
    `robot_forces.csv`.
    """

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        self._fast = folder / "forces.csv"
        self._slow = folder / "robot_forces.csv"
        self._table = _TableFile(self._slow, ("time_s", *columns))
        self._is_fast = False
        self._steps = self._short_steps = 0
        self._last_s: float | None = None

    def add(self, time_s: float, values: Sequence[float]) -> None:
        """Add a sample at a multiple of half of `FORCE_STEP_S` that is later than the
        others.
        """
        self._table.add(f"{time_s:.3f}", *(f"{value:.8g}" for value in values))
        if self._last_s is not None:
            self._steps += 1
            self._short_steps += (
                time_s - self._last_s < 1.0 / MIN_SAMPLE_RATE_HZ + FORCE_STEP_S / 2
            )

        self._last_s = time_s
        if (2 * self._short_steps > self._steps) != self._is_fast:
            self.set_aside() if self._is_fast else self._slow.rename(self._fast)
            self._is_fast = not self._is_fast

    def set_aside(self) -> None:
        """Rename the file so that `read_recording` ignores it."""
        if self._fast.exists():
            self._fast.rename(self._slow)

    def close(self) -> None:
        """Close the table."""
        self._table.close()


class _TableFile:
    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self._file = os.open(
            path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644
        )
        self._longest = FIELD_BYTES * len(names)
        self._time = names.index("time_s")
        header = (",".join(names) + "\n").encode()
        _write_all(self._file, header)
        self._page_left = PAGE_BYTES - len(header)

    def add(self, *cells: str) -> None:
        """Add a line; a line that would not leave room for another one in the page
        fills it.
        """
        line = (",".join(cells) + "\n").encode()
        left = (self._page_left - len(line)) % PAGE_BYTES
        if left < self._longest:
            filled = [
                cell + "0" * left if nth == self._time else cell
                for nth, cell in enumerate(cells)
            ]
            line = (",".join(filled) + "\n").encode()
            left = PAGE_BYTES

        _write_all(self._file, line)
        self._page_left = left

    def close(self) -> None:
        os.close(self._file)


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


# name of a frame's file without its ending; no formula in a spreadsheet
PLAIN_NAME = re.compile(r"\w[\w.+-]*", re.ASCII)


def frame_files(names: Sequence[str]) -> list[str]:
    """Return names of frames' files: the sources' names if they differ, else numbers.

    >>> frame_files(["scans/a.png", "scans/b.jpg"])
    ['a.png', 'b.png']
    >>> frame_files(["volume.nii[0]", "volume.nii[1]"])
    ['0001.png', '0002.png']
    >>> frame_files(["scans/-1.png", "scans/+2.png"])
    ['0001.png', '0002.png']
    """
    stems = [PurePath(name).stem for name in names]
    own = len(set(stems)) == len(stems) and all(
        PLAIN_NAME.fullmatch(stem) for stem in stems
    )
    digits = max(4, len(str(len(names))))

    return [
        f"{stem}.png" if own else f"{nth:0{digits}d}.png"
        for nth, stem in enumerate(stems, start=1)
    ]


def write_log(folder: Path, log: ForceLog) -> None:
    """Write forces.csv: times to the microsecond, forces and torques to 7 digits, nan
    for samples without a force.
    """
    formats = ["%.6f", *["%.7g"] * len(log.columns)]
    values_sc = np.column_stack([log.time_s, log.wrench_sc])
    header = ",".join(["time_s", *log.columns])
    np.savetxt(
        folder / "forces.csv",
        values_sc,
        fmt=formats,
        delimiter=",",
        header=header,
        comments="",
    )


def read_written(folder: Path, out: Path) -> Recording:
    """Read the written recording, as every other command will; messages name `out`."""
    try:
        return read_recording(folder)
    except RecordingError as fault:
        raise RecordingError(str(fault).replace(str(folder), str(out))) from fault
