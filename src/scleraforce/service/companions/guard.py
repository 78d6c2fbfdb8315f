"""The monitor's side of the watchdog: it starts it, passes it the clients, and sends it signs of life."""

import os
import socket
import subprocess

from scleraforce.monitor.causes import Cause
from scleraforce.openigtlink import Status, encode
from scleraforce.service.companions.channel import start_companion
from scleraforce.service.companions.watchdog import (
    ALIVE,
    LOOK_S,
    Beat,
    ClientCame,
    ClientLeft,
    ClientSpeaks,
    Emergency,
    PlannedEnd,
    WatchdogMessage,
    pack_for_watchdog,
)
from scleraforce.service.connection import Connection
from scleraforce.service.stamp import STATUS_DEVICE

BEAT_LOOKS = 0.5  # 10 ms
SILENT_LOOKS = 25  # half a second: a watchdog that answers later than this counts as failed
START_S = 20.0
EMERGENCY = Status(3, Cause.WATCHDOG.value, Cause.WATCHDOG.name, "WITHDRAW: the monitor hung or died")


class Guard:
    """The watchdog process, from the monitor's side.

    Args:
        look_s: time between two looks of the watchdog.

    Raises:
        OSError: the watchdog does not start.
    """

    def __init__(self, look_s: float = LOOK_S) -> None:
        self._beat_s, self._silent_s = BEAT_LOOKS * look_s, SILENT_LOOKS * look_s
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        arguments = [str(theirs.fileno()), str(os.getpid()), str(look_s)]
        self._process = start_companion("scleraforce.service.companions.watchdog", arguments, [theirs.fileno()])
        theirs.close()
        self._fault: str | None = None
        self._beaten_s = self._answered_s = 0.0
        self._channel.settimeout(START_S)
        if self._channel.recv(16) != ALIVE:
            raise OSError("the watchdog did not start")
        self._channel.setblocking(False)
        for version in (1, 2, 3):
            self._send(Emergency(version=version, status=encode(EMERGENCY, STATUS_DEVICE, version=version)))

    @property
    def pid(self) -> int:
        """Id of the watchdog's process."""
        return self._process.pid

    def watch(self, client: Connection) -> None:
        """Pass it a client's socket."""
        self._send(ClientCame(client=client.number), client.fileno())

    def version(self, client: Connection) -> None:
        """Tell it the header version of a client."""
        self._send(ClientSpeaks(client=client.number, version=client.version))

    def forget(self, client: Connection) -> None:
        """Let it close its duplicate of a client's socket."""
        self._send(ClientLeft(client=client.number))

    def beat(self, now_s: float) -> str | None:
        """Send a sign of life, and look for the watchdog's; call it every few ms.

        Returns:
            What is wrong with the watchdog; None if it watches.
        """
        if now_s - self._beaten_s < self._beat_s:
            return self._fault
        if now_s - self._beaten_s > self._silent_s:  # the first time, or after a pause of this process
            self._answered_s = now_s
        self._beaten_s = now_s
        self._send(Beat())
        self._hear(now_s)
        if self._fault is None and now_s - self._answered_s > self._silent_s:
            return f"the watchdog has not answered for {self._silent_s:g} s"
        return self._fault

    def end(self) -> None:
        """End the watchdog, before the monitor ends."""
        self._send(PlannedEnd())
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._channel.close()  # not earlier: closing it with unread answers would discard the message

    def _send(self, message: WatchdogMessage, descriptor: int | None = None) -> None:
        data = pack_for_watchdog(message)
        try:
            socket.send_fds(self._channel, [data], [] if descriptor is None else [descriptor])
        except BlockingIOError:
            self._fault = self._fault or "the watchdog does not keep up"
        except OSError:
            self._fault = "the watchdog has died"

    def _hear(self, now_s: float) -> None:
        try:
            while self._fault is None:
                if not self._channel.recv(16):
                    self._fault = "the watchdog has died"
                self._answered_s = now_s
        except BlockingIOError:
            pass
        except OSError:
            self._fault = "the watchdog has died"
