"""Ramps on eyes that relax, without pictures: the force on the needle at which the
monitor withdraws, and its readings.

Each eye loses up to 20 % of a force with 0.5 to 3 s and up to 25 % with 5 to 30 s.
`calibrate`'s holds of eight virtual pushes say how; E has the error of that log, and
1.5 % more. A reader of dents is off by 0.5 mN, of which 0.4 stay in a session; every
third frame has a second opinion, with a history of its own. Ramps at 5, 10, 20, 50, 100
and 150 mN/s (elastic force) begin at rest, after three pushes, or in a hold in which
the monitor starts.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from markdown_tables import markdown
from monitor.needle_forces import FRAME_S
from monitor.watch import OPINION_EVERY, Decisions
from scleraforce.base.arrays import Floats
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.calibration.relaxation_from_holds import with_elastic_forces
from scleraforce.lab.needle_pushes import (
    NeedlePath,
    path_of_pushes,
    plan_pushes,
    sample_sensor,
    sense,
)
from scleraforce.live.decision.events import FrameRead
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.reading.answer import Answer
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.recordings.force_errors import ZERO_PRIOR, FrameForces
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS, ForceLog
from scleraforce.records.eye import Eye
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.setup import Setup
from scleraforce.records.study import PhantomStudy
from scleraforce.records.tissue_relaxation import Relaxation

RATES_N_S = (5e-3, 10e-3, 20e-3, 50e-3, 100e-3, 150e-3)
FORCES_N = (0.026, 0.003, 0.048, 0.014, 0.034, 0.008, 0.040, 0.020)
TOP_N = 60e-3
BIAS_N = 0.4e-3
NOISE_N = 0.3e-3
SD_N = 0.5e-3
MODULUS_SD = 0.015
LIMITS = MonitorLimits(expects_opinion=True)
CLASSES_N = (5e-3, 30e-3)


@dataclass(frozen=True)
class RelaxingEye:
    """An eye, what a calibration says of its relaxation, and the read elastic force
    over the true one.
    """

    tissue: PronySeries
    known: Relaxation
    scale: float


@dataclass(frozen=True)
class Course:
    """Corners of the needle's elastic force, and when the monitor starts."""

    times_s: list[float]
    forces_n: list[float]
    watched_s: float = 0.0


@dataclass(frozen=True)
class Played:
    """A session up to its withdrawal: felt and read forces and intervals, (frame,); the
    cause.
    """

    felt_n: Floats
    read_n: Floats
    low_n: Floats
    high_n: Floats
    cause: str


def relaxing(*, eyes: int = 100, seed: int = 7) -> None:
    """Ramps on eyes that relax: the force at which they are stopped.

    Args:
        eyes: how many.
        seed: of the eyes.
    """
    drawn = [
        _drawn_eye(np.random.default_rng((seed, number))) for number in range(eyes)
    ]
    rows = []
    for name, course in COURSES.items():
        played = list[Played]()
        for number, eye in enumerate(drawn):
            rng = np.random.default_rng((seed, number, 1))
            rate_n_s = RATES_N_S[number % len(RATES_N_S)]
            played.append(_played(eye, course(rate_n_s, rng), rng))

        rows.append([name, *_cells(played)])

    head = ["ramp", "stopped below 30 mN", "at a force of, mN", "read off by, mN"]
    print(markdown([*head, "90 % intervals hold", "causes"], rows))


def _drawn_eye(rng: np.random.Generator) -> RelaxingEye:
    """Draw an eye and calibrate its relaxation."""
    phantom = PhantomStudy()
    times_s = np.exp(rng.uniform(np.log([0.5, 5.0]), np.log([3.0, 30.0])))
    losses = (rng.uniform(0.0, 0.2), rng.uniform(0.0, 0.25))
    tissue = PronySeries(losses, tuple(times_s.tolist()))
    pushes = plan_pushes(FORCES_N, phantom, rng)
    path = path_of_pushes(pushes, tissue)
    frame_s = np.array([push.frame_s for push in pushes])
    sensor = sample_sensor(phantom, rng)
    table = sense(path, sensor, 2, -1, path.times_s[-1] + 1.5, rng)
    recording: Any = SimpleNamespace(
        forces=ForceLog(table[:, 0], table[:, 1:], FORCE_COLUMNS[1:]),
        info=SimpleNamespace(force=ForceInfo("fz", -1, 2.0)),
    )
    labels = FrameForces(path.felt_n(frame_s), frame_s, np.zeros(2), ZERO_PRIOR)
    found, known, _ = with_elastic_forces(recording, labels, None)
    true_n = path.elastic_n(frame_s)
    scale = float(found.force_n @ true_n / (true_n @ true_n))
    return RelaxingEye(tissue, known, scale * (1.0 + rng.normal(0.0, MODULUS_SD)))


