"""Whether the monitor cries wolf, and how soon it withdraws: whole sessions of virtual eyes, without sockets.

    python benchmarks/bench_monitor_sessions.py MODEL [--sessions 50] [--seconds 60] [--seed 0] [--workers 1]
        [--compared 100] [--rates-mn-s 5 10 20 50 100]

MODEL is of kind "reader". Ten eyes are bent in 3-D with finite strain, as `phantom` does. Every frame is a raw B-scan
(`render_bscan`) that goes through the live reader (segmentation, slice, network) and `decide`; every second one goes to
the library's fit as well, whose answer comes 15 ms later as a second opinion. One second after a withdrawal the
operator asks for a reset, again and again until it is granted.

- Sessions: forces of 0 to 25 mN that hold, swing, rise slowly, step as a robot does, lift off and come back; the eye
  shifts (drift, breathing, pulse), the signal swings, the scanner's clock jitters, a frame in 1000 is lost.
- Ramps: from 0 at several rates, until the withdrawal.
- Before that: frames with random numbers from a pool, which makes them quick, against as many with new ones.

What is known of an eye is off by what a caliper and a calibration are off: 10 um of the wall, 20 um of the gap, 3 % of
the IOP, and E so that forces are off by 1.5 %.
"""

import argparse
import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache, partial
from math import pi, radians
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.known.eye import Known, Modulus
from scleraforce.known.globe import OPEN
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.optics import BscanOptics, Pose, sample_optics
from scleraforce.laboratory.virtual_eye import PhantomEye, finite_strain_sections
from scleraforce.monitor import Decision, MonitorLimits, MonitorState, decide
from scleraforce.monitor.events import FrameRead, MonitorEvent, QueueLoss, Reset, SecondOpinion
from scleraforce.processes import work_units
from scleraforce.reader import load_force_reader
from scleraforce.reader.answers import Answer
from scleraforce.reader.live import LiveReader
from scleraforce.recording.pixels import PixelScale
from scleraforce.section.plane import Section
from scleraforce.service.companions.second_opinion import opinion_of
from scleraforce.service.session import read_event
from scleraforce.service.shown_pictures import ShownPictures
from scleraforce.study import Study, draw

Floats = NDArray[np.float64]
Frame = NDArray[np.uint16]

FRAME_S = 0.01
JITTER_S = 1e-3
LOSS = 1e-3  # of the frames
OPINION_EVERY, OPINION_AFTER_S = 2, 0.015  # as the monitor asks for them
RESET_AFTER_S = 1.0
HIGHEST_N = 25e-3
PATH_N, STATES = 45e-3, 128
RATES_MN_S = (5.0, 10.0, 20.0, 50.0, 100.0)
POOL = 1536
SESSION, RAMPS = range(2)


class PooledGenerator(np.random.Generator):
    """Random numbers of which the normal ones are windows of a pool, at random places."""

    def __init__(self, seed: tuple[int, ...]) -> None:
        super().__init__(np.random.PCG64(np.random.SeedSequence(seed)))

    def standard_normal(self, size, dtype=np.float32, out=None):  # type: ignore[no-untyped-def, override] # noqa: ARG002
        """Return a window, (rows, columns, 2) of float32."""
        top, left = self.integers(0, POOL - size[0]), self.integers(0, POOL - size[1])
        return pool()[top : top + size[0], left : left + size[1]]


@cache
def pool() -> NDArray[np.float32]:
    """Return independent normal numbers, (row, column, 2)."""
    return np.random.default_rng(20_26).standard_normal((POOL, POOL, 2), dtype=np.float32)


