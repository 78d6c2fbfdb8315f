"""The whole monitor: starts its processes, serves, and ends them."""

import gc
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from select import select
from time import monotonic

import cv2

from scleraforce.errors import InputError
from scleraforce.known import Known, stated_eye
from scleraforce.monitor import MonitorLimits
from scleraforce.reader import Reader
from scleraforce.reader.model import LiveReader
from scleraforce.recording.folder import NeedleInfo, OctInfo, RecordingInfo, nearest_gauge
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.channel import Channel, Child
from scleraforce.service.companions.companions import BLACK_BOX, CONSOLE, OPINION, Companions
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.guard import Guard
from scleraforce.service.companions.messages import OpinionSettings, black_box_settings, console_settings
from scleraforce.service.priority import MONITOR_PRIORITY, run_in_real_time
from scleraforce.service.server import Server, ServerSettings
from scleraforce.service.session import Session
from scleraforce.service.startup import allow_files, listen, try_folders
from scleraforce.study import Study

KEPT_S = 10.0
READY_S = 180.0  # for the second opinion: some 15 s where its loops are compiled, and machines may be slow
NOTED_S, LOOK_S = 3.0, 0.1
OWN_FILES = 128  # beside those of clients: sockets to other processes, logs, and what the system's libraries open
RING_FRAMES = 1200  # at 100 a second two seconds more than are kept, which leaves time to copy them
MOST_BITS = 16  # a scanner may use more bits than the model's study states, and its recording must stay readable
WEB_NEEDS = ("fastapi", "uvicorn", "websockets")


@dataclass(frozen=True)
class Address:
    """Where to listen; port 0 takes a free one."""

    host: str
    port: int


@dataclass(frozen=True)
class MonitorSettings:
    """The settings of a monitor.

    Attributes:
        eye: its name.
        known: what is known of the eye.
        limits: of the decision; `size` and `scale_m` are those of the frames that are expected.
        refractive_index: factor by which depth is stretched in the frames.
        address: of the OpenIGTLink server.
        console: address of the web console; None: no console.
        black_box: folder of the log and of the recordings of withdrawals.
        record: folder for a recording of the whole session; None: no recording.
        token: of the operator's reset.
    """

    eye: str
    known: Known
    limits: MonitorLimits
    refractive_index: float
    address: Address
    console: Address | None
    black_box: Path
    record: Path | None
    token: str


@contextmanager
def monitor_service(
    model: Path, reader: Reader, settings: MonitorSettings, note: Callable[[str], None]
) -> Iterator[tuple[Server, Address]]:
    """Start all processes, yield the server and its address, and end all processes.

    Call the server's `run` at once: from here on the watchdog expects signs of life.

    Args:
        model: folder of the model; the second opinion loads it by itself.
        reader: the model.
        settings: of the monitor.
        note: called with a line for the operator.

    Raises:
        InputError: an address cannot be listened on, a folder cannot be written, or there is too little memory.
    """
    rows, columns = settings.limits.size or (0, 0)
    lateral_m, depth_m = settings.limits.scale_m or (0.0, 0.0)
    scale = PixelScale(lateral_m=lateral_m, depth_m=depth_m, refractive_index=settings.refractive_index)
    cv2.setNumThreads(1)
    allow_files(ServerSettings.clients + OWN_FILES)
    with ExitStack() as stack:
        listener = stack.enter_context(listen(settings.address.host, settings.address.port))
        console = None if settings.console is None else stack.enter_context(_listen_for_pages(settings.console))
        live = LiveReader(reader, settings.known, settings.refractive_index)
        ring = FrameRing.create(RING_FRAMES, rows, columns)
        info = _recording_info(settings, reader.study)
        try_folders(settings.black_box, settings.record)
        kept = black_box_settings(settings.black_box, ring, info, settings.record, KEPT_S)
        children = {BLACK_BOX: Child("scleraforce.service.black_box.process", kept, [ring.descriptor])}
        if settings.limits.expects_opinion:
            opinion = OpinionSettings(model=model, known=settings.known, scale=scale, ring=ring.place)
            children[OPINION] = Child("scleraforce.service.companions.second_opinion", opinion, [ring.descriptor])
        if settings.console and console:
            children[CONSOLE] = _console_child(settings, settings.console, console, reader, scale, ring)
            console.close()  # so that nothing listens there once the console has ended
        companions = Companions(children)
        stack.callback(companions.end)
        session = Session(live.read, settings.limits)
        if OPINION in children:
            _wait_for_opinion(companions, children[OPINION].channel, note)
        gc.collect()
        gc.freeze()  # the model stays, so the collector need not scan it again and again
        guard = Guard()
        stack.callback(guard.end)
        if not run_in_real_time(MONITOR_PRIORITY):
            note("no real-time priority: other programs can delay the answers (docs/monitor.md)")
        server = Server(session, listener, ServerSettings(settings.token), ring, guard, companions, note)
        stack.callback(server.close)
        yield server, Address(*listener.getsockname()[:2])


