"""A clock that a test turns: whatever holds the machine up, no time passes on it."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

__all__ = ["TurnedClock"]


class TurnedClock:
    """Seconds since 1970, of a clock that stands still until a test turns it on; one for all threads."""

    def __init__(self, now_s: float = 1.8e9) -> None:
        self._now_s, self._lock = now_s, RLock()

    def __call__(self) -> float:
        with self._lock:
            return self._now_s

    def turn(self, by_s: float) -> None:
        """Let time pass."""
        with self._lock:
            self._now_s += by_s

    @contextmanager
    def held(self) -> Iterator[None]:
        """Let other threads wait where they look at the clock: what is sent meanwhile has arrived when they go on."""
        with self._lock:
            yield
