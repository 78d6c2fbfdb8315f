"""A client of the monitor that tests use: plain sockets, the codec, and a wait with an end."""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from threading import Thread
from time import monotonic, sleep, time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from small_monitor import SCALE_M, frame_of, small_server

from scleraforce.openigtlink import Decoder, Image, Message, Received, Status, Text, encode
from scleraforce.service.companions.companions import Companions

MATRIX = (SCALE_M[0] * 1e3, 0.0, 0.0, 0.0, SCALE_M[1] * 1e3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
SERIALS = count(1)


@dataclass(frozen=True)
class Running:
    """A small monitor that runs."""

    process: subprocess.Popen[str]
    port: int
    watchdog_pid: int


class NoGuard:
    """In place of the watchdog, which would kill this process."""

    def watch(self, client: object) -> None: ...
    def version(self, client: object) -> None: ...
    def forget(self, client: object) -> None: ...
    def beat(self, now_s: float) -> None: ...


@contextmanager
def serving(companions: Companions | None = None, **settings: Any) -> Iterator[int]:
    """Run a small server in a thread until the block ends; what it gives is its port."""
    server, port = small_server(NoGuard(), companions or Companions({}), **settings)  # type: ignore[arg-type]
    thread = Thread(target=server.run)
    thread.start()
    try:
        yield port
    finally:
        server.stop()
        thread.join()
        server.close()


@contextmanager
def small_monitor(errors: int | None = None) -> Iterator[Running]:
    """Run a small monitor, with its watchdog, in a process of its own until the block ends; `errors` is its fd 2."""
    script = Path(__file__).with_name("small_monitor.py")
    process = subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
    )
    assert process.stdin
    assert process.stdout
    try:
        port, watchdog_pid = map(int, process.stdout.readline().split())
        yield Running(process, port, watchdog_pid)
    finally:
        process.stdin.close()
        process.wait(10.0)
        process.stdout.close()


class Peer:
    """One connection; `heard` has (device, message) of all that came."""

    def __init__(self, port: int, version: int = 1) -> None:
        self.link = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.version, self.heard, self.decoder = version, list[tuple[str, Message]](), Decoder()
        self.versions: set[int] = set()

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def say(self, message: Message, device: str = "Scanner", time_s: float | None = None, message_id: int = 0) -> None:
        stamp = time() if time_s is None else time_s
        self.link.sendall(encode(message, device, version=self.version, time_s=stamp, message_id=message_id))

    def show(self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: float) -> None:
        """Send a frame that reads as a force."""
        pixels = frame_of(round(force_mn * 1e3), next(SERIALS)) if pixels is None else pixels
        self.say(Image(pixels[None], MATRIX), **header)  # type: ignore[arg-type]

    def hear(self, within_s: float, done: Callable[["Peer"], bool] = lambda _: False) -> None:
        """Take what comes until `done` or the time is over; a closed connection ends it as well."""
        end_s = monotonic() + within_s
        while not done(self) and (left_s := end_s - monotonic()) > 0:
            self.link.settimeout(left_s)
            try:
                data = self.link.recv(1 << 16)
            except TimeoutError:
                return
            if not data:
                return
            for event in self.decoder.feed(data):
                assert isinstance(event, Received)
                self.versions.add(event.header.version)
                self.heard.append((event.header.device, event.message))

    def statuses(self) -> list[Status]:
        return [message for _, message in self.heard if isinstance(message, Status)]

    def readings(self) -> int:
        """Return how many frames were read so far."""
        return sum(isinstance(message, Text) for _, message in self.heard)

    def wait_for_code(self, code: int, within_s: float = 10.0) -> Status:
        """Return the first STATUS of a code that comes from now on."""
        since = len(self.statuses())
        self.hear(within_s, lambda peer: any(status.code == code for status in peer.statuses()[since:]))
        found = [status for status in self.statuses()[since:] if status.code == code]
        assert found, f"no STATUS {code} came, but {self.statuses()[since:]}"
        return found[0]

    def watch(self, force_mn: float = 10.0, frames: int = 12) -> None:
        """Send harmless frames in contact, each when the last one was answered, until the monitor watches."""
        for number in range(frames):
            read = self.readings()
            self.show(force_mn + 0.01 * (number % 3))
            self.hear(10.0, lambda peer: peer.readings() > read)  # noqa: B023 - called at once
        assert self.statuses()[-1].code == 1, self.statuses()[-1]


def wait_until(holds: Callable[[], bool], within_s: float = 10.0) -> None:
    end_s = monotonic() + within_s
    while not holds():
        assert monotonic() < end_s, "it did not come about"
        sleep(0.01)


__all__ = ["MATRIX", "Peer", "Running", "serving", "small_monitor", "wait_until"]
