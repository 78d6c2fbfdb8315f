"""Play a recording to a monitor as its scanner would: the connection, the clock, and
the record of the answers.
"""

import socket
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from heapq import merge
from itertools import islice, pairwise
from math import ceil
from select import select
from time import monotonic, time
from typing import Any, TypeVar

import msgspec
import numpy as np

import scleraforce.live.network.openigtlink as igtl
from scleraforce.base.errors import InputError, LinkError
from scleraforce.base.units import from_si
from scleraforce.live.companions.process_messages import (
    NEEDLE_DEVICE,
    READING_DEVICE,
    STATUS_DEVICE,
)
from scleraforce.live.companions.watchdog import stamp_time
from scleraforce.live.decision.events import Cause, State
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS, FrameEntry
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import Scan

SCANNER_DEVICE = "Scanner"
CONNECT_S = 5.0
STALL_S = 5.0  # a monitor that takes no bytes for this long counts as hung
LAST_BYTES = 4096
WAITING = 1000  # frames without an answer that are remembered
SUB_CODES = {cause.value: cause.name for cause in Cause}
OK = State.WATCHING.value

Value = TypeVar("Value")
Hear = Callable[[float, str, igtl.Message], object]


class UnstampedMessage:
    """A message that is encoded except for the time in its header; `message_id` is 0 in
    version 1.
    """

    def __init__(
        self, message: igtl.Message, device: str, version: int, message_id: int = 0
    ) -> None:
        message_id = message_id if version > 1 else 0
        self.device = device
        self._bytes = bytearray(
            igtl.encode(message, device, version=version, message_id=message_id)
        )
        self._message_id = message_id

    def stamped(self, time_s: float) -> bytearray:
        """Return the message with a time, s since 1970; valid until the next call."""
        stamp_time(self._bytes, time_s)
        return self._bytes

    @property
    def frame_id(self) -> int:
        """The monitor's id of the frame: the message id, or without one the time in
        microseconds.
        """
        return self._message_id or int(
            from_si(igtl.unpack_header(self._bytes[: igtl.HEADER_BYTES]).time_s, "us")
        )


def frame_message(
    pixels: Pixels,
    scan: Scan,
    number: int,
    version: int,
    *,
    matrix: tuple[float, ...] | None = None,
    plane: str | None = None,
) -> UnstampedMessage:
    """Encode a frame as an IMAGE of one slice, whose device is its plane's name;
    `matrix` replaces the recording's.
    """
    return UnstampedMessage(
        igtl.Image(pixels[None], matrix or image_matrix(scan)),
        plane or SCANNER_DEVICE,
        version,
        number,
    )


