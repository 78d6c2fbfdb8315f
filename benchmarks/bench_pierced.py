"""Sessions with and without a puncture: is it found within 50 ms, and how often is one
reported without a cause?

    python benchmarks/bench_pierced.py [--sessions 100] [--seed 20261130]

Readings without pictures, of walls of the bundled library over the reader's training
(open eyes, whose stiffness is known), at 100 to 400 frames a second with 1 ms of
jitter; one frame in 1,000 is lost, one in 500 reads anything up to 30 mN. Readings have
white noise of 0.1 to 0.4 mN (sd), an error of 3 % of the force (sd) for the session and
a slow wander of 0.3 mN; two virtual eyes through raw B-scans and the reader in the loop
had noise of 0.04 to 0.35 mN.

The needle comes, holds, lifts by half at 1 mm/s to the largest speed and comes back,
while the eye moves by 0.2 mm at up to 2 mm/s. With a puncture, at 10 to 60 mN, the
force falls within 1 to 5 ms to a friction of 10 to 50 % while the needle travels on.
Without one the needle withdraws at the largest speed, or the eye jumps from it at 2
mm/s. A robot states its travel 100 to 1,000 times a second; pictures come 5 to 20 ms
late, which the delay does not count.

A second table has pauses: no frame is read for some time, in which the needle goes
through, or in which a hand begins to let go, so that the force falls to 0 within 50 to
400 ms. It counts the sessions with a `PIERCED` or an `UNSEEN_FALL` after the pause.
"""

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.wall_responses import Library
from scleraforce.live.decision.decide import decide
from scleraforce.live.decision.events import Cause, FrameRead
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.study import ReaderStudy
from scleraforce.records.verdict import Verdict

STEP_S = 2.5e-4
FOUND_S = 0.05
EYE_M = 0.2e-3
EYE_M_S = 2e-3
FORCES_N = (10e-3, 60e-3)
PAUSES_S = (0.0, 0.02, 0.035, 0.05, 0.09)
WILD = 1 / 500
LOST = 1 / 1000
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A session in steps of `STEP_S`: the needle's travel and the true force, (step,),
    and the puncture, if any, s.
    """

    travel_m: Floats
    force_n: Floats
    pierced_s: float | None


def wall_force(
    library: Library, trained: ReaderStudy, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw a wall; return dents, m, and forces, N, up to 60 mN or more, (dent,)."""
    while True:
        drawn = (trained.thickness_m, trained.youngs_modulus_pa, trained.iop_pa)
        thickness_m, modulus_pa, iop_pa = (rng.uniform(*one.bounds) for one in drawn)
        tip_m = np.linspace(0.0, library.tip_m[-1], 400)
        alike = np.ones(len(tip_m))
        force_n = modulus_pa * library.forces(
            thickness_m * alike, iop_pa / modulus_pa * alike, tip_m
        )

        enough = int(np.argmax(force_n > 1.2 * FORCES_N[1]))
        if enough:
            return tip_m[: enough + 1], np.maximum.accumulate(force_n[: enough + 1])


def needle(
    wall: tuple[Floats, Floats],
    pierces: bool,
    fastest_m_s: float,
    rng: np.random.Generator,
) -> Motion:
    """Draw a session on a wall."""
    tip_m, of_tip_n = wall
    top_m = float(np.interp(rng.uniform(*FORCES_N), of_tip_n, tip_m))
    on_m_s = rng.uniform(0.3e-3, 2e-3)
    legs = [
        (0.0, 0.5, 0.0),
        (rng.uniform(0.6, 0.9) * top_m, None, on_m_s),
        (0.0, rng.uniform(0.2, 1.0), 0.0),
    ]
    legs += [
        (rng.uniform(0.3, 0.6) * top_m, None, rng.uniform(1e-3, fastest_m_s)),
        (top_m, None, on_m_s),
    ]
    travel_m = np.zeros(1)

    for goal_m, held_s, speed_m_s in legs:
        steps = round(
            (held_s if held_s is not None else abs(goal_m - travel_m[-1]) / speed_m_s)
            / STEP_S
        )
        end_m = travel_m[-1] if held_s is not None else goal_m
        travel_m = np.concatenate(
            [travel_m, np.linspace(travel_m[-1], end_m, steps + 1)[1:]]
        )

    reached = len(travel_m)
    further_m = (
        on_m_s * STEP_S
        if pierces
        else -fastest_m_s * STEP_S * float(rng.random() < 0.5)
    ) * np.arange(1, 4001)
    travel_m = np.concatenate([travel_m, travel_m[-1] + further_m])
    eye_m = wander(len(travel_m), EYE_M, EYE_M_S, rng)

    if not pierces and further_m[-1] == 0.0:  # the eye jumps from the needle
        eye_m[reached:] -= EYE_M_S * STEP_S * np.arange(1, 4001)

    force_n = np.interp(travel_m + eye_m - eye_m[reached - 1], tip_m, of_tip_n)
    if pierces:
        fall = np.clip(np.arange(4000) * STEP_S / rng.uniform(1e-3, 5e-3), 0.0, 1.0)
        friction = (
            rng.uniform(0.1, 0.5)
            * force_n[reached - 1]
            * (1.0 + 0.2 * np.arange(4000) * STEP_S)
        )
        force_n[reached:] = (1.0 - fall) * force_n[reached - 1] + fall * friction

    return Motion(travel_m, force_n, reached * STEP_S if pierces else None)


