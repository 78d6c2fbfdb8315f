"""The force of the last half minute, in time steps as fine as the pixels of a page."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from math import isfinite
from typing import Any

from scleraforce.service.entry import Entry

STEP_S = 0.04
HISTORY_S = 30.0
SEVERITY = ("WATCHING", "NOT_READY", "WITHDRAW")


@dataclass
class Step:
    """What came within one time step; the worst of it counts, so that no peak is lost.

    `force_mn` is the largest force, the interval the one that holds all intervals; None where no frame could be read.
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
        self.force_mn = _farther(max, self.force_mn, entry.force_mn)
        self.low_mn = _farther(min, self.low_mn, low_mn)
        self.high_mn = _farther(max, self.high_mn, high_mn)

    def as_json(self) -> list[Any]:
        """Return the step for the page, rounded to tenths of a micronewton, which is finer than the page shows."""
        forces = [None if value is None else round(value, 4) for value in (self.force_mn, self.low_mn, self.high_mn)]
        return [self.number, *forces, self.state, self.predicted]


class History:
    """Steps of `STEP_S`, the last `HISTORY_S` of them; a step in which nothing was decided is absent."""

    def __init__(self) -> None:
        self._steps: deque[Step] = deque()

    def take(self, entry: Entry) -> None:
        """Add a decision."""
        number = int(entry.at_s / STEP_S)
        if not self._steps or number > self._steps[-1].number:
            self._steps.append(Step(number, entry.state))
        self._steps[-1].take(entry)
        while self._steps[0].number < self._steps[-1].number - HISTORY_S / STEP_S:
            self._steps.popleft()

    def since(self, number: int) -> list[Step]:
        """Return the steps from a number on, oldest first; the last one may still change."""
        late = list(takewhile(lambda step: step.number >= number, reversed(self._steps)))
        return late[::-1]


def _farther(which: Callable[[float, float], float], one_mn: float | None, other_mn: float | None) -> float | None:
    """Return `which`, the larger or the smaller, of two forces; what is missing or NaN does not count."""
    if other_mn is None or not isfinite(other_mn):
        return one_mn
    return other_mn if one_mn is None else which(one_mn, other_mn)
