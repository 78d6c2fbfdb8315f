"""What a program asks of a monitor, and what the monitor says to it.

Both run one installation: between processes these records go as pickles, over a pipe
that the two alone hold.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.records.remark import Remark
from scleraforce.records.setup import NOTHING_KNOWN, Setup

LOCAL: Final = "127.0.0.1"
PORT: Final = 18944


@dataclass(frozen=True)
class Address:
    """An address to listen on; port 0 takes a free one."""

    host: str
    port: int


@dataclass(frozen=True, kw_only=True)
class StatedLimits:
    """The limits of the decision that a user may state (`MonitorLimits`); None: those
    of the model's classes.
    """

    withdraw_class: int | None = None
    bound_n: float | None = None
    unusable_frames: int = MonitorLimits.unusable_frames
    unusable_opinions: int = MonitorLimits.unusable_opinions
    loss_in_window_s: float = MonitorLimits.loss_in_window_s
    reaction_s: float = MonitorLimits.reaction_s
    retraction_m_s: float = MonitorLimits.retraction_m_s
    reports_pierced: bool = MonitorLimits.reports_pierced


@dataclass(frozen=True, kw_only=True)
class MonitorRequest:
    """A monitor as its user wants it.

    Attributes:
        model: folder of a reader.
        setup: what is known of eye, needle and scan; what the scan does not declare of
            its frames is that of the model's study.
        calibration: file that has the eye, or others, whose population it then is of.
        limits: those of the decision.
        address: where scanner and robot connect.
        console: address of the web console; None: there is none.
        black_box: folder of the log; None: a new one in the user's state folder.
        record: folder for a recording of the session; None: none is written.
        second_opinion: read the frames with the fit as well, in another process.
        learn_eye: learn E from the shape of dents during the session.
        resume: file with the E of this eye from an earlier session; needs `learn_eye`.
    """

    model: Path
    setup: Setup = NOTHING_KNOWN
    calibration: Path | None = None
    limits: StatedLimits = field(default_factory=StatedLimits)
    address: Address = Address(LOCAL, PORT)
    console: Address | None = None
    black_box: Path | None = None
    record: Path | None = None
    second_opinion: bool = True
    learn_eye: bool = False
    resume: Path | None = None


@dataclass(frozen=True)
class OperatorLine:
    """From the monitor: a line for its operator."""

    text: str


@dataclass(frozen=True)
class Started:
    """From the monitor: it listens, and has said all lines of its start.

    `token` is that of the reset, `remarks` limit what it reads.
    """

    host: str
    port: int
    token: str
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class Refused:
    """From the monitor, and its last message: what it was asked for cannot be used."""

    words: str


@dataclass(frozen=True)
class Failed:
    """From the monitor, and its last message: a fault of its own ended it."""

    words: str


@dataclass(frozen=True)
class Ended:
    """From the monitor, and its last message: the summary of its session."""

    summary: Mapping[str, Any]


MonitorMessage = OperatorLine | Started | Refused | Failed | Ended
