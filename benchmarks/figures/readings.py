"""Every way of reading the virtual eyes' frames that the figures compare."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import scleraforce as sf
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import DEFAULT_READER, GROUPS
from figures.recordings import read_made
from figures.reuse import remove
from figures.scores import AnsweredFrame, answered_frame
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.evaluation import FrameAnswer
from scleraforce.front.api.reading_frames import summary_of_calibration
from scleraforce.front.paper.run_folder import framed_for_laboratory
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import ForceReader, Reader
from scleraforce.records.calibration_file import CalibratedEye
from scleraforce.records.study import Range, Study, parse_study, preset_toml

CALIBRATED_FRAMES = 3
GAP_M = Range(min=0.4e-3, max=0.9e-3)  # of the eyes
READINGS = {"network": "the reader's network", "fit": "the reader's fit"}


@dataclass(frozen=True, eq=False)
class Method:
    """A way of reading: a model, whose E, and words for the table.

    `own_modulus`: the eye's own E, calibrated on its first frames; otherwise the mean
    of eyes that are not among those read. `calibrated`: the model takes an E at all,
    which the paper's classifier does not.
    """

    name: str
    title: str
    model: Reader
    own_modulus: bool = True
    calibrated: bool = True


def make_methods(name: str, path: Path) -> list[Method]:
    """Return the ways of reading of a reader, as groups name it, in its folder; the
    default one first.
    """
    reader = load_reader(path)
    assert isinstance(reader, ForceReader)
    ways = sorted(READINGS, key=lambda way: way != reader.default)
    mark = "" if name == DEFAULT_READER else f"{name}-"
    own = [
        Method(
            f"{mark}{way}",
            f"{READINGS[way]}{' (default)' * (way == reader.default)}, the eye's E",
            replace(reader, default=way),
        )
        for way in ways
    ]
    title = f"{READINGS[reader.default]}, E of other eyes"

    return [
        *own,
        Method(f"{mark}{reader.default}-population", title, reader, own_modulus=False),
    ]


def paper_method(
    folder: FiguresFolder, plain: Sequence[FigureEye], study: Study
) -> Method:
    """Return the paper's way of reading: a classifier of linear slices that is trained
    here, with the population's E of the plain eyes.

    They are calibrated linearly on their first frames. Framing and gap are drawn from
    the ranges of the eyes that it will see; IOP is the study's.
    """
    framed = framed_for_laboratory(study)
    framed = replace(framed, dataset=replace(framed.dataset, gap_m=GAP_M))
    modulus_pa, _ = sf.calibrate(
        _recordings(folder, plain), frames=CALIBRATED_FRAMES, mechanics="linear"
    ).population
    slices, model = (folder.work(name) for name in ("linear-slices", "classifier"))
    for place in (slices, model):
        remove(place)

    dataset = sf.generate(
        slices, framed, youngs_modulus_pa=modulus_pa, mechanics="linear"
    )
    title = "the paper's: linear, E of the population"
    return Method("paper", title, sf.train(dataset, model), calibrated=False)


def raw_method(model: Path) -> Method:
    """Return the way of reading of a trained raw reader."""
    return Method("raw", "the raw reader, the eye's E", load_reader(model))


def calibrated_eyes(
    folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int = CALIBRATED_FRAMES
) -> dict[str, CalibratedEye]:
    """Return what `calibrate` makes of each eye's first frames, by the eye's name."""
    found: dict[str, CalibratedEye] = {}
    for half in _halves(eyes):
        found |= summary_of_calibration(calibration_of(folder, half, frames)).eyes
    return found


def read_frames(
    folder: FiguresFolder, eyes: Sequence[FigureEye], method: Method
) -> tuple[AnsweredFrame, ...]:
    """Return the answers of a method to the frames of a group that count.

    The frames that any eye is calibrated on are left out, also where the method does
    not use that calibration.
    """
    found = calibrated_eyes(folder, eyes)
    own = [eye_name(drawn.setup) for drawn in eyes if drawn.calibrating is drawn]
    used = {(eye, frame.file) for eye in own for frame in found[eye].frames}
    halves = _halves(eyes)
    frames: list[AnsweredFrame] = []

    for number, half in enumerate(halves):
        told = half if method.own_modulus else halves[len(halves) - 1 - number]
        calibration = (
            calibration_of(folder, told, CALIBRATED_FRAMES)
            if method.calibrated
            else None
        )
        answers = sf.evaluate(method.model, _recordings(folder, half), calibration)
        frames += _frames(folder, half, answers.frames)

    return tuple(frame for frame in frames if (frame.eye, frame.file) not in used)


def _frames(
    folder: FiguresFolder, eyes: Sequence[FigureEye], answers: Iterable[FrameAnswer]
) -> list[AnsweredFrame]:
    """Return the answers that count, with their truth."""
    found = []
    made = {eye_name(eye.setup): (eye, read_made(folder, eye)) for eye in eyes}

    for answer in answers:
        drawn, truth = made[answer.eye]
        place = truth.files.index(answer.file)
        study = drawn.study
        in_window = bool(truth.in_window(study.oct.depth_m)[place])
        frame = answered_frame(
            answer, float(truth.forces_n[place]), in_window, study.classes
        )
        found += [] if frame is None else [frame]

    return found


def calibration_of(
    folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int
) -> Calibration:
    """Return the calibration of eyes on the first frames of each."""
    calibrating = [drawn.calibrating for drawn in eyes]
    reader = GROUPS[eyes[0].group].reader
    return _calibration(tuple(_recordings(folder, calibrating)), frames, reader)


@cache
def _calibration(recordings: tuple[Path, ...], frames: int, reader: str) -> Calibration:
    study = None if reader == DEFAULT_READER else parse_study(preset_toml(reader))
    return sf.calibrate(recordings, study, frames=frames)


def _recordings(folder: FiguresFolder, eyes: Sequence[FigureEye]) -> list[Path]:
    return [folder.recording(eye) for eye in eyes]


def _halves(eyes: Sequence[FigureEye]) -> list[Sequence[FigureEye]]:
    """Return two halves of a group: the population's E of one is the mean of the
    other's eyes.
    """
    middle = (len(eyes) + 1) // 2
    return [eyes[:middle], eyes[middle:]]
