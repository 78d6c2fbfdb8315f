"""Copies frames from the ring to a recording folder: one at a time, oldest first."""

from collections import deque
from dataclasses import dataclass

from scleraforce.recording.writing import RecordingWriter
from scleraforce.service.companions.frame_ring import FrameRing

CLOCK_STEP_S = 1e-6  # of frames.csv


@dataclass(frozen=True)
class TakenFrame:
    """A frame in the ring: its number, and the time of its decision on the recording's clock."""

    number: int
    time_s: float


class FrameTaker:
    """Takes frames out of the ring, oldest first, and writes them into a recording folder.

    Attributes:
        written: how many frames are complete.
        lost: how many were overwritten before their turn, or could not be written.
    """

    def __init__(self, ring: FrameRing, writer: RecordingWriter) -> None:
        self.written = self.lost = 0
        self._ring, self._writer = ring, writer
        self._waiting: deque[TakenFrame] = deque()
        self._last_s = -float("inf")

    def add(self, frame: TakenFrame) -> None:
        """Queue a frame."""
        if len(self._waiting) == self._ring.frames:  # then the oldest one has been overwritten
            self._waiting.popleft()
            self.lost += 1
        self._waiting.append(frame)

    @property
    def next(self) -> int | None:
        """Number of the next frame to write."""
        return self._waiting[0].number if self._waiting else None

    def take(self) -> None:
        """Write the next frame, or count it as lost.

        Raises:
            OSError: it cannot be written.
        """
        frame = self._waiting.popleft()
        pixels = self._ring.get(frame.number)
        if pixels is None:
            self.lost += 1
            return
        self._last_s = max(frame.time_s, self._last_s + CLOCK_STEP_S)  # no two frames of a table share a time
        try:
            self._writer.add(f"{frame.number:07d}.png", self._last_s, pixels)
        except OSError:
            self.lost += 1
            raise
        self.written += 1

    def close(self) -> None:
        """Close the folder's tables; frames that still wait count as lost."""
        self.lost += len(self._waiting)
        self._waiting.clear()
        self._writer.close()
