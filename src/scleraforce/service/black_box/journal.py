"""The journal of the black box: its log on the disk, its signs of life, and faults reported to the monitor."""

import shutil
import time
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from scleraforce.service.black_box.decision_log import DecisionLog, format_line
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.messages import Alive, CompanionMessage, Decided, Note, SelfReport, WithdrawalKept
from scleraforce.units import from_si

LEAST_FREE_BYTES = 10**9
CHECK_S = 1.0


class Journal:
    """Writes the log and tells the monitor of each thing that cannot be kept: once, until it is kept again.

    Args:
        log: of the decisions.
        channel: to the monitor.
    """

    def __init__(self, log: DecisionLog, channel: Channel) -> None:
        self._log, self._channel = log, channel
        self._faults: dict[str, str] = {}

    def record(self, message: Decided | Note) -> bytes:
        """Append a message to the log; return its line, also if it could not be written."""
        record = _as_json(message)
        try:
            line = self._log.append(record)
        except OSError as fault:
            self.fault("log", fault)
            return format_line(record)
        self.mended("log")
        return line

    def note(self, text: str) -> None:
        """Append a note of the black box itself."""
        self.record(Note(time_s=time.time(), text=text))

    def fault(self, what: str, fault: BaseException) -> None:
        """Tell the monitor what is not kept, and why; note it, unless the log itself is at fault."""
        if what in self._faults:
            return
        self._faults[what] = detail = f"{what}: {fault}"
        if not what.startswith("log"):
            self.note(detail)
        self._tell(SelfReport(detail=detail))

    def mended(self, what: str) -> None:
        """Note that something can be kept again."""
        self._faults.pop(what, None)

    def has_room(self, what: str, folder: Path) -> bool:
        """Return whether the disk of a folder, which need not exist yet, has enough space for `what`."""
        place = next(path for path in (folder, *folder.parents) if path.exists())
        try:
            free_bytes = shutil.disk_usage(place).free
            if free_bytes < LEAST_FREE_BYTES:
                raise OSError(f"{place}: {from_si(free_bytes, 'gb'):.2f} GB free; below 1 GB nothing is kept")
        except OSError as fault:
            self.fault(what, fault)
            return False
        self.mended(what)
        return True

    def sign_of_life(self) -> None:
        """Tell the monitor that the black box works, and what it cannot keep now."""
        self._tell(Alive(faults=tuple(self._faults.values())))

    def kept(self, folder: Path) -> None:
        """Tell the monitor that a withdrawal is complete."""
        self._tell(WithdrawalKept(folder=str(folder)))

    def _tell(self, message: CompanionMessage) -> None:
        with suppress(ChannelClosedError):  # the black box notices it when it listens
            self._channel.send(message)


def _as_json(message: Decided | Note) -> dict[str, Any]:
    """Return a message as the log has it (docs/black_box.md)."""
    if isinstance(message, Decided):
        return {"kind": "entry", "entry": message.entry.as_json()}
    return {"kind": "note", "time_s": message.time_s, "text": message.text}


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
