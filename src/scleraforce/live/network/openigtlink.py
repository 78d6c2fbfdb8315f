"""OpenIGTLink, the protocol of image-guided therapy: records to bytes and bytes to
events, with no socket in it.

Layout after the OpenIGTLink specification, `igtl_header.h`, `igtlMessageBase.cxx` and
the messages' own headers; all integers are big endian, except the pixels of an image,
whose order it states.

A message with a wrong checksum or content is an event, and the stream continues,
because the message's size is known. After an invalid header or a body that is too large
the stream cannot be followed: the last event is `Broken`, the state is ERROR, and
further bytes are refused.
"""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from fastcrc.crc64 import ecma_182
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes
from scleraforce.base.errors import ProtocolError

HEADER_BYTES = 58
VERSIONS = (1, 2, 3)
HEADER = struct.Struct(">H12s20sQQQ")
EXTENDED = struct.Struct(">HHII")
METADATA_ENTRY = struct.Struct(">HHI")
# index and texts; 2,000 entries take a millisecond to read
MAX_METADATA_BYTES = 16 * 1024
FRACTION = 1 << 32
UTF_8 = 106  # IANA's MIBenum
ASCII = 3


@dataclass(frozen=True)
class Header:
    """The header of a message: `time_s` since 1970 (to a quarter of a microsecond),
    `crc` of the body as sent.
    """

    version: int
    type: str
    device: str
    time_s: float
    body_bytes: int
    crc: int


def pack_name(name: str, width: int) -> bytes:
    """Return a name as an ASCII field, padded with NUL, or raise ProtocolError."""
    if len(name) > width or not name.isascii() or "\0" in name:
        raise ProtocolError(
            f"name {name!r}: must be ASCII of at most {width} characters"
        )
    return name.encode("ascii").ljust(width, b"\0")


def pack_header(header: Header) -> bytes:
    """Return the 58 bytes of a header, or raise ProtocolError."""
    if header.version not in VERSIONS:
        raise ProtocolError(
            f"header version {header.version}: must be one of {VERSIONS}"
        )
    if not 0.0 <= header.time_s < FRACTION:
        raise ProtocolError(f"time {header.time_s} s: must be from 0 to below 2^32 s")

    fixed = int(header.time_s * FRACTION)  # exact: a power of two
    names = pack_name(header.type, 12), pack_name(header.device, 20)
    return HEADER.pack(header.version, *names, fixed, header.body_bytes, header.crc)


def unpack_header(data: bytes | bytearray | memoryview) -> Header:
    """Read 58 bytes; without a header of versions 1 to 3 raise ProtocolError: the place
    of the next one is unknown.
    """
    version, type_field, device, fixed, body_bytes, crc = HEADER.unpack(data)
    type_name = type_field.split(b"\0")[0].decode("latin-1")
    if version not in VERSIONS:
        raise ProtocolError(f"header version {version}: must be one of {VERSIONS}")
    if (
        not type_name
        or not type_name.isascii()
        or not type_name.isprintable()
        or " " in type_name
    ):
        raise ProtocolError(f"message type {type_name!r}: must be printable ASCII")

    name = device.split(b"\0")[0].decode("ascii", "replace")
    return Header(version, type_name, name, fixed / FRACTION, body_bytes, crc)


def wrap_body(
    content: bytes, version: int, message_id: int, metadata: Mapping[str, str]
) -> bytes:
    """Put the extended header before the content and the metadata behind it (nothing in
    version 1).
    """
    if version == 1:
        if metadata or message_id:
            raise ProtocolError("metadata and message id: need header version 2 or 3")

        return content

    pairs = [(key.encode(), value.encode()) for key, value in metadata.items()]
    if not 0 <= message_id < FRACTION:
        raise ProtocolError(f"message id {message_id}: must fit into 32 bits")

    _check_metadata_size(
        2 + sum(METADATA_ENTRY.size + len(key) + len(value) for key, value in pairs)
    )
    entries = b"".join(
        METADATA_ENTRY.pack(len(key), UTF_8, len(value)) for key, value in pairs
    )
    index = struct.pack(">H", len(pairs)) + entries
    texts = b"".join(key + value for key, value in pairs)

    return (
        EXTENDED.pack(EXTENDED.size, len(index), len(texts), message_id)
        + content
        + index
        + texts
    )


