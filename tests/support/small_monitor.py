"""A monitor whose reader is a rule: its answer stands in the frame's first pixels. In a process of its own or a thread.

Started as `python small_monitor.py LOOK_S`, with the time of a look of its watchdog: prints its port and the watchdog's
process id, and serves until its standard input closes.
"""

import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from turned_clock import TurnedClock

from scleraforce.monitor import MonitorLimits
from scleraforce.reader.answer import Answer, LiveReading
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.companions import Companions
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.guard import Guard
from scleraforce.service.server import Server, ServerSettings
from scleraforce.service.session import Session

ROWS, COLUMNS = 64, 96
SCALE_M = (20e-6, 10e-6)
TOKEN = "c0ffee"
UNUSABLE, RAISES, NO_NUMBER, HANGS = 60001, 60002, 60003, 60004


def frame_of(force_un: int, serial: int) -> NDArray[np.uint16]:
    """A frame that reads as a force in uN; `serial` makes it differ from others."""
    pixels = np.zeros((ROWS, COLUMNS), dtype=np.uint16)
    pixels[0, :2] = force_un, serial % 65536
    return pixels


def read(pixels: NDArray[Any], _: PixelScale) -> LiveReading:
    force_un = int(pixels[0, 0])
    nowhere = np.full(pixels.shape[1], np.nan)
    if force_un == RAISES:
        raise RuntimeError("the reader broke")
    while force_un == HANGS:
        pass
    if force_un == UNUSABLE:
        return LiveReading(
            Answer(predicted=2, probabilities=None, usable=False, reason="no wall was found"), nowhere, nowhere
        )
    force_n = float("nan") if force_un == NO_NUMBER else force_un * 1e-6
    predicted = int(force_n > 5e-3) + int(force_n > 30e-3)
    shares = tuple(float(number == predicted) for number in range(3))
    interval_n = (0.95 * force_n - 0.5e-3, 1.05 * force_n + 0.5e-3)
    return LiveReading(
        Answer(
            predicted=predicted, probabilities=shares, usable=True, reason=None, force_n=force_n, interval_n=interval_n
        ),
        nowhere,
        nowhere,
    )


def small_server(
    guard: Guard,
    companions: Companions,
    note: Callable[[str], None] = lambda _: None,
    *,
    clock: TurnedClock | None = None,
    borne_s: float = 0.5,
    catch_up_s: float | None = None,
    stalled_s: float = 600.0,
    **settings: Any,
) -> tuple[Server, int]:
    """A server of small frames, and its port; without a clock of the test it needs to bear what holds a test up."""
    limits = MonitorLimits(
        size=(ROWS, COLUMNS), scale_m=SCALE_M, silence_s=borne_s, lag_s=borne_s, catch_up_s=catch_up_s or borne_s
    )
    listener = socket.create_server(("127.0.0.1", 0))
    ring = FrameRing.create(100, ROWS, COLUMNS)
    session = Session(read, limits, clock, clock) if clock else Session(read, limits)
    server = Server(
        session, listener, ServerSettings(TOKEN, stalled_s=stalled_s, **settings), ring, guard, companions, note
    )
    return server, listener.getsockname()[1]


def main() -> None:
    guard = Guard(float(sys.argv[1]))
    server, port = small_server(guard, Companions({}), borne_s=600.0)

    def wait() -> None:
        sys.stdin.read()
        server.stop()

    threading.Thread(target=wait, daemon=True).start()
    sys.stdout.write(f"{port} {guard.pid}\n")
    sys.stdout.flush()
    server.run()
    server.close()
    guard.end()


if __name__ == "__main__":
    main()
