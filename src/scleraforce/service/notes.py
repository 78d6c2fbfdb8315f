"""Lines for the operator, written by a separate thread: a stopped terminal must not stop the monitor."""

from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread

WAITING = 1000  # lines; while this many wait, new ones are dropped


class Notes:
    """Takes lines without ever waiting; a thread writes them in order.

    Args:
        write: writes a line; it may block.
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
        """Write the lines that wait, for `within_s` at most."""
        self._lines.put(None)
        self._thread.join(within_s)

    def _run(self) -> None:
        while (text := self._lines.get()) is not None:
            with suppress(OSError):  # the terminal was closed
                self._write(text)
