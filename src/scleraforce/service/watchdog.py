"""The watchdog: a process that makes the clients withdraw when the monitor hangs or has died.

It holds duplicates of the clients' sockets. If no sign of life comes for `MISSES` looks of `LOOK_S`, it kills the
monitor (which might otherwise resume later and say OK) and sends the emergency STATUS to all clients, every `REPEAT_S`,
until the last one has left. A pause of the whole machine counts as one look. The process uses the standard library
alone, so that it starts before NumPy and the model are loaded and does not depend on them.

Its messages are records, one datagram each; it answers `ALIVE` when it is ready and to each sign of life. A datagram is
a letter and what follows it:

    M  version, space, the STATUS to send    C  client, whose socket comes with it    V  client, space, version
    D  client                                B  nothing                               Q  nothing
"""

import os
import re
import select
import signal
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass

from scleraforce.errors import MessageError

ALIVE = b"A"
MOST_BYTES = 4096
FORM = re.compile(
    rb"M(?P<emergency>[123]) (?P<status>.{58,})|C(?P<came>\d{1,18})|V(?P<speaks>\d{1,18}) (?P<version>[123])"
    rb"|D(?P<left>\d{1,18})|(?P<beat>B)|(?P<end>Q)",
    re.DOTALL,
)  # 58 bytes: the header of any OpenIGTLink message
LOOK_S = 0.02
MISSES = 5
REPEAT_S = 0.05
TIME = slice(34, 42)  # of a header in any version: seconds since 1970, in 2^-32 s
# The second opinion waits for the monitor, and a monitor in a tight loop must not keep its watchdog from running.
OPINION_PRIORITY, MONITOR_PRIORITY, WATCHDOG_PRIORITY = 5, 10, 20


@dataclass(frozen=True, kw_only=True)
class Emergency:
    """The whole STATUS message for clients of a header version, 1 to 3."""

    version: int
    status: bytes


@dataclass(frozen=True, kw_only=True)
class ClientCame:
    """A client, whose socket is sent along."""

    client: int


@dataclass(frozen=True, kw_only=True)
class ClientSpeaks:
    """The header version that a client speaks, 1 to 3."""

    client: int
    version: int


@dataclass(frozen=True, kw_only=True)
class ClientLeft:
    """A client whose socket is to be closed."""

    client: int


@dataclass(frozen=True, kw_only=True)
class Beat:
    """A sign of life of the monitor."""


@dataclass(frozen=True, kw_only=True)
class PlannedEnd:
    """The monitor ends as planned."""


WatchdogMessage = Emergency | ClientCame | ClientSpeaks | ClientLeft | Beat | PlannedEnd


def pack_for_watchdog(message: WatchdogMessage) -> bytes:
    """Return the datagram of a message; raise MessageError if it would not be understood.

    >>> pack_for_watchdog(ClientSpeaks(client=7, version=2))
    b'V7 2'
    """
    match message:
        case Emergency(version=version, status=status):
            data = b"M%d " % version + status
        case ClientCame(client=client):
            data = b"C%d" % client
        case ClientSpeaks(client=client, version=version):
            data = b"V%d %d" % (client, version)
        case ClientLeft(client=client):
            data = b"D%d" % client
        case Beat():
            data = b"B"
        case PlannedEnd():
            data = b"Q"
    _parts(data)
    return data


def unpack_for_watchdog(data: bytes) -> WatchdogMessage:
    """Return the message of a datagram; raise MessageError if it is not a message."""
    parts = _parts(data)
    if parts["emergency"]:
        return Emergency(version=int(parts["emergency"]), status=parts["status"])
    if parts["came"]:
        return ClientCame(client=int(parts["came"]))
    if parts["speaks"]:
        return ClientSpeaks(client=int(parts["speaks"]), version=int(parts["version"]))
    if parts["left"]:
        return ClientLeft(client=int(parts["left"]))
    return Beat() if parts["beat"] else PlannedEnd()


def _parts(data: bytes) -> dict[str, bytes]:
    """Return the parts of a datagram by name; those of other messages are None."""
    found = FORM.fullmatch(data) if len(data) <= MOST_BYTES else None
    if found is None:
        raise MessageError(f"{data[:20]!r}, {len(data)} bytes: not a message to the watchdog")
    return found.groupdict()


