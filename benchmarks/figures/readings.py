"""Every way of reading the virtual eyes' frames that the figures compare."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from figures.commands import answers, made_by
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.recordings import read_made
from figures.scores import AnsweredFrame, answered_frame
from scleraforce.calibration.summary import EyeSummary, read_calibration
from scleraforce.report.files import write_whole
from scleraforce.report.framing import framed_for_laboratory
from scleraforce.study import Range, Study, format_study

__all__ = ["CALIBRATED_FRAMES", "METHODS", "Method", "Models", "calibrated_eyes", "make_models", "read_frames"]

CALIBRATED_FRAMES = 3


@dataclass(frozen=True)
class Method:
    """A way of reading: whose E, which model, and words for the table.

    `own_modulus`: the eye's own E, calibrated on its first frames; otherwise the mean of eyes that are not among those
    read. `linear`: the paper's classifier. `options` go to `evaluate`.
    """

    name: str
    title: str
    own_modulus: bool = True
    linear: bool = False
    options: tuple[str, ...] = ()


METHODS = (
    Method("reader", "reader, the eye's E"),
    Method("network", "its network alone, the eye's E", options=("--method", "network")),
    Method("fit", "its fit alone, the eye's E", options=("--method", "fit")),
    Method("reader-population", "reader, E of other eyes", own_modulus=False),
    Method("paper", "the paper's classifier: linear, E of the population", own_modulus=False, linear=True),
)


@dataclass(frozen=True)
class Models:
    """The models that are compared: the reader's folder and the classifier's."""

    reader: Path
    classifier: Path


def make_models(folder: FiguresFolder, plain: Sequence[FigureEye], study: Study, reader: Path | None) -> Models:
    """Train what is not there yet: the reader, unless one is given, and the paper's classifier.

    The classifier learns from linear slices with the population's E of the plain eyes, calibrated linearly on the same
    frames as the reader's. Its framing and gap are drawn from the ranges of the eyes that it will see.
    """
    study_path = folder.work("study.toml")
    if not study_path.exists():
        write_whole(format_study(study), study_path)
    linear_path = folder.work("linear.toml")
    framed = framed_for_laboratory(study)
    if not linear_path.exists():
        dataset = replace(framed.dataset, gap_m=Range(0.4e-3, 0.9e-3))
        write_whole(format_study(replace(framed, dataset=dataset)), linear_path)
    modulus = made_by(
        folder.work("calibrations") / "linear.json",
        ["calibrate", *_recordings(folder, plain), "--frames", str(CALIBRATED_FRAMES), "--mechanics", "linear"],
    )
    slices = made_by(
        folder.work("linear-slices"),
        ["generate", "--study", linear_path, "--calibration", modulus, "--mechanics", "linear"],
    )
    classifier = made_by(folder.work("classifier"), ["train", slices])
    trained = reader or made_by(folder.work("reader"), ["train", "--study", study_path, "--kind", "reader"])
    return Models(trained, classifier)


def calibrated_eyes(
    folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int = CALIBRATED_FRAMES
) -> dict[str, EyeSummary]:
    """Return what `calibrate` makes of each eye's first frames, by the eye's name."""
    found: dict[str, EyeSummary] = {}
    for half in _halves(eyes):
        found |= read_calibration(_calibration(folder, half, frames)).eyes
    return found


def read_frames(
    folder: FiguresFolder, eyes: Sequence[FigureEye], models: Models, method: Method
) -> tuple[AnsweredFrame, ...]:
    """Return the answers of a method to the frames of a group that count, made where they are not there.

    The frames that any eye is calibrated on are left out, also where the method does not use that calibration.
    """
    used = {(eye, file) for eye, entry in calibrated_eyes(folder, eyes).items() for file in entry.frames}
    halves = _halves(eyes)
    frames: list[AnsweredFrame] = []
    for number, half in enumerate(halves):
        told = half if method.own_modulus else halves[len(halves) - 1 - number]
        out = folder.work("answers") / f"{method.name}-{half[0].eye.id}-to-{half[-1].eye.id}.json"
        model = models.classifier if method.linear else models.reader
        command: list[str | Path] = ["evaluate", model, *_recordings(folder, half)]
        if not method.linear:
            command += ["--calibration", _calibration(folder, told, CALIBRATED_FRAMES), *method.options]
        found = answers(out, command)
        frames += _frames(folder, half, found["frames"])
    return tuple(frame for frame in frames if (frame.eye, frame.file) not in used)


def _frames(
    folder: FiguresFolder, eyes: Sequence[FigureEye], answered: Sequence[dict[str, object]]
) -> list[AnsweredFrame]:
    """Return the answers that count, with their truth; both lists are in the order of the eyes and their frames."""
    found = []
    made = {eye.eye.id: (eye, read_made(folder, eye)) for eye in eyes}
    for answer in answered:
        drawn, truth = made[str(answer["eye"])]
        place = truth.files.index(str(answer["file"]))
        study = drawn.study
        in_window = bool(truth.in_window(study.oct.depth_m)[place])
        frame = answered_frame(answer, float(truth.forces_n[place]), in_window, study.classes)
        found += [] if frame is None else [frame]
    return found


def _calibration(folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int) -> Path:
    """Return the calibration of eyes on the first frames of each, made where it is not there."""
    name = f"{eyes[0].eye.id}-to-{eyes[-1].eye.id}-{frames}-frames.json"
    return made_by(
        folder.work("calibrations") / name, ["calibrate", *_recordings(folder, eyes), "--frames", str(frames)]
    )


def _recordings(folder: FiguresFolder, eyes: Sequence[FigureEye]) -> list[Path]:
    return [folder.recording(eye) for eye in eyes]


def _halves(eyes: Sequence[FigureEye]) -> list[Sequence[FigureEye]]:
    """Return two halves of a group: the population's E of one is the mean of the other's eyes."""
    middle = (len(eyes) + 1) // 2
    return [eyes[:middle], eyes[middle:]]
