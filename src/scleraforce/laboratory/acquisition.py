"""Virtual acquisitions of many eyes: drawn from a study, made by workers, each recording whole or not at all."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import KW_ONLY, dataclass
from functools import partial
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from scleraforce.errors import InputError, RecordingError
from scleraforce.laboratory.phantom import PhantomPlan, phantom_truth, plan_moving_phantom, plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye, study_sections
from scleraforce.processes import available_cores, work_units
from scleraforce.study import Study, draw
from scleraforce.whole_files import KINDS, folder_files, read_text, write_whole_folder


@dataclass(frozen=True)
class Acquisition:
    """Forces and timing: `forces_n`, held or, at `rate_hz`, turning points of a moving needle."""

    forces_n: tuple[float, ...]
    study: Study
    seed: int
    _: KW_ONLY
    rate_hz: float | None = None
    ramp_n_per_s: float = 20e-3
    hold_s: float = 1.0

    def plan(self, eye: PhantomEye) -> PhantomPlan:
        """Draw the acquisition of an eye; the eye's name and the seed decide."""
        if self.rate_hz is None:
            return plan_phantom(eye, self.forces_n, self.study, self.seed)
        moves = {"rate_hz": self.rate_hz, "ramp_n_per_s": self.ramp_n_per_s, "hold_s": self.hold_s}
        return plan_moving_phantom(eye, self.forces_n, self.study, self.seed, **moves)


def sample_eyes(study: Study, count: int, seed: int, name: str, given: Mapping[str, float]) -> tuple[PhantomEye, ...]:
    """Draw eyes of a study, named NAME-1, NAME-2 ...; a larger count leaves the first ones unchanged.

    Thickness, polar angle, gap, direction and tilt are sampled from the study, the azimuth from all around the pole;
    modulus and pressure are the study's. `given` has values that all eyes share, by the fields of `PhantomEye`.
    """
    return tuple(_draw_eye(study, seed, f"{name}-{number}", number, given) for number in range(1, count + 1))


def _draw_eye(study: Study, seed: int, name: str, number: int, given: Mapping[str, float]) -> PhantomEye:
    rng, dataset = np.random.default_rng((seed, number)), study.dataset
    drawn = {
        "thickness_m": draw(study.eye.thickness_m, rng),
        "polar_rad": draw(study.needle.polar_angle_rad, rng),
        "azimuth_rad": float(rng.uniform(-pi, pi)),
        "direction_rad": draw(dataset.direction_rad, rng),
        "tilt_rad": draw(dataset.tilt_rad, rng),
        "gap_m": study.needle.gap_m if dataset.gap_m is None else draw(dataset.gap_m, rng),
        "youngs_modulus_pa": study.eye.youngs_modulus_pa,
        "iop_pa": study.eye.iop_pa,
    }
    return PhantomEye(id=name, **(drawn | dict(given)))


def acquire_all(
    out: Path,
    eyes: Sequence[PhantomEye],
    acquisition: Acquisition,
    *,
    workers: int | None = None,
    progress: Callable[[int], object] | None = None,
) -> int:
    """Write a recording of each eye into a folder, unless an interrupted run has; return the number written.

    The bytes are the same for any number of workers, on the same kind of processor; processes are spawned.
    """
    plans = [acquisition.plan(eye) for eye in eyes]
    todo = []
    for number, plan in enumerate(plans):
        recording = out / plan.eye.id
        if not recording.exists():
            todo.append(number)
        elif not is_recorded(recording, plan, acquisition.study):
            raise RecordingError(
                f"{recording}: not the recording of this eye and seed; remove it or choose another folder"
            )
    report = progress or (lambda _: None)
    report(len(eyes) - len(todo))
    with closing(work_units(partial(_acquiring, tuple(eyes), acquisition), todo, workers or available_cores())) as made:
        for number, files in made:
            write_whole_folder(files, out / eyes[number].id)
            report(1)
    return len(todo)


def is_recorded(recording: Path, plan: PhantomPlan, study: Study) -> bool:
    """Return whether a folder has the truth of this plan, with which `write_phantom`'s folders appear."""
    planned = json.loads(json.dumps(phantom_truth(plan, study, [0.0] * len(plan.frames))))
    try:
        truth = json.loads(read_text(recording / "truth.json", KINDS["truth"]))
        return _drawn(truth) == _drawn(planned)
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        return False


def _drawn(truth: dict[str, Any]) -> dict[str, Any]:
    """Return the drawn part of a truth, without the computed pressures."""
    frames = [{key: value for key, value in frame.items() if key != "pressure_pa"} for frame in truth["frames"]]
    return {**truth, "frames": frames}


def _acquiring(eyes: Sequence[PhantomEye], acquisition: Acquisition) -> Callable[[int], dict[str, bytes]]:
    """Return the worker's function from an eye's number to the files of its recording."""

    def work(number: int) -> dict[str, bytes]:
        eye, study = eyes[number], acquisition.study
        with TemporaryDirectory(prefix="scleraforce-") as folder:
            recording = Path(folder) / eye.id
            write_phantom(recording, acquisition.plan(eye), study_sections(eye, study), study)
            return folder_files(recording)

    return work
