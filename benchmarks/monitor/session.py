"""Frames at a rate: how soon each is answered, whether withdrawals that are injected
are answered and latch, and what the processes hold.

Beside the monitor runs an echo in plain Python, a control in the same seconds: on the
monitor's core, with its priority, a server takes the same bytes into one buffer and
answers with 100. It gets every tenth frame, halfway between two frames of the monitor.

Injected are, at random times, a frame over the bound, or one with a bit flipped. Each
must be answered with code 3 before the next frame is due, and every answer has that
code until the operator's reset. All other frames stay below 25 mN: a withdrawal from
them is false.
"""

import gc
import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from markdown_tables import QUANTILES, markdown, quantiles_ms
from monitor.browser import open_pages
from monitor.real_monitor import (
    MONITOR_CORES,
    Monitor,
    pin,
    real_monitor,
    server_process,
)
from monitor.scanner import OK, SCANNER_PRIORITY, Frames, Scanner, Sent, be_the_peer
from scleraforce.front.cli.output import progress_bar
from scleraforce.live.companions.watchdog import MONITOR_PRIORITY, run_in_real_time
from scleraforce.live.network.openigtlink import HEADER_BYTES, Status, encode
from scleraforce.live.replay.scanner_player import (
    ScannerClient,
    StatusChange,
)

ECHO_EVERY = 10
ECHO_BYTES = 100
WARM_UP = 100
RING_FRAMES = 1300  # until the ring of frames is full, memory grows as it should
FLIPPED_BITS = (8 * HEADER_BYTES, 200_000)  # of the pixels
LATE_FRAMES = 10  # an injected withdrawal within these is late, after them lost


def session(
    model: Path,
    recording: Path,
    *,
    frames: int = 10_000,
    rate_hz: float = 100.0,
    withdrawal_every: int = 0,
    no_opinion: bool = False,
    shared: bool = False,
    remote: bool = False,
    no_real_time: bool = False,
    pages: int = 0,
    seed: int = 0,
) -> dict[str, Any]:
    """Latency, injected and false withdrawals, memory.

    Args:
        model: of kind "reader".
        recording: virtual, 100 frames a second, to 33 mN or more.
        frames: that are sent.
        rate_hz: frames a second.
        withdrawal_every: frames between two injected withdrawals, on average; 0: none.
        no_opinion: start the monitor without its second opinion.
        shared: nothing is pinned and there is no echo, as in a user's session.
        remote: of a shared session: give the scanner priority, as if it were elsewhere.
        no_real_time: start the monitor without the right to real-time priority.
        pages: of the console, open in headless Chromium.
        seed: of the injections.
    """
    shown = Frames(recording)
    if not shared:
        be_the_peer()
    elif remote:
        run_in_real_time(SCANNER_PRIORITY)

    options = ["--no-second-opinion"] if no_opinion else []
    options += ["--web-port", "0"] if pages else []
    with ExitStack() as stack:
        monitor = stack.enter_context(
            real_monitor(
                model,
                recording,
                *options,
                pinned=not shared,
                real_time=not no_real_time,
            )
        )
        if pages:
            stack.enter_context(open_pages(monitor.console, pages))

        echo = None if shared else stack.enter_context(_echo())
        scanner = Scanner(monitor, shown, rate_hz, observed=shared)
        stack.enter_context(closing(scanner))
        injector = Injector(shown, withdrawal_every, seed)
        result = _measured(monitor, scanner, echo, injector, frames)

    _show(result)
    print(*injector.false[:20], sep="\n")
    return result


def _measured(
    monitor: Monitor,
    scanner: Scanner,
    echo: "Echo | None",
    injector: "Injector",
    frames: int,
) -> dict[str, Any]:
    """Send frames at their times; return the figures."""
    log = scanner.log
    # among the answers of half a minute a collection takes 60 ms, in which no frame
    # would be sent
    gc.collect()
    gc.disable()
    scanner.warm_up(WARM_UP)
    before = monitor.resources()
    begun_s = monotonic()
    for number in progress_bar(range(frames), "session"):
        sent_s = scanner.send(injector.draw(scanner, number))
        if echo and number % ECHO_EVERY == 0:
            scanner.rest(0.5)
            echo.send(scanner.data)

        scanner.rest()
        scanner.attend()
        injector.hear(scanner.withdrawals, number, sent_s)
        if number == RING_FRAMES:
            before = monitor.resources()

    took_s = monotonic() - begun_s
    gc.enable()
    scanner.client.listen(monotonic() + 1.0, lambda: log.last is not None)
    times_s = {
        "last byte sent to STATUS heard": [each.took_s for each in log.answers],
        "echo": echo.took_s if echo else [],
        "injected withdrawal's last byte to code 3": injector.delays_s,
    }
    return {
        "latency": {name: quantiles_ms(found) for name, found in times_s.items()},
        "session": {
            "seconds": took_s,
            "answers a second": len(log.answers) / took_s,
            "frames without an answer (invalid ones have none)": (
                scanner.sent - len(log.answers)
            ),
            "false withdrawals": len(injector.false),
            "withdrawals that ended without a reset": scanner.released,
            "frames of the longest withdrawal": scanner.longest_held,
        },
        "injected": {
            f"{name}, {when}": times
            for (name, when), times in sorted(injector.times.items())
        },
        "processes at first": {role: asdict(held) for role, held in before.items()},
        "processes": {role: asdict(held) for role, held in monitor.resources().items()},
    }


