"""The messages of each fault, prepared before it is due, so that reading and encoding delay nothing.

After the fault the recording goes on where it can, so that a silence does not hide a fault that the monitor missed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, nan
from time import time
from types import MappingProxyType

import fastcrc
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.monitor import MonitorLimits
from scleraforce.openigtlink.wire import HEADER_BYTES, pack_header, unpack_header
from scleraforce.recording.folder import Recording
from scleraforce.recording.pixels import Pixels
from scleraforce.replay.player import median_interval_s
from scleraforce.replay.scanner_client import Unstamped, frame_message, image_matrix
from scleraforce.units import from_si

WITHIN_S = 0.5  # a withdrawal later than this does not count
BOUND_N = MonitorLimits().bound_n
DANGEROUS_N = BOUND_N + 3e-3  # clear of the bound by the error of a reading
RISE_N_PER_S = 0.15
FLOOD = 100  # frames of a second; fewer might be read as fast as they come, which is no fault
MOST_BUFFERS = 10  # pictures that a stuck buffer shows in turns
CLOCK_ROWS, CLOCK_COLUMNS = 1 / 32, 1 / 8  # of the frame, where a time is burned in
OLD_SHARES = 0.6, 0.95  # of an old picture, in a ghost
LATER = 0.8  # of an interval, by which each frame waits longer than the one before


@dataclass(frozen=True)
class Sending:
    """One message: a frame, with its number and a time that may be wrong; or bytes as they are."""

    message: Unstamped | bytes
    number: int = 0
    late_s: float = 0.0


Act = tuple[Sending, ...] | None  # what is sent at a frame's time; None: the connection is closed


@dataclass(frozen=True)
class PreparedFault:
    """A prepared fault: its name, its time in the recording (s), and the acts from then on."""

    name: str
    time_s: float
    acts: tuple[Act, ...]


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
    """Prepare a fault that takes the place of the first frame at or after a time of the recording.

    Args:
        name: one of `faults.FAULTS`.
        recording: played before the fault and after it.
        time_s: on the recording's clock.
        rng: for random choices: noise or black, the byte that flips.
        version: of the headers.
        speed: recorded seconds in a second.
        forces_n: the force at each frame; "rising" and "dangerous" need it.

    Raises:
        InputError: no such fault, no such time, or a recording without the frames or forces that it needs.
    """
    if name not in ACTS:
        raise InputError(f"fault: {name!r}; choose one of: {', '.join(ACTS)}")
    frames_s = [entry.time_s for entry in recording.frames]
    first = int(np.searchsorted(frames_s, time_s))
    if not 2 <= first < len(frames_s) - 1:
        raise InputError(
            f"{recording.path}: a fault at {time_s:g} s; frames are from {frames_s[2]:g} to {frames_s[-2]:g} s"
        )
    stage = _Stage(recording, first, rng, version, median_interval_s(recording) / speed, forces_n)
    acts = ACTS[name](stage)
    return PreparedFault(name, frames_s[first], tuple(acts))


class _Stage:
    """The material of a fault: the frames that would come next, and numbers for those sent instead."""

    def __init__(
        self,
        recording: Recording,
        first: int,
        rng: np.random.Generator,
        version: int,
        interval_s: float,
        forces_n: Sequence[float] | None,
    ) -> None:
        self.recording, self.first, self.rng, self.version, self.interval_s = recording, first, rng, version, interval_s
        self.count = ceil(WITHIN_S / interval_s) + 1
        self.number = first  # of the last frame before the fault
        self._forces_n = forces_n

    def pixels(self, index: int) -> Pixels:
        """Return the pixels of the frame `index` places after the first one of the fault."""
        return self.recording.frame(self.recording.frames[self.first + index])

    def sending(self, pixels: Pixels, matrix: tuple[float, ...] | None = None) -> Sending:
        """Return a frame with the next number."""
        self.number += 1
        message = frame_message(pixels, self.recording.info.oct, self.number, self.version, matrix=matrix)
        return Sending(message, self.number)

    @property
    def left(self) -> int:
        """Number of frames that the scanner would send from the fault on, while it is watched."""
        return min(self.count, len(self.recording.frames) - self.first)

    def onward(self, begin: int) -> list[Act]:
        """Return the frames that the scanner would send from `begin` on."""
        return [(self.sending(self.pixels(index)),) for index in range(begin, self.left)]

    def forces_n(self, least_n: float) -> NDArray[np.float64]:
        """Return the force at each frame, of which one must be at least `least_n`."""
        if self._forces_n is None:
            raise InputError(f"{self.recording.path}: no force at its frames; add truth.json or forces.csv")
        forces_n = np.asarray(self._forces_n)
        if not forces_n.max() >= least_n:
            found = (
                f"forces up to {from_si(forces_n.max(), 'mn'):.1f} mN; this fault needs {from_si(least_n, 'mn'):g} mN"
            )
            raise InputError(f"{self.recording.path}: {found}: choose another recording")
        return forces_n

    def nearest(self, wanted_n: Sequence[float] | NDArray[np.float64], least_n: float) -> list[Pixels]:
        """Return pixels of the frames with the nearest forces, avoiding recently shown ones while there are others."""
        forces_n, shown = self.forces_n(least_n), MonitorLimits().shown_frames
        chosen = list(range(max(0, self.first - shown), self.first))
        for force_n in wanted_n:
            order = np.argsort(np.abs(forces_n - force_n), kind="stable")
            recent = set(chosen[-shown:])
            chosen.append(int(next((index for index in order if index not in recent), order[0])))
        return [self.recording.frame(self.recording.frames[index]) for index in chosen[-len(wanted_n) :]]


def _unusable(stage: _Stage) -> list[Act]:
    """Noise, or nothing: black pixels with a few counts of noise, so that the picture does not count as frozen."""
    top = 2**stage.recording.info.oct.bits if stage.rng.random() < 0.5 else 3
    like = stage.pixels(0)
    counts = [stage.rng.integers(0, top, like.shape) for _ in range(stage.count)]
    if like.dtype == np.uint8:
        return [(stage.sending(wrong.astype(np.uint8)),) for wrong in counts]
    return [(stage.sending(wrong.astype(np.uint16)),) for wrong in counts]


def _silence(stage: _Stage) -> list[Act]:
    return [()] * stage.count


def _frozen(stage: _Stage) -> list[Act]:
    last = stage.pixels(-1)
    return [(stage.sending(last),) for _ in range(stage.count)]


def _double_buffer(stage: _Stage) -> list[Act]:
    """The last pictures in turns, as from a buffer that is not refilled."""
    most = min(MOST_BUFFERS, stage.first)
    buffers = int(stage.rng.integers(2, most + 1))
    old = [stage.pixels(back - buffers) for back in range(buffers)]
    return [(stage.sending(old[place % buffers]),) for place in range(stage.count)]


def _burned_in_clock(stage: _Stage) -> list[Act]:
    """The last picture with a corner that changes: a clock, or a single pixel."""
    last = stage.pixels(-1)
    rows, columns = ceil(len(last) * CLOCK_ROWS), ceil(last.shape[1] * CLOCK_COLUMNS)
    if stage.rng.random() < 0.5:
        rows, columns = 1, 1
    acts: list[Act] = []
    for place in range(stage.count):
        burned_in = last.copy()
        digits = stage.rng.integers(0, 2, (rows, columns)) * (2**stage.recording.info.oct.bits - 1)
        burned_in[:rows, :columns] = digits ^ (place & 1)
        acts.append((stage.sending(burned_in),))
    return acts


def _dark_level(stage: _Stage) -> list[Act]:
    """The last picture, one count brighter with each frame."""
    last = stage.pixels(-1)
    return [(stage.sending(_like(last, last + np.float64(place))),) for place in range(stage.count)]


def _moved(stage: _Stage) -> list[Act]:
    """The last picture, moved by a row or a column with each frame."""
    last, axis = stage.pixels(-1), int(stage.rng.integers(2))
    return [(stage.sending(np.roll(last, place, axis)),) for place in range(stage.count)]


def _half_frozen(stage: _Stage) -> list[Act]:
    """Live pictures with one half of the last one: left, right, upper or lower."""
    last, acts = stage.pixels(-1), list[Act]()
    axis, side = (int(stage.rng.integers(2)) for _ in range(2))
    middle = last.shape[axis] // 2
    half = (slice(None),) * axis + (slice(middle, None) if side else slice(middle),)
    for index in range(stage.left):
        mixed = stage.pixels(index).copy()
        mixed[half] = last[half]
        acts.append((stage.sending(mixed),))
    return acts


def _ghost(stage: _Stage) -> list[Act]:
    """The last picture with some of the live one: 60 to 95 % are old."""
    last, old = stage.pixels(-1), stage.rng.uniform(*OLD_SHARES)
    mixed = [_like(last, old * last + (1.0 - old) * stage.pixels(index)) for index in range(stage.left)]
    return [(stage.sending(pixels),) for pixels in mixed]


def _persistence(stage: _Stage) -> list[Act]:
    """What a recursive filter shows that keeps 60 to 95 % of its last picture."""
    last, old, acts = stage.pixels(-1), stage.rng.uniform(*OLD_SHARES), list[Act]()
    mean = last.astype(np.float64)
    for index in range(stage.left):
        mean = old * mean + (1.0 - old) * stage.pixels(index)
        acts.append((stage.sending(_like(last, mean)),))
    return acts


def _pixel_type(stage: _Stage) -> list[Act]:
    """The last picture with 8 and with 16 bits in turns."""
    last = stage.pixels(-1)
    if last.dtype == np.uint8:
        turns: tuple[Pixels, Pixels] = last.astype(np.uint16), last
    else:
        turns = (last >> max(0, stage.recording.info.oct.bits - 8)).astype(np.uint8), last
    return [(stage.sending(turns[place % 2]),) for place in range(stage.count)]


def _like(pixels: Pixels, values: NDArray[np.float64]) -> Pixels:
    """Return values as counts of the type of some pixels."""
    counts = np.clip(np.rint(values), 0, np.iinfo(pixels.dtype).max)
    return counts.astype(np.uint8) if pixels.dtype == np.uint8 else counts.astype(np.uint16)


def _stale(stage: _Stage) -> list[Act]:
    """A growing queue in the sender: each frame has waited longer than the one before."""
    waited = [
        replace(sending, late_s=-LATER * place * stage.interval_s)
        for place, act in enumerate(stage.onward(0), start=1)
        for sending in act or ()
    ]
    return [(sending,) for sending in waited]


def _out_of_order(stage: _Stage) -> list[Act]:
    back = int(stage.rng.integers(1, min(stage.first, 20)))
    stage.number -= back + 1
    old = replace(stage.sending(stage.pixels(0)), late_s=-(back + 1) * stage.interval_s)
    stage.number = stage.first + 1
    return [(old,), *stage.onward(1)]


def _size(stage: _Stage) -> list[Act]:
    pixels = stage.pixels(0)
    return [(stage.sending(pixels[: len(pixels) // 2]),), *stage.onward(1)]


def _scale(stage: _Stage) -> list[Act]:
    return [(stage.sending(stage.pixels(0), _matrix(stage, 1.03)),), *stage.onward(1)]


def _nan(stage: _Stage) -> list[Act]:
    matrix = list(_matrix(stage, 1.0))
    matrix[int(stage.rng.integers(12))] = nan
    return [(stage.sending(stage.pixels(0), tuple(matrix)),), *stage.onward(1)]


def _matrix(stage: _Stage, scale: float) -> tuple[float, ...]:
    return tuple(scale * value for value in image_matrix(stage.recording.info.oct))


def _checksum(stage: _Stage) -> list[Act]:
    sending = stage.sending(stage.pixels(0))
    data = _bytes(sending)
    data[int(stage.rng.integers(HEADER_BYTES, len(data)))] ^= 1 << int(stage.rng.integers(8))
    return [(Sending(bytes(data)),), *stage.onward(1)]


def _bad_image(stage: _Stage) -> list[Act]:
    """The body states more pixels than it has; its length in the header and its checksum are right."""
    data = _bytes(stage.sending(stage.pixels(0)))
    header = unpack_header(data[:HEADER_BYTES])
    body = bytes(data[HEADER_BYTES : -int(stage.rng.integers(1, len(data) // 2))])
    if stage.version > 1:  # the metadata stays behind the pixels
        body = body[:-2] + bytes(2)
    head = pack_header(replace(header, body_bytes=len(body), crc=fastcrc.crc64.ecma_182(body)))
    return [(Sending(head + body),), *stage.onward(1)]


def _bytes(sending: Sending) -> bytearray:
    assert isinstance(sending.message, Unstamped)
    return sending.message.stamped(time())


def _flood(stage: _Stage) -> list[Act]:
    several = [stage.pixels(index) for index in range(min(FLOOD, len(stage.recording.frames) - stage.first))]
    burst = [stage.sending(several[place % len(several)]) for place in range(FLOOD)]
    return [tuple(replace(sending, late_s=place * 1e-5) for place, sending in enumerate(burst)), *stage.onward(1)]


def _rising(stage: _Stage) -> list[Act]:
    start_n = stage.forces_n(BOUND_N)[stage.first - 1]
    wanted_n = start_n + RISE_N_PER_S * stage.interval_s * np.arange(1, stage.count + 1)
    top_n = stage.forces_n(BOUND_N).max()
    return [(stage.sending(pixels),) for pixels in stage.nearest(np.minimum(wanted_n, top_n), BOUND_N)]


def _dangerous(stage: _Stage) -> list[Act]:
    forces_n = stage.forces_n(DANGEROUS_N)
    wanted_n = stage.rng.choice(forces_n[forces_n >= DANGEROUS_N])
    (pixels,) = stage.nearest([wanted_n], DANGEROUS_N)
    return [(stage.sending(pixels),), *stage.onward(1)]


def _half(stage: _Stage) -> list[Act]:
    data = _bytes(stage.sending(stage.pixels(0)))
    return [(Sending(bytes(data[: len(data) // 2])),), *_silence(stage)]


def _garbage(stage: _Stage) -> list[Act]:
    return [(Sending(b"\xff" + stage.rng.bytes(4095)),), *_silence(stage)]


def _disconnect(stage: _Stage) -> list[Act]:
    return [None, *_silence(stage)]


ACTS: Mapping[str, Callable[[_Stage], list[Act]]] = MappingProxyType(
    {
        "unusable": _unusable, "silence": _silence, "frozen": _frozen, "double-buffer": _double_buffer,
        "burned-in-clock": _burned_in_clock, "dark-level": _dark_level, "moved": _moved, "half-frozen": _half_frozen,
        "ghost": _ghost, "persistence": _persistence, "pixel-type": _pixel_type,
        "stale": _stale, "out-of-order": _out_of_order, "size": _size,
        "scale": _scale, "checksum": _checksum, "nan": _nan, "bad-image": _bad_image, "flood": _flood,
        "rising": _rising, "dangerous": _dangerous, "half": _half, "garbage": _garbage, "disconnect": _disconnect,
    }
)  # fmt: skip
