"""The black box: a process that logs every decision and keeps the frames of withdrawals or of the session (Linux).

One thread writes one frame at a time, always the oldest one that is wanted, and listens to the monitor in between.
Other threads only wait for the disk. docs/black_box.md describes what is written, and what happens when it cannot be.
"""

import os
import signal
import time
from datetime import UTC, datetime
from select import select

from scleraforce import __version__
from scleraforce.errors import MessageError
from scleraforce.service import messages
from scleraforce.service.channel import Channel, ChannelClosedError, run_companion
from scleraforce.service.decision_log import Journal
from scleraforce.service.frame_ring import FrameRing
from scleraforce.service.recordings import FrameTaker, RobotForce, SessionBeginning, SessionRecording, Withdrawals

NICENESS = 5
ALIVE_S = 0.5
POLL_S = 0.02
MOST_MESSAGES = 100  # until a frame is written


class BlackBox:
    """Acts on the monitor's messages; `turn` is one round of its work."""

    def __init__(self, channel: Channel, settings: messages.BlackBoxSettings) -> None:
        ring = FrameRing(settings.ring)
        self.ended = False
        self._channel, self._journal = channel, Journal(settings.folder, channel)
        self._force = RobotForce(settings.force)
        self._session = SessionRecording(settings, ring, self._journal)
        self._withdrawals = Withdrawals(settings, ring, self._force, self._journal)
        self._beginning: SessionBeginning | None = None
        self._entry: messages.Entry | None = None  # the last one
        self._alive_s = 0.0

    def run(self) -> None:
        """Work until the monitor has ended and all is written."""
        while not (self.ended and self._next_taker() is None and self._withdrawals.taker is None):
            self.turn()
        self._session.end()
        self._withdrawals.close()
        self._journal.close()

    def turn(self) -> None:
        """Listen to the monitor, write one frame, give a sign of life when due; wait if there is nothing to do."""
        due_s = min(self._alive_s, self._journal.sync_due_s) - time.monotonic()
        pause_s = max(0.0, min(due_s, POLL_S) if self._withdrawals.taker else due_s)
        self._hear(0.0 if self._next_taker() else pause_s)
        if (taker := self._next_taker()) is not None:
            (self._session if taker is self._session.taker else self._withdrawals).write_frame(taker)
        self._withdrawals.turn(ended=self.ended)
        now_s = time.monotonic()
        if now_s >= self._alive_s:
            self._alive_s = now_s + ALIVE_S
            self._journal.sign_of_life()
        self._journal.sync(now_s)

    def _next_taker(self) -> FrameTaker | None:
        """Return the taker of the oldest frame, which is overwritten first."""
        takers = [taker for taker in (self._withdrawals.taker, self._session.taker) if taker and taker.next]
        return min(takers, key=lambda taker: taker.next or 0, default=None)

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
            heard = self._channel.receive(1)
            for message in heard:
                self._take(message)
        except MessageError as fault:  # reported for good: it is never mended
            self._journal.fault("message", fault)
            return True
        except ChannelClosedError:
            if not self.ended:
                self._journal.note("the monitor ended without notice")
                if self._entry is not None:
                    self._keep("monitor_died", self._entry)
            self.ended = True
            return False
        return bool(heard)

    def _take(self, message: messages.CompanionMessage) -> None:
        match message:
            case messages.Decided():
                self._take_decision(message)
            case messages.ForceHeard():
                self._take_force(message)
            case messages.Note():
                self._journal.record(message)
            case messages.MonitorEnds():
                self.ended = True
            case _:
                raise MessageError(f"a {type(message).__name__} is not for the black box")

    def _take_decision(self, message: messages.Decided) -> None:
        entry = message.entry
        before, self._entry = self._entry, entry
        if before and entry.number != before.number + 1:
            self._journal.note(f"decisions {before.number + 1} to {entry.number - 1} never arrived")
        is_new = self._withdrawals.remember(entry, self._journal.record(message))
        beginning = self._begin(entry.at_s, entry.time_s)
        if entry.frame and is_new and self._session.taker:
            self._session.taker.add(entry.frame, entry.at_s - beginning.at_s)
        if entry.state == "WITHDRAW" and (before is None or before.state != "WITHDRAW"):
            self._keep(str(entry.cause).lower(), entry)

    def _take_force(self, heard: messages.ForceHeard) -> None:
        beginning, force = self._begin(heard.at_s, heard.time_s), self._force
        refused = force.refused
        sample = force.add(heard.at_s, heard.values, heard.device)
        if force.refused > refused == 0:
            values = list(heard.values)
            self._journal.note(f"a force of {heard.device} is not kept: {values}; so are others like it")
        if sample:
            self._session.add_force(force.columns, sample, beginning.at_s)

    def _begin(self, at_s: float, time_s: float) -> SessionBeginning:
        """Return the beginning of the session; the first message, at `time_s` since 1970, begins its recording."""
        if self._beginning is None:
            began = datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")
            comment = f"Of a session of scleraforce {__version__}, research use only; time 0 is {began}."
            self._beginning = SessionBeginning(at_s, comment)
            self._session.begin(self._beginning)
        return self._beginning

    def _keep(self, cause: str, entry: messages.Entry) -> None:
        self._journal.sync_due_s = 0.0
        self._withdrawals.keep(cause, entry, self._begin(entry.at_s, entry.time_s))


def serve(channel: Channel, settings: messages.BlackBoxSettings) -> None:
    """Run the black box until the monitor has ended."""
    os.nice(NICENESS)
    os.umask(0o077)  # recordings are of a patient: readable by the owner only
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with the monitor, and not before
    BlackBox(channel, settings).run()


if __name__ == "__main__":
    run_companion(messages.BlackBoxSettings, serve)
