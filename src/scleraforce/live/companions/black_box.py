"""The black box: a process that logs every decision and keeps the frames of withdrawals
or of the session (Linux).

One thread writes one frame at a time, always the oldest one that is wanted, and listens
to the monitor in between. Other threads only wait for the disk. docs/black_box.md
describes what is written, and what happens when it cannot be.
"""

import os
import shutil
import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from math import floor, isfinite
from pathlib import Path
from select import select

from scleraforce.base.errors import MessageError, ScleraforceError
from scleraforce.base.version import __version__
from scleraforce.live.companions import process_messages
from scleraforce.live.companions.decision_log import Journal
from scleraforce.live.companions.process_channel import (
    Channel,
    ChannelClosedError,
    run_companion,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    MIN_SAMPLE_RATE_HZ,
)
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.recordings.recording_writer import (
    FORCE_STEP_S,
    ForceWriter,
    RecordingWriter,
)
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.study import ClassesStudy

NICENESS = 5
ALIVE_S = 0.5
POLL_S = 0.02
MOST_MESSAGES = 100  # until a frame is written
MOST_LINES = 20_000
# the tare is found before the first contact, so a log of the last 10 s would be too
# short
HISTORY_S = 600.0
CLOCK_STEP_S = 1e-6  # of frames.csv
COLUMNS = ("pierced", "travel_m")  # optional columns of frames.csv
FARTHEST_M = 1.0  # farthest travel in it
PLANE_COLUMN = ("plane",)  # as well, of several planes
# the names of their faults
SESSION = "session"
WITHDRAWAL = "withdrawal"


@dataclass(frozen=True)
class SessionBeginning:
    """Time 0 of the session's recordings on the monotonic clock, and the first line of
    each recording.toml.
    """

    at_s: float
    comment: str


# the middle of a step (s), and the means in it (N, N m)
ForceSample = tuple[float, tuple[float, ...]]


class RobotForce:
    """Takes the forces that robots send; `samples` has the last ten minutes.

    Even steps give the log a defined rate; by times of arrival, a burst could have any
    rate. No sample is invented: a step in which nothing came is left out. Only the
    first device is taken, with its first count of numbers. `info` has the axis and sign
    of a force that comes as one number, positive in contact.
    """

    def __init__(self, info: ForceInfo) -> None:
        self.samples: deque[ForceSample] = deque(maxlen=round(HISTORY_S / FORCE_STEP_S))
        self.columns: tuple[str, ...] = ()
        self.refused = 0
        self._info = info
        self._source: tuple[str, int] | None = None
        self._step = -1
        self._sums: list[float] = []
        self._count = 0

    def add(
        self, at_s: float, values: Sequence[float], device: str
    ) -> ForceSample | None:
        """Take a message that came at `at_s`; if it begins a new step, return the
        sample of the step before.
        """
        source = (device, len(values))
        sound = len(values) in (1, 3, 6) and all(map(isfinite, (at_s, *values)))
        if not sound or self._source not in (None, source):
            self.refused += 1
            return None

        self._source = source
        if len(values) == 1:
            values = [self._info.contact_sign * values[0]]

        self.columns = (
            (f"{self._info.axis}_n",)
            if len(values) == 1
            else FORCE_COLUMNS[1 : 1 + len(values)]
        )
        step = max(floor(at_s / FORCE_STEP_S), self._step)
        sample = None

        if step > self._step:
            if self._count:
                sample = (
                    (self._step + 0.5) * FORCE_STEP_S,
                    tuple(total / self._count for total in self._sums),
                )
                self.samples.append(sample)

            self._sums = [0.0] * len(self.columns)
            self._step = step
            self._count = 0

        self._sums = [
            total + value for total, value in zip(self._sums, values, strict=True)
        ]
        self._count += 1

        return sample


