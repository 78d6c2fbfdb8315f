"""A monitor that reads the force from a frame's first pixels, its clock and its
clients.

`run_small` starts the real monitor by `run_monitor` and replaces its watchdog, its
other processes and its clock. No other file of the tests names these parts.
"""

import fcntl
import json
import socket
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from queue import SimpleQueue
from select import select
from shutil import rmtree
from tempfile import mkdtemp
from threading import RLock, Thread
from time import monotonic, time
from types import MappingProxyType, SimpleNamespace
from typing import Any, ClassVar, TypeVar
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from waiting import FUSE_S, ends, wait_until

from scleraforce.base.units import to_si
from scleraforce.live import monitor, monitor_run
from scleraforce.live.companions.companion_processes import (
    OPINION,
    Companions,
    Guard,
)
from scleraforce.live.companions.process_channel import Channel
from scleraforce.live.companions.process_messages import (
    Alive,
    CompanionMessage,
    Decided,
    Entry,
)
from scleraforce.live.connected_clients import ServerSettings
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_request import LOCAL, Address
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
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.reading.answer import Answer, unusable_answer
from scleraforce.records.eye import Eye
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import PixelScale, Plane, Scan
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


Rule = Callable[[NDArray[Any], PixelScale], Answer]


def reader_of(rule: Rule, learned_n_m: float | None) -> Any:
    """A model whose network is a rule, which can read every eye."""
    return SimpleNamespace(
        path=Path("rule"),
        name="rule",
        words="rule",
        bounds_mn=[5.0, 30.0],
        reads_force=True,
        study=Study(),
        read_live=lambda pixels, scale, _: rule(pixels, scale),
        refusal=lambda _: None,
        steepest_n_m=lambda _: learned_n_m,
    )


OF_CLIENTS = ("clients", "message_s", "stalled_s")


def run_small(
    guard: Any,
    companions: Companions,
    started: Callable[[Address], None],
    when_stopped: Callable[[Callable[[], None]], None] | None = None,
    *,
    rule: Rule = read,
    note: Callable[[str], None] = lambda _: None,
    clock: TurnedClock | None = None,
    planes: tuple[str, ...] = (),
    size: tuple[int, int] = (ROWS, COLUMNS),
    scale_m: tuple[float, float] = SCALE_M,
    setup: Setup = NOTHING_KNOWN,
    learned_n_m: float | None = None,
    child: Callable[..., None] = lambda *_: None,
    stated: Mapping[str, Any] = MappingProxyType({}),
    **limits: Any,
) -> None:
    """Serve small frames until a signal, or until the function passed to
    `when_stopped` is called.

    `limits` are those of the decision and of clients, `stated` other settings. `child`
    receives the arguments of each process that the monitor would start; none starts.
    """
    rows, columns = size
    settings = monitor.MonitorSettings(
        eye="eye-a",
        setup=setup,
        limits=MonitorLimits(
            size=size,
            scale_m=scale_m,
            **{name: limits[name] for name in limits if name not in OF_CLIENTS},
        ),
        scan=Scan(
            columns=columns,
            rows=rows,
            bits=16,
            width_m=columns * scale_m[0],
            depth_m=rows * scale_m[1],
            planes=tuple(Plane(name, 0.0, 0.1 * n) for n, name in enumerate(planes)),
        ),
        address=Address(LOCAL, 0),
        console=None,
        black_box=Path(mkdtemp()),
        record=None,
        token=TOKEN,
    )
    own_folder = settings.black_box
    settings = replace(settings, **stated)
    of_clients = {name: limits[name] for name in limits if name in OF_CLIENTS}
    of_server = partial(ServerSettings, **{"stalled_s": 600.0, **of_clients})
    of_server.clients = ServerSettings.clients  # type: ignore[attr-defined]
    clocks = {"clock": clock, "wall_clock": clock} if clock else {}

    with ExitStack() as stack:
        stack.callback(rmtree, own_folder)
        stack.enter_context(
            patch.multiple(
                monitor,
                Child=child,
                Companions=lambda _: companions,
                Guard=lambda: guard,
                MonitorSession=partial(MonitorSession, **clocks),
                ServerSettings=of_server,
                RING_FRAMES=100,
                run_in_real_time=lambda _: True,
            )
        )
        if when_stopped is not None:  # a thread hears no signals
            stack.enter_context(
                patch.object(
                    monitor_run,
                    "ended_by_signals",
                    lambda stop: nullcontext(when_stopped(stop)),
                )
            )
        reader = reader_of(rule, learned_n_m)
        monitor_run.run_monitor(reader, settings, note, started)


