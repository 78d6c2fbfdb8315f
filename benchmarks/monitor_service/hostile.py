"""Open ten thousand hostile connections while a scanner sends and a robot listens;
measure the disturbance.

A STATUS is late by its time since the last one beyond 50 ms. Lateness is measured with
the robot alone, with the scanner, under attack, and under attack without a scanner,
when only the heartbeat is sent.
"""

import json
import os
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

from scleraforce.base.errors import LinkError
from scleraforce.base.worker_processes import no_interrupts
from scleraforce.live.network.openigtlink import Message, Status

from .figures import QUANTILES, Progress, print_table, quantiles_ms
from .monitors import Monitor, cores, pin, real_monitor, resources
from .scanner import Frames, Operator, Pace, be_the_peer

BEAT_S = 0.05
HANG_S = 0.5  # without a STATUS
ASK_S = 1.0  # between two resets that the operator asks for, to see how long that takes
AFTER_S = 3.0  # until the last of them is forgotten


def add_options(parser: ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument("--connections", type=int, default=10_000)
    parser.add_argument("--at-once", type=int, default=200)
    parser.add_argument(
        "--kinds",
        nargs="*",
        default=[],
        metavar="KIND",
        help="only these (attackers.py)",
    )
    parser.add_argument(
        "--alone-s", type=float, default=60.0, help="how long the quiet phases take"
    )


def run(given: Namespace) -> dict[str, Any]:
    """Go through the phases."""
    frames = Frames(given.recording)
    be_the_peer()

    with real_monitor(given.model, given.recording, "--web-port", "0") as monitor:
        scene = Scene(monitor, frames)
        try:
            result = scene.play(given)
        except LinkError as fault:
            print(
                f"the robot's connection: {fault}; the monitor"
                f" {'runs' if monitor.alive else 'has died'}"
            )
            print(monitor.said)
            raise
        finally:
            scene.close()

    show(result)
    return result


class Scene:
    """A robot and a scanner beside a monitor; the robot's connection is the one that is
    heard.
    """

    def __init__(self, monitor: Monitor, frames: Frames) -> None:
        self._monitor = monitor
        console = monitor.console.rstrip("/").rpartition(":")[2]
        self._ports = monitor.port, int(console)
        self._operator = Operator(monitor.port, monitor.token)
        self._gaps_s: list[float] = []
        self._heard_s: float | None = None
        self._pace = Pace(monitor.port, frames, 100.0, observed=True, also=self._hear)
        self._codes: list[str] = []

    def close(self) -> None:
        """Leave."""
        self._pace.client.close()
        self._operator.close()

    def _hear(self, at_s: float, message: Message) -> None:
        if not isinstance(message, Status):
            return
        if self._heard_s is not None:
            self._gaps_s.append(at_s - self._heard_s)

        self._heard_s = at_s
        said = f"{message.code} {message.name}: {message.message}"
        if not self._codes or self._codes[-1].split(":")[0] != said.split(":")[0]:
            self._codes.append(said)

    def play(self, given: Namespace) -> dict[str, Any]:
        """Play the phases; each returns its figures."""
        few = max(20, given.connections // 10)
        phases: dict[str, Any] = {}
        phases["robot alone"] = self._phase(None, False, given.alone_s)
        self._pace.warm_up(100, self._operator)
        phases["with the scanner"] = self._phase(None, True, given.alone_s)
        before = self._held()

        with attackers(self._ports, given.connections, given.seed, given) as attack:
            phases["under attack"] = self._phase(attack, True)

        self._phase(None, True, AFTER_S)
        after = self._held()
        with attackers(self._ports, few, given.seed + 1, given) as attack:
            phases["under attack, without the scanner"] = self._phase(attack, False)

        died = [role for role in before if role not in after]
        return {
            "phases": phases,
            "before": before,
            "after": after,
            "died": died,
            "said": self._monitor.said,
        }

    def _held(self) -> dict[str, Any]:
        held = {role: resources(pid) for role, pid in self._monitor.pids.items()}
        return {role: asdict(found) for role, found in held.items() if found}

    def _phase(
        self, attack: "Attack | None", scanning: bool, for_s: float = 0.0
    ) -> dict[str, Any]:
        """Run for a time, or until the attack is over; return the figures."""
        begun_s = asked_s = monotonic()
        self._gaps_s = []
        self._heard_s = None
        self._codes = []
        self._pace.log.answers.clear()
        self._operator.took_s.clear()
        self._pace.latest_s = 0.0
        sent = self._pace.sent
        progress = Progress("hostile", attack.total if attack else 1)

        while not attack.ends if attack else monotonic() - begun_s < for_s:
            if scanning:
                self._pace.send()

            self._pace.rest()
            self._monitor.prune()

            if monotonic() - asked_s > ASK_S:
                self._operator.settled()
                self._operator.reset()
                asked_s = monotonic()

            if attack is not None:
                attack.look()
                progress.show(attack.done)

        progress.end()
        return {
            "seconds": monotonic() - begun_s,
            "late_ms": quantiles_ms(max(0.0, gap_s - BEAT_S) for gap_s in self._gaps_s),
            "gap_ms": quantiles_ms(self._gaps_s),
            "latest_frame_ms": 1e3 * self._pace.latest_s,
            "hangs": sum(gap_s > HANG_S for gap_s in self._gaps_s),
            "answers_ms": quantiles_ms(
                answer.took_s for answer in self._pace.log.answers
            ),
            "unanswered": self._pace.sent - sent - len(self._pace.log.answers),
            "resets_ms": quantiles_ms(self._operator.took_s),
            "codes": self._codes,
            "ends": attack.ends if attack else {},
        }


class Attack:
    """The running process of the hostile clients.

    Attributes:
        done: connections that have ended.
        ends: how many of each kind ended how; nothing before the last.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", total: int) -> None:
        assert process.stdout is not None
        self._process = process
        self._pipe = process.stdout.fileno()
        self._rest = b""
        self.total = total
        self.done = 0
        self.ends = dict[str, int]()
        os.set_blocking(self._pipe, False)

    def look(self) -> None:
        """Take what it has said, without waiting."""
        try:
            said = os.read(self._pipe, 1 << 16)
        except BlockingIOError:
            return

        if not said and not self.ends:
            raise SystemExit(f"the attackers died: {self._process.wait()}")

        *lines, self._rest = (self._rest + said).split(b"\n")
        for line in lines:
            if line.startswith(b"{"):
                self.ends = json.loads(line)
            else:
                self.done = int(line)


@contextmanager
def attackers(
    ports: tuple[int, int], connections: int, seed: int, given: Namespace
) -> Iterator[Attack]:
    """Run the hostile clients in a process of their own."""
    words = [*map(str, (*ports, connections, given.at_once, seed)), *given.kinds]
    command = [sys.executable, "-m", "monitor_service.attackers", *words]

    with no_interrupts():
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[1]
        )

    assert process.stdout is not None
    pin(process.pid, cores()[1])

    try:
        yield Attack(process, connections)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    phases = result["phases"]
    for title, key in (
        (
            "STATUS later than 50 ms after the one before, at the robot: by, ms",
            "late_ms",
        ),
        ("between two STATUS, ms", "gap_ms"),
        ("a frame's answer, ms", "answers_ms"),
        ("a reset's answer, ms", "resets_ms"),
    ):
        rows = [
            [name, *(phase[key][column] for column in QUANTILES)]
            for name, phase in phases.items()
        ]
        print_table(title, ["", *QUANTILES], rows)

    columns = [
        "",
        "s",
        f"silences over {HANG_S:g} s",
        "frames unanswered",
        "latest frame, ms",
        "codes",
    ]
    rows = [
        [
            name,
            *(
                phase[key]
                for key in ("seconds", "hangs", "unanswered", "latest_frame_ms")
            ),
            len(phase["codes"]),
        ]
        for name, phase in phases.items()
    ]
    print_table("what happened", columns, rows)

    for name, phase in phases.items():
        print(f"  {name}: {' / '.join(phase['codes'][:8])}")

    print_table(
        "held before the attack and after it",
        ["process", "own kB", "then", "pss kB", "then", "descriptors", "then"],
        [
            [
                role,
                *(
                    each[kind]
                    for kind in ("own_kb", "pss_kb", "descriptors")
                    for each in (held, now)
                ),
            ]
            for role, held in result["before"].items()
            if (now := result["after"].get(role))
        ],
    )
    print(f"  died: {', '.join(result['died']) or 'none'}")
    print_table(
        "hostile clients",
        ["kind", "connections"],
        list(phases["under attack"]["ends"].items()),
    )
