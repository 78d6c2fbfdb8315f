"""The recordings of the black box: of the whole session, and of the last seconds before each withdrawal."""

import os
import shutil
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from scleraforce.errors import ScleraforceError
from scleraforce.recording.folder import RecordingInfo
from scleraforce.recording.writing import ForceWriter, RecordingWriter
from scleraforce.service.black_box.heard import ForceSample, Heard, SessionBeginning
from scleraforce.service.black_box.journal import Journal
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import BlackBoxSettings
from scleraforce.service.entry import Entry

CLOCK_STEP_S = 1e-6  # of frames.csv
SESSION = "session"  # what is not kept, where the disk fails
WITHDRAWAL = "withdrawal"  # what is not kept, where the disk fails


@dataclass(frozen=True)
class TakenFrame:
    """A frame in the ring: its number, and the time of its decision on the recording's clock."""

    number: int
    time_s: float


class FrameTaker:
    """Takes frames out of the ring, oldest first, and writes them into a recording folder.

    Attributes:
        written: how many frames are complete.
        lost: how many were overwritten before their turn, or could not be written.
    """

    def __init__(self, ring: FrameRing, writer: RecordingWriter) -> None:
        self.written = self.lost = 0
        self._ring, self._writer = ring, writer
        self._waiting: deque[TakenFrame] = deque()
        self._last_s = -float("inf")

    def add(self, frame: TakenFrame) -> None:
        """Queue a frame."""
        if len(self._waiting) == self._ring.frames:  # then the oldest one has been overwritten
            self._waiting.popleft()
            self.lost += 1
        self._waiting.append(frame)

    @property
    def next(self) -> int | None:
        """Number of the next frame to write."""
        return self._waiting[0].number if self._waiting else None

    def take(self) -> None:
        """Write the next frame, or count it as lost.

        Raises:
            OSError: it cannot be written.
        """
        frame = self._waiting.popleft()
        pixels = self._ring.get(frame.number)
        if pixels is None:
            self.lost += 1
            return
        self._last_s = max(frame.time_s, self._last_s + CLOCK_STEP_S)  # no two frames of a table share a time
        try:
            self._writer.add(f"{frame.number:07d}.png", self._last_s, pixels)
        except OSError:
            self.lost += 1
            raise
        self.written += 1

    def close(self) -> None:
        """Close the folder's tables; frames that still wait count as lost."""
        self.lost += len(self._waiting)
        self._waiting.clear()
        self._writer.close()


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


@dataclass
class _Writing:
    """The withdrawal that is being written.

    Attributes:
        kept: its recording.
        due_s: time, on the monotonic clock, from which on the forces after it suffice.
        finishing: writes what is left after the frames.
    """

    kept: KeptWithdrawal
    due_s: float
    finishing: Future[str | None] | None = None


class Withdrawals:
    """Keeps the last seconds before withdrawals.

    Args:
        settings: of the black box.
        ring: holds the frames.
        heard: the last seconds.
        journal: for notes and faults.
    """

    def __init__(self, settings: BlackBoxSettings, ring: FrameRing, heard: Heard, journal: Journal) -> None:
        self._settings, self._ring, self._heard, self._journal = settings, ring, heard, journal
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=WITHDRAWAL)
        self._writing: _Writing | None = None
        self._wanted: tuple[str, Entry] | None = None

    @property
    def busy(self) -> bool:
        """Whether one is being written."""
        return self._writing is not None

    @property
    def taker(self) -> FrameTaker | None:
        """Takes the frames of the one that is being written."""
        return self._writing.kept.taker if self._writing else None

    def keep(self, cause: str, entry: Entry) -> None:
        """Keep the seconds up to an entry; while others are being written, only the latest request waits."""
        if self._writing is not None:
            if self._wanted:
                self._journal.note(
                    f"the seconds up to {self._wanted[0]} are not kept: more happened while others were written"
                )
            self._wanted = cause, entry
            return
        self._wanted = None
        if not self._journal.has_room(WITHDRAWAL, self._settings.folder):
            return
        try:
            kept = self._begin(cause, entry)
        except OSError as fault:
            self._journal.fault(WITHDRAWAL, fault)
            return
        # Labels of the last frames average over what comes after them.
        self._writing = _Writing(kept, time.monotonic() + self._settings.force.average_s)

    def _begin(self, cause: str, entry: Entry) -> KeptWithdrawal:
        """Begin the recording of the seconds up to an entry."""
        beginning = self._heard.begin(entry.at_s, entry.time_s)
        frames, lines = self._heard.recent.until(entry.at_s)
        stamp = datetime.fromtimestamp(entry.time_s, UTC).strftime("%Y%m%dT%H%M%S.%f")[:-3]
        return KeptWithdrawal(
            self._settings.folder / "withdrawals" / f"{stamp}Z-{cause}",
            self._settings.info,
            f"{beginning.comment} Kept: {cause}.",
            self._ring,
            [TakenFrame(number, frame_s - beginning.at_s) for frame_s, number in frames],
            b"".join(lines),
        )

    def write_frame(self) -> None:
        """Write the frame that waits longest."""
        if self._writing is None:
            return
        try:
            self._writing.kept.taker.take()
        except OSError as fault:
            self._journal.fault(WITHDRAWAL, fault)

    def turn(self, *, ended: bool) -> None:
        """When all frames are written, write the rest in a thread; tell the monitor when the recording is complete.

        Args:
            ended: the monitor has ended, so no more forces come.
        """
        writing = self._writing
        if writing is None or writing.kept.taker.next is not None:
            return
        force = self._heard.force
        if writing.finishing is None:
            if time.monotonic() < writing.due_s and not ended and force.columns:
                return
            start_s = self._heard.beginning.at_s if self._heard.beginning else 0.0
            writing.finishing = self._thread.submit(writing.kept.finish, force.columns, tuple(force.samples), start_s)
        if writing.finishing.done():
            self._complete(writing.kept, writing.finishing)

    def _complete(self, kept: KeptWithdrawal, finished: Future[str | None]) -> None:
        """Tell how the recording came out; then begin the one that waits."""
        try:
            reason = finished.result()
            self._journal.note(f"kept {kept.taker.written} frames in {kept.folder}; {kept.taker.lost} were lost")
            if reason:
                self._journal.note(f"{kept.folder}: the robot's force gives no labels: {reason}")
            self._journal.kept(kept.folder)
        except OSError as fault:
            kept.remove()
            self._journal.fault(WITHDRAWAL, fault)
        self._writing = None
        if self._wanted:
            self.keep(*self._wanted)

    def close(self) -> None:
        """End the thread, which has nothing left to do."""
        self._thread.shutdown()