class FrameTaker:
    """Takes frames out of the ring, oldest first, and writes them into a new recording
    folder, or raises OSError.

    `start_s` is time 0 of the recording. `written` counts the complete frames, `lost`
    the ones that were overwritten before or could not be written.
    """

    def __init__(
        self,
        ring: FrameRing,
        folder: Path,
        info: RecordingInfo,
        beginning: SessionBeginning,
        kept: str = "",
    ) -> None:
        self.folder = folder
        self.start_s = beginning.at_s
        self.written = self.lost = 0
        columns = COLUMNS + PLANE_COLUMN * bool(info.scan.planes)
        self._ring = ring
        self._writer = RecordingWriter(folder, info, beginning.comment + kept, columns)
        self._waiting: deque[process_messages.Decided] = deque()
        self._last_s = -float("inf")
        self._moment = 0

    def add(self, decided: process_messages.Decided) -> None:
        """Enqueue the frame of a decision, whose time it gets; frames of one moment get
        that of the first of them.
        """
        if len(self._waiting) == self._ring.frames:
            # then the oldest one has been overwritten
            self._waiting.popleft()
            self.lost += 1
        self._waiting.append(decided)

    @property
    def next(self) -> int | None:
        """Number of the next frame to write."""
        return self._waiting[0].entry.frame if self._waiting else None

    def take(self) -> None:
        """Write the next frame, or count it as lost."""
        decided = self._waiting.popleft()
        number = decided.entry.frame or 0
        moment = decided.moment

        pixels = self._ring.get(number)
        if pixels is None:
            self.lost += 1
            return

        if moment is None or moment != self._moment:
            # no two frames of one plane share a time
            self._last_s = max(
                decided.entry.at_s - self.start_s, self._last_s + CLOCK_STEP_S
            )
            self._moment = moment or number

        try:
            self._writer.add(f"{number:07d}.png", self._last_s, pixels, _cells(decided))
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
    """The recording of the session, if the settings ask for one; a disk that fails ends
    it, and nothing else.

    It can be read at any time. `taker` takes its frames; None while nothing is
    recorded.
    """

    def __init__(
        self,
        settings: process_messages.BlackBoxSettings,
        ring: FrameRing,
        journal: Journal,
    ) -> None:
        self.taker: FrameTaker | None = None
        self._settings = settings
        self._ring = ring
        self._journal = journal
        self._forces: ForceWriter | None = None
        self._loss_noted = False

    def begin(self, beginning: SessionBeginning) -> None:
        """Begin the recording, if one is asked for."""
        folder = self._settings.record
        if folder is not None and self._journal.has_room(SESSION, folder):
            with self._ended_by_a_fault():
                self.taker = FrameTaker(
                    self._ring, folder, self._settings.info, beginning
                )

    def add_force(self, columns: tuple[str, ...], sample: ForceSample) -> None:
        """Add a sample of the robot's force."""
        if self.taker is not None:
            with self._ended_by_a_fault():
                self._forces = self._forces or ForceWriter(self.taker.folder, columns)
                self._forces.add(sample[0] - self.taker.start_s, sample[1])

    def write_frame(self, taker: FrameTaker) -> None:
        """Write the next frame of the taker."""
        if not self._journal.has_room(SESSION, taker.folder):
            self.end()
            return

        with self._ended_by_a_fault():
            taker.take()
            if taker.lost and not self._loss_noted:
                self._loss_noted = True
                self._journal.note(
                    f"{taker.folder}: the disk does not keep up: frames are lost"
                )

    @contextmanager
    def _ended_by_a_fault(self) -> Iterator[None]:
        try:
            yield
        except OSError as fault:
            self._journal.fault(SESSION, fault)
            self.end()

    def end(self) -> None:
        """Close the recording, if there is one; frames that still wait count as
        lost.
        """
        taker = self.taker
        self.taker = None
        if taker is None:
            return

        try:
            taker.close()
            if self._forces is not None:
                self._forces.close()
        except OSError as fault:
            self._journal.fault(SESSION, fault)

        self._journal.note(
            f"recorded {taker.written} frames in {taker.folder}; {taker.lost} were lost"
        )


