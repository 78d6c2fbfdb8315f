"""The units of the sessions: one eye's frames, once, before monitors with different
known inputs.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np

from monitor_sessions.declarations import declarations
from monitor_sessions.eyes import SessionEye, draw_eye
from monitor_sessions.forces import (
    FRAME_S,
    Trajectory,
    moving_forces,
    ramp_forces,
    trajectory,
)
from monitor_sessions.frames import largest_force_n, stream
from monitor_sessions.watch import Watch, Withdrawal
from scleraforce.base.units import from_si
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.repeated_pictures import ShownPictures
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_force_reader
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup

JITTER_S = 1e-3
LOSS = 1e-3  # of the frames
OK = 1
TOUCHING_N = 1e-3
ENOUGH = 1.1  # times the bound: an eye that gives way below has no ramps


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The runs of one reader: kinds of eyes, and for each eye a number of sessions and
    a ramp at each rate.

    `first` is the number of the first eye, to continue the draws of another run.
    """

    model: Path
    kinds: tuple[str, ...]
    eyes: int
    sessions: int
    seconds: float
    highest_n: float
    rates_n_s: tuple[float, ...]
    seed: int
    first: int = 0

    @property
    def units(self) -> tuple["Unit", ...]:
        """All units; the units of one eye are adjacent."""
        return tuple(
            Unit(kind, eye, session)
            for kind in self.kinds
            for eye in range(self.first, self.first + self.eyes)
            for session in (*range(self.sessions), None)
        )


@dataclass(frozen=True)
class Unit:
    """A session of an eye; None: its ramps."""

    kind: str
    eye: int
    session: int | None

    @property
    def words(self) -> str:
        """Its name."""
        return (
            f"{self.kind} {self.eye},"
            f" {'ramps' if self.session is None else f'session {self.session}'}"
        )


@dataclass(frozen=True)
class Ramp:
    """A ramp of a rate, N/s: the true force at its withdrawal, N, the time from 30 mN
    until then, s, and the cause.

    The monitor never withdrew if all three are missing (None).
    """

    eye: int
    rate_n_s: float
    force_n: float | None
    delay_s: float | None
    cause: str | None