def image_matrix(scan: Scan) -> tuple[float, ...]:
    """Return the matrix of an IMAGE: the steps to the next column, row and slice in mm,
    then the centre, at 0.
    """
    scale = scan.scale
    lateral_mm = from_si(scale.lateral_m, "mm")
    depth_mm = from_si(scale.depth_m, "mm")
    return (lateral_mm, 0.0, 0.0, 0.0, depth_mm, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class ScannerClient:
    """Open connections to a monitor: the scanner's, and on request a robot's beside it.
    Every wait has an end.

    `hear` is called with the time, the device and the message for each that the monitor
    sends; `observed` hears through the robot's connection, which stays when the
    scanner's breaks. Times are of the `clock`. It raises `InputError` if no monitor
    listens there; methods raise `LinkError` if the connection is lost.
    """

    def __init__(
        self,
        host: str,
        port: int,
        hear: Hear,
        *,
        observed: bool = False,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self.address = f"{host}:{port}"
        self.clock = clock
        self._hear = hear
        self._decoder = igtl.Decoder()
        self._scanner: socket.socket | None = _connect(host, port)
        self._heard: socket.socket | None = (
            _connect(host, port) if observed else self._scanner
        )

    def send(self, data: bytes | bytearray) -> float:
        """Send bytes; return when the last 4 KiB were begun (s, monotonic): an answer
        may precede the return.
        """
        whole = memoryview(data)
        self._send(whole[:-LAST_BYTES])
        last_s = self.clock()
        self._send(whole[-LAST_BYTES:])
        return last_s

    def _send(self, rest: memoryview) -> None:
        moved_s = self.clock()
        while rest:
            if self._scanner is None:
                raise LinkError(
                    f"{self.address}: the monitor has closed the connection"
                )

            try:
                rest = rest[self._scanner.send(rest) :]
                moved_s = self.clock()
            except BlockingIOError:
                if self.clock() - moved_s > STALL_S:
                    raise LinkError(
                        f"{self.address}: the monitor has read nothing for"
                        f" {STALL_S:g} s"
                    ) from None

                self._turn(0.1, writing=True)
            except OSError as fault:
                self._lose(self._scanner, fault)

    def listen(self, until_s: float, done: Callable[[], bool] = lambda: False) -> None:
        """Hear the monitor until a time (s, monotonic), or until `done`."""
        self._turn(0.0)
        while not done() and (left_s := until_s - self.clock()) > 0.0:
            self._turn(left_s)

    def disconnect(self) -> None:
        """Close the scanner's connection, and leave the robot's."""
        if self._scanner is not None and self._scanner is not self._heard:
            self._scanner.close()
            self._scanner = None

    def close(self) -> None:
        """Close all connections."""
        for link in {self._scanner, self._heard} - {None}:
            link.close()  # type: ignore[union-attr]
        self._scanner = self._heard = None

    def _turn(self, within_s: float, writing: bool = False) -> None:
        """Wait until bytes have come, or, `writing`, until the scanner's connection
        takes bytes again.
        """
        links = {link for link in (self._scanner, self._heard) if link is not None}
        writers = [self._scanner] if writing and self._scanner is not None else []
        for link in select(list(links), writers, [], within_s)[0]:
            self._receive(link, heard=link is self._heard)

    def _receive(self, link: socket.socket, heard: bool) -> None:
        """Read a connection; discard what comes on the scanner's while the robot's,
        which gets the same, is heard.
        """
        try:
            count = link.recv_into(
                self._decoder.space() if heard else bytearray(1 << 16)
            )
        except BlockingIOError:
            return
        except OSError as fault:
            self._lose(link, fault)
            return

        at_s = self.clock()
        if not count:
            self._lose(link, None)

        for event in self._decoder.received(count) if heard else ():
            if isinstance(event, igtl.Broken):
                raise LinkError(
                    f"{self.address}: does not send OpenIGTLink: {event.reason}"
                )

            if isinstance(event, igtl.Received):
                self._hear(at_s, event.header.device, event.message)

    def _lose(self, link: socket.socket, fault: OSError | None) -> None:
        if link is self._scanner:
            self._scanner = None
        if link is self._heard:
            raise LinkError(
                f"{self.address}: the connection is lost:"
                f" {fault.strerror if fault else 'it was closed'}"
            )

        link.close()


def _connect(host: str, port: int) -> socket.socket:
    try:
        link = socket.create_connection((host, port), timeout=CONNECT_S)
    except OSError as fault:
        reason = fault.strerror or str(fault)
        what_to_do = "start `scleraforce monitor` there, or give `host`, `port`"
        raise InputError(f"{host}:{port}: {reason}; {what_to_do}") from fault

    link.setblocking(False)
    with suppress(OSError):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    return link


@dataclass(frozen=True, kw_only=True)
class StatusChange:
    """A STATUS that came at `at_s` (monotonic) and differs from the one before it, in
    code or sub-code.

    `frame` is the number of the frame that it `answers`, or of the last frame sent, and
    `after_s` the time since that frame's last byte; None before the first frame. The
    force and its interval are the answer's.
    """

    at_s: float
    code: int
    sub_code: int
    message: str
    frame: int | None = None
    after_s: float | None = None
    answers: bool = False
    force_mn: float | None = None
    interval_mn: tuple[float, float] | None = None

    @property
    def cause(self) -> str | None:
        """The name of the cause; None if the sub-code is not a cause."""
        return SUB_CODES.get(self.sub_code)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedAnswer:
    """The code that answers a frame, its time since the frame's last byte, and its
    latency by the monitor's clock.
    """

    code: int
    took_s: float
    server_ms: float | None


class AnswerLog:
    """Record frames that were sent and the monitor's messages; no socket, no clock.

    `begun_s` is when the first frame was sent, `status_s` when the last STATUS came;
    the first one counts as a change. `reading` is the last STRING `ForceReading`,
    parsed; `answered` the number of the frame that it answers.
    """

    def __init__(self) -> None:
        self.changes: list[StatusChange] = []
        self.answers: list[TimedAnswer] = []
        self.frames_sent = 0
        self.begun_s: float | None = None
        self.reading: Mapping[str, Any] = {}
        self.status: igtl.Status | None = None
        self.status_s: float | None = None
        self.longest_silence_s = 0.0
        self.answered: int | None = None
        self._waiting: OrderedDict[tuple[str | None, int], tuple[int, float]] = (
            OrderedDict()
        )
        self._last: tuple[int, float] | None = None
        self._changed = False

    def sent(
        self, number: int, frame_id: int, at_s: float, plane: str | None = None
    ) -> None:
        """Take a frame that was sent: its number in the recording, its id, when its
        last byte was sent, its plane.
        """
        self.frames_sent += 1
        self.begun_s = at_s if self.begun_s is None else self.begun_s
        self._last = self._waiting[plane, frame_id] = number, at_s
        if len(self._waiting) > WAITING:
            self._waiting.popitem(last=False)

    def hear(self, at_s: float, device: str, message: igtl.Message) -> None:
        """Take a message of the monitor."""
        if isinstance(message, igtl.Status) and device == STATUS_DEVICE:
            self._hear_status(at_s, message)
        elif isinstance(message, igtl.Text) and device == READING_DEVICE:
            self._hear_reading(message.text)

    @property
    def last(self) -> TimedAnswer | None:
        """The answer to the last frame that was sent; None until it comes."""
        return (
            self.answers[-1]
            if self.answers and self._last and self.answered == self._last[0]
            else None
        )

    @property
    def ok(self) -> bool:
        """True if the last STATUS lets the robot continue."""
        return self.status is not None and self.status.code == OK

    def first_doubt(
        self, since_s: float, codes: Sequence[int] | None = None
    ) -> StatusChange | None:
        """Return the first change since a time to one of `codes`, or by default to any
        code but OK.
        """
        found = (change for change in self.changes if change.at_s >= since_s)
        return next(
            (
                change
                for change in found
                if (change.code in codes if codes else change.code != OK)
            ),
            None,
        )

    def _hear_status(self, at_s: float, status: igtl.Status) -> None:
        before = self.status
        self.status = status
        if self.status_s is not None:
            self.longest_silence_s = max(self.longest_silence_s, at_s - self.status_s)

        self.status_s = at_s
        self._changed = before is None or (before.code, before.subcode) != (
            status.code,
            status.subcode,
        )

        if self._changed:
            change = StatusChange(
                at_s=at_s,
                code=status.code,
                sub_code=status.subcode,
                message=status.message,
            )
            if self._last is not None:
                number, sent_s = self._last
                change = replace(change, frame=number, after_s=at_s - sent_s)

            self.changes.append(change)

    def _hear_reading(self, text: str) -> None:
        try:
            self.reading = reading = msgspec.json.decode(text, type=dict[str, Any])
        except msgspec.DecodeError:
            return

        frame_id = reading.get("frame_id")
        at_s = self.status_s
        status = self.status

        sent = (
            self._waiting.pop((reading.get("plane"), frame_id), None)
            if isinstance(frame_id, int)
            else None
        )
        if at_s is None or status is None or sent is None:
            return

        number, sent_s = sent
        self.answered = number
        latency_ms = reading.get("latency_ms")
        self.answers.append(
            TimedAnswer(code=status.code, took_s=at_s - sent_s, server_ms=latency_ms)
        )

        if self._changed:
            self._changed = False
            self.changes[-1] = replace(
                self.changes[-1],
                frame=number,
                after_s=at_s - sent_s,
                answers=True,
                force_mn=_plain(reading.get("force_mn"), float),
                interval_mn=_plain(reading.get("interval_mn"), tuple[float, float]),
            )


def _plain(value: object, kind: type[Value]) -> Value | None:
    with suppress(msgspec.ValidationError):
        return msgspec.convert(value, kind)
    return None


FORCE_DEVICE = "RobotForce"
# frames that are read before they are due: half a second at 100 a second, 25 MB
AHEAD = 48
READERS = 2
FORCES_PER_S = 1000.0  # that are sent at most; of a faster log, every n-th sample
# largest delay of the replay that a header may show; beyond it, it would pass for the
# scanner's
STATED_S = 0.05
ANSWER_S = 1.0  # how long a step, and the end, wait for the answer


@dataclass(frozen=True, order=True)
class TimedMessage:
    """A message at its time in the recording, s; `number` is that of a frame, from 1,
    and 0 of a force.
    """

    time_s: float
    number: int
    message: UnstampedMessage = field(compare=False)
    plane: str | None = field(default=None, compare=False)


@dataclass(eq=False)
class Player:
    """Play a recording through an open client; keep time by the client's clock, so that
    no delay adds up.

    `speed` is in recorded seconds a second. `ahead` frames are read before they are
    due, and before the first one goes out. `watch` is called after each message.
    `latest_s` is the largest delay of a message, `last` the number of the last frame
    that was sent. `play`, `step` raise LinkError if the connection is lost, FrameError
    if a frame cannot be read.
    """

    recording: Recording
    client: ScannerClient
    log: AnswerLog
    _: KW_ONLY
    speed: float = 1.0
    version: int = 1
    ahead: int = AHEAD
    watch: Callable[[], object] = lambda: None
    wall_clock: Callable[[], float] = time

    def __post_init__(self) -> None:
        self.forces_sent = 0
        self.latest_s = 0.0
        self.last = 0
        self._begun: tuple[float, float, float] | None = None
        # time in the recording, and when the last frame was sent
        self._frame_went = (
            0.0,
            float("-inf"),
        )

    def play(self, stop_s: float = float("inf")) -> None:
        """Play until a time of the recording, or its end; then wait a moment for the
        last answer.
        """
        entries = [entry for entry in self.recording.frames if entry.time_s < stop_s]
        forces = (
            force
            for force in self._forces()
            if force.time_s < min(stop_s, self.recording.frames[-1].time_s)
        )

        for timed in merge(self.frames(entries), forces, self._poses(entries)):
            self.send(timed)

        if stop_s == float("inf"):
            self._await_answer()

    def step(self, asked: Callable[[FrameEntry], bool]) -> None:
        """Send a frame, without forces, and wait for its answer, while `asked` returns
        True before each one.
        """
        for entry, timed in zip(
            self.recording.frames, self.frames(self.recording.frames), strict=True
        ):
            if not asked(entry):
                return

            self.client.listen(self.client.clock())
            self._put(timed, self.wall_clock())
            self._await_answer()

    def _await_answer(self) -> None:
        self.client.listen(
            self.client.clock() + ANSWER_S, lambda: self.log.answered == self.last
        )
        self.watch()

    def send(self, timed: TimedMessage) -> float:
        """Wait until a message is due and send it; a late replay catches up by half of
        each interval, not at once.
        """
        due_s, stamp_s = self.due(timed.time_s)
        time_s, went_s = self._frame_went if timed.number else (timed.time_s, due_s)
        self.client.listen(
            max(due_s, went_s + (timed.time_s - time_s) / self.speed / 2)
        )
        late_s = max(0.0, self.client.clock() - due_s)
        self.latest_s = max(self.latest_s, late_s)
        sent_s = self._put(timed, stamp_s + max(0.0, late_s - STATED_S))

        if timed.number:
            self._frame_went = timed.time_s, sent_s

        return sent_s

    def due(self, time_s: float) -> tuple[float, float]:
        """Return when a time of the recording is due, on the client's clock and since
        1970; the first one is now.
        """
        if self._begun is None:
            self._begun = time_s, self.client.clock(), self.wall_clock()
        first_s, begun_s, wall_s = self._begun
        passed_s = (time_s - first_s) / self.speed
        return begun_s + passed_s, wall_s + passed_s

    def _put(self, timed: TimedMessage, stamp_s: float) -> float:
        sent_s = self.client.send(timed.message.stamped(stamp_s))
        if timed.number:
            self.last = timed.number
            self.log.sent(timed.number, timed.message.frame_id, sent_s, timed.plane)
        else:
            self.forces_sent += timed.message.device == FORCE_DEVICE

        self.watch()
        return sent_s

    def frames(self, entries: Sequence[FrameEntry]) -> Iterator[TimedMessage]:
        """Yield frames in order, with `ahead` of them read in advance, also before the
        first one is yielded.
        """
        numbers = {
            entry.file: number
            for number, entry in enumerate(self.recording.frames, start=1)
        }
        with ThreadPoolExecutor(READERS) as pool:
            left = (
                pool.submit(self._read, entry, numbers[entry.file]) for entry in entries
            )
            waiting = deque(islice(left, self.ahead))

            try:
                wait(waiting)
                while waiting:
                    yield waiting.popleft().result()
                    waiting.extend(islice(left, 1))
            finally:
                pool.shutdown(cancel_futures=True)

    def _read(self, entry: FrameEntry, number: int) -> TimedMessage:
        pixels = self.recording.frame(entry)
        message = frame_message(
            pixels, self.recording.info.scan, number, self.version, plane=entry.plane
        )
        return TimedMessage(entry.time_s, number, message, entry.plane)

    def _poses(self, entries: list[FrameEntry]) -> Iterator[TimedMessage]:
        """Yield the needle's travel at each frame, if the recording has it; it goes out
        just before the frame.
        """
        for entry in entries:
            if entry.travel_m is not None:
                pose = igtl.Transform(
                    (*igtl.IDENTITY[:9], 0.0, 0.0, from_si(entry.travel_m, "mm"))
                )
                yield TimedMessage(
                    entry.time_s, 0, UnstampedMessage(pose, NEEDLE_DEVICE, self.version)
                )

    def _forces(self) -> Iterator[TimedMessage]:
        """Yield the force log as SENSOR: three forces, and three torques if logged;
        otherwise the contact force.
        """
        log = self.recording.forces
        info = self.recording.info.force
        if log is None or info is None:
            return

        every = max(1, ceil(log.sample_rate_hz * self.speed / FORCES_PER_S - 1e-3))
        whole = tuple(FORCE_COLUMNS[1 : 1 + len(log.columns)]) == log.columns and len(
            log.columns
        ) in (3, 6)
        values_sc = (
            log.wrench_sc
            if whole
            else info.contact_sign * log.force_n(info.axis)[:, None]
        )
        # a robot sends no force that it does not have
        known = np.isfinite(values_sc).all(axis=1)
        times_s = log.time_s[known]
        values_sc = values_sc[known]

        for time_s, values_c in zip(
            times_s[::every].tolist(), values_sc[::every].tolist(), strict=True
        ):
            yield TimedMessage(
                time_s,
                0,
                UnstampedMessage(
                    igtl.Sensor(tuple(values_c)), FORCE_DEVICE, self.version
                ),
            )


def median_interval_s(recording: Recording) -> float:
    """Return the time between two frames of a recording."""
    steps_s = [b.time_s - a.time_s for a, b in pairwise(recording.frames)]
    return float(np.median(steps_s)) if steps_s else 0.01
