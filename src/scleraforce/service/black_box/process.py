"""The black box: a process that logs every decision and keeps the frames of withdrawals or of the session (Linux).

One thread writes one frame at a time, always the oldest one that is wanted, and listens to the monitor in between.
Other threads only wait for the disk. docs/black_box.md describes what is written, and what happens when it cannot be.
"""

import os
import signal
import sys
import time
from collections.abc import Sequence
from select import select

from scleraforce.errors import MessageError
from scleraforce.service.black_box.decision_log import DecisionLog
from scleraforce.service.black_box.heard import Heard, SessionBeginning
from scleraforce.service.black_box.journal import Journal, LogSync
from scleraforce.service.black_box.recordings import TakenFrame, WholeSession, Withdrawals
from scleraforce.service.companions.channel import Channel, ChannelClosedError, settings_of_child
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import (
    BlackBoxSettings,
    CompanionMessage,
    Decided,
    ForceHeard,
    MonitorEnds,
    Note,
    SelfReport,
)
from scleraforce.service.entry import Entry

NICENESS = 5
ALIVE_S = 0.5
POLL_S = 0.02
MOST_MESSAGES = 100  # until a frame is written


class BlackBox:
    """Acts on the monitor's messages; `turn` is one round of its work.

    Args:
        channel: to the monitor.
        settings: of the black box.

    Raises:
        OSError: the log cannot be written.
    """

    def __init__(self, channel: Channel, settings: BlackBoxSettings) -> None:
        log, ring = DecisionLog(settings.folder / "log"), FrameRing.at(settings.ring)
        self.ended = False
        self._channel, self._journal = channel, Journal(log, channel)
        self._sync = LogSync(log, self._journal, settings.folder)
        self._heard = Heard(settings.keep_s, ring.frames, settings.force)
        self._session = WholeSession(settings, ring, self._journal)
        self._withdrawals = Withdrawals(settings, ring, self._heard, self._journal)
        self._alive_s = 0.0

    def run(self) -> None:
        """Work until the monitor has ended and all is written."""
        while not (self.ended and self._next_writer() is None and not self._withdrawals.busy):
            self.turn()
        self._session.end()
        self._withdrawals.close()
        self._sync.close()

    def turn(self) -> None:
        """Listen to the monitor, write one frame, give a sign of life when due; wait if there is nothing to do."""
        self._hear(0.0 if self._next_writer() else self._pause_s())
        if (writer := self._next_writer()) is not None:
            writer.write_frame()
        self._withdrawals.turn(ended=self.ended)
        now_s = time.monotonic()
        if now_s >= self._alive_s:
            self._alive_s = now_s + ALIVE_S
            self._journal.sign_of_life()
        self._sync.turn(now_s)

    def _next_writer(self) -> Withdrawals | WholeSession | None:
        """Return who wants the oldest frame, which is overwritten first."""
        numbers = {who: who.taker.next for who in (self._withdrawals, self._session) if who.taker}
        waiting = {who: number for who, number in numbers.items() if number is not None}
        return min(waiting, key=lambda who: waiting[who], default=None)

    def _pause_s(self) -> float:
        due_s = min(self._alive_s, self._sync.due_s) - time.monotonic()
        return max(0.0, min(due_s, POLL_S) if self._withdrawals.busy else due_s)

    def _hear(self, pause_s: float) -> None:
        if self.ended:
            time.sleep(min(pause_s, POLL_S))
            return
        select([self._channel], [], [], pause_s)
        for _ in range(MOST_MESSAGES):
            if not self._hear_one():
                break

    def _hear_one(self) -> bool:
        """Act on the next message; return whether there was one."""
        try:
            messages = self._channel.receive(1)
            for message in messages:
                self._take(message)
        except MessageError as fault:  # told for good: it is never mended
            self._journal.fault("message", fault)
            return True
        except ChannelClosedError:
            if not self.ended:
                self._journal.note("the monitor ended without notice")
                if self._heard.entry is not None:
                    self._keep("monitor_died", self._heard.entry)
            self.ended = True
            return False
        return bool(messages)

    def _take(self, message: CompanionMessage) -> None:
        match message:
            case Decided(entry=entry):
                self._take_entry(message, entry)
            case ForceHeard():
                self._take_force(message)
            case Note():
                self._journal.record(message)
            case MonitorEnds():
                self.ended = True
            case _:
                raise MessageError(f"a {type(message).__name__} is not for the black box")

    def _take_entry(self, message: Decided, entry: Entry) -> None:
        before, self._heard.entry = self._heard.entry, entry
        if before and entry.number != before.number + 1:
            self._journal.note(f"decisions {before.number + 1} to {entry.number - 1} never arrived")
        self._heard.recent.add_line(entry.at_s, self._journal.record(message))
        beginning = self._begin(entry.at_s, entry.time_s)
        if entry.frame is not None and self._heard.recent.add_frame(entry.at_s, entry.frame):
            self._session.add_frame(TakenFrame(entry.frame, entry.at_s - beginning.at_s))
        if entry.state == "WITHDRAW" and (before is None or before.state != "WITHDRAW"):
            self._keep(str(entry.cause).lower(), entry)

    def _take_force(self, heard: ForceHeard) -> None:
        beginning, force = self._begin(heard.at_s, heard.time_s), self._heard.force
        refused = force.refused
        sample = force.add(heard.at_s, heard.values, heard.device)
        if force.refused > refused == 0:
            values = list(heard.values)
            self._journal.note(f"a force of {heard.device} is not kept: {values}; so are others like it")
        if sample:
            self._session.add_force(force.columns, sample, beginning)

    def _begin(self, at_s: float, time_s: float) -> SessionBeginning:
        """Return the beginning of the session; the first message begins its recording."""
        first = self._heard.beginning is None
        beginning = self._heard.begin(at_s, time_s)
        if first:
            self._session.begin(beginning)
        return beginning

    def _keep(self, cause: str, entry: Entry) -> None:
        self._sync.hurry()
        self._withdrawals.keep(cause, entry)


def main(arguments: Sequence[str]) -> None:
    """Run the black box of the monitor that started this process, until the monitor ends."""
    os.nice(NICENESS)
    os.umask(0o077)  # recordings are of a patient: readable by the owner only
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with the monitor, and not before
    channel, settings = settings_of_child(arguments, BlackBoxSettings)
    try:
        BlackBox(channel, settings).run()
    except Exception as fault:
        channel.send(SelfReport(detail=f"{type(fault).__name__}: {fault}"))
        raise


if __name__ == "__main__":
    main(sys.argv)
