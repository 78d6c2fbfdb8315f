"""A scanner that sends a recording to and fro, its operator, and the answers."""

import gc
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, time

import numpy as np
from numpy.typing import NDArray

from monitor.real_monitor import OTHER_CORES, Monitor
from scleraforce.base.errors import InputError
from scleraforce.live.companions.watchdog import run_in_real_time
from scleraforce.live.network.openigtlink import Message
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.live.replay.scanner_player import (
    AnswerLog,
    ScannerClient,
    StatusChange,
    frame_message,
)
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import (
    Recording,
    read_recording,
    true_forces,
)
from scleraforce.records.frame import Pixels

HIGHEST_N = 25e-3  # below this nothing withdraws
DANGEROUS_N = 33e-3  # clear over the bound
# above the second opinion, with which it shares a core: a scanner is another machine
SCANNER_PRIORITY = 15
OK = 1
WITHDRAW = 3
# other work may keep the scanner from its frames for a while; each time the monitor
# withdraws
WARM_UP_S = 120.0
RESET_AFTER = 20  # frames of a withdrawal


def be_the_peer() -> bool:
    """Let this process measure: beside the monitor's core, before normal processes;
    return whether it may be so.
    """
    os.sched_setaffinity(0, OTHER_CORES)
    gc.collect()
    gc.freeze()
    return run_in_real_time(SCANNER_PRIORITY)


@dataclass(frozen=True)
class Preloaded(Recording):
    """A recording whose frames are in memory; they are shown `columns` further to the
    right.
    """

    pixels: dict[str, Pixels]
    columns: int = 0

    def frame(self, entry: FrameEntry) -> Pixels:
        """Return a frame."""
        return np.roll(self.pixels[entry.file], self.columns, axis=1)

    def moved(self, columns: int) -> "Preloaded":
        """Return the recording with other pictures of the same walls: each moved by
        some columns.
        """
        return replace(self, columns=columns)


class Frames:
    """A virtual recording in memory: `messages` are its frames, encoded; `to_and_fro`
    is an endless way through them.

    On the way back the pictures are moved by a column: no scanner shows the last ones
    again. Headers are of version 1: the time is the frame's id, so that a frame may be
    sent again.
    """

    def __init__(self, path: Path) -> None:
        read = read_recording(path)
        with ThreadPoolExecutor() as pool:
            pictures = pool.map(read.frame, read.frames)
        files = [entry.file for entry in read.frames]
        pixels = dict(zip(files, pictures, strict=True))
        self.recording = Preloaded(
            read.path, read.info, read.frames, read.forces, pixels
        )
        true_n = true_forces(path)
        self.force_n = np.array([true_n[file] for file in files])
        over = np.flatnonzero(self.force_n >= HIGHEST_N)
        self.harmless = int(over[0]) if len(over) else len(files)
        if self.harmless < 20:
            raise InputError(
                f"{path}: {self.harmless} frames before {HIGHEST_N * 1e3:g} mN; 20 are"
                " needed"
            )

        moved = self.recording.moved(1)
        shown = [(self.recording, entry) for entry in read.frames]
        shown += [(moved, entry) for entry in read.frames[: self.harmless]]
        self.messages = [
            frame_message(recording.frame(entry), read.info.scan, number, 1)
            for number, (recording, entry) in enumerate(shown, start=1)
        ]

    def to_and_fro(self) -> Iterator[int]:
        """Yield indices of harmless frames: the force never jumps."""
        while True:
            yield from range(self.harmless)
            moved = len(self.force_n)
            yield from range(moved + self.harmless - 2, moved, -1)

    def dangerous(self) -> NDArray[np.intp]:
        """Return indices of the frames that are over the bound by more than a reading's
        error.
        """
        return np.flatnonzero(self.force_n >= DANGEROUS_N)


@dataclass(frozen=True)
class Sent:
    """A frame in the place of the next one; a bit of it may be flipped on the way."""

    index: int
    flipped_bit: int | None = None


