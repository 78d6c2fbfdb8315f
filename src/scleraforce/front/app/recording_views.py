"""A recording on the page: its frames as pictures, its log as a curve, each frame's
wall and answer.
"""

import json
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePath
from threading import Lock
from typing import Any

import cv2
import numpy as np

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.base.plain_json import finite_json, parse_json
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import KINDS, read_text, write_whole
from scleraforce.front.api.reading_frames import read
from scleraforce.front.app.request_end import check_wanted
from scleraforce.front.app.work_folder import PARTS
from scleraforce.recordings.drawn_walls import frame_file_digest
from scleraforce.recordings.forces_under_frames import contact_force, label_frames
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.frame import NO_WALL, NOT_JUDGED, WALL, Pixels
from scleraforce.records.study import ClassesStudy
from scleraforce.wall.wall import Segmentation

BINS = 800  # of a curve: the least and the largest value of each
# percentiles of a frame that are shown black and white
DARK = 1.0
BRIGHT = 99.8
OPENED = 8  # recordings that are kept in memory


def png(pixels: Pixels | Floats, height: int | None = None) -> bytes:
    """Return a frame (row, column) as a PNG of 8 bits, its darkest and brightest parts
    and NaN black and white.
    """
    known = pixels[np.isfinite(pixels)]
    low, high = np.percentile(known, [DARK, BRIGHT]) if known.size else (0.0, 1.0)

    grey = np.clip(
        (np.nan_to_num(pixels, nan=low).astype(np.float32) - low)
        * (255.0 / max(high - low, 1e-9)),
        0.0,
        255.0,
    ).astype(np.uint8)
    if height is not None and height < len(grey):
        width = max(1, round(grey.shape[1] * height / len(grey)))
        grey = np.asarray(
            cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA), np.uint8
        )

    return bytes(cv2.imencode(".png", grey)[1])


def thinned_curve(time_s: Floats, values: Floats) -> dict[str, Any]:
    """Return a curve with the least and the largest value of each of `BINS` stretches,
    NaN where there is none.
    """
    starts = np.linspace(0, len(values), min(BINS, len(values)), endpoint=False).astype(
        np.intp
    )
    low, high = (
        extreme.reduceat(values, starts).tolist() for extreme in (np.fmin, np.fmax)
    )

    return {"time_s": time_s[starts].tolist(), "low": low, "high": high}


def mask_between(
    outer: list[float | None],
    inner: list[float | None],
    unseen: list[int],
    rows: int,
    columns: int,
) -> Bytes:
    """Return the mask (row, column) of boundaries in rows, None: not there (an inner
    one: below the frame).
    """
    if (len(outer), len(inner)) != (columns, columns) or not all(
        0 <= column < columns for column in unseen
    ):
        raise FrameError(
            f"wall: boundaries or unseen columns do not fit a frame of {columns}"
            " columns"
        )

    first = np.array([np.nan if row is None else row for row in outer], np.float64)
    last = np.array([rows if row is None else row for row in inner], np.float64)
    row = np.arange(rows)[:, None]
    mask = np.where((row >= first) & (row < last), np.uint8(WALL), np.uint8(NO_WALL))
    mask[:, unseen] = NOT_JUDGED

    return mask


@dataclass(frozen=True)
class ReadBy:
    """What a frame is read with: a bundled model's name or the path of a folder, and a
    calibration's path; None: without a calibration.
    """

    model: str | Path
    calibration: Path | None = None


@lru_cache(OPENED)
def _opened(path: Path, _: tuple[int, ...]) -> Recording:
    return read_recording(path)


