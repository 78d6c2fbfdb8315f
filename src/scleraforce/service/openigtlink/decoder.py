"""Bytes in, events out: the receiving half of OpenIGTLink, with no socket in it.

A message that is wrong inside (checksum, content) is an event and the stream goes on, for its size is known. A header
that cannot be one, or a body over the cap, leaves no place to go on from: the last event is `Broken`, the state is
ERROR, and further bytes are refused.
"""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import ProtocolError
from scleraforce.service.openigtlink.crc64 import crc64
from scleraforce.service.openigtlink.messages import SPOKEN, Message, Query, unpack
from scleraforce.service.openigtlink.wire import HEADER_BYTES, Header, split_body, unpack_header

__all__ = ["MAX_BODY_BYTES", "BadChecksum", "Broken", "Decoder", "Event", "Malformed", "Received", "State", "Unknown"]

MAX_BODY_BYTES = 16 * 1024 * 1024  # a 16-bit volume of 2048 x 2048 x 2
HASH_BYTES = 64 * 1024  # the checksum runs along in pieces of this size, so that little is left after the last byte


@dataclass(frozen=True, eq=False)
class Received:
    """A message that is spoken, whole and with the right checksum."""

    header: Header
    message: Message
    message_id: int = 0
    metadata: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Unknown:
    """A message of another type; its body is passed over, neither kept nor checked."""

    header: Header


@dataclass(frozen=True)
class BadChecksum:
    """The body is not what its sender took the CRC of."""

    header: Header
    found: int


@dataclass(frozen=True)
class Malformed:
    """The checksum is right, and the body is not what the type says."""

    header: Header
    reason: str


@dataclass(frozen=True)
class Broken:
    """The stream cannot be followed any more."""

    reason: str


Event = Received | Unknown | BadChecksum | Malformed | Broken


class State(Enum):
    """What the next byte belongs to."""

    HEADER = "header"
    BODY = "body"
    PASSING = "passing"
    ERROR = "error"


class Decoder:
    """An incremental decoder of one peer's bytes; it holds at most one message of at most `max_body_bytes`.

    >>> from scleraforce.service.openigtlink.messages import Status, encode
    >>> decoder = Decoder()
    >>> data = encode(Status(1, message="watching"), "ForceMonitor")
    >>> decoder.feed(data[:70])
    ()
    >>> decoder.feed(data[70:])[0].message
    Status(code=1, subcode=0, name='', message='watching')
    """

    def __init__(self, max_body_bytes: int = MAX_BODY_BYTES) -> None:
        self.max_body_bytes = max_body_bytes
        self.state = State.HEADER
        self._head = bytearray()
        self._start_body(np.empty(0, dtype=np.uint8), 0)

    def _start_body(self, body: NDArray[np.uint8], left: int) -> None:
        self._body, self._left, self._filled, self._hashed, self._crc = body, left, 0, 0, 0

    @property
    def broken(self) -> bool:
        """Whether the stream cannot be followed any more."""
        return self.state is State.ERROR

    def feed(self, data: bytes | bytearray | memoryview) -> tuple[Event, ...]:
        """Take the next bytes of the stream, in pieces of any size.

        Returns:
            What became complete, in order; `Broken` is the last if it occurs.

        Raises:
            ProtocolError: the stream broke earlier.
        """
        if self.broken:
            raise ProtocolError("the stream is broken: close the connection and start a new decoder")
        rest, events = memoryview(data), []
        while rest and not self.broken:
            used, event = self._step(rest)
            rest = rest[used:]
            if event is not None:
                events.append(event)
        return tuple(events)

    def _step(self, rest: memoryview) -> tuple[int, Event | None]:
        """Use some of the bytes; what they completed."""
        if self.state is State.HEADER:
            used = min(HEADER_BYTES - len(self._head), len(rest))
            self._head += rest[:used]
            return used, self._begin() if len(self._head) == HEADER_BYTES else None
        used = min(self._left, len(rest))
        if self.state is State.BODY:
            self._keep(rest[:used])
        self._left -= used
        return used, self._end() if not self._left else None

    def _begin(self) -> Event | None:
        """A header is whole; room is taken for its body only now that its size is known to be allowed."""
        try:
            self._header = unpack_header(self._head)
            if self._header.body_bytes > self.max_body_bytes:
                raise ProtocolError(f"body of {self._header.body_bytes} bytes: at most {self.max_body_bytes}")
        except ProtocolError as error:
            self.state = State.ERROR
            self._head.clear()
            return Broken(str(error))
        self._head.clear()
        kept = self._header.type in SPOKEN
        self.state = State.BODY if kept else State.PASSING
        size = self._header.body_bytes
        self._start_body(np.empty(size if kept else 0, dtype=np.uint8), size)
        return None if size else self._end()

    def _keep(self, piece: memoryview) -> None:
        self._body[self._filled : self._filled + len(piece)] = np.frombuffer(piece, dtype=np.uint8)
        self._filled += len(piece)
        if self._filled - self._hashed >= HASH_BYTES:
            self._hash()

    def _hash(self) -> None:
        self._crc = crc64(self._body[self._hashed : self._filled], self._crc)
        self._hashed = self._filled

    def _end(self) -> Event:
        """A body is whole; it is let go of, so that only its event holds it."""
        self._hash()
        header, body, crc, kept = self._header, self._body, self._crc, self.state is State.BODY
        self.state = State.HEADER
        self._start_body(np.empty(0, dtype=np.uint8), 0)
        if not kept:
            asked = header.type.removeprefix("GET_")
            return Received(header, Query(asked)) if asked != header.type and asked else Unknown(header)
        if crc != header.crc:
            return BadChecksum(header, crc)
        return _read(header, body)


def _read(header: Header, body: NDArray[np.uint8]) -> Event:
    try:
        content, message_id, metadata = split_body(memoryview(body.data), header.version)
        return Received(header, unpack(header.type, content), message_id, metadata)
    except ProtocolError as error:
        return Malformed(header, str(error))
