"""Ramps on eyes that relax, without pictures: the force on the needle at which the
monitor withdraws, and its readings.

    python benchmarks/bench_relaxing_ramps.py [--eyes 100] [--seed 7]
        [--figure push.png]

Each eye loses up to 20 % of a force with 0.5 to 3 s and up to 25 % with 5 to 30 s.
`calibrate`'s holds of eight virtual pushes say how; E has the error of that log, and
1.5 % more. A reader of dents is off by 0.5 mN, of which 0.4 stay in a session; every
third frame has a second opinion, with a history of its own. Ramps at 5, 10, 20, 50, 100
and 150 mN/s (elastic force) begin at rest, after three pushes, or in a hold in which
the monitor starts.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.calibration.relaxation_from_holds import with_elastic_forces
from scleraforce.lab.needle_pushes import (
    NeedlePath,
    path_of_pushes,
    plan_pushes,
    sample_sensor,
    sense,
)
from scleraforce.live.decision.decide import decide
from scleraforce.live.decision.events import FrameRead, MonitorEvent, SecondOpinion
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
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
FRAME_S = 0.01
OPINION_EVERY = 3
OPINION_AFTER_S = 0.025
TOP_N = 60e-3
BIAS_N = 0.4e-3
NOISE_N = 0.3e-3
SD_N = 0.5e-3
MODULUS_SD = 0.015
LIMITS = MonitorLimits(expects_opinion=True)
CLASSES_N = (5e-3, 30e-3)
FRAME = ((512, 512), (1e-5, 5e-6))
# times, elastic forces, start of the monitor
Corners = tuple[list[float], list[float], float]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RelaxingEye:
    """An eye, what a calibration says of its relaxation, and the read elastic force
    over the true one.
    """

    tissue: PronySeries
    known: Relaxation
    scale: float


@dataclass(frozen=True)
class Played:
    """A session up to its withdrawal: times, elastic, felt and read forces and
    intervals, (frame,); the cause.
    """

    time_s: Floats
    elastic_n: Floats
    felt_n: Floats
    read: list[Answer]
    cause: str | None


def draw_eye(rng: np.random.Generator) -> RelaxingEye:
    """Draw an eye and calibrate its relaxation."""
    times_s = np.exp(rng.uniform(np.log([0.5, 5.0]), np.log([3.0, 30.0])))
    tissue = PronySeries(
        (rng.uniform(0.0, 0.2), rng.uniform(0.0, 0.25)), tuple(times_s.tolist())
    )
    pushes = plan_pushes(FORCES_N, PhantomStudy(), rng)
    path = path_of_pushes(pushes, tissue)
    frame_s = np.array([push.frame_s for push in pushes])
    table = sense(
        path, sample_sensor(PhantomStudy(), rng), 2, -1, path.times_s[-1] + 1.5, rng
    )
    log = ForceLog(table[:, 0], table[:, 1:], FORCE_COLUMNS[1:])
    recording: Any = SimpleNamespace(
        forces=log, info=SimpleNamespace(force=ForceInfo("fz", -1, 2.0))
    )
    labels = FrameForces(path.felt_n(frame_s), frame_s, np.zeros(2), ZERO_PRIOR)
    found, known, _ = with_elastic_forces(recording, labels, None)
    true_n = path.elastic_n(frame_s)

    return RelaxingEye(
        tissue,
        known,
        float(found.force_n @ true_n / (true_n @ true_n))
        * (1.0 + rng.normal(0.0, MODULUS_SD)),
    )


def dent_read(elastic_n: float) -> Answer:
    """Return a reader's answer to a dent."""
    elastic_n = max(elastic_n, 0.0)
    interval_n = (
        max(elastic_n - NINETY_PERCENT * SD_N, 0.0),
        elastic_n + NINETY_PERCENT * SD_N,
    )
    predicted = int(np.searchsorted(CLASSES_N, elastic_n))
    shares = tuple(float(number == predicted) for number in range(3))

    return Answer(
        predicted=predicted,
        probabilities=shares,
        usable=True,
        reason=None,
        force_n=elastic_n,
        interval_n=interval_n,
    )


def play(eye: RelaxingEye, corners: Corners, rng: np.random.Generator) -> Played:
    """Show the frames of a needle to a monitor until it withdraws."""
    path = NeedlePath(tuple(corners[0]), tuple(corners[1]), eye.tissue)
    time_s = np.arange(corners[2] + FRAME_S, corners[0][-1], FRAME_S)
    elastic_n = path.elastic_n(time_s)
    felt_n = path.felt_n(time_s)
    bias_n = rng.normal(0.0, BIAS_N, 2)
    network = opinion = TissueMemory.monitored(
        Setup(eye=Eye(relaxation=eye.known)), TOP_N
    )
    state = MonitorState()
    waiting = list[SecondOpinion]()
    read = list[Answer]()
    cause = None

    for number, at_s in enumerate(time_s.tolist()):
        off_n = min(elastic_n[number] / CLASSES_N[0], 1.0) * bias_n + rng.normal(
            0.0, NOISE_N, 2
        )
        first, second = (
            dent_read(eye.scale * elastic_n[number] + one_n) for one_n in off_n
        )
        answer, network = network.read(first, CLASSES_N, at_s)
        read.append(answer)
        due = [replace(one, at_s=at_s) for one in waiting if one.at_s <= at_s]
        waiting = [one for one in waiting if one.at_s > at_s]
        size, scale_m = FRAME
        seen = FrameRead(
            at_s=at_s,
            frame_id=number,
            verdict=answer.verdict,
            shown_back=0,
            size=size,
            scale_m=scale_m,
        )
        events: list[MonitorEvent] = [*due, seen]

        for event in events:
            state, decision = decide(state, event, LIMITS)
            cause = cause or (decision.cause.name if decision.cause else None)

        if cause is not None:
            break

        if number % OPINION_EVERY == 0:
            answer, opinion = opinion.read(second, CLASSES_N, at_s)
            waiting.append(
                SecondOpinion(
                    at_s=at_s + OPINION_AFTER_S, frame_id=number, verdict=answer.verdict
                )
            )

    shown = len(read)
    return Played(time_s[:shown], elastic_n[:shown], felt_n[:shown], read, cause)


