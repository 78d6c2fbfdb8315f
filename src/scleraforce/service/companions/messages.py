"""What the monitor's processes tell each other: a frozen record for each message, and the closed table of all kinds.

`codec` turns them into bytes and back. Times are in seconds: `at_s` on the monotonic clock, `time_s` since 1970. The
watchdog, which uses the standard library alone, has messages of its own (`watchdog_messages`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from scleraforce.monitor.events import SecondOpinion
from scleraforce.service.black_box.settings import BlackBoxSettings
from scleraforce.service.companions.opinion_settings import OpinionSettings
from scleraforce.service.console.settings import ConsoleSettings
from scleraforce.service.entry import Entry


@dataclass(frozen=True, kw_only=True)
class Decided:
    """To the black box and the console: a decision."""

    entry: Entry


@dataclass(frozen=True, kw_only=True)
class ForceHeard:
    """To the black box: what a robot's sensor measured, N and N m; numbers may be NaN."""

    at_s: float
    time_s: float
    values: tuple[float, ...]
    device: str


@dataclass(frozen=True, kw_only=True)
class Note:
    """To the black box, and in its log: a line on what happened beside the decisions."""

    time_s: float
    text: str


@dataclass(frozen=True, kw_only=True)
class MonitorEnds:
    """To the black box: the monitor ends as planned; nothing follows."""


@dataclass(frozen=True, kw_only=True)
class Outline:
    """To the console: the wall found in a frame, in rows of it, at each `step`-th column; None where there is none."""

    frame: int
    step: int
    outer: tuple[float | None, ...]
    inner: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class ClientRole:
    """A client of the monitor: its address, and whether it is the "scanner" or a "listener"."""

    address: str
    role: str


@dataclass(frozen=True, kw_only=True)
class Rates:
    """To the console, twice a second: frames per second, frames lost since the start, and the clients."""

    frames_per_second: float
    lost: int
    clients: tuple[ClientRole, ...]


@dataclass(frozen=True, kw_only=True)
class ResetAsked:
    """From the console: the operator asks for a reset; `request` is the console's number of it."""

    request: int
    token: str


@dataclass(frozen=True, kw_only=True)
class ResetAnswered:
    """To the console: the answer to the reset of number `request`."""

    request: int
    granted: bool
    message: str


@dataclass(frozen=True, kw_only=True)
class ListensAt:
    """From the console: it serves its page at this address."""

    url: str


@dataclass(frozen=True, kw_only=True)
class WrongTokens:
    """From the console: so many resets came with a wrong token."""

    count: int


@dataclass(frozen=True, kw_only=True)
class OpinionAsked:
    """To the second opinion: read the frame of this number in the ring; `order` is the decision's name for it."""

    number: int
    order: int


@dataclass(frozen=True, kw_only=True)
class OpinionGiven:
    """From the second opinion: what it reads in the frame of this order; numbers may be NaN."""

    order: int
    usable: bool
    reason: str | None
    predicted: int
    probabilities: tuple[float, ...] | None
    force_n: float | None
    interval_n: tuple[float, float] | None

    def at(self, at_s: float) -> SecondOpinion:
        """Return it as the decision takes it, with the time when it came."""
        return SecondOpinion(
            at_s=at_s,
            frame_id=self.order,
            usable=self.usable,
            reason=self.reason,
            predicted=self.predicted,
            probabilities=self.probabilities,
            force_n=self.force_n,
            interval_n=self.interval_n,
        )


@dataclass(frozen=True, kw_only=True)
class Alive:
    """A sign of life: of the black box every 0.5 s, with what it cannot keep now; of a second opinion that is ready."""

    faults: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class SelfReport:
    """From any companion: what is wrong with it, in its own words."""

    detail: str


@dataclass(frozen=True, kw_only=True)
class WithdrawalKept:
    """From the black box: the last seconds before a withdrawal are complete in this folder."""

    folder: str


Settings = BlackBoxSettings | OpinionSettings | ConsoleSettings  # the first message to each companion

CompanionMessage = (
    Decided
    | ForceHeard
    | Note
    | MonitorEnds
    | Outline
    | Rates
    | ResetAsked
    | ResetAnswered
    | ListensAt
    | WrongTokens
    | OpinionAsked
    | OpinionGiven
    | Alive
    | SelfReport
    | WithdrawalKept
    | Settings
)

MESSAGE_KINDS: Mapping[str, type[CompanionMessage]] = MappingProxyType(
    {
        "entry": Decided,
        "force": ForceHeard,
        "note": Note,
        "end": MonitorEnds,
        "outline": Outline,
        "rates": Rates,
        "reset": ResetAsked,
        "reset-answer": ResetAnswered,
        "listening": ListensAt,
        "wrong-tokens": WrongTokens,
        "opinion-wanted": OpinionAsked,
        "opinion": OpinionGiven,
        "alive": Alive,
        "fault": SelfReport,
        "kept": WithdrawalKept,
        "black-box-settings": BlackBoxSettings,
        "opinion-settings": OpinionSettings,
        "console-settings": ConsoleSettings,
    }
)
