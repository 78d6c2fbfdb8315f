"""A monitor whose reader is a rule (the answer is in the frame's first pixels), its
clock and its clients.
"""

import fcntl
import socket
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from select import select
from threading import RLock, Thread
from time import monotonic, time
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from waiting import FUSE_S, ends, wait_until

from scleraforce.base.units import to_si
from scleraforce.live.companions.companion_processes import Companions, Guard
from scleraforce.live.companions.process_channel import Channel
from scleraforce.live.companions.process_messages import CompanionMessage, Entry
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.connected_clients import ServerSettings
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_server import MonitorServer
from scleraforce.live.monitor_session import MonitorSession
from scleraforce.live.network.openigtlink import (
    Decoder,
    Image,
    Message,
    Received,
    Status,
    Text,
    encode,
)
from scleraforce.reading.answer import Answer, unusable_answer
from scleraforce.reading.eye_reader import EyeReader
from scleraforce.records.eye import Eye
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import Study
from scleraforce.records.verdict import Verdict
from scleraforce.wall.wall import without_wall


class TurnedClock:
    """Seconds since 1970 of a clock that a test moves; one for all threads."""

    def __init__(self, now_s: float = 1.8e9) -> None:
        self._now_s = now_s
        self._lock = RLock()

    def __call__(self) -> float:
        with self._lock:
            return self._now_s

    def turn(self, by_s: float) -> None:
        """Let time pass."""
        with self._lock:
            self._now_s += by_s

    @contextmanager
    def held(self) -> Iterator[None]:
        """Let other threads wait where they look at the clock: what is sent meanwhile
        has then arrived.
        """
        with self._lock:
            yield


ROWS = 64
COLUMNS = 96
SCALE_M = (20e-6, 10e-6)
TOKEN = "c0ffee"
UNUSABLE = 60001
RAISES = 60002
NO_NUMBER = 60003
HANGS = 60004


def frame_of(force_un: int, serial: int) -> NDArray[np.uint16]:
    """A frame that reads as a force in uN; `serial` makes it differ from others."""
    pixels = np.zeros((ROWS, COLUMNS), dtype=np.uint16)
    pixels[0, :2] = force_un, serial % 65536
    return pixels


def read(pixels: NDArray[Any], _: PixelScale) -> Answer:
    force_un = int(pixels[0, 0])
    wall = without_wall(pixels.shape, "no wall was found")
    if force_un == RAISES:
        raise RuntimeError("the reader broke")

    while force_un == HANGS:
        pass

    if force_un == UNUSABLE:
        return replace(unusable_answer(3, "no wall was found"), segmentation=wall)

    force_n = float("nan") if force_un == NO_NUMBER else force_un * 1e-6
    predicted = int(force_n > 5e-3) + int(force_n > 30e-3)
    shares = tuple(float(number == predicted) for number in range(3))
    interval_n = (0.95 * force_n - 0.5e-3, 1.05 * force_n + 0.5e-3)

    return Answer(
        predicted=predicted,
        probabilities=shares,
        usable=True,
        reason=None,
        force_n=force_n,
        interval_n=interval_n,
        segmentation=wall,
    )


def reader_of(
    rule: Callable[[NDArray[Any], PixelScale], Answer],
    setup: Setup = NOTHING_KNOWN,
    stiffness_n_m: Callable[[], float | None] = lambda: None,
) -> EyeReader:
    """A reader of an eye whose network is a rule, which can read every eye."""
    model: Any = SimpleNamespace(
        study=Study(),
        read_live=lambda pixels, scale, _: rule(pixels, scale),
        refusal=lambda _: None,
        steepest_n_m=lambda _: stiffness_n_m(),
    )
    return EyeReader(model, setup, by="network")


def small_server(
    guard: Guard,
    companions: Companions,
    note: Callable[[str], None] = lambda _: None,
    *,
    clock: TurnedClock | None = None,
    borne_s: float = 0.5,
    catch_up_s: float | None = None,
    stalled_s: float = 600.0,
    planes: tuple[str, ...] = (),
    **settings: Any,
) -> tuple[MonitorServer, int]:
    """A server of small frames, and its port; without a clock of the test it needs to
    bear what holds a test up.
    """
    limits = MonitorLimits(
        size=(ROWS, COLUMNS),
        scale_m=SCALE_M,
        silence_s=borne_s,
        lag_s=borne_s,
        catch_up_s=catch_up_s or borne_s,
    )
    listener = socket.create_server(("127.0.0.1", 0))
    ring = FrameRing.create(100, ROWS, COLUMNS)
    reader = reader_of(read)
    readers = dict.fromkeys(planes, reader) or reader
    session = (
        MonitorSession(readers, limits, clock, clock)
        if clock
        else MonitorSession(readers, limits)
    )
    stated = ServerSettings(TOKEN, stalled_s=stalled_s, **settings)
    server = MonitorServer(session, listener, stated, ring, guard, companions, note)

    return server, listener.getsockname()[1]


