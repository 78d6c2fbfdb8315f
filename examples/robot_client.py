#!/usr/bin/env python3
"""A robot's side of the monitor: when may the needle move on? docs/robots.md has the
rule; copy this file and adapt it.

Any STATUS code of `ForceMonitor` but 1, 150 ms without a fresh STATUS, or any error
means: withdraw. Run as `robot_client.py [HOST [PORT]]`, it prints what a robot would
do. Standard library only. Research use only.
"""

# ruff: noqa: T201 - a program that prints

import socket
import struct
import sys
import time
from collections.abc import Callable

# version, type, device, time, bytes of the body, CRC-64 of the body
HEADER = struct.Struct(">H12s20sQQQ")
STATUS = struct.Struct(">Hq20s")  # code, sub-code, name; the message follows
OK = 1
SILENCE_S = 0.150
# an OK delayed by more than this, compared with the quickest STATUS, is old
OLD_S = 0.100
DRIFT = 1e-4  # of this clock and the monitor's, which need not agree
# in this machine's buffer: the monitor closes the connection of a robot that leaves
# more unread
UNREAD_BYTES = 8192
MAX_BODY_BYTES = 64 * 1024  # the monitor's messages are far smaller
DEVICE = "ForceMonitor"


class DoubtError(Exception):
    """The monitor cannot be heard, or not be believed."""


def crc_table() -> list[int]:
    """Return the CRC-64 (ECMA-182, first bit first) of each byte."""
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = (crc << 1) ^ (0x42F0E1EBA9EA3693 if crc >> 63 else 0)
            crc &= 0xFFFFFFFFFFFFFFFF

        table.append(crc)

    return table


TABLE = crc_table()


def crc64(data: bytes) -> int:
    """Return the CRC-64 of a body, as OpenIGTLink has it."""
    crc = 0
    for byte in data:
        crc = ((crc << 8) & 0xFFFFFFFFFFFFFFFF) ^ TABLE[(crc >> 56) ^ byte]
    return crc


def receive(link: socket.socket, count: int, until_s: float) -> bytes:
    """Return the next `count` bytes; raise DoubtError if they do not come in time."""
    data = b""
    while len(data) < count:
        left_s = until_s - time.monotonic()
        if left_s <= 0:
            raise DoubtError("no STATUS for 150 ms")

        link.settimeout(left_s)
        try:
            piece = link.recv(count - len(data))
        except TimeoutError:
            raise DoubtError("no STATUS for 150 ms") from None

        if not piece:
            raise DoubtError("the monitor has closed the connection")

        data += piece

    return data


def next_status(link: socket.socket, until_s: float) -> tuple[int, int, str, float]:
    """Return code, sub-code, message and time (s) of the next STATUS; others are
    checked and passed over.
    """
    while True:
        version, kind, device, time_s32, size, crc = HEADER.unpack(
            receive(link, HEADER.size, until_s)
        )
        if version != 1:  # a client that has sent nothing is spoken to in version 1
            raise DoubtError(f"a header of version {version}")
        if size > MAX_BODY_BYTES:
            raise DoubtError(f"a body of {size} bytes")

        body = receive(link, size, until_s)
        if crc64(body) != crc:
            raise DoubtError("a checksum is wrong")
        if kind.rstrip(b"\0") != b"STATUS" or device.rstrip(b"\0") != DEVICE.encode():
            continue
        if size < STATUS.size:
            raise DoubtError(f"a STATUS of {size} bytes")

        code, sub_code, _ = STATUS.unpack_from(body)
        return (
            code,
            sub_code,
            body[STATUS.size :].split(b"\0")[0].decode("utf-8", "replace"),
            time_s32 / 2**32,
        )


def watch(host: str, port: int, tell: Callable[[bool, str], None]) -> None:
    """Follow the monitor until it cannot be heard any more.

    `tell` is called with each change: whether the needle may move on, and why. Its last
    call is a withdrawal.
    """
    told: tuple[int, int] | None = None
    try:
        with socket.create_connection((host, port), timeout=SILENCE_S) as link:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)
            heard_s = time.monotonic()
            least_s = float("inf")
            until_s = heard_s + SILENCE_S

            while True:
                code, sub_code, message, said_s = next_status(link, until_s)
                before_s = heard_s
                heard_s = time.monotonic()

                least_s = min(least_s + DRIFT * (heard_s - before_s), heard_s - said_s)
                if code == OK and heard_s - said_s > least_s + OLD_S:
                    # it has waited somewhere: what is true now may be a withdrawal
                    continue

                until_s = heard_s + SILENCE_S  # only a STATUS counts, no other message
                if (code, sub_code) != told:
                    told = code, sub_code
                    tell(code == OK, f"code {code}, sub-code {sub_code}: {message}")
    except (OSError, DoubtError) as doubt:
        tell(False, str(doubt))


def show(go_on: bool, why: str) -> None:
    """Print what a robot would do."""
    print(f"{time.time():.3f} {'continue' if go_on else 'WITHDRAW'}: {why}", flush=True)


if __name__ == "__main__":
    host, port = (sys.argv[1:] + ["127.0.0.1", "18944"][len(sys.argv) - 1 :])[:2]
    try:
        watch(host, int(port), show)
    except KeyboardInterrupt:
        sys.exit(130)
    sys.exit(1)
