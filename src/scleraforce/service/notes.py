"""Lines for the operator, written by a thread of their own: a terminal that was stopped must not stop the monitor."""

from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread

__all__ = ["Notes"]

WAITING = 1000  # lines; those that come when so many wait are left out


class Notes:
    """Takes lines without ever waiting, and lets a thread write them in their order.

    Args:
        write: writes a line; may take as long as it likes.
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write, self._lines = write, SimpleQueue[str | None]()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def __call__(self, text: str) -> None:
        """Take a line."""
        if self._lines.qsize() < WAITING:
            self._lines.put(text)

    def close(self, within_s: float = 1.0) -> None:
        """Write what waits, if that does not take longer."""
        self._lines.put(None)
        self._thread.join(within_s)

    def _run(self) -> None:
        while (text := self._lines.get()) is not None:
            with suppress(OSError):  # a terminal that was closed: nobody reads any more
                self._write(text)
