"""The processes beside the monitor, from its side: the watchdog, the black box, the
console, the second opinion.
"""

import os
import socket
import subprocess
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from types import UnionType

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import MessageError
from scleraforce.live.companions import process_messages, watchdog
from scleraforce.live.companions.process_channel import (
    Channel,
    ChannelClosedError,
    Child,
    encode_message,
    start_companion,
)
from scleraforce.live.companions.process_messages import DECISION_DEVICE, STATUS_DEVICE
from scleraforce.live.decision.events import Cause, State
from scleraforce.live.network.openigtlink import Status, encode
from scleraforce.wall.wall import Segmentation

BEAT_LOOKS = 0.5  # 10 ms
# half a second: a watchdog that answers later than this counts as failed
SILENT_LOOKS = 25
START_S = 20.0
EMERGENCY = Status(
    3, Cause.WATCHDOG.value, Cause.WATCHDOG.name, "WITHDRAW: the monitor hung or died"
)
BLACK_BOX = "black box"
CONSOLE = "console"
OPINION = "second opinion"
# a failure of these is a cause of a withdrawal; the console only shows
NEEDED = (
    BLACK_BOX,
    OPINION,
)
# and each sends `Alive`, `SelfReport`
SENDS: dict[str, type | UnionType] = {
    BLACK_BOX: process_messages.WithdrawalKept,
    CONSOLE: process_messages.ResetAsked
    | process_messages.ListensAt
    | process_messages.WrongTokens,
    OPINION: process_messages.OpinionGiven | process_messages.EyeLearned,
}
OUTLINE_S = 0.04
OUTLINE_STEP = 4  # columns
KEEPS_UP_S = 2.0  # a companion that takes no message for longer has failed
MOST_WAITING = 1000  # decisions that the black box has not taken yet: some seconds
STARTS_S = 30.0  # within which the black box must give its first sign of life
SILENT_S = 5.0  # it gives one every 0.5 s; a disk may delay it


def emergency(version: int) -> bytes:
    """Return what the watchdog sends: the STATUS, and the same as a STRING."""
    text = process_messages.decision_text(
        code=EMERGENCY.code,
        sub_code=EMERGENCY.subcode,
        state=State.WITHDRAW.name,
        cause=EMERGENCY.name,
        message=EMERGENCY.message,
    )
    status = encode(EMERGENCY, STATUS_DEVICE, version=version)
    return status + encode(text, DECISION_DEVICE, version=version)


class Guard:
    """The watchdog process, which looks every `look_s`, from the monitor's side."""

    def __init__(self, look_s: float = watchdog.LOOK_S) -> None:
        self._beat_s = BEAT_LOOKS * look_s
        self._silent_s = SILENT_LOOKS * look_s
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        arguments = [str(theirs.fileno()), str(os.getpid()), str(look_s)]
        self._process = start_companion(
            "scleraforce.live.companions.watchdog", arguments, [theirs.fileno()]
        )
        theirs.close()
        self._fault: str | None = None
        self._beaten_s = self._answered_s = 0.0
        self._channel.settimeout(START_S)

        if self._channel.recv(16) != watchdog.ALIVE:
            raise OSError("the watchdog did not start")

        self._channel.setblocking(False)
        for version in (1, 2, 3):
            self._send(b"M%d " % version + emergency(version))

    @property
    def pid(self) -> int:
        """Id of the watchdog's process."""
        return self._process.pid

    def watch(self, client: int, descriptor: int) -> None:
        """Pass it the socket of a client, by its number."""
        self._send(b"C%d" % client, descriptor)

    def version(self, client: int, version: int) -> None:
        """Send it the header version of a client."""
        self._send(b"V%d %d" % (client, version))

    def forget(self, client: int) -> None:
        """Make it close its duplicate of a client's socket."""
        self._send(b"D%d" % client)

    def beat(self, now_s: float) -> str | None:
        """Send a sign of life, and take the watchdog's; return its fault, if any. Call
        it every few ms.
        """
        if now_s - self._beaten_s < self._beat_s:
            return self._fault

        if now_s - self._beaten_s > self._silent_s:
            # the first time, or after a pause of this process
            self._answered_s = now_s

        self._beaten_s = now_s
        self._send(b"B")
        self._hear(now_s)
        if self._fault is None and now_s - self._answered_s > self._silent_s:
            return f"the watchdog has not answered for {self._silent_s:g} s"

        return self._fault

    def end(self) -> None:
        """End the watchdog, before the monitor ends."""
        self._send(b"Q")
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

        # not earlier: closing it with unread answers would discard the message
        self._channel.close()

    def _send(self, data: bytes, descriptor: int | None = None) -> None:
        try:
            socket.send_fds(
                self._channel, [data], [] if descriptor is None else [descriptor]
            )
        except BlockingIOError:
            self._fault = self._fault or "the watchdog does not keep up"
        except OSError:
            self._fault = "the watchdog has died"

    def _hear(self, now_s: float) -> None:
        try:
            while self._fault is None:
                if not self._channel.recv(16):
                    self._fault = "the watchdog has died"
                self._answered_s = now_s
        except BlockingIOError:
            pass
        except OSError:
            self._fault = "the watchdog has died"


@dataclass
class _CompanionState:
    """The known state of a companion: its reported `fault`, and its breach of the
    protocol, for good (`garbled`).
    """

    fault: str | None = None
    garbled: str | None = None
    dead: bool = False
    heard: bool = False
    full_since_s: float | None = None