@dataclass(frozen=True)
class Plan:
    """What to run."""

    model: Path
    sessions: int
    seconds: float
    seed: int
    eyes: int
    rates_n_s: tuple[float, ...]

    def unit(self, number: int) -> tuple[int, int, int]:
        """Return the eye, the kind and the number of a unit: all of one eye follow each other."""
        each = -(-self.sessions // self.eyes)
        eye, place = divmod(number, each + 1)
        return eye, (RAMPS if place == each else SESSION), eye * each + place

    @property
    def units(self) -> range:
        """All units; those of sessions beyond the last do nothing."""
        return range(self.eyes * (-(-self.sessions // self.eyes) + 1))


@dataclass(frozen=True)
class Trajectory:
    """True forces, N, and what the eye and the light do, (frame,)."""

    force_n: Floats
    lateral_m: Floats
    depth_m: Floats
    snr_db: Floats
    name: list[str]


@dataclass
class Outcome:
    """What a unit gave."""

    frames: int = 0
    ok: int = 0
    opinions: int = 0
    errors_n: list[float] = field(default_factory=list)
    wolves: list[str] = field(default_factory=list)
    ramps: list[tuple[float, float, float, str]] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)
    took_s: float = 0.0


def draw_eye(number: int, seed: int) -> PhantomEye:
    """Draw an eye within what the reader was trained on, whose wall reaches 45 mN within the scanner's depth."""
    rng = np.random.default_rng((seed, 1, number))
    return PhantomEye(
        id=f"eye-{number}",
        thickness_m=rng.uniform(0.45e-3, 0.85e-3),
        youngs_modulus_pa=rng.uniform(0.22e6, 0.5e6),
        iop_pa=rng.uniform(150.0, 500.0),
        gap_m=rng.uniform(0.4e-3, 0.9e-3),
        polar_rad=radians(rng.uniform(25.0, 45.0)),
    )


@lru_cache(maxsize=1)
def eye_sections(eye: PhantomEye, study: Study) -> tuple[Floats, Floats]:
    """Return forces (state,) and both boundaries there (state, boundary, point, 2), m; points are of the material."""
    forces_n = PATH_N * np.linspace(0.0, 1.0, STATES) ** 1.3
    sections = finite_strain_sections(eye, study)([float(force) for force in forces_n])
    return forces_n, np.stack([[section.outer, section.inner] for section in sections])


def section_at(states: tuple[Floats, Floats], force_n: float) -> Section:
    """Interpolate an eye's section between the forces beside."""
    forces_n, curves_sbnc = states
    after = int(np.clip(np.searchsorted(forces_n, force_n), 1, len(forces_n) - 1))
    share = (force_n - forces_n[after - 1]) / (forces_n[after] - forces_n[after - 1])
    return Section(*((1.0 - share) * curves_sbnc[after - 1] + share * curves_sbnc[after]))


def told(eye: PhantomEye, rng: np.random.Generator) -> Known:
    """Return what is known of an eye; its E makes up for the wrong thickness and IOP, as a calibration's does."""
    thickness_m = eye.thickness_m + rng.normal(0.0, 10e-6)
    iop_pa = eye.iop_pa * (1.0 + rng.normal(0.0, 0.03))
    same_force = (eye.thickness_m / thickness_m) ** 2 * (eye.iop_pa / iop_pa) ** (1.0 / 3.0)
    modulus_pa = eye.youngs_modulus_pa * same_force * (1.0 + rng.normal(0.0, 0.015))
    gap_m = eye.gap_m + rng.normal(0.0, 20e-6)
    return Known(
        globe=OPEN,
        modulus=Modulus(mean_pa=modulus_pa, sd_pa=0.015 * modulus_pa, source="own"),
        iop_pa=iop_pa,
        thickness_m=thickness_m,
        gap_m=gap_m,
        polar_rad=eye.polar_rad,
    )


def moving_forces(count: int, rng: np.random.Generator) -> tuple[Floats, list[str]]:
    """Return true forces below 25 mN and what the robot does, (frame,)."""
    force_n, name = [0.0] * 100, ["before contact"] * 100
    while len(force_n) < count:
        part, words = segment(force_n[-1], rng)
        force_n += part
        name += [words] * len(part)
    tremor = 0.2e-3 * np.sin(2.0 * pi * (rng.uniform(0.8, 1.5) * FRAME_S * np.arange(count) + rng.random()))
    forces = np.array(force_n[:count])
    touching = np.clip(forces / 1e-3, 0.0, 1.0)
    return np.clip(forces + touching * tremor, 0.0, HIGHEST_N), name[:count]


def segment(now_n: float, rng: np.random.Generator) -> tuple[list[float], str]:
    """Return the forces of what the robot does next."""
    frames = int(rng.uniform(1.0, 4.0) / FRAME_S)
    share = np.arange(1, frames + 1) / frames
    kind = rng.choice(["hold", "swing", "ramp", "step", "lift off"], p=[0.2, 0.25, 0.3, 0.2, 0.05])
    if kind == "hold":
        return [now_n] * frames, "hold"
    if kind == "swing":
        reach = rng.uniform(0.2, 1.0) * min(now_n, HIGHEST_N - now_n)
        wave = np.sin(2.0 * pi * share * rng.integers(1, 4))
        return list(now_n + reach * wave), "swing"
    if kind == "ramp":
        goal_n = rng.uniform(0.0, HIGHEST_N)
        return list(now_n + (goal_n - now_n) * share), "ramp"
    if kind == "step":
        goal_n = float(np.clip(now_n + rng.choice([-1, 1]) * rng.uniform(0.5e-3, 3e-3), 0.0, HIGHEST_N))
        rise = np.minimum(np.arange(1, frames + 1) / rng.integers(3, 8), 1.0)
        return list(now_n + (goal_n - now_n) * rise), "step"
    down = np.linspace(1.0, 0.0, int(rng.uniform(0.1, 0.4) / FRAME_S))
    away = np.zeros(int(rng.uniform(0.3, 2.0) / FRAME_S))
    back = np.linspace(0.0, rng.uniform(2e-3, 10e-3), int(rng.uniform(0.5, 1.5) / FRAME_S))
    return [*(now_n * down), *away, *back], "lift off"


def trajectory(force_n: Floats, name: list[str], study: Study, rng: np.random.Generator) -> Trajectory:
    """Add what the eye and the light do: drift, breathing and pulse within the study's shifts, and a jitter of 5 um."""
    time_s = FRAME_S * np.arange(len(force_n))

    def swinging(reach: float, period_s: tuple[float, float]) -> Floats:
        swing: Floats = reach * np.sin(2.0 * pi * (time_s / rng.uniform(*period_s) + rng.random()))
        return swing

    largest_m = study.phantom.eye_shift_m.bounds[1]
    shifts = []
    for pulse_m in (5e-6, 20e-6):
        drift = swinging(0.6 * largest_m, (3.0, 20.0)) + swinging(0.3 * largest_m, (3.0, 5.0))
        shifts.append(drift + swinging(pulse_m, (0.8, 1.2)) + rng.normal(0.0, 5e-6, len(time_s)))
    return Trajectory(force_n, shifts[0], shifts[1], swinging(2.0, (2.0, 10.0)), name)


class Bench:
    """What a process keeps: the model, its readers, and the scanner of the session."""

    def __init__(self, plan: Plan) -> None:
        cv2.setNumThreads(1)
        self.plan = plan
        reader = load_force_reader(plan.model)
        self.reader, self.study = reader, reader.study
        scanner = self.study.oct
        self.scale = PixelScale.of(scanner)
        self.limits = MonitorLimits(
            bound_n=self.study.classes.bounds_n[-1], size=(scanner.rows, scanner.columns),
            scale_m=(self.scale.lateral_m, self.scale.depth_m), expects_opinion=True,
        )  # fmt: skip

    def unit(self, number: int) -> Outcome:
        """Run one unit."""
        eye_number, kind, session = self.plan.unit(number)
        outcome, start = Outcome(), perf_counter()
        if kind == SESSION and session >= self.plan.sessions:
            return outcome
        eye = draw_eye(eye_number, self.plan.seed)
        rng = np.random.default_rng((self.plan.seed, 2, number))
        if kind == SESSION:
            path = trajectory(*moving_forces(int(self.plan.seconds / FRAME_S), rng), self.study, rng)
            self.play(eye, path, rng, outcome, f"session {session}")
        else:
            for rate in self.plan.rates_n_s:
                before = np.zeros(int(rng.uniform(0.5, 1.0) / FRAME_S))
                rising = np.arange(0.0, PATH_N, rate * FRAME_S)
                forces = np.concatenate([before, rising + rng.random() * rate * FRAME_S])
                forces = np.minimum(forces, PATH_N)
                path = trajectory(forces, [f"{rate:g}"] * len(forces), self.study, rng)
                self.play(eye, path, rng, outcome, f"ramp {eye_number}", rate)
        outcome.took_s = perf_counter() - start
        return outcome

    def frames(self, eye: PhantomEye, path: Trajectory, rng: np.random.Generator) -> Iterator[Frame]:
        """Render the frames of a trajectory."""
        states = eye_sections(eye, self.study)
        scanner = sample_optics(self.study.phantom, self.study.oct, rng)
        surface_m = draw(self.study.phantom.surface_depth_m, rng)
        pooled = PooledGenerator((self.plan.seed, int(rng.integers(2**31))))
        for n, force_n in enumerate(path.force_n):
            optics = optics_at(scanner, path, n)
            pose = Pose(lateral_m=path.lateral_m[n], depth_m=surface_m + path.depth_m[n])
            section = pose.place(section_at(states, float(force_n)))
            yield render_bscan(section, self.study.oct, optics, pooled).frame

    def event(self, answer: Answer, at_s: float, number: int, frame: Frame, shown_back: int) -> FrameRead:
        """Return a frame's answer as an event."""
        rows, columns = frame.shape
        scale_m = (self.scale.lateral_m, self.scale.depth_m)
        return read_event(
            answer, at_s=at_s, frame_id=number, size=(rows, columns), scale_m=scale_m, shown_back=shown_back
        )

    def play(
        self,
        eye: PhantomEye,
        path: Trajectory,
        rng: np.random.Generator,
        outcome: Outcome,
        label: str,
        rate_n_s: float | None = None,
    ) -> None:
        """Play one trajectory through reader and decision; a ramp ends with its withdrawal."""
        known = told(eye, rng)
        live = LiveReader(self.reader, known, 1.0)
        state, asked_s, shown = MonitorState(), 0.0, ShownPictures(self.limits.shown_frames)
        decision: Decision | None = None
        pending: list[SecondOpinion] = []
        for n, frame in enumerate(self.frames(eye, path, rng)):
            shown_back = shown.back(frame)
            at_s = FRAME_S * (n + 1) + float(np.clip(rng.normal(0.0, JITTER_S), -4e-3, 4e-3))
            events: list[MonitorEvent] = []
            while pending and pending[0].at_s <= at_s:
                events.append(pending.pop(0))
            if rng.random() < LOSS:
                events.append(QueueLoss(at_s, 1))
            else:
                answer = live.read(frame, self.scale).answer
                events.append(self.event(answer, at_s, n, frame, shown_back))
                note(outcome, answer, path.force_n[n])
                if n % OPINION_EVERY == 0:
                    pending.append(self.opinion(frame, known, at_s + OPINION_AFTER_S, n))
                    outcome.opinions += 1
            if decision is not None and decision.code == 3 and at_s - asked_s >= RESET_AFTER_S:
                events.append(Reset(at_s))
                asked_s = at_s
            for event in events:
                before = decision
                state, decision = decide(state, event, self.limits)
                if decision.code == 3 and (before is None or before.code != 3):
                    asked_s = at_s
                    name = decision.cause.name if decision.cause else "?"
                    if rate_n_s is not None:
                        crossing_s = FRAME_S * (1 + float(np.argmax(path.force_n >= self.limits.bound_n)))
                        outcome.ramps.append((rate_n_s, float(path.force_n[n]), event.at_s - crossing_s, name))
                        return
                    outcome.wolves.append(
                        f"{label} ({eye.thickness_m * 1e6:.0f} um, {eye.youngs_modulus_pa / 1e6:.2f} MPa), "
                        f"{at_s:.2f} s, {1e3 * path.force_n[n]:.1f} mN true, during {path.name[n]}: "
                        f"{name}: {decision.message}"
                    )
            outcome.frames += 1
            outcome.ok += decision is not None and decision.code == 1
        if rate_n_s is not None:
            outcome.ramps.append((rate_n_s, float("nan"), float("nan"), "none"))

    def opinion(self, frame: Frame, known: Known, at_s: float, number: int) -> SecondOpinion:
        """Ask the library's fit."""
        return opinion_of(number, self.reader.read(frame, self.scale, known)).at(at_s)

    def compared(self, count: int) -> dict[str, list[float]]:
        """Return the errors of the live reader, N, on frames with pooled and with new random numbers."""
        errors: dict[str, list[float]] = {"pooled": [], "new": []}
        took_s = dict.fromkeys(errors, 0.0)
        eye = draw_eye(0, self.plan.seed)
        states = eye_sections(eye, self.study)
        known = told(eye, np.random.default_rng((self.plan.seed, 3)))
        live = LiveReader(self.reader, known, 1.0)
        for name, found in errors.items():
            rng = np.random.default_rng((self.plan.seed, 4))  # the same eyes, poses and optics for both
            pooled = PooledGenerator((self.plan.seed, 5))
            new = np.random.default_rng((self.plan.seed, 6))
            for _ in range(count):
                force_n = float(rng.uniform(0.0, HIGHEST_N))
                optics = sample_optics(self.study.phantom, self.study.oct, rng)
                pose = Pose(lateral_m=rng.uniform(-2e-4, 2e-4), depth_m=draw(self.study.phantom.surface_depth_m, rng))
                section = pose.place(section_at(states, force_n))
                start = perf_counter()
                frame = render_bscan(section, self.study.oct, optics, pooled if name == "pooled" else new).frame
                took_s[name] += perf_counter() - start
                answer = live.read(frame, self.scale).answer
                if answer.force_n is not None:
                    found.append(answer.force_n - force_n)
            print(f"  {name}: {1e3 * took_s[name] / count:.1f} ms a frame")
        return errors


def optics_at(scanner: BscanOptics, path: Trajectory, n: int) -> BscanOptics:
    """Return the optics of a frame: the light swings, and shadows move with the eye."""
    shadows = tuple(replace(shadow, centre_m=shadow.centre_m + path.lateral_m[n]) for shadow in scanner.shadows)
    return replace(scanner, snr_db=scanner.snr_db + path.snr_db[n], shadows=shadows)


def note(outcome: Outcome, answer: Answer, force_n: float) -> None:
    """Keep what a reading is off."""
    if answer.force_n is None or answer.interval_n is None:
        outcome.notes[answer.reason or "no force"] += 1
        return
    outcome.errors_n.append(answer.force_n - force_n)
    outcome.notes["true force outside the interval"] += not answer.interval_n[0] <= force_n <= answer.interval_n[1]


def prepare(plan: Plan) -> Callable[[int], Outcome]:
    """Return what runs a unit, in a process of its own."""
    return Bench(plan).unit


def print_ramps(ramps: list[tuple[float, float, float, str]]) -> None:
    """Print the table of the ramps."""
    print(f"\n{'mN/s':>6}{'ramps':>7}{'withdrawn at, mN (true)':>26}{'after crossing 30 mN, ms':>28}  causes")
    for rate in sorted({row[0] for row in ramps}):
        rows = [row for row in ramps if row[0] == rate]
        force_mn, delay_ms = 1e3 * np.array([row[1] for row in rows]), 1e3 * np.array([row[2] for row in rows])
        causes = ", ".join(f"{name} {count}" for name, count in Counter(row[3] for row in rows).most_common())
        spread = [
            f"{values.min():.1f} / {np.median(values):.1f} / {values.max():.1f}" for values in (force_mn, delay_ms)
        ]
        print(f"{1e3 * rate:6.0f}{len(rows):7}{spread[0]:>26}{spread[1]:>28}  {causes}")


def main() -> None:
    """Run the sessions and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("model", type=Path)
    parser.add_argument("--sessions", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--compared", type=int, default=100, help="frames, of each kind")
    parser.add_argument("--rates-mn-s", type=float, nargs="+", default=RATES_MN_S, help="of the ramps")
    given = parser.parse_args()
    for name in ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_"):  # workers keep their images: a sixth quicker
        os.environ.setdefault(name, "1000000000")
    rates_n_s = tuple(1e-3 * rate for rate in given.rates_mn_s)
    plan = Plan(given.model, given.sessions, given.seconds, given.seed, min(10, given.sessions), rates_n_s)
    print("Random numbers from a pool against new ones, the same frames:")
    for name, errors_n in Bench(plan).compared(given.compared).items():
        off = 1e3 * np.array(errors_n)
        print(f"  {name}: {len(off)} read, off by {off.mean():+.3f} ± {off.std() / np.sqrt(len(off)):.3f} mN, "
              f"spread {off.std():.3f} mN")  # fmt: skip
    total = Outcome()
    for number, outcome in work_units(partial(prepare, plan), plan.units, given.workers):
        eye, kind, session = plan.unit(number)
        off = 1e3 * np.array(outcome.errors_n or [np.nan])
        words = f"session {session}" if kind == SESSION else "ramps"
        print(
            f"eye {eye}, {words}: {outcome.frames} frames, {outcome.ok} OK, off by {off.mean():+.2f} ± {off.std():.2f} "
            f"mN, {len(outcome.wolves)} false withdrawals, {outcome.took_s:.0f} s",
            flush=True,
        )
        for wolf in outcome.wolves:
            print(f"  {wolf}", flush=True)
        if kind == SESSION:
            total.frames, total.ok = total.frames + outcome.frames, total.ok + outcome.ok
            total.opinions += outcome.opinions
            total.errors_n += outcome.errors_n
            total.wolves += outcome.wolves
            total.notes += outcome.notes
        total.ramps += outcome.ramps
    off = 1e3 * np.array(total.errors_n)
    print(
        f"\n{total.frames} frames, {total.ok / max(total.frames, 1):.2%} of them OK, {total.opinions} second opinions"
    )
    print(f"false withdrawals: {len(total.wolves)}")
    print(f"readings off by {off.mean():+.2f} ± {off.std():.2f} mN, at most {np.abs(off).max():.2f} mN")
    for name, count in total.notes.most_common():
        print(f"  {count} frames: {name}")
    print_ramps(total.ramps)


if __name__ == "__main__":
    main()
