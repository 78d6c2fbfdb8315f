"""Whole sessions of virtual eyes before the monitor, without sockets: false
withdrawals, and the force at which ramps are stopped.

Eyes are bent in 3-D at finite strain, like the eyes of `make figures`. Every frame is a
raw B-scan (`render_bscan`) that goes through the live reader (segmentation, slice,
network) and `decide`; every third one goes to the library's fit as well, whose answer
comes 25 ms later as a second opinion. One second after a withdrawal the operator asks
for a reset, again and again until it is granted.

- Sessions: after an approach to the upper half of the forces they hold, swing, rise
  slowly, step as a robot does, lift off and come back; the eye shifts (drift,
  breathing, pulse), the signal swings, the scanner's clock jitters, one frame in 1000
  is lost.
- Ramps: from 0 at several rates, until the withdrawal. A sealed eye whose wall gives
  way before 33 mN has none.

The same frames go to monitors with different known inputs (`declarations`): the globe,
with E and k calibrated on three frames; the same calibration without the globe; E
alone. Declared values have the errors of calipers and gauges: 10 um of the wall, 20 um
of the gap, 3 % of the IOP.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from markdown_tables import markdown
from monitor.declarations import DECLARATIONS, declarations
from monitor.eyes import KINDS, SessionEye, draw_eye, largest_force_n
from monitor.needle_forces import (
    FRAME_S,
    Trajectory,
    moving_forces,
    ramp_forces,
    trajectory,
)
from monitor.pictures import stream
from monitor.watch import Watch, Withdrawal, limits_of
from provenance.stamps import new_stamp
from scleraforce.base.units import from_si, to_si
from scleraforce.base.worker_processes import work_units
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.repeated_pictures import ShownPictures
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_force_reader

JITTER_S = 1e-3
LOSS = 1e-3  # of the frames
TOUCHING_N = 1e-3
ENOUGH = 1.1  # times the bound: an eye that gives way below has no ramps
BOUND_N = MonitorLimits().bound_n
REFERENCE = "declared"


@dataclass(frozen=True)
class Ramp:
    """A ramp of a rate, N/s: the true force at its withdrawal, N, how long before 30 mN
    that was, s, and the cause; no force (None) if the monitor never withdrew.
    """

    eye: int
    rate_n_s: float
    force_n: float | None = None
    early_s: float = 0.0
    cause: str = "never"


@dataclass
class Outcome:
    """What a monitor did.

    Attributes:
        frames: of the sessions.
        errors_n: of all frames with a reading.
        holds: of frames of `TOUCHING_N` or more: whether the 90 % interval has the true
            force (without contact that is exactly 0, the edge of all answers).
        withdrawn_n: true forces at the withdrawals from sessions: all are false.
        causes: of these withdrawals.
        ramps: one by one.
    """

    frames: int = 0
    errors_n: list[float] = field(default_factory=list)
    holds: list[bool] = field(default_factory=list)
    withdrawn_n: list[float] = field(default_factory=list)
    causes: list[str] = field(default_factory=list)
    ramps: list[Ramp] = field(default_factory=list)

    def add(self, other: "Outcome") -> None:
        """Add what it did on another eye."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def note(
        self, answer: Answer | None, withdrawal: Withdrawal | None, force_n: float
    ) -> None:
        """Take a frame of a session."""
        self.frames += 1
        if withdrawal is not None:
            self.withdrawn_n.append(force_n)
            self.causes.append(withdrawal.cause)

        if answer and answer.force_n is not None and answer.interval_n is not None:
            self.errors_n.append(answer.force_n - force_n)
            low_n, high_n = answer.interval_n
            if force_n >= TOUCHING_N:
                self.holds.append(low_n <= force_n <= high_n)


Outcomes = Mapping[str, Outcome]  # by declaration


