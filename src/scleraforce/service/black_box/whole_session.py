"""The recording of the whole session as long as it can be written: it begins, loses frames, ends, and says so."""

from scleraforce.service.black_box.heard import SessionBeginning
from scleraforce.service.black_box.journal import Journal
from scleraforce.service.black_box.kept_frames import FrameTaker, TakenFrame
from scleraforce.service.black_box.robot_force import ForceSample
from scleraforce.service.black_box.session_recording import SessionRecording
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import BlackBoxSettings

SESSION = "session"  # what is not kept, where the disk fails


class WholeSession:
    """Records the session if the settings ask for it; a disk that fails ends the recording, and nothing else.

    Args:
        settings: of the black box.
        ring: holds the frames.
        journal: for notes and faults.
    """

    def __init__(self, settings: BlackBoxSettings, ring: FrameRing, journal: Journal) -> None:
        self._settings, self._ring, self._journal = settings, ring, journal
        self._recording: SessionRecording | None = None
        self._told_lost = False

    @property
    def taker(self) -> FrameTaker | None:
        """Takes the session's frames; None while nothing is recorded."""
        return self._recording.taker if self._recording else None

    def begin(self, beginning: SessionBeginning) -> None:
        """Begin the recording, if one is asked for."""
        folder = self._settings.record
        if folder is None or not self._journal.has_room(SESSION, folder):
            return
        try:
            self._recording = SessionRecording(folder, self._settings.info, beginning.comment, self._ring)
        except OSError as fault:
            self._journal.fault(SESSION, fault)

    def add_frame(self, frame: TakenFrame) -> None:
        """Queue a frame."""
        if self._recording:
            self._recording.taker.add(frame)

    def add_force(self, columns: tuple[str, ...], sample: ForceSample, beginning: SessionBeginning) -> None:
        """Add a sample of the robot's force."""
        if self._recording is None:
            return
        try:
            self._recording.add_force(columns, sample, beginning.at_s)
        except OSError as fault:
            self._journal.fault(SESSION, fault)
            self.end()

    def write_frame(self) -> None:
        """Write the frame that waits longest."""
        recording = self._recording
        if recording is None:
            return
        if not self._journal.has_room(SESSION, recording.folder):
            self.end()
            return
        try:
            recording.taker.take()
        except OSError as fault:
            self._journal.fault(SESSION, fault)
            self.end()
            return
        self._tell_lost(recording)

    def _tell_lost(self, recording: SessionRecording) -> None:
        """Note that frames are lost, the first time."""
        if recording.taker.lost and not self._told_lost:
            self._told_lost = True
            self._journal.note(f"{recording.folder}: the disk does not keep up: frames are lost")

    def end(self) -> None:
        """Close the recording, if there is one."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        try:
            recording.close()
        except OSError as fault:
            self._journal.fault(SESSION, fault)
        taker = recording.taker
        self._journal.note(f"recorded {taker.written} frames in {recording.folder}; {taker.lost} were lost")
