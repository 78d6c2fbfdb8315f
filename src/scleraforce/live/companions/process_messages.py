"""A decision as it is sent, logged and shown, and the messages between the monitor and
its companions.

The first message to a companion is its settings. `process_channel` turns messages into
bytes and back. Times are in seconds: `at_s` on the monotonic clock, `time_s` since
1970. The watchdog, which uses the standard library alone, has messages of its own.
"""

import json
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

from msgspec import Struct, ValidationError, convert

from scleraforce.base.errors import MessageError
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import from_si, to_si
from scleraforce.base.version import __version__
from scleraforce.live.companions.shared_frames import RingPlace
from scleraforce.live.decision.events import State
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.network.openigtlink import Text
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale, Plane
from scleraforce.records.setup import Setup
from scleraforce.records.verdict import Verdict

# Of the OpenIGTLink messages.
STATUS_DEVICE = "ForceMonitor"
DECISION_DEVICE = "ForceDecision"
READING_DEVICE = "ForceReading"
NEEDLE_DEVICE = "NeedlePose"
# left out if None
OF_PLANES = dict.fromkeys(
    ("plane", "planes_force_mn", "planes_interval_mn", "contact_xyz_mm")
)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A decision of the monitor and its event: "frame", "tick", "reset", ...; "again"
    repeats one, with its number.

    `withdrawn_s` is when the withdrawal began. `frame` is the number in this session,
    from 1, `frame_id` the sender's; `latency_ms` runs from the frame's last byte to the
    answer on the wire; `verdict` is also None for a frame that could not be read.
    `time_to_bound_ms` is the median, an end of the interval None beyond 2 s
    (`reading.force_trend`). `modulus_mpa` is E as learned in this session (mean, SD,
    number of frames), None if it is not. `overtaken` counts the frames since the start
    that newer ones overtook, `lost` the unread ones. `plane`: the frame's, if there are
    several; then `planes_force_mn` and `contact_xyz_mm` are what the second opinion
    last read in all planes together.
    """

    number: int
    time_s: float
    at_s: float
    event: str
    state: str
    code: int
    sub_code: int
    cause: str | None
    message: str
    frame: int | None = None
    frame_id: int | None = None
    verdict: Verdict | None = None
    latency_ms: float | None = None
    lost: int = 0
    overtaken: int = 0
    withdrawn_s: float | None = None
    present_cause: str | None = None
    present: str = ""
    time_to_bound_ms: float | None = None
    time_to_bound_ms_interval: tuple[float, float | None] | None = None
    modulus_mpa: float | None = None
    modulus_sd_mpa: float | None = None
    modulus_frames: int | None = None
    plane: str | None = None
    planes_force_mn: float | None = None
    planes_interval_mn: tuple[float, float] | None = None
    contact_xyz_mm: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.state not in State.__members__:
            raise MessageError(
                f"state: {self.state[:20]!r}; must be one of"
                f" {', '.join(State.__members__)}"
            )

    @property
    def force_mn(self) -> float | None:
        """The force that was read in the frame."""
        return from_si(self.verdict.force_n, "mn") if self.verdict else None

    @property
    def interval_mn(self) -> tuple[float, float] | None:
        """The 90 % interval of the force."""
        interval_n = self.verdict.interval_n if self.verdict else None
        return interval_n and (
            from_si(interval_n[0], "mn"),
            from_si(interval_n[1], "mn"),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object: flat, forces in mN, `class` for `predicted`; NaN and
        infinity become null.

        `usable` is null for events other than a frame, and false for a frame that could
        not be read.
        """
        verdict = self.verdict
        reading = {
            "probabilities": finite_json(verdict.probabilities) if verdict else None,
            "force_mn": finite_json(self.force_mn),
            "interval_mn": finite_json(self.interval_mn),
            "usable": (
                verdict.usable if verdict else None if self.frame is None else False
            ),
            "reason": verdict.reason if verdict else None,
        }
        record: dict[str, Any] = {}

        for name, value in vars(self).items():
            if value is not None or name not in OF_PLANES:
                record |= reading if name == "verdict" else {name: finite_json(value)}

        elastic_mn = from_si(verdict.elastic_force_n, "mn") if verdict else None
        return record | {
            "class": verdict.predicted if verdict else None,
            "elastic_force_mn": finite_json(elastic_mn),
        }

    @classmethod
    def from_json(cls, value: Any) -> "Entry":
        """Return the entry of an object of `as_json`; in a list null becomes NaN. A
        MessageError names the field.
        """
        if not isinstance(value, dict) or (OF_PLANES | value).keys() != KEYS:
            raise MessageError("not an entry: an object with the keys of one")
        try:
            return convert(value | {"verdict": _verdict_of(value)}, cls)
        except ValidationError as fault:
            raise MessageError(str(fault)) from fault


