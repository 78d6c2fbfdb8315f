"""Inject each fault many times at random moments; measure how soon the monitor
withdraws, and with which cause.

The faults of a scanner and its line (`replay --fault`) are injected one after the other
into one monitor, with the operator's reset in between. Faults of the monitor's own
processes need a new monitor each time; the tests' small monitor, which starts quickly,
takes most of the deaths, the real one some.
"""

import os
import signal
from argparse import ArgumentParser, Namespace
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle
from time import monotonic
from typing import Any

import numpy as np

from scleraforce.base.errors import InputError, LinkError
from scleraforce.live.network.openigtlink import Message
from scleraforce.live.replay.scanner_faults import FAULTS, FaultReport, inject, prepare
from scleraforce.live.replay.scanner_player import (
    AnswerLog,
    Player,
    ScannerClient,
    TimedMessage,
    UnstampedMessage,
    frame_message,
    median_interval_s,
)

from .figures import QUANTILES, Progress, print_table, quantiles_ms
from .monitors import Monitor, real_monitor
from .scanner import (
    CONTACT_N,
    OK,
    WITHDRAW,
    Frames,
    Operator,
    Pace,
    Preloaded,
    be_the_peer,
)
from .small import SmallFrames, small_monitor

RUN_IN = 25  # frames of the way to a fault: within them the reset has to be granted
ASKED_FROM = 11  # of them: the last ten, which give the force's rise, are in order
MORE = 12  # frames, at most, beyond those
# of each frame, in turns: on no way to a fault is a picture shown that the monitor
# remembers
PICTURES = 4
TRIES = 20
WITHIN_S = 3.0
BREAKING = {"half", "garbage", "disconnect"}  # these need another connection afterwards
RESTARTS = 20  # of monitors that did not come to watch, for each death


@dataclass
class Row:
    """Results of one kind of fault."""

    name: str
    of: str
    times: int = 0
    delays_s: list[float] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)
    missed: list[str] = field(default_factory=list)
    unexpected: int = 0
    restarts: int = 0

    def add(
        self, delay_s: float | None, cause: str, code: int | None, expected: bool = True
    ) -> None:
        """Take one fault: a silence of 150 ms makes the robot withdraw as well, but
        counts as missed here.
        """
        self.times += 1
        self.causes[cause] += 1
        self.unexpected += not expected

        if delay_s is None or code != WITHDRAW:
            self.missed.append(cause)
        else:
            self.delays_s.append(delay_s)


