"""Brings the log to the disk once a second, in a thread, since a disk may take long; and looks at the free space."""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from scleraforce.service.black_box.decision_log import DecisionLog
from scleraforce.service.black_box.journal import Journal

CHECK_S = 1.0


class LogSync:
    """The syncs of a log, one at a time.

    Args:
        log: of the decisions.
        journal: told when the disk fails.
        folder: of the black box.

    Attributes:
        due_s: time of the next sync, on the monotonic clock.
    """

    def __init__(self, log: DecisionLog, journal: Journal, folder: Path) -> None:
        self.due_s = 0.0
        self._log, self._journal, self._folder = log, journal, folder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="log")
        self._running: Future[None] | None = None

    def hurry(self) -> None:
        """Make the next sync due now."""
        self.due_s = 0.0

    def turn(self, now_s: float) -> None:
        """If it is time, look at the disk and at the last sync, and begin the next one."""
        if now_s < self.due_s:
            return
        self.due_s = now_s + CHECK_S
        if self._journal.has_room("disk", self._folder):
            self._journal.mended("withdrawal")  # the next one can be kept
        if self._running is not None:
            if not self._running.done():
                return
            if (fault := self._running.exception()) is not None:
                self._journal.fault("log on disk", fault)
            else:
                self._journal.mended("log on disk")
        self._running = self._thread.submit(self._log.sync)

    def close(self) -> None:
        """Wait for the last sync, and close the log."""
        self._thread.shutdown()
        self._log.close()
