"""The answers of a monitor to a scanner: its changes of state, and the latency of each frame."""

import json
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from scleraforce.monitor.transitions import Cause, State
from scleraforce.openigtlink import Message, Status, Text
from scleraforce.service.messages import READING_DEVICE, STATUS_DEVICE

WAITING = 1000  # frames without an answer that are remembered
SUB_CODES = {cause.value: cause.name for cause in Cause}
OK = State.WATCHING.value


@dataclass(frozen=True, kw_only=True)
class Change:
    """A STATUS that came at `at_s` (monotonic) and differs from the one before it, in code or sub-code.

    `frame` is the number of the frame that it `answers`, or of the last frame sent, and `after_s` the time since that
    frame's last byte; None before the first frame. The force and its interval are the answer's.
    """

    at_s: float
    code: int
    sub_code: int
    message: str
    frame: int | None = None
    after_s: float | None = None
    answers: bool = False
    force_mn: float | None = None
    interval_mn: tuple[float, float] | None = None

    @property
    def cause(self) -> str | None:
        """The name of the cause; None if the sub-code is not a cause."""
        return SUB_CODES.get(self.sub_code)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedAnswer:
    """The code that answers a frame, its time since the frame's last byte, and its latency by the monitor's clock."""

    code: int
    took_s: float
    server_ms: float | None


class AnswerLog:
    """Record frames that were sent and the monitor's messages; no socket, no clock.

    `begun_s` is when the first frame was sent, `status_s` when the last STATUS came; the first one counts as a change.
    `reading` is the last STRING `ForceReading`, parsed; `answered` the number of the frame that it answers.
    """

    def __init__(self) -> None:
        self.changes: list[Change] = []
        self.answers: list[TimedAnswer] = []
        self.frames_sent = 0
        self.begun_s: float | None = None
        self.reading: Mapping[str, Any] = {}
        self.status: Status | None = None
        self.status_s: float | None = None
        self.longest_silence_s = 0.0
        self.answered: int | None = None
        self._waiting: OrderedDict[int, tuple[int, float]] = OrderedDict()
        self._last: tuple[int, float] | None = None
        self._changed = False

    def sent(self, number: int, frame_id: int, at_s: float) -> None:
        """Take a frame that was sent: its number in the recording, its id, when its last byte was sent."""
        self.frames_sent += 1
        self.begun_s = at_s if self.begun_s is None else self.begun_s
        self._last = self._waiting[frame_id] = number, at_s
        if len(self._waiting) > WAITING:
            self._waiting.popitem(last=False)

    def hear(self, at_s: float, device: str, message: Message) -> None:
        """Take a message of the monitor."""
        if isinstance(message, Status) and device == STATUS_DEVICE:
            self._hear_status(at_s, message)
        elif isinstance(message, Text) and device == READING_DEVICE:
            self._hear_reading(message.text)

    @property
    def last(self) -> TimedAnswer | None:
        """The answer to the last frame that was sent; None until it comes."""
        return self.answers[-1] if self.answers and self._last and self.answered == self._last[0] else None

    @property
    def ok(self) -> bool:
        """True if the last STATUS lets the robot continue."""
        return self.status is not None and self.status.code == OK

    def first_doubt(self, since_s: float, codes: Sequence[int] | None = None) -> Change | None:
        """Return the first change since a time to one of `codes`, or by default to any code but OK."""
        found = (change for change in self.changes if change.at_s >= since_s)
        return next((change for change in found if (change.code in codes if codes else change.code != OK)), None)

    def _hear_status(self, at_s: float, status: Status) -> None:
        before, self.status = self.status, status
        if self.status_s is not None:
            self.longest_silence_s = max(self.longest_silence_s, at_s - self.status_s)
        self.status_s = at_s
        self._changed = before is None or (before.code, before.subcode) != (status.code, status.subcode)
        if self._changed:
            change = Change(at_s=at_s, code=status.code, sub_code=status.subcode, message=status.message)
            if self._last is not None:
                number, sent_s = self._last
                change = replace(change, frame=number, after_s=at_s - sent_s)
            self.changes.append(change)

    def _hear_reading(self, text: str) -> None:
        """Take the reading of a frame, which the last STATUS answered."""
        try:
            reading = json.loads(text)
        except ValueError:
            return
        if not isinstance(reading, dict):
            return
        self.reading = reading
        frame_id, at_s, status = reading.get("frame_id"), self.status_s, self.status
        if not isinstance(frame_id, int) or at_s is None or status is None or frame_id not in self._waiting:
            return
        number, sent_s = self._waiting.pop(frame_id)
        self.answered = number
        latency_ms = reading.get("latency_ms")
        self.answers.append(TimedAnswer(code=status.code, took_s=at_s - sent_s, server_ms=latency_ms))
        if self._changed:
            self._changed = False
            self.changes[-1] = replace(
                self.changes[-1], frame=number, after_s=at_s - sent_s, answers=True,
                force_mn=_number(reading.get("force_mn")), interval_mn=_interval(reading.get("interval_mn")),
            )  # fmt: skip


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _interval(value: object) -> tuple[float, float] | None:
    ends = [_number(end) for end in value] if isinstance(value, list) else []
    return (ends[0], ends[1]) if len(ends) == 2 and ends[0] is not None and ends[1] is not None else None
