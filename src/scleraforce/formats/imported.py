"""Write imported frames and forces as a recording folder: whole or not at all."""

import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError, RecordingError
from scleraforce.recording.files import Recording, read_recording
from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.tables import ForceLog
from scleraforce.recording.writing import RecordingWriter

PLAIN_NAME = re.compile(r"\w[\w.+-]*", re.ASCII)  # of a frame's file, without its ending; no formula in a spreadsheet


@contextmanager
def folder_when_whole(out: Path) -> Iterator[Path]:
    """Give the name of a folder beside `out` that is not there yet; it becomes `out` when it is finished.

    Raises:
        InputError: `out` exists, or what is beside it cannot be written.
        OSError: a file that was read meanwhile cannot be; it has its name.
    """
    if out.exists() or out.is_symlink():
        raise InputError(f"{out}: exists already; remove it or choose another --out")
    part = out.with_name(f".scleraforce-{secrets.token_hex(8)}.part")
    try:
        yield part
        part.rename(out)
    except OSError as fault:
        if fault.filename is not None and not Path(fault.filename).is_relative_to(part):
            raise
        raise InputError(f"{out}: {fault.strerror}") from fault
    finally:
        shutil.rmtree(part, ignore_errors=True)


def frame_files(names: Sequence[str]) -> list[str]:
    """Return names of frames' files: those of their sources where each has one of its own, else numbers.

    >>> frame_files(["scans/a.png", "scans/b.jpg"]), frame_files(["volume.nii[0]", "volume.nii[1]"])
    (['a.png', 'b.png'], ['0001.png', '0002.png'])
    >>> frame_files(["scans/-1.png", "scans/+2.png"])
    ['0001.png', '0002.png']
    """
    stems = [PurePath(name).stem for name in names]
    own = len(set(stems)) == len(stems) and all(PLAIN_NAME.fullmatch(stem) for stem in stems)
    digits = max(4, len(str(len(names))))
    return [f"{stem}.png" if own else f"{nth:0{digits}d}.png" for nth, stem in enumerate(stems, start=1)]


def write_frames(
    folder: Path, info: RecordingInfo, comment: str, frames: Iterable[tuple[str, float, NDArray[np.uint16]]]
) -> None:
    """Write recording.toml, frames/ and frames.csv; frames (file, time in s, counts) come in the order of their times.

    Raises:
        OSError: the folder exists, or cannot be written.
    """
    writer = RecordingWriter(folder, info, comment)
    try:
        for file, time_s, counts in frames:
            writer.add(file, time_s, counts)
    finally:
        writer.close()


def write_log(folder: Path, log: ForceLog) -> None:
    """Write forces.csv: times to the microsecond, forces and torques to 7 digits, nan where there is no force."""
    formats = ["%.6f", *["%.7g"] * len(log.columns)]
    values_sc = np.column_stack([log.time_s, log.wrench_sc])
    header = ",".join(["time_s", *log.columns])
    np.savetxt(folder / "forces.csv", values_sc, fmt=formats, delimiter=",", header=header, comments="")


def written(folder: Path, out: Path) -> Recording:
    """Read what was written, as every other command will.

    Raises:
        RecordingError: it is no recording that can be used; the message names `out`, where it was to be.
    """
    try:
        return read_recording(folder)
    except RecordingError as fault:
        raise RecordingError(str(fault).replace(str(folder), str(out))) from fault
