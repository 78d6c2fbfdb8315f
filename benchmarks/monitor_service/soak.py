"""Frames for an hour and more: memory, descriptors, and withdrawals that must all be
answered, and latch.

Withdrawals are injected at random times, one in 500 frames on average: a frame over the
bound, of another size, of another scale, with a byte flipped. Each must be answered
with code 3 before the next frame is due, and every answer has that code until the
operator's reset, 25 frames later at least.
"""

from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import fmean
from time import monotonic
from typing import Any

import numpy as np

from scleraforce.live.network.openigtlink import HEADER_BYTES
from scleraforce.live.replay.scanner_player import (
    UnstampedMessage,
    frame_message,
    image_matrix,
)

from .figures import QUANTILES, Progress, print_table, quantiles, quantiles_ms
from .monitors import Monitor, Resources, real_monitor, resources
from .scanner import OK, WITHDRAW, Frames, Operator, Pace, be_the_peer

RING_FRAMES = 1300  # until the ring of frames is full, memory grows as it should
LATE_FRAMES = 10  # a withdrawal within these is late, after them lost
HELD_FRAMES = 25  # a withdrawal is watched for these before the reset
RESET_FRAMES = 500  # within which it has to be granted
SAMPLE_S = 2.0


def add_options(parser: ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument("--frames", type=int, default=300_000)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument(
        "--withdrawal-every", type=int, default=500, help="frames, on average"
    )


@dataclass
class Tally:
    """Counts of the withdrawals."""

    injected: Counter[str] = field(default_factory=Counter)
    answered: Counter[str] = field(default_factory=Counter)
    late: Counter[str] = field(default_factory=Counter)
    lost: list[str] = field(default_factory=list)
    unlatched: list[str] = field(default_factory=list)
    uncalled: list[str] = field(default_factory=list)
    stuck: int = 0
    causes: Counter[str] = field(default_factory=Counter)
    delays_s: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Sample:
    """Resources of the processes after a number of frames."""

    frames: int
    held: Mapping[str, Resources]


def run(given: Namespace) -> dict[str, Any]:
    """Send frames, inject, look at the processes."""
    frames = Frames(given.recording)
    be_the_peer()

    with real_monitor(given.model, given.recording) as monitor:
        soak = Soak(monitor, frames, given)
        try:
            soak.go()
        finally:
            soak.close()

        return soak.result()


class Soak:
    """One long run."""

    def __init__(self, monitor: Monitor, frames: Frames, given: Namespace) -> None:
        self._monitor = monitor
        self._frames = frames
        self._given = given
        self._rng = np.random.default_rng(given.seed)
        self._pace = Pace(monitor.port, frames, given.rate_hz)
        self._operator = Operator(monitor.port, monitor.token)
        self._injections = injections(frames, self._rng)
        self._samples: list[Sample] = []
        self._sample_s = 0.0
        self._progress = Progress("soak", given.frames)
        self.tally = Tally()

    def close(self) -> None:
        """Leave."""
        self._progress.end()
        self._pace.client.close()
        self._operator.close()

    def go(self) -> None:
        """Send all frames."""
        self._pace.warm_up(100, self._operator)
        while self._pace.sent < self._given.frames:
            if self._rng.random() < 1.0 / self._given.withdrawal_every:
                self._withdraw_and_reset()
                continue

            self._frame()
            if self._pace.log.code == WITHDRAW:
                status = self._pace.log.status
                self.tally.uncalled.append(
                    f"frame {self._pace.sent}: {status.message if status else ''}"
                )
                self._reset()

        self._sample(at_once=True)

    def _frame(self) -> None:
        self._pace.send()
        self._pace.rest()
        self._sample()
        self._monitor.prune()
        self._progress.show(
            self._pace.sent, f"{sum(self.tally.injected.values())} withdrawals"
        )

    def _withdraw_and_reset(self) -> None:
        name = str(self._rng.choice(list(self._injections)))
        tally = self.tally
        log = self._pace.log
        tally.injected[name] += 1
        begun_s = self._injections[name](self._pace)
        self._pace.rest()
        in_time = log.code == WITHDRAW

        for _ in range(LATE_FRAMES):
            if log.code != WITHDRAW:
                self._frame()

        if log.code != WITHDRAW:
            tally.lost.append(f"frame {self._pace.sent}: {name}: code {log.code}")
        else:
            (tally.answered if in_time else tally.late)[name] += 1
            tally.causes[log.status.name if log.status else ""] += 1
            tally.delays_s.append(log.withdrawn_s - begun_s)

            for _ in range(HELD_FRAMES):
                self._frame()
                if log.code != WITHDRAW:
                    tally.unlatched.append(
                        f"frame {self._pace.sent}: {name}: code {log.code}"
                    )
                    break

            self._reset()

    def _reset(self) -> None:
        """Ask until it is granted and heard of."""
        for number in range(RESET_FRAMES):
            if number % 5 == 0 and self._operator.settled() is not True:
                self._operator.reset()
            self._frame()
            if self._pace.log.code == OK:
                return

        self.tally.stuck += 1

    def _sample(self, at_once: bool = False) -> None:
        """Look at the processes now and then."""
        if self._pace.sent < RING_FRAMES or (
            monotonic() - self._sample_s < SAMPLE_S and not at_once
        ):
            return

        self._sample_s = monotonic()
        held = {
            role: found
            for role, pid in self._monitor.pids.items()
            if (found := resources(pid))
        }
        self._samples.append(Sample(self._pace.sent, held))

    def result(self) -> dict[str, Any]:
        """Print the tables; return the figures."""
        tally = self.tally
        answers = self._pace.log.answers
        injected = sum(tally.injected.values())
        growth = {role: grown(self._samples, role) for role in self._monitor.pids}
        first = self._samples[0].frames if self._samples else 0
        print_table(
            f"held after {first} frames (a full ring), and then until"
            f" {self._pace.sent}",
            [
                "process",
                "",
                "at first, kB",
                "at last, kB",
                "kB a 1000 frames",
                "most descriptors",
            ],
            [
                [role, kind, *growth[role][kind], growth[role]["descriptors"]]
                for role in growth
                if growth[role]
                for kind in ("rss", "own", "pss")
            ],
        )
        print_table(
            "withdrawals",
            ["injected", "times", "code 3 before the next frame", "later"],
            [
                [name, count, tally.answered[name], tally.late[name]]
                for name, count in sorted(tally.injected.items())
            ],
        )
        delays = quantiles_ms(tally.delays_s)
        print_table(
            "from the last byte to code 3, ms", QUANTILES, [list(delays.values())]
        )
        latencies = {
            "last byte sent to STATUS received": quantiles_ms(
                answer.took_s for answer in answers
            ),
            "last byte received to STATUS sent": quantiles(
                answer.server_ms for answer in answers if answer.server_ms is not None
            ),
        }
        rows = [[line, *found.values()] for line, found in latencies.items()]
        print_table("all frames, ms", ["", *QUANTILES], rows)
        figures = {
            "lost": len(tally.lost),
            "left without a reset": len(tally.unlatched),
            "resets not granted": tally.stuck,
            "withdrawals that nothing called for": len(tally.uncalled),
            "injected": injected,
            "frames": self._pace.sent,
            "frames without an answer (invalid frames have none)": (
                self._pace.sent - len(answers)
            ),
        }
        print_table("all in all", ["", ""], list(figures.items()))

        for line in (*tally.lost, *tally.unlatched, *tally.uncalled)[:20]:
            print(f"    {line}")

        return {
            "counts": figures,
            "growth": growth,
            "tally": vars(tally),
            "delays_ms": delays,
            "latencies_ms": latencies,
            "samples": [
                {
                    "frames": s.frames,
                    **{role: asdict(held) for role, held in s.held.items()},
                }
                for s in self._samples[:: max(1, len(self._samples) // 200)]
            ],
        }


def grown(samples: list[Sample], role: str) -> dict[str, Any]:
    """Return for each kind of memory: the mean of the first and of the last tenth, kB,
    and the slope between.
    """
    held = [
        (sample.frames, sample.held[role]) for sample in samples if role in sample.held
    ]
    if len(held) < 2:
        return {}

    tenth = max(1, len(held) // 10)
    frames = np.array([at for at, _ in held], dtype=np.float64)
    kinds: dict[str, Any] = {"descriptors": max(each.descriptors for _, each in held)}
    kinds["descriptors at first"] = held[0][1].descriptors
    kinds["descriptors at last"] = held[-1][1].descriptors

    for kind in ("rss", "own", "pss"):
        memory = np.array(
            [getattr(each, f"{kind}_kb") for _, each in held], dtype=np.float64
        )
        slope = float(np.polyfit(frames, memory, 1)[0]) if len(set(frames)) > 1 else 0.0
        kinds[kind] = [
            round(fmean(memory[:tenth])),
            round(fmean(memory[-tenth:])),
            1e3 * slope,
        ]

    return kinds


def injections(
    frames: Frames, rng: np.random.Generator
) -> dict[str, Callable[[Pace], float]]:
    """Return what sends each kind in the place of the next frame; each returns when its
    last byte went.
    """
    recording = frames.recording
    oct_info = frames.recording.info.scan
    pixels = recording.frame(recording.frames[0])
    matrix = tuple(1.03 * value for value in image_matrix(oct_info))
    cut = frame_message(pixels[: len(pixels) // 2], oct_info, 1, 1)
    scaled = frame_message(pixels, oct_info, 1, 1, matrix=matrix)

    def over(pace: Pace) -> float:
        return pace.send(frames.messages[int(rng.choice(dangerous))])

    def flipped(pace: Pace) -> float:
        place = int(rng.integers(HEADER_BYTES, pixels.nbytes))
        return pace.send(Flipped(frames.messages[0], place, int(rng.integers(8))))

    dangerous = frames.dangerous()
    kinds: dict[str, Callable[[Pace], float]] = {
        "another size": lambda pace: pace.send(cut),
        "another scale": lambda pace: pace.send(scaled),
        "a byte flipped": flipped,
    }

    return {"over the bound": over, **kinds} if len(dangerous) else kinds


class Flipped:
    """A frame with one bit flipped."""

    def __init__(self, message: UnstampedMessage, place: int, bit: int) -> None:
        self._message = message
        self._place = place
        self._bit = bit

    def stamped(self, time_s: float) -> bytearray:
        """Return it with a time."""
        data = bytearray(self._message.stamped(time_s))
        data[self._place] ^= 1 << self._bit
        return data

    @property
    def frame_id(self) -> int:
        """Of the frame."""
        return self._message.frame_id
