"""The processes beside the monitor, from its side: the black box, the console, the second opinion."""

from collections import deque
from collections.abc import Iterator, Mapping
from types import MappingProxyType, UnionType

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import MessageError
from scleraforce.segmentation.found import Segmentation
from scleraforce.service.companions.channel import ChannelClosedError, Child, encode_message
from scleraforce.service.companions.messages import (
    Alive,
    CompanionMessage,
    Decided,
    ListensAt,
    MonitorEnds,
    OpinionAsked,
    OpinionGiven,
    Outline,
    ResetAsked,
    SelfReport,
    WithdrawalKept,
    WrongTokens,
)
from scleraforce.service.entry import Entry

BLACK_BOX, CONSOLE, OPINION = "black box", "console", "second opinion"
NEEDED = (BLACK_BOX, OPINION)  # a failure of these is a cause of a withdrawal; the console only shows
SAYS: Mapping[str, type | UnionType] = MappingProxyType(
    {BLACK_BOX: WithdrawalKept, CONSOLE: ResetAsked | ListensAt | WrongTokens, OPINION: OpinionGiven}
)  # each speaks for itself, too: `Alive`, `SelfReport`
OUTLINE_S = 0.04
OUTLINE_STEP = 4  # columns
KEEPS_UP_S = 2.0  # a companion that takes no message for longer has failed
MOST_WAITING = 1000  # decisions that the black box has not taken yet: some seconds
STARTS_S = 30.0  # within which the black box must give its first sign of life
SILENT_S = 5.0  # it gives one every 0.5 s; a disk may delay it


class Companions:
    """Sends messages to the companions and receives theirs; never waits for one.

    Args:
        children: the companions that run, by name.
    """

    def __init__(self, children: dict[str, Child]) -> None:
        self._children = dict(children)
        self._faults: dict[str, str] = {}
        self._dead: set[str] = set()
        self._garbled: dict[str, str] = {}
        self._heard_of: set[str] = set()
        self._alive_until_s: float | None = None
        self._full_since_s: dict[str, float] = {}
        self._waiting = deque[bytes]()
        self._outlined_s = 0.0

    def __contains__(self, name: str) -> bool:
        return name in self._children

    @property
    def channels(self) -> dict[int, str]:
        """File descriptors of the channels, with the names of the companions."""
        return {child.channel.fileno(): name for name, child in self._children.items()}

    def starts(self, name: str) -> bool:
        """Return whether a companion runs that has neither given a sign of life nor failed, as far as `hear` knows."""
        failed = name in self._faults or name in self._garbled or self.dead(name)
        return name in self and not failed and name not in self._heard_of

    def faults(self, now_s: float) -> tuple[str, ...]:
        """Return what is wrong with the companions that are needed; call it every few ms, after `hear`."""
        if self._alive_until_s is None:
            self._alive_until_s = now_s + STARTS_S
        self._send_waiting(now_s)
        found = {name: self._fault(name, now_s) for name in NEEDED if name in self._children}
        return tuple(f"{name}: {fault}" for name, fault in found.items() if fault)

    def _fault(self, name: str, now_s: float) -> str | None:
        if name in self._garbled:
            return self._garbled[name]
        if name in self._faults or name in self._dead:
            return self._faults.get(name, "it has died")
        full = name == BLACK_BOX and len(self._waiting) >= MOST_WAITING
        if full or now_s - self._full_since_s.get(name, now_s) > KEEPS_UP_S:
            return "it does not keep up"
        silent = name == BLACK_BOX and now_s > (self._alive_until_s or now_s)
        return "it does not answer" if silent else None

    def entry(self, entry: Entry) -> None:
        """Send a decision; it waits for a black box that does not keep up, and goes before all other messages."""
        data = encode_message(Decided(entry=entry))
        if BLACK_BOX in self._children:
            if len(self._waiting) < MOST_WAITING:  # else it counts as failed already, and the log shows the gap
                self._waiting.append(data)
            self._send_waiting(entry.at_s)
        self._send(CONSOLE, data, entry.at_s)

    def outline(self, frame: int, wall: Segmentation, now_s: float) -> None:
        """Send the wall that was found in a frame to the console, every `OUTLINE_S` at most."""
        if CONSOLE in self._children and now_s - self._outlined_s >= OUTLINE_S:
            self._outlined_s = now_s
            rows = _rows(wall.outer_row), _rows(wall.inner_row)
            self.tell(CONSOLE, Outline(frame=frame, step=OUTLINE_STEP, outer=rows[0], inner=rows[1]), now_s)

    def ask_opinion(self, number: int, order: int, now_s: float) -> None:
        """Ask for a second opinion on a frame in the ring."""
        self.tell(OPINION, OpinionAsked(number=number, order=order), now_s)

    def tell(self, name: str, message: CompanionMessage, now_s: float) -> None:
        """Send a message to a companion, if it runs; to the black box only while no decision waits."""
        if name == BLACK_BOX:
            self._send_waiting(now_s)
        if name != BLACK_BOX or not self._waiting:
            self._send(name, encode_message(message), now_s)

    def _send_waiting(self, now_s: float) -> None:
        """Send the decisions that wait for the black box, oldest first."""
        while self._waiting and self._send(BLACK_BOX, self._waiting[0], now_s):
            self._waiting.popleft()

    def _send(self, name: str, data: bytes, now_s: float) -> bool:
        """Send a message to a companion; return whether it was taken."""
        child = self._children.get(name)
        if child is None or self.dead(name):
            return False
        try:
            if child.channel.send_encoded(data):
                self._full_since_s.pop(name, None)
                return True
            self._full_since_s.setdefault(name, now_s)
        except ChannelClosedError:
            self._dead.add(name)
        return False

    def hear(self, name: str, now_s: float) -> Iterator[CompanionMessage]:
        """Yield a companion's messages, except those about its own state, which are taken note of.

        One that sends what is no message, or not its to send, has failed for good.
        """
        try:
            for message in self._children[name].channel.receive():
                match message:
                    case SelfReport(detail=detail):
                        self._faults[name] = detail
                    case Alive(faults=faults):
                        self._take_alive(name, faults, now_s)
                    case _ if isinstance(message, SAYS[name]):
                        yield message
                    case _:
                        raise MessageError(f"a {type(message).__name__} is not its to say")
        except MessageError as fault:
            self._garbled.setdefault(name, f"it does not keep to the protocol: {fault}")
        except ChannelClosedError:
            self._dead.add(name)

    def _take_alive(self, name: str, faults: tuple[str, ...], now_s: float) -> None:
        """Take a companion's sign of life with its present faults, which replace earlier ones."""
        self._heard_of.add(name)
        if name == BLACK_BOX:
            self._alive_until_s = now_s + SILENT_S
        if faults:
            self._faults[name] = "; ".join(faults)
        else:
            self._faults.pop(name, None)

    def dead(self, name: str) -> bool:
        """Return whether a companion has ended, which its closed channel tells."""
        return name in self._dead

    def last_words(self, name: str) -> str:
        """Return what is known of a companion's fault, after a colon; "" if nothing is."""
        detail = self._garbled.get(name) or self._faults.get(name)
        return f": {detail}" if detail else ""

    def end(self) -> None:
        """End all companions, as planned."""
        if BLACK_BOX in self._children:
            self.tell(BLACK_BOX, MonitorEnds(), 0.0)
        for child in self._children.values():
            child.end(within_s=30.0)


def _rows(row: NDArray[np.float64]) -> tuple[float | None, ...]:
    return tuple([None if value != value else round(value, 1) for value in row[::OUTLINE_STEP].tolist()])