def wander(count: int, width: float, per_s: float, rng: np.random.Generator) -> Floats:
    """Return a smooth wander of half a width either way that never changes faster than
    `per_s`.
    """
    rate_hz = per_s / (np.pi * width) * rng.uniform(0.3, 1.0)
    moved: Floats = (
        0.5
        * width
        * np.sin(
            2.0 * np.pi * rate_hz * STEP_S * np.arange(count) + rng.uniform(0.0, 6.3)
        )
    )

    return moved


def frames(motion: Motion, tells: bool, rng: np.random.Generator) -> list[FrameRead]:
    """Return the frames of a session with readings; `at_s` is the time of their light,
    which the travel comes after.
    """
    rate_hz = rng.uniform(100.0, 400.0)
    noise_n = rng.uniform(0.1e-3, 0.4e-3)
    late_s = rng.uniform(5e-3, 20e-3)
    robot_s = 1.0 / rng.uniform(100.0, 1000.0)
    scale = 1.0 + rng.normal(0.0, 0.03)
    read_n = scale * motion.force_n + wander(len(motion.force_n), 0.6e-3, 5e-3, rng)
    shown = []

    for number in range(1, int(len(read_n) * STEP_S * rate_hz)):
        at_s = number / rate_hz + float(
            np.clip(rng.normal(0.0, 1e-3), -0.3 / rate_hz, 0.3 / rate_hz)
        )
        force_n = abs(read_n[int(at_s / STEP_S)] + rng.normal(0.0, noise_n))
        force_n = rng.uniform(0.0, 30e-3) if rng.random() < WILD else force_n
        sent_s = at_s + late_s - (at_s + late_s) % robot_s
        travel_m = float(
            motion.travel_m[min(int(sent_s / STEP_S), len(motion.travel_m) - 1)]
        )

        if rng.random() >= LOST:
            shown.append(
                frame_read(
                    number,
                    at_s,
                    float(force_n),
                    travel_m if tells else None,
                    at_s + late_s - sent_s,
                )
            )

    return shown


def let_go(
    wall: tuple[Floats, Floats], rng: np.random.Generator
) -> tuple[Motion, float]:
    """Draw a needle that is held at 5 to 25 mN and let go; return when that begins,
    s.
    """
    tip_m, of_tip_n = wall
    top_m = float(np.interp(rng.uniform(5e-3, 25e-3), of_tip_n, tip_m))
    held = round(rng.uniform(1.0, 1.5) / STEP_S)
    falls = round(rng.uniform(0.05, 0.4) / STEP_S)
    travel_m = top_m * np.concatenate(
        [np.ones(held), np.linspace(1.0, 0.0, falls), np.zeros(1000)]
    )
    return Motion(travel_m, np.interp(travel_m, tip_m, of_tip_n), None), held * STEP_S


def without(shown: list[FrameRead], from_s: float, to_s: float) -> list[FrameRead]:
    """Return the frames that are read if none is for some time."""
    return [one for one in shown if not from_s <= one.at_s < to_s]


def frame_read(
    number: int, at_s: float, force_n: float, travel_m: float | None, age_s: float
) -> FrameRead:
    """Return a frame of a reading in the middle class, whose interval stays below the
    bound.
    """
    verdict = Verdict(
        predicted=1,
        probabilities=(0.0, 1.0, 0.0),
        usable=True,
        reason=None,
        force_n=force_n,
        interval_n=(force_n, force_n),
    )
    return FrameRead(
        at_s=at_s,
        frame_id=number,
        verdict=verdict,
        shown_back=0,
        size=(512, 512),
        scale_m=(1e-5, 1e-5),
        travel_m=travel_m,
        travel_age_s=age_s,
    )


def pierced_at(shown: list[FrameRead], limits: MonitorLimits) -> list[float]:
    """Return the times at which a monitor finds a puncture; other causes neither hide
    nor replace one.
    """
    state = MonitorState()
    found = []

    for frame in shown:
        before = state.pierced
        state, _ = decide(state, frame, limits)
        if state.pierced != before:
            found.append(frame.at_s)

    return found


