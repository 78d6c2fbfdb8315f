"""One client's connection, and the messages of the monitor to it."""

import fcntl
import socket
import sys
import termios
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import nan
from struct import pack

from scleraforce.errors import ProtocolError
from scleraforce.monitor import Decision
from scleraforce.monitor.events import Verdict
from scleraforce.openigtlink import Decoder, Message, PeerEvent, Sensor, Status, Text, encode
from scleraforce.service.entry import Entry
from scleraforce.service.scanner_image import FrameAssembler

NOT_READ = Verdict(predicted=0, probabilities=None, usable=False, reason=None, force_n=None, interval_n=None)
MESSAGE_CHARACTERS = 1000  # of a STATUS: a reason may quote what a peer sent
WAITING_BYTES = 8192  # not yet taken by the peer: a tenth of a second; a message behind them is old when it is read
SEND_BUFFER_BYTES = 8192  # of the system, which doubles it: what it holds, nobody can take back
NOTES_PER_S, NOTES_AT_ONCE = 1.0, 10
FORCES_PER_S, FORCES_AT_ONCE = 1200.0, 120  # a robot sends 1000 a second at most
TURN_BYTES, TURN_EVENTS = 8 * 1024 * 1024, 16  # received before others have their turn: all that a socket holds


class RateLimiter:
    """Allows `per_s` actions a second in the long run, and a burst of `at_once` after a pause.

    >>> allowance = RateLimiter(per_s=2.0, at_once=3)
    >>> [allowance.take(now_s) for now_s in (10.0, 10.0, 10.0, 10.0, 10.5, 10.6)]
    [True, True, True, False, True, False]
    """

    def __init__(self, per_s: float, at_once: int) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._then_s = float(at_once), -float("inf")

    def take(self, now_s: float) -> bool:
        """Return whether the action is allowed now; if it is, it counts as done."""
        self._left = min(self._at_once, self._left + self._per_s * max(0.0, now_s - self._then_s))
        self._then_s = max(now_s, self._then_s)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def status_message(decision: Decision) -> Status:
    """Return the STATUS of a decision; the error name is that of the cause, or of the state where there is no cause."""
    name = decision.cause.name if decision.cause else "" if decision.code == 1 else decision.state.name
    return Status(decision.code, decision.sub_code, name[:20], decision.message[:MESSAGE_CHARACTERS])


def reading_messages(entry: Entry) -> tuple[Text, Sensor]:
    """Return the STRING and the SENSOR of a decision on a frame.

    The SENSOR holds: frame, class, probabilities of the classes 0, 1 and 2, force, lower and upper end of its interval
    (N), usable (1 or 0), code of the STATUS. Missing values are NaN.
    """
    verdict = entry.verdict or NOT_READ
    shares = (verdict.probabilities or (nan, nan, nan))[:3]
    numbers = (
        nan if entry.frame is None else float(entry.frame),
        float(verdict.predicted) if entry.verdict else nan,
        *shares, *(nan,) * (3 - len(shares)),
        nan if verdict.force_n is None else verdict.force_n,
        *(verdict.interval_n or (nan, nan)),
        float(verdict.usable),
        float(entry.code),
    )  # fmt: skip
    return Text(entry.text), Sensor(numbers)


class Outgoing:
    """Messages for several clients, encoded once for each header version that is needed."""

    def __init__(self, device: str, messages: tuple[Message, ...], wall_clock: Callable[[], float]) -> None:
        self._device, self._messages, self._time_s = device, messages, wall_clock()
        self._encoded: dict[int, bytes] = {}

    def to(self, version: int) -> bytes:
        """Return the bytes for a client of a header version."""
        if version not in self._encoded:
            parts = [encode(item, self._device, version=version, time_s=self._time_s) for item in self._messages]
            self._encoded[version] = b"".join(parts)
        return self._encoded[version]


