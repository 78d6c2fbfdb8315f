"""The recording of one withdrawal: its last seconds, as a folder that appears when it is whole."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from scleraforce.errors import ScleraforceError
from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.writing import ForceWriter, RecordingWriter
from scleraforce.service.black_box.kept_frames import FrameTaker, TakenFrame
from scleraforce.service.black_box.robot_force import ForceSample
from scleraforce.service.companions.frame_ring import FrameRing

__all__ = ["KeptWithdrawal"]


class KeptWithdrawal:
    """The recording of one withdrawal: written as `.NAME.partial`, and renamed when it is whole.

    Args:
        folder: where it will appear.
        info: what recording.toml says.
        comment: a line at its top.
        ring: where the frames are.
        frames: which of them, oldest first.
        decisions: lines of the log that stand beside them.

    Raises:
        OSError: it cannot be written; so do the methods.
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
        """Write the force log, wait for the disk, rename the folder; where the log gives no labels, say why.

        Args:
            columns: of the force log; none: there is no log.
            forces: its samples.
            start_s: the recording's time 0 on their clock.
        """
        self.taker.close()
        reason = self._write_forces(columns, forces, start_s) if columns else None
        for path in (*self._partial.rglob("*"), self._partial):
            _sync(path)
        self._partial.rename(self.folder)
        _sync(self.folder.parent)
        return reason

    def remove(self) -> None:
        """Remove what was written."""
        shutil.rmtree(self._partial, ignore_errors=True)

    def _write_forces(self, columns: Sequence[str], forces: Sequence[ForceSample], start_s: float) -> str | None:
        """Write the log; where it cannot say the force of every frame, set it aside, so that the rest can be read."""
        from scleraforce.recording.files import read_recording  # here: the monitor, which starts this, has no SciPy
        from scleraforce.recording.labels import label_frames
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
        return None if (self._partial / "forces.csv").exists() else "fewer than 100 samples a second"


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
