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


MOVES = {
    (State.NOT_READY, Signal.HARMLESS): State.WATCHING,
    (State.NOT_READY, Signal.ALARM): State.WITHDRAW,
    (State.WATCHING, Signal.UNJUDGED): State.NOT_READY,
    (State.WATCHING, Signal.ALARM): State.WITHDRAW,
    (State.WITHDRAW, Signal.RESET_GRANTED): State.WATCHING,
}
TRANSITIONS: Mapping[tuple[State, Signal], State] = MappingProxyType(
    {(state, signal): MOVES.get((state, signal), state) for state in State for signal in Signal}
)  # a signal without a move leaves the state unchanged


def transition_diagram() -> str:
    """Return the moves as a Mermaid state diagram."""
    lines = [f"    {before.name} --> {after.name}: {signal.value}" for (before, signal), after in MOVES.items()]
    return "\n".join(["stateDiagram-v2", "    [*] --> NOT_READY", *lines])


class Cause(Enum):
    """The cause of a withdrawal; the value is the sub-code.

    7 and 9 are OpenIGTLink's own codes of a timeout and of a checksum error; codes from 101 on are this monitor's.
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
