"""Single frames, from a file or as an array: find the wall, load a model, read the force.

Only what the runtime needs is imported (NumPy, OpenCV, ONNX Runtime), unless a calibration is given that is no file.
"""

import json
from dataclasses import dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scleraforce import reader
from scleraforce.errors import FrameError, InputError, StudyError
from scleraforce.known.calibration_file import (
    CalibrationSummary,
    foreign_modulus,
    known_of_eye,
    parse_calibration_file,
    read_calibration,
    summary_of,
)
from scleraforce.known.eye import Known, KnownGlobe, Modulus, completed, known_globe, known_of_recording
from scleraforce.models.folder import SHIPPED_WALL_FINDER
from scleraforce.reader.answer import Answer, Reader
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import RecordingInfo, Scanner, read_scaled_frame, recording_of
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.checked_wall import find_checked_wall
from scleraforce.segmentation.sclera import find_sclera
from scleraforce.segmentation.steps import Segmentation
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study.fields import check_quantity

if TYPE_CHECKING:
    from scleraforce.calibration.result import Calibration

Frame = str | PathLike[str] | Pixels


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Pixels with their scale; `place` names them in messages, `info` is their recording's, `notes` their file's."""

    pixels: Pixels
    scale: PixelScale
    place: str
    info: RecordingInfo | None = None
    notes: tuple[str, ...] = ()


def segment(
    frame: Frame,
    *,
    width_m: float | None = None,
    depth_m: float | None = None,
    refractive_index: float | None = None,
    wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER,
) -> Segmentation:
    """Find the wall in a raw frame.

    Args:
        frame: an image file, or counts (row, column) as uint8 or uint16; rows go down into the eye.
        width_m: of the frame; None: what the recording beside the file or the file itself says. An array needs it.
        depth_m: of the frame as stored; likewise.
        refractive_index: by which depth is stretched; None: the recording's, or 1 (corrected).
        wall_finder: model folder of a network that checks the wall, and whose wall it is where both ways to find one
            differ; by default the one that ships. None: nothing checks it.

    Returns:
        Boundaries in rows, `mask`, `thickness_m`, and whether the wall can be judged: `usable`, or the `reason`.

    Raises:
        FrameError: the frame cannot be read, or nothing says how large it is.

    >>> import scleraforce as sf
    >>> found = sf.segment("eye-a/frames/0001.png")
    >>> found.usable, found.mask.shape
    (True, (512, 512))
    """
    seen = _scaled(
        frame,
        Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index),
        Scanner(refractive_index=1.0),
        "assumed",
    )
    thickness_m = None if seen.info is None else seen.info.eye.thickness_m
    try:
        if wall_finder is None:
            return find_sclera(seen.pixels, seen.scale, thickness_m)
        return find_checked_wall(seen.pixels, seen.scale, _finder(wall_finder), thickness_m)
    except ValueError as fault:
        raise FrameError(f"{seen.place}: {fault}") from fault


def _finder(path: str | PathLike[str]) -> WallFinder:
    return _shipped_finder() if path == SHIPPED_WALL_FINDER else load_wall_finder(path)


@cache
def _shipped_finder() -> WallFinder:
    return load_wall_finder(SHIPPED_WALL_FINDER)


def load_model(path: str | PathLike[str], *, wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER) -> Reader:
    """Load a model: one that ships with scleraforce, or a folder.

    Args:
        path: "default", the reader that ships, or the folder that `train` or `scleraforce train` wrote, which wins.
        wall_finder: model folder that checks the walls, by default the one that ships; None: nothing does.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it.

    >>> import scleraforce as sf
    >>> sf.load_model("reader").kind, sf.load_model("default").kind
    ('reader', 'reader')
    """
    return reader.load_model(path, finder=wall_finder)


def read(
    model: Reader,
    frame: Frame,
    *,
    calibration: "Calibration | str | PathLike[str] | None" = None,
    eye: str | None = None,
    youngs_modulus_pa: float | None = None,
    iop_pa: float | None = None,
    thickness_m: float | None = None,
    gap_m: float | None = None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
    width_m: float | None = None,
    depth_m: float | None = None,
    refractive_index: float | None = None,
) -> Answer:
    """Read the force from one raw frame.

    What is not told of the eye and of the frame's size is what the recording beside the file states, if there is one.

    Args:
        model: of `load_model` or `train`.
        frame: an image file, or counts (row, column) as uint8 or uint16; rows go down into the eye.
        calibration: of `calibrate`, or its file: gives the eye's modulus, or the population's.
        eye: its name in the calibration; None: the recording's.
        youngs_modulus_pa: of this eye, instead of a calibration.
        iop_pa: intraocular pressure.
        thickness_m: of the wall.
        gap_m: distance of the B-scan plane from the needle axis.
        globe: "open" or "sealed"; None: the recording's, or it is not known, and the interval is wider.
        rigidity_pa13_per_m3: of a sealed globe (`recording.toml` has it in mmHg^(1/3) per µl).
        width_m: of the frame; an array needs it.
        depth_m: of the frame as stored; likewise.
        refractive_index: by which depth is stretched; None: the recording's, or that of the model's study.

    Returns:
        `force_n` with its 90 % `interval_n` and the pressure `iop_at_dent_pa` (None with a classifier), the class
        `predicted`, `probabilities`, and `warnings` that limit the answer. A frame that cannot be judged is not
        `usable`, for a `reason`, and of the highest class.

    Raises:
        FrameError: the frame cannot be read, or nothing says how large it is.
        InputError: a modulus and a calibration, a calibration and no name of an eye, or no such globe.
        CalibrationError: the calibration file cannot be used.

    >>> import scleraforce as sf
    >>> model = sf.load_model("reader")
    >>> answer = sf.read(model, "eye-a/frames/0002.png", youngs_modulus_pa=0.3e6)
    >>> print(f"{answer.force_n * 1e3:.0f} mN, class {answer.predicted}")
    2... mN, class 1
    """
    check_model(model)
    given = {"youngs_modulus_pa": youngs_modulus_pa, "iop_pa": iop_pa, "thickness_m": thickness_m, "gap_m": gap_m}
    for key, value in given.items():
        if value is not None:
            check_quantity(key, value)
    seen = _scaled(
        frame,
        Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index),
        Scanner(refractive_index=model.study.oct.refractive_index),
        "model's study",
    )
    modulus = None if youngs_modulus_pa is None else Modulus.stated(youngs_modulus_pa)
    told = Known(
        modulus=modulus,
        iop_pa=iop_pa,
        thickness_m=thickness_m,
        gap_m=gap_m,
        globe=_told_globe(globe, rigidity_pa13_per_m3),
    )
    known = completed(told, Known() if seen.info is None else known_of_recording(seen.info))
    warnings = list(seen.notes)
    if calibration is not None:
        if modulus is not None:
            raise InputError("youngs_modulus_pa: a calibration is given, too; leave one of the two out")
        summary, name = summary_of_calibration(calibration), _eye_name(eye, seen.info)
        known = known_of_eye(known, summary, name)
        if foreign := foreign_modulus(summary, name):
            warnings.append(foreign)
    elif eye is not None:
        raise InputError(f"eye: {eye!r} names an eye of a calibration; give the calibration, too")
    if seen.info is not None:
        warnings += (f"{seen.place}: {limit}" for limit in model.limits(known, seen.info.oct, seen.info.needle.gauge))
    try:
        answer = model.read(seen.pixels, seen.scale, known)
    except ValueError as fault:
        raise FrameError(f"{seen.place}: {fault}") from fault
    return replace(answer, warnings=(*answer.warnings, *warnings))


def _told_globe(globe: str | None, rigidity_pa13_per_m3: float | None) -> KnownGlobe | None:
    """Return what was told of a globe, checked as the keys of a recording are."""
    if rigidity_pa13_per_m3 is not None and globe != "sealed":
        raise InputError('rigidity_pa13_per_m3: of a sealed globe; give globe="sealed", too, or leave it out')
    return None if globe is None else known_globe(globe, rigidity_pa13_per_m3)


def _scaled(frame: Frame, told: Scanner, assumed: Scanner, source: str) -> _Scaled:
    """Return a frame with its scale, from its file or from what was told."""
    if isinstance(frame, str | PathLike):
        path = Path(frame)
        found = read_scaled_frame(path, told, (assumed, source))
        place = str(recording_of(path) or path)
        return _Scaled(found.pixels, found.scale, place, found.info, found.notes)
    pixels: Any = np.asarray(frame)  # its type is checked where it is read
    if pixels.ndim != 2:
        raise FrameError(f"frame: an array of shape {pixels.shape}; give one frame, rows x columns")
    if told.width_m is None or told.depth_m is None:
        raise FrameError("frame: nothing says how large this array is; give width_m and depth_m")
    for name, extent_m in (("width_m", told.width_m), ("depth_m", told.depth_m)):
        try:
            check_quantity(name, extent_m)
        except StudyError as fault:
            raise FrameError(str(fault)) from None
    index = told.refractive_index or assumed.refractive_index or 1.0
    try:
        scale = PixelScale(
            lateral_m=told.width_m / pixels.shape[1], depth_m=told.depth_m / pixels.shape[0], refractive_index=index
        )
    except ValueError as fault:
        raise FrameError(f"frame: {fault}") from fault
    return _Scaled(pixels, scale, "frame")


def check_model(model: object) -> None:
    """Check that a model was loaded.

    Raises:
        InputError: it is a path.
    """
    if isinstance(model, str | PathLike):
        raise InputError(f"model: {model} is a path; give sf.load_model({str(model)!r})")


def summary_of_calibration(calibration: "Calibration | str | PathLike[str]") -> CalibrationSummary:
    """Return what models need of a calibration, or of its file.

    Raises:
        CalibrationError: the file cannot be used.
    """
    if isinstance(calibration, str | PathLike):
        return read_calibration(calibration)
    from scleraforce.calibration.result import calibration_as_json  # with all that calibrates

    text = json.dumps(calibration_as_json(calibration), allow_nan=False)
    return summary_of(parse_calibration_file(text.encode(), "the calibration"))


def _eye_name(eye: str | None, info: RecordingInfo | None) -> str:
    if eye is not None:
        return eye
    if info is None:
        raise InputError(
            "eye: missing; a calibration has several, and no recording.toml beside the frame names this one"
        )
    return info.eye.id
