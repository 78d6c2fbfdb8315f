"""The messages between the monitor and its companions: one record each; the first one to a companion is its settings.

`channel` turns them into bytes and back. Times are in seconds: `at_s` on the monotonic clock, `time_s` since 1970. The
watchdog, which uses the standard library alone, has messages of its own (`watchdog`).
"""

import socket
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from msgspec import Struct

from scleraforce import __version__
from scleraforce.known import Known
from scleraforce.monitor import MonitorLimits
from scleraforce.monitor.events import Verdict
from scleraforce.recording.folder import ForceInfo, RecordingInfo
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.frame_ring import FrameRing, RingPlace
from scleraforce.service.entry import Entry
from scleraforce.service.reset_token import token_digest
from scleraforce.units import from_si

FORCE = ForceInfo("fz", 1, 0.2)  # the needle moves, so labels average over a short time


class _Message(Struct, frozen=True, tag=True, forbid_unknown_fields=True):
    """A message; the name of its class goes with it."""


class Decided(_Message, frozen=True, kw_only=True):
    """To the black box and the console: a decision."""

    entry: Entry


class ForceHeard(_Message, frozen=True, kw_only=True):
    """To the black box: what a robot's sensor measured, N and N m; numbers may be NaN."""

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
    """To the console: the wall that a frame's force was read from, as rows at each `step`-th column; None: no wall."""

    frame: int
    step: int
    outer: tuple[float | None, ...]
    inner: tuple[float | None, ...]


class ClientRole(Struct, frozen=True, kw_only=True):
    """A client of the monitor: its address, and its role, "scanner" or "listener"."""

    address: str
    role: str


class Rates(_Message, frozen=True, kw_only=True):
    """To the console, twice a second: frames per second, frames lost since the start, and the clients."""

    frames_per_second: float
    lost: int
    clients: tuple[ClientRole, ...]


class ResetAsked(_Message, frozen=True, kw_only=True):
    """From the console: the operator asks for a reset; `request` is the console's number of it."""

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
    """To the second opinion: read the frame of this number in the ring; `order` is the decision's name for it."""

    number: int
    order: int


class OpinionGiven(_Message, frozen=True, kw_only=True):
    """From the second opinion: its verdict on the frame of this order."""

    order: int
    verdict: Verdict


class Alive(_Message, frozen=True, kw_only=True):
    """A sign of life: of the black box every 0.5 s, with what it cannot keep now; of a second opinion that is ready."""

    faults: tuple[str, ...]


class SelfReport(_Message, frozen=True, kw_only=True):
    """From any companion: its fault, in its own words."""

    detail: str


class WithdrawalKept(_Message, frozen=True, kw_only=True):
    """From the black box: the last seconds before a withdrawal are complete in this folder."""

    folder: str


class BlackBoxSettings(_Message, frozen=True, kw_only=True):
    """Settings of the black box.

    Attributes:
        folder: of the log and of the withdrawals.
        ring: of the frames.
        info: contents of each recording.toml.
        record: folder for a recording of the whole session; None: only withdrawals are kept.
        keep_s: duration that is kept at a withdrawal.
    """

    folder: Path
    ring: RingPlace
    info: RecordingInfo
    record: Path | None
    keep_s: float

    @property
    def force(self) -> ForceInfo:
        """Axis and sign of a robot's force, and how long a label averages."""
        return self.info.force or FORCE


class OpinionSettings(_Message, frozen=True, kw_only=True):
    """Settings of the second opinion.

    Attributes:
        model: folder of the model.
        known: of the eye.
        scale: of the frames.
        ring: of the frames.
    """

    model: Path
    known: Known
    scale: PixelScale
    ring: RingPlace


class ConsoleSettings(_Message, frozen=True, kw_only=True):
    """Settings of the console.

    Attributes:
        host: address that is listened on.
        listener: descriptor of the socket that listens there.
        token_digest: of the token of the operator's reset.
        ring: of the frames.
        pixel_mm: lateral and in depth.
        class_bounds_mn: between the classes of force.
        bound_mn: of the interval's upper end, where the robot withdraws.
        withdraw_class: from which on it does.
        silence_s: without a frame, after which it does.
        reads_force: False with a classifier.
        model: its name.
        eye: name of the eye; "" by default.
        version: of this package.
    """

    host: str
    listener: int
    token_digest: str
    ring: RingPlace
    pixel_mm: tuple[float, float]
    class_bounds_mn: tuple[float, ...]
    bound_mn: float
    withdraw_class: int
    silence_s: float
    reads_force: bool
    model: str
    eye: str
    version: str

    def for_page(self) -> dict[str, Any]:
        """Return the settings for the page, as a JSON object."""
        known = ("pixel_mm", "class_bounds_mn", "bound_mn", "withdraw_class", "silence_s", "reads_force")
        named = {name: getattr(self, name) for name in (*known, "model", "eye", "version")}
        return {**named, "rows": self.ring.rows, "columns": self.ring.columns}


Settings = BlackBoxSettings | OpinionSettings | ConsoleSettings

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
    | BlackBoxSettings
    | OpinionSettings
    | ConsoleSettings
)


def black_box_settings(
    folder: Path, ring: FrameRing, info: RecordingInfo, record: Path | None = None, keep_s: float = 10.0
) -> BlackBoxSettings:
    """Return the settings of the black box, for `Child("scleraforce.service.black_box.process", settings, ...)`.

    Args:
        folder: of the log and of the withdrawals; created if it is missing.
        ring: of the frames; longer than `keep_s`, or the oldest frames are overwritten before they are kept.
        info: contents of each recording.toml. Without `force`, a robot's force is the axis fz, positive in contact,
            and labels average over 0.2 s.
        record: folder for a recording of the whole session; must not exist. None: only withdrawals are kept.
        keep_s: duration that is kept at a withdrawal.
    """
    if (info.oct.rows, info.oct.columns) != ring.shape:
        raise ValueError(f"info.oct: {info.oct.rows} x {info.oct.columns} pixels; the ring has {ring.shape}")
    return BlackBoxSettings(
        folder=folder.absolute(),
        ring=ring.place,
        info=replace(info, force=info.force or FORCE),
        record=None if record is None else record.absolute(),
        keep_s=keep_s,
    )


def console_settings(
    *,
    host: str,
    listener: socket.socket,
    token: str,
    ring: FrameRing,
    lateral_m: float,
    depth_m: float,
    limits: MonitorLimits,
    class_bounds_n: Sequence[float],
    model: str,
    eye: str = "",
) -> ConsoleSettings:
    """Return the settings of the console's process, its first message.

    Args:
        host: address that is listened on.
        listener: the socket that listens there; its descriptor has to be inherited.
        token: of the operator's reset; the console is told its digest.
        ring: the frames; its descriptor has to be inherited.
        lateral_m: width of a pixel.
        depth_m: height of a pixel.
        limits: of the decision.
        class_bounds_n: between the classes of force.
        model: its name.
        eye: whose eye; "" where that is not said.
    """
    return ConsoleSettings(
        host=host,
        listener=listener.fileno(),
        token_digest=token_digest(token),
        ring=ring.place,
        pixel_mm=(from_si(lateral_m, "mm"), from_si(depth_m, "mm")),
        class_bounds_mn=tuple(from_si(bound_n, "mn") for bound_n in class_bounds_n),
        bound_mn=from_si(limits.bound_n, "mn"),
        withdraw_class=limits.withdraw_class,
        silence_s=limits.silence_s,
        reads_force=limits.reads_force,
        model=model,
        eye=eye,
        version=__version__,
    )
