"""An end for reading what a command says: companions that outlive it hold its pipe, which is then read for ever."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Timer
from typing import IO

__all__ = ["LIMIT_S", "ends"]

LIMIT_S = 240.0  # of a test that starts a monitor, on a busy machine


@contextmanager
def ends(pipe: IO[str], seconds: float = LIMIT_S) -> Iterator[None]:
    """Kill whoever else holds a pipe when this takes longer: whoever reads it then sees its end (Linux only)."""
    timer = Timer(seconds, _kill_holders, (os.readlink(f"/proc/self/fd/{pipe.fileno()}"),))
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
