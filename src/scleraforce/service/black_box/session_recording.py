"""`scleraforce monitor --record`: the whole session as a recording folder, written while it runs."""

from pathlib import Path

from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.writing import ForceWriter, RecordingWriter
from scleraforce.service.black_box.kept_frames import FrameTaker
from scleraforce.service.black_box.robot_force import ForceSample
from scleraforce.service.companions.frame_ring import FrameRing

__all__ = ["SessionRecording"]


class SessionRecording:
    """The recording of a session; it can be read at any time.

    Args:
        folder: must not exist.
        info: what recording.toml says.
        comment: a line at its top.
        ring: where the frames are.

    Raises:
        OSError: it exists or cannot be written; so do the methods.
    """

    def __init__(self, folder: Path, info: RecordingInfo, comment: str, ring: FrameRing) -> None:
        self.folder = folder
        self.taker = FrameTaker(ring, RecordingWriter(folder, info, comment))
        self._forces: ForceWriter | None = None

    def add_force(self, columns: tuple[str, ...], sample: ForceSample, start_s: float) -> None:
        """Add a sample of the robot's force; `start_s` is the recording's time 0 on its clock."""
        if self._forces is None:
            self._forces = ForceWriter(self.folder, columns)
        self._forces.add(sample.at_s - start_s, sample.values)

    def close(self) -> None:
        """Close what is open; frames that wait are counted as lost."""
        self.taker.close()
        if self._forces is not None:
            self._forces.close()
