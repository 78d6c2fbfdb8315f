"""Bytes in, events out: the receiving half of OpenIGTLink, with no socket in it.

A message with a wrong checksum or content is an event, and the stream continues, because the message's size is known.
After an invalid header or a body that is too large the stream cannot be followed: the last event is `Broken`, the state
is ERROR, and further bytes are refused.

A body is received in its final place: `space` lends the buffer for the next bytes, `received` says how many came.
"""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from fastcrc.crc64 import ecma_182

from scleraforce.arrays import Bytes
from scleraforce.errors import ProtocolError
from scleraforce.openigtlink.messages import HEADER_BYTES, SPOKEN, Header, Message, query_of, split_body, unpack_header

MAX_BODY_BYTES = 16 * 1024 * 1024  # a 16-bit volume of 2048 x 2048 x 2
HEADERS_BYTES = 4096  # lent at once for headers, so that one `received` stays below a millisecond
PASSED_BYTES = 64 * 1024  # lent at once for a body that is skipped


@dataclass(frozen=True, eq=False)
class Received:
    """A complete message of a supported type, with the right checksum."""

    header: Header
    message: Message
    message_id: int = 0
    metadata: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Unknown:
    """A message of another type; its body is skipped, neither kept nor checked."""

    header: Header


@dataclass(frozen=True)
class BadChecksum:
    """The CRC of the body differs from that in the header."""

    header: Header
    reason: str


@dataclass(frozen=True)
class Malformed:
    """The checksum is right, but the body does not fit the type."""

    header: Header
    reason: str


@dataclass(frozen=True)
class Broken:
    """The stream cannot be followed any more."""

    reason: str


PeerEvent = Received | Unknown | BadChecksum | Malformed | Broken


class DecoderState(Enum):
    """The part of the stream that the next byte belongs to."""

    HEADER = "header"
    BODY = "body"
    PASSING = "passing"
    ERROR = "error"


class Decoder:
    """An incremental decoder of one peer's bytes; it holds at most one message.

    A header that states more than `max_body_bytes` breaks the stream; the limit may be changed for later headers.
    """

    def __init__(self, max_body_bytes: int = MAX_BODY_BYTES) -> None:
        self.max_body_bytes = max_body_bytes
        self.state = DecoderState.HEADER
        self._head = bytearray()
        self._scratch = memoryview(bytearray(PASSED_BYTES))
        self._start_body(np.empty(0, dtype=np.uint8), 0)

    def _start_body(self, body: Bytes, left: int) -> None:
        self._body, self._room, self._left, self._crc = body, memoryview(body.data), left, 0

    @property
    def broken(self) -> bool:
        """True if the stream cannot be followed any more."""
        return self.state is DecoderState.ERROR

    @property
    def between(self) -> bool:
        """True if no message is incomplete."""
        return self.state is DecoderState.HEADER and not self._head

    def space(self) -> memoryview:
        """Lend the buffer for the next bytes, never empty; it is valid until the next call of another method.

        Like `received` and `feed`, it raises ProtocolError if the stream broke earlier.
        """
        self._refuse_if_broken()
        if self.state is DecoderState.BODY:
            return self._room[-self._left :]
        return self._scratch[: HEADERS_BYTES if self.state is DecoderState.HEADER else min(self._left, PASSED_BYTES)]

    def received(self, count: int) -> tuple[PeerEvent, ...]:
        """Take the first `count` bytes of the lent buffer; return the events that are complete, in order."""
        room = self.space()
        if not 0 <= count <= len(room):
            raise ValueError(f"{count} bytes received: {len(room)} were lent")
        if self.state is not DecoderState.BODY:
            return self._take(room[:count])
        event = self._advance(count)
        return () if event is None else (event,)

    def feed(self, data: bytes | bytearray | memoryview) -> tuple[PeerEvent, ...]:
        """Take the next bytes of the stream, in pieces of any size; return the events that are complete, in order."""
        self._refuse_if_broken()
        return self._take(memoryview(data))

    def _refuse_if_broken(self) -> None:
        if self.broken:
            raise ProtocolError("the stream is broken: close the connection and start a new decoder")

    def _take(self, rest: memoryview) -> tuple[PeerEvent, ...]:
        events = []
        while rest and not self.broken:
            used, event = self._step(rest)
            rest = rest[used:]
            if event is not None:
                events.append(event)
        return tuple(events)

    def _step(self, rest: memoryview) -> tuple[int, PeerEvent | None]:
        """Use some of the bytes; return how many, and the event that they complete."""
        if self.state is DecoderState.HEADER:
            used = min(HEADER_BYTES - len(self._head), len(rest))
            self._head += rest[:used]
            return used, self._begin() if len(self._head) == HEADER_BYTES else None
        used = min(self._left, len(rest))
        if self.state is DecoderState.BODY:
            self._room[-self._left :][:used] = rest[:used]
        return used, self._advance(used)

    def _begin(self) -> PeerEvent | None:
        """Read a complete header; memory for its body is taken only once its size is known to be allowed."""
        try:
            self._header = unpack_header(self._head)
            if self._header.body_bytes > self.max_body_bytes:
                raise ProtocolError(f"body of {self._header.body_bytes} bytes: at most {self.max_body_bytes}")
        except ProtocolError as error:
            self.state = DecoderState.ERROR
            return Broken(str(error))
        finally:
            self._head.clear()
        kept = self._header.type in SPOKEN
        self.state = DecoderState.BODY if kept else DecoderState.PASSING
        size = self._header.body_bytes
        self._start_body(np.empty(size if kept else 0, dtype=np.uint8), size)
        return None if size else self._end()

    def _advance(self, count: int) -> PeerEvent | None:
        """Count bytes of the body that are in place; the checksum is updated on the way."""
        if self.state is DecoderState.BODY and count:
            self._crc = ecma_182(self._room[-self._left :][:count], self._crc)
        self._left -= count
        return None if self._left else self._end()

    def _end(self) -> PeerEvent:
        """Return the event of a complete body; the decoder keeps no reference to the body."""
        header, body, crc, kept = self._header, self._body, self._crc, self.state is DecoderState.BODY
        self.state = DecoderState.HEADER
        self._start_body(np.empty(0, dtype=np.uint8), 0)
        if not kept:
            asked = query_of(header.type)
            return Unknown(header) if asked is None else Received(header, asked)
        if crc != header.crc:
            return BadChecksum(header, f"{header.type}: checksum {crc:016x}, not {header.crc:016x}")
        try:
            content, message_id, metadata = split_body(memoryview(body.data), header.version)
            return Received(header, SPOKEN[header.type](content), message_id, metadata)
        except ProtocolError as error:
            return Malformed(header, str(error))
