"""Inject each fault many times at random moments; measure how soon the monitor
withdraws, and with which cause.

The faults of a scanner and its line (`scleraforce replay --fault`) are injected one
after the other into one monitor, with the operator's reset in between. Faults of the
monitor's own processes need a new monitor each time.
"""

import os
import signal
from collections import Counter
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from itertools import cycle
from pathlib import Path
from time import monotonic

import numpy as np

from markdown_tables import QUANTILES, markdown, quantiles_ms
from monitor.real_monitor import Monitor, real_monitor
from monitor.scanner import WITHDRAW, Frames, Operator, Scanner, be_the_peer
from scleraforce.base.errors import InputError, LinkError
from scleraforce.front.cli.output import progress_bar
from scleraforce.live.network.openigtlink import Message
from scleraforce.live.replay.scanner_faults import (
    FAULTS,
    FaultReport,
    draw_fault_time,
    inject,
    prepare,
)
from scleraforce.live.replay.scanner_player import AnswerLog, Player, ScannerClient

RUN_IN = 25  # frames of the way to a fault: within them the reset has to be granted
ASKED_FROM = 11  # of them: the last ten, which give the force's rise, are in order
# of each frame, in turns: on no way to a fault is a picture shown that the monitor
# remembers
PICTURES = 4
TRIES = 20
WITHIN_S = 3.0


@dataclass(frozen=True)
class Death:
    """A signal to one of the monitor's processes, and the expected cause."""

    role: str
    signal: signal.Signals
    cause: str = "EXCEPTION"


DEATHS = {
    "monitor stopped": Death("monitor", signal.SIGSTOP, "WATCHDOG"),
    "monitor killed": Death("monitor", signal.SIGKILL, "WATCHDOG"),
    "watchdog killed": Death("watchdog", signal.SIGKILL),
    "watchdog stopped": Death("watchdog", signal.SIGSTOP),
    "black box killed": Death("black box", signal.SIGKILL),
    "second opinion killed": Death("second opinion", signal.SIGKILL),
    "second opinion stopped": Death("second opinion", signal.SIGSTOP, "NO_OPINION"),
}


@dataclass
class Row:
    """Delays and causes of one kind of fault, and how many causes were not expected."""

    delays_s: list[float] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    unexpected: int = 0

    def add(self, report: FaultReport) -> None:
        """Take one fault; a withdrawal without code 3 does not count as one here."""
        self.causes[report.cause or report.message] += 1
        self.unexpected += not report.expected
        if report.code == WITHDRAW and report.delay_s is not None:
            self.delays_s.append(report.delay_s)


def faults(
    model: Path,
    recording: Path,
    *,
    times: int = 100,
    deaths: int = 20,
    only: tuple[str, ...] = (*FAULTS, *DEATHS),
    seed: int = 0,
) -> None:
    """From each injected fault to code 3.

    Args:
        model: of kind "reader".
        recording: virtual, 100 frames a second.
        times: each fault of the scanner.
        deaths: each death of the monitor's processes.
        only: names of faults.
        seed: of moments and order.
    """
    frames = Frames(recording)
    be_the_peer()
    rows = {name: Row() for name in only}
    rng = np.random.default_rng(seed)
    names = [name for name in only if name in FAULTS]
    order = rng.permutation(names * times).tolist()
    if order:
        with (
            real_monitor(model, recording) as monitor,
            closing(Line(monitor, frames, rng)) as line,
        ):
            for name in progress_bar(order, "faults"):
                rows[name].add(line.fault(name))
                monitor.prune()

    died = [name for name in only if name in DEATHS]
    for name in progress_bar(died * deaths, "deaths"):
        with real_monitor(model, recording) as monitor:
            rows[name].add(_died(monitor, frames, name, rng))

    cells = [
        [
            name,
            row.causes.total(),
            *quantiles_ms(row.delays_s).values(),
            row.unexpected,
            ", ".join(f"{cause} {count}" for cause, count in row.causes.most_common()),
        ]
        for name, row in rows.items()
    ]
    head = ["fault", "times", "withdrawn", *(f"{name}, ms" for name in QUANTILES[1:])]
    print("from the fault's last byte, or the signal, to code 3")
    print(markdown([*head, "other cause", "causes"], cells))


class Line:
    """The scanner's line to one monitor, over many faults."""

    def __init__(
        self, monitor: Monitor, frames: Frames, rng: np.random.Generator
    ) -> None:
        self._port = monitor.port
        self._frames = frames
        self._rng = rng
        self._operator = Operator(monitor)
        self._columns = cycle(range(PICTURES))
        self._log = AnswerLog()
        self._client = self._connect()

    def close(self) -> None:
        """Leave."""
        self._client.close()
        self._operator.close()

    def fault(self, name: str) -> FaultReport:
        """Reset the monitor on the way to a random place of the recording, and inject
        there.
        """
        forces_n = list(self._frames.force_n)
        for _ in range(TRIES):
            recording = self._frames.recording.moved(next(self._columns))
            at_s = draw_fault_time(recording, forces_n, self._rng, name)
            times_s = [entry.time_s for entry in recording.frames]
            first = max(0, times_s.index(at_s) - RUN_IN)
            led = replace(recording, frames=recording.frames[first:])
            prepared = prepare(name, led, at_s, self._rng, forces_n=forces_n[first:])
            self._log = AnswerLog()
            player = Player(led, self._client, self._log, watch=self._reset)
            player.play(at_s)
            while self._operator.busy:
                self._client.listen(monotonic() + 1e-3)

            if self._log.ok:
                report = inject(player, prepared)
                # some faults break the connection
                self._client.close()
                self._client = self._connect()
                return report

        raise InputError(f"{name}: no reset in {TRIES} tries: {self._log.status}")

    def _connect(self) -> ScannerClient:
        return ScannerClient("127.0.0.1", self._port, self._hear, observed=True)

    def _hear(self, at_s: float, device: str, message: Message) -> None:
        self._log.hear(at_s, device, message)

    def _reset(self) -> None:
        """Ask for a reset, after a frame that was not answered with OK."""
        if self._log.frames_sent > ASKED_FROM and not self._log.ok:
            self._operator.reset()


def _died(
    monitor: Monitor, frames: Frames, name: str, rng: np.random.Generator
) -> FaultReport:
    """Send a signal at a random moment while a monitor watches, and frames until it
    withdraws.
    """
    death = DEATHS[name]
    pid = monitor.pids[death.role]
    message = f"no code 3 in {WITHIN_S:g} s"
    with closing(Scanner(monitor, frames, 100.0)) as scanner:
        scanner.warm_up(10 + int(rng.integers(20)))
        scanner.client.listen(monotonic() + rng.uniform(0.0, 0.01))
        begun_s = monotonic()
        os.kill(pid, death.signal)
        try:
            while scanner.code != WITHDRAW and monotonic() < begun_s + WITHIN_S:
                scanner.send()
                scanner.rest(done=lambda: scanner.code == WITHDRAW)
        except LinkError as fault:
            message = str(fault)

    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)

    change = scanner.log.first_doubt(begun_s, (WITHDRAW,))
    return FaultReport(
        name=name,
        began_s=begun_s,
        delay_s=change.at_s - begun_s if change else None,
        message=change.message if change else message,
        code=change.code if change else None,
        cause=change.cause if change else None,
        expected=change is not None and change.cause == death.cause,
    )