def sessions(
    *,
    model: Path | None = None,
    kinds: tuple[str, ...] = tuple(KINDS),
    eyes: int = 10,
    sessions: int = 1,
    seconds: float = 60.0,
    highest_mn: float = 20.0,
    rates_mn_s: tuple[float, ...] = (5.0, 10.0, 20.0, 50.0, 100.0),
    seed: int = 0,
    workers: int = 1,
) -> None:
    """False withdrawals of whole sessions, and the forces at which ramps are stopped.

    Args:
        model: of kind "reader", for all of them; None: the shipped one of each kind.
        kinds: of eyes.
        eyes: of each kind.
        sessions: of each eye.
        seconds: of a session.
        highest_mn: force of the sessions.
        rates_mn_s: of the ramps.
        seed: of eyes and sessions.
        workers: processes.
    """
    # workers keep their images: a sixth quicker
    for name in ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_"):
        os.environ.setdefault(name, "1000000000")

    units = [
        (model or Path(KINDS[kind].model), kind, eye)
        for kind in kinds
        for eye in range(eyes)
    ]
    play = partial(
        _played,
        sessions=sessions,
        seconds=seconds,
        highest_n=to_si(highest_mn, "mn"),
        rates_n_s=tuple(to_si(rate, "mn") for rate in rates_mn_s),
        seed=seed,
    )
    found: dict[str, dict[str, Outcome]] = {kind: {} for kind in kinds}
    for number, outcomes in work_units(
        partial(_prepare, play, units), range(len(units)), workers
    ):
        _, kind, eye = units[number]
        print(f"{kind} {eye} is done", flush=True)
        for name, outcome in outcomes.items():
            found[kind].setdefault(name, Outcome()).add(outcome)

    print(f"\n{new_stamp('python -m monitor sessions')}")
    print(f"\n{ramp_table(found)}\n\n{session_table(found)}")


def _prepare(
    play: Callable[[Path, str, int], Outcomes], units: list[tuple[Path, str, int]]
) -> Callable[[int], Outcomes]:
    """Return what plays an eye, in a process of its own."""
    cv2.setNumThreads(1)
    return lambda number: play(*units[number])


def _played(
    model: Path,
    kind: str,
    eye: int,
    *,
    sessions: int,
    seconds: float,
    highest_n: float,
    rates_n_s: tuple[float, ...],
    seed: int,
) -> Outcomes:
    """Play the sessions and the ramps of an eye before a monitor of each
    declaration.
    """
    reader = load_force_reader(model)
    limits = limits_of(reader)
    drawn = draw_eye(kind, eye, reader.study, seed)
    largest_n = largest_force_n(drawn)
    rng = np.random.default_rng((seed, 3, eye))
    known = declarations(drawn, reader, seed, rng)
    outcomes = {name: Outcome() for name in known}

    def watches() -> dict[str, Watch]:
        return {name: Watch(reader, setup, limits) for name, setup in known.items()}

    for session in range(sessions):
        rng = np.random.default_rng((seed, 2, eye, session + 1))
        frames = int(seconds / FRAME_S)
        forces = moving_forces(frames, min(highest_n, largest_n), rng)
        path = trajectory(*forces, drawn.study, rng)
        for n, name, answer, withdrawal in shown(drawn, path, watches(), rng, seed):
            outcomes[name].note(answer, withdrawal, float(path.force_n[n]))

    rng = np.random.default_rng((seed, 2, eye, 0))
    for rate_n_s in rates_n_s if largest_n > ENOUGH * limits.bound_n else ():
        path = trajectory(*ramp_forces(rate_n_s, largest_n, rng), drawn.study, rng)
        crossing_s = FRAME_S * (1 + float(np.argmax(path.force_n >= limits.bound_n)))
        left = watches()
        for n, name, _, withdrawal in shown(drawn, path, left, rng, seed):
            if withdrawal is not None:
                stopped_n = float(path.force_n[n])
                early_s = crossing_s - withdrawal.at_s
                ramp = Ramp(eye, rate_n_s, stopped_n, early_s, withdrawal.cause)
                outcomes[name].ramps.append(ramp)
                del left[name]

        for name in left:
            outcomes[name].ramps.append(Ramp(eye, rate_n_s))

    return outcomes


