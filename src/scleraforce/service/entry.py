"""One decision of the monitor, in the form that is sent, logged and shown."""

import json
from dataclasses import dataclass, replace
from math import nan
from typing import Any

from msgspec import ValidationError, convert

from scleraforce.errors import MessageError
from scleraforce.monitor.events import Verdict
from scleraforce.monitor.transitions import State
from scleraforce.plain_json import finite
from scleraforce.units import from_si, to_si

LATER = {"withdrawn_s": None, "present_cause": None, "present": ""}  # logs of 26 November 2026 and before lack these


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A decision and its event. `text` is its JSON, for the STRING `ForceReading`, the log and the console.

    Attributes:
        number: of the decision, from 1.
        time_s: since 1970.
        at_s: monotonic clock.
        event: "frame", "tick", "reset", "opinion", ...; "again": the last decision repeated, with its number.
        state: NOT_READY, WATCHING or WITHDRAW.
        code: of the STATUS.
        sub_code: of the STATUS.
        cause: name of the first cause of a withdrawal; None without one.
        message: of the STATUS.
        frame: number of the frame in this session, from 1; None for other events.
        frame_id: the sender's number of the frame; None for other events.
        verdict: the reading of the frame; None for other events and for a frame that could not be read.
        latency_ms: from the frame's last byte to the answer on the wire; None for other events.
        lost: frames since the start that newer ones overtook and that were never read.
        overtaken: all frames that newer ones overtook, with those that were read after them.
        withdrawn_s: when the withdrawal began, since 1970; None without one.
        present_cause: name of the cause that is true now; None without one.
        present: what is wrong now; "" if nothing is.

    Raises:
        MessageError: a state that does not exist.
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

    def __post_init__(self) -> None:
        if self.state not in State.__members__:
            raise MessageError(f"state: {self.state[:20]!r}; must be one of {', '.join(State.__members__)}")

    @property
    def usable(self) -> bool | None:
        """Whether the frame could be judged; None for other events."""
        return self.verdict.usable if self.verdict else None if self.frame is None else False

    @property
    def force_mn(self) -> float | None:
        """The force that was read in the frame."""
        return from_si(self.verdict.force_n, "mn") if self.verdict and self.verdict.force_n is not None else None

    @property
    def interval_mn(self) -> tuple[float, float] | None:
        """The 90 % interval of the force."""
        if self.verdict is None or self.verdict.interval_n is None:
            return None
        low_n, high_n = self.verdict.interval_n
        return from_si(low_n, "mn"), from_si(high_n, "mn")

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object: flat, forces in mN, `class` for `predicted`; NaN and infinity become null."""
        verdict = self.verdict
        return {
            "number": self.number,
            "time_s": finite(self.time_s),
            "at_s": finite(self.at_s),
            "event": self.event,
            "state": self.state,
            "code": self.code,
            "sub_code": self.sub_code,
            "cause": self.cause,
            "message": self.message,
            "frame": self.frame,
            "frame_id": self.frame_id,
            "probabilities": finite(verdict.probabilities) if verdict else None,
            "force_mn": finite(self.force_mn),
            "interval_mn": finite(self.interval_mn),
            "usable": self.usable,
            "reason": verdict.reason if verdict else None,
            "latency_ms": finite(self.latency_ms),
            "lost": self.lost,
            "overtaken": self.overtaken,
            "withdrawn_s": finite(self.withdrawn_s),
            "present_cause": self.present_cause,
            "present": self.present,
            "class": verdict.predicted if verdict else None,
        }

    @classmethod
    def from_json(cls, value: Any) -> "Entry":
        """Return the entry of a JSON object of `as_json`; in a list null becomes NaN, elsewhere None.

        Raises:
            MessageError: it is not the object of an entry; the message names the field.
        """
        if not isinstance(value, dict) or (LATER | value).keys() != KEYS:
            raise MessageError("not an entry: an object with the keys of one")
        try:
            return convert(value | {"verdict": _verdict_of(value)}, cls)
        except ValidationError as fault:
            raise MessageError(str(fault)) from fault

    @property
    def text(self) -> str:
        """Return the JSON object in one line."""
        return json.dumps(self.as_json())


KEYS = Entry(
    number=1, time_s=0.0, at_s=0.0, event="tick", state="WATCHING", code=1, sub_code=0, cause=None, message=""
).as_json().keys()  # fmt: skip


def _verdict_of(value: dict[str, Any]) -> Verdict | None:
    """Return the verdict in the object of an entry; None without a class."""
    if value["class"] is None:
        return None
    names = {"class": "predicted", "force_mn": "force_n", "interval_mn": "interval_n"}
    known = ("class", "probabilities", "usable", "reason", "force_mn", "interval_mn")
    verdict = convert({names.get(name, name): _with_nan(value[name]) for name in known}, Verdict)
    low_mn, high_mn = verdict.interval_n or (nan, nan)
    return replace(
        verdict,
        force_n=None if verdict.force_n is None else to_si(verdict.force_n, "mn"),
        interval_n=verdict.interval_n and (to_si(low_mn, "mn"), to_si(high_mn, "mn")),
    )


def _with_nan(value: Any) -> Any:
    return [nan if number is None else number for number in value] if isinstance(value, list) else value