# Shown before the first decision.
START = Entry(
    number=0,
    time_s=0.0,
    at_s=0.0,
    event="start",
    state="NOT_READY",
    code=13,
    sub_code=0,
    cause=None,
    message="",
)
KEYS = START.as_json().keys() | OF_PLANES.keys()


def _verdict_of(value: dict[str, Any]) -> Verdict | None:
    if value["class"] is None:
        return None

    names = {
        "class": "predicted",
        "force_mn": "force_n",
        "interval_mn": "interval_n",
        "elastic_force_mn": "elastic_force_n",
        "probabilities": "probabilities",
        "usable": "usable",
        "reason": "reason",
    }
    found = {own: value[name] for name, own in names.items()}

    for name, listed in found.items():
        if isinstance(listed, list):
            found[name] = [nan if number is None else number for number in listed]

    read = convert(found, Verdict)
    force_n = to_si(read.force_n, "mn")
    elastic_n = to_si(read.elastic_force_n, "mn")
    interval_n = read.interval_n and (
        to_si(read.interval_n[0], "mn"),
        to_si(read.interval_n[1], "mn"),
    )

    return replace(
        read, force_n=force_n, elastic_force_n=elastic_n, interval_n=interval_n
    )


def decision_text(
    *, code: int, sub_code: int, state: str, cause: str | None, message: str
) -> Text:
    """Return what a STATUS says as a STRING, for programs without that type: a JSON
    object with these keys (docs/monitor.md#messages).
    """
    content = {
        "code": code,
        "sub_code": sub_code,
        "state": state,
        "cause": cause,
        "message": message,
    }
    return Text(json.dumps(content))


class _Message(
    Struct,
    frozen=True,
    kw_only=True,
    tag=True,
    forbid_unknown_fields=True,
    omit_defaults=True,
):
    """A message; the name of its class goes with it."""


class Decided(_Message, frozen=True, kw_only=True):
    """To the black box and the console: a decision; of a frame also the needle's
    travel, m, and whether it pierced.

    `moment`: of several planes, the number of the first frame that is read together
    with this one.
    """

    entry: Entry
    travel_m: float | None = None
    pierced: bool = False
    moment: int | None = None


class ForceHeard(_Message, frozen=True, kw_only=True):
    """To the black box: the numbers of a robot's force sensor, N and N m; they may be
    NaN.
    """

    at_s: float
    time_s: float
    values: tuple[float, ...]
    device: str


class Note(_Message, frozen=True, kw_only=True):
    """To the black box, and in its log: a line on an event other than a decision."""

    time_s: float
    text: str


class MonitorEnds(_Message, frozen=True, kw_only=True):
    """To the black box: the monitor ends as planned; nothing follows."""


class Outline(_Message, frozen=True, kw_only=True):
    """To the console: the wall that a frame's force was read from, as rows at each
    `step`-th column; None: no wall.
    """

    frame: int
    step: int
    outer: tuple[float | None, ...]
    inner: tuple[float | None, ...]
    plane: str | None = None


class Rates(_Message, frozen=True, kw_only=True):
    """To the console, twice a second: frames per second, frames lost since the start,
    the clients, and what the second opinion has remarked since the start.

    Of a client, `clients` has the `address` and the `role`, "scanner" or "listener".
    """

    frames_per_second: float
    lost: int
    clients: tuple[dict[str, str], ...]
    remarks: tuple[Remark, ...] = ()


class ResetAsked(_Message, frozen=True, kw_only=True):
    """From the console: the operator asks for a reset; `request` is the console's
    number of it.
    """

    request: int
    token: str


class ResetAnswered(_Message, frozen=True, kw_only=True):
    """To the console: the answer to the reset of number `request`."""

    request: int
    granted: bool
    message: str


class ListensAt(_Message, frozen=True, kw_only=True):
    """From the console: it serves its page at this address."""

    url: str


class WrongTokens(_Message, frozen=True, kw_only=True):
    """From the console: the number of resets that came with a wrong token."""

    count: int


