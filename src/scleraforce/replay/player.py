"""Play a recording to a monitor as the scanner that took it would."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from heapq import merge
from itertools import islice, pairwise
from math import ceil
from time import time

import numpy as np

from scleraforce.openigtlink import Sensor
from scleraforce.recording.folder import Recording
from scleraforce.recording.tables import FORCE_COLUMNS, FrameEntry
from scleraforce.replay.scanner_client import AnswerLog, ScannerClient, Unstamped, frame_message

FORCE_DEVICE = "RobotForce"
UNIT = 0  # of the protocol: not stated, because one message holds forces and torques
AHEAD = 48  # frames that are read before they are due: half a second at 100 a second, 25 MB
READERS = 2
FORCES_PER_S = 1000.0  # that are sent at most; of a faster log, every n-th sample
STATED_S = 0.05  # largest delay of the replay that a header may show; beyond it, it would pass for the scanner's
ANSWER_S = 1.0  # how long a step, and the end, wait for the answer


@dataclass(frozen=True, order=True)
class Timed:
    """A message at its time in the recording, s; `number` is that of a frame, from 1, and 0 of a force."""

    time_s: float
    number: int
    message: Unstamped = field(compare=False)


class Player:
    """Play a recording through an open client; keep time by the client's clock, so that no delay adds up.

    `speed` is in recorded seconds a second. `ahead` frames are read before they are due, and before the first one goes
    out. `watch` is called after each message. `latest_s` is the largest delay of a message, `last` the number of the
    last frame that was sent. `play`, `step` raise LinkError if the connection is lost, FrameError if a frame cannot be
    read.
    """

    def __init__(
        self,
        recording: Recording,
        client: ScannerClient,
        log: AnswerLog,
        *,
        speed: float = 1.0,
        version: int = 1,
        ahead: int = AHEAD,
        watch: Callable[[], object] = lambda: None,
        wall_clock: Callable[[], float] = time,
    ) -> None:
        self.recording, self.client, self.log = recording, client, log
        self.speed, self.version, self.ahead = speed, version, ahead
        self.forces_sent, self.latest_s, self.last = 0, 0.0, 0
        self._watch, self._wall_clock = watch, wall_clock
        self._begun: tuple[float, float, float] | None = None
        self._frame_went: tuple[float, float] | None = None

    def play(self, stop_s: float = float("inf")) -> None:
        """Play until a time of the recording, or its end; then wait a moment for the last answer."""
        entries = [entry for entry in self.recording.frames if entry.time_s < stop_s]
        forces = (force for force in self._forces() if force.time_s < min(stop_s, self.recording.frames[-1].time_s))
        for timed in merge(self.frames(entries), forces):
            self.send(timed)
        if stop_s == float("inf"):
            self.client.listen(self.client.clock() + ANSWER_S, lambda: self.log.answered == self.last)
            self._watch()

    def step(self, asked: Callable[[FrameEntry], bool]) -> None:
        """Send a frame, without forces, and wait for its answer, while `asked` returns True before each one."""
        for entry, timed in zip(self.recording.frames, self.frames(self.recording.frames), strict=True):
            if not asked(entry):
                return
            self.client.listen(self.client.clock())
            self._put(timed, self._wall_clock())
            self.client.listen(self.client.clock() + ANSWER_S, lambda: self.log.answered == self.last)
            self._watch()

    def send(self, timed: Timed) -> float:
        """Wait until a message is due and send it; a late replay catches up by half of each interval, not at once."""
        due_s, stamp_s = self.due(timed.time_s)
        earliest_s = due_s
        if timed.number and self._frame_went is not None:
            time_s, went_s = self._frame_went
            earliest_s = max(due_s, went_s + (timed.time_s - time_s) / self.speed / 2)
        self.client.listen(earliest_s)
        late_s = max(0.0, self.client.clock() - due_s)
        self.latest_s = max(self.latest_s, late_s)
        sent_s = self._put(timed, stamp_s + max(0.0, late_s - STATED_S))
        if timed.number:
            self._frame_went = timed.time_s, sent_s
        return sent_s

    def due(self, time_s: float) -> tuple[float, float]:
        """Return when a time of the recording is due, on the client's clock and since 1970; the first one is now."""
        if self._begun is None:
            self._begun = time_s, self.client.clock(), self._wall_clock()
        first_s, begun_s, wall_s = self._begun
        passed_s = (time_s - first_s) / self.speed
        return begun_s + passed_s, wall_s + passed_s

    def _put(self, timed: Timed, stamp_s: float) -> float:
        sent_s = self.client.send(timed.message.stamped(stamp_s))
        if timed.number:
            self.last = timed.number
            self.log.sent(timed.number, timed.message.frame_id, sent_s)
        else:
            self.forces_sent += 1
        self._watch()
        return sent_s

    def frames(self, entries: tuple[FrameEntry, ...] | list[FrameEntry]) -> Iterator[Timed]:
        """Yield frames in order, with `ahead` of them read in advance, also before the first one is yielded."""
        numbers = {entry.file: number for number, entry in enumerate(self.recording.frames, start=1)}
        with ThreadPoolExecutor(READERS) as pool:
            waiting: deque[Future[Timed]] = deque()
            left = iter(entries)

            def read_ahead(count: int) -> None:
                waiting.extend(pool.submit(self._read, entry, numbers[entry.file]) for entry in islice(left, count))

            try:
                read_ahead(self.ahead)
                wait(waiting)
                while waiting:
                    yield waiting.popleft().result()
                    read_ahead(1)
            finally:
                pool.shutdown(cancel_futures=True)

    def _read(self, entry: FrameEntry, number: int) -> Timed:
        pixels = self.recording.frame(entry)
        return Timed(entry.time_s, number, frame_message(pixels, self.recording.info.oct, number, self.version))

    def _forces(self) -> Iterator[Timed]:
        """Yield the force log as SENSOR: three forces, and three torques if logged; otherwise the contact force."""
        log, info = self.recording.forces, self.recording.info.force
        if log is None or info is None:
            return
        every = max(1, ceil(log.sample_rate_hz * self.speed / FORCES_PER_S - 1e-3))
        whole = tuple(FORCE_COLUMNS[1 : 1 + len(log.columns)]) == log.columns and len(log.columns) in (3, 6)
        values_sc = log.wrench_sc if whole else info.contact_sign * log.force_n(info.axis)[:, None]
        known = np.isfinite(values_sc).all(axis=1)  # a robot sends no force that it does not have
        times_s, values_sc = log.time_s[known], values_sc[known]
        for time_s, values_c in zip(times_s[::every].tolist(), values_sc[::every].tolist(), strict=True):
            yield Timed(time_s, 0, Unstamped(Sensor(tuple(values_c), UNIT), FORCE_DEVICE, self.version))


def median_interval_s(recording: Recording) -> float:
    """Return the time between two frames of a recording."""
    steps_s = [b.time_s - a.time_s for a, b in pairwise(recording.frames)]
    return float(np.median(steps_s)) if steps_s else 0.01
