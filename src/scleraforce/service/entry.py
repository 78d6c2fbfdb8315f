"""One decision of the monitor, as all get it who are told, keep it or show it."""

import json
from dataclasses import dataclass
from typing import Any

from scleraforce.plain_json import finite

__all__ = ["Entry"]


@dataclass(frozen=True)
class Entry:
    """What was decided, and on what. `text` is its JSON: the STRING `ForceReading`, a line of the log, the console's.

    Attributes:
        number: of the decision, from 1.
        time_s: since 1970.
        at_s: of the monotonic clock.
        event: what was decided on: "frame", "tick", "reset", "opinion", ...; "again": told once more, under its number.
        state: NOT_READY, WATCHING or WITHDRAW.
        code: of the STATUS.
        sub_code: of the STATUS.
        cause: name of the first cause of a withdrawal; None without one.
        message: of the STATUS.
        frame: number of the frame in this session, from 1; None where the event was none. So are those that follow.
        frame_id: what its sender calls it.
        predicted: its class.
        probabilities: of the classes.
        force_mn: its force.
        interval_mn: in which 90 % of such forces lie.
        usable: whether it could be judged.
        reason: why not.
        latency_ms: from its last byte to the answer on the wire.
        lost: frames lost to the queue since the start.
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
    predicted: int | None = None
    probabilities: tuple[float, ...] | None = None
    force_mn: float | None = None
    interval_mn: tuple[float, float] | None = None
    usable: bool | None = None
    reason: str | None = None
    latency_ms: float | None = None
    lost: int = 0

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object: the names of the attributes, but `class` for `predicted`; null for no number."""
        record: dict[str, Any] = finite(vars(self))
        record["class"] = record.pop("predicted")
        return record

    @property
    def text(self) -> str:
        """Return the JSON object in one line."""
        return json.dumps(self.as_json())
