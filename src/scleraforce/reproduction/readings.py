"""Readings beside the paper's own: walls at finite strain, by the paper's method and by the force reader."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.result import Calibration, calibration_as_json
from scleraforce.known.calibration_file import read_calibration, write_calibration
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import BentSections, PhantomEye, paper_eyes
from scleraforce.learning.dataset import open_dataset
from scleraforce.learning.train import train_classifier, train_reader
from scleraforce.library import Library
from scleraforce.library.build import cached_library
from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.processes import work_units
from scleraforce.reader import load_force_reader, load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.reproduction.run import Progress, Run
from scleraforce.study import Study, study_hash

CALIBRATED_EYES = 4  # of the five eyes, as in the paper (sec. 3.2, Table 2)
INTERVAL_EYES = 60  # at most: 20 of each kind of globe
CALIBRATION_FORCES_N = (10e-3, 20e-3, 30e-3)  # of the pushes before the trials, up to the bound of danger


def bent_trials(study: Study) -> tuple[tuple[PhantomEye, tuple[float, ...]], ...]:
    """Return the eyes of the paper's design with the forces of their calibration, then of their trials."""
    return tuple((eye, (*CALIBRATION_FORCES_N, *forces_n)) for eye, forces_n in paper_eyes(study))


def bent_recordings(run: Run) -> list[Path]:
    """Return the recordings of the eyes, in the order of the design."""
    return [run.bent_recordings / eye.id for eye, _ in bent_trials(run.study)]


def bend_eyes(run: Run, progress: Progress) -> None:
    """Compute and image the eyes, an eye a process; `progress` counts eyes."""
    run.bent_recordings.mkdir(parents=True)
    prepare = partial(partial, _bend_eye, run.study, run.bent_recordings)  # gives the function of an eye's number
    for _ in work_units(prepare, range(len(bent_trials(run.study))), run.workers):
        progress(1)


def _bend_eye(study: Study, folder: Path, number: int) -> None:
    eye, forces_n = bent_trials(study)[number]
    plan = plan_phantom(eye, forces_n, study, study.phantom.seed)
    write_phantom(folder / eye.id, plan, BentSections(eye, study), study)


def run_library(run: Run, progress: Progress | None = None) -> Library:
    """Return the bundled reader's library; if the run trains, the user's cached one (`progress` counts paths)."""
    if not run.train:
        return load_force_reader(run.reader).library
    return cached_library(run.study, workers=run.workers, progress=progress)


def calibrate_bent(run: Run, progress: Progress) -> None:
    """Calibrate for the force reader and as the paper does; `progress` counts the frames of both."""
    opened = [read_recording(path) for path in bent_recordings(run)]
    before = [replace(one, frames=one.frames[: len(CALIBRATION_FORCES_N)]) for one in opened]  # the trials
    by_reader = calibrate_for(run, before, progress, run_library(run))
    as_in_paper = calibrate_for(run, opened[:CALIBRATED_EYES], progress, None)
    run.bent_calibrations.mkdir(parents=True)
    for calibration, path in ((by_reader, run.bent_finite_strain), (as_in_paper, run.bent_linear)):
        write_calibration(calibration_as_json(calibration), path)


def calibrate_for(
    run: Run, recordings: Sequence[Recording], progress: Progress, library: Library | None
) -> Calibration:
    """Calibrate recordings under a run's study; without a library at linear mechanics."""
    finder, study = load_wall_finder(SHIPPED_WALL_FINDER), run.study
    return calibrate_recordings(recordings, study, study_hash(study), library, progress=progress, finder=finder)


def train_force_reader(run: Run, progress: Progress) -> None:
    """Train the reader; `progress` counts epochs, then the eyes of its intervals."""
    study = replace(run.study, reader=replace(run.study.reader, interval_eyes=interval_eyes(run.study)))
    train_reader(run_library(run), study, run.reader, progress=progress, measured=progress)


def interval_eyes(study: Study) -> int:
    """Return the number of eyes for the intervals of the run's reader, fewer than for general use."""
    return min(INTERVAL_EYES, study.reader.interval_eyes)


def train_bent_model(run: Run, progress: Progress) -> None:
    """Train the paper's network for the linear modulus of these eyes, on the slices of the data set."""
    modulus_pa = read_calibration(run.bent_linear).population_mean_pa
    train_classifier(open_dataset(run.dataset), run.bent_model, progress=progress, youngs_modulus_pa=modulus_pa)


def read_bent(run: Run, progress: Progress) -> tuple[Evaluation, Evaluation]:
    """Return the answers of the paper's method and of the reader to the same trials; `progress` counts frames."""
    paths, calibration = bent_recordings(run), read_calibration(run.bent_finite_strain)
    paper, reader = (
        evaluate_recordings(load_model(path), paths, calibration, progress) for path in (run.bent_model, run.reader)
    )
    return paper, reader