def add_options(parser: ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument(
        "--times",
        type=int,
        default=100,
        help="each fault of the scanner, and each death of the small",
    )
    parser.add_argument(
        "--deaths",
        type=int,
        default=20,
        help="each death of the real monitor's processes",
    )
    parser.add_argument(
        "--only", nargs="*", default=None, metavar="NAME", help="only these"
    )


def run(given: Namespace) -> dict[str, Any]:
    """Inject all of them."""
    frames = Frames(given.recording)
    names = [
        name
        for name in (*FAULTS, *DEATHS, *SMALL_DEATHS)
        if given.only is None or name in given.only
    ]
    be_the_peer()
    rows = scanner_faults(frames, given, [name for name in names if name in FAULTS])
    show(rows)
    rows += small_deaths(given, [name for name in names if name in SMALL_DEATHS])
    rows += real_deaths(frames, given, [name for name in names if name in DEATHS])
    show(rows)

    return {
        "rows": [
            {**vars(row), "delays_s": None, "delay_ms": quantiles_ms(row.delays_s)}
            for row in rows
        ]
    }


def show(rows: list[Row]) -> None:
    """Print the table of the finished faults."""
    if not rows:
        return

    columns = [
        "fault",
        "of",
        "times",
        "withdrawn",
        *(f"{name}, ms" for name in QUANTILES[1:]),
        "other cause",
        "causes",
    ]
    found = []

    for row in rows:
        delays = quantiles_ms(row.delays_s)
        causes = ", ".join(
            f"{cause} {times}" for cause, times in row.causes.most_common()
        )
        numbers = [delays[name] for name in QUANTILES[1:]]
        found.append(
            [
                row.name,
                row.of,
                row.times,
                len(row.delays_s),
                *numbers,
                row.unexpected,
                causes,
            ]
        )

    print_table("from the fault's last byte, or the signal, to code 3", columns, found)


# Faults of the scanner and its line.


def scanner_faults(frames: Frames, given: Namespace, names: list[str]) -> list[Row]:
    """Inject them in a random order into one monitor."""
    rows = {name: Row(name, "scanner") for name in names}
    if not names:
        return []

    rng = np.random.default_rng(given.seed)
    order = rng.permutation([name for name in names for _ in range(given.times)])
    progress = Progress("faults", len(order))

    with real_monitor(given.model, given.recording) as monitor:
        line = Line(monitor, frames, rng)
        try:
            for done, name in enumerate(order):
                try:
                    report = line.fault(str(name))
                except (InputError, LinkError) as fault:
                    raise SystemExit(
                        f"{name}, number {done}: {fault}\n{monitor.said}"
                    ) from fault

                rows[name].add(
                    report.delay_s,
                    report.cause or report.message,
                    report.code,
                    report.expected,
                )
                progress.show(done + 1, str(name))
                monitor.prune()
        finally:
            progress.end()
            line.close()

    print(
        f"faults of the scanner: {len(order)}, {line.cycle_s / max(1, len(order)):.2f}"
        f" s each; resets granted {line.operator.granted}, refused"
        f" {line.operator.refused}; withdrawn on the way {dict(line.on_the_way)}"
    )
    return list(rows.values())


class Line:
    """The scanner's line to one monitor, over many faults."""

    def __init__(
        self, monitor: Monitor, frames: Frames, rng: np.random.Generator
    ) -> None:
        self._port = monitor.port
        self._frames = frames
        self._rng = rng
        self.operator = Operator(monitor.port, monitor.token)
        self.on_the_way: Counter[str] = Counter()
        self.cycle_s = 0.0
        touched = (frames.force_n > CONTACT_N) & (
            np.arange(len(frames.force_n)) < frames.harmless
        )
        touched[: RUN_IN + MORE + 12] = False
        self._places = np.flatnonzero(touched & np.roll(touched, RUN_IN + MORE))
        self._columns = cycle(range(PICTURES))
        self.log = AnswerLog()
        self._client = self._connect()

    def _connect(self) -> ScannerClient:
        return ScannerClient("127.0.0.1", self._port, self._hear, observed=True)

    def _hear(self, at_s: float, device: str, message: Message) -> None:
        self.log.hear(at_s, device, message)

    def close(self) -> None:
        """Leave."""
        self._client.close()
        self.operator.close()

    def fault(self, name: str) -> FaultReport:
        """Reset the monitor on the way to a random place of the recording, and inject
        there.
        """
        begun_s = monotonic()
        interval_s = median_interval_s(self._frames.recording)
        least_n = FAULTS[name].least_n(interval_s)
        before_n = self._frames.force_n[self._places - 1]
        place = int(self._rng.choice(self._places[before_n > least_n]))
        forces_n = list(self._frames.force_n)

        for _ in range(TRIES):
            recording = self._frames.recording.moved(next(self._columns))
            at_s = recording.frames[place].time_s
            prepared = prepare(
                name, recording, at_s, self._rng, version=1, forces_n=forces_n
            )

            player = self._go(recording, place)
            if player is not None:
                break
        else:
            raise InputError(f"no reset in {TRIES} tries: {self.log.status}")

        report = inject(player, prepared)
        if name in BREAKING:
            self._client.close()
            self._client = self._connect()

        self.cycle_s += monotonic() - begun_s
        return report

    def _go(self, recording: Preloaded, place: int) -> Player | None:
        """Play the frames before a place; None where the monitor does not watch by
        then.
        """
        self.log = AnswerLog()
        player = Player(recording, self._client, self.log, version=1)
        first = place - RUN_IN - int(self._rng.integers(MORE))
        oct_info = recording.info.scan
        entries = recording.frames
        messages = {
            index: frame_message(
                recording.frame(entries[index]), oct_info, index + 1, 1
            )
            for index in range(first, place)
        }
        granted = False

        for index, message in messages.items():
            player.send(TimedMessage(entries[index].time_s, index + 1, message))
            if self.log.ok:
                granted = True
            elif granted and self.log.status and self.log.status.code == WITHDRAW:
                self.on_the_way[self.log.status.name] += 1
                granted = False
            elif index - first >= ASKED_FROM and self.operator.settled() is not True:
                self.operator.reset()

        while self.operator.busy:
            self.operator.settled()
            self._client.listen(monotonic() + 1e-3)

        return player if self.log.ok else None


# Deaths of processes.


@dataclass(frozen=True)
class Death:
    """A signal to one of the monitor's processes, or a frame that hangs its reader, and
    the expected cause.
    """

    role: str
    signal: signal.Signals
    cause: str
    hangs: bool = False


WATCHED = "WATCHDOG"
FAILED = "EXCEPTION"
DEATHS = {
    "monitor stopped": Death("monitor", signal.SIGSTOP, WATCHED),
    "monitor killed": Death("monitor", signal.SIGKILL, WATCHED),
    "watchdog killed": Death("watchdog", signal.SIGKILL, FAILED),
    "watchdog stopped": Death("watchdog", signal.SIGSTOP, FAILED),
    "black box killed": Death("black box", signal.SIGKILL, FAILED),
    "second opinion killed": Death("second opinion", signal.SIGKILL, FAILED),
    "second opinion stopped": Death("second opinion", signal.SIGSTOP, "NO_OPINION"),
}
SMALL_DEATHS = {
    "a tight loop": Death("monitor", signal.SIGCONT, WATCHED, hangs=True),
    "stopped": Death("monitor", signal.SIGSTOP, WATCHED),
    "killed": Death("monitor", signal.SIGKILL, WATCHED),
    "its watchdog killed": Death("watchdog", signal.SIGKILL, FAILED),
}


def real_deaths(frames: Frames, given: Namespace, names: list[str]) -> list[Row]:
    """Start a monitor for each; signal at a random moment while it watches."""
    rng = np.random.default_rng((given.seed, 1))
    rows = []
    progress = Progress("deaths", given.deaths * len(names))

    for place, name in enumerate(names):
        row = Row(name, "real")
        death = DEATHS[name]

        while row.times < given.deaths and row.restarts <= RESTARTS:
            with real_monitor(given.model, given.recording) as monitor:
                pid = monitor.pids[death.role]
                _watch_and_die(Pace(monitor.port, frames, 100.0), pid, death, rng, row)

            progress.show(given.deaths * place + row.times, name)

        rows.append(row)

    progress.end()
    return rows


def small_deaths(given: Namespace, names: list[str]) -> list[Row]:
    """Do the same to small monitors."""
    rng = np.random.default_rng((given.seed, 2))
    rows = []
    frames = SmallFrames()
    progress = Progress("small deaths", given.times * len(names))

    for place, name in enumerate(names):
        row = Row(name, "small")
        death = SMALL_DEATHS[name]

        while row.times < given.times and row.restarts <= RESTARTS:
            with small_monitor() as small:
                pid = (
                    small.process.pid if death.role == "monitor" else small.watchdog_pid
                )
                hanging = frames.hanging if death.hangs else None
                _watch_and_die(
                    Pace(small.port, frames, 100.0), pid, death, rng, row, hanging
                )

            progress.show(given.times * place + row.times, name)

        rows.append(row)

    progress.end()
    return rows


def _watch_and_die(
    pace: Pace,
    pid: int,
    death: Death,
    rng: np.random.Generator,
    row: Row,
    hanging: UnstampedMessage | None = None,
) -> None:
    """Let a monitor watch for a while, and then die; where it does not come to watch,
    it is not counted.
    """
    try:
        pace.warm_up(10 + int(rng.integers(20)))
    except (InputError, LinkError) as fault:
        row.restarts += 1
        print(f"{row.name}: another monitor is started: {fault}", flush=True)
        return
    else:
        _die(pace, pid, death, rng, row, hanging)
    finally:
        pace.client.close()
        _wake(pid)


def _die(
    pace: Pace,
    pid: int,
    death: Death,
    rng: np.random.Generator,
    row: Row,
    hanging: UnstampedMessage | None,
) -> None:
    """Send the signal, or the frame that hangs, at a random moment; send frames until a
    withdrawal.
    """
    pace.send()
    pace.client.listen(monotonic() + rng.uniform(0.0, 0.01))
    if pace.log.code != OK:
        row.add(None, f"code {pace.log.code} before", None)
        return

    begun_s = monotonic()
    if hanging:
        begun_s = pace.send(hanging)
    else:
        os.kill(pid, death.signal)

    try:
        while pace.log.code != WITHDRAW and monotonic() < begun_s + WITHIN_S:
            pace.rest(done=lambda: pace.log.code == WITHDRAW)
            if pace.log.code != WITHDRAW:
                pace.send()
    except LinkError as fault:
        row.add(None, str(fault), None)
        return

    if pace.log.code != WITHDRAW or pace.log.status is None:
        row.add(None, f"code {pace.log.code} after {WITHIN_S:g} s", None)
        return

    cause = pace.log.status.name
    row.add(pace.log.withdrawn_s - begun_s, cause, WITHDRAW, cause == death.cause)


def _wake(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)
