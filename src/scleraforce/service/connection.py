"""One client's connection: it decodes what comes in, and sends without ever waiting."""

import fcntl
import socket
import sys
import termios
from collections import deque
from contextlib import suppress
from struct import pack

from scleraforce.errors import ProtocolError
from scleraforce.openigtlink import Decoder, PeerEvent
from scleraforce.service.allowance import Allowance
from scleraforce.service.scanner_image import FrameAssembler

WAITING_BYTES = 8192  # not yet taken by the peer: a tenth of a second; a message behind them is old when it is read
SEND_BUFFER_BYTES = 8192  # of the system, which doubles it: what it holds, nobody can take back
NOTES_PER_S, NOTES_AT_ONCE = 1.0, 10
FORCES_PER_S, FORCES_AT_ONCE = 1200.0, 120  # a robot sends 1000 a second at most
TURN_BYTES, TURN_EVENTS = 8 * 1024 * 1024, 16  # received before others have their turn: all that a socket holds


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
        self.notes, self.forces = Allowance(NOTES_PER_S, NOTES_AT_ONCE), Allowance(FORCES_PER_S, FORCES_AT_ONCE)
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
