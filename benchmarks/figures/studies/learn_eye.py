"""Sessions with and without `--learn-eye`: the figures of docs/monitor_figures.md,
"Learning the eye".

Raw B-scans of open virtual eyes, 3-D at finite strain, rendered 50 times a second. Both
monitors read the same frames: segmentation, network, fit as second opinion of every
sixth frame, decision; one also learns E, with the code of `monitor --learn-eye`, in
this process: what was learned counts a second after it was asked for, as on a busy
machine. The eye's globe, thickness, IOP and gap are given, with the errors of calipers
and gauges.

A session moves for 4 s below 8 to 20 mN, where each withdrawal is false, then rises to
40 mN by 10 to 50 mN/s, where a monitor whose order is not out when the true force
reaches 30 mN has missed one. Five sessions are of one eye, in turns with E of the
study's prior and of a population of 0.35 +- 0.087 MPa.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from figures.accuracy import percent
from figures.printing import print_table, whole_number
from monitor.declarations import stated_eye
from monitor.eyes import SessionEye, draw_eye
from monitor.needle_forces import FRAME_S, Trajectory, moving_forces, trajectory
from monitor.pictures import stream
from monitor.watch import WITHDRAW, Watch
from scleraforce.base.worker_processes import work_units
from scleraforce.calibration.filter.eye_parameters import with_modulus
from scleraforce.calibration.stiffness_from_shape import EyePosterior
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.live.companions.eye_learning import EyeFitting, EyeLearner
from scleraforce.live.companions.process_messages import EyeLearned
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from virtual_eyes import changed

EVERY = 2  # of the frames of a trajectory
OPINIONS = 6
TOP_N = 40e-3
BOUND_N = 30e-3
TOUCHING_N = 3e-3
SESSIONS_OF_AN_EYE = 5
# the first of it without contact, and left out
MOVING_S = 4.8
APART_S = 0.8
HIGHEST_N = (8e-3, 20e-3)
RISING_N_S = (10e-3, 50e-3)
LEARNED_AFTER_S = 1.0
JITTER_S = 1e-3
POPULATION = Modulus(mean_pa=0.35e6, sd_pa=0.087e6, source="population")
PRIORS = ("the study's", "a population's")


@dataclass
class Played:
    """A monitor in some sessions.

    Attributes:
        sessions: number of them.
        false: withdrawals below the bound.
        missed: rises without an order in time.
        widths_n: of the intervals in the last quarter of the frames in contact.
        holds: whether the interval contains the force, in the first quarter and the
            last.
        sds: relative standard deviation of E at the end of each session.
    """

    sessions: int = 0
    false: int = 0
    missed: int = 0
    widths_n: list[float] = field(default_factory=list)
    holds: list[bool] = field(default_factory=list)
    sds: list[float] = field(default_factory=list)

    def add(self, other: "Played") -> None:
        """Add other sessions."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


class InProcess:
    """A link to a fit in this process, whose answers come later."""

    def __init__(self, fitting: EyeFitting) -> None:
        self.now_s = 0.0
        self._fitting = fitting
        self._due = deque[tuple[float, EyeLearned]]()

    def send(self, obj: Any, /) -> None:
        """Fit."""
        if learned := self._fitting.take(obj):
            self._due.append((self.now_s + LEARNED_AFTER_S, learned))

    def poll(self) -> bool:
        """Return whether an answer is due."""
        return bool(self._due) and self._due[0][0] <= self.now_s

    def recv(self) -> EyeLearned:
        """Return it."""
        return self._due.popleft()[1]

    def close(self) -> None:
        """Nothing is open."""


def known_of(
    reader: ForceReader, drawn: SessionEye, number: int, rng: np.random.Generator
) -> Setup:
    """Return what is given of an eye: E of the study's prior, or of a population."""
    prior = reader.study.calibration
    own = Modulus(
        mean_pa=prior.prior_mean_pa, sd_pa=prior.prior_sd_pa, source="population"
    )
    stated = changed(stated_eye(drawn, rng)[0], globe=OPEN)
    return with_modulus(stated, (own, POPULATION)[number % 2])


def needle_path(rng: np.random.Generator, drawn: SessionEye) -> tuple[Trajectory, int]:
    """Return the course of a session, and the number of frames until the rise."""
    count = round(MOVING_S / FRAME_S)
    moving_n, names = moving_forces(count, rng.uniform(*HIGHEST_N), rng)
    rising_n = np.arange(moving_n[-1], TOP_N, rng.uniform(*RISING_N_S) * FRAME_S)
    forces_n = np.concatenate([moving_n, rising_n])
    names = [*names, *["rise"] * len(rising_n)]
    path = trajectory(forces_n, names, drawn.study, rng)
    begin = round(APART_S / FRAME_S)
    parts = (part[begin::EVERY] for part in vars(path).values())
    return Trajectory(*parts), (len(moving_n) - begin) // EVERY


