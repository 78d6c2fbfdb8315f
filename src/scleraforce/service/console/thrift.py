"""How much a page is told and drawn: less while the machine is short of time; no clock and no I/O.

The console runs at a lower priority than the monitor, so it is late before the monitor is, and it hears how late
answers are. What it does not send, the browser does not draw, which takes ten times as long as sending.
"""

from collections import deque
from dataclasses import dataclass

LATE_S = 0.015  # a wake-up of the console this late is a sign
SLOW_MS = 10.0  # an answer that takes longer, too
SIGNS, WITHIN_S = 3, 1.0  # so many within this time: the machine is short
HELD_S = 1.0  # at least, before less is shown again
CALM_S = 5.0  # without a sign, before more is shown again


@dataclass(frozen=True, kw_only=True)
class Share:
    """What a page gets: at most one update every `update_s`, one picture every `picture_s`, of `pixels` a side."""

    level: int
    update_s: float
    picture_s: float
    pixels: int


SHARES = (
    Share(level=0, update_s=1 / 30, picture_s=1 / 30, pixels=640),
    Share(level=1, update_s=0.1, picture_s=0.2, pixels=320),
    Share(level=2, update_s=0.2, picture_s=0.5, pixels=320),  # slower, and a page would call it not live
)


class Thrift:
    """Chooses the share of the pages by signs that the machine is short.

    >>> thrift = Thrift()
    >>> for n in range(3):
    ...     thrift.woke(0.02, 0.1 * n)
    >>> thrift.share(0.2).level, thrift.share(5.3).level
    (1, 0)
    """

    def __init__(self) -> None:
        self._signs: deque[float] = deque(maxlen=SIGNS)
        self._level = 0
        self._since_s = float("-inf")
        self._behind = 0

    def woke(self, late_s: float, now_s: float) -> None:
        """Take how late the console woke up."""
        if late_s > LATE_S:
            self._signs.append(now_s)

    def answered(self, latency_ms: float | None, behind: int, now_s: float) -> None:
        """Take the latency of an answer, and how many frames were overtaken or lost since the start."""
        if behind > self._behind or (latency_ms is not None and latency_ms > SLOW_MS):
            self._signs.append(now_s)
        self._behind = behind

    def share(self, now_s: float) -> Share:
        """Return the share from now on."""
        held = now_s - self._since_s >= HELD_S
        short = len(self._signs) == SIGNS and now_s - self._signs[0] <= WITHIN_S
        calm = not self._signs or now_s - self._signs[-1] > CALM_S
        if short and held and self._level < len(SHARES) - 1:
            self._level, self._since_s = self._level + 1, now_s
            self._signs.clear()
        elif calm and self._level and now_s - self._since_s > CALM_S:
            self._level, self._since_s = self._level - 1, now_s
        return SHARES[self._level]