def shown(
    drawn: SessionEye,
    path: Trajectory,
    watches: Mapping[str, Watch],
    rng: np.random.Generator,
    seed: int,
) -> Iterator[tuple[int, str, Answer | None, Withdrawal | None]]:
    """Show the frames of a trajectory to all monitors that are left; yield what each
    does at each frame.
    """
    pictures = ShownPictures(MonitorLimits().shown_frames)
    for n, frame in enumerate(stream(drawn, path, rng, seed)):
        shown_back = pictures.back(frame)
        jitter_s = float(np.clip(rng.normal(0.0, JITTER_S), -4e-3, 4e-3))
        at_s = FRAME_S * (n + 1) + jitter_s
        is_lost = rng.random() < LOSS

        for name, watch in list(watches.items()):
            if is_lost:
                yield n, name, None, watch.lost(at_s)
            else:
                yield n, name, *watch.read(frame, at_s, n, shown_back)

        if not watches:
            return


def ramp_table(found: Mapping[str, Outcomes]) -> str:
    """Return, for each kind of eyes and declaration, the ramps stopped in time, their
    true forces, and how long before 30 mN that was.
    """
    rows = _rows(found)
    rates_n_s = sorted({ramp.rate_n_s for *_, of in rows for ramp in of.ramps})
    head = ["eyes", "globe", "stopped below 30 mN"]
    head += [f"at {from_si(rate_n_s, 'mn'):g} mN/s" for rate_n_s in rates_n_s]
    cells = [
        [
            KINDS[kind].words,
            DECLARATIONS[name],
            f"{sum((ramp.force_n or np.inf) < BOUND_N for ramp in outcome.ramps)} of"
            f" {len(outcome.ramps)}",
            *(_stopped(outcome.ramps, rate_n_s) for rate_n_s in rates_n_s),
            _earlier(outcome.ramps, found[kind][REFERENCE].ramps),
            _counted(ramp.cause for ramp in outcome.ramps),
        ]
        for kind, name, outcome in rows
    ]
    return markdown([*head, "earlier than declared, mN", "causes"], cells)


def session_table(found: Mapping[str, Outcomes]) -> str:
    """Return, for each kind of eyes and declaration, the withdrawals from harmless
    sessions.
    """
    head = ["eyes", "globe", "frames", "withdrawals", "at a true force of, mN"]
    cells = [
        [
            KINDS[kind].words,
            DECLARATIONS[name],
            outcome.frames,
            _counted(outcome.causes),
            _in_mn(outcome.withdrawn_n, min, median, max),
            _in_mn(outcome.errors_n, np.mean, np.std),
            f"{np.mean(outcome.holds):.1%}" if outcome.holds else "-",
        ]
        for kind, name, outcome in _rows(found)
    ]
    head += ["read off by, mN: mean, sd", "90 % intervals hold, from 1 mN on"]
    return markdown(head, cells)


def _rows(found: Mapping[str, Outcomes]) -> list[tuple[str, str, Outcome]]:
    return [
        (kind, name, outcome)
        for kind, outcomes in found.items()
        for name, outcome in outcomes.items()
    ]


def _counted(causes: Iterable[str]) -> str:
    counts = Counter(causes).most_common()
    return ", ".join(f"{count} {cause}" for cause, count in counts) or "none"


def _stopped(ramps: Sequence[Ramp], rate_n_s: float) -> str:
    """Return least, median and largest of the forces, mN, and the times before 30 mN,
    ms.
    """
    stopped = [ramp for ramp in ramps if ramp.rate_n_s == rate_n_s and ramp.force_n]
    forces_n = [ramp.force_n for ramp in stopped if ramp.force_n]
    early_ms = [round(1e3 * ramp.early_s) for ramp in stopped]
    forces = _in_mn(forces_n, min, median, max)
    return f"{forces}; {min(early_ms)} to {max(early_ms)} ms" if early_ms else "-"


def _earlier(ramps: Sequence[Ramp], declared: Sequence[Ramp]) -> str:
    """Return the median and largest difference in mN by which ramps were stopped
    earlier than with a declared globe.
    """
    same = {(ramp.eye, ramp.rate_n_s): ramp.force_n for ramp in declared}
    pairs = [(same.get((ramp.eye, ramp.rate_n_s)), ramp.force_n) for ramp in ramps]
    earlier_n = [a - b for a, b in pairs if a is not None and b is not None]
    return "" if ramps is declared else _in_mn(earlier_n, median, max)


def _in_mn(forces_n: Sequence[float], *of: Callable[[Sequence[float]], float]) -> str:
    if not forces_n:
        return "-"
    return " / ".join(f"{from_si(each(forces_n), 'mn'):.2f}" for each in of)
