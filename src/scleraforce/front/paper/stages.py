"""The stages of `reproduce`: the paper's method on linear walls, then beside the force
reader on finite strain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path

from scleraforce.base.worker_processes import work_units
from scleraforce.calibration.calibrate import calibrate_recordings, calibration_passes
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.calibration.evaluation import Evaluation, evaluate_recordings
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.front.paper import run_folder
from scleraforce.front.paper.paper_page import SECTIONS, write_reproduction_html
from scleraforce.front.paper.run_folder import (
    CALIBRATED_EYES,
    CALIBRATION_FORCES_N,
    Progress,
    Run,
    Stage,
    bent_trials,
)
from scleraforce.lab.training.slice_dataset import generate_dataset, open_dataset
from scleraforce.lab.training.trained_models import train_classifier, train_reader
from scleraforce.lab.virtual_eye import (
    BentSections,
    LinearSections,
    eye_name,
    paper_eyes,
)
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.library import Library
from scleraforce.library.library_plan import plan_library
from scleraforce.reading.load_model import load_reader, load_wall_finder
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import (
    open_calibration,
    read_calibration,
    write_calibration,
)
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.study import Study, study_hash

# for the intervals of the run's reader, at most: 20 of each kind of globe
INTERVAL_EYES = 60
# of each network: two are trained at the same time, and two threads of one take nearly
# as long as one
TRAINING_THREADS = 1


@dataclass(frozen=True)
class Reproduction:
    """Results: moduli, answers to linear eyes, `to_the_bounds`, at finite strain by
    both methods; seconds.
    """

    calibration: Calibration
    evaluation: Evaluation
    to_the_bounds: Evaluation
    bent_paper: Evaluation
    bent_reader: Evaluation
    seconds: dict[str, float]


def reproduce(
    run: Run,
    announce: run_folder.Announce,
    started_at: datetime,
    tell: Callable[[str], object] = lambda _: None,
    note: Callable[[str], object] = lambda _: None,
) -> Reproduction:
    """Do the unfinished stages of the pipeline, and write the page with the date
    `started_at`; see `run_stages`.

    Walls of finite strain are bent and calibrated while linear ones are simulated, and
    both networks are trained at the same time.
    """
    answers: list[Evaluation] = []

    def evaluate(run: Run, progress: Progress) -> None:
        model = load_reader(run.model)
        folders = (run.recordings, run.recordings_to_the_bounds)
        answers.extend(
            evaluate_recordings(model, _of_eyes(run, each), progress=progress)
            for each in folders
        )

    def evaluate_bent(run: Run, progress: Progress) -> None:
        calibration = read_calibration(run.bent_finite_strain)
        trials = _of_eyes(run, run.bent_recordings)
        models = map(load_reader, (run.bent_model, run.reader))
        answers.extend(
            evaluate_recordings(model, trials, calibration, progress)
            for model in models
        )

    def report(run: Run, progress: Progress) -> None:
        write_reproduction_html(
            run, answers, run_folder.seconds_so_far(run), started_at, progress
        )

    epochs = run.study.network.epochs
    study = run.study
    library = Stage(
        "library",
        lambda _: plan_library(study).units,
        run_folder.run_library,
        beside=True,
    )
    reader_steps = study.reader.epochs + _interval_eyes(study)
    reader = Stage(
        "train reader", lambda _: reader_steps, _train_reader, lambda run: run.reader
    )
    bent_answers = 2 * sum(len(forces_n) for _, forces_n in bent_trials(study))
    stages = (
        Stage("phantom", _trials, _write_eyes, lambda run: run.recordings),
        Stage(
            "phantom to the bounds",
            _trials,
            partial(_write_eyes, to_the_bounds=True),
            lambda run: run.recordings_to_the_bounds,
        ),
        Stage(
            "calibrate",
            lambda run: _trials(run, CALIBRATED_EYES),
            _calibrate,
            lambda run: run.calibration,
        ),
        Stage(
            "generate",
            lambda _: sum(group.images for group in study.dataset.group),
            _generate,
            lambda run: run.dataset,
            resumes=True,
        ),
        Stage("train", lambda _: epochs, _train, lambda run: run.model),
        Stage("evaluate", lambda run: 2 * _trials(run), evaluate),
        Stage(
            "bend",
            lambda _: len(bent_trials(study)),
            _bend_eyes,
            lambda run: run.bent_recordings,
            beside=True,
        ),
        *([library] if run.train else []),
        Stage(
            "calibrate bent",
            _bent_frames,
            _calibrate_bent,
            lambda run: run.bent_calibrations,
            by_reader=True,
            beside=True,
        ),
        Stage(
            "train bent",
            lambda _: epochs,
            _train_bent,
            lambda run: run.bent_model,
            beside=True,
            after="generate",
        ),
        *([reader] if run.train else []),
        Stage("read bent", lambda _: bent_answers, evaluate_bent),
        Stage("report", lambda _: SECTIONS, report),
    )
    seconds = run_folder.run_stages(run, stages, announce, tell, note)
    evaluation, to_the_bounds, bent_paper, bent_reader = answers
    calibration = parse_calibration(open_calibration(run.calibration))

    return Reproduction(
        calibration, evaluation, to_the_bounds, bent_paper, bent_reader, seconds
    )


def _of_eyes(run: Run, folder: Path) -> list[Path]:
    """Return the recordings of the eyes in a folder, in the order of the design."""
    return [folder / eye_name(setup) for setup, _ in paper_eyes(run.study)]


def _trials(run: Run, eyes: int | None = None) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study)[:eyes])


def _bent_frames(run: Run) -> int:
    counts = [len(forces_n) for _, forces_n in bent_trials(run.study)]
    passes = calibration_passes(run_folder.run_library(run), None)
    return passes * len(counts) * len(CALIBRATION_FORCES_N) + sum(
        counts[:CALIBRATED_EYES]
    )


def _interval_eyes(study: Study) -> int:
    return min(INTERVAL_EYES, study.reader.interval_eyes)


def _write_eyes(run: Run, progress: Progress, *, to_the_bounds: bool = False) -> None:
    study = run.study
    folder = run.recordings_to_the_bounds if to_the_bounds else run.recordings
    folder.mkdir()

    for setup, forces_n in paper_eyes(study, to_the_bounds=to_the_bounds):
        plan = plan_phantom(setup, forces_n, study, study.phantom.seed + to_the_bounds)
        write_phantom(
            folder / eye_name(setup),
            plan,
            LinearSections(setup, study),
            study,
            progress,
        )


def _calibrate(run: Run, progress: Progress) -> None:
    opened = [
        read_recording(path) for path in _of_eyes(run, run.recordings)[:CALIBRATED_EYES]
    ]
    _write_calibration(run, opened, progress, None, run.calibration)


def _write_calibration(
    run: Run,
    recordings: Sequence[Recording],
    progress: Progress,
    library: Library | None,
    out: Path,
) -> None:
    """Calibrate recordings under a run's study; without a library at linear
    mechanics.
    """
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    study = run.study
    found = calibrate_recordings(
        recordings,
        study,
        study_hash(study),
        library,
        progress=progress,
        walls=FoundWalls(finder),
    )
    write_calibration(found.to_dict(), out)


def _generate(run: Run, progress: Progress) -> None:
    modulus = read_calibration(run.calibration)
    generate_dataset(
        run.study,
        run.dataset,
        calibration=modulus,
        workers=run.workers,
        progress=progress,
    )


def _train(run: Run, progress: Progress) -> None:
    train_classifier(
        open_dataset(run.dataset),
        run.model,
        progress=progress,
        threads=TRAINING_THREADS,
    )


def _bend_eyes(run: Run, progress: Progress) -> None:
    """Compute and image the eyes, an eye a process; `progress` counts eyes."""
    run.bent_recordings.mkdir(parents=True)
    # gives the function of an eye's number
    prepare = partial(partial, _bend_eye, run.study, run.bent_recordings)
    for _ in work_units(prepare, range(len(bent_trials(run.study))), run.workers):
        progress(1)


def _bend_eye(study: Study, folder: Path, number: int) -> None:
    setup, forces_n = bent_trials(study)[number]
    plan = plan_phantom(setup, forces_n, study, study.phantom.seed)
    write_phantom(folder / eye_name(setup), plan, BentSections(setup, study), study)


def _calibrate_bent(run: Run, progress: Progress) -> None:
    """Calibrate for the force reader, on the pushes before the trials, and as the paper
    does.
    """
    opened = [read_recording(path) for path in _of_eyes(run, run.bent_recordings)]
    before = [
        replace(one, frames=one.frames[: len(CALIBRATION_FORCES_N)]) for one in opened
    ]
    run.bent_calibrations.mkdir(parents=True)
    _write_calibration(
        run, before, progress, run_folder.run_library(run), run.bent_finite_strain
    )
    _write_calibration(run, opened[:CALIBRATED_EYES], progress, None, run.bent_linear)


def _train_reader(run: Run, progress: Progress) -> None:
    """Train the reader, with fewer eyes for its intervals than for general use."""
    study = replace(
        run.study,
        reader=replace(run.study.reader, interval_eyes=_interval_eyes(run.study)),
    )
    train_reader(
        run_folder.run_library(run),
        study,
        run.reader,
        progress=progress,
        measured=progress,
    )


def _train_bent(run: Run, progress: Progress) -> None:
    """Train the paper's network for the linear modulus of these eyes, on the slices of
    the data set.
    """
    modulus_pa = read_calibration(run.bent_linear).population_mean_pa
    train_classifier(
        open_dataset(run.dataset),
        run.bent_model,
        progress=progress,
        youngs_modulus_pa=modulus_pa,
        threads=TRAINING_THREADS,
    )