@dataclass
class Outcome:
    """A monitor's results in a unit.

    `errors_n` has all frames with a reading. `touching` frames have `TOUCHING_N` or
    more, and `inside` counts the ones with the true force in their 90 % interval
    (without contact the force is exactly 0, the edge of all answers).
    """

    frames: int = 0
    ok: int = 0
    errors_n: list[float] = field(default_factory=list)
    touching: int = 0
    inside: int = 0
    withdrawn_n: list[float] = field(default_factory=list)
    withdrawals: list[str] = field(default_factory=list)
    ramps: list[Ramp] = field(default_factory=list)
    unread: Counter[str] = field(default_factory=Counter)

    def add(self, other: "Outcome") -> None:
        """Add what it did in another unit."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def note(self, answer: Answer, force_n: float) -> None:
        """Keep how far off a reading is."""
        if answer.force_n is None or answer.interval_n is None:
            self.unread[answer.reason or "no force"] += 1
            return

        self.errors_n.append(answer.force_n - force_n)
        if force_n >= TOUCHING_N:
            self.touching += 1
            self.inside += answer.interval_n[0] <= force_n <= answer.interval_n[1]


class Bench:
    """State of a process: the reader and the limits of its monitors."""

    def __init__(self, plan: Plan) -> None:
        cv2.setNumThreads(1)
        self.plan = plan
        self.reader = load_force_reader(plan.model)
        scanner = self.reader.study.oct
        scale = PixelScale.of(scanner)
        self.limits = MonitorLimits(
            bound_n=self.reader.study.classes.bounds_n[-1],
            size=(scanner.rows, scanner.columns),
            scale_m=(scale.lateral_m, scale.depth_m),
            expects_opinion=True,
        )
        self._last: tuple[SessionEye | None, dict[str, Setup]] = (None, {})

    def unit(self, number: int) -> tuple[dict[str, Outcome], float]:
        """Run one unit; return what every monitor did, and the seconds that it took."""
        unit = self.plan.units[number]
        start = perf_counter()
        drawn = draw_eye(unit.kind, unit.eye, self.reader.study, self.plan.seed)
        told = self._told(drawn, unit.eye)
        largest_n = largest_force_n(drawn)
        place = 0 if unit.session is None else unit.session + 1
        rng = np.random.default_rng((self.plan.seed, 2, unit.eye, place))
        outcomes = {name: Outcome() for name in told}

        if unit.session is None:
            for rate_n_s in (
                self.plan.rates_n_s if largest_n > ENOUGH * self.limits.bound_n else ()
            ):
                path = trajectory(
                    *ramp_forces(rate_n_s, largest_n, rng), drawn.study, rng
                )
                for name, ramp in self._ramp(
                    drawn, path, self._watches(told), rng, unit.eye, rate_n_s
                ).items():
                    outcomes[name].ramps.append(ramp)
        else:
            highest_n = min(self.plan.highest_n, largest_n)
            forces = moving_forces(int(self.plan.seconds / FRAME_S), highest_n, rng)
            path = trajectory(*forces, drawn.study, rng)
            self._session(drawn, path, self._watches(told), rng, outcomes)

        return outcomes, perf_counter() - start

    def _told(self, drawn: SessionEye, number: int) -> dict[str, Setup]:
        """Return the declarations of an eye; the last eye's are cached."""
        if self._last[0] != drawn:
            rng = np.random.default_rng((self.plan.seed, 3, number))
            self._last = (drawn, declarations(drawn, self.reader, self.plan.seed, rng))
        return self._last[1]

    def _watches(self, told: Mapping[str, Setup]) -> dict[str, Watch]:
        return {
            name: Watch(self.reader, known, self.limits) for name, known in told.items()
        }

    def _session(
        self,
        drawn: SessionEye,
        path: Trajectory,
        watches: dict[str, Watch],
        rng: np.random.Generator,
        outcomes: Mapping[str, Outcome],
    ) -> None:
        """Play a session: every withdrawal in it is false."""
        for n, name, answer, withdrawal in self._shown(drawn, path, watches, rng):
            outcome = outcomes[name]
            force_n = float(path.force_n[n])
            outcome.frames += 1
            outcome.ok += watches[name].code == OK

            if answer is not None:
                outcome.note(answer, force_n)

            if withdrawal is not None:
                outcome.withdrawn_n.append(force_n)
                outcome.withdrawals.append(
                    f"{name}, {withdrawal.at_s:.2f} s, {from_si(force_n, 'mn'):.1f} mN"
                    f" true, during {path.name[n]}: {withdrawal.cause}:"
                    f" {withdrawal.message}"
                )

    def _ramp(
        self,
        drawn: SessionEye,
        path: Trajectory,
        watches: dict[str, Watch],
        rng: np.random.Generator,
        eye: int,
        rate_n_s: float,
    ) -> dict[str, Ramp]:
        """Play a ramp, for each monitor until it withdraws."""
        crossing_s = FRAME_S * (
            1 + float(np.argmax(path.force_n >= self.limits.bound_n))
        )
        ramps = dict.fromkeys(watches, Ramp(eye, rate_n_s, None, None, None))

        for n, name, _, withdrawal in self._shown(drawn, path, watches, rng):
            if withdrawal is not None:
                delay_s = withdrawal.at_s - crossing_s
                ramps[name] = Ramp(
                    eye, rate_n_s, float(path.force_n[n]), delay_s, withdrawal.cause
                )
                del watches[name]

        return ramps

    def _shown(
        self,
        drawn: SessionEye,
        path: Trajectory,
        watches: Mapping[str, Watch],
        rng: np.random.Generator,
    ) -> Iterator[tuple[int, str, Answer | None, Withdrawal | None]]:
        """Show the frames of a trajectory to all monitors that are left; yield what
        each does at each frame.
        """
        shown = ShownPictures(self.limits.shown_frames)
        for n, frame in enumerate(stream(drawn, path, rng, self.plan.seed)):
            shown_back = shown.back(frame)
            at_s = FRAME_S * (n + 1) + float(
                np.clip(rng.normal(0.0, JITTER_S), -4e-3, 4e-3)
            )
            lost = rng.random() < LOSS

            for name, watch in list(watches.items()):
                heard = (
                    (None, watch.lost(at_s))
                    if lost
                    else watch.read(frame, at_s, n, shown_back)
                )
                yield n, name, *heard

            if not watches:
                return


def prepare(plan: Plan) -> Callable[[int], tuple[dict[str, Outcome], float]]:
    """Return what runs a unit, in a process of its own."""
    return Bench(plan).unit
