"""A client of the monitor that tests use: plain sockets, the codec, and a wait for what comes."""

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
from turned_clock import TurnedClock

from scleraforce.openigtlink import Decoder, Image, Message, Received, Status, Text, encode
from scleraforce.service.companions.companions import Companions

MATRIX = (SCALE_M[0] * 1e3, 0.0, 0.0, 0.0, SCALE_M[1] * 1e3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
SERIALS = count(1)
FUSE_S = 300.0  # nothing takes so long, on any machine: what has not come by then never will
FRAME_S = 0.01  # between two frames of a scanner
LOOK_S = 6.0  # of a watchdog that no busy machine makes impatient


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
    """Run a small server in a thread until the block ends; what it gives is its port.

    Its time is that of a `clock`, by default of one that stands still; `clock=None` is the machine's.
    """
    settings.setdefault("clock", TurnedClock())
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
def small_monitor(errors: int | None = None, look_s: float = LOOK_S) -> Iterator[Running]:
    """Run a small monitor, with its watchdog, in a process of its own until the block ends; `errors` is its fd 2."""
    script = Path(__file__).with_name("small_monitor.py")
    process = subprocess.Popen(
        [sys.executable, str(script), str(look_s)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )
    assert process.stdin
    assert process.stdout
    try:
        port, watchdog_pid = map(int, process.stdout.readline().split())
        yield Running(process, port, watchdog_pid)
    finally:
        process.stdin.close()
        process.wait(FUSE_S)
        process.stdout.close()


class Peer:
    """One connection; `heard` has (device, message) of all that came. With a clock, a frame comes every 10 ms of it."""

    def __init__(self, port: int, version: int = 1, clock: TurnedClock | None = None) -> None:
        self.link = socket.create_connection(("127.0.0.1", port), timeout=FUSE_S)
        self.clock, self.closed = clock, False
        self.version, self.heard, self.decoder = version, list[tuple[str, Message]](), Decoder()
        self.versions: set[int] = set()

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()

    def say(self, message: Message, device: str = "Scanner", time_s: float | None = None, message_id: int = 0) -> None:
        if self.clock and isinstance(message, Image):
            self.clock.turn(FRAME_S)
        stamp = (self.clock or time)() if time_s is None else time_s
        self.link.sendall(encode(message, device, version=self.version, time_s=stamp, message_id=message_id))

    def show(self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: float) -> None:
        """Send a frame that reads as a force."""
        pixels = frame_of(round(force_mn * 1e3), next(SERIALS)) if pixels is None else pixels
        self.say(Image(pixels[None], MATRIX), **header)  # type: ignore[arg-type]

    def read(self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: float) -> None:
        """Send a frame and wait until it is answered."""
        before = self.readings()
        self.show(force_mn, pixels, **header)
        self.hear(lambda peer: peer.readings() > before)

    def hear(self, done: Callable[["Peer"], bool] = lambda _: False, within_s: float = FUSE_S) -> None:
        """Take what comes until `done` or the time is over; a closed connection ends it as well."""
        end_s = monotonic() + within_s
        while not done(self) and (left_s := end_s - monotonic()) > 0:
            self.link.settimeout(left_s)
            try:
                data = self.link.recv(1 << 16)
            except TimeoutError:
                return
            except ConnectionResetError:
                data = b""
            if not data:
                self.closed = True
                return
            for event in self.decoder.feed(data):
                assert isinstance(event, Received)
                self.versions.add(event.header.version)
                self.heard.append((event.header.device, event.message))

    def statuses(self) -> list[Status]:
        return [message for _, message in self.heard if isinstance(message, Status)]

    def texts(self) -> list[Text]:
        return [message for _, message in self.heard if isinstance(message, Text)]

    def readings(self) -> int:
        """Return how many frames were read so far."""
        return len(self.texts())

    def wait_for_code(self, code: int) -> Status:
        """Return the first STATUS of a code that comes from now on."""
        since = len(self.statuses())
        self.hear(lambda peer: any(status.code == code for status in peer.statuses()[since:]))
        found = [status for status in self.statuses()[since:] if status.code == code]
        assert found, f"no STATUS {code} came, but {self.statuses()[since:]}"
        return found[0]

    def watch(self, force_mn: float = 10.0, frames: int = 12) -> None:
        """Send harmless frames in contact, each when the last one was answered, until the monitor watches."""
        for number in range(frames):
            self.read(force_mn + 0.01 * (number % 3))
        assert self.statuses()[-1].code == 1, self.statuses()[-1]

    def watch_until(self, code: int) -> Status:
        """Send harmless frames until the monitor says a code; return that STATUS."""
        since = len(self.statuses())
        while not (found := [status for status in self.statuses()[since:] if status.code == code]):
            self.read(10.0)
        return found[0]


def wait_until(holds: Callable[[], bool]) -> None:
    end_s = monotonic() + FUSE_S
    while not holds():
        assert monotonic() < end_s, "it did not come about"
        sleep(0.01)


__all__ = ["FRAME_S", "FUSE_S", "MATRIX", "Peer", "Running", "serving", "small_monitor", "wait_until"]
