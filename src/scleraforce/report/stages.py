"""The stages of `reproduce`: five virtual eyes, Young's modulus, slices, network, answers, page."""

import json
from dataclasses import dataclass
from pathlib import Path

from scleraforce.calibration.calibrate import Calibration, calibrate_recordings
from scleraforce.calibration.files import calibration_as_json, read_posteriors
from scleraforce.dataset import generate_dataset, open_dataset, read_population_modulus
from scleraforce.learning.train import train_classifier
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.recording.files import read_recording
from scleraforce.recording.phantom import plan_phantom, write_phantom
from scleraforce.recording.virtual_eye import linear_sections, paper_eyes
from scleraforce.report.files import write_whole
from scleraforce.report.left_out import EPOCHS, read_left_out, write_left_out
from scleraforce.report.reproduction import Announce, Progress, Run, Stage, run_stages, seconds_so_far
from scleraforce.report.reproduction_page import FIGURES, write_reproduction_html
from scleraforce.study import study_hash

__all__ = ["Reproduction", "reproduce"]

CALIBRATED = 4  # of the five eyes, as in the paper (sec. 3.2, Table 2)


@dataclass(frozen=True)
class Reproduction:
    """What a reproduction has found: moduli, answers, and the seconds of each stage."""

    calibration: Calibration
    evaluation: Evaluation
    seconds: dict[str, float]


def reproduce(run: Run, announce: Announce) -> Reproduction:
    """Do the whole of the paper, as far as it is not done, and write the page.

    Args:
        run: where and on what.
        announce: opens a progress bar.
    """
    answers: list[Evaluation] = []

    def evaluate(run: Run, progress: Progress) -> None:
        answers.append(evaluate_recordings(load_model(run.model), _recordings(run), progress=progress))

    def leave_out(run: Run, progress: Progress) -> None:
        write_left_out(
            read_left_out(open_dataset(run.dataset), read_posteriors(run.calibration), answers[0], progress),
            run.left_out,
        )

    def report(run: Run, progress: Progress) -> None:
        write_reproduction_html(run, answers[0], seconds_so_far(run), progress)

    stages = (
        Stage("phantom", _trials, _make_eyes, lambda run: run.recordings),
        Stage("calibrate", _calibrated_trials, _calibrate, lambda run: run.calibration),
        Stage("generate", _images, _generate, lambda run: run.dataset, resumes=True),
        Stage("train", lambda run: run.study.network.epochs, _train, lambda run: run.model),
        Stage("evaluate", _trials, evaluate),
        Stage("leave out", _left_out_epochs, leave_out, lambda run: run.left_out),
        Stage("report", lambda _: FIGURES, report),
    )
    seconds = run_stages(run, stages, announce)
    return Reproduction(read_posteriors(run.calibration), answers[0], seconds)


def _recordings(run: Run) -> list[Path]:
    """Return the recordings of the virtual eyes, in the order of the design."""
    return [run.recordings / eye.id for eye, _ in paper_eyes(run.study)]


def _trials(run: Run) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study))


def _calibrated_trials(run: Run) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study)[:CALIBRATED])


def _images(run: Run) -> int:
    return sum(group.images for group in run.study.dataset.group)


def _left_out_epochs(run: Run) -> int:
    return CALIBRATED * min(EPOCHS, run.study.network.epochs)


def _make_eyes(run: Run, progress: Progress) -> None:
    run.recordings.mkdir()
    for eye, forces_n in paper_eyes(run.study):
        plan = plan_phantom(eye, forces_n, run.study, run.study.phantom.seed)
        write_phantom(run.recordings / eye.id, plan, linear_sections(eye, run.study), run.study, progress)


def _calibrate(run: Run, progress: Progress) -> None:
    opened = [read_recording(path) for path in _recordings(run)[:CALIBRATED]]
    calibration = calibrate_recordings(opened, run.study, study_hash(run.study), library=None, progress=progress)
    write_whole(json.dumps(calibration_as_json(calibration), indent=1, allow_nan=False) + "\n", run.calibration)


def _generate(run: Run, progress: Progress) -> None:
    modulus = read_population_modulus(run.calibration)
    generate_dataset(run.study, run.dataset, calibration=modulus, workers=run.workers, progress=progress)


def _train(run: Run, progress: Progress) -> None:
    train_classifier(open_dataset(run.dataset), run.model, progress=progress)