@dataclass
class _Writing:
    """A withdrawal that is being written, in `.NAME.partial`, which is renamed to
    `folder` when it is complete.

    From `due_s` on the forces after it suffice. `finishing` writes the rest after the
    frames; its result is the reason if the force log gives no labels, else None.
    """

    folder: Path
    taker: FrameTaker
    due_s: float
    finishing: Future[str | None] | None = None


class Withdrawals:
    """Remembers the frames and the log's lines of the last seconds, and keeps them at a
    withdrawal.
    """

    def __init__(
        self,
        settings: process_messages.BlackBoxSettings,
        ring: FrameRing,
        force: RobotForce,
        journal: Journal,
    ) -> None:
        self._settings = settings
        self._ring = ring
        self._force = force
        self._journal = journal
        self._frames: deque[process_messages.Decided] = deque(maxlen=ring.frames)
        self._lines: deque[tuple[float, bytes]] = deque(maxlen=MOST_LINES)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=WITHDRAWAL)
        self._writing: _Writing | None = None
        self._wanted: tuple[str, process_messages.Entry, SessionBeginning] | None = None

    def remember(self, decided: process_messages.Decided, line: bytes) -> bool:
        """Remember the line and the frame of a decision; return whether the frame is
        new (opinions name it again).
        """
        entry = decided.entry
        self._lines.append((entry.at_s, line))
        while self._lines[0][0] < entry.at_s - self._settings.keep_s:
            self._lines.popleft()

        if entry.frame is None or (
            self._frames and entry.frame <= (self._frames[-1].entry.frame or 0)
        ):
            return False

        self._frames.append(decided)
        return True

    @property
    def taker(self) -> FrameTaker | None:
        """Takes the frames of the withdrawal that is being written, if one is."""
        return self._writing.taker if self._writing else None

    def keep(
        self, cause: str, entry: process_messages.Entry, beginning: SessionBeginning
    ) -> None:
        """Keep the seconds up to an entry; while others are being written, only the
        latest request waits.
        """
        if self._writing is not None:
            if self._wanted:
                lost = f"the seconds up to {self._wanted[0]} are not kept"
                self._journal.note(f"{lost}: more happened while others were written")

            self._wanted = cause, entry, beginning
            return

        self._wanted = None
        if not self._journal.has_room(WITHDRAWAL, self._settings.folder):
            return

        try:
            self._writing = self._begin(cause, entry, beginning)
        except OSError as fault:
            self._journal.fault(WITHDRAWAL, fault)

    def _begin(
        self, cause: str, entry: process_messages.Entry, beginning: SessionBeginning
    ) -> _Writing:
        since_s = entry.at_s - self._settings.keep_s
        stamp = datetime.fromtimestamp(entry.time_s, UTC).strftime("%Y%m%dT%H%M%S.%f")[
            :-3
        ]
        folder = self._settings.folder / "withdrawals" / f"{stamp}Z-{cause}"
        partial = folder.parent / f".{folder.name}.partial"
        taker = FrameTaker(
            self._ring, partial, self._settings.info, beginning, f" Kept: {cause}."
        )
        lines = [
            line for line_s, line in self._lines if since_s <= line_s <= entry.at_s
        ]
        (partial / "decisions.jsonl").write_bytes(b"".join(lines))

        for decided in self._frames:
            if since_s <= decided.entry.at_s <= entry.at_s:
                taker.add(decided)

        # Labels of the last frames average over what comes after them.
        return _Writing(
            folder, taker, time.monotonic() + self._settings.force.average_s
        )

    def write_frame(self, taker: FrameTaker) -> None:
        """Write the next frame of the taker."""
        try:
            taker.take()
        except OSError as fault:
            self._journal.fault(WITHDRAWAL, fault)

    def turn(self, *, ended: bool) -> None:
        """Write the rest in a thread once all frames are written. If the monitor has
        `ended`, no more forces come.
        """
        writing = self._writing
        force = self._force
        if writing is None or writing.taker.next is not None:
            return

        if writing.finishing is None:
            if time.monotonic() < writing.due_s and not ended and force.columns:
                return
            writing.finishing = self._thread.submit(
                _finish, writing, force.columns, tuple(force.samples)
            )

        if writing.finishing.done():
            self._complete(writing, writing.finishing)

    def _complete(self, writing: _Writing, finished: Future[str | None]) -> None:
        taker = writing.taker
        folder = writing.folder

        try:
            reason = finished.result()
            self._journal.note(
                f"kept {taker.written} frames in {folder}; {taker.lost} were lost"
            )

            if reason:
                self._journal.note(
                    f"{folder}: the robot's force gives no labels: {reason}"
                )

            self._journal.send(process_messages.WithdrawalKept(folder=str(folder)))
        except OSError as fault:
            shutil.rmtree(taker.folder, ignore_errors=True)
            self._journal.fault(WITHDRAWAL, fault)

        self._writing = None
        if self._wanted:
            self.keep(*self._wanted)

    def close(self) -> None:
        """End the thread, which has nothing left to do."""
        self._thread.shutdown()


