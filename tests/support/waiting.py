"""Waits that end: how long a test waits for another thread or process, on any
machine.
"""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Timer
from time import monotonic, sleep
from typing import IO

FUSE_S = 100.0  # nothing takes so long; pytest ends a test after three times that
HANGS_S = 3600.0  # of what only a signal ends: longer than any test
LIMIT_S = 240.0  # of a test that starts a monitor, on a busy machine


@contextmanager
def ends(pipe: IO[str], seconds: float = LIMIT_S) -> Iterator[None]:
    """Kill whoever else holds a pipe when this takes longer: whoever reads it then sees
    its end (Linux only).
    """
    timer = Timer(
        seconds, _kill_holders, (os.readlink(f"/proc/self/fd/{pipe.fileno()}"),)
    )
    timer.start()

    try:
        yield
    finally:
        timer.cancel()


def _kill_holders(pipe: str) -> None:
    for place in Path("/proc").glob("[0-9]*/fd/*"):
        holder = int(place.parts[2])
        with suppress(OSError):  # it ended meanwhile, or is another user's
            if holder != os.getpid() and os.readlink(place) == pipe:
                os.kill(holder, signal.SIGKILL)


def wait_until(holds: Callable[[], bool]) -> None:
    end_s = monotonic() + FUSE_S
    while not holds():
        assert monotonic() < end_s, "it did not come about"
        sleep(0.01)


def alive(pid: int) -> bool:
    """Return True if a process runs: a zombie has ended."""
    try:
        return (
            Path(f"/proc/{pid}/stat")
            .read_text(encoding="ascii")
            .rsplit(")", 1)[1]
            .split()[0]
            != "Z"
        )
    except OSError:
        return False
