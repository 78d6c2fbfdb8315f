"""Open ten thousand hostile connections while a scanner sends and a robot listens;
measure the disturbance.

A STATUS is late by its time since the last one beyond 50 ms. Lateness, answers to
frames and resets are measured with the scanner alone, and under attack.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path
from time import monotonic

from markdown_tables import QUANTILES, markdown, quantiles_ms
from monitor.real_monitor import OTHER_CORES, pin, real_monitor
from monitor.scanner import Frames, Scanner, be_the_peer
from scleraforce.base.worker_processes import no_interrupts
from scleraforce.live.network.openigtlink import Message, Status

BEAT_S = 0.05
ASK_S = 1.0  # between two resets that the operator asks for, to see how long that takes


def hostile(
    model: Path,
    recording: Path,
    *,
    connections: int = 10_000,
    at_once: int = 200,
    alone_s: float = 60.0,
    seed: int = 0,
) -> None:
    """What hostile clients do to the answers.

    Args:
        model: of kind "reader".
        recording: virtual, 100 frames a second.
        connections: hostile ones.
        at_once: how many of them at a time.
        alone_s: how long the scanner is alone before.
        seed: of the attackers.
    """
    frames = Frames(recording)
    be_the_peer()
    status_s: list[float] = []
    rows = []

    def hear(at_s: float, message: Message) -> None:
        if isinstance(message, Status):
            status_s.append(at_s)

    with (
        real_monitor(model, recording, "--web-port", "0") as monitor,
        closing(Scanner(monitor, frames, 100.0, observed=True, hear=hear)) as scanner,
    ):
        operator = scanner.operator
        console = monitor.console.rstrip("/").rpartition(":")[2]
        words = map(str, (monitor.port, console, connections, at_once, seed))
        scanner.warm_up(100)
        end_s = monotonic() + alone_s
        with _attackers(*words) as attack:
            phases = {
                "alone": lambda: monotonic() < end_s,
                "under attack": attack.goes_on,
            }
            for phase, goes_on in phases.items():
                status_s.clear()
                scanner.log.answers.clear()
                operator.took_s.clear()
                asked_s = monotonic()
                while goes_on():
                    scanner.frame()
                    if monotonic() - asked_s > ASK_S:
                        operator.reset()
                        asked_s = monotonic()

                late_s = [max(0.0, b - a - BEAT_S) for a, b in pairwise(status_s)]
                answers_s = [answer.took_s for answer in scanner.log.answers]
                rows += [
                    [phase, "STATUS late by, ms", *quantiles_ms(late_s).values()],
                    [phase, "a frame's answer", *quantiles_ms(answers_s).values()],
                    [phase, "a reset", *quantiles_ms(operator.took_s).values()],
                ]
                attack.begin()

        died = monitor.pids.keys() - monitor.resources().keys()
        withdrawals = [change.message for change in scanner.withdrawals]

    print(markdown(["", "ms", *QUANTILES], rows), end="\n\n")
    print(markdown(["hostile clients", "connections"], attack.ends.items()))
    print(f"processes that died: {', '.join(died) or 'none'}")
    print(f"withdrawals: {len(withdrawals)}", *withdrawals[:20], sep="\n")


class Attack:
    """The process of the hostile clients; `ends` says in the end how many of each kind
    ended how.
    """

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._begin = process.stdin
        self._pipe = process.stdout.fileno()
        self._said = b""
        self.ends: dict[str, int] = {}
        os.set_blocking(self._pipe, False)

    def begin(self) -> None:
        """Let them loose."""
        self._begin.close()

    def goes_on(self) -> bool:
        """Take what the process has said, without waiting; return False at its end."""
        try:
            said = os.read(self._pipe, 1 << 16)
        except BlockingIOError:
            return True

        self._said += said
        if not said:
            self.ends = json.loads(self._said)
        return bool(said)


@contextmanager
def _attackers(*words: str) -> Iterator[Attack]:
    """Start the hostile clients in a process of their own."""
    with no_interrupts():
        process = subprocess.Popen(
            [sys.executable, "-m", "monitor.attackers", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[1],
        )

    pin(process.pid, OTHER_CORES)
    try:
        yield Attack(process)
    finally:
        process.kill()
        process.wait()
