"""The withdrawals that the black box keeps: one is written at a time, and at most one more waits."""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime

from scleraforce.service.black_box.heard import Heard
from scleraforce.service.black_box.journal import Journal
from scleraforce.service.black_box.kept_frames import FrameTaker, TakenFrame
from scleraforce.service.black_box.kept_withdrawal import KeptWithdrawal
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import BlackBoxSettings
from scleraforce.service.entry import Entry

WITHDRAWAL = "withdrawal"  # what is not kept, where the disk fails


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
