"""The watchdog: a process that makes the clients withdraw when the monitor hangs or has
died.

It holds duplicates of the clients' sockets. Its duty begins with the first client or
sign of life. If no sign of life comes for `MISSES` looks of `LOOK_S`, it kills the
monitor (which might otherwise resume later and say OK) and sends the emergency (a
STATUS, and a STRING for programs without that type) to all clients, every `REPEAT_S`,
until the last one has left. A pause of the whole machine counts as one look. The
process uses the standard library alone, so that it starts before NumPy and the model
are loaded and does not depend on them.

A message is one datagram: a letter and what follows it. The watchdog answers `ALIVE`
when it is ready and to each sign of life (B); Q is a planned end.

    M  version, space, messages to send
    C  client, whose socket comes with it
    V  client, space, version
    D  client, whose socket is to be closed
    B  nothing
    Q  nothing
"""

import os
import re
import select
import signal
import socket
import sys
import time
from contextlib import suppress

from scleraforce.base.errors import MessageError

ALIVE = b"A"
MOST_BYTES = 4096
# 58 bytes: a whole header
FORM = re.compile(rb"M[123] .{58,}|C\d{1,18}|V\d{1,18} [123]|D\d{1,18}|B|Q", re.DOTALL)
LOOK_S = 0.02
MISSES = 5
REPEAT_S = 0.05
# for the first client or sign of life: the monitor greets its operator before
DUTY_S = 20.0
HEADER_BYTES = 58  # of a header in any version
TIME = slice(34, 42)  # seconds since 1970, in 2^-32 s
BODY_BYTES = slice(42, 50)
# The second opinion waits for the monitor, and a monitor in a tight loop must not keep
# its watchdog from running.
OPINION_PRIORITY = 5
MONITOR_PRIORITY = 10
WATCHDOG_PRIORITY = 20


def parts_of(data: bytes) -> tuple[bytes, int, bytes]:
    """Return the letter of a datagram, the number after it (0 without one), and the
    rest, or raise MessageError.

    >>> parts_of(b"V7 2")
    (b'V', 7, b'2')
    """
    if len(data) > MOST_BYTES or not FORM.fullmatch(data):
        raise MessageError(
            f"{data[:20]!r}, {len(data)} bytes: not a message to the watchdog"
        )
    number, _, rest = data[1:].partition(b" ")
    return data[:1], int(number or b"0"), rest


def stamp_time(messages: bytearray, time_s: float) -> None:
    """Write a time into each of several OpenIGTLink messages, s since 1970."""
    time_s32 = int(time_s * 2**32).to_bytes(8, "big")
    start = 0

    while start < len(messages):
        header = memoryview(messages)[start : start + HEADER_BYTES]
        header[TIME] = time_s32
        start += HEADER_BYTES + int.from_bytes(header[BODY_BYTES], "big")


def run_in_real_time(priority: int) -> bool:
    """Give this process, but not its children, priority over all normal ones
    (SCHED_FIFO); return whether it worked.

    It works for root and for users with a limit `rtprio` (man 5 limits.conf). A user
    with a limit `nice` instead gets that niceness below 0, which makes delays rarer.
    """
    try:
        os.sched_setscheduler(
            0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority)
        )
    except OSError:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, -priority)
        return False

    return True


