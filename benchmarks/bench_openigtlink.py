"""Feed mutated OpenIGTLink messages to the decoder: only events and ProtocolError may
come out.

    python benchmarks/bench_openigtlink.py [--messages 1000000] [--seed 1]

Bits are flipped, messages cut, lengths and types changed, pieces doubled; half of the
messages then get the right size and checksum, so that the code behind the checksum is
reached. They go in pieces of any size over connections of 1 to 8 messages; the rest of
a broken connection is dropped. Everything is sent twice: the first time warms up the
memory, and a feed counts as slow only if it was slow twice, because the machine has
other work too (times are this thread's processor times).
"""

import argparse
import ctypes
import gc
import resource
import struct
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite
from pathlib import Path
from random import Random
from time import perf_counter, thread_time_ns

import numpy as np
from fastcrc.crc64 import ecma_182

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
SLOW_MS = 0.1  # feeds that take longer are remembered
LARGE_SHARE = 0.002
SIZE_PLACE = 42
CRC_PLACE = 50
NUMBERS = (
    0,
    1,
    2,
    3,
    4,
    7,
    8,
    11,
    12,
    13,
    72,
    127,
    128,
    255,
    256,
    32767,
    32768,
    65535,
    2**31,
    2**32 - 1,
    2**63,
    2**64 - 1,
)
TYPES = (
    *(
        b"IMAGE",
        b"STATUS",
        b"STRING",
        b"SENSOR",
        b"TRANSFORM",
        b"GET_STATUS",
        b"GET_IMAGE",
        b"GET_",
        b"STT_TRANS",
    ),
    *(b"POLYDATA", b"", b"\xff\xfe", b"image", b"IMAGE\0GARBAGE"),
)
Sent = list[bytes]
Mutation = Callable[[bytearray, Random], None]


@dataclass
class Outcome:
    """Counts of events by type and of images; unexpected exceptions; slow feeds by
    number.
    """

    events: Counter[str] = field(default_factory=Counter)
    unexpected: list[str] = field(default_factory=list)
    feeds: int = 0
    slow_ms: dict[int, float] = field(default_factory=dict)