def main() -> None:
    guard = Guard(float(sys.argv[1]))

    def started(address: Address) -> None:
        sys.stdout.write(f"{address.port} {guard.pid}\n")
        sys.stdout.flush()

    patient = {"silence_s": 600.0, "lag_s": 600.0, "catch_up_s": 600.0}
    run_small(guard, Companions({}), started, **patient)


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


Said = TypeVar("Said", bound=CompanionMessage)


class FakeCompanion:
    """In place of a `Child`: `theirs` is its end of the channel."""

    def __init__(self) -> None:
        self.channel, self.theirs = Channel.pair()
        self._told = list[CompanionMessage]()

    def says(self, message: CompanionMessage) -> None:
        assert self.theirs.send(message)

    def told(self, kind: type[Said], count: int = 0) -> list[Said]:
        """Return what it was told of a kind so far, once that are so many."""
        wait_until(lambda: len(self._heard(kind)) >= count)
        return self._heard(kind)

    def decisions(self, count: int = 0) -> list[Entry]:
        return [decided.entry for decided in self.told(Decided, count)]

    def _heard(self, kind: type[Said]) -> list[Said]:
        self._told += self.theirs.receive()
        return [one for one in self._told if isinstance(one, kind)]

    def end(self, within_s: float = 0.0) -> None:  # noqa: ARG002 - as a `Child`
        self.channel.close()

    def close(self) -> None:
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
LOOK_S = 6.0  # patience of the watchdog, enough on a busy machine


@dataclass(frozen=True)
class Running:
    """A small monitor that runs."""

    process: subprocess.Popen[str]
    port: int
    watchdog_pid: int


class NoGuard:
    """A watchdog that does nothing; a real one would kill this process."""

    def watch(self, client: int, descriptor: int) -> None: ...
    def version(self, client: int, version: int) -> None: ...
    def forget(self, client: int) -> None: ...
    def beat(self, now_s: float) -> None: ...
    def end(self) -> None: ...


# limits for tests on the machine's clock, wide enough for a busy machine
BORNE = {"silence_s": 0.5, "lag_s": 0.5, "catch_up_s": 0.5}
NOBODY: Mapping[str, FakeCompanion] = {}


@contextmanager
def serving(
    companions: Mapping[str, FakeCompanion] = NOBODY,
    guard: Any = None,
    **settings: Any,
) -> Iterator[int]:
    """Run a small monitor in a thread until the block ends; yield its port.

    Its time is from `clock`, by default one that does not move; `clock=None` is the
    machine's.
    """
    if OPINION in companions:
        companions[OPINION].says(Alive(faults=()))  # it is ready

    addresses = SimpleQueue[Address]()
    stops = list[Callable[[], None]]()
    thread = Thread(
        target=run_small,
        args=(
            guard or NoGuard(),
            Companions(dict(companions)),  # type: ignore[arg-type]
            addresses.put,
            stops.append,
        ),
        kwargs={"clock": TurnedClock(), **BORNE, **settings},
        daemon=True,
    )
    thread.start()
    try:
        yield addresses.get(timeout=FUSE_S).port
    finally:
        for stop in stops:
            stop()
        thread.join(FUSE_S)
        for companion in companions.values():
            companion.close()


def reset(port: int, secret: str = TOKEN) -> tuple[bool, str]:
    """Ask for a reset; return the answer."""
    return ask_reset(LOCAL, port, secret, within_s=FUSE_S)


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
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
    )
    assert process.stdout

    try:
        with ends(process.stdout, FUSE_S):
            port, watchdog_pid = map(int, process.stdout.readline().split())

        yield Running(process, port, watchdog_pid)
    finally:
        process.terminate()
        process.wait(FUSE_S)
        process.stdout.close()


