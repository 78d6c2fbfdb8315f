"""Faults of a scanner and its connection, injected on purpose: does the monitor withdraw, when, and why?"""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from types import MappingProxyType

import numpy as np

from scleraforce.errors import InputError, LinkError
from scleraforce.monitor.causes import Cause
from scleraforce.recording.folder import Recording
from scleraforce.replay.answer_log import Change
from scleraforce.replay.fault_acts import BOUND_N, FLOOD, WITHIN_S, Act, PreparedFault, Sending
from scleraforce.replay.player import STATED_S, Player, median_interval_s
from scleraforce.replay.scanner_client import Unstamped
from scleraforce.units import from_si

CONTACT_N, HARMLESS_N = 4e-3, BOUND_N - 6e-3  # clear of the monitor's bounds by the error of a reading
SILENT_S = 0.15  # without a STATUS, after which the robot withdraws by itself


@dataclass(frozen=True)
class Fault:
    """A kind of fault: a line that describes it, and the causes that a monitor should give."""

    line: str
    causes: tuple[Cause, ...]


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "unusable": Fault("frames that show noise, or nothing", (Cause.UNUSABLE,)),
        "silence": Fault("no more frames; the connection stays", (Cause.SILENCE,)),
        "frozen": Fault("the same picture again and again, with new numbers and times", (Cause.FROZEN,)),
        "double-buffer": Fault("the last 2 to 10 pictures in turns, with new numbers and times", (Cause.FROZEN,)),
        "burned-in-clock": Fault("the same picture, in which a clock or one pixel changes", (Cause.FROZEN,)),
        "dark-level": Fault("the same picture, one count brighter with each frame", (Cause.FROZEN,)),
        "moved": Fault("the same picture, moved by a row or a column with each frame", (Cause.FROZEN,)),
        "half-frozen": Fault("live pictures, one half of which stays", (Cause.FROZEN,)),
        "ghost": Fault("60 to 95 % of one old picture, the rest live", (Cause.FROZEN,)),
        "persistence": Fault("a filter that keeps 60 to 95 % of its last picture", (Cause.FROZEN,)),
        "pixel-type": Fault("the same picture with 8 and 16 bits in turns", (Cause.PIXEL_TYPE,)),
        "stale": Fault("frames that wait longer and longer in their sender's queue", (Cause.STALE,)),
        "out-of-order": Fault("a frame with an older number and time", (Cause.OUT_OF_ORDER,)),
        "size": Fault("a frame of half the rows", (Cause.SIZE,)),
        "scale": Fault("a frame whose pixels are stated 3 % too large", (Cause.SCALE,)),
        "checksum": Fault("a frame with one byte flipped", (Cause.CHECKSUM,)),
        "nan": Fault("a frame whose matrix has a NaN", (Cause.BAD_IMAGE,)),
        "bad-image": Fault("a frame whose body is shorter than it states", (Cause.BAD_IMAGE,)),
        "flood": Fault(f"{FLOOD} frames at once", (Cause.QUEUE_BEHIND,)),
        "rising": Fault("the force rises by 150 mN/s (needs a recording that has such forces)",
                        (Cause.RISING, Cause.BOUND)),
        "dangerous": Fault("a frame of class 2 out of nothing (needs a recording that has one)",
                           (Cause.DANGEROUS_CLASS, Cause.BOUND, Cause.RISING)),
        "half": Fault("half a frame, and nothing more", (Cause.SILENCE,)),
        "garbage": Fault("bytes that are not OpenIGTLink", (Cause.BAD_IMAGE,)),
        "disconnect": Fault("the connection is closed", (Cause.SILENCE,)),
    }
)  # fmt: skip


@dataclass(frozen=True)
class FaultReport:
    """The consequence of a fault.

    Attributes:
        name: of the fault.
        began_s: when its first act was done (s, monotonic); for a silence, when the frame was due.
        delay_s: from then until the robot withdraws; None if it does not within `WITHIN_S`.
        code: of the STATUS; None if no STATUS came for 150 ms, or the monitor has gone.
        cause: name of the cause in the STATUS.
        message: of the STATUS, or what happened instead.
        expected: whether the cause is one of those of the fault.
    """

    name: str
    _: KW_ONLY
    began_s: float
    delay_s: float | None
    code: int | None
    cause: str | None
    message: str
    expected: bool