class OpinionAsked(_Message, frozen=True, kw_only=True):
    """To the second opinion: read the frame of this number in the ring, complete at
    `at_s`.

    `order` is the decision's name for it. `teaches`: the eye may be learned from it, as
    the monitor watches and can read it; `pierced`: it showed a puncture. `planes`: of
    several ones the name, number and order of each one's frame.
    """

    number: int
    order: int
    at_s: float
    teaches: bool
    pierced: bool
    planes: tuple[tuple[str, int, int], ...] = ()


class OpinionGiven(_Message, frozen=True, kw_only=True):
    """From the second opinion: its verdict on the frame of this order, with its
    remarks; of several planes, the contact (x, y, depth).
    """

    order: int
    verdict: Verdict
    remarks: tuple[Remark, ...] = ()
    plane: str | None = None
    contact_m: tuple[float, ...] | None = None


class EyeLearned(_Message, frozen=True, kw_only=True):
    """From the second opinion: the eye with E as learned from n frames, and why that
    could not be saved, or "".
    """

    setup: Setup
    frames: int
    fault: str


class Alive(_Message, frozen=True, kw_only=True):
    """A sign of life: of the black box every 0.5 s, with its present faults; of a
    second opinion that is ready.
    """

    faults: tuple[str, ...]


class SelfReport(_Message, frozen=True, kw_only=True):
    """From any companion: its fault, in its own words."""

    detail: str


class WithdrawalKept(_Message, frozen=True, kw_only=True):
    """From the black box: the last seconds before a withdrawal are complete in this
    folder.
    """

    folder: str


class BlackBoxSettings(_Message, frozen=True, kw_only=True):
    """Settings of the black box: `folder` is created, `record`, for the whole session,
    must not exist.

    `info`, of each recording.toml, has `force`. `keep_s` before a withdrawal are kept,
    if the ring holds as much.
    """

    folder: Path
    ring: RingPlace
    info: RecordingInfo
    record: Path | None
    keep_s: float

    def __post_init__(self) -> None:
        rows, columns = self.info.scan.shape
        if (rows, columns) != (self.ring.rows, self.ring.columns):
            raise ValueError(
                f"info.scan: {rows} x {columns} pixels; the ring: {self.ring}"
            )
        if self.info.force is None:
            raise ValueError("info.force: missing; a robot may send its force")

    @property
    def force(self) -> ForceInfo:
        """Axis and sign of a robot's force, and how long a label averages."""
        assert self.info.force is not None
        return self.info.force


class OpinionSettings(_Message, frozen=True, kw_only=True):
    """Settings of the second opinion: the model's folder, what is known of the eye, and
    the frames.

    `learns`: the name of the eye, if its E is learned; `record`: the folder of the
    session's recording. `planes`: of the scanner, if it takes several.
    """

    model: Path
    setup: Setup
    scale: PixelScale
    ring: RingPlace
    learns: str | None
    record: Path | None
    planes: tuple[Plane, ...] = ()


class ConsoleSettings(_Message, frozen=True, kw_only=True):
    """Settings of the console: `listener` is the descriptor of the socket that listens
    on `host`, `eye` may be "", `remarks` are those of the start.
    """

    host: str
    listener: int
    token_digest: str
    ring: RingPlace
    scale: PixelScale
    limits: MonitorLimits
    class_bounds_n: tuple[float, ...]
    model: str
    eye: str
    remarks: tuple[Remark, ...]

    def for_page(self) -> dict[str, Any]:
        """Return the settings for the page, as a JSON object."""
        return {
            "pixel_mm": (
                from_si(self.scale.lateral_m, "mm"),
                from_si(self.scale.depth_m, "mm"),
            ),
            "class_bounds_mn": [
                from_si(bound_n, "mn") for bound_n in self.class_bounds_n
            ],
            "bound_mn": from_si(self.limits.bound_n, "mn"),
            "withdraw_class": self.limits.withdraw_class,
            "silence_s": self.limits.silence_s,
            "reads_force": self.limits.reads_force,
            "model": self.model,
            "eye": self.eye,
            "remarks": [remark.to_dict() for remark in self.remarks],
            "version": __version__,
            "rows": self.ring.rows,
            "columns": self.ring.columns,
        }


Settings = BlackBoxSettings | OpinionSettings | ConsoleSettings
ToCompanion = (
    Decided
    | ForceHeard
    | Note
    | MonitorEnds
    | Outline
    | Rates
    | ResetAnswered
    | OpinionAsked
    | Settings
)
ToMonitor = (
    ResetAsked
    | ListensAt
    | WrongTokens
    | OpinionGiven
    | EyeLearned
    | Alive
    | SelfReport
    | WithdrawalKept
)
CompanionMessage = ToCompanion | ToMonitor
