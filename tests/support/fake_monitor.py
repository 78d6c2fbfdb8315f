"""A monitor for tests of its clients: answers every image and does what a test tells it to; a thread for each peer."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import time

from scleraforce.openigtlink import (
    BadChecksum,
    Decoder,
    Image,
    Malformed,
    Received,
    Sensor,
    Status,
    Text,
    encode,
)

__all__ = ["HEARTBEAT_S", "NOT_READY", "OK", "FakeMonitor", "MonitorRule", "fake_monitor"]

HEARTBEAT_S = 0.05
STATUS, READING = "ForceMonitor", "ForceReading"
NOT_READY, OK = Status(13, 0, "NOT_READY", "NOT_READY: no good frame yet"), Status(1, 0, "", "WATCHING: class 0")


class MonitorRule:
    """Says OK after each image, until `decide` returns another STATUS for it; then that one, for ever.

    Attributes:
        decide: called with each event of a client's stream (None: it has gone); a STATUS is a withdrawal.
        received: events that came, in order; of one thread at a time only in tests with one sender.
        status: said with each answer, and with each heartbeat.
        answers: False: it says nothing any more.
    """

    def __init__(self, decide: Callable[[object], Status | None] = lambda _: None) -> None:
        self.decide = decide
        self.received: list[Received | BadChecksum | Malformed | None] = []
        self.answers, self.status = True, NOT_READY
        self._frames = 0

    def take(self, event: Received | BadChecksum | Malformed | None) -> list[tuple[str, Status | Text | Sensor]]:
        """Take an event; return the devices and the messages that answer it."""
        self.received.append(event)
        decided = self.decide(event)
        image = isinstance(event, Received) and isinstance(event.message, Image)
        if self.status.code != 3:
            self.status = decided or (OK if image else self.status)
        said: list[tuple[str, Status | Text | Sensor]] = [(STATUS, self.status)] if decided or image else []
        return said + self._reading(event) if image else said

    def _reading(self, event: Received) -> list[tuple[str, Status | Text | Sensor]]:
        self._frames += 1
        reading = {
            "event": "frame",
            "frame": self._frames,
            "frame_id": event.message_id or int(event.header.time_s * 1e6),
            "class": 0,
            "force_mn": 1.5,
            "interval_mn": [0.5, 2.5],
            "lost": 0,
        }
        return [(READING, Text(json.dumps(reading))), (READING, Sensor((float(self._frames),)))]


class FakeMonitor(MonitorRule):
    """The rule behind a socket.

    Attributes:
        reads: False: it reads nothing any more.
    """

    def __init__(self, decide: Callable[[object], Status | None] = lambda _: None) -> None:
        super().__init__(decide)
        self.reads = True
        self._peers: dict[socket.socket, int] = {}
        self._lock = threading.RLock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._accept, self._beat)]
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
        self._threads[0].join()  # nobody comes any more
        self.drop()
        for thread in self._threads:
            thread.join(5.0)

    def _accept(self) -> None:
        with suppress(OSError):
            while not self._ended.is_set():
                peer, _ = self._listener.accept()
                with self._lock:
                    self._peers[peer] = 1
                self._threads.append(threading.Thread(target=self._serve, args=(peer,), daemon=True))
                self._threads[-1].start()

    def _beat(self) -> None:
        while not self._ended.wait(HEARTBEAT_S):
            with self._lock:
                self._tell(self.status, STATUS)

    def _serve(self, peer: socket.socket) -> None:
        decoder = Decoder()
        with suppress(OSError):
            while not decoder.broken and not self._ended.is_set():
                if not self.reads:
                    self._ended.wait(0.01)
                    continue
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

    def _take(self, peer: socket.socket, event: Received | BadChecksum | Malformed | None) -> None:
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
def fake_monitor(decide: Callable[[object], Status | None] = lambda _: None) -> Iterator[FakeMonitor]:
    monitor = FakeMonitor(decide)
    try:
        yield monitor
    finally:
        monitor.close()
