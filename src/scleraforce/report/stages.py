"""The stages of `reproduce`: five virtual eyes in the paper's design, slices, network, answers, page."""

from pathlib import Path

from scleraforce.dataset import generate_dataset, open_dataset
from scleraforce.learning.train import train_classifier
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.recording.phantom import plan_phantom, write_phantom
from scleraforce.recording.virtual_eye import linear_sections, paper_eyes
from scleraforce.report.reproduction import Announce, Progress, Run, Stage, run_stages, seconds_so_far
from scleraforce.report.reproduction_page import FIGURES, write_reproduction_html

__all__ = ["recording_paths", "reproduce"]


def reproduce(run: Run, announce: Announce) -> tuple[Evaluation, dict[str, float]]:
    """Do the whole of the paper, as far as it is not done, and write the page.

    Args:
        run: where and on what.
        announce: opens a progress bar.

    Returns:
        The answers to the virtual eyes, and the seconds of each stage.
    """
    found: list[Evaluation] = []

    def evaluate(run: Run, progress: Progress) -> None:
        found.append(evaluate_recordings(load_model(run.model), recording_paths(run), progress=progress))

    def report(run: Run, progress: Progress) -> None:
        write_reproduction_html(run, found[0], seconds_so_far(run), progress)

    stages = (
        Stage("phantom", _trials, _make_eyes, lambda run: run.recordings),
        Stage("generate", _images, _generate, lambda run: run.dataset, resumes=True),
        Stage("train", lambda run: run.study.network.epochs, _train, lambda run: run.model),
        Stage("evaluate", _trials, evaluate),
        Stage("report", lambda _: FIGURES, report),
    )
    seconds = run_stages(run, stages, announce)
    return found[0], seconds


def recording_paths(run: Run) -> list[Path]:
    """Return the recordings of the virtual eyes, in the order of the design."""
    return [run.recordings / eye.id for eye, _ in paper_eyes(run.study)]


def _trials(run: Run) -> int:
    return sum(len(forces_n) for _, forces_n in paper_eyes(run.study))


def _images(run: Run) -> int:
    return sum(group.images for group in run.study.dataset.group)


def _make_eyes(run: Run, progress: Progress) -> None:
    run.recordings.mkdir()
    for eye, forces_n in paper_eyes(run.study):
        plan = plan_phantom(eye, forces_n, run.study, run.study.phantom.seed)
        write_phantom(run.recordings / eye.id, plan, linear_sections(eye, run.study), run.study, progress)


def _generate(run: Run, progress: Progress) -> None:
    generate_dataset(run.study, run.dataset, workers=run.workers, progress=progress)


def _train(run: Run, progress: Progress) -> None:
    train_classifier(open_dataset(run.dataset), run.model, progress=progress)
