"""A scanner that sends a recording to and fro, and the measurements of each answer."""

import gc
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from time import monotonic, time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import InputError
from scleraforce.live.companions.watchdog import run_in_real_time
from scleraforce.live.network.openigtlink import Message
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.live.replay.scanner_player import (
    AnswerLog,
    ScannerClient,
    UnstampedMessage,
    frame_message,
)
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import (
    Recording,
    read_recording,
    true_forces,
)
from scleraforce.records.frame import Pixels

from .monitors import cores

HIGHEST_N = 25e-3  # below this nothing withdraws
CONTACT_N = 4e-3  # clear of the monitor's bound of contact
DANGEROUS_N = 33e-3  # clear over the bound
# above the second opinion, with which it shares a core: a scanner is another machine
SCANNER_PRIORITY = 15
OK = 1
WITHDRAW = 3
# other work may keep the scanner from its frames for a while; each time the monitor
# withdraws
WARM_UP_S = 120.0


def be_the_peer() -> bool:
    """Let this process measure: beside the monitor's core, before normal processes;
    return whether it may be so.
    """
    os.sched_setaffinity(0, cores()[1])
    gc.collect()
    gc.freeze()
    return run_in_real_time(SCANNER_PRIORITY)


class Frames:
    """A virtual recording in memory: `messages` are its frames, encoded; `to_and_fro`
    is an endless way through them.

    On the way back the pictures are moved by a column: no scanner shows the last ones
    again. Headers are of version 1: the time is the frame's id, so that a frame may be
    sent again.
    """

    def __init__(self, path: Path, most: int | None = None) -> None:
        self.recording = preloaded(read_recording(path), most)
        entries = self.recording.frames
        true_n = true_forces(path)
        self.force_n = np.array([true_n[entry.file] for entry in entries])
        over = np.flatnonzero(self.force_n >= HIGHEST_N)
        self.harmless = int(over[0]) if len(over) else len(entries)

        if self.harmless < 20:
            raise InputError(
                f"{path}: {self.harmless} frames before {HIGHEST_N * 1e3:g} mN; 20 are"
                " needed"
            )

        oct_info = self.recording.info.scan
        self.messages = [
            frame_message(self.recording.frame(entry), oct_info, number, 1)
            for number, entry in enumerate(entries, start=1)
        ]
        moved = self.recording.moved(1)
        self.messages += [
            frame_message(moved.frame(entry), oct_info, number, 1)
            for number, entry in enumerate(entries[: self.harmless], start=1)
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


def preloaded(recording: Recording, most: int | None = None) -> Preloaded:
    """Read the frames of a recording, or the first ones."""
    entries = tuple(islice(recording.frames, most))
    with ThreadPoolExecutor() as pool:
        pixels = dict(
            zip(
                (entry.file for entry in entries),
                pool.map(recording.frame, entries),
                strict=True,
            )
        )

    return Preloaded(recording.path, recording.info, entries, recording.forces, pixels)


class Answers(AnswerLog):
    """The answers; `withdrawn_s` is when the first STATUS of the present withdrawal
    came.
    """

    withdrawn_s = 0.0

    @property
    def code(self) -> int | None:
        """Of the last STATUS."""
        return self.status.code if self.status else None

    def hear(self, at_s: float, device: str, message: Message) -> None:
        """Take a message of the monitor."""
        before = self.code
        super().hear(at_s, device, message)
        if self.code == WITHDRAW and before != WITHDRAW:
            self.withdrawn_s = at_s


Heard = Callable[[float, Message], object]


class Way(Protocol):
    """Frames, encoded, and an endless way through them."""

    messages: list[UnstampedMessage]

    def to_and_fro(self) -> Iterator[int]:
        """Yield indices."""


class Sent(Protocol):
    """A message that a scanner sends: a frame, or something like it."""

    def stamped(self, time_s: float) -> bytearray:
        """Return its bytes with a time, s since 1970."""

    @property
    def frame_id(self) -> int:
        """The frame's id at the monitor."""


class Pace:
    """Sends harmless frames at their times, and keeps the answers.

    Args:
        port: of the monitor.
        frames: what is sent.
        rate_hz: how often.
        observed: hear through a robot's connection, beside the scanner's.
        also: called with the time and the message for each that comes.

    Attributes:
        log: what came back.
        latest_s: how late the latest frame went out.
        sent: frames.
        data: the last one, as it was sent.
    """

    def __init__(
        self,
        port: int,
        frames: Way,
        rate_hz: float,
        *,
        observed: bool = False,
        also: Heard = lambda *_: None,
    ) -> None:
        self.log = Answers()
        self.latest_s = 0.0
        self.sent = 0
        self.client = ScannerClient("127.0.0.1", port, self._hear, observed=observed)
        self._also = also
        self._frames = frames
        self._interval_s = 1.0 / rate_hz
        self._wall_s = time() - monotonic()
        self._way = frames.to_and_fro()
        self._due_s = monotonic()
        self.data = bytearray()

    def _hear(self, at_s: float, device: str, message: Message) -> None:
        self.log.hear(at_s, device, message)
        self._also(at_s, message)

    def warm_up(self, frames: int, operator: "Operator | None" = None) -> None:
        """Send frames until a number of them were answered with OK; an operator resets
        a monitor that has withdrawn.

        Raises:
            InputError: the monitor has withdrawn and there is no operator, or it does
                not say OK within two minutes.
        """
        end_s = monotonic() + WARM_UP_S
        while (
            frames and monotonic() < end_s and (operator or self.log.code != WITHDRAW)
        ):
            self.send()
            self.rest()
            frames -= self.log.code == OK

            if (
                operator
                and self.log.code == WITHDRAW
                and operator.settled() is not True
            ):
                operator.reset()

        if frames:
            said = self.log.status.message if self.log.status else "nothing"
            raise InputError(f"the monitor does not say OK to harmless frames: {said}")

        self.log.answers.clear()
        self.latest_s = 0.0
        self.sent = 0

    def send(self, message: Sent | None = None) -> float:
        """Wait until the next frame is due and send it, or another message in its
        place; return when its end went.
        """
        self.client.listen(self._due_s)
        now_s = monotonic()
        self.latest_s = max(self.latest_s, now_s - self._due_s)
        place = next(self._way)
        message = message or self._frames.messages[place]
        # times only rise, whatever the wall clock does
        self.data = message.stamped(self._wall_s + self._due_s)
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


class Operator:
    """Asks for resets on a connection of its own; `took_s` has the time of each
    answer.
    """

    def __init__(self, port: int, token: str) -> None:
        self._port = port
        self._token = token
        self._pool = ThreadPoolExecutor(1)
        self._asked: Future[bool] | None = None
        self.granted = self.refused = 0
        self.took_s: list[float] = []

    def reset(self) -> None:
        """Ask, if no answer is due."""
        if self._asked is None:
            self._asked = self._pool.submit(self._ask)

    def _ask(self) -> bool:
        begun_s = monotonic()
        granted = False
        with suppress(InputError):  # nobody answered in time
            granted, _ = ask_reset("127.0.0.1", self._port, self._token)
        self.took_s.append(monotonic() - begun_s)
        return granted

    @property
    def busy(self) -> bool:
        """True while an answer is due."""
        return self._asked is not None

    def settled(self) -> bool | None:
        """Return whether the reset was granted; None where no answer has come."""
        if self._asked is None or not self._asked.done():
            return None

        granted = self._asked.result()
        self._asked = None
        self.granted = self.granted + granted
        self.refused = self.refused + (not granted)

        return granted

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()