class Companions:
    """Sends messages to the running companions, by their names, and receives theirs;
    never waits for one.
    """

    def __init__(self, children: dict[str, Child]) -> None:
        self._children = dict(children)
        self._states = {name: _CompanionState() for name in children}
        self._alive_until_s: float | None = None
        self._waiting = deque[bytes]()
        self._outlined_s = 0.0

    def __iter__(self) -> Iterator[str]:
        return iter(self._children)

    def channel(self, name: str) -> Channel:
        """Return the channel of a companion."""
        return self._children[name].channel

    def starts(self, name: str) -> bool:
        """Return whether a companion runs that has neither given a sign of life nor
        failed, as far as `hear` knows.
        """
        state = self._states.get(name)
        return state is not None and not (
            state.heard or state.fault or state.garbled or state.dead
        )

    def faults(self, now_s: float) -> tuple[str, ...]:
        """Return the faults of the companions that are needed; call it every few ms,
        after `hear`.
        """
        if self._alive_until_s is None:
            self._alive_until_s = now_s + STARTS_S

        self._send_waiting(now_s)
        found = {
            name: self._fault(name, now_s) for name in NEEDED if name in self._children
        }

        return tuple(f"{name}: {fault}" for name, fault in found.items() if fault)

    def _fault(self, name: str, now_s: float) -> str | None:
        state = self._states[name]
        if state.garbled or state.fault or state.dead:
            return state.garbled or state.fault or "it has died"

        full = name == BLACK_BOX and len(self._waiting) >= MOST_WAITING
        if full or (
            state.full_since_s is not None and now_s - state.full_since_s > KEEPS_UP_S
        ):
            return "it does not keep up"

        silent = name == BLACK_BOX and now_s > (self._alive_until_s or now_s)
        return "it does not answer" if silent else None

    def decided(self, decided: process_messages.Decided) -> None:
        """Send a decision; it waits for a black box that does not keep up, before all
        other messages.
        """
        data = encode_message(decided)
        entry = decided.entry

        if BLACK_BOX in self._children:
            if len(self._waiting) < MOST_WAITING:
                # else it counts as failed already, and the log shows the gap
                self._waiting.append(data)
            self._send_waiting(entry.at_s)

        self._send(CONSOLE, data, entry.at_s)

    def outline(
        self, frame: int, wall: Segmentation, now_s: float, plane: str | None
    ) -> None:
        """Send a frame's wall to the console, every `OUTLINE_S` at most."""
        if CONSOLE in self._children and now_s - self._outlined_s >= OUTLINE_S:
            self._outlined_s = now_s
            outer = _rows(wall.outer_row)
            inner = _rows(wall.inner_row)
            outline = process_messages.Outline(
                frame=frame, step=OUTLINE_STEP, outer=outer, inner=inner, plane=plane
            )
            self.send(CONSOLE, outline, now_s)

    def send(
        self, name: str, message: process_messages.CompanionMessage, now_s: float
    ) -> bool:
        """Send a message to a companion, to the black box only while no decision waits;
        return whether it was taken.
        """
        if name == BLACK_BOX:
            self._send_waiting(now_s)
        return (name != BLACK_BOX or not self._waiting) and self._send(
            name, encode_message(message), now_s
        )

    def _send_waiting(self, now_s: float) -> None:
        while self._waiting and self._send(BLACK_BOX, self._waiting[0], now_s):
            self._waiting.popleft()

    def _send(self, name: str, data: bytes, now_s: float) -> bool:
        state = self._states.get(name)
        if state is None or state.dead:
            return False

        try:
            taken = self.channel(name).send_encoded(data)
        except ChannelClosedError:
            state.dead = True
            return False

        state.full_since_s = (
            None
            if taken
            else now_s
            if state.full_since_s is None
            else state.full_since_s
        )
        return taken

    def hear(
        self, name: str, now_s: float
    ) -> Iterator[process_messages.CompanionMessage]:
        """Yield a companion's messages, except on its own state; one that sends
        something else has failed for good.
        """
        state = self._states[name]
        try:
            for message in self.channel(name).receive():
                match message:
                    case process_messages.SelfReport(detail=detail):
                        state.fault = detail
                    case process_messages.Alive(faults=faults):
                        state.heard = True
                        state.fault = "; ".join(faults) or None
                        if name == BLACK_BOX:
                            self._alive_until_s = now_s + SILENT_S
                    case _ if isinstance(message, SENDS[name]):
                        yield message
                    case _:
                        raise MessageError(
                            f"a {type(message).__name__} is not its to send"
                        )
        except MessageError as fault:
            state.garbled = (
                state.garbled or f"it does not keep to the protocol: {fault}"
            )
        except ChannelClosedError:
            state.dead = True

    def dead(self, name: str) -> bool:
        """Return whether a companion has ended, which closes its channel."""
        return self._states[name].dead

    def last_words(self, name: str) -> str:
        """Return a companion's fault, after a colon; "" if it is unknown."""
        detail = self._states[name].garbled or self._states[name].fault
        return f": {detail}" if detail else ""

    def end(self) -> None:
        """End all companions, as planned."""
        if BLACK_BOX in self._children:
            self.send(BLACK_BOX, process_messages.MonitorEnds(), 0.0)
        for child in self._children.values():
            child.end(within_s=30.0)


def _rows(row: Floats) -> tuple[float | None, ...]:
    return tuple(
        [
            None if value != value else round(value, 1)
            for value in row[::OUTLINE_STEP].tolist()
        ]
    )