def stamp_time(message: bytearray, time_s: float) -> None:
    """Write a time into an OpenIGTLink message, s since 1970."""
    message[TIME] = int(time_s * 2**32).to_bytes(8, "big")


def run_in_real_time(priority: int) -> bool:
    """Give this process, but not its children, priority over all normal ones (SCHED_FIFO); return whether it worked.

    It works for root and for users with a limit `rtprio` (man 5 limits.conf). A user with a limit `nice` instead gets
    that niceness below 0, which makes delays rarer.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, -priority)
        return False
    return True


class Watchdog:
    """The watchdog's clients, and the messages to send them; it kills process `monitor_pid` if that hangs."""

    def __init__(self, monitor: socket.socket, monitor_pid: int, look_s: float = LOOK_S) -> None:
        self._monitor, self._pid, self._look_s = monitor, monitor_pid, look_s
        self._messages: dict[int, bytearray] = {}
        self._clients: dict[int, socket.socket] = {}
        self._versions: dict[int, int] = {}

    def watch(self) -> bool:
        """Watch until the monitor ends; return True if it ends as planned, False if it hangs or dies."""
        misses = 0
        self._monitor.send(ALIVE)
        while misses < MISSES:
            if not select.select([self._monitor], [], [], self._look_s)[0]:
                misses += 1
                continue
            misses = 0
            try:
                data, sockets, _, _ = socket.recv_fds(self._monitor, MOST_BYTES + 1, 1)
            except ConnectionResetError:  # it died before it had heard an answer
                return False
            if not data:
                return False
            message = unpack_for_watchdog(data)
            if isinstance(message, PlannedEnd):
                return True
            self._take(message, sockets)
        return False

    def _take(self, message: WatchdogMessage, sockets: list[int]) -> None:
        match message:
            case Beat():
                with suppress(BlockingIOError, BrokenPipeError):  # it may have died since; the next look will show it
                    self._monitor.send(ALIVE)
            case Emergency(version=version, status=status):
                self._messages[version] = bytearray(status)
            case ClientCame(client=number):
                if not sockets:
                    raise MessageError(f"client {number} came without its socket")
                self._clients[number] = socket.socket(fileno=sockets[0])
                self._versions[number] = 1
            case ClientSpeaks(client=number, version=version):
                self._versions[number] = version
            case ClientLeft(client=number):
                self._clients.pop(number).close()

    def alarm(self) -> None:
        """Kill the monitor and tell the clients to withdraw, until none is left."""
        started_s = time.monotonic()
        if os.getppid() == self._pid:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
        count = len(self._clients)
        self._send_emergency()
        note = f"watchdog: the monitor hung or died and was ended; clients told to withdraw: {count}\n"
        with suppress(OSError):  # standard error never blocks: see `start_companion`
            os.write(2, note.encode())
        due_s = started_s + REPEAT_S
        while self._clients:
            self._drain(max(0.0, due_s - time.monotonic()))
            if time.monotonic() >= due_s:
                self._send_emergency()
                due_s += REPEAT_S

    def _send_emergency(self) -> None:
        """Send the emergency to every client; a client that does not read misses it, one that has left is forgotten."""
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
        """Discard what clients send: closing a socket with unread bytes would discard the last STATUS."""
        ready = select.select(list(self._clients.values()), [], [], within_s)[0]
        for number, client in list(self._clients.items()):
            if client not in ready:
                continue
            try:
                gone = not client.recv(1 << 20)
            except BlockingIOError:
                gone = False
            except OSError:
                gone = True
            if gone:
                self._clients.pop(number).close()


def main() -> None:
    """Run as a process: arguments are the descriptor of the channel, the monitor's process id and `look_s`."""
    channel, pid, look_s = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    run_in_real_time(WATCHDOG_PRIORITY)
    watchdog = Watchdog(socket.socket(fileno=channel), pid, look_s)
    if not watchdog.watch():
        watchdog.alarm()


if __name__ == "__main__":
    main()
