"""One decision of the monitor, in the form that is sent, logged and shown."""

import json
from dataclasses import dataclass
from math import nan
from typing import Any

from scleraforce.errors import MessageError
from scleraforce.monitor.transitions import State
from scleraforce.plain_json import finite
from scleraforce.service.record_json import record_as_json, record_of_json

LATER = {"withdrawn_s": None, "present_cause": None, "present": ""}  # logs of 26 November 2026 and before lack these
NUMBERS = float, tuple  # what may hold NaN; asking the others would take twice as long


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
        frame: number of the frame in this session, from 1; None for other events, as all that follows
            but the two counts.
        frame_id: the sender's number of the frame.
        predicted: its class.
        probabilities: of the classes.
        force_mn: its force.
        interval_mn: the 90 % interval of the force.
        usable: whether the frame could be judged.
        reason: why it could not.
        latency_ms: from the frame's last byte to the answer on the wire.
        lost: frames since the start that newer ones overtook and that were never read.
        overtaken: all that newer ones overtook, those included that were read after them.
        withdrawn_s: when the withdrawal began, since 1970; None without one.
        present_cause: name of the cause that is true now; None without one.
        present: what is wrong now; "" if nothing is.
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
    overtaken: int = 0
    withdrawn_s: float | None = None
    present_cause: str | None = None
    present: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the JSON object: the attributes by name, `predicted` as `class`; NaN and infinity become null.

        Raises:
            MessageError: an attribute is of another type than it states.
        """
        fields = record_as_json(self)
        record = {name: finite(value) if type(value) in NUMBERS else value for name, value in fields.items()}
        record["class"] = record.pop("predicted")
        return record

    @classmethod
    def from_json(cls, value: Any) -> "Entry":
        """Return the entry of a JSON object of `as_json`; in a tuple null becomes NaN, elsewhere None.

        Raises:
            MessageError: it is none.
        """
        if not isinstance(value, dict) or "class" not in value or "predicted" in value:
            raise MessageError("not an entry: an object with a class")
        record = LATER | {"predicted" if name == "class" else name: entry for name, entry in value.items()}
        for name in ("probabilities", "interval_mn"):
            if isinstance(numbers := record.get(name), list):
                record[name] = [nan if number is None else number for number in numbers]
        entry = record_of_json(cls, record)
        if entry.state not in State.__members__:
            raise MessageError(f"state: {entry.state[:20]!r}; must be one of {', '.join(State.__members__)}")
        return entry

    @property
    def text(self) -> str:
        """Return the JSON object in one line."""
        return json.dumps(self.as_json())