def split_body(
    body: memoryview, version: int
) -> tuple[memoryview, int, dict[str, str]]:
    """Split a body into content, message id and metadata; raise ProtocolError if the
    sizes contradict each other.
    """
    if version == 1:
        return body, 0, {}
    if len(body) < EXTENDED.size:
        raise ProtocolError(
            f"body of {len(body)} bytes: too short for an extended header"
        )

    extended, index_bytes, text_bytes, message_id = EXTENDED.unpack_from(body)
    _check_metadata_size(index_bytes + text_bytes)

    end = len(body) - index_bytes - text_bytes
    if extended < EXTENDED.size or end < extended:
        raise ProtocolError(
            f"extended header: {extended} + {index_bytes} + {text_bytes} bytes in"
            f" {len(body)}"
        )

    metadata = _metadata(body[end : end + index_bytes], body[end + index_bytes :])
    return body[extended:end], message_id, metadata


def _check_metadata_size(size: int) -> None:
    if size > MAX_METADATA_BYTES:
        raise ProtocolError(f"metadata: {size} bytes, at most {MAX_METADATA_BYTES}")


def _metadata(index: memoryview, texts: memoryview) -> dict[str, str]:
    """Return keys and values; the texts follow each other in the order of the index."""
    if len(index) < 2:
        if len(index) or len(texts):
            raise ProtocolError(
                f"metadata: index of {len(index)} bytes for texts of {len(texts)}"
            )

        return {}

    (count,) = struct.unpack_from(">H", index)
    if len(index) != 2 + count * METADATA_ENTRY.size:
        raise ProtocolError(
            f"metadata: {count} entries in an index of {len(index)} bytes"
        )

    metadata = {}
    place = 0

    for key_bytes, _, value_bytes in METADATA_ENTRY.iter_unpack(index[2:]):
        middle = place + key_bytes
        end = place + key_bytes + value_bytes
        if end > len(texts):
            raise ProtocolError(
                f"metadata: an entry ends at byte {end} of {len(texts)}"
            )

        key, value = (
            bytes(texts[at:to]).decode("utf-8", "replace")
            for at, to in ((place, middle), (middle, end))
        )
        metadata[key] = value
        place = end

    return metadata


HEAD = struct.Struct(">HBBBB3H12f3H3H")
SCALARS: dict[int, np.dtype[Any]] = dict(
    enumerate(map(np.dtype, ("int8", "uint8", "int16", "uint16")), start=2)
)
CODES = {dtype: code for code, dtype in SCALARS.items()}
ORDERS: dict[int, Literal["<", ">"]] = {1: ">", 2: "<"}
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Image:
    """One image, or a part of one.

    `pixels` are (slice, row, column) or (slice, row, column, component), int8, uint8,
    int16 or uint16 in this machine's byte order, and read-only if received. `matrix`
    has the steps to the next column, row and slice, then the centre's position, mm.
    `size` is columns, rows and slices of the whole image, None if `pixels` is all of
    it, and `offset` the column, row and slice where `pixels` begins. `coordinates` is 1
    for RAS, 2 for LPS.
    """

    pixels: NDArray[Any]
    matrix: tuple[float, ...] = IDENTITY
    size: tuple[int, int, int] | None = None
    offset: tuple[int, int, int] = (0, 0, 0)
    coordinates: int = 1


