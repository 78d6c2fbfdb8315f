"""Read a recording folder: `recording.toml`, `frames.csv`, `frames/` and, where it was logged, `forces.csv`.

`docs/recordings.md` describes the folder. Frames are read one at a time, by `Recording.frame`.
"""

import hashlib
import os
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from scleraforce.errors import RecordingError, StudyError
from scleraforce.recording.images import check_frame, read_frame
from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.pixels import Pixels
from scleraforce.recording.tables import ForceLog, FrameEntry, read_force_log, read_frame_list
from scleraforce.study.toml import parse_record
from scleraforce.whole_files import KINDS, read_bytes, read_text


@dataclass(frozen=True)
class Recording:
    """One eye's recording: where it lies, what it states, its frames in order, its force log (None: not logged)."""

    path: Path
    info: RecordingInfo
    frames: tuple[FrameEntry, ...]
    forces: ForceLog | None

    def frame_path(self, entry: FrameEntry) -> Path:
        """Return where a frame's file lies."""
        return self.path / "frames" / entry.file

    def frame(self, entry: FrameEntry) -> Pixels:
        """Read a frame, uint8 or uint16 (rows, columns), and check it against recording.toml.

        Raises:
            FrameError: the file cannot be read, or has another size or more bits than stated.
        """
        path = self.frame_path(entry)
        pixels = read_frame(path)
        check_frame(pixels, self.info.oct.rows, self.info.oct.columns, self.info.oct.bits, str(path))
        return pixels


def read_recording(path: str | PathLike[str]) -> Recording:
    """Read and check a recording folder; its frames are looked for, but not opened.

    Raises:
        RecordingError: naming the file, the line and the field.

    >>> import scleraforce as sf
    >>> recording = sf.read_recording("eye-a")
    >>> [recording.frame(entry).shape for entry in recording.frames]
    [(512, 512), (512, 512), (512, 512)]
    """
    path = Path(path)
    info = read_info(path / "recording.toml")
    frames = read_frame_list(path / "frames.csv")
    _check_files(path, frames)
    if not os.path.lexists(path / "forces.csv"):
        return Recording(path, info, frames, None)
    if info.force is None:
        raise RecordingError(f"{path / 'recording.toml'}: force: missing; forces.csv needs [force] axis, contact_sign")
    return Recording(path, info, frames, read_force_log(path / "forces.csv", info.force.axis))


def frame_digest(pixels: Pixels) -> str:
    """Return what a frame is known by, whatever its file is called: the SHA-256 of its size and pixels, hexadecimal.

    >>> import numpy as np
    >>> frame_digest(np.zeros((2, 3), np.uint8)) == frame_digest(np.zeros((2, 3), np.uint16))
    True
    """
    digest = hashlib.sha256(f"{pixels.shape[0]} x {pixels.shape[1]}\n".encode())
    digest.update(pixels.astype("<u2").tobytes())
    return digest.hexdigest()


def tables_digest(recording: Recording) -> str:
    """Return the SHA-256 of a recording's tables (recording.toml, frames.csv, forces.csv), hexadecimal.

    Raises:
        RecordingError: one of them cannot be read any more.
    """
    digest = hashlib.sha256()
    for kind, name in (("recording", "recording.toml"), ("frames", "frames.csv"), ("forces", "forces.csv")):
        digest.update(read_bytes(recording.path / name, KINDS[kind]))
    return digest.hexdigest()


def read_info(path: Path) -> RecordingInfo:
    """Read and check a recording.toml.

    Raises:
        RecordingError: naming the file, the line and the field.
    """
    if not path.parent.is_dir():
        raise RecordingError(f"{path.parent}: no such folder; give a recording folder")
    try:
        return parse_record(RecordingInfo, read_text(path, KINDS["recording"]), str(path))
    except StudyError as fault:
        raise RecordingError(str(fault)) from fault


def _check_files(path: Path, frames: tuple[FrameEntry, ...]) -> None:
    folder = (path / "frames").resolve()
    for entry in frames:
        file = path / "frames" / entry.file
        place = f"{path / 'frames.csv'}: file"
        try:
            inside, there = file.resolve().is_relative_to(folder), file.is_file()
        except (OSError, RuntimeError) as fault:  # a name that is too long, links that go round
            reason = fault.strerror if isinstance(fault, OSError) else fault
            raise RecordingError(f"{place}: {entry.file}: {reason}") from fault
        if not inside:
            raise RecordingError(f"{place}: {entry.file} leads out of {path / 'frames'}")
        if not there:
            raise RecordingError(f"{place}: {file} does not exist")
