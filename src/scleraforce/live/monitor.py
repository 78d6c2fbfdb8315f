"""The whole monitor: checks what it needs, starts its processes, serves, and ends
them.
"""

import gc
import os
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from errno import EADDRNOTAVAIL
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue
from select import select
from tempfile import TemporaryFile
from threading import Thread
from time import monotonic
from typing import Generic, TypeVar

import cv2

from scleraforce.base.errors import InputError
from scleraforce.live.companions.companion_processes import (
    BLACK_BOX,
    CONSOLE,
    OPINION,
    Companions,
    Guard,
)
from scleraforce.live.companions.decision_log import DecisionLog
from scleraforce.live.companions.process_channel import Child
from scleraforce.live.companions.process_messages import (
    BlackBoxSettings,
    ConsoleSettings,
    Note,
    OpinionSettings,
    Settings,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.companions.watchdog import MONITOR_PRIORITY, run_in_real_time
from scleraforce.live.connected_clients import ServerSettings
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_request import Address
from scleraforce.live.monitor_server import MonitorServer
from scleraforce.live.monitor_session import MonitorSession
from scleraforce.live.network.operator_reset import token_digest
from scleraforce.live.repeated_pictures import warm_pictures
from scleraforce.reading.eye_reader import EyeReader
from scleraforce.reading.reading_models import Reader
from scleraforce.records.needle import Needle, lean_ends, one_lean
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

KEPT_S = 10.0  # of each withdrawal
# for the second opinion: some 15 s where its loops are compiled, and machines may be
# slow
READY_S = 180.0
NOTED_S = 3.0
LOOK_S = 0.1
# beside the clients' sockets: other processes' sockets, logs, and what the system's
# libraries open
OWN_FILES = 128
# frames in the ring: at 100 a second two seconds more than are kept, which leaves time
# to copy them
RING_FRAMES = 1200
# forces of a robot; the needle moves, so labels average over a short time
FORCE = ForceInfo("fz", 1, 0.2)
WEB_NEEDS = ("fastapi", "uvicorn", "websockets")
WAITING_LINES = 1000  # for the operator; while this many wait, new ones are dropped

Line = TypeVar("Line")


@dataclass(frozen=True)
class MonitorSettings:
    """The settings of a monitor; `scan`: the expected frames, whose `size` and
    `scale_m` `limits` has as well.

    Without a `console` address there is no console. The log and the recordings of
    withdrawals are in `black_box`; `record` is the folder for a recording of the whole
    session. `learns`: the second opinion learns E. If the scan has several planes, the
    gap is not known. `remarks` on eye and frames go to log and console.
    """

    eye: str
    setup: Setup
    limits: MonitorLimits
    scan: Scan
    address: Address
    console: Address | None
    black_box: Path
    record: Path | None
    token: str
    learns: bool = False
    remarks: tuple[Remark, ...] = ()


@contextmanager
def monitor_service(
    model: Path, reader: Reader, settings: MonitorSettings, note: Callable[[str], None]
) -> Iterator[tuple[MonitorServer, Address]]:
    """Start all processes, yield the server and its address, and end all processes.

    Call the server's `run` within `watchdog.DUTY_S`: from its first turn on the
    watchdog expects signs of life. The second opinion loads the folder `model` by
    itself; `note` is called with a line for the operator. It raises InputError if an
    address cannot be listened on, a folder cannot be written, or there is too little
    memory.
    """
    limits = settings.limits
    known = settings.setup
    scan = settings.scan
    scale = scan.scale
    cv2.setNumThreads(1)
    allow_files(ServerSettings.clients + OWN_FILES)

    with ExitStack() as stack:
        listener = stack.enter_context(
            listen(settings.address.host, settings.address.port)
        )
        pages = settings.console and stack.enter_context(
            _listen_for_pages(settings.console)
        )
        readers = live_readers(reader, known, scan)
        ring = FrameRing.create(RING_FRAMES * max(len(scan.planes), 1), *scan.shape)
        info = _recording_info(settings, reader.study)
        try_folders(settings.black_box, settings.record)
        folder = settings.black_box.absolute()
        record = settings.record and settings.record.absolute()
        kept = BlackBoxSettings(
            folder=folder, ring=ring.place, info=info, record=record, keep_s=KEPT_S
        )
        children = {BLACK_BOX: _child("companions.black_box", kept, ring)}

        if limits.expects_opinion:
            opinion = OpinionSettings(
                model=model,
                setup=known,
                scale=scale,
                ring=ring.place,
                learns=settings.eye if settings.learns else None,
                record=record,
                planes=scan.planes,
            )
            children[OPINION] = _child("companions.second_opinion", opinion, ring)

        if settings.console and pages:
            console = ConsoleSettings(
                host=settings.console.host,
                listener=pages.fileno(),
                token_digest=token_digest(settings.token),
                ring=ring.place,
                scale=scale,
                limits=limits,
                class_bounds_n=reader.study.classes.bounds_n,
                model=reader.name,
                eye=settings.eye,
                remarks=settings.remarks,
            )
            children[CONSOLE] = _child("console.server", console, ring, pages.fileno())
            pages.close()  # so that nothing listens there once the console has ended

        companions = Companions(children)
        stack.callback(companions.end)
        session = MonitorSession(readers if scan.planes else readers[""], limits)
        _wait_for_opinion(companions, note)
        gc.collect()
        # the model stays, so the collector need not scan it again and again
        gc.freeze()
        guard = Guard()
        stack.callback(guard.end)

        if not run_in_real_time(MONITOR_PRIORITY):
            note(
                "no real-time priority: other programs can delay the answers"
                " (docs/monitor.md)"
            )

        server = MonitorServer(
            session,
            listener,
            ServerSettings(settings.token),
            ring,
            guard,
            companions,
            note,
        )
        stack.callback(server.close)
        for text in (f"model {reader.words}", *map(_logged, settings.remarks)):
            begun = Note(time_s=session.wall_clock(), text=text)
            companions.send(BLACK_BOX, begun, monotonic())

        yield server, Address(*listener.getsockname()[:2])


def live_readers(reader: Reader, setup: Setup, scan: Scan) -> dict[str, EyeReader]:
    """Return the reader of each plane by name, of the eye as that plane sees it, ready
    to read without delay; that of a single plane is named "".
    """
    refractive_index = scan.scale.refractive_index
    shown = replace(setup, scan=replace(setup.scan, refractive_index=refractive_index))
    setups = {
        plane.name: shown.turned(plane.direction_rad) for plane in scan.planes
    } or {"": shown}
    readers = {
        name: EyeReader(reader, of_plane, by="network")
        for name, of_plane in setups.items()
    }
    for one in readers.values():
        one.warm()
    warm_pictures()
    return readers


def _logged(remark: Remark) -> str:
    return f"{remark.code}: {remark}"


def _child(
    module: str, settings: Settings, ring: FrameRing, *descriptors: int
) -> Child:
    return Child(
        f"scleraforce.live.{module}", settings, [ring.place.descriptor, *descriptors]
    )


def _listen_for_pages(address: Address) -> socket.socket:
    missing = [name for name in WEB_NEEDS if find_spec(name) is None]
    if missing:
        raise InputError(
            f"`web_port`: {missing[0]} is not installed; run pip install"
            " 'scleraforce[web]'"
        )
    return listen(address.host, address.port, "web_")


def _wait_for_opinion(companions: Companions, note: Callable[[str], None]) -> None:
    """Wait until the second opinion, if there is one, is ready or has failed; then the
    server orders a withdrawal.

    A frame that it was asked about earlier would wait until its first reading is done.
    """
    begun_s = now_s = monotonic()
    is_noted = False

    while companions.starts(OPINION) and now_s - begun_s < READY_S:
        select([companions.channel(OPINION)], [], [], LOOK_S)
        now_s = monotonic()
        for _ in companions.hear(OPINION, now_s):
            pass  # it has been asked nothing

        if not is_noted and now_s - begun_s > NOTED_S:
            is_noted = True
            note(
                "the second opinion gets ready: some seconds, once after an"
                " installation half a minute or more"
            )

    if companions.starts(OPINION):
        note(
            f"the second opinion was not ready within {READY_S:g} s: nothing is OK"
            " before its first one"
        )


def _recording_info(settings: MonitorSettings, study: Study) -> RecordingInfo:
    known = settings.setup
    stated_m = study.needle.gap_m if known.needle.gap_m is None else known.needle.gap_m
    lean_rad = one_lean(known.needle.lean_rad)
    gap_m = None if settings.scan.planes else stated_m
    needle = Needle(
        diameter_m=known.needle.diameter_m or study.needle.outer_diameter_m,
        gap_m=gap_m,
        polar_rad=known.needle.polar_rad,
        lean_rad=lean_ends(lean_rad),
        lean_azimuth_rad=None if lean_rad is None else known.needle.lean_azimuth_rad,
    )

    return RecordingInfo(
        replace(known.eye.declared(), name=settings.eye), settings.scan, needle, FORCE
    )


def listen(host: str, port: int, prefix: str = "") -> socket.socket:
    """Return a socket that listens, or raise InputError; `prefix` is that of the
    names of both fields ("web_").
    """
    if not host.strip():
        raise InputError(
            f"`{prefix}host`: empty; use 127.0.0.1 for this machine alone, 0.0.0.0 for"
            " all its networks"
        )

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        (*_, address), *_ = socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)
        return socket.create_server(address[:2], family=family, backlog=256)
    except (
        socket.gaierror,
        UnicodeError,
    ) as fault:  # Python raises a UnicodeError for a name of over 63 letters
        reason = getattr(fault, "strerror", None) or str(fault)
    except OSError as fault:
        reason = str(fault.strerror).partition(" (while")[0]
        if fault.errno != EADDRNOTAVAIL:
            what_to_do = f"give another `{prefix}port`, or end what listens there"
            raise InputError(f"{host}:{port}: {reason}; {what_to_do}") from fault

    raise InputError(
        f"`{prefix}host` {host!r}: {reason}; give an address of this machine"
    )