def draw_fault_time(recording: Recording, forces_n: Sequence[float], rng: np.random.Generator) -> float:
    """Draw when a fault begins: after contact, and long enough before any force that is a cause by itself.

    Raises:
        InputError: the recording has no such time.
    """
    force_n = np.asarray(forces_n)
    frames_s = np.array([entry.time_s for entry in recording.frames])
    touched = np.flatnonzero((force_n > CONTACT_N) & (force_n < HARMLESS_N))
    first = int(touched[0]) + 10 if len(touched) else len(force_n)  # a few frames in contact
    over = np.flatnonzero(force_n >= HARMLESS_N)
    end_s = (frames_s[over[0]] if len(over) else frames_s[-1]) - WITHIN_S
    possible = [
        index for index in range(first, len(force_n)) if frames_s[index] <= end_s and force_n[index] > CONTACT_N
    ]
    if not possible:
        raise InputError(
            f"{recording.path}: no room for a fault: {WITHIN_S:g} s between contact ({from_si(CONTACT_N, 'mn'):g} mN) "
            f"and {from_si(HARMLESS_N, 'mn'):g} mN are needed; use a slower ramp, or --fault-at-s"
        )
    return float(frames_s[rng.choice(possible)])


def inject(player: Player, prepared: PreparedFault) -> FaultReport:
    """Do the prepared acts, each at a frame's time, until the robot withdraws or `WITHIN_S` has passed.

    Args:
        player: has played up to the fault's time; its client is `observed`, so that a robot still hears the monitor
            when the scanner's connection is gone.
        prepared: the fault.

    Raises:
        InputError: the monitor did not say OK before the fault, so nothing can be observed.
    """
    client, log, fault = player.client, player.log, FAULTS[prepared.name]
    due_s, stamp_s = player.due(prepared.time_s)
    interval_s = median_interval_s(player.recording) / player.speed
    client.listen(due_s)
    if not log.ok:
        said = log.status.message if log.status else "nothing"
        raise InputError(
            f"{player.recording.path}: the monitor was not watching when the fault was due; it said: {said}"
        )
    held_s = max(0.0, client.clock() - due_s - STATED_S)  # the replay's own delay is not part of the fault
    due_s, stamp_s = due_s + held_s, stamp_s + held_s
    began_s = since_s = client.clock()
    change: Change | None = None
    try:
        for index, act in enumerate(prepared.acts):
            sent_s = _do(player, act, stamp_s + index * interval_s)
            began_s = sent_s if index == 0 else began_s
            next_s = due_s + (index + 1) * interval_s
            client.listen(next_s, lambda: log.first_doubt(since_s) is not None)
            change = log.first_doubt(since_s)
            if change or _silent(player, began_s) or next_s > began_s + WITHIN_S:
                break
        else:
            client.listen(began_s + WITHIN_S, lambda: log.first_doubt(since_s) is not None)
            change = log.first_doubt(since_s)
    except LinkError as fault_of_link:
        return FaultReport(
            prepared.name,
            began_s=began_s,
            delay_s=client.clock() - began_s,
            code=None,
            cause=None,
            message=str(fault_of_link),
            expected=False,
        )
    if change is None and _silent(player, began_s):
        heard_s = log.status_s or began_s
        return FaultReport(
            prepared.name,
            began_s=began_s,
            delay_s=heard_s + SILENT_S - began_s,
            code=None,
            cause=None,
            message="no STATUS for 150 ms",
            expected=False,
        )
    if change is None:
        return FaultReport(
            prepared.name,
            began_s=began_s,
            delay_s=None,
            code=None,
            cause=None,
            message="the monitor still says OK",
            expected=False,
        )
    expected = change.cause in [cause.name for cause in fault.causes]
    return FaultReport(
        prepared.name,
        began_s=began_s,
        delay_s=change.at_s - began_s,
        code=change.code,
        cause=change.cause,
        message=change.message,
        expected=expected,
    )


def _silent(player: Player, began_s: float) -> bool:
    return player.client.clock() - max(player.log.status_s or 0.0, began_s - SILENT_S) > SILENT_S


def _do(player: Player, act: Act, stamp_s: float) -> float:
    """Do one act; return when the last byte of its first message was sent."""
    if act is None:
        player.client.disconnect()
    begun_s: float | None = None
    for sending in act or ():
        sent_s = _send(player, sending, stamp_s)
        player.client.listen(player.client.clock())
        begun_s = sent_s if begun_s is None else begun_s
        if sent_s is None or not player.log.ok:
            break
    return player.client.clock() if begun_s is None else begun_s


def _send(player: Player, sending: Sending, stamp_s: float) -> float | None:
    """Send; return None if the monitor has disconnected this client, whose robot connection then hears the answer."""
    message, time_s = sending.message, stamp_s + sending.late_s
    try:
        sent_s = player.client.send(message.stamped(time_s) if isinstance(message, Unstamped) else message)
    except LinkError:
        return None
    if isinstance(message, Unstamped):
        player.log.sent(sending.number, message.frame_id, sent_s)
    return sent_s