class Operator:
    """Asks for resets on a connection of its own; `took_s` has the time of each
    answer.
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._pool = ThreadPoolExecutor(1)
        self._asked: Future[None] | None = None
        self.took_s: list[float] = []

    @property
    def busy(self) -> bool:
        """True while an answer is due."""
        return self._asked is not None and not self._asked.done()

    def reset(self) -> None:
        """Ask, if no answer is due."""
        if not self.busy:
            self._asked = self._pool.submit(self._ask)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()

    def _ask(self) -> None:
        begun_s = monotonic()
        with suppress(InputError):  # nobody answered in time
            ask_reset("127.0.0.1", self._monitor.port, self._monitor.token)
        self.took_s.append(monotonic() - begun_s)


class Scanner:
    """Sends harmless frames at their times, keeps the answers, and has each withdrawal
    reset after `RESET_AFTER` frames.

    Args:
        monitor: the monitor.
        frames: what is sent.
        rate_hz: how often.
        observed: hear through a robot's connection, beside the scanner's.
        hear: called with the time and the message for each that comes.

    Attributes:
        log: what came back.
        withdrawals: the first STATUS of each.
        released: withdrawals that ended although no reset was asked for.
        longest_held: frames of the longest withdrawal.
        sent: frames.
        latest_s: how late the latest frame went out.
        data: the last one, as it was sent.
    """

    def __init__(
        self,
        monitor: Monitor,
        frames: Frames,
        rate_hz: float,
        *,
        observed: bool = False,
        hear: Callable[[float, Message], object] = lambda *_: None,
    ) -> None:
        self.log = AnswerLog()
        self.operator = Operator(monitor)
        self.withdrawals: list[StatusChange] = []
        self.released = 0
        self.longest_held = 0
        self.sent = 0
        self.latest_s = 0.0
        self.data = bytearray()
        self._also = hear
        self._monitor = monitor
        self._frames = frames
        self._way = frames.to_and_fro()
        self._interval_s = 1.0 / rate_hz
        self._wall_s = time() - monotonic()
        self._due_s = self._ok_s = monotonic()
        self._held = 0
        self._reset_asked = False
        self.client = ScannerClient(
            "127.0.0.1", monitor.port, self._hear, observed=observed
        )

    @property
    def code(self) -> int | None:
        """The code of the last STATUS."""
        return self.log.status.code if self.log.status else None

    def close(self) -> None:
        """Leave."""
        self.client.close()
        self.operator.close()

    def warm_up(self, frames: int) -> None:
        """Send frames until a number of them were answered with OK.

        Raises:
            InputError: that takes more than two minutes.
        """
        end_s = monotonic() + WARM_UP_S
        while frames:
            if monotonic() > end_s:
                said = self.log.status.message if self.log.status else "nothing"
                raise InputError(f"harmless frames are not answered with OK: {said}")

            self.frame()
            frames -= self.code == OK

        self.log.answers.clear()
        self.withdrawals.clear()
        self.latest_s = 0.0
        self.sent = 0

    def frame(self) -> None:
        """Send a frame, hear the monitor until the next one is due, and attend to a
        withdrawal.
        """
        self.send()
        self.rest()
        self.attend()

    def send(self, sent: Sent | None = None) -> float:
        """Wait until the next frame is due and send it, or another one in its place;
        return when its end went.
        """
        self.client.listen(self._due_s)
        self.latest_s = max(self.latest_s, monotonic() - self._due_s)
        index = next(self._way)
        message = self._frames.messages[sent.index if sent else index]
        # times only rise, whatever the wall clock does
        self.data = message.stamped(self._wall_s + self._due_s)
        if sent and sent.flipped_bit is not None:
            self.data = bytearray(self.data)
            self.data[sent.flipped_bit // 8] ^= 1 << sent.flipped_bit % 8

        sent_s = self.client.send(self.data)
        self.log.sent(message.frame_id, message.frame_id, sent_s)
        self.sent += 1

        return sent_s

    def rest(
        self, share: float = 1.0, done: Callable[[], bool] = lambda: False
    ) -> None:
        """Hear the monitor, until a share of the interval has passed, or until
        `done`.
        """
        self.client.listen(self._due_s + share * self._interval_s, done)
        if share == 1.0:
            self._due_s += self._interval_s
            if self._due_s < monotonic() - self._interval_s:
                # this process was held up: a scanner would lose frames
                self._due_s = monotonic()

    def attend(self) -> None:
        """Note a withdrawal, and ask for a reset once it has lasted for a while."""
        self._monitor.prune()
        if self.code != WITHDRAW:
            self.released += self._held > 0 and not self._reset_asked
            self._held = 0
            self._reset_asked = False
            self._ok_s = monotonic()
            return

        begun = self.log.first_doubt(self._ok_s, (WITHDRAW,))
        if self._held == 0 and begun is not None:
            self.withdrawals.append(begun)

        self._held += 1
        self.longest_held = max(self.longest_held, self._held)
        if self._held > RESET_AFTER:
            self.operator.reset()
            self._reset_asked = True

    def _hear(self, at_s: float, device: str, message: Message) -> None:
        self.log.hear(at_s, device, message)
        self._also(at_s, message)
