"""Hostile clients, many at once: slow, huge, half-closed, deaf, flooding, lying ones. A
process of its own.

    python -m monitor.attackers PORT CONSOLE CONNECTIONS AT_ONCE SEED

PORT is the monitor's, CONSOLE that of its pages. They begin when standard input ends.
Prints one JSON object: how many there were of each kind, and how they were parted with.
"""

import asyncio
import json
import os
import random
import socket
import sys
from asyncio import StreamReader, StreamWriter
from collections import Counter
from contextlib import suppress
from time import monotonic, time

import numpy as np

from scleraforce.live.network.openigtlink import (
    Header,
    Image,
    Query,
    Sensor,
    Status,
    Text,
    encode,
    pack_header,
)
from scleraforce.live.network.operator_reset import RESET_DEVICE

BLOCK = 65536
FOR_S = 0.5  # that a client goes on sending, or listening
SIZES = (5 * 2**20, 16 * 2**20, 2**63, 2**64 - 1)
# Bodies of requests to the console: without a length, with two, with a wrong one.
LENGTHS = (
    "Transfer-Encoding: chunked",
    "Transfer-Encoding: chunked\r\nContent-Length: 2",
    "Content-Length: 000000000100000000",
    "Content-Length: 999999999999999",
)


class Client:
    """A hostile client's end of a connection; each of its kinds is a method."""

    def __init__(
        self, reader: StreamReader, writer: StreamWriter, rng: random.Random
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._rng = rng

    async def slow(self) -> None:
        """Send a byte of a good message now and then."""
        data = encode(Status(1, message="so slow"), "Robot")
        for byte in data[: self._rng.randint(5, 60)]:
            await self._send(bytes([byte]), within_s=0.1)

    async def huge(self) -> None:
        """Announce up to 2^64 bytes, and send bytes."""
        await self._send(_header(self._rng.choice(SIZES)))
        await self._flood(bytes(BLOCK))

    async def half(self) -> None:
        """Send half a message, or none, and the end of the writing."""
        await self._send(self._image()[: self._rng.choice((0, 30, 58, 1000))])
        self._writer.write_eof()
        await self._listen()

    async def garbage(self) -> None:
        """Send bytes without sense."""
        await self._send(self._rng.randbytes(self._rng.randint(1, BLOCK)))
        await self._listen()

    async def wrong_checksum(self) -> None:
        """Send images, good but for their checksums."""
        for _ in range(20):
            data = bytearray(self._image())
            data[-1] ^= 1
            await self._send(data, within_s=0.02)

    async def guesses(self) -> None:
        """Ask for a reset with guessed tokens and codes, until codes are locked for
        all; the operator's token is still right.
        """
        for _ in range(5):
            code = f"{self._rng.randrange(10**6):06d}"
            guess = self._rng.choice((code, self._rng.randbytes(4).hex()))
            await self._send(encode(Text(guess), RESET_DEVICE), within_s=0.05)

        await self._listen()

    async def deaf(self) -> None:
        """Read nothing for a while; some break the connection instead of closing it."""
        await asyncio.sleep(self._rng.uniform(0.0, 3.0))
        if self._rng.random() < 0.5:
            self._writer.transport.abort()

    async def floods(self) -> None:
        """Send small messages without end, and read no answer."""
        query = encode(Query("STATUS"), "Robot")
        force = encode(Sensor((0.01,) * self._rng.choice((1, 6, 255))), "RobotForce")
        await self._flood(1000 * self._rng.choice((query, force, _header(0))))

    async def second_scanner(self) -> None:
        """Send images while another scanner sends: small ones, and such as are read."""
        for _ in range(5):
            await self._send(self._image(), within_s=0.02)

    async def to_the_console(self) -> None:
        """Ask the pages for a reset, with a body that goes on until it is let go."""
        origin = "Host: localhost\r\nOrigin: http://localhost"
        length = self._rng.choice(LENGTHS)
        await self._send(
            f"POST /reset HTTP/1.1\r\n{origin}\r\n{length}\r\n\r\n".encode()
        )
        await self._flood(f"{BLOCK:x}\r\n".encode() + bytes(BLOCK))

    def _image(self) -> bytes:
        rows = self._rng.choice((64, 128, 512))
        pixels = np.full((1, rows, rows), self._rng.randint(1, 4000), np.uint16)
        matrix = (0.03, 0.0, 0.0, 0.0, 0.008, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        return bytes(encode(Image(pixels, matrix), "Scanner", time_s=time()))

    async def _send(self, data: bytes | bytearray, within_s: float = 0.0) -> None:
        """Send, as long as the other end reads, and wait a random time."""
        self._writer.write(data)
        await self._writer.drain()
        await asyncio.sleep(self._rng.uniform(0.0, within_s))

    async def _flood(self, data: bytes) -> None:
        """Send again and again; never read."""
        end_s = monotonic() + FOR_S
        with suppress(TimeoutError):
            async with asyncio.timeout(FOR_S):
                while monotonic() < end_s:
                    await self._send(data)

    async def _listen(self) -> None:
        """Read for a while, or until the other end closes."""
        with suppress(TimeoutError):
            async with asyncio.timeout(FOR_S):
                while await self._reader.read(BLOCK):
                    pass


KINDS = (
    Client.slow,
    Client.huge,
    Client.half,
    Client.garbage,
    Client.wrong_checksum,
    Client.guesses,
    Client.deaf,
    Client.floods,
    Client.second_scanner,
    Client.to_the_console,
)


def _header(body_bytes: int) -> bytes:
    """Return the header of a message of a type that nobody knows."""
    return pack_header(Header(1, "WHATEVER", "Robot", 0.0, body_bytes, 0))


async def _attack(ports: tuple[int, int], rng: random.Random) -> str:
    """Be one hostile client; return its kind and how it ended."""
    kind = rng.choice(KINDS)
    port = ports[kind is Client.to_the_console]
    end = "left"
    try:
        async with asyncio.timeout(5.0):
            # a small buffer: what a client does not read stays with the monitor
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1)
            link = writer.get_extra_info("socket")
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            try:
                await kind(Client(reader, writer, rng))
            finally:
                writer.close()
    except TimeoutError:
        end = "stalled"
    except OSError:
        end = "was let go"

    return f"{kind.__name__}: {end}"


async def _main(
    ports: tuple[int, int], connections: int, at_once: int, seed: int
) -> None:
    """Attack in a random order."""
    free = asyncio.Semaphore(at_once)
    ends = Counter[str]()

    async def one(number: int) -> None:
        async with free:
            ends[await _attack(ports, random.Random(f"{seed} {number}"))] += 1

    await asyncio.gather(*map(one, range(connections)))
    print(json.dumps(dict(sorted(ends.items()))), flush=True)


if __name__ == "__main__":
    # they would be elsewhere, and take no time from the monitor's companions
    os.nice(15)
    sys.stdin.read()
    port, console, connections, at_once, seed = map(int, sys.argv[1:])
    asyncio.run(_main((port, console), connections, at_once, seed))
