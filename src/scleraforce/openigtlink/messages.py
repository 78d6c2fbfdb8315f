"""The supported messages, as frozen records, and their bodies."""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from fastcrc.crc64 import ecma_182

from scleraforce.errors import ProtocolError
from scleraforce.openigtlink.image import Image, pack_image, unpack_image
from scleraforce.openigtlink.wire import ASCII, UTF_8, Header, pack_header, pack_name, wrap_body

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
    """STATUS; of the codes 1 is OK, 3 emergency, 7 timeout, 9 checksum, 13 not ready; `name` is that of the error."""

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
    """SENSOR: up to 255 numbers; `unit` is the 64 bits of the protocol's unit field. Numbers may be NaN: check them."""

    values: tuple[float, ...]
    unit: int = 0
    status: int = 0


@dataclass(frozen=True)
class Transform:
    """TRANSFORM: three columns of the rotation, then the translation (mm)."""

    matrix: tuple[float, ...]


@dataclass(frozen=True)
class Query:
    """GET_...: a peer asks for a message of this type: "STATUS", "IMAGE", "TRANSFORM" (GET_TRANS on the wire)."""

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
    """Return a whole message as it goes over the wire.

    Args:
        message: its content.
        device: the device's name, ASCII, at most 20 characters.
        version: of the header, 1 to 3: that of the peer.
        time_s: seconds since 1970.
        message_id: of versions 2 and 3 only.
        metadata: of versions 2 and 3 only.

    Raises:
        ProtocolError: something does not fit into the message.

    >>> len(encode(Status(1, message="watching"), "ForceMonitor"))
    97
    """
    name, content = _pack(message)
    body = wrap_body(content, version, message_id, metadata)
    return pack_header(Header(version, name, device, time_s, len(body), ecma_182(body))) + body


def _pack(message: Message) -> tuple[str, bytes]:
    """Return the name of the type and the content."""
    try:
        match message:
            case Image():
                return "IMAGE", pack_image(message)
            case Status(code, subcode, name, text):
                if len(text.encode()) > MAX_TEXT_BYTES:
                    raise ProtocolError(f"STATUS: a message of {len(text.encode())} bytes, at most {MAX_TEXT_BYTES}")
                return "STATUS", STATUS.pack(code, subcode, pack_name(name, 20)) + text.encode() + b"\0"
            case Text(text):
                return "STRING", STRING.pack(ASCII if text.isascii() else UTF_8, len(text.encode())) + text.encode()
            case Sensor(values, unit, status):
                return "SENSOR", SENSOR.pack(len(values), status, unit) + struct.pack(f">{len(values)}d", *values)
            case Transform(matrix):
                return "TRANSFORM", TRANSFORM.pack(*matrix)
            case Query(name):
                return GET + SHORTENED.get(name, name), b""
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise ProtocolError(f"{type(message).__name__}: {error}") from error


def query_of(name: str) -> Query | None:
    """Return the query of a message of type GET_...; None if the type is no query.

    >>> query_of("GET_TRANS")
    Query(type='TRANSFORM')
    """
    asked = name.removeprefix(GET)
    return Query(WHOLE.get(asked, asked)) if asked and asked != name else None


def unpack(name: str, content: memoryview) -> Message:
    """Read the content of a message of a supported type.

    Raises:
        ProtocolError: the content does not fit the type.
    """
    return SPOKEN[name](content)


def _status(content: memoryview) -> Status:
    _need("STATUS", STATUS.size <= len(content) <= STATUS.size + MAX_TEXT_BYTES + 1, len(content))
    code, subcode, name = STATUS.unpack_from(content)
    return Status(code, subcode, _until_nul(name), _until_nul(bytes(content[STATUS.size :])))


def _text(content: memoryview) -> Text:
    _need("STRING", len(content) >= STRING.size, len(content))
    _, length = STRING.unpack_from(content)
    _need("STRING", len(content) >= STRING.size + length, len(content))
    return Text(bytes(content[STRING.size : STRING.size + length]).decode("utf-8", "replace"))


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
    {"IMAGE": unpack_image, "STATUS": _status, "STRING": _text, "SENSOR": _sensor, "TRANSFORM": _transform}
)


def _need(what: str, holds: bool, found: int) -> None:
    if not holds:
        raise ProtocolError(f"{what}: {found} bytes do not hold what they state")


def _until_nul(field: bytes) -> str:
    return field.split(b"\0")[0].decode("utf-8", "replace")
