"""Walls of frames that people or other programs drew: masks, and a recording's `walls/`
(docs/recordings.md).
"""

import csv
import hashlib
from collections.abc import Mapping
from functools import lru_cache
from io import StringIO
from os import PathLike
from pathlib import Path, PurePath
from typing import Any

import cv2
import numpy as np

from scleraforce.base.arrays import Bytes
from scleraforce.base.errors import FrameError, RecordingError
from scleraforce.base.whole_files import KINDS, read_bytes, write_whole
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.frame_and_force_tables import read_table
from scleraforce.records.frame import NO_WALL, NOT_JUDGED, WALL
from scleraforce.records.remark import Remark

COLUMNS = ("file", "author", "time_utc", "source_sha256")


def mask_of(mask: Any, place: str) -> Bytes:
    """Return a mask (row, column) of NO_WALL, NOT_JUDGED and WALL; flags, and 0 and 1,
    are taken for no wall and wall.

    Pixels that a masked array masks are not judged.

    Raises:
        FrameError: naming `place`: another shape, or other values.
    """
    hidden = np.ma.getmaskarray(np.ma.asarray(mask))
    found = np.asarray(mask)
    if found.ndim != 2:
        raise FrameError(
            f"{place}: a mask of shape {found.shape}; give one, rows x columns"
        )

    levels = np.unique(found)
    if set(levels.tolist()) <= {0, 1}:
        return np.where(
            hidden, np.uint8(NOT_JUDGED), found.astype(np.uint8) * np.uint8(WALL)
        )
    if others := [
        level for level in levels.tolist() if level not in (NO_WALL, NOT_JUDGED, WALL)
    ]:
        raise FrameError(
            f"{place}: {others[0]:g} in a mask; it has 0 (no wall), 128 (column not"
            " judged), 255 (wall)"
        )

    return np.where(hidden, np.uint8(NOT_JUDGED), found.astype(np.uint8))


def drawn_mask(mask: Any) -> Bytes:
    """Return a mask given as the path of a picture or as an array; see `mask_of`."""
    if isinstance(mask, str | PathLike):
        path = Path(mask)
        return mask_of(read_frame(path), str(path))
    return mask_of(mask, "mask")


class RecordedWalls:
    """The walls of a recording's frames: `walls/NAME.png`, with `walls.csv` the frames
    that they were drawn on.

    They are counted as they are used; `remarks` say how many were, and which were not.
    """

    def __init__(self, recording: Path) -> None:
        self._recording = recording
        self._table = recording / "walls.csv"
        self._rows = _kept_rows(self._table) if self._table.exists() else None
        self._used = set[str]()
        self._stale = dict[str, str]()

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What is to be said of the walls that were asked for."""
        outdated = (Remark("wall-outdated", words) for words in self._stale.values())
        words = f"wall: corrected in {len(self._used)} frames"
        corrected = (Remark("walls-corrected", words),) if self._used else ()
        return (*outdated, *corrected)

    def path(self, file: str) -> Path:
        """Return the file of the wall of a frame, which may not exist."""
        return self._recording / "walls" / f"{PurePath(file).stem}.png"

    def wall(self, file: str) -> Bytes | None:
        """Return the mask of a frame; None without one, or with a remark if the frame
        has changed since.

        Raises:
            FrameError: it is not a mask.
            RecordingError: `walls.csv` does not name the frame.
        """
        path = self.path(file)
        if not path.exists():
            return None

        if self._rows is not None:
            if file not in self._rows:
                raise RecordingError(
                    f"{self._table}: file: {file} is missing, and {path} exists"
                )
            if self._rows[file][-1] != frame_file_digest(
                self._recording / "frames" / file
            ):
                self._stale[file] = (
                    f"{path}: drawn on another version of {file}; it is not used"
                )
                return None

        self._used.add(file)
        return drawn_mask(path)


def frame_file_digest(path: Path) -> str:
    """Return the SHA-256 of a frame's file, hexadecimal, as `sha256sum` prints it."""
    return hashlib.sha256(read_bytes(path, KINDS["frame"])).hexdigest()


def write_wall(
    recording: Path, file: str, mask: Bytes, author: str, time_utc: str
) -> None:
    """Write a frame's mask (row, column), and in walls.csv who drew it and on which
    version; earlier ones are replaced.

    Walls without a line in walls.csv get one: they count as drawn on today's frames.
    """
    path = recording / "walls" / f"{PurePath(file).stem}.png"
    table = recording / "walls.csv"
    path.parent.mkdir(exist_ok=True)
    drawn = {each.stem for each in path.parent.glob("*.png")} | {path.stem}
    rows = _rows(table) if table.exists() else {}

    for frame in (
        each
        for each in (recording / "frames").iterdir()
        if each.stem in drawn and each.name not in rows
    ):
        rows[frame.name] = [frame.name, "unknown", "", frame_file_digest(frame)]

    rows[file] = [
        file,
        author,
        time_utc,
        frame_file_digest(recording / "frames" / file),
    ]
    _write_rows(recording, rows)  # first: a mask that it does not name is an error
    write_whole(bytes(cv2.imencode(".png", mask)[1]), path)


def remove_wall(recording: Path, file: str) -> None:
    """Remove a frame's mask and its line in walls.csv."""
    RecordedWalls(recording).path(file).unlink(missing_ok=True)
    if (recording / "walls.csv").exists():
        _write_rows(
            recording,
            {
                name: row
                for name, row in _rows(recording / "walls.csv").items()
                if name != file
            },
        )


def _kept_rows(table: Path) -> Mapping[str, list[str]]:
    """Read walls.csv, again where it has changed: each frame of a recording asks."""
    stat = table.stat()
    return _read_rows(table, (stat.st_mtime_ns, stat.st_size, stat.st_ino))


@lru_cache(maxsize=8)
def _read_rows(table: Path, _: tuple[int, ...]) -> Mapping[str, list[str]]:
    return _rows(table)


def _rows(table: Path) -> dict[str, list[str]]:
    text = read_table(table, KINDS["walls"], COLUMNS, COLUMNS)
    found = {row[0]: list(row) for row in zip(*map(text.column, COLUMNS), strict=True)}
    if bad := [file for file, row in found.items() if len(row[-1]) != 64]:
        raise RecordingError(f"{table}: source_sha256: not a SHA-256 for {bad[0]}")
    return found


def _write_rows(recording: Path, rows: Mapping[str, list[str]]) -> None:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows.values()])
    write_whole(text.getvalue(), recording / "walls.csv")
