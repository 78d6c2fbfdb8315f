"""Every way of reading the virtual eyes' frames that the figures compare."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from figures.commands import answers, content_key, made, made_by
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import DEFAULT_READER, GROUPS
from figures.recordings import read_made
from figures.scores import AnsweredFrame, answered_frame
from scleraforce.base.whole_files import write_whole
from scleraforce.front.paper.run_folder import framed_for_laboratory
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.records.calibration_file import CalibratedEye, read_calibration
from scleraforce.records.model_folder import RECORD_FILE, SHIPPED, STUDY_FILE
from scleraforce.records.study import Range, Study, format_study

CALIBRATED_FRAMES = 3
GAP_M = Range(min=0.4e-3, max=0.9e-3)  # of the eyes
READINGS = {"network": "the reader's network", "fit": "the reader's fit"}


@dataclass(frozen=True)
class Method:
    """A way of reading: a model, whose E, and words for the table.

    `own_modulus`: the eye's own E, calibrated on its first frames; otherwise the mean
    of eyes that are not among those read. `calibrated`: the model takes an E at all,
    which the paper's classifier does not.
    """

    name: str
    title: str
    model: Path
    own_modulus: bool = True
    calibrated: bool = True


def make_methods(folder: FiguresFolder, name: str, reader: Path) -> list[Method]:
    """Return the ways of reading of a reader, the default one first.

    Args:
        folder: where copies of the model are kept.
        name: of the reader, as groups name it.
        reader: its folder.
    """
    default = json.loads((reader / RECORD_FILE).read_text(encoding="utf-8"))["default"]
    ways = sorted(READINGS, key=lambda way: way != default)
    mark = "" if name == DEFAULT_READER else f"{name}-"
    own = [
        Method(
            f"{mark}{way}",
            f"{READINGS[way]}{' (default)' * (way == default)}, the eye's E",
            _answering(folder, reader, mark, way),
        )
        for way in ways
    ]
    title = f"{READINGS[default]}, E of other eyes"

    return [
        *own,
        Method(f"{mark}{default}-population", title, own[0].model, own_modulus=False),
    ]


def paper_method(
    folder: FiguresFolder, plain: Sequence[FigureEye], study: Study
) -> Method:
    """Return the paper's way of reading, with the modulus of the plain eyes; train a
    classifier that is not there.
    """
    model = _classifier(folder, plain, study)
    return Method(
        "paper", "the paper's: linear, E of the population", model, calibrated=False
    )


def raw_method(model: Path) -> Method:
    """Return the way of reading of a trained raw reader."""
    return Method("raw", "the raw reader, the eye's E", model)


def _answering(folder: FiguresFolder, reader: Path, mark: str, way: str) -> Path:
    """Return a copy of a reader with one of its two methods as the default."""

    def copy(part: Path) -> None:
        shutil.copytree(reader, part)
        record = json.loads((part / RECORD_FILE).read_text(encoding="utf-8"))
        write_whole(
            json.dumps({**record, "default": way}, indent=2) + "\n", part / RECORD_FILE
        )

    return made(
        folder.work(f"{mark}reader-{way}"), f"{content_key(reader)} {way}", copy
    )


def _classifier(
    folder: FiguresFolder, plain: Sequence[FigureEye], study: Study
) -> Path:
    """Return the paper's classifier of linear slices, with the population's E of the
    plain eyes.

    They are calibrated linearly on their first frames. Framing and gap are drawn from
    the ranges of the eyes that it will see; IOP is the study's.
    """
    path = folder.work("linear.toml")
    framed = framed_for_laboratory(study)
    write_whole(
        format_study(replace(framed, dataset=replace(framed.dataset, gap_m=GAP_M))),
        path,
    )
    modulus = made_by(
        folder.work("calibrations") / "linear.json",
        [
            "calibrate",
            *_recordings(folder, plain),
            "--frames",
            str(CALIBRATED_FRAMES),
            "--mechanics",
            "linear",
        ],
    )
    slices = made_by(
        folder.work("linear-slices"),
        [
            "generate",
            "--study",
            path,
            "--calibration",
            modulus,
            "--mechanics",
            "linear",
        ],
    )

    return made_by(folder.work("classifier"), ["train", slices])


def calibrated_eyes(
    folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int = CALIBRATED_FRAMES
) -> dict[str, CalibratedEye]:
    """Return what `calibrate` makes of each eye's first frames, by the eye's name."""
    found: dict[str, CalibratedEye] = {}
    for half in _halves(eyes):
        found |= read_calibration(_calibration(folder, half, frames)).eyes
    return found


def read_frames(
    folder: FiguresFolder, eyes: Sequence[FigureEye], method: Method
) -> tuple[AnsweredFrame, ...]:
    """Return the answers of a method to the frames of a group that count, made where
    they are not there.

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
        first = eye_name(half[0].setup)
        last = eye_name(half[-1].setup)
        out = folder.work("answers") / f"{method.name}-{first}-to-{last}.json"
        command: list[str | Path] = [
            "evaluate",
            method.model,
            *_recordings(folder, half),
        ]

        if method.calibrated:
            command += ["--calibration", _calibration(folder, told, CALIBRATED_FRAMES)]

        frames += _frames(folder, half, answers(out, command)["frames"])

    return tuple(frame for frame in frames if (frame.eye, frame.file) not in used)


def _frames(
    folder: FiguresFolder,
    eyes: Sequence[FigureEye],
    answered: Sequence[dict[str, object]],
) -> list[AnsweredFrame]:
    """Return the answers that count, with their truth; both lists are in the order of
    the eyes and their frames.
    """
    found = []
    made = {eye_name(eye.setup): (eye, read_made(folder, eye)) for eye in eyes}

    for answer in answered:
        drawn, truth = made[str(answer["eye"])]
        place = truth.files.index(str(answer["file"]))
        study = drawn.study
        in_window = bool(truth.in_window(study.oct.depth_m)[place])
        frame = answered_frame(
            answer, float(truth.forces_n[place]), in_window, study.classes
        )
        found += [] if frame is None else [frame]

    return found


def _calibration(folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int) -> Path:
    """Return the calibration of eyes on the first frames of each, made where it is not
    there.
    """
    name = (
        f"{eye_name(eyes[0].setup)}-to-{eye_name(eyes[-1].setup)}-{frames}-frames.json"
    )
    calibrating = [drawn.calibrating for drawn in eyes]
    command: list[str | Path] = [
        "calibrate",
        *_recordings(folder, calibrating),
        "--frames",
        str(frames),
    ]

    reader = GROUPS[eyes[0].group].reader
    if reader != DEFAULT_READER:
        command += ["--study", SHIPPED[reader] / STUDY_FILE]

    return made_by(folder.work("calibrations") / name, command)


def _recordings(folder: FiguresFolder, eyes: Sequence[FigureEye]) -> list[Path]:
    return [folder.recording(eye) for eye in eyes]


def _halves(eyes: Sequence[FigureEye]) -> list[Sequence[FigureEye]]:
    """Return two halves of a group: the population's E of one is the mean of the
    other's eyes.
    """
    middle = (len(eyes) + 1) // 2
    return [eyes[:middle], eyes[middle:]]