class RecordingViews:
    """Recordings as the page shows them; recordings and models are opened when they are
    first needed.
    """

    def __init__(self) -> None:
        self._reading = Lock()

    def recording(self, path: Path) -> Recording:
        """Return a recording, read again where one of its tables has changed."""
        tables = [path / name for name in PARTS]
        return _opened(
            path, tuple(table.stat().st_mtime_ns for table in tables if table.exists())
        )

    def entry(self, path: Path, file: str) -> tuple[Recording, FrameEntry]:
        """Return a recording and its frame of a name."""
        recording = self.recording(path)
        for entry in recording.frames:
            if entry.file == file:
                return recording, entry
        raise InputError(f"{path.name}: no frame {file}")

    def summary(self, path: Path) -> dict[str, Any]:
        """Return size, frames with times and labels, force curve, and what the import
        of a recording remarked.

        What limits its answers is among the remarks of each.
        """
        recording = self.recording(path)
        info = recording.info
        log = recording.forces
        notes = list[str]()
        imported = list[dict[str, Any]]()
        try:
            imported = [remark.to_dict() for remark in recording.remarks]
        except RecordingError as fault:  # a damaged import.json
            notes.append(str(fault))

        try:
            trials = label_frames(recording, ClassesStudy()) if log is not None else ()
        except RecordingError as fault:  # which says why no frame has one
            trials = ()
            notes.append(str(fault))

        drawn = {wall.stem for wall in (path / "walls").glob("*.png")}
        files = [entry.file for entry in recording.frames]
        force = None
        if log is not None and info.force is not None:
            known = log.known(info.force.axis)
            force = thinned_curve(
                known.time_s, from_si(contact_force(known, info.force), "mn")
            )

        found: dict[str, Any] = finite_json(
            {
                "eye": info.eye_name,
                "rows": info.scan.rows,
                "columns": info.scan.columns,
                "width_mm": from_si(info.scan.width_m, "mm"),
                "depth_mm": from_si(info.scan.depth_m, "mm"),
                "files": files,
                "time_s": [entry.time_s for entry in recording.frames],
                "planes": (
                    [entry.plane for entry in recording.frames]
                    if info.scan.planes
                    else None
                ),
                "force_mn": (
                    [from_si(trial.measured_force_n, "mn") for trial in trials] or None
                ),
                "log": force,
                "notes": notes,
                "imported": imported,
                "corrected": [file for file in files if PurePath(file).stem in drawn],
            }
        )
        return found

    def read_frame(self, path: Path, file: str, by: ReadBy) -> dict[str, Any]:
        """Return the wall of a frame, and the answer of a model with its warnings; with
        a calibration by what it says of the recording's eye.
        """
        recording, entry = self.entry(path, file)
        frames = [
            entry,
            *(
                other
                for other in recording.frames
                if other.time_s == entry.time_s and other is not entry
            ),
        ]

        with self._reading:  # the model is not made for several threads
            check_wanted()
            answer = read(
                by.model,
                [recording.frame_path(each) for each in frames],
                calibration=by.calibration,
                eye=None if by.calibration is None else recording.info.eye_name,
            )

        wall = answer.segmentation
        found = answer.to_dict() | {"warnings": list(answer.warnings)}
        shown: dict[str, Any] = finite_json(
            {"answer": found, "wall": None if wall is None else _outline(wall)}
        )

        return shown | {
            "frames": [each.file for each in frames],
            "draft": read_draft(recording, file),
        }


def write_draft(recording: Recording, file: str, drawn: dict[str, Any]) -> None:
    """Write a wall that is being drawn beside the masks, with the digest of its
    frame.
    """
    path = _draft(recording, file)
    path.parent.mkdir(exist_ok=True)
    write_whole(json.dumps(drawn | {"source_sha256": _digest(recording, file)}), path)


def read_draft(recording: Recording, file: str) -> dict[str, Any] | None:
    """Return the draft of a frame's wall; None without one, if it is damaged, or if the
    frame has changed since.
    """
    with suppress(InputError, ValueError):
        draft = parse_json(read_text(_draft(recording, file), KINDS["result"]))
        if isinstance(draft, dict) and draft.pop("source_sha256", "") == _digest(
            recording, file
        ):
            return draft

    return None


def remove_draft(recording: Recording, file: str) -> None:
    """Remove the draft of a frame's wall."""
    _draft(recording, file).unlink(missing_ok=True)


def _draft(recording: Recording, file: str) -> Path:
    return recording.path / "walls" / f".{PurePath(file).stem}.draft.json"


def _digest(recording: Recording, file: str) -> str:
    return frame_file_digest(recording.path / "frames" / file)


def _outline(wall: Segmentation) -> dict[str, Any]:
    inner = wall.inner_row if wall.inner_found else np.full_like(wall.inner_row, np.nan)
    rows = [
        [round(row, 2) if np.isfinite(row) else None for row in each.tolist()]
        for each in (wall.outer_row, inner)
    ]

    return {
        "outer": rows[0],
        "inner": rows[1],
        "usable": wall.usable,
        "reason": wall.reason,
        "source": wall.source,
        "thickness_um": from_si(wall.thickness_m, "um"),
    }