class Connection:
    """A client.

    Attributes:
        number: of the connection since the start; never used twice.
        address: of the peer, as text.
        version: header version that the peer used last; 1 before its first message.
        frames: assembles its images.
        heard_s: when it was last read from; 0 before.
        wrong_tokens: how many resets it requested with a wrong token.
        message_since_s: since when a message from it has been incomplete; None between messages.
        notes: limits how often its errors are noted.
        forces: limits how often a force from it is kept.
    """

    def __init__(self, link: socket.socket, address: str, number: int) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.number, self.address, self.version = number, address, 1
        self.frames = FrameAssembler()
        self.heard_s, self.wrong_tokens = 0.0, 0
        self.message_since_s: float | None = None
        self.notes, self.forces = RateLimiter(NOTES_PER_S, NOTES_AT_ONCE), RateLimiter(FORCES_PER_S, FORCES_AT_ONCE)
        self._link, self._decoder, self._rest = link, Decoder(), memoryview(b"")
        self._given_bytes = 0
        self._untaken: deque[tuple[int, float]] = deque()  # (bytes given in all, when) of each message

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._link.fileno()

    def receive(self, max_body_bytes: int, now_s: float) -> tuple[list[PeerEvent], bool]:
        """Read what has arrived, up to the share of one turn.

        Args:
            max_body_bytes: largest body of a message that begins now.
            now_s: monotonic clock.

        Returns:
            The events that are complete, and whether the peer is still there.
        """
        events: list[PeerEvent] = []
        self.heard_s = now_s
        self._decoder.max_body_bytes = max_body_bytes
        left, alive = TURN_BYTES, True
        try:
            while left > 0 and len(events) < TURN_EVENTS and alive and not self._decoder.broken:
                space = self._decoder.space()
                count = self._link.recv_into(space)
                events += self._decoder.received(count) if count else ()
                alive, left = count > 0, left - count
                if count < len(space) and not self._decoder.between:
                    break
        except BlockingIOError:
            pass
        except (OSError, ProtocolError):
            alive = False
        if self._decoder.between:
            self.message_since_s = None
        elif self.message_since_s is None or events:
            self.message_since_s = now_s
        return events, alive and not self._decoder.broken

    def send(self, data: bytes, now_s: float) -> None:
        """Send a message, or drop it where the peer has not taken too many bytes yet.

        So a message that the peer reads is no older than these bytes and what waits in the peer's own buffer.

        Raises:
            OSError: the peer has gone.
        """
        if self._rest:
            self._flush()
        waiting_bytes = self._waiting_bytes()
        self._forget_taken(waiting_bytes)
        if self._rest or waiting_bytes > WAITING_BYTES:
            return
        self._rest = memoryview(data)
        self._given_bytes += len(data)
        self._untaken.append((self._given_bytes, now_s))
        self._flush()

    @property
    def unread_since_s(self) -> float | None:
        """When the oldest message was sent that has not arrived in the peer's own buffer; None if all have."""
        if self._untaken:
            self._forget_taken(self._waiting_bytes())
        return self._untaken[0][1] if self._untaken else None

    def _forget_taken(self, waiting_bytes: int) -> None:
        taken_bytes = self._given_bytes - len(self._rest) - waiting_bytes
        while self._untaken and self._untaken[0][0] <= taken_bytes:
            self._untaken.popleft()

    def _waiting_bytes(self) -> int:
        """Return how much was sent that has not arrived in the peer's own buffer (Linux: SIOCOUTQ)."""
        return int.from_bytes(fcntl.ioctl(self._link, termios.TIOCOUTQ, bytes(4)), sys.byteorder)

    def _flush(self) -> None:
        """Continue a message that was sent in part: a peer must never get half of one."""
        try:
            while self._rest:
                self._rest = self._rest[self._link.send(self._rest) :]
        except BlockingIOError:
            pass

    def close(self, *, discard: bool = False) -> None:
        """End the connection, also where another process holds a duplicate of its socket.

        Args:
            discard: throw away what was sent and has not arrived, which is old by now.
        """
        with suppress(OSError):  # the peer was quicker
            if discard:
                self._link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, pack("ii", 1, 0))
            self._link.shutdown(socket.SHUT_RDWR)
        self._link.close()