class Peer:
    """One connection; `heard` has (device, message) of all that came. With a clock, a
    frame comes `every_s` of it after the last.

    While a peer hears, all receive, each into its `arrived`: the server drops messages
    to a client that does not read, some 5 kB after the last that its system has
    acknowledged, which may take that 40 ms.
    """

    connected: ClassVar[set["Peer"]] = set()

    def __init__(
        self, port: int, version: int = 1, clock: TurnedClock | None = None
    ) -> None:
        self.port = port
        self.size = (ROWS, COLUMNS)
        self.link = socket.create_connection((LOCAL, port), timeout=FUSE_S)
        self.clock = clock
        self.every_s = FRAME_S
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
            self.clock.turn(self.every_s)
        self.link.sendall(self._encoded(message, device, time_s, message_id))

    def _encoded(
        self,
        message: Message,
        device: str = "Scanner",
        time_s: float | None = None,
        message_id: int = 0,
    ) -> bytes:
        stamp = (self.clock or time)() if time_s is None else time_s
        return encode(
            message,
            device,
            version=self.version,
            time_s=stamp,
            message_id=message_id,
        )

    def deliver(self) -> None:
        """Wait until the system has delivered all that was sent to the server's
        socket.
        """
        wait_until(lambda: not any(fcntl.ioctl(self.link, termios.TIOCOUTQ, bytes(4))))

    def show(
        self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: Any
    ) -> None:
        """Send a frame that reads as a force."""
        pixels = self._frame(force_mn) if pixels is None else pixels
        self.say(Image(pixels[None], MATRIX), **header)

    def _frame(self, force_mn: float) -> NDArray[np.uint16]:
        rows, columns = self.size
        return frame_of(round(force_mn * 1e3), next(SERIALS))[:rows, :columns]

    def read(
        self, force_mn: float, pixels: NDArray[np.uint16] | None = None, **header: Any
    ) -> None:
        """Send a frame and wait until it is answered."""
        before = self.readings()
        self.show(force_mn, pixels, **header)
        self.hear_readings(before + 1)
        assert self.readings() > before, "a frame was not answered"

    def show_together(
        self,
        *forces_mn: float,
        within_s: float = FRAME_S,
        headers: Callable[[int], dict[str, Any]] = lambda _: {},
    ) -> None:
        """Send a few frames, no more than a socket holds, of which the server sees
        none before all have come, `within_s` after the last; `headers` are by their
        place, from 1 on.
        """
        assert self.clock
        images = [
            self._encoded(
                Image(self._frame(force_mn)[None], MATRIX),
                **{"time_s": self.clock() + 1e-4 * place, **headers(place)},
            )
            for place, force_mn in enumerate(forces_mn, 1)
        ]
        with self.clock.held():
            self.clock.turn(within_s)
            self.link.sendall(b"".join(images))
            self.deliver()

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

    @property
    def status(self) -> Status:
        """The last STATUS."""
        return self.statuses()[-1]

    def texts(self, device: str = "ForceReading") -> list[Text]:
        return [
            message
            for name, message in self.heard
            if isinstance(message, Text) and name == device
        ]

    def readings(self) -> int:
        """Return how many frames were read so far."""
        return len(self.texts())

    def hear_readings(self, count: int) -> None:
        """Wait until so many frames were read."""
        self.hear(lambda peer: peer.readings() >= count)

    def said(self) -> dict[str, Any]:
        """Return what was said of the last frame."""
        return dict(json.loads(self.texts()[-1].text))

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
        assert self.status.code == 1, self.status

    def withdraw(self) -> None:
        """Bring the monitor to where it withdraws although its frames are harmless."""
        self.watch()
        self.show(40.0)
        self.wait_for_code(3)
        for _ in range(8):
            self.read(10.0)
        assert self.status.code == 3, self.status

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
