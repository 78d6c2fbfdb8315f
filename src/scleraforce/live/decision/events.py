"""States, signals and causes, the table that the monitor follows, and its events.

Events are frozen records with their time (s, on a monotonic clock that the caller
reads).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from scleraforce.records.verdict import Verdict


class State(Enum):
    """The state of the monitor; the value is the code of the OpenIGTLink STATUS."""

    NOT_READY = 13
    WATCHING = 1
    PIERCED = 14  # reported only: OpenIGTLink's "manual mode"
    WITHDRAW = 3


class Signal(Enum):
    """The meaning of an event, judged by the limits."""

    HARMLESS = "harmless frame"
    TOLERATED = "unusable frame, tolerated"
    UNJUDGED = "unusable frame before contact"
    QUIET = "nothing new"
    ALARM = "cause of a withdrawal"
    PIERCED = "wall pierced, to be reported only"
    RESET_GRANTED = "reset after fresh harmless frames"
    RESET_REFUSED = "reset, refused"


MOVES = {
    (State.NOT_READY, Signal.HARMLESS): State.WATCHING,
    (State.NOT_READY, Signal.PIERCED): State.PIERCED,
    (State.NOT_READY, Signal.ALARM): State.WITHDRAW,
    (State.WATCHING, Signal.UNJUDGED): State.NOT_READY,
    (State.WATCHING, Signal.PIERCED): State.PIERCED,
    (State.WATCHING, Signal.ALARM): State.WITHDRAW,
    (State.PIERCED, Signal.ALARM): State.WITHDRAW,
    (State.PIERCED, Signal.RESET_GRANTED): State.WATCHING,
    (State.WITHDRAW, Signal.RESET_GRANTED): State.WATCHING,
}
LATCHED = (State.PIERCED, State.WITHDRAW)  # until the operator's reset
BY_SEVERITY = (State.WATCHING, State.NOT_READY, *LATCHED)
# a signal without a move leaves the state unchanged
TRANSITIONS: Mapping[tuple[State, Signal], State] = MappingProxyType(
    {
        (state, signal): MOVES.get((state, signal), state)
        for state in State
        for signal in Signal
    }
)


class Cause(Enum):
    """The cause of a withdrawal; the value is the sub-code.

    7 and 9 are OpenIGTLink's own codes of a timeout and of a checksum error; codes from
    101 on are this monitor's.
    """

    SILENCE = 7
    CHECKSUM = 9
    DANGEROUS_CLASS = 101
    BOUND = 102
    RISING = 103
    UNUSABLE = 104
    FROZEN = 105
    OUT_OF_ORDER = 106
    SIZE = 107
    SCALE = 108
    NO_NUMBER = 109
    QUEUE_BEHIND = 110
    BAD_IMAGE = 111
    EXCEPTION = 112
    NO_OPINION = 113
    STALE = 114
    PIXEL_TYPE = 115
    PIERCED = 116
    UNSEEN_FALL = 117
    WATCHDOG = 120  # sent by the watchdog alone, never by the decision


@dataclass(frozen=True, kw_only=True)
class FrameRead:
    """A frame and its reading.

    `size` is (rows, columns), `scale_m` (lateral, depth) of a pixel as stored.
    `shown_back`: the number of frames since its picture was last shown, 0 if it is new.
    `sent_s`: the time that its sender states, on the sender's own clock; None if it
    states none. `pixel_type`: of its pixels as sent, such as "uint16". `travel_m`: the
    needle's travel along its axis, as its robot stated it `travel_age_s` before the
    frame; None if it states none. `plane`: the name of its plane, if there are several.
    `taken_s`: when it was taken, if that is known to be before `at_s`: the arrival of
    its oldest part, or the place of an overtaken frame between two answered ones.
    """

    at_s: float
    frame_id: int
    verdict: Verdict
    shown_back: int
    size: tuple[int, int]
    scale_m: tuple[float, float]
    sent_s: float | None = None
    pixel_type: str | None = None
    travel_m: float | None = None
    travel_age_s: float = 0.0
    plane: str | None = None
    taken_s: float | None = None

    @property
    def since_s(self) -> float:
        """The time that it shows: of its oldest part."""
        return self.at_s if self.taken_s is None else self.taken_s


@dataclass(frozen=True, kw_only=True)
class SecondOpinion:
    """The reading of an earlier frame by another method, which came at `at_s`; it can
    only add a doubt.
    """

    at_s: float
    frame_id: int
    verdict: Verdict
    plane: str | None = None


@dataclass(frozen=True)
class OvertakenRead:
    """The reading of a frame that newer frames overtook, made after theirs; it can only
    add a doubt.
    """

    at_s: float
    read: FrameRead


@dataclass(frozen=True)
class Tick:
    """Time passes."""

    at_s: float


@dataclass(frozen=True)
class Fault:
    """A cause of a withdrawal other than a frame: a damaged message, an image that is
    not one, any exception.
    """

    at_s: float
    cause: Cause
    detail: str


SLACK_S = 1e-9  # of sums of intervals: four of 10 ms are no more than 40 ms


@dataclass(frozen=True, kw_only=True)
class QueueLoss:
    """Frames that will never be read: newer ones overtook them, and there was no time
    for them afterwards.

    `unread_s` is the time that they stand for: their number times the scanner's
    interval. The frames of one `row` came between two frames that were answered.
    """

    at_s: float
    lost: int
    unread_s: float
    row: int
    plane: str | None = None


@dataclass(frozen=True)
class Reset:
    """The operator asks to leave the withdrawal."""

    at_s: float


MonitorEvent = (
    FrameRead | SecondOpinion | OvertakenRead | Tick | Fault | QueueLoss | Reset
)