def pack_image(image: Image, *, little_endian: bool = True) -> bytes:
    """Return the body of an image; raise ProtocolError if the message cannot state its
    pixels, shape or place.
    """
    pixels = image.pixels
    if pixels.ndim not in (3, 4) or pixels.dtype not in CODES or not pixels.size:
        kind = f"{pixels.dtype} {pixels.shape}"
        raise ProtocolError(
            f"pixels {kind}: must be 8 or 16 bit, (slice, row, column[, component])"
        )

    part = pixels.shape[2::-1]
    components = pixels.shape[3] if pixels.ndim == 4 else 1
    size = image.size or part
    elements = len(image.matrix)
    _check_place(size, image.offset, part)

    if max(size) > 0xFFFF or components > 0xFF or elements != 12:
        raise ProtocolError(
            f"image of {size}, {components} components, {elements} matrix elements: out"
            " of range"
        )

    order = 2 if little_endian else 1
    code = CODES[pixels.dtype]
    head = HEAD.pack(
        1,
        components,
        code,
        order,
        image.coordinates,
        *size,
        *image.matrix,
        *image.offset,
        *part,
    )

    return (
        head
        + np.ascontiguousarray(
            pixels, dtype=pixels.dtype.newbyteorder(ORDERS[order])
        ).tobytes()
    )


def unpack_image(body: memoryview) -> Image:
    """Read the body of an image; pixels in this machine's byte order, at an even place,
    are a view into the body.
    """
    if len(body) < HEAD.size:
        raise ProtocolError(f"IMAGE: {len(body)} bytes, must be at least {HEAD.size}")

    version, components, code, order, coordinates, *rest = HEAD.unpack_from(body)
    size = tuple(rest[:3])
    matrix = tuple(rest[3:15])
    offset = tuple(rest[15:18])
    part = tuple(rest[18:])

    if (
        version not in (1, 2)
        or code not in SCALARS
        or order not in ORDERS
        or not components
    ):
        kind = f"scalar type {code}, byte order {order}, {components} components"
        raise ProtocolError(f"IMAGE: version {version}, {kind}")
    if not all(map(math.isfinite, matrix)):
        raise ProtocolError("IMAGE: the matrix is not finite")

    _check_place(size, offset, part)
    dtype = SCALARS[code].newbyteorder(ORDERS[order])

    stated = math.prod(part) * components * dtype.itemsize
    if len(body) - HEAD.size != stated:
        raise ProtocolError(
            f"IMAGE: {len(body) - HEAD.size} bytes of pixels, must be {stated}"
        )

    shape = part[::-1] if components == 1 else (*part[::-1], components)
    received = np.frombuffer(body, dtype=dtype, offset=HEAD.size)
    pixels = np.require(received, SCALARS[code], "A").reshape(shape)
    pixels.flags.writeable = False

    return Image(pixels, matrix, size, offset, coordinates)


def _check_place(
    size: tuple[int, ...], offset: tuple[int, ...], part: tuple[int, ...]
) -> None:
    inside = all(
        o >= 0 and p > 0 and o + p <= s
        for s, o, p in zip(size, offset, part, strict=True)
    )
    if not inside:
        raise ProtocolError(
            f"IMAGE: a part of {part} at {offset} does not lie in {size}"
        )


STATUS = struct.Struct(">Hq20s")
STRING = struct.Struct(">HH")
SENSOR = struct.Struct(">BBQ")
TRANSFORM = struct.Struct(">12f")
MAX_TEXT_BYTES = 0xFFFF  # of a STATUS, as of a STRING
GET = "GET_"
SHORTENED = {"TRANSFORM": "TRANS"}  # a type has 12 characters
WHOLE = {short: name for name, short in SHORTENED.items()}
NO_METADATA: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True)
class Status:
    """STATUS; of the codes 1 is OK, 3 emergency, 7 timeout, 9 checksum, 13 not ready;
    `name` is that of the error.
    """

    code: int
    subcode: int = 0
    name: str = ""
    message: str = ""


@dataclass(frozen=True)
class Text:
    """STRING."""

    text: str


@dataclass(frozen=True)
class Sensor:
    """SENSOR: up to 255 numbers; `unit` is the 64 bits of the protocol's unit field.
    Numbers may be NaN: check them.
    """

    values: tuple[float, ...]
    unit: int = 0
    status: int = 0


@dataclass(frozen=True)
class Transform:
    """TRANSFORM: three columns of the rotation, then the translation (mm)."""

    matrix: tuple[float, ...]

    @property
    def travel_mm(self) -> float:
        """The translation along its own z axis."""
        return sum(
            axis * place
            for axis, place in zip(self.matrix[6:9], self.matrix[9:12], strict=True)
        )


