"""The force that a robot sends, as a log of even steps: the mean of the samples in each 10 ms."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite

from scleraforce.recording.folder import ForceInfo
from scleraforce.recording.tables import FORCE_COLUMNS
from scleraforce.recording.writing import FORCE_STEP_S

HISTORY_S = 600.0  # the tare is found before the first contact, so a log of the last 10 s would be too short


@dataclass(frozen=True)
class ForceSample:
    """The mean of a step: `at_s` is its middle; forces in N, torques in N m."""

    at_s: float
    values: tuple[float, ...]


class RobotForce:
    """Takes the forces that robots send; `samples` are those of the last ten minutes.

    Even steps give the log a defined rate; by times of arrival, a burst could have any rate. No sample is invented: a
    step in which nothing came is left out. Only the first device is taken, with its first count of numbers.

    Args:
        info: axis and sign of a force that comes as one number, positive in contact.
    """

    def __init__(self, info: ForceInfo) -> None:
        self.samples: deque[ForceSample] = deque(maxlen=round(HISTORY_S / FORCE_STEP_S))
        self.columns: tuple[str, ...] = ()
        self.refused = 0
        self._info = info
        self._source: tuple[str, int] | None = None
        self._step = -1
        self._sums: list[float] = []
        self._count = 0

    def add(self, at_s: float, values: Sequence[float], device: str) -> ForceSample | None:
        """Take a message that came at `at_s`; if it begins a new step, return the sample of the step before."""
        source = (device, len(values))
        sound = len(values) in (1, 3, 6) and all(map(isfinite, (at_s, *values)))
        if not sound or self._source not in (None, source):
            self.refused += 1
            return None
        self._source = source
        if len(values) == 1:
            values = [self._info.contact_sign * values[0]]
        self.columns = (f"{self._info.axis}_n",) if len(values) == 1 else FORCE_COLUMNS[1 : 1 + len(values)]
        step = max(floor(at_s / FORCE_STEP_S), self._step)
        sample = self._begin(step) if step > self._step else None
        self._sums = [total + value for total, value in zip(self._sums, values, strict=True)]
        self._count += 1
        return sample

    def _begin(self, step: int) -> ForceSample | None:
        """Begin a step; return the sample of the one before."""
        sample = None
        if self._count:
            middle_s = (self._step + 0.5) * FORCE_STEP_S
            sample = ForceSample(middle_s, tuple(total / self._count for total in self._sums))
            self.samples.append(sample)
        self._step, self._count = step, 0
        self._sums = [0.0] * len(self.columns)
        return sample
