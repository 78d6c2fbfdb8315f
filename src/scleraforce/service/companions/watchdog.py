"""The watchdog: a process that tells the clients to withdraw when the monitor hangs or has died.

It holds duplicates of the clients' sockets. If no sign of life comes for `MISSES` looks of `LOOK_S`, it kills the
monitor (which might otherwise go on later and say OK) and sends the emergency STATUS to all clients, every `REPEAT_S`,
until the last one has left. A pause of the whole machine counts as one look. The process uses the standard library
alone, so that it starts before the model is loaded. `watchdog_messages` says what the monitor tells it.
"""

import os
import select
import signal
import socket
import sys
import time
from contextlib import suppress

from scleraforce.errors import MessageError
from scleraforce.service.companions.watchdog_messages import (
    ALIVE,
    MOST_BYTES,
    Beat,
    ClientCame,
    ClientLeft,
    ClientSpeaks,
    Emergency,
    PlannedEnd,
    WatchdogMessage,
    unpack_for_watchdog,
)
from scleraforce.service.priority import WATCHDOG_PRIORITY, run_in_real_time
from scleraforce.service.stamp import stamp_time

LOOK_S = 0.02
MISSES = 5
REPEAT_S = 0.05


class Watchdog:
    """The watchdog's clients, and the messages to send them.

    Args:
        monitor: the channel to the monitor.
        monitor_pid: process to kill if it hangs.
        look_s: time between two looks.
    """

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
        told = len(self._clients)
        self._tell()
        said = f"watchdog: the monitor hung or died and was ended; clients told to withdraw: {told}\n"
        with suppress(OSError):  # standard error never blocks: see `start_companion`
            os.write(2, said.encode())
        due_s = started_s + REPEAT_S
        while self._clients:
            self._drain(max(0.0, due_s - time.monotonic()))
            if time.monotonic() >= due_s:
                self._tell()
                due_s += REPEAT_S

    def _tell(self) -> None:
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
