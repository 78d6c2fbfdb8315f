"""Hostile clients, many at once: slow, huge, half-closed, deaf, flooding, lying ones. A
process of its own.

    python -m monitor_service.attackers PORT CONSOLE CONNECTIONS AT_ONCE SEED [KIND...]

PORT is the monitor's, CONSOLE that of its pages.

Prints one JSON object at the end: how many there were of each kind, and how they were
parted with.
"""

import asyncio
import json
import os
import random
import socket
import sys
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from time import monotonic, time

import numpy as np

from scleraforce.live.network.openigtlink import (
    Header,
    Image,
    Message,
    Query,
    Sensor,
    Status,
    Text,
    encode,
    pack_header,
)
from scleraforce.live.network.operator_reset import RESET_DEVICE

MATRIX = (0.03, 0.0, 0.0, 0.0, 0.008, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
BLOCK = 65536
TELL_EVERY = 50


def header(name: str, body_bytes: int) -> Header:
    """Return the header of a message of any type and size."""
    return Header(1, name, "Robot", 0.0, body_bytes, 0)


class Link:
    """A connection of somebody hostile."""

    def __init__(self, link: socket.socket, rng: random.Random) -> None:
        self.link = link
        self.rng = rng
        self._loop = asyncio.get_running_loop()

    async def send(self, data: bytes | bytearray) -> None:
        """Send, as long as the other end reads."""
        await self._loop.sock_sendall(self.link, data)

    async def until_closed(self, within_s: float) -> bool:
        """Read until the other end closes; return whether it did in time."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while await self._loop.sock_recv(self.link, BLOCK):
                    pass
                return True
        return False

    async def for_a_while(self, data: Callable[[], bytes], within_s: float) -> None:
        """Send again and again; never read."""
        end_s = monotonic() + within_s
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while monotonic() < end_s:
                    await self.send(data())
                    await asyncio.sleep(0)

    def shut(self) -> None:
        """Send nothing more, and keep listening."""
        self.link.shutdown(socket.SHUT_WR)


async def slow(link: Link) -> None:
    """A byte of a good message now and then."""
    for byte in encode(Status(1, message="so slow"), "Robot")[
        : link.rng.randint(5, 60)
    ]:
        await link.send(bytes([byte]))
        await asyncio.sleep(link.rng.uniform(0.01, 0.1))


async def drip(link: Link) -> None:
    """A large message that is allowed, in pieces."""
    data = encode(Text("x" * 60_000), "Robot")
    for place in range(0, len(data), 4096):
        await link.send(data[place : place + 4096])
        await asyncio.sleep(link.rng.uniform(0.01, 0.2))


async def huge(link: Link) -> None:
    """A header that announces 16 MiB, or 2^63 bytes, and then bytes."""
    size = link.rng.choice([16 * 2**20, 2**63, 2**64 - 1, 5 * 2**20])
    await link.send(
        pack_header(header(link.rng.choice(["IMAGE", "STRING", "OTHER"]), size))
    )
    await link.for_a_while(lambda: bytes(BLOCK), 0.5)


async def half_closed(link: Link) -> None:
    """Half a message, or none, and the end of its writing."""
    data = encode(Image(np.zeros((1, 64, 64), np.uint16), MATRIX), "Scanner")
    await link.send(data[: link.rng.choice([0, 30, 58, 1000])])
    link.shut()
    await link.until_closed(1.0)


async def garbage(link: Link) -> None:
    """Bytes without sense."""
    await link.send(link.rng.randbytes(link.rng.randint(1, BLOCK)))
    await link.until_closed(1.0)


async def wrong_crc(link: Link) -> None:
    """Good messages but for their checksums."""
    for _ in range(20):
        image = Image(np.zeros((1, 64, 64), np.uint16), MATRIX)
        kinds: tuple[Message, ...] = (Status(1), Text("{}"), Sensor((1.0,) * 6), image)
        message = link.rng.choice(kinds)
        data = bytearray(encode(message, "Scanner", time_s=time()))
        data[-1] ^= 1
        await link.send(data)
        await asyncio.sleep(link.rng.uniform(0.0, 0.02))


async def wrong_token(link: Link) -> None:
    """Resets with guessed tokens."""
    for _ in range(5):
        await link.send(encode(Text(link.rng.randbytes(4).hex()), RESET_DEVICE))
        await asyncio.sleep(link.rng.uniform(0.0, 0.05))
    await link.until_closed(0.5)


async def wrong_code(link: Link) -> None:
    """Resets with guessed codes, until they are locked for all; the operator's token is
    still right.
    """
    for _ in range(5):
        code = f"{link.rng.randrange(10**6):06d}"
        await link.send(encode(Text(code), RESET_DEVICE))
        await asyncio.sleep(link.rng.uniform(0.0, 0.05))
    await link.until_closed(0.5)


async def leave(link: Link) -> None:
    """Nothing at all; some break the connection instead of closing it."""
    if link.rng.random() < 0.5:
        link.link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")


async def deaf(link: Link) -> None:
    """Never reads the answers."""
    link.link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    await asyncio.sleep(link.rng.uniform(0.5, 3.0))


async def asks(link: Link) -> None:
    """Asks for the STATUS without end, and reads no answer."""
    data = encode(Query("STATUS"), "Robot") * 1000
    await link.for_a_while(lambda: data, 0.5)


async def sensors(link: Link) -> None:
    """The robot's force, thousands of times."""
    data = encode(Sensor((0.01,) * link.rng.choice([1, 6, 255])), "RobotForce") * 30
    await link.for_a_while(lambda: data, 0.3)


async def unknown(link: Link) -> None:
    """Small messages of a type that nobody knows."""
    data = pack_header(header("WHATEVER", 0)) * 1000
    await link.for_a_while(lambda: data, 0.3)


async def second_scanner(link: Link) -> None:
    """Images while another scanner sends: small ones, and such as are read."""
    rows = link.rng.choice([64, 128, 512])
    image = Image(
        np.full((1, rows, rows), link.rng.randint(1, 4000), np.uint16), MATRIX
    )

    for _ in range(5):
        await link.send(encode(image, "Scanner", time_s=time()))
        await asyncio.sleep(link.rng.uniform(0.0, 0.02))


async def post(link: Link, *fields: str) -> None:
    """A request for a reset, and a body that goes on until it is let go."""
    host = "Host: localhost\r\nOrigin: http://localhost"
    head = "\r\n".join(["POST /reset HTTP/1.1", host, *fields, "", ""])
    await link.send(head.encode())
    await link.for_a_while(lambda: f"{BLOCK:x}\r\n".encode() + bytes(BLOCK), 0.5)


async def chunked(link: Link) -> None:
    """A body without a stated size, to the console, without a token."""
    await post(link, link.rng.choice(["Transfer-Encoding: chunked"] * 2 + CODINGS))


async def zeros(link: Link) -> None:
    """A length with leading zeros, or one that is too large."""
    await post(link, f"Content-Length: {link.rng.choice(LENGTHS)}")


CODINGS = ["Transfer-Encoding: chunked\r\nContent-Length: 2"]
LENGTHS = ["000000000100000000", "0100000000", "100000000", "999999999999999"]
CONSOLE_KINDS = (chunked, zeros)  # to its pages instead of the monitor
KINDS: tuple[Callable[[Link], Awaitable[None]], ...] = (
    slow,
    drip,
    huge,
    half_closed,
    garbage,
    wrong_crc,
    wrong_token,
    wrong_code,
    leave,
    deaf,
    asks,
    sensors,
    unknown,
    second_scanner,
    *CONSOLE_KINDS,
)


async def attack(port: int, kind: Callable[[Link], Awaitable[None]], seed: str) -> str:
    """Be one hostile client; return how it ended."""
    with socket.socket() as link:
        link.setblocking(False)
        try:
            async with asyncio.timeout(5.0):
                await asyncio.get_running_loop().sock_connect(link, ("127.0.0.1", port))
                await kind(Link(link, random.Random(seed)))
        except TimeoutError:
            return "stalled"
        except ConnectionError:
            return "was let go"

    return "left"


async def main(
    ports: tuple[int, int],
    connections: int,
    at_once: int,
    seed: int,
    names: list[str],
) -> None:
    """Attack in a random order."""
    kinds = [kind for kind in KINDS if not names or kind.__name__ in names]
    rng = random.Random(seed)
    free = asyncio.Semaphore(at_once)
    ends = Counter[str]()
    done = 0

    async def one(number: int, kind: Callable[[Link], Awaitable[None]]) -> None:
        nonlocal done
        port = ports[kind in CONSOLE_KINDS]
        try:
            ends[
                f"{kind.__name__}: {await attack(port, kind, f'{seed} {number}')}"
            ] += 1
        finally:
            free.release()

        done += 1
        if done % TELL_EVERY == 0:
            print(done, flush=True)

    async with asyncio.TaskGroup() as group:
        for number in range(connections):
            await free.acquire()
            group.create_task(one(number, rng.choice(kinds)))

    print(json.dumps(dict(sorted(ends.items()))), flush=True)


if __name__ == "__main__":
    # they would be elsewhere, and take no time from the monitor's companions
    os.nice(15)
    port, console, connections, at_once, seed = map(int, sys.argv[1:6])
    asyncio.run(main((port, console), connections, at_once, seed, sys.argv[6:]))
