"""The frame of every OpenIGTLink body: a header; in versions 2 and 3 also an extended header and metadata.

Layout after the OpenIGTLink specification, `igtl_header.h` and `igtlMessageBase.cxx`; all integers are big endian.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from scleraforce.errors import ProtocolError

HEADER_BYTES = 58
VERSIONS = (1, 2, 3)
HEADER = struct.Struct(">H12s20sQQQ")
EXTENDED = struct.Struct(">HHII")
METADATA_ENTRY = struct.Struct(">HHI")
MAX_METADATA_BYTES = 16 * 1024  # index and texts; 2,000 entries take a millisecond to read
FRACTION = 1 << 32
UTF_8 = 106  # IANA's MIBenum
ASCII = 3


@dataclass(frozen=True)
class Header:
    """The header of a message: `time_s` since 1970 (to a quarter of a microsecond), `crc` of the body as sent."""

    version: int
    type: str
    device: str
    time_s: float
    body_bytes: int
    crc: int


def pack_name(name: str, width: int) -> bytes:
    """Return a name as an ASCII field, padded with NUL, or raise ProtocolError."""
    if len(name) > width or not name.isascii() or "\0" in name:
        raise ProtocolError(f"name {name!r}: must be ASCII of at most {width} characters")
    return name.encode("ascii").ljust(width, b"\0")


def pack_header(header: Header) -> bytes:
    """Return the 58 bytes of a header, or raise ProtocolError."""
    if header.version not in VERSIONS:
        raise ProtocolError(f"header version {header.version}: must be one of {VERSIONS}")
    if not 0.0 <= header.time_s < FRACTION:
        raise ProtocolError(f"time {header.time_s} s: must be from 0 to below 2^32 s")
    fixed = int(header.time_s * FRACTION)  # exact: a power of two
    names = pack_name(header.type, 12), pack_name(header.device, 20)
    return HEADER.pack(header.version, *names, fixed, header.body_bytes, header.crc)


def unpack_header(data: bytes | bytearray | memoryview) -> Header:
    """Read 58 bytes; without a header of versions 1 to 3 raise ProtocolError: the place of the next one is unknown."""
    version, type_field, device, fixed, body_bytes, crc = HEADER.unpack(data)
    type_name = type_field.split(b"\0")[0].decode("latin-1")
    if version not in VERSIONS:
        raise ProtocolError(f"header version {version}: must be one of {VERSIONS}")
    if not type_name or not type_name.isascii() or not type_name.isprintable() or " " in type_name:
        raise ProtocolError(f"message type {type_name!r}: must be printable ASCII")
    name = device.split(b"\0")[0].decode("ascii", "replace")
    return Header(version, type_name, name, fixed / FRACTION, body_bytes, crc)


def wrap_body(content: bytes, version: int, message_id: int, metadata: Mapping[str, str]) -> bytes:
    """Put the extended header before the content and the metadata behind it (nothing in version 1)."""
    if version == 1:
        if metadata or message_id:
            raise ProtocolError("metadata and message id: need header version 2 or 3")
        return content
    pairs = [(key.encode(), value.encode()) for key, value in metadata.items()]
    if not 0 <= message_id < FRACTION:
        raise ProtocolError(f"message id {message_id}: must fit into 32 bits")
    _check_metadata_size(2 + sum(METADATA_ENTRY.size + len(key) + len(value) for key, value in pairs))
    entries = b"".join(METADATA_ENTRY.pack(len(key), UTF_8, len(value)) for key, value in pairs)
    index = struct.pack(">H", len(pairs)) + entries
    texts = b"".join(key + value for key, value in pairs)
    return EXTENDED.pack(EXTENDED.size, len(index), len(texts), message_id) + content + index + texts


def split_body(body: memoryview, version: int) -> tuple[memoryview, int, dict[str, str]]:
    """Split a body into content, message id and metadata; raise ProtocolError if the sizes contradict each other."""
    if version == 1:
        return body, 0, {}
    if len(body) < EXTENDED.size:
        raise ProtocolError(f"body of {len(body)} bytes: too short for an extended header")
    extended, index_bytes, text_bytes, message_id = EXTENDED.unpack_from(body)
    _check_metadata_size(index_bytes + text_bytes)
    end = len(body) - index_bytes - text_bytes
    if extended < EXTENDED.size or end < extended:
        raise ProtocolError(f"extended header: {extended} + {index_bytes} + {text_bytes} bytes in {len(body)}")
    metadata = _metadata(body[end : end + index_bytes], body[end + index_bytes :])
    return body[extended:end], message_id, metadata


def _check_metadata_size(size: int) -> None:
    if size > MAX_METADATA_BYTES:
        raise ProtocolError(f"metadata: {size} bytes, at most {MAX_METADATA_BYTES}")


def _metadata(index: memoryview, texts: memoryview) -> dict[str, str]:
    """Return keys and values; the texts follow each other in the order of the index."""
    if len(index) < 2:
        if len(index) or len(texts):
            raise ProtocolError(f"metadata: index of {len(index)} bytes for texts of {len(texts)}")
        return {}
    (count,) = struct.unpack_from(">H", index)
    if len(index) != 2 + count * METADATA_ENTRY.size:
        raise ProtocolError(f"metadata: {count} entries in an index of {len(index)} bytes")
    metadata, place = {}, 0
    for key_bytes, _, value_bytes in METADATA_ENTRY.iter_unpack(index[2:]):
        middle, end = place + key_bytes, place + key_bytes + value_bytes
        if end > len(texts):
            raise ProtocolError(f"metadata: an entry ends at byte {end} of {len(texts)}")
        key, value = (bytes(texts[at:to]).decode("utf-8", "replace") for at, to in ((place, middle), (middle, end)))
        metadata[key], place = value, end
    return metadata