@dataclass(frozen=True)
class Query:
    """GET_...: a peer asks for a message of this type: "STATUS", "IMAGE", "TRANSFORM"
    (GET_TRANS on the wire).
    """

    type: str


Message = Image | Status | Text | Sensor | Transform | Query


def encode(
    message: Message,
    device: str,
    *,
    version: int = 1,
    time_s: float = 0.0,
    message_id: int = 0,
    metadata: Mapping[str, str] = NO_METADATA,
) -> bytes:
    """Return a whole message as bytes, with a header of the peer's version, 1 to 3.

    The name of the device is ASCII, at most 20 characters. Version 1 has neither
    message id nor metadata. What does not fit into the message is a ProtocolError.
    """
    name, content = _pack(message)
    body = wrap_body(content, version, message_id, metadata)
    return (
        pack_header(Header(version, name, device, time_s, len(body), ecma_182(body)))
        + body
    )


def _pack(message: Message) -> tuple[str, bytes]:
    """Return the name of the type and the content."""
    try:
        match message:
            case Image():
                return "IMAGE", pack_image(message)
            case Status(code, subcode, name, text):
                if len(text.encode()) > MAX_TEXT_BYTES:
                    raise ProtocolError(
                        f"STATUS: a message of {len(text.encode())} bytes, at most"
                        f" {MAX_TEXT_BYTES}"
                    )

                return (
                    "STATUS",
                    STATUS.pack(code, subcode, pack_name(name, 20))
                    + text.encode()
                    + b"\0",
                )
            case Text(text):
                return (
                    "STRING",
                    STRING.pack(ASCII if text.isascii() else UTF_8, len(text.encode()))
                    + text.encode(),
                )
            case Sensor(values, unit, status):
                return "SENSOR", SENSOR.pack(len(values), status, unit) + struct.pack(
                    f">{len(values)}d", *values
                )
            case Transform(matrix):
                return "TRANSFORM", TRANSFORM.pack(*matrix)
            case Query(name):
                return GET + SHORTENED.get(name, name), b""
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise ProtocolError(f"{type(message).__name__}: {error}") from error


def query_of(name: str) -> Query | None:
    """Return the query of a message of type GET_...; None for other types."""
    asked = name.removeprefix(GET)
    return Query(WHOLE.get(asked, asked)) if asked and asked != name else None


def _status(content: memoryview) -> Status:
    _need(
        "STATUS",
        STATUS.size <= len(content) <= STATUS.size + MAX_TEXT_BYTES + 1,
        len(content),
    )
    code, subcode, name = STATUS.unpack_from(content)

    return Status(
        code, subcode, _until_nul(name), _until_nul(bytes(content[STATUS.size :]))
    )


def _text(content: memoryview) -> Text:
    _need("STRING", len(content) >= STRING.size, len(content))
    _, length = STRING.unpack_from(content)
    _need("STRING", len(content) >= STRING.size + length, len(content))
    return Text(
        bytes(content[STRING.size : STRING.size + length]).decode("utf-8", "replace")
    )


def _sensor(content: memoryview) -> Sensor:
    _need("SENSOR", len(content) >= SENSOR.size, len(content))
    count, status, unit = SENSOR.unpack_from(content)
    _need("SENSOR", len(content) == SENSOR.size + 8 * count, len(content))
    return Sensor(struct.unpack_from(f">{count}d", content, SENSOR.size), unit, status)


def _transform(content: memoryview) -> Transform:
    _need("TRANSFORM", len(content) == TRANSFORM.size, len(content))
    matrix = TRANSFORM.unpack(content)
    _need("TRANSFORM, finite,", all(map(math.isfinite, matrix)), len(content))
    return Transform(matrix)


SPOKEN: Mapping[str, Callable[[memoryview], Message]] = MappingProxyType(
    {
        "IMAGE": unpack_image,
        "STATUS": _status,
        "STRING": _text,
        "SENSOR": _sensor,
        "TRANSFORM": _transform,
    }
)


