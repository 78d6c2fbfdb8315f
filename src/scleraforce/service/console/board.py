"""The state of the console: takes the monitor's messages, gives what a page shows; no clock and no I/O."""

from collections import deque
from statistics import median
from typing import Any

from msgspec import to_builtins

from scleraforce.service.companions.messages import CompanionMessage, Decided, Outline, Rates
from scleraforce.service.console.history import STEP_S, History
from scleraforce.service.console.sentences import detail_of, sentence_of
from scleraforce.service.entry import Entry

SILENT_S = 1.2  # without any message; the monitor sends its rates twice a second
WATCHING_SILENT_S = 0.5  # without a decision while WATCHING; without frames it would have withdrawn long before
READING_S = 0.5  # an older reading is not shown
LATENCY_S = 5.0
OUTLINE_S = 0.2  # after this long, a frame is shown without its outline
READING = ("frame", "class", "probabilities", "force_mn", "interval_mn", "usable", "reason")


class Board:
    """Takes the monitor's messages and sums them up for a page.

    Args:
        now_s: time of the start; all times here are of the monotonic clock.
    """

    def __init__(self, now_s: float) -> None:
        self._entry_s = self._outline_s = self._frame_s = now_s
        self._heard_s: float | None = None
        self._entry: Entry | None = None
        self._reading: tuple[int, Entry] | None = None  # the last one on a frame, with its number
        self._outline: Outline | None = None
        self._rates: Rates | None = None
        self._lost = 0
        self._latencies: deque[tuple[float, float]] = deque()
        self._ended = False
        self.history = History()

    def take(self, message: CompanionMessage, now_s: float) -> bool:
        """Take a message of the monitor; return whether pages must be told at once."""
        self._heard_s = now_s
        match message:
            case Decided(entry=entry):
                return self._take_entry(entry, now_s)
            case Outline():
                self._outline, self._outline_s = message, now_s
            case Rates():
                self._rates, self._lost = message, message.lost
        return False

    def _take_entry(self, entry: Entry, now_s: float) -> bool:
        before, self._entry, self._entry_s = self._entry, entry, now_s
        self._lost = entry.lost
        self.history.take(entry)
        if entry.frame is not None:
            self._reading, self._frame_s = (entry.frame, entry), now_s
            if entry.latency_ms is not None:
                self._latencies.append((now_s, entry.latency_ms))
            while self._latencies and now_s - self._latencies[0][0] > LATENCY_S:
                self._latencies.popleft()
        return before is None or (before.state, before.cause) != (entry.state, entry.cause)

    def end(self) -> None:
        """Note that the monitor has ended or died."""
        self._ended = True

    def monitor(self, now_s: float) -> str:
        """Return the state of the monitor: "ended", "starting", "silent" or "answers"."""
        if self._ended:
            return "ended"
        if self._heard_s is None:
            return "starting"
        watching = self._entry is not None and self._entry.state == "WATCHING"
        silent = now_s - self._heard_s > SILENT_S or (watching and now_s - self._entry_s > WATCHING_SILENT_S)
        return "silent" if silent else "answers"

    def as_json(self, now_s: float, since: int) -> dict[str, Any]:
        """Return all that a page shows, except the picture.

        Args:
            now_s: time.
            since: number of the first step of the history that the page needs.
        """
        return {
            "kind": "state",
            "now": now_s / STEP_S,
            "monitor": self.monitor(now_s),
            **self._decision(),
            "reading": self._shown_reading(now_s),
            "latency_ms": self._latency_ms(now_s),
            "frames_per_second": self._rates.frames_per_second if self._rates else None,
            "lost": self._lost,
            "clients": to_builtins(self._rates.clients) if self._rates else [],
            "steps": [step.as_json() for step in self.history.since(since)],
        }

    def _decision(self) -> dict[str, Any]:
        entry = self._entry
        if entry is None:
            return {
                "state": "NOT_READY",
                "cause": None,
                "detail": "",
                "sentence": "",
                "present": "",
                "withdrawn_s": None,
            }
        return {
            "state": entry.state,
            "cause": entry.cause,
            "detail": entry.present if entry.cause else detail_of(entry.message, entry.state),
            "sentence": sentence_of(entry.cause) if entry.cause else "",
            "present": sentence_of(entry.present_cause) if entry.present_cause else "",
            "withdrawn_s": entry.withdrawn_s,
        }

    def _shown_reading(self, now_s: float) -> dict[str, Any] | None:
        if self._reading is None or now_s - self._frame_s > READING_S:
            return None
        record = self._reading[1].as_json()
        return {name: record[name] for name in READING}

    def _latency_ms(self, now_s: float) -> list[float] | None:
        found = [latency_ms for at_s, latency_ms in self._latencies if now_s - at_s <= LATENCY_S]
        return [round(median(found), 2), round(max(found), 2)] if found else None

    def picture(self) -> tuple[int, Outline | None] | None:
        """Return the number of the frame to show, and its outline; None before the first frame."""
        outlined = self._outline.frame if self._outline else 0
        newest = self._reading[0] if self._reading else 0
        if newest > outlined and self._frame_s - self._outline_s > OUTLINE_S:
            return newest, None
        return (outlined, self._outline) if outlined else None