def try_folders(black_box: Path, record: Path | None) -> None:
    """Create the folder of the black box, and test that both folders can be written;
    the recording's is created later.

    A folder that another monitor uses, or a `record` that exists, is an InputError,
    too.
    """
    if record is not None:
        _try_record(record.absolute(), black_box.absolute())
    try:
        DecisionLog(black_box / "log").close()
        withdrawals = black_box / "withdrawals"
        _try_write(withdrawals if withdrawals.exists() else black_box)
    except OSError as fault:
        raise InputError(
            f"`black_box` {black_box}: {fault.strerror}; give another folder"
        ) from fault


def _try_record(record: Path, black_box: Path) -> None:
    try:
        if os.path.lexists(record):
            raise InputError(
                f"`record` {record}: exists already; remove it or choose another name"
            )
        if record == black_box or record in black_box.parents:
            raise InputError(
                f"`record` {record}: the folder of the black box is there; choose"
                " another name"
            )

        with suppress(FileNotFoundError):
            os.stat(record)  # a name may be too long

        _try_write(next(folder for folder in record.parents if os.path.lexists(folder)))
    except OSError as fault:
        raise InputError(
            f"`record` {record}: {fault.strerror}; give another folder"
        ) from fault


def _try_write(folder: Path) -> None:
    """Write a file without a name, which is gone when it is closed."""
    with TemporaryFile(dir=folder):
        pass


def allow_files(needed: int) -> None:
    """Raise the soft limit of open files of this process and its children to `needed`,
    or raise InputError.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(
            f"open files: at most {hard} are allowed (ulimit -Hn), the monitor needs"
            f" {needed} so that neither the scanner nor the operator is locked out;"
            " raise the limit `nofile` in /etc/security/limits.conf"
        )

    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


class OperatorNotes(Generic[Line]):
    """Writes lines for the operator, or messages with them, in order, in a thread: a
    stopped terminal must not stop the monitor.
    """

    def __init__(self, write: Callable[[Line], object]) -> None:
        self._write = write
        self._lines = SimpleQueue[Line | None]()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def __call__(self, line: Line) -> None:
        """Enqueue a line."""
        if self._lines.qsize() < WAITING_LINES:
            self._lines.put(line)

    def close(self, within_s: float = 1.0) -> None:
        """Write the lines that wait, for `within_s` at most."""
        self._lines.put(None)
        self._thread.join(within_s)

    def _run(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError):  # the terminal was closed
                self._write(line)
