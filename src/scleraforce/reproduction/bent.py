"""The paper's 45 trials on walls that bend as real ones do: the paper's method and the force reader, side by side.

The eyes are those of the paper's design once more, computed in three dimensions at finite strain, under the same
forces. Each is pushed three times before its trials, to find its modulus on; these frames do not count. The paper's
method is given all that the paper gave it: a linear calibration on every frame of four eyes, and a network for their
mean.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.result import Calibration, calibration_as_json
from scleraforce.dataset import open_dataset, read_population_modulus
from scleraforce.known.calibration_file import read_calibration, write_calibration
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye, finite_strain_sections, paper_eyes
from scleraforce.learning.classifier.train import train_classifier
from scleraforce.learning.reader.train import train_reader
from scleraforce.library import Library
from scleraforce.library.cache import cached_library
from scleraforce.models.folder import SHIPPED_WALL_FINDER
from scleraforce.processes import work_units
from scleraforce.reader import load_force_reader, load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.reproduction.run import Progress, Run
from scleraforce.study import Study, study_hash

CALIBRATED_EYES = 4  # of the five eyes, as in the paper (sec. 3.2, Table 2)
INTERVAL_EYES = 60  # at most: 20 of each kind of globe
CALIBRATION_FORCES_N = (10e-3, 20e-3, 30e-3)  # of the pushes before the trials: none above the bound of danger


def bent_trials(study: Study) -> tuple[tuple[PhantomEye, tuple[float, ...]], ...]:
    """Return the eyes of the paper's design with the forces of their calibration and, after those, of their trials."""
    return tuple((eye, (*CALIBRATION_FORCES_N, *forces_n)) for eye, forces_n in paper_eyes(study))


def bent_recordings(run: Run) -> list[Path]:
    """Return the recordings of the eyes, in the order of the design."""
    return [run.bent.recordings / eye.id for eye, _ in bent_trials(run.study)]


def bend_eyes(run: Run, progress: Progress) -> None:
    """Compute and image the eyes, an eye a process; `progress` counts eyes."""
    run.bent.recordings.mkdir(parents=True)
    prepare = partial(_prepared, run.study, run.bent.recordings)
    for _ in work_units(prepare, range(len(bent_trials(run.study))), run.workers):
        progress(1)


def _prepared(study: Study, folder: Path) -> Callable[[int], None]:
    return partial(_bend_eye, study, folder)


def _bend_eye(study: Study, folder: Path, number: int) -> None:
    eye, forces_n = bent_trials(study)[number]
    plan = plan_phantom(eye, forces_n, study, study.phantom.seed)
    write_phantom(folder / eye.id, plan, finite_strain_sections(eye, study), study)


def run_library(run: Run, progress: Progress | None = None) -> Library:
    """Return the bundled reader's library, or that of a run that trains.

    The latter comes from the user's cache, or is made and stored there: `progress` counts paths.
    """
    if not run.train:
        return load_force_reader(run.reader).library
    return cached_library(run.study, workers=run.workers, progress=progress)


def calibrate_bent(run: Run, progress: Progress) -> None:
    """Calibrate both ways; `progress` counts the frames of both."""
    opened = [read_recording(path) for path in bent_recordings(run)]
    before = [replace(one, frames=one.frames[: len(CALIBRATION_FORCES_N)]) for one in opened]  # the trials
    by_reader = _calibrated(run, before, progress, run_library(run))
    as_in_paper = _calibrated(run, opened[:CALIBRATED_EYES], progress, None)
    run.bent.calibrations.mkdir(parents=True)
    for calibration, path in ((by_reader, run.bent.finite_strain), (as_in_paper, run.bent.linear)):
        write_calibration(calibration_as_json(calibration), path)


def _calibrated(run: Run, recordings: Sequence[Recording], progress: Progress, library: Library | None) -> Calibration:
    finder, study = load_wall_finder(SHIPPED_WALL_FINDER), run.study
    return calibrate_recordings(recordings, study, study_hash(study), library, progress=progress, finder=finder)


def train_force_reader(run: Run, progress: Progress) -> None:
    """Train the reader; `progress` counts epochs, then the eyes of its intervals."""
    study = replace(run.study, reader=replace(run.study.reader, interval_eyes=interval_eyes(run.study)))
    train_reader(run_library(run), study, run.reader, progress=progress, measured=progress)


def interval_eyes(study: Study) -> int:
    """Return on how many eyes the intervals of the run's reader are measured: fewer than of one to work with."""
    return min(INTERVAL_EYES, study.reader.interval_eyes)


def train_bent_model(run: Run, progress: Progress) -> None:
    """Train the paper's network for the linear modulus of these eyes, on the slices that are there (see `samples`)."""
    modulus_pa = read_population_modulus(run.bent.linear).youngs_modulus_pa
    train_classifier(open_dataset(run.dataset), run.bent.model, progress=progress, youngs_modulus_pa=modulus_pa)


def read_bent(run: Run, progress: Progress) -> tuple[Evaluation, Evaluation]:
    """Return the answers of the paper's method and of the reader to the same trials; `progress` counts frames."""
    paths, calibration = bent_recordings(run), read_calibration(run.bent.finite_strain)
    paper, reader = (
        evaluate_recordings(load_model(path), paths, calibration, progress) for path in (run.bent.model, run.reader)
    )
    return paper, reader
