"""Sessions with and without `--learn-eye`: withdrawals, intervals, and E at the start
and at the end.

    python benchmarks/bench_learn_eye.py [--count 50] [--seed 43] [--opinions 20]
        [--workers 1]

Raw B-scans of open virtual eyes, 3-D at finite strain, rendered 50 times a second
(`monitor_sessions`). Both monitors read the same frames: segmentation, network, fit as
second opinion, decision; one also learns E, with the code of `monitor --learn-eye`, in
this process: what was learned counts a second after it was asked for, as on a busy
machine. The eye's globe, thickness, IOP and gap are given, with the errors of calipers
and gauges.

Every sixth frame goes to the second opinion. A session moves for 4 s below 8 to 20 mN,
where each withdrawal is false, then rises to 40 mN by 10 to 50 mN/s, where a monitor
whose order is not out when the true force reaches 30 mN has missed one. Five sessions
are of one eye, in turns with E of the study's prior and of a population of 0.35 +-
0.087 MPa. The wider interval is to blame for a false withdrawal if the 90 % interval
held the true force.

`--opinions N`: the second opinion of the service reads N s of frames, 50 a second, with
and without learning.
"""

import argparse
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from select import select
from tempfile import TemporaryDirectory
from time import monotonic, process_time, sleep
from typing import Any

import cv2
import numpy as np

