"""Feed mutated OpenIGTLink messages to the decoder: only events and ProtocolError may
come out.

Bits are flipped, messages cut, lengths and types changed, pieces doubled; half of the
messages then get the right size and checksum, so that the code behind the checksum is
reached. They go in pieces of any size over connections of 1 to 8 messages; the rest of
a broken connection is dropped. Everything is sent twice: the first time warms up the
memory.
"""

import ctypes
import gc
import resource
import struct
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from math import isfinite
from pathlib import Path
from random import Random
from time import perf_counter

import numpy as np
from fastcrc.crc64 import ecma_182

from markdown_tables import markdown
from scleraforce.base.errors import ProtocolError
from scleraforce.live.network.openigtlink import (
    HEADER_BYTES,
    Decoder,
    Image,
    Message,
    PeerEvent,
    Query,
    Received,
    Sensor,
    Status,
    Text,
    Transform,
    encode,
)
from scleraforce.live.network.scanner_frame import FrameAssembler

MESSAGES_A_CONNECTION = (1, 1, 1, 2, 3, 8)
CAPS_BYTES = (4 * 1024, 64 * 1024, 64 * 1024, 16 * 1024 * 1024)
LARGE_SHARE = 0.002
SIZE_PLACE = 42
PIECE_BYTES = 64 * 1024
NUMBERS = [0, 1, 2, 3, 4, 7, 8, 11, 12, 13, 72, 127, 128, 255, 256, 32767, 32768]
NUMBERS += [65535, 2**31, 2**32 - 1, 2**63, 2**64 - 1]
TYPES = [b"IMAGE", b"STATUS", b"STRING", b"SENSOR", b"TRANSFORM", b"GET_STATUS"]
TYPES += [b"GET_IMAGE", b"GET_", b"STT_TRANS", b"POLYDATA", b"", b"\xff\xfe"]
TYPES += [b"image", b"IMAGE\0GARBAGE"]
MATRIX = (0.005, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass
class Outcome:
    """Counts of events by type and of images; unexpected exceptions."""

    events: Counter[str] = field(default_factory=Counter)
    unexpected: list[str] = field(default_factory=list)


def messages(*, messages: int = 1_000_000, seed: int = 1) -> int:
    """What mutated messages do to the decoder: exceptions, memory, time.

    Args:
        messages: how many are sent, twice.
        seed: of the mutations.

    Returns:
        1 if there was an exception other than ProtocolError.
    """
    run(messages, seed)
    before_bytes = _resident_bytes()
    outcome = run(messages, seed)
    grown_bytes = _resident_bytes() - before_bytes
    figures = {
        "messages, twice": messages,
        "exceptions other than ProtocolError": len(outcome.unexpected),
        **dict(sorted(outcome.events.items())),
        "memory grown in the second run, KiB": grown_bytes // 1024,
        "an image of 512 x 512 of 16 bits, copied to its place, ms": _image_ms(),
    }
    print(*outcome.unexpected[:3], sep="\n")
    print(markdown(["decoder", f"seed {seed}"], figures.items()))

    return 1 if outcome.unexpected else 0


def run(count: int, seed: int) -> Outcome:
    """Send that many mutated messages; report each unexpected exception and end its
    connection.
    """
    draw = Random(seed)
    outcome = Outcome()
    assembler = FrameAssembler()
    small, large = _sent_messages()
    done = 0

    while done < count:
        chosen = [
            draw.choice(large if draw.random() < LARGE_SHARE else small)
            for _ in range(draw.choice(MESSAGES_A_CONNECTION))
        ]
        sent = [_mutated(message, draw) for message in chosen][: count - done]
        done += len(sent)
        try:
            _connection(b"".join(sent), draw, outcome, assembler)
        except Exception:
            outcome.unexpected.append(traceback.format_exc())

    return outcome


def _sent_messages() -> tuple[list[bytes], list[bytes]]:
    """Return every kind of message in every version: small ones, and images of full
    size.
    """
    draw = np.random.default_rng(3)
    counts = draw.integers(0, 120, (1, 12, 16))
    kinds = ("int8", "uint8", "int16", "uint16")
    images = [Image(counts.astype(dtype), MATRIX) for dtype in kinds]
    parts = [
        Image(images[3].pixels[:, a:b], MATRIX, (16, 12, 1), (0, a, 0))
        for a, b in pairwise((0, 5, 9, 12))
    ]
    small: list[Message] = [
        *images,
        *parts,
        Image(counts.astype("uint8")[..., np.newaxis].repeat(3, 3)),
        Image(counts.astype("int16").repeat(2, 0)),
        Status(1, -7, "Ready", "class 0, 1.2 mN"),
        Text('{"force_mn": 12.5}'),
        Text("µN"),
        Sensor((1.5, -2.0, 1e300)),
        Transform(MATRIX),
        *map(Query, ("STATUS", "IMAGE", "POLYDATA")),
    ]
    large = Image(draw.integers(0, 4096, (1, 512, 512)).astype("uint16"), MATRIX)

    return _encoded(small), _encoded([large])


def _encoded(messages: list[Message]) -> list[bytes]:
    plain = [
        encode(message, "Scanner", version=version)
        for message in messages
        for version in (1, 2, 3)
    ]
    metadata = {"eye": "left", "µ": ""}
    return plain + [
        encode(message, "Scanner", version=2, message_id=7, metadata=metadata)
        for message in messages
    ]


def _mutated(message: bytes, draw: Random) -> bytes:
    """Return a message with 0 to 3 mutations; half of the changed ones are put
    right.
    """
    data = bytearray(message)
    for mutation in draw.choices(MUTATIONS, k=draw.choice((0, 1, 1, 1, 2, 3))):
        mutation(data, draw)
    if draw.random() < 0.5:
        _put_right(data)
    return bytes(data)


def _flip_bits(data: bytearray, draw: Random) -> None:
    """Flip 1 to 8 bits."""
    for _ in range(draw.randint(1, 8)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def _cut(data: bytearray, draw: Random) -> None:
    """Lose the end."""
    del data[draw.randrange(1, len(data) + 1) :]


def _change_number(data: bytearray, draw: Random) -> None:
    """Write a number of 1 to 8 bytes over the header's size or a number of the body."""
    width = draw.choice((1, 2, 4, 8))
    place = SIZE_PLACE if draw.random() < 0.2 else HEADER_BYTES + draw.randrange(90)
    if place < len(data):
        number = draw.choice(NUMBERS) if draw.random() < 0.7 else draw.randrange(2**64)
        data[place : place + width] = (number % 256**width).to_bytes(width, "big")


def _change_type(data: bytearray, draw: Random) -> None:
    """Say that it is something else."""
    data[2:14] = draw.choice(TYPES)[:12].ljust(12, b"\0")


def _double_piece(data: bytearray, draw: Random) -> None:
    """Say a piece twice, somewhere."""
    start = draw.randrange(len(data))
    place = draw.randrange(len(data) + 1)
    data[place:place] = data[start : start + draw.randint(1, 100)]


MUTATIONS = (
    _flip_bits,
    _cut,
    _change_number,
    _change_number,
    _change_type,
    _double_piece,
)


def _put_right(data: bytearray) -> None:
    """State the size and the checksum that the body has, in a header that can be
    one.
    """
    if len(data) >= HEADER_BYTES:
        if not 1 <= data[1] <= 3 or data[0]:
            data[:2] = b"\0\2"
        body = data[HEADER_BYTES:]
        struct.pack_into(">QQ", data, SIZE_PLACE, len(body), ecma_182(body))


def _connection(
    data: bytes, draw: Random, outcome: Outcome, assembler: FrameAssembler
) -> None:
    """Take a connection's bytes until it breaks, as a server does, and count."""
    decoder = Decoder(draw.choice(CAPS_BYTES))
    lend = draw.random() < 0.5

    for piece in _pieces(data, draw):
        steps = _fed(decoder, piece) if lend else [decoder.feed(piece)]
        for event in chain.from_iterable(steps):
            outcome.events.update(_kinds(event, assembler))

        if decoder.broken:
            return


def _pieces(data: bytes, draw: Random) -> Iterator[bytes]:
    """Cut a stream into pieces, of a size that differs from stream to stream."""
    most = draw.choice((3, 60, 400, 5000, 600_000))
    place = 0
    while place < len(data):
        step = draw.randint(1, most) + len(data) // 5000
        yield data[place : place + step]
        place += step


def _fed(decoder: Decoder, piece: bytes) -> Iterator[tuple[PeerEvent, ...]]:
    """Write a piece into the places that a decoder lends; yield the events."""
    rest = memoryview(piece)
    while rest and not decoder.broken:
        room = decoder.space()
        count = min(len(room), len(rest), PIECE_BYTES)
        room[:count] = rest[:count]
        rest = rest[count:]
        yield decoder.received(count)


def _kinds(event: PeerEvent, assembler: FrameAssembler) -> Iterator[str]:
    """Yield what an event counts as; check the frame of an image."""
    if not isinstance(event, Received):
        yield type(event).__name__
        return

    yield f"Received {type(event.message).__name__}"
    if not isinstance(event.message, Image):
        return

    try:
        frame = assembler.add(event.message)
    except ProtocolError:
        yield "image refused"
        return

    if frame is None:
        yield "part kept"
        return

    assert frame.pixels.ndim == 2
    assert frame.pixels.size
    assert frame.pixels.dtype in (np.uint8, np.uint16)
    assert min(frame.lateral_m, frame.depth_m) > 0.0
    assert isfinite(frame.lateral_m * frame.depth_m)
    yield "frame"


def _resident_bytes() -> int:
    """Return the memory of this process that is in RAM, less what the allocator keeps
    for later.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def _image_ms() -> float:
    """Return the least time of an image of full size, received in pieces of 64 KiB."""
    data = _sent_messages()[1][0]
    taken_ms = []
    for _ in range(300):
        start_s = perf_counter()
        for _ in _fed(Decoder(), data):
            pass
        taken_ms.append((perf_counter() - start_s) * 1e3)

    return min(taken_ms)