def at_rest(rate_n_s: float, _: np.random.Generator) -> Corners:
    """Return a ramp from rest."""
    return (
        [0.0, 1.0, 1.0 + TOP_N / rate_n_s, 2.0 + TOP_N / rate_n_s],
        [0.0, 0.0, TOP_N, TOP_N],
        0.0,
    )


def after_pushes(rate_n_s: float, rng: np.random.Generator) -> Corners:
    """Return a ramp after three pushes."""
    times_s = [0.0, 1.0]
    forces_n = [0.0, 0.0]

    for _ in range(3):
        top_n = rng.uniform(8e-3, 22e-3)
        steps_s = [
            top_n / rng.uniform(10e-3, 50e-3),
            rng.uniform(2.0, 6.0),
            0.3,
            rng.uniform(1.0, 3.0),
        ]
        times_s += (times_s[-1] + np.cumsum(steps_s)).tolist()
        forces_n += [top_n, top_n, 0.0, 0.0]

    reached_s = times_s[-1] + TOP_N / rate_n_s
    return [*times_s, reached_s, reached_s + 1.0], [*forces_n, TOP_N, TOP_N], 0.0


def from_a_hold(rate_n_s: float, rng: np.random.Generator) -> Corners:
    """Return a ramp from a hold; the monitor starts a second before the ramp."""
    held_n = rng.uniform(10e-3, 20e-3)
    left_s = rng.uniform(2.5, 20.5)
    reached_s = left_s + (TOP_N - held_n) / rate_n_s
    return (
        [0.0, 0.5, left_s, reached_s, reached_s + 1.0],
        [0.0, held_n, held_n, TOP_N, TOP_N],
        left_s - 1.0,
    )


BEGINNINGS: dict[str, Callable[[float, np.random.Generator], Corners]] = {
    "at rest": at_rest,
    "after three pushes": after_pushes,
    "from a hold": from_a_hold,
}


def row(name: str, sessions: list[Played]) -> str:
    """Return a line of the table; readings count from 1 mN on."""
    stops_mn = [1e3 * session.felt_n[-1] for session in sessions]
    in_time = sum(
        session.cause is not None and session.felt_n[-1] < LIMITS.bound_n
        for session in sessions
    )
    pairs = [
        (answer.force_n or 0.0, answer.interval_n or (0.0, 0.0), true_n)
        for session in sessions
        for answer, true_n in zip(session.read, session.felt_n.tolist(), strict=True)
        if true_n > 1e-3
    ]
    error_mn = 1e3 * np.mean([abs(read_n - true_n) for read_n, _, true_n in pairs])
    held = np.mean([low_n <= true_n <= high_n for _, (low_n, high_n), true_n in pairs])
    causes = ", ".join(
        f"{count} {cause}"
        for cause, count in Counter(one.cause for one in sessions).most_common()
    )
    spread = ", ".join(f"{of(stops_mn):.1f}" for of in (np.min, np.median, np.max))

    return (
        f"| {name} | {in_time} of {len(sessions)} | {spread} | {error_mn:.2f} |"
        f" {held:.0%} | {causes} |"
    )


def draw_figure(path: Path, session: Played) -> None:
    """Draw one session: elastic, felt and read force."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    read_mn = 1e3 * np.array([answer.force_n for answer in session.read])
    low_mn, high_mn = 1e3 * np.array([answer.interval_n for answer in session.read]).T
    axes.fill_between(
        session.time_s, low_mn, high_mn, alpha=0.25, label="90 % interval"
    )
    axes.plot(
        session.time_s, 1e3 * session.elastic_n, label="elastic force of the dent, Fe"
    )
    axes.plot(session.time_s, 1e3 * session.felt_n, label="force on the needle, F")
    axes.plot(session.time_s, read_mn, linewidth=0.8, label="read")
    axes.axhline(1e3 * LIMITS.bound_n, color="0.5", linestyle=":")
    axes.set(xlabel="time, s", ylabel="force, mN")
    axes.legend(loc="upper left")
    figure.savefig(path)


def main() -> None:
    """Play the ramps and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("--eyes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument(
        "--figure", type=Path, help="of the first eye after three pushes"
    )
    given = parser.parse_args()
    eyes = [
        draw_eye(np.random.default_rng((given.seed, number)))
        for number in range(given.eyes)
    ]
    print(
        "| ramp | stopped below 30 mN | at a force of, mN | read off by, mN | 90 %"
        " intervals hold | causes |"
    )
    print("|---|---|---|---|---|---|")

    for name, corners in BEGINNINGS.items():
        sessions = list[Played]()
        for number, eye in enumerate(eyes):
            rng = np.random.default_rng((given.seed, number, 1))
            sessions.append(
                play(eye, corners(RATES_N_S[number % len(RATES_N_S)], rng), rng)
            )

        print(row(name, sessions), flush=True)
        if given.figure is not None and corners is after_pushes:
            draw_figure(given.figure, sessions[0])


if __name__ == "__main__":
    main()
