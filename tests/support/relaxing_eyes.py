"""Force logs of virtual pushes on tissue that relaxes, without pictures; answers as a
reader of dents gives them.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from scleraforce.calibration.holds_of_a_log import HoldLog
from scleraforce.calibration.relaxation_from_holds import hold_log, with_elastic_forces
from scleraforce.lab.needle_pushes import (
    ForceSensor,
    NeedlePath,
    Push,
    path_of_pushes,
    plan_pushes,
    sample_sensor,
    sense,
)
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.reading.answer import Answer
from scleraforce.recordings.force_errors import ZERO_PRIOR, FrameForces
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS, ForceLog
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.study import PhantomStudy
from scleraforce.records.tissue_relaxation import Relaxation

BOUNDS_N = (5e-3, 30e-3)
TISSUE = PronySeries((0.12, 0.15), (1.2, 12.0))
FORCES_N = (0.026, 0.003, 0.048, 0.014, 0.034, 0.008, 0.040, 0.020)


def pushed(
    tissue: PronySeries, rng: np.random.Generator, forces_n=FORCES_N
) -> tuple[tuple[Push, ...], NeedlePath]:
    """Pushes, each with a frame, and the path of their needle."""
    pushes = plan_pushes(forces_n, PhantomStudy(), rng)
    return pushes, path_of_pushes(pushes, tissue)


class HeldPushes(NamedTuple):
    """Pushes with a frame in each, their log, how the tissue relaxes by it, and the
    elastic forces of the frames, N.
    """

    pushes: tuple[Push, ...]
    path: NeedlePath
    frame_s: np.ndarray
    log: HoldLog
    relaxation: Relaxation
    elastic_n: np.ndarray


def sensed(path: NeedlePath, sensor: ForceSensor, rng: np.random.Generator) -> ForceLog:
    """The log of a path until 1.5 s after its end: fz, pushes negative."""
    table = sense(path, sensor, 2, -1, path.times_s[-1] + 1.5, rng)
    return ForceLog(table[:, 0], table[:, 1:], FORCE_COLUMNS[1:])


def logged(path: NeedlePath, rng: np.random.Generator) -> Any:
    """The parts of a recording that `with_elastic_forces` needs."""
    phantom = PhantomStudy(force_drift_n_per_s=PhantomStudy().needle_lean_rad)
    log = sensed(path, sample_sensor(phantom, rng), rng)
    info = SimpleNamespace(force=ForceInfo("fz", -1, 2.0))
    return SimpleNamespace(forces=log, info=info)


@cache
def found_in(
    tissue: PronySeries, seed: int, known: Relaxation | None = None
) -> HeldPushes:
    """What the log of some pushes shows."""
    rng = np.random.default_rng(seed)
    return shown_by(*pushed(tissue, rng), rng, known)


def shown_by(
    pushes: tuple[Push, ...],
    path: NeedlePath,
    rng: np.random.Generator,
    known: Relaxation | None = None,
) -> HeldPushes:
    """What the log of a path shows, with true labels of a frame in each push."""
    frame_s = np.array([push.frame_s for push in pushes])
    recording = logged(path, rng)
    forces = FrameForces(path.felt_n(frame_s), frame_s, np.zeros(2), ZERO_PRIOR)
    elastic, relaxation, _ = with_elastic_forces(recording, forces, known)
    log = hold_log(recording, forces)
    return HeldPushes(pushes, path, frame_s, log, relaxation, elastic.force_n)


def read_as(elastic_n: float, sd_n: float = 0.2e-3) -> Answer:
    """A reader's answer to the dent of an elastic force."""
    interval_n = max(elastic_n - 1.645 * sd_n, 0.0), elastic_n + 1.645 * sd_n
    return Answer(
        predicted=1,
        probabilities=(0.0, 1.0, 0.0),
        usable=True,
        reason=None,
        force_n=elastic_n,
        interval_n=interval_n,
        contact_m=0.0,
    )