def main() -> None:
    guard = Guard(float(sys.argv[1]))
    server, port = small_server(guard, Companions({}), borne_s=600.0)

    def wait() -> None:
        sys.stdin.read()
        server.stop()

    threading.Thread(target=wait, daemon=True).start()
    sys.stdout.write(f"{port} {guard.pid}\n")
    sys.stdout.flush()
    server.run()
    server.close()
    guard.end()


if __name__ == "__main__":
    main()


def verdict(
    force_mn: float | None = None,
    interval_mn: tuple[float, float] | None = None,
    predicted: int = 1,
    **said: Any,
) -> Verdict:
    """A usable verdict with a force in mN; `said` are other attributes."""
    others: dict[str, Any] = {
        "probabilities": (0.0, 0.75, 0.25),
        "usable": True,
        "reason": None,
        **said,
    }
    force_n = None if force_mn is None else to_si(force_mn, "mn")
    interval_n = interval_mn and (
        to_si(interval_mn[0], "mn"),
        to_si(interval_mn[1], "mn"),
    )

    return Verdict(
        predicted=predicted, force_n=force_n, interval_n=interval_n, **others
    )


TICK_ENTRY = Entry(
    number=1,
    time_s=1.8e9,
    at_s=12.5,
    event="tick",
    state="NOT_READY",
    code=13,
    sub_code=0,
    cause=None,
    message="no good frame yet",
)
READ_ENTRY = Entry(
    number=3,
    time_s=1.8e9,
    at_s=12.5,
    event="frame",
    state="WATCHING",
    code=1,
    sub_code=0,
    cause=None,
    message="OK:\n“12 mN”",
    frame=3,
    frame_id=77,
    verdict=verdict(12.5, (11.0, 13.5)),
    latency_ms=0.75,
    lost=2,
    time_to_bound_ms=900.0,
    time_to_bound_ms_interval=(310.5, None),
)
OF_VERDICT = (
    "force_mn",
    "interval_mn",
    "predicted",
    "probabilities",
    "usable",
    "reason",
)


def decision(state: str = "WATCHING", **said: Any) -> Entry:
    """A decision; `said` are attributes of the entry and of its verdict, which exists
    if one of its own is given.
    """
    read = {name: said.pop(name) for name in OF_VERDICT if name in said}
    others = {"event": "frame", "state": state, "code": 1, "message": "x", **said}
    return replace(TICK_ENTRY, verdict=verdict(**read) if read else None, **others)


INFO = RecordingInfo(
    Eye("eye", thickness_m=600e-6, iop_pa=266.0),
    Scan(
        columns=32,
        rows=24,
        bits=16,
        width_m=15e-3,
        depth_m=4e-3,
        tilt_rad=0.0,
        refractive_index=1.0,
    ),
    Needle(diameter_m=gauge_diameter_m(22), gap_m=0.5e-3),
    ForceInfo("fz", -1, 0.2),
)


class FakeCompanion:
    """In place of a `Child`: `theirs` is its end of the channel."""

    def __init__(self) -> None:
        self.channel, self.theirs = Channel.pair()

    def says(self, message: CompanionMessage) -> None:
        assert self.theirs.send(message)

    def end(self) -> None:
        self.channel.close()
        self.theirs.close()


MATRIX = (
    SCALE_M[0] * 1e3,
    0.0,
    0.0,
    0.0,
    SCALE_M[1] * 1e3,
    0.0,
    0.0,
    0.0,
    1.0,
    0.0,
    0.0,
    0.0,
)
SERIALS = count(1)
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

    def watch(self, client: int, descriptor: int) -> None: ...
    def version(self, client: int, version: int) -> None: ...
    def forget(self, client: int) -> None: ...
    def beat(self, now_s: float) -> None: ...


@contextmanager
def serving(companions: Companions | None = None, **settings: Any) -> Iterator[int]:
    """Run a small server in a thread until the block ends; yield its port.

    Its time is from `clock`, by default one that does not move; `clock=None` is the
    machine's.
    """
    settings.setdefault("clock", TurnedClock())
    server, port = small_server(NoGuard(), companions or Companions({}), **settings)  # type: ignore[arg-type]
    thread = Thread(target=server.run, daemon=True)
    thread.start()

    try:
        yield port
    finally:
        server.stop()
        thread.join(FUSE_S)
        server.close()


@contextmanager
def small_monitor(
    errors: int | None = None, look_s: float = LOOK_S
) -> Iterator[Running]:
    """Run a small monitor, with its watchdog, in a process of its own until the block
    ends; `errors` is its fd 2.
    """
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
        with ends(process.stdout, FUSE_S):
            port, watchdog_pid = map(int, process.stdout.readline().split())

        yield Running(process, port, watchdog_pid)
    finally:
        process.stdin.close()
        process.wait(FUSE_S)
        process.stdout.close()


