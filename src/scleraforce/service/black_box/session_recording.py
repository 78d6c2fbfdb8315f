"""`scleraforce monitor --record`: a recording of the whole session, written while it runs."""

from pathlib import Path

from scleraforce.recording.folder import RecordingInfo
from scleraforce.recording.writing import ForceWriter, RecordingWriter
from scleraforce.service.black_box.kept_frames import FrameTaker
from scleraforce.service.black_box.robot_force import ForceSample
from scleraforce.service.companions.frame_ring import FrameRing


class SessionRecording:
    """The recording of a session; it can be read at any time.

    Args:
        folder: must not exist.
        info: contents of recording.toml.
        comment: first line of recording.toml.
        ring: holds the frames.

    Raises:
        OSError: the folder exists or cannot be written. The methods raise it as well.
    """

    def __init__(self, folder: Path, info: RecordingInfo, comment: str, ring: FrameRing) -> None:
        self.folder = folder
        self.taker = FrameTaker(ring, RecordingWriter(folder, info, comment))
        self._forces: ForceWriter | None = None

    def add_force(self, columns: tuple[str, ...], sample: ForceSample, start_s: float) -> None:
        """Add a sample of the robot's force; `start_s` is time 0 of the recording, on the clock of the sample."""
        if self._forces is None:
            self._forces = ForceWriter(self.folder, columns)
        self._forces.add(sample.at_s - start_s, sample.values)

    def close(self) -> None:
        """Close all files; frames that still wait count as lost."""
        self.taker.close()
        if self._forces is not None:
            self._forces.close()
