"""The recording of one withdrawal: its last seconds, in a folder that appears when it is complete."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from scleraforce.errors import ScleraforceError
from scleraforce.recording.folder import RecordingInfo
from scleraforce.recording.writing import ForceWriter, RecordingWriter
from scleraforce.service.black_box.kept_frames import FrameTaker, TakenFrame
from scleraforce.service.black_box.robot_force import ForceSample
from scleraforce.service.companions.frame_ring import FrameRing


class KeptWithdrawal:
    """The recording of one withdrawal: written as `.NAME.partial`, and renamed when it is complete.

    Args:
        folder: its final name.
        info: contents of recording.toml.
        comment: first line of recording.toml.
        ring: holds the frames.
        frames: those to keep, oldest first.
        decisions: lines of the log for the same seconds.

    Raises:
        OSError: the folder cannot be written. The methods raise it as well.
    """

    def __init__(
        self,
        folder: Path,
        info: RecordingInfo,
        comment: str,
        ring: FrameRing,
        frames: Sequence[TakenFrame],
        decisions: bytes,
    ) -> None:
        self.folder = folder
        self._partial = folder.parent / f".{folder.name}.partial"
        writer = RecordingWriter(self._partial, info, comment)
        (self._partial / "decisions.jsonl").write_bytes(decisions)
        self.taker = FrameTaker(ring, writer)
        for frame in frames:
            self.taker.add(frame)

    def finish(self, columns: Sequence[str], forces: Sequence[ForceSample], start_s: float) -> str | None:
        """Write the force log, wait for the disk, rename the folder; return why the log gives no labels, else None.

        Args:
            columns: of the force log; empty for no log.
            forces: its samples.
            start_s: time 0 of the recording, on the clock of the samples.
        """
        self.taker.close()
        reason = self._write_forces(columns, forces, start_s) if columns else None
        for path in (*self._partial.rglob("*"), self._partial):
            _sync(path)
        self._partial.rename(self.folder)
        _sync(self.folder.parent)
        return reason

    def remove(self) -> None:
        """Remove the unfinished folder."""
        shutil.rmtree(self._partial, ignore_errors=True)

    def _write_forces(self, columns: Sequence[str], forces: Sequence[ForceSample], start_s: float) -> str | None:
        """Write the log; if it can label no frame, set it aside, so that the frames can be read."""
        from scleraforce.recording.folder import read_recording  # here: the monitor imports this module without SciPy
        from scleraforce.recording.labels import label_frames
        from scleraforce.recording.tables import MIN_SAMPLE_RATE_HZ
        from scleraforce.study.records import ClassesStudy

        log = ForceWriter(self._partial, columns)
        for sample in forces:
            log.add(sample.at_s - start_s, sample.values)
        log.close()
        try:
            label_frames(read_recording(self._partial), ClassesStudy())
        except ScleraforceError as fault:
            log.set_aside()
            return str(fault).replace(str(self._partial), str(self.folder))
        return (
            None if (self._partial / "forces.csv").exists() else f"fewer than {MIN_SAMPLE_RATE_HZ:g} samples a second"
        )


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
