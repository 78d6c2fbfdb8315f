"""Decisions of monitor sessions in virtual time: five eyes of each kind, two sessions
and two ramps each.

No socket and no clock: frames, jitter, losses and the delay of the second opinion are
drawn or fixed (`monitor.sessions`), so a session repeats itself exactly. This module
uses the parts of that benchmark.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from golden.answers import Answers, Record, plain
from monitor.declarations import declarations
from monitor.eyes import KINDS, SessionEye, draw_eye, largest_force_n
from monitor.needle_forces import (
    Trajectory,
    moving_forces,
    ramp_forces,
    trajectory,
)
from monitor.sessions import shown
from monitor.watch import Watch, Withdrawal, limits_of
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_force_reader

SEED = 20_261_128
EYES = 5  # of each kind
SESSIONS = 2
SESSION_FRAMES = 250  # 100 before the contact, the approach, and an action or two
BEFORE_FRAMES = 25  # of those before the contact that are shown
HIGHEST_N = 20e-3  # of the sessions: a withdrawal is false
RATES_N_S = (50e-3, 100e-3)  # of the ramps: a withdrawal is due
MESH_CORE = 4  # with these rings a second an eye; no answer is of accuracy
MESH_RINGS = 8
MONITORS = (
    "declared",
    "option",
)  # declarations: with globe and calibrated k, and E alone


def names() -> list[str]:
    """Return the names of the eyes."""
    return [f"{kind}-{number}" for kind in KINDS for number in range(EYES)]


def answers(name: str, _recordings: dict[str, Path], _folder: Path) -> Answers:
    """Return the decisions of the sessions and ramps of one eye, of each monitor."""
    kind, _, number = name.partition("-")
    cv2.setNumThreads(1)
    reader = load_force_reader(Path(KINDS[kind].model))
    drawn = draw_eye(kind, int(number), reader.study, SEED)
    mesh = replace(drawn.study.mesh, core=MESH_CORE, rings=MESH_RINGS)
    drawn = replace(drawn, study=replace(drawn.study, mesh=mesh))
    rng = np.random.default_rng((SEED, 3, int(number)))
    declared = declarations(drawn, reader, SEED, rng)
    found: Answers = {}
    for words, path, path_rng in _paths(drawn, int(number)):
        watches = {
            monitor: Watch(reader, declared[monitor], limits_of(reader))
            for monitor in MONITORS
        }
        played = _played(drawn, path, watches, path_rng)
        found |= {f"{name}/{words}/{monitor}": of for monitor, of in played.items()}
    return found


def _paths(
    drawn: SessionEye, number: int
) -> Iterator[tuple[str, Trajectory, np.random.Generator]]:
    """Yield the sessions and the ramps of an eye, each with the rest of its random
    numbers.
    """
    largest_n = largest_force_n(drawn)
    for session in range(SESSIONS):
        rng = np.random.default_rng((SEED, 4, number, session))
        forces = moving_forces(SESSION_FRAMES, min(HIGHEST_N, largest_n), rng)
        path = trajectory(*_shortened(*forces), drawn.study, rng)
        yield f"session {session}", path, rng
    for ramp, rate_n_s in enumerate(RATES_N_S):
        rng = np.random.default_rng((SEED, 5, number, ramp))
        forces = ramp_forces(rate_n_s, largest_n, rng)
        path = trajectory(*_shortened(*forces), drawn.study, rng)
        yield f"ramp of {1e3 * rate_n_s:g} mN a second", path, rng


def _shortened(
    force_n: NDArray[np.float64], names: list[str]
) -> tuple[NDArray[np.float64], list[str]]:
    """Return forces and names without most of the frames before the contact."""
    first = max(0, int(np.argmax(force_n > 0.0)) - BEFORE_FRAMES)
    return force_n[first:], names[first:]


def _played(
    drawn: SessionEye,
    path: Trajectory,
    watches: Mapping[str, Watch],
    rng: np.random.Generator,
) -> dict[str, Record]:
    """Show a trajectory's frames to monitors; return what each of them decided."""
    courses = {monitor: _Course() for monitor in watches}
    for number, monitor, answer, withdrawal in shown(drawn, path, watches, rng, SEED):
        true_n = float(path.force_n[number])
        courses[monitor].add(watches[monitor].code, answer, withdrawal, true_n)
    return {
        monitor: courses[monitor].record(watch.decisions.released)
        for monitor, watch in watches.items()
    }


class _Course:
    """The course of one session before one monitor, a frame at a time."""

    def __init__(self) -> None:
        self._codes: list[int | None] = []
        self._forces_mn: list[float] = []
        self._classes: list[int] = []
        self._withdrawals: list[str] = []
        self._withdrawn_mn: list[float] = []
        self._withdrawn_s: list[float] = []

    def add(
        self,
        code: int | None,
        answer: Answer | None,
        withdrawal: Withdrawal | None,
        true_n: float,
    ) -> None:
        self._codes.append(code)
        self._classes.append(-1 if answer is None else answer.predicted)
        if answer is not None and answer.force_n is not None:
            self._forces_mn.append(1e3 * answer.force_n)
        if withdrawal is not None:
            self._withdrawals.append(f"{withdrawal.cause}: {withdrawal.message}")
            self._withdrawn_mn.append(1e3 * true_n)
            self._withdrawn_s.append(withdrawal.at_s)

    def record(self, released: int) -> Record:
        """Return the codes as runs ("13x24" is 24 frames of code 13), the withdrawals,
        and a digest of the readings.
        """
        runs = [(code, len(list(run))) for code, run in groupby(self._codes)]
        forces = self._forces_mn
        record = {
            "frames": len(self._codes),
            "codes": " ".join(f"{code}x{length}" for code, length in runs),
            "classes": crc32(bytes(number + 1 for number in self._classes)),
            "withdrawals": self._withdrawals,
            "withdrawn_mn": self._withdrawn_mn,
            "withdrawn_s": self._withdrawn_s,
            "readings": len(forces),
            "reading_mn": forces[:: max(1, len(forces) // 8)][:9],
            "released": released,
        }
        return {name: plain(value) for name, value in record.items()}
