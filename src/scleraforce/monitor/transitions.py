"""States, signals and causes, and the table that the monitor follows; the documentation draws its diagram from it."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class State(Enum):
    """The state of the monitor; the value is the code of the OpenIGTLink STATUS."""

    NOT_READY = 13
    WATCHING = 1
    WITHDRAW = 3


class Signal(Enum):
    """The meaning of an event, judged by the limits."""

    HARMLESS = "harmless frame"
    TOLERATED = "unusable frame, tolerated"
    UNJUDGED = "unusable frame before contact"
    QUIET = "nothing new"
    ALARM = "cause of a withdrawal"
    RESET_GRANTED = "reset after fresh harmless frames"
    RESET_REFUSED = "reset, refused"


TRANSITIONS: Mapping[tuple[State, Signal], State] = MappingProxyType(
    {
        (State.NOT_READY, Signal.HARMLESS): State.WATCHING,
        (State.NOT_READY, Signal.TOLERATED): State.NOT_READY,
        (State.NOT_READY, Signal.UNJUDGED): State.NOT_READY,
        (State.NOT_READY, Signal.QUIET): State.NOT_READY,
        (State.NOT_READY, Signal.ALARM): State.WITHDRAW,
        (State.NOT_READY, Signal.RESET_GRANTED): State.NOT_READY,
        (State.NOT_READY, Signal.RESET_REFUSED): State.NOT_READY,
        (State.WATCHING, Signal.HARMLESS): State.WATCHING,
        (State.WATCHING, Signal.TOLERATED): State.WATCHING,
        (State.WATCHING, Signal.UNJUDGED): State.NOT_READY,
        (State.WATCHING, Signal.QUIET): State.WATCHING,
        (State.WATCHING, Signal.ALARM): State.WITHDRAW,
        (State.WATCHING, Signal.RESET_GRANTED): State.WATCHING,
        (State.WATCHING, Signal.RESET_REFUSED): State.WATCHING,
        (State.WITHDRAW, Signal.HARMLESS): State.WITHDRAW,
        (State.WITHDRAW, Signal.TOLERATED): State.WITHDRAW,
        (State.WITHDRAW, Signal.UNJUDGED): State.WITHDRAW,
        (State.WITHDRAW, Signal.QUIET): State.WITHDRAW,
        (State.WITHDRAW, Signal.ALARM): State.WITHDRAW,
        (State.WITHDRAW, Signal.RESET_GRANTED): State.WATCHING,
        (State.WITHDRAW, Signal.RESET_REFUSED): State.WITHDRAW,
    }
)


def transition_diagram() -> str:
    """Return the table as a Mermaid state diagram, without the signals that leave a state as it is."""
    lines = ["stateDiagram-v2", "    [*] --> NOT_READY"]
    moves = [(before, signal, after) for (before, signal), after in TRANSITIONS.items() if before is not after]
    lines += [f"    {before.name} --> {after.name}: {signal.value}" for before, signal, after in moves]
    return "\n".join(lines)


class Cause(Enum):
    """Why the robot must withdraw; the value is the sub-code.

    7 and 9 are OpenIGTLink's own codes of a timeout and of a checksum error; those from 101 on are this monitor's.
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
    WATCHDOG = 120  # sent by the watchdog alone, never by the decision
