"""The tests' small monitor, whose reader is a rule: it starts quickly, and hangs where
a frame says so.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.worker_processes import no_interrupts
from scleraforce.live.companions.watchdog import LOOK_S, MONITOR_PRIORITY
from scleraforce.live.network.openigtlink import Image
from scleraforce.live.replay.scanner_player import SCANNER_DEVICE, UnstampedMessage

from .monitors import cores, pin

SUPPORT = Path(__file__).parents[2] / "tests" / "support"
sys.path.append(str(SUPPORT))

from small_monitor import HANGS, SCALE_M, frame_of  # type: ignore[import-not-found] # noqa: E402


@dataclass(frozen=True)
class Small:
    """A small monitor that runs."""

    process: subprocess.Popen[str]
    port: int
    watchdog_pid: int


@contextmanager
def small_monitor() -> Iterator[Small]:
    """Run the small monitor with its watchdog; end both."""
    with no_interrupts():
        process = subprocess.Popen(
            [sys.executable, SUPPORT / "small_monitor.py", str(LOOK_S)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    assert process.stdin is not None
    assert process.stdout is not None

    try:
        port, watchdog_pid = map(int, process.stdout.readline().split())
        pin(process.pid, cores()[0])

        with suppress(OSError):  # as the real one does by itself
            os.sched_setscheduler(
                process.pid, os.SCHED_FIFO, os.sched_param(MONITOR_PRIORITY)
            )

        yield Small(process, port, watchdog_pid)
    finally:
        process.stdin.close()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

        process.stdout.close()


class SmallFrames:
    """Frames of 10 mN, more than the monitor remembers, and one that makes the reader
    hang.
    """

    def __init__(self) -> None:
        self.messages = [
            _message(frame_of(10_000 + serial, serial)) for serial in range(1, 61)
        ]
        self.hanging = _message(frame_of(HANGS, 0))

    def to_and_fro(self) -> Iterator[int]:
        """Yield indices, without end."""
        return cycle(range(len(self.messages)))


def _message(pixels: NDArray[np.uint16]) -> UnstampedMessage:
    matrix = (
        SCALE_M[0] * 1e3,
        0.0,
        0.0,
        0.0,
        SCALE_M[1] * 1e3,
        0.0,
        0.0,
        0.0,
        1.0,
        0.0,
        0.0,
        0.0,
    )
    return UnstampedMessage(Image(pixels[None], matrix), SCANNER_DEVICE, 1)