class Peer:
    """One connection; `heard` has (device, message) of all that came. With a clock, a
    frame comes every 10 ms of it.

    While a peer hears, all receive, each into its `arrived`: the server drops messages
    to a client that does not read, some 5 kB after the last that its system has
    acknowledged, which may take that 40 ms.
    """

    connected: ClassVar[set["Peer"]] = set()

    def __init__(
        self, port: int, version: int = 1, clock: TurnedClock | None = None
    ) -> None:
        self.link = socket.create_connection(("127.0.0.1", port), timeout=FUSE_S)
        self.clock = clock
        self.closed = False
        self.version = version
        self.heard = list[tuple[str, Message]]()
        self.decoder = Decoder()
        self.versions: set[int] = set()
        self.arrived: list[bytes] = []
        self.connected.add(self)

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.connected.discard(self)
        self.link.close()

    def fileno(self) -> int:
        return self.link.fileno()

    def say(
        self,
        message: Message,
        device: str = "Scanner",
        time_s: float | None = None,
        message_id: int = 0,
    ) -> None:
        if self.clock and isinstance(message, Image):
            self.clock.turn(FRAME_S)
        stamp = (self.clock or time)() if time_s is None else time_s
        self.link.sendall(
            encode(
                message,
                device,
                version=self.version,
                time_s=stamp,
                message_id=message_id,
            )
        )

    def deliver(self) -> None:
        """Wait until all that was sent is where the server looks: on a busy machine the
        system may take its time.
        """
        wait_until(lambda: not any(fcntl.ioctl(self.link, termios.TIOCOUTQ, bytes(4))))

    def show(
        self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: Any
    ) -> None:
        """Send a frame that reads as a force."""
        pixels = (
            frame_of(round(force_mn * 1e3), next(SERIALS)) if pixels is None else pixels
        )
        self.say(Image(pixels[None], MATRIX), **header)

    def read(
        self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: Any
    ) -> None:
        """Send a frame and wait until it is answered."""
        before = self.readings()
        self.show(force_mn, pixels, **header)
        self.hear(lambda peer: peer.readings() > before)
        assert self.readings() > before, "a frame was not answered"

    def hear(
        self,
        done: Callable[["Peer"], bool] = lambda _: False,
        within_s: float | None = None,
    ) -> None:
        """Take what comes until `done`; a closed connection ends it as well, or a time
        that is given.
        """
        end_s = monotonic() + (FUSE_S if within_s is None else within_s)
        while (
            not done(self) and not self.closed and (left_s := end_s - monotonic()) > 0
        ):
            if not self.arrived:
                for peer in select([*self.connected], [], [], left_s)[0]:
                    peer._receive()
            arrived = self.arrived
            self.arrived = []

            for data in arrived:
                self.closed = not data
                for event in self.decoder.feed(data):
                    assert isinstance(event, Received)
                    self.versions.add(event.header.version)
                    self.heard.append((event.header.device, event.message))

        assert within_s is not None or self.closed or done(self), (
            f"{self.readings()} readings, {self.statuses()[-1:]}"
        )

    def _receive(self) -> None:
        """Take what has come from the system; nothing at the end of the connection."""
        try:
            data = self.link.recv(1 << 16)
        except ConnectionResetError:
            data = b""

        self.arrived.append(data)
        if not data:
            self.connected.discard(self)

    def statuses(self) -> list[Status]:
        return [message for _, message in self.heard if isinstance(message, Status)]

    def texts(self, device: str = "ForceReading") -> list[Text]:
        return [
            message
            for name, message in self.heard
            if isinstance(message, Text) and name == device
        ]

    def readings(self) -> int:
        """Return how many frames were read so far."""
        return len(self.texts())

    def wait_for_code(self, code: int) -> Status:
        """Return the first STATUS of a code that comes from now on."""
        since = len(self.statuses())
        self.hear(
            lambda peer: any(status.code == code for status in peer.statuses()[since:])
        )
        found = [status for status in self.statuses()[since:] if status.code == code]
        assert found, f"no STATUS {code} came, but {self.statuses()[since:]}"

        return found[0]

    def watch(self, force_mn: float = 10.0, frames: int = 12) -> None:
        """Send harmless frames in contact, each when the last one was answered, until
        the monitor watches.
        """
        for number in range(frames):
            self.read(force_mn + 0.01 * (number % 3))
        assert self.statuses()[-1].code == 1, self.statuses()[-1]

    def watch_until(self, code: int) -> Status:
        """Send harmless frames until the monitor says a code; return that STATUS."""
        since = len(self.statuses())
        while not (
            found := [
                status for status in self.statuses()[since:] if status.code == code
            ]
        ):
            self.read(10.0)

        return found[0]