def _played(eye: RelaxingEye, course: Course, rng: np.random.Generator) -> Played:
    """Show the frames of a needle to a monitor until it withdraws."""
    path = NeedlePath(tuple(course.times_s), tuple(course.forces_n), eye.tissue)
    time_s = np.arange(course.watched_s + FRAME_S, course.times_s[-1], FRAME_S)
    elastic_n = path.elastic_n(time_s)
    bias_n = rng.normal(0.0, BIAS_N, 2)
    known = Setup(eye=Eye(relaxation=eye.known))
    network = opinion = TissueMemory.monitored(known, TOP_N)
    decisions = Decisions(LIMITS)
    read_fc = list[tuple[float, float, float]]()
    cause = "None"

    for number, at_s in enumerate(time_s.tolist()):
        true_n = elastic_n[number]
        noise_n = rng.normal(0.0, NOISE_N, 2)
        off_n = min(true_n / CLASSES_N[0], 1.0) * bias_n + noise_n
        dents = [_dent_read(eye.scale * true_n + each_n) for each_n in off_n]
        answer, network = network.read(dents[0], CLASSES_N, at_s)
        read_fc.append((answer.force_n or 0.0, *(answer.interval_n or (0.0, 0.0))))
        frame = FrameRead(
            at_s=at_s,
            frame_id=number,
            verdict=answer.verdict,
            shown_back=0,
            size=(512, 512),
            scale_m=(1e-5, 5e-6),
        )
        if withdrawal := decisions.hear(frame, at_s):
            cause = withdrawal.cause
            break

        if number % OPINION_EVERY == 0:
            answer, opinion = opinion.read(dents[1], CLASSES_N, at_s)
            decisions.ask(answer.verdict, at_s, number)

    felt_n = path.felt_n(time_s)[: len(read_fc)]
    read_n, low_n, high_n = np.array(read_fc).T
    return Played(felt_n, read_n, low_n, high_n, cause)


def _dent_read(elastic_n: float) -> Answer:
    """Return a reader's answer to a dent."""
    force_n = max(elastic_n, 0.0)
    width_n = NINETY_PERCENT * SD_N
    predicted = int(np.searchsorted(CLASSES_N, force_n))
    return Answer(
        predicted=predicted,
        probabilities=tuple(float(number == predicted) for number in range(3)),
        usable=True,
        reason=None,
        force_n=force_n,
        interval_n=(max(force_n - width_n, 0.0), force_n + width_n),
    )


def _at_rest(rate_n_s: float, _: np.random.Generator) -> Course:
    """Return a ramp from rest."""
    reached_s = 1.0 + TOP_N / rate_n_s
    return Course([0.0, 1.0, reached_s, reached_s + 1.0], [0.0, 0.0, TOP_N, TOP_N])


def _after_pushes(rate_n_s: float, rng: np.random.Generator) -> Course:
    """Return a ramp after three pushes."""
    times_s = [0.0, 1.0]
    forces_n = [0.0, 0.0]
    for _ in range(3):
        top_n = rng.uniform(8e-3, 22e-3)
        push_s = top_n / rng.uniform(10e-3, 50e-3)
        steps_s = [push_s, rng.uniform(2.0, 6.0), 0.3, rng.uniform(1.0, 3.0)]
        times_s += (times_s[-1] + np.cumsum(steps_s)).tolist()
        forces_n += [top_n, top_n, 0.0, 0.0]

    reached_s = times_s[-1] + TOP_N / rate_n_s
    return Course([*times_s, reached_s, reached_s + 1.0], [*forces_n, TOP_N, TOP_N])


def _from_a_hold(rate_n_s: float, rng: np.random.Generator) -> Course:
    """Return a ramp from a hold; the monitor starts a second before the ramp."""
    held_n = rng.uniform(10e-3, 20e-3)
    left_s = rng.uniform(2.5, 20.5)
    reached_s = left_s + (TOP_N - held_n) / rate_n_s
    times_s = [0.0, 0.5, left_s, reached_s, reached_s + 1.0]
    return Course(times_s, [0.0, held_n, held_n, TOP_N, TOP_N], left_s - 1.0)


COURSES: dict[str, Callable[[float, np.random.Generator], Course]] = {
    "at rest": _at_rest,
    "after three pushes": _after_pushes,
    "from a hold": _from_a_hold,
}


def _cells(played: list[Played]) -> list[str]:
    """Return the cells of a row; readings count from 1 mN on."""
    stops_n = np.array([each.felt_n[-1] for each in played])
    causes = Counter(each.cause for each in played)
    in_time = sum(
        each.cause != "None" and each.felt_n[-1] < LIMITS.bound_n for each in played
    )
    felt_n, read_n, low_n, high_n = (
        np.concatenate([getattr(each, name) for each in played])
        for name in ("felt_n", "read_n", "low_n", "high_n")
    )
    felt = felt_n > 1e-3
    holds = (low_n <= felt_n) & (felt_n <= high_n)
    stops_mn = 1e3 * np.quantile(stops_n, (0.0, 0.5, 1.0))
    return [
        f"{in_time} of {len(played)}",
        ", ".join(f"{stop_mn:.1f}" for stop_mn in stops_mn),
        f"{1e3 * np.abs(read_n - felt_n)[felt].mean():.2f}",
        f"{holds[felt].mean():.0%}",
        ", ".join(f"{count} {cause}" for cause, count in causes.most_common()),
    ]
