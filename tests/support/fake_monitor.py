"""A monitor for tests of its clients: it answers each image by a rule, over sockets or
on a clock of its own.
"""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import time

from waiting import FUSE_S

from scleraforce.base.errors import LinkError
from scleraforce.live.network.openigtlink import (
    Decoder,
    Image,
    Message,
    PeerEvent,
    Received,
    Sensor,
    Status,
    Text,
    encode,
)

HEARTBEAT_S = 0.05
STATUS = "ForceMonitor"
READING = "ForceReading"
NOT_READY = Status(13, 0, "NOT_READY", "NOT_READY: no good frame yet")
OK = Status(1, 0, "", "WATCHING: class 0")


class MonitorRule:
    """Says OK after each image, until `decide` returns another STATUS for an event
    (None: a client has gone).
    """

    def __init__(
        self, decide: Callable[[object], Status | None] = lambda _: None
    ) -> None:
        self.decide = decide
        self.received: list[PeerEvent | None] = []  # in order only with one sender
        # False: it says nothing any more
        self.answers = True
        self.status = NOT_READY
        self._frames = 0

    def received_of(self, kind: type[Message]) -> list[Received]:
        """Return the events that carry messages of a kind."""
        return [
            event
            for event in self.received
            if isinstance(event, Received) and isinstance(event.message, kind)
        ]

    def take(self, event: PeerEvent | None) -> list[tuple[str, Status | Text | Sensor]]:
        """Take an event; return the devices and the messages that answer it."""
        self.received.append(event)
        decided = self.decide(event)
        image = isinstance(event, Received) and isinstance(event.message, Image)
        if self.status.code != 3:
            self.status = decided or (OK if image else self.status)

        said: list[tuple[str, Status | Text | Sensor]] = (
            [(STATUS, self.status)] if decided or image else []
        )
        return said + self._reading(event) if image else said

    def _reading(self, event: Received) -> list[tuple[str, Status | Text | Sensor]]:
        self._frames += 1
        frame_id = event.message_id or int(event.header.time_s * 1e6)
        reading = {
            "event": "frame",
            "frame": self._frames,
            "frame_id": frame_id,
            "class": 0,
            "lost": 0,
        }
        reading |= {"force_mn": 1.5, "interval_mn": [0.5, 2.5]}

        return [
            (READING, Text(json.dumps(reading))),
            (READING, Sensor((float(self._frames),))),
        ]


class FakeMonitor(MonitorRule):
    """The rule behind a socket."""

    def __init__(
        self, decide: Callable[[object], Status | None] = lambda _: None
    ) -> None:
        super().__init__(decide)
        self.reads = True  # False: it reads nothing any more, for good
        self._peers: dict[socket.socket, int] = {}
        self._lock = threading.RLock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._accept, self._beat)
        ]

        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        return self._listener.getsockname()[1]

    def say(self, status: Status) -> None:
        with self._lock:
            self.status = status
            self._tell(self.status, STATUS)

    def say_bytes(self, data: bytes) -> None:
        with self._lock:
            for peer in list(self._peers):
                with suppress(OSError):
                    peer.sendall(data)

    def drop(self) -> None:
        """Close all connections."""
        with self._lock:
            for peer in list(self._peers):
                with suppress(OSError):
                    peer.shutdown(socket.SHUT_RDWR)  # its thread closes it
            self._peers.clear()

    def close(self) -> None:
        self._ended.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)

        self._listener.close()
        self._threads[0].join(FUSE_S)  # nobody comes any more
        self.drop()
        for thread in self._threads:
            thread.join(FUSE_S)

    def _accept(self) -> None:
        with suppress(OSError):
            while not self._ended.is_set():
                peer, _ = self._listener.accept()
                with self._lock:
                    self._peers[peer] = 1

                self._threads.append(
                    threading.Thread(target=self._serve, args=(peer,), daemon=True)
                )
                self._threads[-1].start()

    def _beat(self) -> None:
        while not self._ended.wait(HEARTBEAT_S):  # the pace of a real one
            with self._lock:
                self._tell(self.status, STATUS)

    def _serve(self, peer: socket.socket) -> None:
        decoder = Decoder()
        with suppress(OSError):
            while not decoder.broken and not self._ended.is_set():
                if not self.reads:
                    self._ended.wait()
                    break

                data = peer.recv(1 << 18)
                if not data:
                    break

                for event in decoder.feed(data):
                    self._take(peer, event)

        try:
            self._take(peer, None)
        finally:
            with self._lock:
                self._peers.pop(peer, None)

            peer.close()

    def _take(self, peer: socket.socket, event: PeerEvent | None) -> None:
        with self._lock:
            if isinstance(event, Received):
                self._peers[peer] = event.header.version
            for device, message in self.take(event):
                self._tell(message, device)

    def _tell(self, message: Status | Text | Sensor, device: str) -> None:
        if not self.answers:
            return
        for peer, version in list(self._peers.items()):
            with suppress(OSError):
                peer.sendall(encode(message, device, version=version, time_s=time()))


@contextmanager
def fake_monitor(
    decide: Callable[[object], Status | None] = lambda _: None,
) -> Iterator[FakeMonitor]:
    monitor = FakeMonitor(decide)
    try:
        yield monitor
    finally:
        monitor.close()


class ClockedClient:
    """In place of a `ScannerClient`, beside a monitor that answers at once; a test may
    move its time `now_s` on.
    """

    address = "clocked"

    def __init__(
        self, monitor: MonitorRule, hear: Callable[[float, str, Message], object]
    ) -> None:
        self.monitor = monitor
        self._hear = hear
        self._decoder = Decoder()
        # True: the monitor closes the connection
        self.now_s = 1000.0
        self.dropped = False
        self._beat_s = self.now_s
        self._scans = True
        self._said: list[tuple[str, Message]] = []

    def clock(self) -> float:
        return self.now_s

    def send(self, data: bytes | bytearray) -> float:
        if not self._scans:
            raise LinkError(f"{self.address}: the monitor has closed the connection")

        for event in self._decoder.feed(bytes(data)):
            self._say(event)

        if self._decoder.broken:
            self.disconnect()
        return self.now_s

    def listen(self, until_s: float, done: Callable[[], bool] = lambda: False) -> None:
        self._beat()
        while not done() and self.now_s < until_s:
            self.now_s = min(until_s, self._beat_s)
            self._beat()

    def disconnect(self) -> None:
        if self._scans:
            self._scans = False
            self._say(None)

    def close(self) -> None:
        self._scans = False

    def _say(self, event: object) -> None:
        said = self.monitor.take(event)
        self._said += said if self.monitor.answers else []

    def _beat(self) -> None:
        """Say the heartbeats that are due, and hear what was said."""
        while self._beat_s <= self.now_s:
            self._said += (
                [(STATUS, self.monitor.status)] if self.monitor.answers else []
            )
            self._beat_s += HEARTBEAT_S

        if self.dropped:
            raise LinkError(f"{self.address}: the connection is lost: it was closed")

        said = self._said
        self._said = []
        for device, message in said:
            self._hear(self.now_s, device, message)