def _listen_for_pages(address: Address) -> socket.socket:
    missing = [name for name in WEB_NEEDS if find_spec(name) is None]
    if missing:
        raise InputError(f"--web-port: {missing[0]} is not installed; run pip install 'scleraforce[web]'")
    return listen(address.host, address.port, "web-")


def _wait_for_opinion(companions: Companions, channel: Channel, note: Callable[[str], None]) -> None:
    """Wait until the second opinion is ready, or has failed, which the server then answers with a withdrawal.

    Frames that it were asked about before would wait for as long as its first reading takes.
    """
    begun_s = now_s = monotonic()
    is_noted = False
    while companions.starts(OPINION) and now_s - begun_s < READY_S:
        select([channel], [], [], LOOK_S)
        now_s = monotonic()
        for _ in companions.hear(OPINION, now_s):
            pass  # it has been asked nothing
        if not is_noted and now_s - begun_s > NOTED_S:
            is_noted = True
            note("the second opinion gets ready: some seconds, once after an installation half a minute or more")
    if companions.starts(OPINION):
        note(f"the second opinion was not ready within {READY_S:g} s: nothing is OK before its first one")


def session_scan(settings: MonitorSettings) -> OctInfo:
    """Return what is known of the frames of a session."""
    rows, columns = settings.limits.size or (0, 0)
    lateral_m, depth_m = settings.limits.scale_m or (0.0, 0.0)
    return OctInfo(
        columns=columns,
        rows=rows,
        bits=MOST_BITS,
        width_m=columns * lateral_m,
        depth_m=rows * depth_m,
        plane_direction_rad=settings.known.direction_rad,
        refractive_index=settings.refractive_index,
    )


def _recording_info(settings: MonitorSettings, study: Study) -> RecordingInfo:
    """Return the contents of recording.toml for a recording of the session."""
    known = settings.known
    gap_m = study.needle.gap_m if known.gap_m is None else known.gap_m
    return RecordingInfo(
        stated_eye(settings.eye, known),
        session_scan(settings),
        NeedleInfo(
            gauge=nearest_gauge(study.needle.outer_diameter_m), slice_gap_m=gap_m, polar_angle_rad=known.polar_rad
        ),
    )


def _console_child(
    settings: MonitorSettings,
    address: Address,
    listener: socket.socket,
    reader: Reader,
    scale: PixelScale,
    ring: FrameRing,
) -> Child:
    told = console_settings(
        host=address.host, listener=listener, token=settings.token, ring=ring,
        lateral_m=scale.lateral_m, depth_m=scale.depth_m,
        limits=settings.limits, class_bounds_n=reader.study.classes.bounds_n, model=reader.path.name, eye=settings.eye,
    )  # fmt: skip
    return Child("scleraforce.service.console", told, [ring.descriptor, listener.fileno()])