from monitor_sessions.declarations import stated_eye
from monitor_sessions.eyes import SessionEye, draw_eye
from monitor_sessions.forces import FRAME_S, Trajectory, moving_forces, trajectory
from monitor_sessions.frames import stream
from monitor_sessions.watch import WITHDRAW, Watch
from scleraforce.base.units import from_si
from scleraforce.base.worker_processes import work_units
from scleraforce.calibration.filter.eye_parameters import with_modulus
from scleraforce.calibration.stiffness_from_shape import EyePosterior
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.live.companions.eye_learning import EyeFitting, EyeLearner
from scleraforce.live.companions.process_channel import Child
from scleraforce.live.companions.process_messages import (
    Alive,
    EyeLearned,
    OpinionAsked,
    OpinionGiven,
    OpinionSettings,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from virtual_eyes import changed

EVERY = 2
OPINIONS = 6
TOP_N = 40e-3
BOUND_N = 30e-3
TOUCHING_N = 3e-3
AN_EYE = 5
# the first of it without contact, and left out
MOVING_S = 4.8
APART_S = 0.8
HIGHEST_N = (8e-3, 20e-3)
RISING_N_S = (10e-3, 50e-3)
STEP_S = 1.0
POPULATION = Modulus(mean_pa=0.35e6, sd_pa=0.087e6, source="population")
PRIORS = ("the study's", "a population's")
MONITORS = ("no", "yes")


@dataclass
class Played:
    """A monitor in some sessions; lists have one number a session, or a frame in
    contact, unless stated otherwise.

    `ends`: for the first and the last quarter of the frames in contact, widths (N) and
    whether the force was inside.
    """

    false: int = 0
    unexplained: int = 0
    missed: int = 0
    broken: int = 0
    causes: list[str] = field(default_factory=list)
    stopped_n: list[float] = field(default_factory=list)
    ends: tuple[list[tuple[float, bool]], list[tuple[float, bool]]] = field(
        default_factory=lambda: ([], [])
    )
    modulus: tuple[list[tuple[float, float]], list[tuple[float, float]]] = field(
        default_factory=lambda: ([], [])
    )
    ratios: list[float] = field(default_factory=list)

    def add(self, other: "Played") -> None:
        """Add other sessions."""
        for name in (
            "false",
            "unexplained",
            "missed",
            "broken",
            "causes",
            "stopped_n",
            "ratios",
        ):
            setattr(self, name, getattr(self, name) + getattr(other, name))

        for at in range(2):
            self.ends[at].extend(other.ends[at])
            self.modulus[at].extend(other.modulus[at])


class InProcess:
    """A link to a fit in this process; its answers come `STEP_S` after they were asked
    for.
    """

    def __init__(self, fitting: EyeFitting) -> None:
        self.now_s = 0.0
        self.took_s = list[float]()
        self._fitting = fitting
        self._due = deque[tuple[float, EyeLearned]]()

    def send(self, obj: Any, /) -> None:
        """Fit."""
        begun_s = process_time()
        if found := self._fitting.take(obj):
            self._due.append((self.now_s + STEP_S, found))
            self.took_s.append(process_time() - begun_s)

    def poll(self) -> bool:
        """Return whether an answer is due."""
        return bool(self._due) and self._due[0][0] <= self.now_s

    def recv(self) -> EyeLearned:
        """Return it."""
        return self._due.popleft()[1]

    def close(self) -> None:
        """Nothing is open."""


class Bench:
    """State of a process: the reader, and the limits of its monitors."""

    def __init__(self, seed: int) -> None:
        cv2.setNumThreads(1)
        self.seed = seed
        self.reader = load_force_reader(Path("default"))
        scanner = self.reader.study.oct
        scale = PixelScale.of(self.reader.study.oct)
        self.limits = MonitorLimits(
            bound_n=BOUND_N,
            size=(scanner.rows, scanner.columns),
            scale_m=(scale.lateral_m, scale.depth_m),
            expects_opinion=True,
        )

    def session(self, number: int) -> tuple[Played, Played, list[float]]:
        """Play a session; return both monitors, and the time that each step of learning
        took of a core, s.
        """
        drawn = draw_eye("open", number // AN_EYE, self.reader.study, self.seed)
        rng = self._rng(number)
        known = self.known(drawn, number, rng)
        begun = EyePosterior(
            setup=known, study=self.reader.study, library=self.reader.library_for(known)
        )
        link = InProcess(EyeFitting(begun, eye_name(drawn.setup), None))
        learner = EyeLearner(link)  # type: ignore[arg-type] # in place of a connection
        watches = [
            Watch(self.reader, known, self.limits, one, OPINIONS)
            for one in (None, learner)
        ]
        played = [Played(), Played()]
        readings = list[tuple[list[tuple[float, bool] | None], list[float]]]()
        path, moving = forces(rng, drawn)

        for n, frame in enumerate(stream(drawn, path, rng, self.seed)):
            link.now_s = at_s = EVERY * FRAME_S * (n + 1) + float(
                np.clip(rng.normal(0.0, 1e-3), -4e-3, 4e-3)
            )
            force_n = float(path.force_n[n])
            at_frame = list[tuple[float, bool] | None]()

            if force_n >= BOUND_N:
                break

            for watch, of in zip(watches, played, strict=True):
                answer, begins = watch.read(frame, at_s, n, 0)
                low_n, high_n = answer.interval_n or (np.inf, np.inf)
                holds = low_n <= force_n <= high_n
                at_frame.append((high_n - low_n, holds) if answer.interval_n else None)

                if begins:
                    of.causes.append(begins.cause)
                    of.false += n < moving
                    of.unexplained += n < moving and not holds
                    of.stopped_n += [force_n] * (n >= moving)

            if force_n >= TOUCHING_N and n < moving:
                moduli = (watch.setup.eye.modulus for watch in watches)
                readings.append(
                    (at_frame, [modulus.relative_sd for modulus in moduli if modulus])
                )

        truth_pa = drawn.setup.eye.modulus_pa
        for place, (watch, of) in enumerate(zip(watches, played, strict=True)):
            of.missed = int(watch.code != WITHDRAW)
            of.broken = watch.released + (watch.limits.bound_n != BOUND_N)
            quarter = max(len(readings) // 4, 1)

            for end, frames in zip(
                of.ends, (readings[:quarter], readings[-quarter:]), strict=True
            ):
                end += [one for both, _ in frames if (one := both[place]) is not None]

            for errors, modulus in zip(
                of.modulus, (known.eye.modulus, watch.setup.eye.modulus), strict=True
            ):
                assert modulus is not None
                errors.append((modulus.mean_pa / truth_pa - 1.0, modulus.relative_sd))

        played[1].ratios = [
            two[0] / one[0] / (sds[1] / sds[0])
            for (one, two), sds in readings
            if one and two
        ]
        return played[0], played[1], link.took_s

    def _rng(self, number: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, 4, number))

    def known(self, drawn: SessionEye, number: int, rng: np.random.Generator) -> Setup:
        """Return what is given of an eye: E of the study's prior, or of a
        population.
        """
        prior = self.reader.study.calibration
        studys = Modulus(
            mean_pa=prior.prior_mean_pa, sd_pa=prior.prior_sd_pa, source="population"
        )
        stated = changed(stated_eye(drawn, rng)[0], globe=OPEN)
        return with_modulus(stated, (studys, POPULATION)[number % 2])


def forces(rng: np.random.Generator, drawn: SessionEye) -> tuple[Trajectory, int]:
    """Return the course of a session, and the number of frames until the rise."""
    moving_n, names = moving_forces(
        round(MOVING_S / FRAME_S), rng.uniform(*HIGHEST_N), rng
    )
    rising_n = np.arange(moving_n[-1], TOP_N, rng.uniform(*RISING_N_S) * FRAME_S)
    path = trajectory(
        np.concatenate([moving_n, rising_n]),
        [*names, *["rise"] * len(rising_n)],
        drawn.study,
        rng,
    )
    begin = round(APART_S / FRAME_S)

    return (
        Trajectory(*(part[begin::EVERY] for part in vars(path).values())),
        (len(moving_n) - begin) // EVERY,
    )


def rows(prior: str, monitors: tuple[Played, Played]) -> Iterator[str]:
    """Yield the lines of a prior."""
    for learns, of in zip(MONITORS, monitors, strict=True):
        widths = [
            from_si(float(np.mean([width for width, _ in end])), "mn")
            for end in of.ends
        ]
        held = np.mean([holds for end in of.ends for _, holds in end])
        off = [
            100.0 * float(np.sqrt(np.mean([error**2 for error, _ in end])))
            for end in of.modulus
        ]
        sds = [100.0 * float(np.mean([sd for _, sd in end])) for end in of.modulus]
        inside = sum(
            abs(error) < 2.0 * sd * (1.0 + error) for error, sd in of.modulus[1]
        )
        stopped = (
            f"{from_si(float(np.median(of.stopped_n)), 'mn'):.1f}"
            if of.stopped_n
            else ""
        )
        count = len(of.modulus[0])
        yield (
            f"| {prior} | {learns} | {of.false}, {of.unexplained} | {of.missed} of"
            f" {count} | {stopped} | {widths[0]:.1f}, {widths[1]:.1f} | {held:.0%} |"
            f" {off[0]:.0f}, {off[1]:.0f} | {sds[0]:.0f}, {sds[1]:.0f} | {inside} of"
            f" {count} |"
        )


def opinions(
    reader: ForceReader, drawn: SessionEye, setup: Setup, seconds: float, learns: bool
) -> tuple[list[float], int]:
    """Return how late each opinion of the service's process was, s, and how many frames
    have taught at the end.
    """
    scale = PixelScale.of(reader.study.oct)
    rng = np.random.default_rng(0)
    frames = list(stream(drawn, forces(rng, drawn)[0], rng, 0))
    ring = FrameRing.create(64, *frames[0].shape)
    late_s = list[float]()
    sent_s = dict[int, float]()
    taught = 0

    with TemporaryDirectory() as folder:
        settings = OpinionSettings(
            model=Path("default"),
            setup=setup,
            scale=scale,
            ring=ring.place,
            learns="eye" if learns else None,
            record=Path(folder),
        )
        child = Child(
            "scleraforce.live.companions.second_opinion",
            settings,
            [ring.place.descriptor],
        )

        while not any(isinstance(one, Alive) for one in child.channel.receive()):
            select([child.channel], [], [], 1.0)

        begun_s = monotonic()
        for number in range(1, round(50 * seconds)):
            sleep(max(0.0, begun_s + number / 50 - monotonic()))
            ring.put(number, frames[number % len(frames)])
            sent_s[number] = now_s = monotonic()
            child.channel.send(
                OpinionAsked(
                    number=number, order=number, at_s=now_s, teaches=True, pierced=False
                )
            )

            for one in child.channel.receive():
                if isinstance(one, OpinionGiven):
                    late_s.append(now_s - sent_s[one.order])
                taught = one.frames if isinstance(one, EyeLearned) else taught

        child.end(10.0)

    return late_s, taught


def main() -> None:
    """Play the sessions and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=50, help="sessions")
    parser.add_argument("--seed", type=int, default=43)
    parser.add_argument("--opinions", type=float, default=0.0, metavar="S")
    parser.add_argument("--workers", type=int, default=1)

    given = parser.parse_args()
    if given.opinions:
        bench = Bench(given.seed)
        drawn = draw_eye("open", 0, bench.reader.study, given.seed)

        for learns in (False, True):
            known = bench.known(drawn, 0, np.random.default_rng(0))
            late_s, frames = opinions(
                bench.reader, drawn, known, given.opinions, learns
            )
            half, most = (
                from_si(float(np.quantile(late_s, share)), "ms")
                for share in (0.5, 0.99)
            )
            words = (
                f"{len(late_s)} opinions after {half:.0f} ms, 99 % {most:.0f}; {frames}"
                " frames taught"
            )
            print(f"learning {MONITORS[learns]}: {words}")

        return

    found = [(Played(), Played()) for _ in PRIORS]
    took_s = list[float]()

    with suppress(KeyboardInterrupt):  # the table is of the sessions that are done
        for number, (*both, steps_s) in work_units(
            partial(_bench, given.seed), range(given.count), given.workers
        ):
            for of, other in zip(found[number % 2], both, strict=True):
                of.add(other)

            took_s += steps_s
            said = [
                f"{one.causes}, E {one.modulus[1][0][0]:+.0%} sd"
                f" {one.modulus[1][0][1]:.0%}"
                for one in both
            ]
            print(f"session {number}: {'; learned: '.join(said)}", flush=True)

    print(
        "\n| prior of E | learns | false withdrawals, not by the interval's width |"
        " missed | stopped at, mN | width, mN: first, last quarter | intervals hold | E"
        " off, %: start, end | sd, % | in 2 sd |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")

    for prior, monitors in zip(PRIORS, found, strict=True):
        if monitors[0].modulus[0]:
            print("\n".join(rows(prior, monitors)))

    ratios = [ratio for _, learned in found for ratio in learned.ratios]
    causes = [cause for monitors in found for one in monitors for cause in one.causes]
    print(
        "\nwithdrawals left, or bounds raised:"
        f" {sum(one.broken for monitors in found for one in monitors)}"
    )
    print(
        "interval over interval / sd over sd: 1 % of frames below"
        f" {np.quantile(ratios, 0.01):.2f}, median {np.median(ratios):.2f}"
    )
    print(
        f"PIERCED {causes.count('PIERCED')} of {len(causes)} causes; a step of learning"
        f" took {np.median(took_s or [0.0]):.2f} s of a core,"
        f" {max(took_s, default=0.0):.2f} at most"
    )


def _bench(seed: int) -> Callable[[int], tuple[Played, Played, list[float]]]:
    return Bench(seed).session


if __name__ == "__main__":
    main()
