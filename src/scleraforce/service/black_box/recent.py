"""The last seconds in the memory of the black box: numbers of frames, and lines of the log."""

from collections import deque

MOST_LINES = 20_000


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
