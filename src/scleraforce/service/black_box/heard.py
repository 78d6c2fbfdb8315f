"""The memory of the black box: the beginning, the last seconds, the last decision, and the forces of a robot."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import floor, isfinite

from scleraforce import __version__
from scleraforce.recording.folder import ForceInfo
from scleraforce.recording.tables import FORCE_COLUMNS
from scleraforce.recording.writing import FORCE_STEP_S
from scleraforce.service.entry import Entry

MOST_LINES = 20_000
HISTORY_S = 600.0  # the tare is found before the first contact, so a log of the last 10 s would be too short


@dataclass(frozen=True)
class SessionBeginning:
    """Time 0 of the session's recordings on the monotonic clock, and the first line of each recording.toml."""

    at_s: float
    comment: str


class Heard:
    """Remembers what came from the monitor.

    Args:
        keep_s: duration of the last seconds.
        most_frames: largest number of frames in them.
        force: axis and sign of a robot's force.

    Attributes:
        recent: frames and lines of the log of the last seconds.
        force: samples of the last ten minutes.
        beginning: of the session; None before the first message.
        entry: the last decision.
    """

    def __init__(self, keep_s: float, most_frames: int, force: ForceInfo) -> None:
        self.recent, self.force = Recent(keep_s, most_frames), RobotForce(force)
        self.beginning: SessionBeginning | None = None
        self.entry: Entry | None = None

    def begin(self, at_s: float, time_s: float) -> SessionBeginning:
        """Return the session's beginning, which is the first message; `time_s` is since 1970."""
        if self.beginning is None:
            began = datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")
            comment = f"Of a session of scleraforce {__version__}, research use only; time 0 is {began}."
            self.beginning = SessionBeginning(at_s, comment)
        return self.beginning


class Recent:
    """Remembers frames and lines with their times, in order.

    Args:
        keep_s: how far back from the latest one.
        most_frames: largest number of frames.
    """

    def __init__(self, keep_s: float, most_frames: int) -> None:
        self._keep_s = keep_s
        self._frames: deque[tuple[float, int]] = deque(maxlen=most_frames)
        self._lines: deque[tuple[float, bytes]] = deque(maxlen=MOST_LINES)

    def add_line(self, at_s: float, line: bytes) -> None:
        """Remember a line of the log."""
        self._lines.append((at_s, line))
        while self._lines[0][0] < at_s - self._keep_s:
            self._lines.popleft()

    def add_frame(self, at_s: float, number: int) -> bool:
        """Remember a frame; return False if it is known already (a second opinion names its frame again)."""
        if self._frames and number <= self._frames[-1][1]:
            return False
        self._frames.append((at_s, number))
        return True

    def until(self, at_s: float) -> tuple[list[tuple[float, int]], list[bytes]]:
        """Return the frames, with their times, and the lines of the last seconds up to a time.

        >>> recent = Recent(10.0, 100)
        >>> for at_s in range(30):
        ...     _ = recent.add_frame(float(at_s), at_s + 1)
        >>> recent.until(25.0)[0][0], recent.until(25.0)[0][-1]
        ((15.0, 16), (25.0, 26))
        """
        since_s = at_s - self._keep_s
        frames = [(frame_s, number) for frame_s, number in self._frames if since_s <= frame_s <= at_s]
        return frames, [line for line_s, line in self._lines if since_s <= line_s <= at_s]


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