def messages() -> tuple[Sent, Sent]:
    """Return every kind of message in every version: small ones, and images of full
    size.
    """
    draw = np.random.default_rng(3)
    counts = draw.integers(0, 120, (1, 12, 16))
    matrix = (0.005, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    images = [
        Image(counts.astype(dtype), matrix)
        for dtype in ("int8", "uint8", "int16", "uint16")
    ]
    cuts = list(pairwise((0, 5, 9, 12)))
    parts = [
        Image(images[3].pixels[:, a:b], matrix, (16, 12, 1), (0, a, 0)) for a, b in cuts
    ]
    others = [
        Image(counts.astype("uint8")[..., np.newaxis].repeat(3, 3)),
        Image(counts.astype("int16").repeat(2, 0)),
    ]
    said: list[Message] = [
        *images,
        *parts,
        *others,
        *(
            Status(1, -7, "Ready", "class 0, 1.2 mN"),
            Text('{"force_mn": 12.5}'),
            Text("µN"),
            Sensor((1.5, -2.0, 1e300)),
        ),
        *(Transform(matrix), Query("STATUS"), Query("IMAGE"), Query("POLYDATA")),
    ]
    large = Image(draw.integers(0, 4096, (1, 512, 512)).astype("uint16"), matrix)

    return _encoded(said), _encoded([large])


def _encoded(said: list[Message]) -> Sent:
    plain = [
        encode(message, "Scanner", version=version)
        for message in said
        for version in (1, 2, 3)
    ]
    told = {"eye": "left", "µ": ""}

    return plain + [
        encode(message, "Scanner", version=2, message_id=7, metadata=told)
        for message in said
    ]


def flip_bits(data: bytearray, draw: Random) -> None:
    """Flip 1 to 8 bits."""
    for _ in range(draw.randint(1, 8)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def cut(data: bytearray, draw: Random) -> None:
    """Lose the end."""
    del data[draw.randrange(1, len(data) + 1) :]


def change_number(data: bytearray, draw: Random) -> None:
    """Write a number of 1 to 8 bytes over the header's size or a number of the body."""
    width = draw.choice((1, 2, 4, 8))
    place = SIZE_PLACE if draw.random() < 0.2 else HEADER_BYTES + draw.randrange(90)
    if place < len(data):
        number = draw.choice(NUMBERS) if draw.random() < 0.7 else draw.randrange(2**64)
        data[place : place + width] = (number % 256**width).to_bytes(width, "big")


def change_type(data: bytearray, draw: Random) -> None:
    """Say that it is something else."""
    data[2:14] = draw.choice(TYPES)[:12].ljust(12, b"\0")


def double_piece(data: bytearray, draw: Random) -> None:
    """Say a piece twice, somewhere."""
    start = draw.randrange(len(data))
    place = draw.randrange(len(data) + 1)
    data[place:place] = data[start : start + draw.randint(1, 100)]


MUTATIONS: tuple[Mutation, ...] = (
    flip_bits,
    cut,
    change_number,
    change_number,
    change_type,
    double_piece,
)


def put_right(data: bytearray) -> None:
    """State the size and the checksum that the body has, in a header that can be
    one.
    """
    if len(data) >= HEADER_BYTES:
        if not 1 <= data[1] <= 3 or data[0]:
            data[:2] = b"\0\2"
        body = data[HEADER_BYTES:]
        struct.pack_into(">QQ", data, SIZE_PLACE, len(body), ecma_182(body))


def mutated(data: bytes, draw: Random) -> bytes:
    """Return a message with 0 to 3 mutations; half of the changed ones are put
    right.
    """
    changed = bytearray(data)
    for mutation in draw.choices(MUTATIONS, k=draw.choice((0, 1, 1, 1, 2, 3))):
        mutation(changed, draw)
    if draw.random() < 0.5:
        put_right(changed)
    return bytes(changed)


def pieces(data: bytes, draw: Random) -> Iterator[bytes]:
    """Cut a stream into pieces, of a size that differs from stream to stream."""
    most = draw.choice((3, 60, 400, 5000, 600_000))
    place = 0
    while place < len(data):
        step = draw.randint(1, most) + len(data) // 5000
        yield data[place : place + step]
        place += step


def feed(decoder: Decoder, piece: bytes, lend: bool) -> Iterator[tuple[PeerEvent, ...]]:
    """Yield the events of a piece, fed as it is or written into the places that are
    lent.
    """
    if not lend:
        yield decoder.feed(piece)
        return

    rest = memoryview(piece)
    while rest and not decoder.broken:
        room = decoder.space()
        count = min(len(room), len(rest))
        room[:count] = rest[:count]
        rest = rest[count:]
        yield decoder.received(count)


class Peer:
    """Takes connections one after another, as a server does, and counts."""

    def __init__(self) -> None:
        self.outcome = Outcome()
        self.assembler = FrameAssembler()

    def connection(self, sent: Sent, draw: Random) -> None:
        """Take a connection's messages until it breaks."""
        decoder = Decoder(draw.choice(CAPS_BYTES))
        lend = draw.random() < 0.5

        for piece in pieces(b"".join(sent), draw):
            steps = feed(decoder, piece, lend)
            while True:
                start = thread_time_ns()
                events = next(steps, None)
                taken_ms = (thread_time_ns() - start) * 1e-6
                if events is None:
                    break

                self.outcome.feeds += 1
                if taken_ms > SLOW_MS:
                    self.outcome.slow_ms[self.outcome.feeds] = taken_ms

                self._count(events)

            if decoder.broken:
                return

    def _count(self, events: tuple[PeerEvent, ...]) -> None:
        for event in events:
            name = type(event).__name__
            if isinstance(event, Received):
                name = f"Received {type(event.message).__name__}"
                if isinstance(event.message, Image):
                    self._image(event.message)

            self.outcome.events[name] += 1

    def _image(self, image: Image) -> None:
        try:
            frame = self.assembler.add(image)
        except ProtocolError:
            self.outcome.events["image refused"] += 1
            return

        if frame is None:
            self.outcome.events["part kept"] += 1
            return

        assert frame.pixels.ndim == 2
        assert frame.pixels.size
        assert frame.pixels.dtype in (np.uint8, np.uint16)
        assert min(frame.lateral_m, frame.depth_m) > 0.0
        assert isfinite(frame.lateral_m * frame.depth_m)
        self.outcome.events["frame"] += 1


def resident_bytes() -> int:
    """Return the memory of this process that is in RAM, less what the allocator keeps
    for later.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def run(count: int, seed: int) -> Outcome:
    """Send that many mutated messages; report each unexpected exception and end its
    connection.
    """
    draw = Random(seed)
    peer = Peer()
    small, large = messages()
    done = 0

    while done < count:
        some = [
            draw.choice(large if draw.random() < LARGE_SHARE else small)
            for _ in range(draw.choice(MESSAGES_A_CONNECTION))
        ]
        sent = [mutated(message, draw) for message in some][: count - done]

        try:
            peer.connection(sent, draw)
        except Exception:
            peer.outcome.unexpected.append(traceback.format_exc())

        done += len(sent)

    return peer.outcome


def image_ms() -> float:
    """Return the least time of an image of 512 x 512 pixels of 16 bits, received in
    pieces of 64 KiB.
    """
    data = messages()[1][0]
    taken = []

    for _ in range(300):
        decoder = Decoder()
        rest = memoryview(data)
        start = perf_counter()

        while rest:
            count = min(len(room := decoder.space()), len(rest), 64 * 1024)
            room[:count] = rest[:count]
            decoder.received(count)
            rest = rest[count:]

        taken.append((perf_counter() - start) * 1e3)

    return min(taken)


def main() -> int:
    """Print the figures; 1 if there was an exception other than ProtocolError."""
    parser = argparse.ArgumentParser(
        description="Mutated OpenIGTLink messages through the decoder"
    )
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    start = perf_counter()
    first = run(given.messages, given.seed)
    before = resident_bytes()
    outcome = run(given.messages, given.seed)
    slow_ms = [
        min(taken_ms, first.slow_ms[number])
        for number, taken_ms in outcome.slow_ms.items()
        if number in first.slow_ms
    ]
    outcome.slow_ms.clear()  # ours, not the decoder's
    grown_bytes = resident_bytes() - before
    print(
        f"{given.messages} messages twice, seed {given.seed},"
        f" {perf_counter() - start:.0f} s"
    )
    print(f"exceptions other than ProtocolError: {len(outcome.unexpected)}")

    for text in outcome.unexpected[:3]:
        print(text)

    for name, number in sorted(outcome.events.items()):
        print(f"  {name:22} {number:9}")

    print(f"slowest of {outcome.feeds} feeds: {max(slow_ms, default=SLOW_MS):.2f} ms")
    print(f"memory grown in the second run: {grown_bytes / 1024:.0f} KiB")
    print(
        "an image of 512 x 512, 16 bit, copy into its place included:"
        f" {image_ms():.3f} ms"
    )

    return 1 if outcome.unexpected else 0


if __name__ == "__main__":
    sys.exit(main())