class Watchdog:
    """The watchdog's clients, and the messages to send them; it kills process
    `monitor_pid` if that hangs.
    """

    def __init__(
        self, monitor: socket.socket, monitor_pid: int, look_s: float = LOOK_S
    ) -> None:
        self._monitor = monitor
        self._pid = monitor_pid
        self._look_s = look_s
        self._messages: dict[int, bytearray] = {}
        self._clients: dict[int, socket.socket] = {}
        self._versions: dict[int, int] = {}

    def await_duty(self) -> None:
        """Take messages until the first client, sign of life or end of the monitor,
        which `watch` takes, for `DUTY_S` at most.
        """
        end_s = time.monotonic() + DUTY_S
        self._answer()

        while select.select(
            [self._monitor], [], [], max(0.0, end_s - time.monotonic())
        )[0]:
            try:
                letter = self._monitor.recv(1, socket.MSG_PEEK)
            except ConnectionResetError:
                return

            if letter in (b"B", b"C", b"Q", b""):
                return

            self._hear()

    def watch(self) -> bool:
        """Watch until the monitor ends; return True if it ends as planned, False if it
        hangs or dies.
        """
        misses = 0
        self._answer()

        while misses < MISSES:
            if not select.select([self._monitor], [], [], self._look_s)[0]:
                misses += 1
                continue

            misses = 0
            letter = self._hear()
            if letter in (b"Q", b""):
                return letter == b"Q"

        return False

    def _hear(self) -> bytes:
        """Take a message; return its letter, b"" if the monitor has died."""
        try:
            data, sockets, _, _ = socket.recv_fds(self._monitor, MOST_BYTES + 1, 1)
        except ConnectionResetError:  # it died before it had heard an answer
            return b""

        if not data:
            return b""

        letter, number, rest = parts_of(data)
        self._take(letter, number, rest, sockets)
        return letter

    def _answer(self) -> None:
        with suppress(BlockingIOError, BrokenPipeError):
            # it may have died since; the next look will show it
            self._monitor.send(ALIVE)

    def _take(
        self, letter: bytes, number: int, rest: bytes, sockets: list[int]
    ) -> None:
        match letter:
            case b"B":
                self._answer()
            case b"M":
                self._messages[number] = bytearray(rest)
            case b"C":
                if not sockets:
                    raise MessageError(f"client {number} came without its socket")

                self._clients[number] = socket.socket(fileno=sockets[0])
                self._versions[number] = 1
            case b"V":
                self._versions[number] = int(rest)
            case b"D":
                self._clients.pop(number).close()

    def alarm(self) -> None:
        """Kill the monitor and tell the clients to withdraw, until none is left."""
        started_s = time.monotonic()
        if os.getppid() == self._pid:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)

        count = len(self._clients)
        self._send_emergency()
        note = (
            "watchdog: the monitor hung or died and was ended; clients ordered to"
            f" withdraw: {count}\n"
        )
        with suppress(OSError):  # standard error never blocks: see `start_companion`
            os.write(2, note.encode())

        due_s = started_s + REPEAT_S
        while self._clients:
            self._drain(max(0.0, due_s - time.monotonic()))
            if time.monotonic() >= due_s:
                self._send_emergency()
                due_s += REPEAT_S

    def _send_emergency(self) -> None:
        """Send the emergency to every client; a client that does not read misses it,
        one that has left is forgotten.
        """
        now_s = time.time()
        for message in self._messages.values():
            stamp_time(message, now_s)

        for number, client in list(self._clients.items()):
            try:
                client.send(self._messages[self._versions[number]])
            except BlockingIOError:
                pass
            except OSError:
                self._clients.pop(number).close()

    def _drain(self, within_s: float) -> None:
        """Discard what clients send: closing a socket with unread bytes would discard
        the last STATUS.
        """
        ready = select.select(list(self._clients.values()), [], [], within_s)[0]
        for number, client in list(self._clients.items()):
            if client not in ready:
                continue

            try:
                gone = not client.recv(1 << 20)
            except OSError as fault:
                gone = not isinstance(fault, BlockingIOError)

            if gone:
                self._clients.pop(number).close()


def main() -> None:
    """Run as a process: arguments are the descriptor of the channel, the monitor's
    process id and `look_s`.
    """
    channel = int(sys.argv[1])
    pid = int(sys.argv[2])
    look_s = float(sys.argv[3])
    run_in_real_time(WATCHDOG_PRIORITY)

    watchdog = Watchdog(socket.socket(fileno=channel), pid, look_s)
    watchdog.await_duty()
    if not watchdog.watch():
        watchdog.alarm()


if __name__ == "__main__":
    main()