def _need(what: str, holds: bool, found: int) -> None:
    if not holds:
        raise ProtocolError(f"{what}: {found} bytes do not hold what they state")


def _until_nul(field: bytes) -> str:
    return field.split(b"\0")[0].decode("utf-8", "replace")


MAX_BODY_BYTES = 16 * 1024 * 1024  # a 16-bit volume of 2048 x 2048 x 2
# lent at once for headers, so that one `received` stays below a millisecond
HEADERS_BYTES = 4096
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

    A header that states more than `max_body_bytes` breaks the stream; the limit may be
    changed for later headers.
    """

    def __init__(self, max_body_bytes: int = MAX_BODY_BYTES) -> None:
        self.max_body_bytes = max_body_bytes
        self.state = DecoderState.HEADER
        self._head = bytearray()
        self._scratch = memoryview(bytearray(PASSED_BYTES))
        self._start_body(np.empty(0, dtype=np.uint8), 0)

    def _start_body(self, body: Bytes, left: int) -> None:
        self._body = body
        self._room = memoryview(body.data)
        self._left = left
        self._crc = 0

    @property
    def broken(self) -> bool:
        """True if the stream cannot be followed any more."""
        return self.state is DecoderState.ERROR

    @property
    def between(self) -> bool:
        """True if no message is incomplete."""
        return self.state is DecoderState.HEADER and not self._head

    def space(self) -> memoryview:
        """Lend the buffer for the next bytes, never empty; it is valid until the next
        call of another method.

        Like `received` and `feed`, it raises ProtocolError if the stream broke earlier.
        """
        self._refuse_if_broken()
        if self.state is DecoderState.BODY:
            return self._room[-self._left :]

        return self._scratch[
            : (
                HEADERS_BYTES
                if self.state is DecoderState.HEADER
                else min(self._left, PASSED_BYTES)
            )
        ]

    def received(self, count: int) -> tuple[PeerEvent, ...]:
        """Take the first `count` bytes of the lent buffer; return the events that are
        complete, in order.
        """
        room = self.space()
        if not 0 <= count <= len(room):
            raise ValueError(f"{count} bytes received: {len(room)} were lent")
        if self.state is not DecoderState.BODY:
            return self._take(room[:count])

        event = self._advance(count)
        return () if event is None else (event,)

    def feed(self, data: bytes | bytearray | memoryview) -> tuple[PeerEvent, ...]:
        """Take the next bytes of the stream, in pieces of any size; return the events
        that are complete, in order.
        """
        self._refuse_if_broken()
        return self._take(memoryview(data))

    def _refuse_if_broken(self) -> None:
        if self.broken:
            raise ProtocolError(
                "the stream is broken: close the connection and start a new decoder"
            )

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
        """Read a complete header; memory for its body is taken only once its size is
        known to be allowed.
        """
        try:
            self._header = unpack_header(self._head)
            if self._header.body_bytes > self.max_body_bytes:
                raise ProtocolError(
                    f"body of {self._header.body_bytes} bytes: at most"
                    f" {self.max_body_bytes}"
                )
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
        """Count bytes of the body that are in place; the checksum is updated on the
        way.
        """
        if self.state is DecoderState.BODY and count:
            self._crc = ecma_182(self._room[-self._left :][:count], self._crc)
        self._left -= count
        return None if self._left else self._end()

    def _end(self) -> PeerEvent:
        """Return the event of a complete body; the decoder keeps no reference to the
        body.
        """
        header = self._header
        body = self._body
        crc = self._crc
        kept = self.state is DecoderState.BODY
        self.state = DecoderState.HEADER
        self._start_body(np.empty(0, dtype=np.uint8), 0)

        if not kept:
            asked = query_of(header.type)
            return Unknown(header) if asked is None else Received(header, asked)
        if crc != header.crc:
            return BadChecksum(
                header, f"{header.type}: checksum {crc:016x}, not {header.crc:016x}"
            )

        try:
            content, message_id, metadata = split_body(
                memoryview(body.data), header.version
            )
            return Received(header, SPOKEN[header.type](content), message_id, metadata)
        except ProtocolError as error:
            return Malformed(header, str(error))