def fall_after(shown: list[FrameRead], limits: MonitorLimits, from_s: float) -> str:
    """Return the cause of a fall that a monitor finds from a time on, or ""."""
    state = MonitorState()
    for frame in shown:
        state, decision = decide(state, frame, limits)
        falls = (Cause.PIERCED, Cause.UNSEEN_FALL)
        if frame.at_s >= from_s and decision.present_cause in falls:
            return decision.present_cause.name

    return ""


def pauses(
    reader: ForceReader, pause_s: float, tells: bool, given: argparse.Namespace
) -> dict[str, Counter[str]]:
    """Return the causes found after a pause with a puncture in it, and after one in
    which a hand begins to let go.
    """
    found = {"pierced": Counter[str](), "let go": Counter[str]()}
    for number in range(given.sessions):
        for kind, causes in found.items():
            rng = np.random.default_rng((given.seed, 2, number, kind == "pierced"))
            wall = wall_force(reader.library, reader.study.reader, rng)
            # nothing else withdraws first: in a withdrawal a fall is none
            limits = replace(limits_of(wall, 5e-3), bound_n=0.2, withdraw_class=3)

            if kind == "pierced":
                motion = needle(wall, True, 5e-3, rng)
                begun_s = motion.pierced_s or 0.0
                from_s = begun_s - rng.uniform(0.0, max(pause_s - 5e-3, 0.0))
            else:
                motion, begun_s = let_go(wall, rng)
                from_s = begun_s + rng.uniform(-0.5 * pause_s, 0.05)

            shown = without(frames(motion, tells, rng), from_s, from_s + pause_s)
            causes[fall_after(shown, limits, from_s)] += 1

    return found


def limits_of(wall: tuple[Floats, Floats], fastest_m_s: float) -> MonitorLimits:
    """Return the limits for a wall, a fifth stiffer, and a robot."""
    wall_n_m = 1.2 * float((np.diff(wall[1]) / np.diff(wall[0])).max())
    return MonitorLimits(retraction_m_s=fastest_m_s, stiffness_n_m=wall_n_m)


def outcome(found_s: list[float], pierced_s: float | None) -> tuple[bool, int, float]:
    """Return whether the puncture was found in time, the number of false findings, and
    the delay, s (NaN: none).
    """
    false = [at_s for at_s in found_s if pierced_s is None or at_s < pierced_s]
    delays_s = [
        at_s - pierced_s
        for at_s in found_s
        if pierced_s is not None and at_s >= pierced_s
    ]

    return (
        bool(delays_s and delays_s[0] <= FOUND_S),
        len(false),
        delays_s[0] if delays_s else np.nan,
    )


def main() -> None:
    """Play the sessions and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "--sessions", type=int, default=100, help="with a puncture, and as many without"
    )
    parser.add_argument("--seed", type=int, default=20261130)
    given = parser.parse_args()
    reader = load_force_reader(Path("default"))
    print(
        "| largest speed, mm/s | travel | found in 50 ms | delay, ms: median, most |"
        " false, of sessions without |"
    )
    print("|---|---|---|---|---|")

    for fastest_m_s, tells in ((5e-3, False), (5e-3, True), (20e-3, True)):
        results: dict[bool, list[tuple[bool, int, float]]] = {True: [], False: []}
        for number in range(given.sessions):
            for pierces in (True, False):
                rng = np.random.default_rng((given.seed, number, pierces))
                wall = wall_force(reader.library, reader.study.reader, rng)
                motion = needle(wall, pierces, fastest_m_s, rng)
                shown = frames(motion, tells, rng)
                limits = limits_of(wall, fastest_m_s)
                results[pierces].append(
                    outcome(pierced_at(shown, limits), motion.pierced_s)
                )

        found, early, delays_s = zip(*results[True], strict=True)
        false = sum(count > 0 for _, count, _ in results[False])
        spread = f"{1e3 * np.nanmedian(delays_s):.0f}, {1e3 * np.nanmax(delays_s):.0f}"
        words = f"{false} ({sum(map(bool, early))} before a puncture)"
        told = "stated" if tells else ""
        print(
            f"| {1e3 * fastest_m_s:g} | {told} | {sum(found)} of {len(found)} |"
            f" {spread} | {words} |",
            flush=True,
        )

    print(
        "\n| pause, ms | travel | pierced in it: PIERCED, UNSEEN_FALL | let go in it:"
        " PIERCED, UNSEEN_FALL |\n|---|---|---|---|"
    )
    for pause_s, tells in product(PAUSES_S, (False, True)):
        found_after = pauses(reader, pause_s, tells, given)
        cells = [
            f"{causes['PIERCED']}, {causes['UNSEEN_FALL']} of {causes.total()}"
            for causes in found_after.values()
        ]
        told = "stated" if tells else ""
        print(f"| {1e3 * pause_s:g} | {told} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
