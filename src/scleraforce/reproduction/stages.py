"""The stages of `reproduce`: the paper's method on linear walls, then beside the force reader on finite strain.

Virtual eyes, Young's modulus, slices, network and answers for the one; eyes, moduli, the paper's network and both
methods' answers for the other; then the page. The force reader and its library are the bundled ones, or trained.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from scleraforce.calibration.calibrate import calibrate_recordings, calibration_passes
from scleraforce.calibration.result import Calibration, calibration_as_json, parse_calibration
from scleraforce.known.calibration_file import open_calibration, write_calibration
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections, paper_eyes
from scleraforce.learning.dataset import open_dataset, read_population_modulus
from scleraforce.learning.generate import generate_dataset
from scleraforce.learning.train import train_classifier
from scleraforce.library.plan import plan_library
from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import read_recording
from scleraforce.reproduction.page import FIGURES, write_reproduction_html
from scleraforce.reproduction.readings import (
    CALIBRATED_EYES,
    CALIBRATION_FORCES_N,
    EPOCHS,
    bend_eyes,
    bent_trials,
    calibrate_bent,
    interval_eyes,
    read_bent,
    read_left_out,
    run_library,
    train_bent_model,
    train_force_reader,
    write_left_out,
)
from scleraforce.reproduction.run import Announce, Progress, Run, Stage, run_stages, seconds_so_far
from scleraforce.study import Study, study_hash


@dataclass(frozen=True)
class Reproduction:
    """What a reproduction has found: moduli, answers, and the seconds of each stage.

    `to_the_bounds` are the answers to the same eyes under forces that are drawn up to the bounds of the classes.
    `bent_paper` and `bent_reader` are the answers of the paper's method and of the force reader to walls of finite
    strain.
    """

    calibration: Calibration
    evaluation: Evaluation
    to_the_bounds: Evaluation
    bent_paper: Evaluation
    bent_reader: Evaluation
    seconds: dict[str, float]


def reproduce(
    run: Run, announce: Announce, started_at: datetime, tell: Callable[[str], object] = lambda _: None
) -> Reproduction:
    """Do the whole of the paper, as far as it is not done, and write the page.

    Args:
        run: where and on what.
        announce: opens a progress bar.
        started_at: what the page gives as its date.
        tell: called with a line for the user, where results of other code are removed.
    """
    answers: list[Evaluation] = []

    def evaluate(run: Run, progress: Progress) -> None:
        model = load_model(run.model)
        for folder in (run.recordings, run.recordings_to_the_bounds):
            recordings = _recordings(run, folder)
            answers.append(evaluate_recordings(model, recordings, progress=progress))

    def leave_out(run: Run, progress: Progress) -> None:
        calibration = parse_calibration(open_calibration(run.calibration))
        write_left_out(read_left_out(open_dataset(run.dataset), calibration, answers[0], progress), run.left_out)

    def read_bent_eyes(run: Run, progress: Progress) -> None:
        answers.extend(read_bent(run, progress))

    def report(run: Run, progress: Progress) -> None:
        evaluation, to_the_bounds, bent_paper, bent_reader = answers
        seconds = seconds_so_far(run)
        write_reproduction_html(
            run, evaluation, to_the_bounds, bent_paper, bent_reader, seconds, started_at, progress
        )  # fmt: skip

    library = Stage("library", lambda run: plan_library(run.study).units, _make_library)
    reader = Stage("train reader", _reader_steps, train_force_reader, lambda run: run.reader)
    stages = (
        Stage("phantom", _trials, _make_eyes, lambda run: run.recordings),
        Stage("phantom to the bounds", _trials, _make_eyes_to_the_bounds, lambda run: run.recordings_to_the_bounds),
        Stage("calibrate", _calibrated_trials, _calibrate, lambda run: run.calibration),
        Stage("generate", _images, _generate, lambda run: run.dataset, resumes=True),
        Stage("train", lambda run: run.study.network.epochs, _train, lambda run: run.model),
        Stage("evaluate", lambda run: 2 * _trials(run), evaluate),
        Stage("leave out", _left_out_epochs, leave_out, lambda run: run.left_out),
        Stage("bend", lambda run: len(bent_trials(run.study)), bend_eyes, lambda run: run.bent.recordings),
        *([library] if run.train else []),
        Stage("calibrate bent", _bent_frames, calibrate_bent, lambda run: run.bent.calibrations, by_reader=True),
        Stage("train bent", lambda run: run.study.network.epochs, train_bent_model, lambda run: run.bent.model),
        *([reader] if run.train else []),
        Stage("read bent", _bent_answers, read_bent_eyes),
        Stage("report", lambda _: FIGURES, report),
    )
    seconds = run_stages(run, stages, announce, tell)
    evaluation, to_the_bounds, bent_paper, bent_reader = answers
    calibration = parse_calibration(open_calibration(run.calibration))
    return Reproduction(calibration, evaluation, to_the_bounds, bent_paper, bent_reader, seconds)


def _recordings(run: Run, folder: Path) -> list[Path]:
    """Return the recordings of the virtual eyes in a folder, in the order of the design."""
    return [folder / eye.id for eye, _ in paper_eyes(run.study)]


def _trials(run: Run) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study))


def _calibrated_trials(run: Run) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study)[:CALIBRATED_EYES])


def _bent_answers(run: Run) -> int:
    return 2 * sum(len(forces_n) for _, forces_n in bent_trials(run.study))


def _bent_frames(run: Run) -> int:
    counts = [len(forces_n) for _, forces_n in bent_trials(run.study)]
    passes = calibration_passes(run_library(run), None)
    return passes * len(counts) * len(CALIBRATION_FORCES_N) + sum(counts[:CALIBRATED_EYES])


def _images(run: Run) -> int:
    return sum(group.images for group in run.study.dataset.group)


def _reader_steps(run: Run) -> int:
    return run.study.reader.epochs + interval_eyes(run.study)


def _left_out_epochs(run: Run) -> int:
    return CALIBRATED_EYES * min(EPOCHS, run.study.network.epochs)


def _make_eyes(run: Run, progress: Progress) -> None:
    _write_eyes(run.recordings, paper_eyes(run.study), run.study, run.study.phantom.seed, progress)


def _make_eyes_to_the_bounds(run: Run, progress: Progress) -> None:
    eyes = paper_eyes(run.study, to_the_bounds=True)
    _write_eyes(run.recordings_to_the_bounds, eyes, run.study, run.study.phantom.seed + 1, progress)


def _write_eyes(
    folder: Path, eyes: Sequence[tuple[PhantomEye, tuple[float, ...]]], study: Study, seed: int, progress: Progress
) -> None:
    folder.mkdir()
    for eye, forces_n in eyes:
        plan = plan_phantom(eye, forces_n, study, seed)
        write_phantom(folder / eye.id, plan, linear_sections(eye, study), study, progress)


def _calibrate(run: Run, progress: Progress) -> None:
    opened = [read_recording(path) for path in _recordings(run, run.recordings)[:CALIBRATED_EYES]]
    finder, study = load_wall_finder(SHIPPED_WALL_FINDER), run.study
    calibration = calibrate_recordings(opened, study, study_hash(study), None, progress=progress, finder=finder)
    write_calibration(calibration_as_json(calibration), run.calibration)


def _make_library(run: Run, progress: Progress) -> None:
    run_library(run, progress)


def _generate(run: Run, progress: Progress) -> None:
    modulus = read_population_modulus(run.calibration)
    generate_dataset(run.study, run.dataset, calibration=modulus, workers=run.workers, progress=progress)


def _train(run: Run, progress: Progress) -> None:
    train_classifier(open_dataset(run.dataset), run.model, progress=progress)
