"""Faults of a scanner and its connection, injected on purpose: does the monitor
withdraw, when, and why?

The messages of a fault are prepared before it is due, so that reading and encoding
delay nothing. After a single wrong frame the recording continues where it can, so that
a silence does not hide a fault that the monitor missed.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, islice
from math import ceil, nan
from time import time
from types import MappingProxyType

import fastcrc
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, LinkError
from scleraforce.base.units import from_si
from scleraforce.live.decision.events import Cause
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.network.openigtlink import (
    HEADER_BYTES,
    Image,
    pack_header,
    unpack_header,
)
from scleraforce.live.replay.scanner_player import (
    SCANNER_DEVICE,
    STATED_S,
    Player,
    UnstampedMessage,
    frame_message,
    image_matrix,
    median_interval_s,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.frame import Pixels

WITHIN_S = 0.5  # a later withdrawal does not count
SILENT_S = 0.15  # without a STATUS, after which the robot withdraws by itself
LIMITS = MonitorLimits()
BOUND_N = LIMITS.bound_n
# Clear of the monitor's bounds by the error of a reading.
CONTACT_N = 4e-3
HARMLESS_N = BOUND_N - 6e-3
DANGEROUS_N = BOUND_N + 3e-3
RISE_N_PER_S = 0.15
# frames of a second; a monitor might read fewer without delay, which is not a fault
FLOOD = 100
MOST_BUFFERS = 10  # pictures that a stuck buffer shows in turns
# part of the frame where a time is burned in
CLOCK_ROWS = 1 / 32
CLOCK_COLUMNS = 1 / 8
OLD_SHARES = 0.6, 0.95  # of an old picture, in a ghost
PAUSE_S = 0.06
LEFT = 0.25  # of the force, after a puncture
CLEARLY_N = 1.5e-3  # of a fall: several times the noise of readings
OLD_S = 5.0  # age of a part
LATER = 0.8  # of an interval, by which each frame waits longer than the one before


@dataclass(frozen=True)
class Sending:
    """One message: a frame, with its number and a time that may be wrong; or raw
    bytes.
    """

    message: UnstampedMessage | bytes
    number: int = 0
    late_s: float = 0.0


Act = tuple[Sending, ...] | None  # sent at a frame's time; None closes the connection


@dataclass(frozen=True)
class PreparedFault:
    """A fault, its time in the recording (s), and its acts from then on, one at each
    frame's time.
    """

    name: str
    time_s: float
    acts: tuple[Act, ...]


@dataclass(frozen=True, kw_only=True)
class FaultReport:
    """The consequence of a fault.

    `began_s` is when its first act was done (s, monotonic), or when the frame was due
    that did not come; `delay_s` runs from then until the robot withdraws; None: it does
    not within `WITHIN_S`. `code`, `message` and `cause` are the STATUS's; without a
    STATUS for 150 ms, or without a monitor, there is no `code` and `message` says so.
    `expected` is True if the cause is one of the fault's.
    """

    name: str
    began_s: float
    delay_s: float | None
    message: str
    code: int | None = None
    cause: str | None = None
    expected: bool = False


def prepare(
    name: str,
    recording: Recording,
    time_s: float,
    rng: np.random.Generator,
    *,
    version: int = 1,
    speed: float = 1.0,
    forces_n: Sequence[float] | None = None,
) -> PreparedFault:
    """Prepare a fault that takes the place of the first frame at or after a time of the
    recording.

    `rng` makes random choices, such as noise or black; "rising" and "dangerous" need
    `forces_n`, at each frame. It raises `InputError`: no such fault, no such time, or a
    recording without the frames or forces that it needs.
    """
    if name not in FAULTS:
        raise InputError(f"fault: {name!r}; choose one of: {', '.join(FAULTS)}")
    if recording.info.scan.planes:
        raise InputError(
            f"{recording.path}: oct.plane: faults need a recording of a single plane"
        )

    frames_s = [entry.time_s for entry in recording.frames]
    first = int(np.searchsorted(frames_s, time_s))
    if not 2 <= first < len(frames_s) - 1:
        within = f"frames are from {frames_s[2]:g} to {frames_s[-2]:g} s"
        raise InputError(f"{recording.path}: a fault at {time_s:g} s; {within}")

    stage = _FaultMaterial(
        recording, first, rng, version, median_interval_s(recording) / speed, forces_n
    )
    return PreparedFault(name, frames_s[first], tuple(FAULTS[name].acts(stage)))


def draw_fault_time(
    recording: Recording,
    forces_n: Sequence[float],
    rng: np.random.Generator,
    name: str | None = None,
    speed: float = 1.0,
) -> float:
    """Draw a time after contact, long before any force that is a cause by itself, and
    with the force from which the fault `name`, if any, can be seen; raises
    `InputError` if none is.
    """
    least_n = CONTACT_N
    if name is not None:
        least_n = FAULTS[name].least_n(median_interval_s(recording) / speed)
    force_n = np.asarray(forces_n)
    frames_s = np.array([entry.time_s for entry in recording.frames])
    touched = np.flatnonzero((force_n > CONTACT_N) & (force_n < HARMLESS_N))
    # a few frames in contact
    first = int(touched[0]) + 10 if len(touched) else len(force_n)
    over = np.flatnonzero(force_n >= HARMLESS_N)
    end_s = (frames_s[over[0]] if len(over) else frames_s[-1]) - WITHIN_S

    seen = (force_n > least_n) & (np.roll(force_n, 1) > least_n)
    possible = first + np.flatnonzero(seen[first:] & (frames_s <= end_s)[first:])
    if not len(possible):
        between = (
            f"contact ({from_si(least_n, 'mn'):g} mN) and"
            f" {from_si(HARMLESS_N, 'mn'):g} mN"
        )
        needs = (
            f"{WITHIN_S:g} s between {between} are needed; use a slower ramp, or"
            " `fault_at_s`"
        )
        raise InputError(f"{recording.path}: no room for a fault: {needs}")

    return float(frames_s[rng.choice(possible)])


def inject(player: Player, prepared: PreparedFault) -> FaultReport:
    """Do the prepared acts, each at a frame's time, until the robot withdraws or
    `WITHIN_S` has passed.

    The player has played up to the fault's time; its client is `observed`, so that a
    robot still hears the monitor when the scanner's connection is gone. It raises
    `InputError` if the monitor did not say OK before the fault.
    """
    client = player.client
    log = player.log
    name = prepared.name
    due_s, stamp_s = player.due(prepared.time_s)
    interval_s = median_interval_s(player.recording) / player.speed
    client.listen(due_s)

    if not log.ok:
        said = f"it said: {log.status.message if log.status else 'nothing'}"
        raise InputError(
            f"{player.recording.path}: the monitor was not watching when the fault was"
            f" due; {said}"
        )

    # the replay's own delay is not part of the fault
    held_s = max(0.0, client.clock() - due_s - STATED_S)
    due_s = due_s + held_s
    stamp_s = stamp_s + held_s
    began_s = since_s = client.clock()

    def doubted() -> bool:
        return log.first_doubt(since_s) is not None

    try:
        for index, act in enumerate(prepared.acts):
            sent_s = _do(player, act, stamp_s + index * interval_s)
            began_s = sent_s if index == 0 else began_s
            next_s = due_s + (index + 1) * interval_s
            client.listen(next_s, doubted)

            if doubted() or _silent(player, began_s) or next_s > began_s + WITHIN_S:
                break
        else:
            client.listen(began_s + WITHIN_S, doubted)
    except LinkError as gone:
        return FaultReport(
            name=name,
            began_s=began_s,
            delay_s=client.clock() - began_s,
            message=str(gone),
        )

    report = FaultReport(
        name=name, began_s=began_s, delay_s=None, message="the monitor still says OK"
    )
    if (change := log.first_doubt(since_s)) is not None:
        report = replace(
            report,
            delay_s=change.at_s - began_s,
            message=change.message,
            code=change.code,
        )
        return replace(
            report,
            cause=change.cause,
            expected=change.cause in [one.name for one in FAULTS[name].causes],
        )
    if _silent(player, began_s):
        delay_s = (log.status_s or began_s) + SILENT_S - began_s
        return replace(report, delay_s=delay_s, message="no STATUS for 150 ms")

    return report


def _silent(player: Player, began_s: float) -> bool:
    return (
        player.client.clock() - max(player.log.status_s or 0.0, began_s - SILENT_S)
        > SILENT_S
    )


def _do(player: Player, act: Act, stamp_s: float) -> float:
    """Do one act, as long as the monitor says OK; return when the last byte of its
    first message was sent.
    """
    client = player.client
    log = player.log
    begun_s = list[float]()
    if act is None:
        client.disconnect()

    for number, sending in enumerate(act or ()):
        if number and not log.ok:
            break

        message = sending.message
        time_s = stamp_s + sending.late_s

        try:
            begun_s.append(
                client.send(
                    message.stamped(time_s)
                    if isinstance(message, UnstampedMessage)
                    else message
                )
            )
        except LinkError:
            # the monitor has disconnected this client, whose robot connection hears the
            # answer
            break

        if isinstance(message, UnstampedMessage):
            log.sent(sending.number, message.frame_id, begun_s[-1])

        client.listen(client.clock())

    return begun_s[0] if begun_s else client.clock()


@dataclass
class _FaultMaterial:
    """The material of a fault: the frames that would come next, from `first` on;
    `number` is that of the last one sent.

    The fault is watched for the time of `count` frames, of which `left` remain in the
    recording; `last` is the picture before it.
    """

    recording: Recording
    first: int
    rng: np.random.Generator
    version: int
    interval_s: float
    given_n: Sequence[float] | None

    def __post_init__(self) -> None:
        self.count = ceil(WITHIN_S / self.interval_s) + 1
        self.number = self.first
        self.left = min(self.count, len(self.recording.frames) - self.first)
        self.last = self.pixels(-1)
        self.scan = self.recording.info.scan
        self.silence: list[Act] = [()] * self.count

    def pixels(self, index: int) -> Pixels:
        """Return the pixels of the frame `index` places after the first one of the
        fault.
        """
        return self.recording.frame(self.recording.frames[self.first + index])

    def sending(
        self, pixels: Pixels, matrix: tuple[float, ...] | None = None
    ) -> Sending:
        """Return a frame with the next number."""
        self.number += 1
        message = frame_message(
            pixels, self.scan, self.number, self.version, matrix=matrix
        )
        return Sending(message, self.number)

    def shown(self, pictures: Iterable[Pixels]) -> list[Act]:
        """Return pictures in place of the next frames."""
        return [(self.sending(pixels),) for pixels in pictures]

    @property
    def live(self) -> Iterator[Pixels]:
        """The pixels of the frames that would come next."""
        return map(self.pixels, range(self.left))

    def once(self, *sendings: Sending) -> list[Act]:
        """Return a wrong act in place of the first frame, and the frames after it."""
        return [sendings, *self.shown(map(self.pixels, range(1, self.left)))]

    def bytes_of_next(self) -> bytearray:
        """Return the next frame as it would be sent now."""
        message = self.sending(self.pixels(0)).message
        assert isinstance(message, UnstampedMessage)
        return message.stamped(time())

    def forces_n(self, least_n: float) -> Floats:
        """Return the force at each frame, of which one must be at least `least_n`."""
        if self.given_n is None:
            raise InputError(
                f"{self.recording.path}: no force at its frames; add truth.json or"
                " forces.csv"
            )

        forces_n = np.asarray(self.given_n)
        if not forces_n.max() >= least_n:
            needs = (
                f"this fault needs {from_si(least_n, 'mn'):g} mN: choose another"
                " recording"
            )
            found_mn = from_si(forces_n.max(), "mn")
            raise InputError(
                f"{self.recording.path}: forces up to {found_mn:.1f} mN; {needs}"
            )

        return forces_n

    def nearest(
        self, wanted_n: Sequence[float] | Floats, least_n: float
    ) -> list[Pixels]:
        """Return pixels of the frames with the nearest forces, avoiding recently shown
        ones while there are others.
        """
        forces_n = self.forces_n(least_n)
        shown = LIMITS.shown_frames
        chosen = list(range(max(0, self.first - shown), self.first))

        for force_n in wanted_n:
            order = np.argsort(np.abs(forces_n - force_n), kind="stable")
            recent = set(chosen[-shown:])
            chosen.append(
                int(next((index for index in order if index not in recent), order[0]))
            )

        return [
            self.recording.frame(self.recording.frames[index])
            for index in chosen[-len(wanted_n) :]
        ]

    def fallen(self, name: str, count: int) -> list[Pixels]:
        """Return pixels of frames after the fall that the fault `name` hides."""
        least_n = FAULTS[name].least_n(self.interval_s)
        before_n = self.forces_n(CONTACT_N)[self.first - 1]
        if before_n < least_n:
            raise InputError(
                f"{self.recording.path}: {from_si(before_n, 'mn'):.1f} mN at the fault;"
                f" its fall shows clearly only from {from_si(least_n, 'mn'):.1f} mN on:"
                " choose another time (`fault_at_s`)"
            )

        return self.nearest([LEFT * before_n] * count, CONTACT_N)


def _unusable(stage: _FaultMaterial) -> list[Act]:
    """Return noise, or black pixels with a few counts of noise, so that the picture
    does not count as frozen.
    """
    top = 2**stage.scan.pixel_bits if stage.rng.random() < 0.5 else 3
    like = stage.pixels(0)
    return stage.shown(
        _like(like, stage.rng.integers(0, top, like.shape)) for _ in range(stage.count)
    )


def _double_buffer(stage: _FaultMaterial) -> list[Act]:
    buffers = int(stage.rng.integers(2, min(MOST_BUFFERS, stage.first) + 1))
    old = [stage.pixels(back - buffers) for back in range(buffers)]
    return stage.shown(old[place % buffers] for place in range(stage.count))


def _burned_in_clock(stage: _FaultMaterial) -> list[Act]:
    last = stage.last
    pictures = []
    clock = ceil(len(last) * CLOCK_ROWS), ceil(last.shape[1] * CLOCK_COLUMNS)
    rows, columns = (1, 1) if stage.rng.random() < 0.5 else clock

    for place in range(stage.count):
        burned_in = last.copy()
        digits = stage.rng.integers(0, 2, (rows, columns)) * (
            2**stage.scan.pixel_bits - 1
        )
        burned_in[:rows, :columns] = digits ^ (place & 1)
        pictures.append(burned_in)

    return stage.shown(pictures)


def _dark_level(stage: _FaultMaterial) -> list[Act]:
    return stage.shown(
        _like(stage.last, stage.last + np.float64(place))
        for place in range(stage.count)
    )


def _moved(stage: _FaultMaterial) -> list[Act]:
    axis = int(stage.rng.integers(2))
    return stage.shown(np.roll(stage.last, place, axis) for place in range(stage.count))


def _half_frozen(stage: _FaultMaterial) -> list[Act]:
    axis, side = (int(stage.rng.integers(2)) for _ in range(2))
    shape = stage.last.shape
    half = (np.indices(shape, sparse=True)[axis] >= shape[axis] // 2) == bool(side)
    return stage.shown(np.where(half, stage.last, live) for live in stage.live)


def _ghost(stage: _FaultMaterial) -> list[Act]:
    old = stage.rng.uniform(*OLD_SHARES)
    return stage.shown(
        _like(live, old * stage.last + (1.0 - old) * live) for live in stage.live
    )


def _persistence(stage: _FaultMaterial) -> list[Act]:
    old = stage.rng.uniform(*OLD_SHARES)
    mean = stage.last.astype(np.float64)
    means = accumulate(
        stage.live, lambda mean, seen: old * mean + (1.0 - old) * seen, initial=mean
    )
    return stage.shown(_like(stage.last, mean) for mean in islice(means, 1, None))


def _pixel_type(stage: _FaultMaterial) -> list[Act]:
    last = stage.last
    above = max(0, stage.scan.pixel_bits - 8)
    other = (
        last.astype(np.uint16)
        if last.dtype == np.uint8
        else (last >> above).astype(np.uint8)
    )

    return stage.shown(last if place % 2 else other for place in range(stage.count))


def _like(pixels: Pixels, values: NDArray[np.generic]) -> Pixels:
    counts = np.clip(np.rint(values.astype(np.float64)), 0, np.iinfo(pixels.dtype).max)
    return (
        counts.astype(np.uint8)
        if pixels.dtype == np.uint8
        else counts.astype(np.uint16)
    )


def _stale(stage: _FaultMaterial) -> list[Act]:
    return [
        tuple(
            replace(sending, late_s=-LATER * place * stage.interval_s)
            for sending in act or ()
        )
        for place, act in enumerate(stage.shown(stage.live), start=1)
    ]


def _out_of_order(stage: _FaultMaterial) -> list[Act]:
    back = int(stage.rng.integers(1, min(stage.first, 20)))
    stage.number -= back + 1
    old = replace(stage.sending(stage.pixels(0)), late_s=-(back + 1) * stage.interval_s)
    stage.number = stage.first + 1
    return stage.once(old)


def _scale(stage: _FaultMaterial) -> list[Act]:
    matrix = tuple(1.03 * value for value in image_matrix(stage.scan))
    return stage.once(stage.sending(stage.pixels(0), matrix))


def _nan(stage: _FaultMaterial) -> list[Act]:
    matrix = np.array(image_matrix(stage.scan))
    matrix[stage.rng.integers(12)] = nan
    return stage.once(stage.sending(stage.pixels(0), tuple(matrix.tolist())))


def _checksum(stage: _FaultMaterial) -> list[Act]:
    data = stage.bytes_of_next()
    data[int(stage.rng.integers(HEADER_BYTES, len(data)))] ^= 1 << int(
        stage.rng.integers(8)
    )
    return stage.once(Sending(bytes(data)))


def _bad_image(stage: _FaultMaterial) -> list[Act]:
    """The body states more pixels than it has; its length in the header and its
    checksum are right.
    """
    data = stage.bytes_of_next()
    header = unpack_header(data[:HEADER_BYTES])
    body = bytes(data[HEADER_BYTES : -int(stage.rng.integers(1, len(data) // 2))])
    if stage.version > 1:  # the metadata follows the pixels
        body = body[:-2] + bytes(2)

    head = pack_header(
        replace(header, body_bytes=len(body), crc=fastcrc.crc64.ecma_182(body))
    )
    return stage.once(Sending(head + body))


def _flood(stage: _FaultMaterial) -> list[Act]:
    several = [
        stage.pixels(index)
        for index in range(min(FLOOD, len(stage.recording.frames) - stage.first))
    ]
    burst = [stage.sending(several[place % len(several)]) for place in range(FLOOD)]

    return stage.once(
        *(replace(sending, late_s=place * 1e-5) for place, sending in enumerate(burst))
    )


def _rising(stage: _FaultMaterial) -> list[Act]:
    forces_n = stage.forces_n(BOUND_N)
    wanted_n = forces_n[stage.first - 1] + RISE_N_PER_S * stage.interval_s * np.arange(
        1, stage.count + 1
    )
    return stage.shown(stage.nearest(np.minimum(wanted_n, forces_n.max()), BOUND_N))


def _dangerous(stage: _FaultMaterial) -> list[Act]:
    forces_n = stage.forces_n(DANGEROUS_N)
    wanted_n = stage.rng.choice(forces_n[forces_n >= DANGEROUS_N])
    return stage.once(*map(stage.sending, stage.nearest([wanted_n], DANGEROUS_N)))


def _pause(stage: _FaultMaterial) -> list[Act]:
    missing = ceil(PAUSE_S / stage.interval_s)
    after = stage.fallen("pause", stage.count - missing)
    return [*stage.silence[:missing], *stage.shown(after)]


def _bunch(stage: _FaultMaterial) -> list[Act]:
    frames = ceil(PAUSE_S / stage.interval_s)
    held = frames // 2
    fallen = stage.fallen("bunch", stage.count - held)
    bunch = [stage.sending(stage.pixels(index)) for index in range(held)]
    bunch += map(stage.sending, fallen[: frames - held])
    at_once = tuple(
        replace(sending, late_s=(place + 1 - frames) * stage.interval_s)
        for place, sending in enumerate(bunch)
    )
    later = stage.shown(fallen[frames - held :])

    return [*stage.silence[: frames - 1], at_once, *later]


def _parts(stage: _FaultMaterial) -> list[Act]:
    return [_in_parts(stage, pixels) for pixels in stage.live]


def _in_parts(stage: _FaultMaterial, pixels: Pixels) -> tuple[Sending, Sending]:
    """Return a picture whose last row alone is fresh."""
    stage.number += 1
    rows, columns = pixels.shape
    old, fresh = (
        UnstampedMessage(
            Image(
                pixels[None, first:after],
                image_matrix(stage.scan),
                (columns, rows, 1),
                (0, first, 0),
            ),
            SCANNER_DEVICE,
            stage.version,
            stage.number,
        )
        for first, after in ((0, rows - 1), (rows - 1, rows))
    )
    return Sending(old, stage.number, -OLD_S), Sending(fresh, stage.number)


def _contact_n(_: float) -> float:
    return CONTACT_N


def _unseen_n(_: float) -> float:
    """Return the force from which a fall to a quarter in a gap is beyond doubt, N."""
    return (LIMITS.fall_n + CLEARLY_N) / (1.0 - LEFT)


def _pierced_n(interval_s: float) -> float:
    """Return the force from which a fall to a quarter is a puncture, N, although all
    frames come: more than a withdrawal makes from one of them to the next.
    """
    within_s = min(interval_s, LIMITS.fall_s)
    moved_m = (LIMITS.retraction_m_s + LIMITS.eye_m_s) * within_s
    return _unseen_n(interval_s) + LIMITS.stiffness_n_m * moved_m / (1.0 - LEFT)


def _half(stage: _FaultMaterial) -> list[Act]:
    data = stage.bytes_of_next()
    return [(Sending(bytes(data[: len(data) // 2])),), *stage.silence]


@dataclass(frozen=True)
class ScannerFault:
    """A kind of fault: a line that describes it, its acts, and the causes that a
    monitor should give.

    `least_n` gives the force from which it can be seen, N, for a time between frames,
    s.
    """

    line: str
    acts: Callable[[_FaultMaterial], list[Act]]
    causes: tuple[Cause, ...] = (Cause.FROZEN,)
    least_n: Callable[[float], float] = _contact_n


FAULTS: Mapping[str, ScannerFault] = MappingProxyType(
    {
        "unusable": ScannerFault(
            "frames that show noise, or nothing", _unusable, (Cause.UNUSABLE,)
        ),
        "silence": ScannerFault(
            "no more frames; the connection stays",
            lambda stage: stage.silence,
            (Cause.SILENCE,),
        ),
        "frozen": ScannerFault(
            "the same picture again and again, with new numbers and times",
            lambda stage: stage.shown([stage.last] * stage.count),
        ),
        "double-buffer": ScannerFault(
            "the last 2 to 10 pictures in turns, with new numbers and times",
            _double_buffer,
        ),
        "burned-in-clock": ScannerFault(
            "the same picture, in which a clock or one pixel changes", _burned_in_clock
        ),
        "dark-level": ScannerFault(
            "the same picture, one count brighter with each frame", _dark_level
        ),
        "moved": ScannerFault(
            "the same picture, moved by a row or a column with each frame", _moved
        ),
        "half-frozen": ScannerFault(
            "live pictures, one half of which stays", _half_frozen
        ),
        "ghost": ScannerFault("60 to 95 % of one old picture, the rest live", _ghost),
        "persistence": ScannerFault(
            "a filter that keeps 60 to 95 % of its last picture", _persistence
        ),
        "pixel-type": ScannerFault(
            "the same picture with 8 and 16 bits in turns",
            _pixel_type,
            (Cause.PIXEL_TYPE,),
        ),
        "stale": ScannerFault(
            "frames that wait longer and longer in their sender's queue",
            _stale,
            (Cause.STALE,),
        ),
        "out-of-order": ScannerFault(
            "a frame with an older number and time",
            _out_of_order,
            (Cause.OUT_OF_ORDER,),
        ),
        "size": ScannerFault(
            "a frame of half the rows",
            lambda stage: stage.once(
                stage.sending(stage.pixels(0)[: stage.scan.shape[0] // 2])
            ),
            (Cause.SIZE,),
        ),
        "scale": ScannerFault(
            "a frame whose pixels are stated 3 % too large", _scale, (Cause.SCALE,)
        ),
        "checksum": ScannerFault(
            "a frame with one byte flipped", _checksum, (Cause.CHECKSUM,)
        ),
        "nan": ScannerFault("a frame whose matrix has a NaN", _nan, (Cause.BAD_IMAGE,)),
        "bad-image": ScannerFault(
            "a frame whose body is shorter than it states",
            _bad_image,
            (Cause.BAD_IMAGE,),
        ),
        "flood": ScannerFault(f"{FLOOD} frames at once", _flood, (Cause.QUEUE_BEHIND,)),
        "rising": ScannerFault(
            "the force rises by 150 mN/s (needs a recording that has such forces)",
            _rising,
            (Cause.RISING, Cause.BOUND),
        ),
        "dangerous": ScannerFault(
            "a frame of class 2 out of nothing (needs a recording that has one)",
            _dangerous,
            (Cause.DANGEROUS_CLASS, Cause.BOUND, Cause.RISING),
        ),
        "pause": ScannerFault(
            "no frame for 60 ms, in which the force falls to a quarter (needs forces)",
            _pause,
            (Cause.UNSEEN_FALL, Cause.PIERCED),
            _unseen_n,
        ),
        "bunch": ScannerFault(
            "the frames of 60 ms at once, in which the force falls (needs forces)",
            _bunch,
            (Cause.UNSEEN_FALL, Cause.PIERCED),
            _pierced_n,
        ),
        "parts": ScannerFault(
            "pictures in two parts, of which the first is 5 s old",
            _parts,
            (Cause.BAD_IMAGE,),
        ),
        "half": ScannerFault("half a frame, and nothing more", _half, (Cause.SILENCE,)),
        "garbage": ScannerFault(
            "bytes that are not OpenIGTLink",
            lambda stage: [(Sending(b"\xff" + stage.rng.bytes(4095)),), *stage.silence],
            (Cause.BAD_IMAGE,),
        ),
        "disconnect": ScannerFault(
            "the connection is closed",
            lambda stage: [None, *stage.silence],
            (Cause.SILENCE,),
        ),
    }
)
