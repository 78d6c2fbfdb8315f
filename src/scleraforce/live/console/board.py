"""The board of the console: all that a page shows, its history, and a sentence for each
cause.
"""

import re
import tomllib
from collections import deque
from dataclasses import dataclass
from importlib.resources import files
from itertools import takewhile
from math import isfinite
from statistics import median
from typing import Any

from scleraforce.live.companions.process_messages import (
    START,
    CompanionMessage,
    Decided,
    Entry,
    Outline,
    Rates,
)
from scleraforce.live.decision.events import BY_SEVERITY

SENTENCES: dict[str, str] = tomllib.loads(
    files(__package__).joinpath("causes.toml").read_text("utf-8")
)
READ_WORDS = re.compile(r"; class \d+(; -?[\d.]+ mN)?(; .*)?$", re.DOTALL)
STEP_S = 0.04
HISTORY_S = 30.0
SEVERITY = [state.name for state in BY_SEVERITY]
SILENT_S = 1.2  # without any message; the monitor sends its rates twice a second
# without a decision while WATCHING; without frames it would have withdrawn long before
WATCHING_SILENT_S = 0.5
READING_S = 0.5  # an older reading is not shown
LATENCY_S = 5.0
OUTLINE_S = 0.2  # after this long, a frame is shown without its outline
READING = (
    "frame",
    "class",
    "probabilities",
    "force_mn",
    "interval_mn",
    "usable",
    "reason",
    "time_to_bound_ms",
    "time_to_bound_ms_interval",
    "modulus_mpa",
    "modulus_sd_mpa",
    "modulus_frames",
    "plane",
)


def sentence_of(cause: str) -> str:
    """Return the sentence of a cause, by its name."""
    return SENTENCES.get(cause, f"Cause: {cause}.")


def detail_of(message: str, state: str) -> str:
    """Return the reason within a decision's message: without the state before it and
    the last reading after it.
    """
    reason = message.removeprefix(state).removeprefix(": ")
    if state == "WATCHING":  # there need not be a reason
        reason = f"; {reason}"
    return READ_WORDS.sub("", reason).removeprefix("; ")


@dataclass
class DecisionStep:
    """All decisions within one time step; the worst of it counts, so that no peak is
    lost.

    `force_mn` is the largest force, the interval the one that holds all intervals; None
    where no frame could be read.
    """

    number: int
    state: str
    force_mn: float | None = None
    low_mn: float | None = None
    high_mn: float | None = None
    predicted: int | None = None

    def take(self, entry: Entry) -> None:
        """Add a decision."""
        self.state = max(self.state, entry.state, key=SEVERITY.index)
        if entry.verdict is None or not entry.verdict.usable:
            return

        self.predicted = max(entry.verdict.predicted, self.predicted or 0)
        low_mn, high_mn = entry.interval_mn or (None, None)
        self.force_mn = max(_numbers(self.force_mn, entry.force_mn), default=None)
        self.low_mn = min(_numbers(self.low_mn, low_mn), default=None)
        self.high_mn = max(_numbers(self.high_mn, high_mn), default=None)

    def as_json(self) -> list[Any]:
        """Return the step for the page, rounded to tenths of a micronewton, which is
        finer than the page shows.
        """
        forces = [
            None if value is None else round(value, 4)
            for value in (self.force_mn, self.low_mn, self.high_mn)
        ]
        return [self.number, *forces, self.state, self.predicted]


class StepHistory:
    """The steps of the last `HISTORY_S`; a step in which nothing was decided is
    absent.
    """

    def __init__(self) -> None:
        self._steps: deque[DecisionStep] = deque()

    def take(self, entry: Entry) -> None:
        """Add a decision."""
        number = int(entry.at_s / STEP_S)
        if not self._steps or number > self._steps[-1].number:
            self._steps.append(DecisionStep(number, entry.state))
        self._steps[-1].take(entry)
        while self._steps[0].number < self._steps[-1].number - HISTORY_S / STEP_S:
            self._steps.popleft()

    def since(self, number: int) -> list[DecisionStep]:
        """Return the steps from a number on, oldest first; the last one may still
        change.
        """
        late = list(
            takewhile(lambda step: step.number >= number, reversed(self._steps))
        )
        return late[::-1]