def _cells(decided: process_messages.Decided) -> tuple[str, ...]:
    """Return the cells of a frame in the columns, empty where nothing is known."""
    travel_m = decided.travel_m
    plane = decided.entry.plane
    known = travel_m is not None and abs(travel_m) <= FARTHEST_M
    return (
        "1" if decided.pierced else "",
        f"{travel_m:.7f}" if known else "",
        *([plane] if plane else []),
    )


def _finish(
    writing: _Writing, columns: Sequence[str], forces: Sequence[ForceSample]
) -> str | None:
    """Write the force log, wait for the disk, rename the folder; return the reason if
    the log gives no labels.
    """
    writing.taker.close()
    reason = _write_forces(writing, columns, forces) if columns else None
    partial = writing.taker.folder
    for path in (*partial.rglob("*"), partial):
        _sync(path)

    partial.rename(writing.folder)
    _sync(writing.folder.parent)
    return reason


def _write_forces(
    writing: _Writing, columns: Sequence[str], forces: Sequence[ForceSample]
) -> str | None:
    """Write the log; if it can label no frame, set it aside, so that the frames can be
    read.
    """
    partial = writing.taker.folder
    log = ForceWriter(partial, columns)
    for at_s, values in forces:
        log.add(at_s - writing.taker.start_s, values)

    log.close()
    try:
        label_frames(read_recording(partial), ClassesStudy())
    except ScleraforceError as fault:
        log.set_aside()
        return str(fault).replace(str(partial), str(writing.folder))

    return (
        None
        if (partial / "forces.csv").exists()
        else f"fewer than {MIN_SAMPLE_RATE_HZ:g} samples a second"
    )


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class BlackBox:
    """Acts on the monitor's messages; `turn` is one round of its work."""

    def __init__(
        self, channel: Channel, settings: process_messages.BlackBoxSettings
    ) -> None:
        ring = FrameRing(settings.ring)
        self.ended = False
        self._channel = channel
        self._journal = Journal(settings.folder, channel)
        self._force = RobotForce(settings.force)
        self._session = SessionRecording(settings, ring, self._journal)
        self._withdrawals = Withdrawals(settings, ring, self._force, self._journal)
        self._beginning: SessionBeginning | None = None
        self._entry: process_messages.Entry | None = None  # the last one
        self._alive_s = 0.0

    def run(self) -> None:
        """Work until the monitor has ended and all is written."""
        while not (
            self.ended
            and self._next_taker() is None
            and self._withdrawals.taker is None
        ):
            self.turn()

        self._session.end()
        self._withdrawals.close()
        self._journal.close()

    def turn(self) -> None:
        """Listen to the monitor, write one frame, give a sign of life when due; wait if
        there is nothing to do.
        """
        due_s = min(self._alive_s, self._journal.sync_due_s) - time.monotonic()
        pause_s = max(0.0, min(due_s, POLL_S) if self._withdrawals.taker else due_s)
        self._hear(0.0 if self._next_taker() else pause_s)

        if (taker := self._next_taker()) is not None:
            (
                self._session if taker is self._session.taker else self._withdrawals
            ).write_frame(taker)

        self._withdrawals.turn(ended=self.ended)
        now_s = time.monotonic()
        if now_s >= self._alive_s:
            self._alive_s = now_s + ALIVE_S
            self._journal.sign_of_life()

        self._journal.sync(now_s)

    def _next_taker(self) -> FrameTaker | None:
        """Return the taker of the oldest frame, which is overwritten first."""
        takers = [
            taker
            for taker in (self._withdrawals.taker, self._session.taker)
            if taker and taker.next
        ]
        return min(takers, key=lambda taker: taker.next or 0, default=None)

    def _hear(self, pause_s: float) -> None:
        if self.ended:
            time.sleep(min(pause_s, POLL_S))
            return

        select([self._channel], [], [], pause_s)
        for _ in range(MOST_MESSAGES):
            try:
                if not (heard := self._channel.receive(1)):
                    return

                self._take(heard[0])
            except MessageError as fault:  # reported for good: it is never mended
                self._journal.fault("message", fault)
            except ChannelClosedError:
                if not self.ended:
                    self._journal.note("the monitor ended without notice")
                    if self._entry is not None:
                        self._keep("monitor_died", self._entry)

                self.ended = True
                return

    def _take(self, message: process_messages.CompanionMessage) -> None:
        match message:
            case process_messages.Decided():
                self._take_decision(message)
            case process_messages.ForceHeard():
                self._take_force(message)
            case process_messages.Note():
                self._journal.record(message)
            case process_messages.MonitorEnds():
                self.ended = True
            case _:
                raise MessageError(
                    f"a {type(message).__name__} is not for the black box"
                )

    def _take_decision(self, message: process_messages.Decided) -> None:
        entry = message.entry
        before = self._entry
        self._entry = entry

        if before and entry.number != before.number + 1:
            self._journal.note(
                f"decisions {before.number + 1} to {entry.number - 1} never arrived"
            )

        is_new = self._withdrawals.remember(message, self._journal.record(message))
        self._begin(entry.at_s, entry.time_s)
        if is_new and self._session.taker:
            self._session.taker.add(message)
        if entry.state == "WITHDRAW" and (before is None or before.state != "WITHDRAW"):
            self._keep(str(entry.cause).lower(), entry)

    def _take_force(self, heard: process_messages.ForceHeard) -> None:
        self._begin(heard.at_s, heard.time_s)
        force = self._force
        refused = self._force.refused
        sample = force.add(heard.at_s, heard.values, heard.device)

        if force.refused > refused == 0:
            values = list(heard.values)
            self._journal.note(
                f"a force of {heard.device} is not kept: {values}; so are others"
                " like it"
            )

        if sample:
            self._session.add_force(force.columns, sample)

    def _begin(self, at_s: float, time_s: float) -> SessionBeginning:
        """Return the beginning of the session; the first message, at `time_s` since
        1970, begins its recording.
        """
        if self._beginning is None:
            began = datetime.fromtimestamp(time_s, UTC).isoformat(
                timespec="milliseconds"
            )
            comment = (
                f"Of a session of scleraforce {__version__}, research use only; time 0"
                f" is {began}."
            )
            self._beginning = SessionBeginning(at_s, comment)
            self._session.begin(self._beginning)

        return self._beginning

    def _keep(self, cause: str, entry: process_messages.Entry) -> None:
        self._journal.sync_due_s = 0.0
        self._withdrawals.keep(cause, entry, self._begin(entry.at_s, entry.time_s))


def run_black_box(
    channel: Channel, settings: process_messages.BlackBoxSettings
) -> None:
    """Run the black box until the monitor has ended."""
    os.nice(NICENESS)
    os.umask(0o077)  # recordings are of a patient: readable by the owner only
    # it ends with the monitor, and not before
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    BlackBox(channel, settings).run()


if __name__ == "__main__":
    run_companion(process_messages.BlackBoxSettings, run_black_box)