def play(
    seed: int, reader: ForceReader, limits: MonitorLimits, number: int
) -> tuple[Played, Played]:
    """Play a session with both monitors."""
    drawn = draw_eye("open", number // SESSIONS_OF_AN_EYE, reader.study, seed)
    rng = np.random.default_rng((seed, 4, number))
    known = known_of(reader, drawn, number, rng)
    posterior = EyePosterior(
        setup=known, study=reader.study, library=reader.library_for(known)
    )
    link = InProcess(EyeFitting(posterior, eye_name(drawn.setup), None))
    learner = EyeLearner(link)  # type: ignore[arg-type] # in place of a connection
    watches = [Watch(reader, known, limits, one, OPINIONS) for one in (None, learner)]
    monitors = Played(sessions=1), Played(sessions=1)
    readings = list[list[tuple[float, bool] | None]]()
    path, moving = needle_path(rng, drawn)

    for frame, pixels in enumerate(stream(drawn, path, rng, seed)):
        late_s = float(np.clip(rng.normal(0.0, JITTER_S), -4 * JITTER_S, 4 * JITTER_S))
        link.now_s = EVERY * FRAME_S * (frame + 1) + late_s
        force_n = float(path.force_n[frame])
        if force_n >= BOUND_N:
            break

        answers = [watch.read(pixels, link.now_s, frame, 0) for watch in watches]
        if frame >= moving:
            continue

        for played, (_, withdrawal) in zip(monitors, answers, strict=True):
            played.false += withdrawal is not None
        if force_n >= TOUCHING_N:
            readings.append([_interval(answer, force_n) for answer, _ in answers])

    quarter = max(len(readings) // 4, 1)
    columns = zip(*readings, strict=True)
    for watch, played, column in zip(watches, monitors, columns, strict=True):
        played.missed = int(watch.code != WITHDRAW)
        assert watch.setup.eye.modulus is not None
        played.sds.append(watch.setup.eye.modulus.relative_sd)
        last = list(filter(None, column[-quarter:]))
        played.widths_n += [width_n for width_n, _ in last]
        first = filter(None, column[:quarter])
        played.holds += [holds for _, holds in (*first, *last)]

    return monitors


def _interval(answer: Answer, force_n: float) -> tuple[float, bool] | None:
    """Return the width of an interval, N, and whether it contains the force."""
    if answer.interval_n is None:
        return None
    low_n, high_n = answer.interval_n
    return high_n - low_n, low_n <= force_n <= high_n


def _playing(seed: int) -> "partial[tuple[Played, Played]]":
    """Prepare a process: the reader, and the limits of its monitors."""
    cv2.setNumThreads(1)
    reader = load_force_reader(Path("default"))
    scanner = reader.study.oct
    scale = PixelScale.of(scanner)
    limits = MonitorLimits(
        bound_n=BOUND_N,
        size=(scanner.rows, scanner.columns),
        scale_m=(scale.lateral_m, scale.depth_m),
        expects_opinion=True,
    )
    return partial(play, seed, reader, limits)


def rows(prior: str, monitors: tuple[Played, Played]) -> Iterator[list[object]]:
    """Yield the rows of a prior."""
    for learns, played in zip(("no", "yes"), monitors, strict=True):
        if played.sessions:
            yield [
                prior,
                learns,
                f"{played.false} in {played.sessions} sessions",
                played.missed,
                f"{1e3 * np.mean(played.widths_n):.1f}",
                percent(float(np.mean(played.holds))),
                percent(float(np.mean(played.sds))),
            ]


@click.command(help=__doc__)
@whole_number("--count", 50, "Sessions.")
@whole_number("--seed", 43)
@whole_number("--workers", 1)
def main(count: int, seed: int, workers: int) -> None:
    """Play the sessions and print the table."""
    found = {prior: (Played(), Played()) for prior in PRIORS}

    for number, monitors in work_units(partial(_playing, seed), range(count), workers):
        played = found[PRIORS[number % len(PRIORS)]]
        for whole, part in zip(played, monitors, strict=True):
            whole.add(part)

    head = ["prior of E", "learns", "false withdrawals", "missed"]
    more = ["width in the last quarter, mN", "intervals hold, %", "sd of E, %"]
    table = (row for prior, both in found.items() for row in rows(prior, both))
    print_table([*head, *more], table)