def _numbers(*forces_mn: float | None) -> list[float]:
    return [
        force_mn
        for force_mn in forces_mn
        if force_mn is not None and isfinite(force_mn)
    ]


class Board:
    """Sums up the monitor's messages for a page; all times are of the monotonic
    clock.
    """

    def __init__(self, now_s: float) -> None:
        self._entry_s = self._outline_s = self._frame_s = now_s
        self._heard_s: float | None = None
        self._entry = START
        # the last one on a frame, with its number
        self._reading: tuple[int, Entry] | None = None
        self._outline: Outline | None = None
        self._rates: Rates | None = None
        self._lost = 0
        self._latencies: deque[tuple[float, float]] = deque()
        self._ended = False
        self.history = StepHistory()

    def take(self, message: CompanionMessage, now_s: float) -> bool:
        """Take a message of the monitor; return whether pages need it at once."""
        self._heard_s = now_s
        match message:
            case Decided(entry=entry):
                return self._take_entry(entry, now_s)
            case Outline():
                self._outline = message
                self._outline_s = now_s
            case Rates():
                self._rates = message
                self._lost = message.lost

        return False

    def _take_entry(self, entry: Entry, now_s: float) -> bool:
        before = self._entry
        self._entry = entry
        self._entry_s = now_s
        self._lost = entry.lost
        self.history.take(entry)

        if entry.frame is not None:
            self._reading = (entry.frame, entry)
            self._frame_s = now_s
            if entry.latency_ms is not None:
                self._latencies.append((now_s, entry.latency_ms))
            while self._latencies and now_s - self._latencies[0][0] > LATENCY_S:
                self._latencies.popleft()

        return before is START or (before.state, before.cause) != (
            entry.state,
            entry.cause,
        )

    def end(self) -> None:
        """Note that the monitor has ended or died."""
        self._ended = True

    def monitor(self, now_s: float) -> str:
        """Return the state of the monitor: "ended", "starting", "silent" or
        "answers".
        """
        if self._ended:
            return "ended"
        if self._heard_s is None:
            return "starting"

        watching = self._entry.state == "WATCHING"
        silent = now_s - self._heard_s > SILENT_S or (
            watching and now_s - self._entry_s > WATCHING_SILENT_S
        )

        return "silent" if silent else "answers"

    def as_json(self, now_s: float, since: int) -> dict[str, Any]:
        """Return all that a page shows, except the picture; the history begins with
        step number `since`.
        """
        entry = self._entry
        read = (
            self._reading[1].as_json()
            if self._reading and now_s - self._frame_s <= READING_S
            else None
        )
        latencies_ms = [
            latency_ms
            for at_s, latency_ms in self._latencies
            if now_s - at_s <= LATENCY_S
        ]

        return {
            "kind": "state",
            "now": now_s / STEP_S,
            "monitor": self.monitor(now_s),
            "reading": read and {name: read.get(name) for name in READING},
            "latency_ms": (
                [round(median(latencies_ms), 2), round(max(latencies_ms), 2)]
                if latencies_ms
                else None
            ),
            "frames_per_second": self._rates.frames_per_second if self._rates else None,
            "lost": self._lost,
            "clients": self._rates.clients if self._rates else [],
            "remarks": (
                [remark.to_dict() for remark in self._rates.remarks]
                if self._rates
                else []
            ),
            "steps": [step.as_json() for step in self.history.since(since)],
            "state": entry.state,
            "cause": entry.cause,
            "detail": (
                entry.present if entry.cause else detail_of(entry.message, entry.state)
            ),
            "sentence": sentence_of(entry.cause) if entry.cause else "",
            "present": sentence_of(entry.present_cause) if entry.present_cause else "",
            "withdrawn_s": entry.withdrawn_s,
            "pierced": "PIERCED" in (entry.cause, entry.present_cause),
        }

    def picture(self) -> tuple[int, Outline | None] | None:
        """Return the number of the frame to show, and its outline; None before the
        first frame.
        """
        outlined = self._outline.frame if self._outline else 0
        newest = self._reading[0] if self._reading else 0
        if newest > outlined and self._frame_s - self._outline_s > OUTLINE_S:
            return newest, None
        return (outlined, self._outline) if outlined else None
