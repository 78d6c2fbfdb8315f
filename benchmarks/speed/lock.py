"""One benchmark at a time on a machine: two would measure each other."""

import fcntl
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PLACE = Path(tempfile.gettempdir()) / "scleraforce-benchmark.lock"


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other benchmark runs, and keep others waiting."""
    with PLACE.open("w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("waiting for another benchmark to end", file=sys.stderr)
            fcntl.flock(lock, fcntl.LOCK_EX)

        yield
