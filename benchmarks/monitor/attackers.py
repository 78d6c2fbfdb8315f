"""Hostile clients, many at once: slow, huge, half-closed, deaf, flooding, lying ones. A
process of its own.

    python -m monitor.attackers PORT CONSOLE CONNECTIONS AT_ONCE SEED

PORT is the monitor's, CONSOLE that of its pages. They begin when standard input ends.
Prints one JSON object: how many there were of each kind, and how they were parted with.
"""

import json
import os
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from random import Random
from socket import SHUT_WR, SO_LINGER, SOL_SOCKET, create_connection, socket
from time import monotonic, sleep, time

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
STALLED_S = 5.0
SIZES = (5 * 2**20, 16 * 2**20, 2**63, 2**64 - 1)
# Bodies of requests to the console: without a length, with two, with a wrong one.
LENGTHS = (
    "Transfer-Encoding: chunked",
    "Transfer-Encoding: chunked\r\nContent-Length: 2",
    "Content-Length: 000000000100000000",
    "Content-Length: 999999999999999",
)


def slow(link: socket, rng: Random) -> None:
    """Send a byte of a good message now and then."""
    data = encode(Status(1, message="so slow"), "Robot")
    for byte in data[: rng.randint(5, 60)]:
        link.sendall(bytes([byte]))
        sleep(rng.uniform(0.0, 0.1))


def huge(link: socket, rng: Random) -> None:
    """Announce up to 2^64 bytes, and send bytes."""
    link.sendall(_header(rng.choice(SIZES)))
    _flood(link, bytes(BLOCK))


def half(link: socket, rng: Random) -> None:
    """Send half a message, or none, and the end of the writing."""
    link.sendall(_image(rng)[: rng.choice((0, 30, 58, 1000))])
    link.shutdown(SHUT_WR)
    _listen(link)


def garbage(link: socket, rng: Random) -> None:
    """Send bytes without sense."""
    link.sendall(rng.randbytes(rng.randint(1, BLOCK)))
    _listen(link)


def wrong_checksum(link: socket, rng: Random) -> None:
    """Send images, good but for their checksums."""
    for _ in range(20):
        data = _image(rng)
        link.sendall(data[:-1] + bytes([data[-1] ^ 1]))
        sleep(rng.uniform(0.0, 0.02))


def guesses(link: socket, rng: Random) -> None:
    """Ask for a reset with guessed tokens and codes, until codes are locked for all;
    the operator's token is still right.
    """
    for _ in range(5):
        code = f"{rng.randrange(10**6):06d}"
        guess = rng.choice((code, rng.randbytes(4).hex()))
        link.sendall(encode(Text(guess), RESET_DEVICE))
        sleep(rng.uniform(0.0, 0.05))

    _listen(link)


def deaf(link: socket, rng: Random) -> None:
    """Read nothing for a while; some break the connection instead of closing it."""
    sleep(rng.uniform(0.0, 3.0))
    if rng.random() < 0.5:
        link.setsockopt(SOL_SOCKET, SO_LINGER, b"\1\0\0\0\0\0\0\0")


def floods(link: socket, rng: Random) -> None:
    """Send small messages without end, and read no answer."""
    query = encode(Query("STATUS"), "Robot")
    force = encode(Sensor((0.01,) * rng.choice((1, 6, 255))), "RobotForce")
    _flood(link, 1000 * rng.choice((query, force, _header(0))))


def second_scanner(link: socket, rng: Random) -> None:
    """Send images while another scanner sends: small ones, and such as are read."""
    for _ in range(5):
        link.sendall(_image(rng))
        sleep(rng.uniform(0.0, 0.02))


def to_the_console(link: socket, rng: Random) -> None:
    """Ask the pages for a reset, with a body that goes on until it is let go."""
    origin = "Host: localhost\r\nOrigin: http://localhost"
    head = f"POST /reset HTTP/1.1\r\n{origin}\r\n{rng.choice(LENGTHS)}\r\n\r\n"
    link.sendall(head.encode())
    _flood(link, f"{BLOCK:x}\r\n".encode() + bytes(BLOCK))


KINDS = (
    slow,
    huge,
    half,
    garbage,
    wrong_checksum,
    guesses,
    deaf,
    floods,
    second_scanner,
    to_the_console,
)


def _header(body_bytes: int) -> bytes:
    """Return the header of a message of a type that nobody knows."""
    return pack_header(Header(1, "WHATEVER", "Robot", 0.0, body_bytes, 0))


def _image(rng: Random) -> bytes:
    rows = rng.choice((64, 128, 512))
    pixels = np.full((1, rows, rows), rng.randint(1, 4000), np.uint16)
    matrix = (0.03, 0.0, 0.0, 0.0, 0.008, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return bytes(encode(Image(pixels, matrix), "Scanner", time_s=time()))


def _flood(link: socket, data: bytes) -> None:
    """Send again and again; never read."""
    link.settimeout(FOR_S)
    end_s = monotonic() + FOR_S
    with suppress(TimeoutError):
        while monotonic() < end_s:
            link.sendall(data)


def _listen(link: socket) -> None:
    """Read for a while, or until the other end closes."""
    end_s = monotonic() + FOR_S
    while monotonic() < end_s and link.recv(BLOCK):
        pass


def _attack(ports: tuple[int, int], rng: Random) -> str:
    """Be one hostile client; return its kind and how it ended."""
    kind = rng.choice(KINDS)
    end = "left"
    try:
        address = ("127.0.0.1", ports[kind is to_the_console])
        with create_connection(address, STALLED_S) as link:
            kind(link, rng)
    except TimeoutError:
        end = "stalled"
    except OSError:
        end = "was let go"

    return f"{kind.__name__}: {end}"


def main(
    port: int, console: int, connections: int, at_once: int, seed: int
) -> Counter[str]:
    """Attack in a random order; return how often each end was met."""
    with ThreadPoolExecutor(at_once) as pool:
        attacks = [
            pool.submit(_attack, (port, console), Random(f"{seed} {number}"))
            for number in range(connections)
        ]
        return Counter(sorted(attack.result() for attack in attacks))


if __name__ == "__main__":
    # they would be elsewhere, and take no time from the monitor's companions
    os.nice(15)
    sys.stdin.read()
    print(json.dumps(main(*map(int, sys.argv[1:]))), flush=True)
