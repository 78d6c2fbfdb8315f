"""Frames that newer ones overtook: each waits to be read after them, for a limited time, or is lost."""

from collections import deque
from statistics import median_low
from typing import Generic, TypeVar

Item = TypeVar("Item")

MOST_FRAMES = 100  # that wait: those of 0.1 s at 1000 a second, 52 MB of 512 x 512 pixels
SLACK_S = 1e-9  # of a sum of intervals
FIRST_INTERVAL_S = 0.01  # until frames tell another
LEAST_SENT_S = 0.001  # between two headers: they may count in anything
KNOWN_FRAMES, ENOUGH_FRAMES = 1000, 10  # so many that a flood hardly counts in the mean
SETTLED_FRAMES = 100  # so many that a pause at the start hardly counts in the mean


class FramePace:
    """The interval of a scanner: the mean over its last frames, in which a pause counts up to `most_s`.

    The first frames may come in bunches or after a pause, so that their mean tells little: until `SETTLED_FRAMES` have
    come it is the median of the gaps between the times in their headers, where they have any.
    """

    def __init__(self, most_s: float) -> None:
        self._most_s = most_s
        self._gaps_s: deque[float] = deque(maxlen=KNOWN_FRAMES)
        self._last_s: float | None = None
        self._sent_gaps_s = [FIRST_INTERVAL_S]
        self._last_sent_s: float | None = None

    def arrived(self, at_s: float, sent_s: float | None = None) -> float:
        """Take the time at which a frame was complete, and that in its header; return the interval.

        >>> pace = FramePace(0.1)
        >>> [round(pace.arrived(0.02 * n), 3) for n in range(20)][8::11]
        [0.01, 0.02]
        """
        if len(self._gaps_s) < SETTLED_FRAMES:
            self._sent(sent_s)
        enough = len(self._gaps_s) >= (ENOUGH_FRAMES if len(self._sent_gaps_s) == 1 else SETTLED_FRAMES)
        interval_s = sum(self._gaps_s) / len(self._gaps_s) if enough else median_low(self._sent_gaps_s)
        if self._last_s is not None:
            self._gaps_s.append(min(max(at_s - self._last_s, 0.0), self._most_s))
        self._last_s = at_s
        return interval_s

    def _sent(self, sent_s: float | None) -> None:
        """Keep the gap between two headers, where the time rises."""
        if sent_s is not None and self._last_sent_s is not None and sent_s > self._last_sent_s:
            self._sent_gaps_s.append(min(max(sent_s - self._last_sent_s, LEAST_SENT_S), self._most_s))
        self._last_sent_s = sent_s


class Overtaken(Generic[Item]):
    """A queue in which no frame waits longer than `most_s`, and which takes no bunch that stands for more than that.

    A bunch lasts as long as its frames stand for, however quickly they are read. The queue never holds more than
    `MOST_FRAMES`, however short the time is that they stand for.

    Args:
        most_s: the limit of both.
    """

    def __init__(self, most_s: float) -> None:
        self._most_s = most_s
        self._waiting: deque[tuple[float, float, int, Item]] = deque()
        self._bunch_s, self._last_s = 0.0, float("-inf")

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, frame: Item, at_s: float, interval_s: float, row: int) -> None:
        """Let a frame wait that came at a time and stands for an interval; `row` names what overtook it."""
        self._waiting.append((at_s, interval_s, row, frame))
        self._bunch_s = max(0.0, self._bunch_s - (at_s - self._last_s)) + interval_s
        self._last_s = at_s

    def take(self) -> Item:
        """Return the frame that has waited longest; it waits no more."""
        return self._waiting.popleft()[3]

    def lose(self, now_s: float) -> list[tuple[int, int, float]]:
        """Drop what exceeds the limits, oldest first; return (row, frames, time that they stand for) of each row."""
        rows: dict[int, tuple[int, float]] = {}
        while self._waiting and self._too_much(now_s):
            _, interval_s, row, _ = self._waiting.popleft()
            lost, unread_s = rows.get(row, (0, 0.0))
            rows[row] = lost + 1, unread_s + interval_s
            self._bunch_s = max(0.0, self._bunch_s - interval_s)
        return [(row, *losses) for row, losses in rows.items()]

    def _too_much(self, now_s: float) -> bool:
        late = now_s - self._waiting[0][0] > self._most_s
        return late or self._bunch_s > self._most_s + SLACK_S or len(self._waiting) > MOST_FRAMES
