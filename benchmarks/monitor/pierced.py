"""Sessions with and without a puncture: is it found within 50 ms, and how often is one
reported without a cause?

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

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from markdown_tables import markdown
from scleraforce.base.arrays import Floats
from scleraforce.library.wall_responses import Library
from scleraforce.live.decision.decide import decide
from scleraforce.live.decision.events import Cause, FrameRead
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
from scleraforce.reading.load_model import load_force_reader
from scleraforce.records.study import ReaderStudy
from scleraforce.records.verdict import Verdict

STEP_S = 2.5e-4
AFTER = 4000  # steps after the puncture
FOUND_S = 0.05
EYE_M = 0.2e-3
EYE_M_S = 2e-3
FORCES_N = (10e-3, 60e-3)
ROBOTS = ((5e-3, False), (5e-3, True), (20e-3, True))  # m/s, states its travel
SLOW_M_S = 5e-3
PAUSES_S = (0.0, 0.02, 0.035, 0.05, 0.09)
FALLS = (Cause.PIERCED, Cause.UNSEEN_FALL)
WILD = 1 / 500
LOST = 1 / 1000


@dataclass(frozen=True)
class Wall:
    """Dents, m, and forces, N, of a wall up to 60 mN or more, (dent,)."""

    tip_m: Floats
    force_n: Floats

    def limits(self, fastest_m_s: float) -> MonitorLimits:
        """Return the limits for the wall, a fifth stiffer, and a robot."""
        steepest_n_m = float((np.diff(self.force_n) / np.diff(self.tip_m)).max())
        return MonitorLimits(
            retraction_m_s=fastest_m_s, stiffness_n_m=1.2 * steepest_n_m
        )


@dataclass(frozen=True)
class Motion:
    """A session in steps of `STEP_S`: the needle's travel and the true force, (step,),
    and when the puncture, the withdrawal or the release begins, s.
    """

    travel_m: Floats
    force_n: Floats
    begun_s: float


def pierced(*, sessions: int = 100, seed: int = 20_261_130) -> None:
    """Punctures found within 50 ms, and found where there is none.

    Args:
        sessions: with a puncture, and as many without.
        seed: of the sessions.
    """
    reader = load_force_reader(Path("default"))
    library = reader.library
    trained = reader.study.reader
    rows = []
    for fastest_m_s, tells in ROBOTS:
        delays_s: list[float] = []
        false = early = 0
        for number, pierces in product(range(sessions), (True, False)):
            rng = np.random.default_rng((seed, number, pierces))
            wall = _drawn_wall(library, trained, rng)
            motion = _needle(wall, pierces, fastest_m_s, rng)
            frames = _frames(motion, tells, rng)
            found_s = list(_pierced_at(frames, wall.limits(fastest_m_s)))
            after_s = [at_s - motion.begun_s for at_s in found_s]
            if pierces:
                delays_s += [delay_s for delay_s in after_s if delay_s >= 0.0][:1]
                early += min(after_s, default=0.0) < 0.0
            else:
                false += bool(found_s)

        in_time = sum(delay_s <= FOUND_S for delay_s in delays_s)
        rows.append(
            [
                f"{1e3 * fastest_m_s:g}",
                "stated" if tells else "",
                f"{in_time} of {sessions}",
                f"{1e3 * np.median(delays_s):.0f}, {1e3 * np.max(delays_s):.0f}",
                f"{false} ({early} before a puncture)",
            ]
        )

    head = ["largest speed, mm/s", "travel", "found in 50 ms"]
    head += ["delay, ms: median, most", "false, of sessions without"]
    print(markdown(head, rows), end="\n\n")
    rows = []
    for pause_s, tells in product(PAUSES_S, (False, True)):
        causes = {True: Counter[str](), False: Counter[str]()}
        for number, pierces in product(range(sessions), (True, False)):
            rng = np.random.default_rng((seed, 2, number, pierces))
            wall = _drawn_wall(library, trained, rng)
            causes[pierces][_cause_after(wall, pierces, pause_s, tells, rng)] += 1

        cells = [f"{of['PIERCED']}, {of['UNSEEN_FALL']}" for of in causes.values()]
        rows.append([f"{1e3 * pause_s:g}", "stated" if tells else "", *cells])

    head = ["pause, ms", "travel", f"pierced in it ({sessions}): PIERCED, UNSEEN_FALL"]
    print(markdown([*head, f"let go in it ({sessions}): the same"], rows))


def _drawn_wall(
    library: Library, trained: ReaderStudy, rng: np.random.Generator
) -> Wall:
    """Draw a wall that bears 60 mN and a fifth more."""
    drawn = (trained.thickness_m, trained.youngs_modulus_pa, trained.iop_pa)
    tip_m = np.linspace(0.0, library.tip_m[-1], 400)
    alike = np.ones(len(tip_m))
    while True:
        thickness_m, modulus_pa, iop_pa = (rng.uniform(*each.bounds) for each in drawn)
        force_n = modulus_pa * library.forces(
            thickness_m * alike, iop_pa / modulus_pa * alike, tip_m
        )
        enough = int(np.argmax(force_n > 1.2 * FORCES_N[1]))
        if enough:
            end = enough + 1
            return Wall(tip_m[:end], np.maximum.accumulate(force_n[:end]))


def _needle(
    wall: Wall, pierces: bool, fastest_m_s: float, rng: np.random.Generator
) -> Motion:
    """Draw a session on a wall."""
    top_m = float(np.interp(rng.uniform(*FORCES_N), wall.force_n, wall.tip_m))
    on_m_s = rng.uniform(0.3e-3, 2e-3)
    deep_m = rng.uniform(0.6, 0.9) * top_m
    held_s = rng.uniform(0.2, 1.0)
    lifted_m = rng.uniform(0.3, 0.6) * top_m
    up_m_s = rng.uniform(1e-3, fastest_m_s)
    legs = [
        np.zeros(1 + round(0.5 / STEP_S)),
        _leg(0.0, deep_m, on_m_s),
        np.full(round(held_s / STEP_S), deep_m),
        _leg(deep_m, lifted_m, up_m_s),
        _leg(lifted_m, top_m, on_m_s),
    ]
    reached = sum(map(len, legs))
    steps = np.arange(1, AFTER + 1)
    withdraws = pierces or rng.random() < 0.5
    further_m_s = on_m_s if pierces else -fastest_m_s * withdraws
    travel_m = np.concatenate([*legs, top_m + further_m_s * STEP_S * steps])
    eye_m = _wander(len(travel_m), EYE_M, EYE_M_S, rng)
    if not withdraws:  # the eye jumps from the needle
        eye_m[reached:] -= EYE_M_S * STEP_S * steps

    dent_m = travel_m + eye_m - eye_m[reached - 1]
    force_n = np.interp(dent_m, wall.tip_m, wall.force_n)
    if pierces:
        before_n = force_n[reached - 1]
        after_s = (steps - 1) * STEP_S
        fallen = np.clip(after_s / rng.uniform(1e-3, 5e-3), 0.0, 1.0)
        friction_n = rng.uniform(0.1, 0.5) * before_n * (1.0 + 0.2 * after_s)
        force_n[reached:] = (1.0 - fallen) * before_n + fallen * friction_n

    return Motion(travel_m, force_n, reached * STEP_S)


def _leg(from_m: float, to_m: float, speed_m_s: float) -> Floats:
    steps = round(abs(to_m - from_m) / speed_m_s / STEP_S)
    return np.linspace(from_m, to_m, steps + 1)[1:]


def _wander(count: int, width: float, per_s: float, rng: np.random.Generator) -> Floats:
    """Return a smooth wander of half a width either way that never changes faster than
    `per_s`.
    """
    rate_hz = per_s / (np.pi * width) * rng.uniform(0.3, 1.0)
    turns = 2.0 * np.pi * rate_hz * STEP_S * np.arange(count) + rng.uniform(0.0, 6.3)
    return np.asarray(0.5 * width * np.sin(turns))


def _let_go(wall: Wall, rng: np.random.Generator) -> Motion:
    """Draw a needle that is held at 5 to 25 mN and let go."""
    top_m = float(np.interp(rng.uniform(5e-3, 25e-3), wall.force_n, wall.tip_m))
    held = np.ones(round(rng.uniform(1.0, 1.5) / STEP_S))
    falls = np.linspace(1.0, 0.0, round(rng.uniform(0.05, 0.4) / STEP_S))
    travel_m = top_m * np.concatenate([held, falls, np.zeros(1000)])
    force_n = np.interp(travel_m, wall.tip_m, wall.force_n)
    return Motion(travel_m, force_n, len(held) * STEP_S)


def _frames(
    motion: Motion, tells: bool, rng: np.random.Generator
) -> Iterator[FrameRead]:
    """Yield the frames of a session with readings in the middle class, whose intervals
    stay below the bound; `at_s` is the time of their light, which the travel comes
    after.
    """
    rate_hz = rng.uniform(100.0, 400.0)
    noise_n = rng.uniform(0.1e-3, 0.4e-3)
    late_s = rng.uniform(5e-3, 20e-3)
    robot_s = 1.0 / rng.uniform(100.0, 1000.0)
    scale = 1.0 + rng.normal(0.0, 0.03)
    steps = len(motion.force_n)
    read_n = scale * motion.force_n + _wander(steps, 0.6e-3, 5e-3, rng)

    for number in range(1, int(steps * STEP_S * rate_hz)):
        jitter_s = np.clip(rng.normal(0.0, 1e-3), -0.3 / rate_hz, 0.3 / rate_hz)
        at_s = number / rate_hz + float(jitter_s)
        force_n = abs(read_n[int(at_s / STEP_S)] + rng.normal(0.0, noise_n))
        force_n = float(rng.uniform(0.0, 30e-3) if rng.random() < WILD else force_n)
        age_s = (at_s + late_s) % robot_s
        sent_step = min(int((at_s + late_s - age_s) / STEP_S), steps - 1)
        if rng.random() < LOST:
            continue

        yield FrameRead(
            at_s=at_s,
            frame_id=number,
            verdict=Verdict(
                predicted=1,
                probabilities=(0.0, 1.0, 0.0),
                usable=True,
                reason=None,
                force_n=force_n,
                interval_n=(force_n, force_n),
            ),
            shown_back=0,
            size=(512, 512),
            scale_m=(1e-5, 1e-5),
            travel_m=float(motion.travel_m[sent_step]) if tells else None,
            travel_age_s=age_s,
        )


def _pierced_at(frames: Iterable[FrameRead], limits: MonitorLimits) -> Iterator[float]:
    """Yield the times at which a monitor finds a puncture; other causes neither hide
    nor replace one.
    """
    state = MonitorState()
    for frame in frames:
        before = state.pierced
        state, _ = decide(state, frame, limits)
        if state.pierced != before:
            yield frame.at_s


def _cause_after(
    wall: Wall, pierces: bool, pause_s: float, tells: bool, rng: np.random.Generator
) -> str:
    """Return the cause found after a pause with a puncture in it, or after one in which
    a hand begins to let go; "" for none.
    """
    # nothing else withdraws first: in a withdrawal a fall is none
    limits = replace(wall.limits(SLOW_M_S), bound_n=0.2, withdraw_class=3)
    if pierces:
        motion = _needle(wall, True, SLOW_M_S, rng)
        from_s = motion.begun_s - rng.uniform(0.0, max(pause_s - 5e-3, 0.0))
    else:
        motion = _let_go(wall, rng)
        from_s = motion.begun_s + rng.uniform(-0.5 * pause_s, 0.05)

    state = MonitorState()
    for frame in _frames(motion, tells, rng):
        if from_s <= frame.at_s < from_s + pause_s:
            continue

        state, decision = decide(state, frame, limits)
        if frame.at_s >= from_s and decision.present_cause in FALLS:
            return decision.present_cause.name

    return ""