def _show(result: dict[str, Any]) -> None:
    """Print the tables."""
    rows = [[name, *found.values()] for name, found in result["latency"].items()]
    print(markdown(["ms", *QUANTILES], rows), end="\n\n")
    counts = result["session"] | result["injected"]
    print(markdown(["session", ""], counts.items()), end="\n\n")
    rows = [
        [role, *result["processes at first"][role].values(), *held.values()]
        for role, held in result["processes"].items()
    ]
    head = ["RSS, kB", "PSS, kB", "descriptors"]
    print(markdown(["process", *head, *(f"at last: {name}" for name in head)], rows))


class Injector:
    """Calls for withdrawals at random, and counts how they are answered.

    Attributes:
        times: how often each kind was answered "in time", "late", or "lost".
        delays_s: from the last byte to code 3.
        false: messages of withdrawals that nothing called for.
    """

    def __init__(self, frames: Frames, every: int, seed: int) -> None:
        self.times = Counter[tuple[str, str]]()
        self.delays_s: list[float] = []
        self.false: list[str] = []
        self._every = every
        self._rng = np.random.default_rng(seed)
        self._dangerous = frames.dangerous()
        self._pending = ""
        self._number = 0
        self._sent_s = 0.0
        self._heard = 0

    def draw(self, scanner: Scanner, number: int) -> Sent | None:
        """Return what takes the place of the next frame, or None."""
        rng = self._rng
        chance = 1.0 / self._every if self._every else 0.0
        if self._pending or scanner.code != OK or rng.random() >= chance:
            return None

        self._number = number
        if len(self._dangerous) and rng.random() < 0.5:
            self._pending = "over the bound"
            return Sent(int(rng.choice(self._dangerous)))

        self._pending = "a bit flipped"
        return Sent(0, int(rng.integers(*FLIPPED_BITS)))

    def hear(self, withdrawals: list[StatusChange], number: int, sent_s: float) -> None:
        """Take the withdrawals so far, after a frame that went at a time."""
        if self._number == number:
            self._sent_s = sent_s

        for change in withdrawals[self._heard :]:
            if self._pending:
                self.delays_s.append(change.at_s - self._sent_s)
                self._answered("in time" if self._number == number else "late")
            else:
                self.false.append(f"frame {number}: {change.message}")

        self._heard = len(withdrawals)
        if self._pending and number >= self._number + LATE_FRAMES:
            self._answered("lost")

    def _answered(self, when: str) -> None:
        self.times[self._pending, when] += 1
        self._pending = ""


class Echo:
    """The control's connection, and the round trips of the frames that it got."""

    def __init__(self, port: int) -> None:
        self.took_s: list[float] = []
        self._heard_s: list[float] = []
        self._client = ScannerClient(
            "127.0.0.1", port, lambda at_s, *_: self._heard_s.append(at_s)
        )

    def send(self, data: bytearray) -> None:
        """Send a frame, and wait for what comes back."""
        self._heard_s.clear()
        sent_s = self._client.send(data)
        self._client.listen(sent_s + 1.0, lambda: bool(self._heard_s))
        self.took_s += [at_s - sent_s for at_s in self._heard_s]

    def close(self) -> None:
        """Leave."""
        self._client.close()


@contextmanager
def _echo() -> Iterator[Echo]:
    with server_process("monitor.session") as (port, pid):
        pin(pid, MONITOR_CORES)
        with closing(Echo(port)) as echo:
            yield echo


def serve_echo() -> None:
    """Take messages of whatever size their headers state; answer each."""
    bare = len(encode(Status(1, message=""), "Echo"))
    answer = encode(Status(1, message=" " * (ECHO_BYTES - bare)), "Echo")
    room = memoryview(bytearray(1 << 21))
    run_in_real_time(MONITOR_PRIORITY)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        print(listener.getsockname()[1], flush=True)
        link, _ = listener.accept()
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        while _filled(link, room[:HEADER_BYTES]):
            size = HEADER_BYTES + int.from_bytes(room[42:50], "big")
            if not _filled(link, room[HEADER_BYTES:size]):
                return
            link.sendall(answer)


def _filled(link: socket.socket, room: memoryview) -> bool:
    """Receive until a buffer is full; return False where the other end closes."""
    while room:
        count = link.recv_into(room)
        if not count:
            return False
        room = room[count:]
    return True


if __name__ == "__main__":
    serve_echo()
