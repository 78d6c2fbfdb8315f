"""The stages of `reproduce`: the paper's method on linear walls, then beside the force reader on finite strain."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

from scleraforce.calibration.calibrate import calibration_passes
from scleraforce.calibration.result import Calibration, calibration_as_json, parse_calibration
from scleraforce.known.calibration_file import open_calibration, read_calibration, write_calibration
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import LinearSections, paper_eyes
from scleraforce.learning.dataset import open_dataset
from scleraforce.learning.generate import generate_dataset
from scleraforce.learning.train import train_classifier
from scleraforce.library.plan import plan_library
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.recording.folder import read_recording
from scleraforce.reproduction.page import FIGURES, write_reproduction_html
from scleraforce.reproduction.run import (
    CALIBRATED_EYES,
    CALIBRATION_FORCES_N,
    Announce,
    Progress,
    Run,
    Stage,
    bend_eyes,
    bent_trials,
    calibrate_bent,
    calibrate_for,
    interval_eyes,
    read_bent,
    run_library,
    run_stages,
    seconds_so_far,
    train_bent_model,
    train_force_reader,
)


@dataclass(frozen=True)
class Reproduction:
    """Results: moduli, answers to linear eyes, `to_the_bounds`, at finite strain by both methods; seconds."""

    calibration: Calibration
    evaluation: Evaluation
    to_the_bounds: Evaluation
    bent_paper: Evaluation
    bent_reader: Evaluation
    seconds: dict[str, float]


def reproduce(
    run: Run, announce: Announce, started_at: datetime, tell: Callable[[str], object] = lambda _: None
) -> Reproduction:
    """Do the unfinished stages of the pipeline, and write the page with the date `started_at`; see `run_stages`."""
    answers: list[Evaluation] = []

    def train(run: Run, progress: Progress) -> None:
        train_classifier(open_dataset(run.dataset), run.model, progress=progress)

    def evaluate(run: Run, progress: Progress) -> None:
        model = load_model(run.model)
        for folder in (run.recordings, run.recordings_to_the_bounds):
            recordings = _recordings(run, folder)
            answers.append(evaluate_recordings(model, recordings, progress=progress))

    def evaluate_bent(run: Run, progress: Progress) -> None:
        answers.extend(read_bent(run, progress))

    def report(run: Run, progress: Progress) -> None:
        write_reproduction_html(run, answers, seconds_so_far(run), started_at, progress)

    epochs, study = run.study.network.epochs, run.study
    library = Stage("library", lambda _: plan_library(study).units, run_library)
    reader_steps = study.reader.epochs + interval_eyes(study)
    reader = Stage("train reader", lambda _: reader_steps, train_force_reader, lambda run: run.reader)
    bent_answers = 2 * sum(len(forces_n) for _, forces_n in bent_trials(study))
    stages = (
        Stage("phantom", _trials, _write_eyes, lambda run: run.recordings),
        Stage("phantom to the bounds", _trials, partial(_write_eyes, to_the_bounds=True),
              lambda run: run.recordings_to_the_bounds),
        Stage("calibrate", lambda run: _trials(run, CALIBRATED_EYES), _calibrate, lambda run: run.calibration),
        Stage("generate", lambda _: sum(group.images for group in study.dataset.group), _generate,
              lambda run: run.dataset, resumes=True),
        Stage("train", lambda _: epochs, train, lambda run: run.model),
        Stage("evaluate", lambda run: 2 * _trials(run), evaluate),
        Stage("bend", lambda _: len(bent_trials(study)), bend_eyes, lambda run: run.bent_recordings),
        *([library] if run.train else []),
        Stage("calibrate bent", _bent_frames, calibrate_bent, lambda run: run.bent_calibrations,
              by_reader=True),
        Stage("train bent", lambda _: epochs, train_bent_model, lambda run: run.bent_model),
        *([reader] if run.train else []),
        Stage("read bent", lambda _: bent_answers, evaluate_bent),
        Stage("report", lambda _: FIGURES, report),
    )  # fmt: skip
    seconds = run_stages(run, stages, announce, tell)
    evaluation, to_the_bounds, bent_paper, bent_reader = answers
    calibration = parse_calibration(open_calibration(run.calibration))
    return Reproduction(calibration, evaluation, to_the_bounds, bent_paper, bent_reader, seconds)


def _recordings(run: Run, folder: Path) -> list[Path]:
    return [folder / eye.id for eye, _ in paper_eyes(run.study)]


def _trials(run: Run, eyes: int | None = None) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study)[:eyes])


def _bent_frames(run: Run) -> int:
    counts = [len(forces_n) for _, forces_n in bent_trials(run.study)]
    passes = calibration_passes(run_library(run), None)
    return passes * len(counts) * len(CALIBRATION_FORCES_N) + sum(counts[:CALIBRATED_EYES])


def _write_eyes(run: Run, progress: Progress, *, to_the_bounds: bool = False) -> None:
    study, folder = run.study, run.recordings_to_the_bounds if to_the_bounds else run.recordings
    folder.mkdir()
    for eye, forces_n in paper_eyes(study, to_the_bounds=to_the_bounds):
        plan = plan_phantom(eye, forces_n, study, study.phantom.seed + to_the_bounds)
        write_phantom(folder / eye.id, plan, LinearSections(eye, study), study, progress)


def _calibrate(run: Run, progress: Progress) -> None:
    opened = [read_recording(path) for path in _recordings(run, run.recordings)[:CALIBRATED_EYES]]
    write_calibration(calibration_as_json(calibrate_for(run, opened, progress, None)), run.calibration)


def _generate(run: Run, progress: Progress) -> None:
    modulus = read_calibration(run.calibration)
    generate_dataset(run.study, run.dataset, calibration=modulus, workers=run.workers, progress=progress)
