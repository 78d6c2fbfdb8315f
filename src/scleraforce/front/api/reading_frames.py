"""Find the wall in a frame, load a model, read the force from a frame or from whole
recordings.

It imports the small runtime alone (NumPy, OpenCV, ONNX Runtime), unless a calibration
is given that is not a file.
"""

import getpass
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf, isfinite
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

import scleraforce.records.calibration_file as calibration_file
from scleraforce.base.arrays import Flags
from scleraforce.base.errors import FrameError, InputError, StudyError
from scleraforce.calibration.evaluation import Evaluation, evaluate_recordings
from scleraforce.fit.unknowns import SIZE
from scleraforce.front.api.progress import Counting, check_rigidity, counting_for
from scleraforce.reading.answer import Answer, Answers
from scleraforce.reading.load_model import (
    bundled_finder,
    load_reader,
    load_wall_finder,
    opened_reader,
    suited_reader,
)
from scleraforce.reading.needle_lean import MOST_LEAN_RAD
from scleraforce.reading.reading_models import Reader
from scleraforce.reading.recorded_wall import recorded_wall
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.recordings import recording_folder
from scleraforce.recordings.drawn_walls import (
    RecordedWalls,
    mask_of,
    read_mask,
    write_wall,
)
from scleraforce.recordings.formats.picture_streams import find_greys
from scleraforce.recordings.formats.pixels_without_value import NOT_FINITE
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records import scan
from scleraforce.records.calibration_file import CalibrationSummary, read_calibration
from scleraforce.records.eye import NOTHING_KNOWN, Known, Modulus, completed_eye
from scleraforce.records.fields import check_quantity
from scleraforce.records.frame import (
    NOT_JUDGED,
    Pixels,
    ScaledFrame,
    SourcedValue,
    frame_digest,
)
from scleraforce.records.globe import known_globe
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.recording_info import known_of_recording
from scleraforce.records.scan import Plane, Scanner
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation, without_wall
from scleraforce.wall.wall_in_metres import GIVEN_SD_ROWS, check_mask_size, given_wall
from scleraforce.wall.wall_network import WallFinder

if TYPE_CHECKING:
    from scleraforce.calibration.calibration import Calibration

    GivenCalibration = Calibration | CalibrationSummary | str | PathLike[str]

FrameSource = str | PathLike[str] | Pixels
Mask = str | PathLike[str] | Pixels | Flags
Given = Recording | str | PathLike[str]  # a recording, opened or as a folder


@dataclass(frozen=True, eq=False)
class FrameReading:
    """An answer with its inputs: `given` by the caller, `stated` by recording.toml,
    `known` of both; notes; plane.
    """

    answer: Answer
    frame: ScaledFrame
    given: Known
    stated: Known
    known: Known
    notes: tuple[str, ...]
    plane: Plane | None = None


def segment(
    frame: FrameSource,
    *,
    width_m: float | None = None,
    depth_m: float | None = None,
    refractive_index: float | None = None,
    wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER,
) -> Segmentation:
    """Find the wall in a raw frame.

    Args:
        frame: an image file, or an array (row, column), as `read` takes it; rows go
            down into the eye.
        width_m: of the frame; None: the recording's beside the file, or the file's own.
            An array needs it.
        depth_m: of the frame as stored; None: the recording's, or the file's own. An
            array needs it.
        refractive_index: of the depth axis; None: the recording's, or 1 (corrected).
        wall_finder: model folder of a network that checks the wall, and whose wall it
            is where the two methods differ; by default the bundled one. None: nothing
            checks it.

    Returns:
        Boundaries in rows, `mask`, `thickness_m`, and whether the wall can be judged:
        `usable`, or the `reason`.

    Raises:
        FrameError: the frame cannot be read, or nothing says how large it is.

    >>> import scleraforce as sf
    >>> found = sf.segment("eye-a/frames/0001.png")
    >>> found.usable, found.mask.shape
    (True, (512, 512))
    """
    given = Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index)
    seen, found = segmented_frame(
        frame, given, Scanner(refractive_index=1.0), finder_of(wall_finder)
    )
    return replace(found, pixels=seen.pixels)


def segmented_frame(
    frame: FrameSource,
    given: Scanner,
    assumed: Scanner,
    finder: WallFinder | None,
    transpose: bool = False,
) -> tuple[ScaledFrame, Segmentation]:
    """Return a frame with its scale, as `scaled_frame`, and its wall."""
    seen = scaled_frame(frame, given, assumed, "assumed", transpose)
    try:
        thickness_m = None if seen.info is None else seen.info.eye.thickness_m
        return seen, _judged_wall(seen, frame, thickness_m, finder, transpose)
    except ValueError as fault:
        raise FrameError(f"{_place(frame)}: {fault}") from fault


def _judged_wall(
    seen: ScaledFrame,
    frame: FrameSource,
    thickness_m: float | None,
    finder: WallFinder | None,
    transpose: bool,
) -> Segmentation:
    """Return the wall of a frame, without the columns of which a masked array masks a
    pixel: they count as black.
    """
    if not np.ma.is_masked(frame):
        return find_wall(seen.pixels, seen.scale, thickness_m, finder)

    judged: Any = ~np.ma.getmaskarray(np.ma.asarray(frame)).any(axis=int(transpose))
    if not judged.any():
        return without_wall(seen.pixels.shape, "all columns are masked")

    lit: Any = seen.pixels * judged.astype(seen.pixels.dtype)
    found = find_wall(lit, seen.scale, thickness_m, finder)
    outer_row, inner_row = (
        np.where(judged, row, np.nan) for row in (found.outer_row, found.inner_row)
    )

    return replace(found, outer_row=outer_row, inner_row=inner_row)


def finder_of(model: str | PathLike[str] | None) -> WallFinder | None:
    """Load a wall finder, the bundled one once; None stays None."""
    if model is None:
        return None
    return bundled_finder() if model == SHIPPED_WALL_FINDER else load_wall_finder(model)


def load_model(
    path: str | PathLike[str],
    *,
    wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER,
) -> Reader:
    """Load a model: a bundled one, or a folder.

    Args:
        path: the name of a bundled model ("default", "living", "paper"), or the path of
            a folder that `train` or `scleraforce train` wrote ("./mine").
        wall_finder: model folder that checks the walls, by default the bundled one;
            None: nothing checks them.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it.

    >>> import scleraforce as sf
    >>> sf.load_model("./reader").kind, sf.load_model("default").kind
    ('reader', 'reader')
    """
    return load_reader(path, finder=wall_finder)


@overload
def read(
    model: Reader | str | PathLike[str],
    frame: str | PathLike[str] | list[FrameSource] | tuple[FrameSource, ...],
    *,
    calibration: "Calibration | str | PathLike[str] | None" = ...,
    eye: str | None = ...,
    youngs_modulus_pa: float | None = ...,
    iop_pa: float | None = ...,
    thickness_m: float | None = ...,
    gap_m: float | None = ...,
    polar_angle_rad: float | None = ...,
    plane_direction_rad: float | None = ...,
    lean_rad: float | Literal["unknown"] | None = ...,
    stiffening: float | None = ...,
    globe: str | None = ...,
    rigidity_pa13_per_m3: float | None = ...,
    width_m: float | None = ...,
    depth_m: float | None = ...,
    refractive_index: float | None = ...,
    transpose: bool = ...,
    held_s: float | None = ...,
    planes: Sequence[Plane] = ...,
    mask: "Mask | Sequence[Mask] | None" = ...,
    mask_sd_rows: float = ...,
    progress: Callable[[int], object] | None = ...,
) -> Answer: ...


@overload
def read(
    model: Reader | str | PathLike[str],
    frame: NDArray[Any],
    *,
    calibration: "Calibration | str | PathLike[str] | None" = ...,
    eye: str | None = ...,
    youngs_modulus_pa: float | None = ...,
    iop_pa: float | None = ...,
    thickness_m: float | None = ...,
    gap_m: float | None = ...,
    polar_angle_rad: float | None = ...,
    plane_direction_rad: float | None = ...,
    lean_rad: float | Literal["unknown"] | None = ...,
    stiffening: float | None = ...,
    globe: str | None = ...,
    rigidity_pa13_per_m3: float | None = ...,
    width_m: float | None = ...,
    depth_m: float | None = ...,
    refractive_index: float | None = ...,
    transpose: bool = ...,
    held_s: float | None = ...,
    planes: Sequence[Plane] = ...,
    mask: "Mask | Sequence[Mask] | None" = ...,
    mask_sd_rows: float = ...,
    progress: Callable[[int], object] | None = ...,
) -> Any: ...


def read(
    model: Reader | str | PathLike[str],
    frame: FrameSource | NDArray[Any] | list[FrameSource] | tuple[FrameSource, ...],
    *,
    calibration: "Calibration | str | PathLike[str] | None" = None,
    eye: str | None = None,
    youngs_modulus_pa: float | None = None,
    iop_pa: float | None = None,
    thickness_m: float | None = None,
    gap_m: float | None = None,
    polar_angle_rad: float | None = None,
    plane_direction_rad: float | None = None,
    lean_rad: float | Literal["unknown"] | None = None,
    stiffening: float | None = None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
    width_m: float | None = None,
    depth_m: float | None = None,
    refractive_index: float | None = None,
    transpose: bool = False,
    held_s: float | None = None,
    planes: Sequence[Plane] = (),
    mask: "Mask | Sequence[Mask] | None" = None,
    mask_sd_rows: float = GIVEN_SD_ROWS,
    progress: Callable[[int], object] | None = None,
) -> Any:
    """Read the force from one raw frame, or from one of each plane that a scanner takes
    at once.

    By default, the eye, the frame's size and its plane are the recording's beside the
    file.

    Args:
        model: of `load_model` or `train`, or its folder or name.
        frame: an image file, or an array (row, column); rows go down into the eye. Of
            several planes, a list of these, which are read together. An array (n, row,
            column) is a stack of single frames. Floats are scaled to counts; columns
            that a masked array masks are not judged; an array of bool is a mask without
            a frame.
        calibration: of `calibrate`, or its file: gives the eye's modulus, or the
            population's.
        eye: its name in the calibration; None: the recording's.
        youngs_modulus_pa: of this eye, instead of a calibration.
        iop_pa: intraocular pressure.
        thickness_m: of the wall.
        gap_m: distance of the B-scan plane from the needle axis.
        polar_angle_rad: of the contact, from the pole.
        plane_direction_rad: of the B-scan's lateral axis, from the meridian that leads
            away from the pole.
        lean_rad: angle between the needle and the wall's normal; "unknown": the
            interval spans 0 to 45 degrees; None: the recording's, else as in the
            calibration, else as in the picture, if a shaft is in it.
        stiffening: parameter b of the tissue (docs/physics.md); None: the
            calibration's, else 0.
        globe: "open" or "sealed"; None: the recording's, or it is not known, and the
            interval is wider.
        rigidity_pa13_per_m3: of a sealed globe (`recording.toml` has it in mmHg^(1/3)
            per µl).
        width_m: of the frame; an array needs it.
        depth_m: of the frame as stored; an array needs it.
        refractive_index: of the depth axis; None: the recording's, or the model's
            study's.
        transpose: the depth runs along the file's rows, from left to right.
        held_s: time since the needle's push, in tissue that relaxes; None: as in the
            frames of the calibration.
        planes: of a list of frames, one for each; by default their recording's. The gap
            is then found, not given.
        mask: the wall, in place of the one that is found: an image file or an array of
            the frame's shape, 255 or True where wall is, 128 in columns that are not
            judged; of several planes a list. By default the recording's.
        mask_sd_rows: standard deviation of the mask's boundaries, rows.
        progress: called with 1 after each frame of a stack.

    Returns:
        An `Answer`: `force_n` with its 90 % `interval_n`, the pressure `iop_at_dent_pa`
        (None with a classifier), the class `predicted`, `probabilities`, and `warnings`
        that limit the answer. A frame that cannot be judged is not `usable`, for a
        `reason`, and of the highest class. Of a stack `Answers`, with `to_dataframe`
        and `to_xarray`.

    Raises:
        FrameError: the frame cannot be read, or nothing says how large it is.
        InputError: a modulus and a calibration, a calibration and no name of an eye, no
            such globe, or frames without their planes.
        CalibrationError: the calibration file cannot be used.

    >>> import scleraforce as sf
    >>> model = sf.load_model("./reader")
    >>> answer = sf.read(model, "eye-a/frames/0002.png", youngs_modulus_pa=0.3e6)
    >>> print(f"{answer.force_n * 1e3:.0f} mN, class {answer.predicted}")
    2... mN, class 1
    """
    reader = opened_reader(model)
    given = eye_of_arguments(
        {
            "youngs_modulus_pa": youngs_modulus_pa,
            "iop_pa": iop_pa,
            "thickness_m": thickness_m,
            "gap_m": gap_m,
            "polar_angle_rad": polar_angle_rad,
            "plane_direction_rad": plane_direction_rad,
            "lean_rad": lean_rad,
            "stiffening": stiffening,
            "globe": globe,
            "rigidity_pa13_per_m3": rigidity_pa13_per_m3,
        }
    )
    size = Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index)

    def answer(frames: Sequence[FrameSource], masks: "Sequence[Mask]") -> Answer:
        at = planes or stated_planes(frames)
        one = frame_readings(
            reader,
            frames,
            given,
            size,
            calibration,
            eye,
            transpose,
            held_s,
            at,
            masks,
            mask_sd_rows,
        )[0]
        found = one.answer.segmentation and replace(
            one.answer.segmentation, pixels=one.frame.pixels
        )

        return replace(
            one.answer, warnings=(*one.answer.warnings, *one.notes), segmentation=found
        )

    several = isinstance(frame, list | tuple) and all(
        isinstance(one, str | PathLike | np.ndarray) for one in frame
    )
    frames: Any = frame if several else [frame]
    masks: Any = (
        [] if mask is None else mask if isinstance(mask, list | tuple) else [mask]
    )

    if not isinstance(frame, np.ndarray) or frame.ndim != 3:
        return answer(frames, masks)
    if not frame.size:
        raise FrameError(
            f"frame: an array of shape {frame.shape}; give frames x rows x columns, at"
            " least one"
        )

    stack, notes = as_counts(frame)
    masks = mask if isinstance(mask, np.ndarray) else masks
    if len(masks) not in (0, len(stack)):
        raise InputError(
            f"mask: {len(masks)} for a stack of {len(stack)} frames; give one for each"
        )

    answers = list[Answer]()
    for nth, one in enumerate(stack):
        found = answer([one], list(masks[nth : nth + 1]))
        answers.append(replace(found, warnings=(*found.warnings, *notes)))
        if progress is not None:
            progress(1)

    return Answers(tuple(answers))


def evaluate(
    model: Reader | str | PathLike[str],
    recordings: Given | Sequence[Given],
    calibration: "Calibration | str | PathLike[str] | None" = None,
    *,
    progress: Callable[[int], object] | None = None,
    counting: Counting | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs.

    Args:
        model: of `load_model` or `train`, or its folder or name.
        recordings: one or more, opened or as folders.
        calibration: of `calibrate`, or its file: gives a reader the eyes' moduli; its
            frames are not scored.
        progress: called with 1 after each frame.
        counting: for bars, in place of `progress`: a context manager of the title
            "frames" and their number.

    Returns:
        The answer to each of the `frames`, `mae_n`, `coverage`, `accuracy`, `confusion`
        (rows: target), and `notes`.

    Raises:
        InputError: a recording or the calibration cannot be used, or not with this
            model.

    >>> import scleraforce as sf
    >>> evaluation = sf.evaluate(sf.load_model("./reader"), "eye-a")
    >>> [frame.answer.predicted for frame in evaluation.frames]
    [1, 2, 2]
    """
    reader = opened_reader(model)
    each = opened_recordings(recordings)
    summary = None if calibration is None else summary_of_calibration(calibration)
    counting = counting or counting_for(progress, "frames")
    with counting("frames", sum(len(one.frames) for one in each)) as advance:
        return evaluate_recordings(reader, each, summary, advance)


def save_wall(
    recording: Given, file: str, mask: Mask, *, author: str | None = None
) -> None:
    """Save the wall of a recording's frame: all later readings use it, in place of the
    one that they find.

    Args:
        recording: opened, or its folder.
        file: name of the frame.
        mask: an image file or an array of the frame's shape, 255 or True where wall is,
            128 in columns that are not judged. It replaces an earlier one.
        author: of the mask; None: the name of the user.

    Raises:
        InputError: no such frame, another frame whose wall would be in the same file,
            or another shape.

    >>> import scleraforce as sf
    >>> found = sf.segment("eye-a/frames/0001.png")
    >>> sf.save_wall("eye-a", "0001.png", found.mask, author="A. Reader")
    >>> sf.read(sf.load_model("./reader"), "eye-a/frames/0001.png").segmentation.source
    'corrected'
    """
    found = opened_recordings(recording)[0]
    recording_folder.check_alone(found, file)
    drawn = (
        read_mask(Path(mask))
        if isinstance(mask, str | PathLike)
        else mask_of(mask, "mask")
    )
    check_mask_size(drawn, (found.info.oct.rows, found.info.oct.columns), "mask")

    if author is not None and not author.isprintable():
        raise InputError(
            f"author: {author!r}: a line break or another unprintable character; give a"
            " name of one line"
        )

    write_wall(found.path, file, drawn, author or getpass.getuser(), utc_now())


def utc_now() -> str:
    """Return the time, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def stated_planes(frames: Sequence[FrameSource]) -> tuple[Plane, ...]:
    """Return the planes of frames that are in a recording of several; raises
    `InputError` if they are of two times.
    """
    found = [
        recording_folder.stated_plane(Path(one))
        for one in frames
        if isinstance(one, str | PathLike)
    ]
    stated = [one for one in found if one is not None]
    if len({one[:2] for one in stated}) > 1:
        raise InputError(
            "frame: of several times; only frames of one time_s are read together"
        )

    return tuple(plane for *_, plane in stated)


def frame_readings(
    model: Reader | str | PathLike[str],
    frames: Sequence[FrameSource],
    given: Known,
    size: Scanner,
    calibration: "GivenCalibration | None" = None,
    eye: str | None = None,
    transpose: bool = False,
    held_s: float | None = None,
    planes: Sequence[Plane] = (),
    masks: "Sequence[Mask | None]" = (),
    mask_sd_rows: float = GIVEN_SD_ROWS,
) -> list[FrameReading]:
    """Read one frame, or one of each plane together, as `read` does; return each answer
    with its inputs.
    """
    model = opened_reader(model)
    if not frames:
        raise InputError("frame: none; give one, or one of each plane")
    if len(planes) != len(frames) and (planes or len(frames) != 1):
        raise InputError(
            f"planes: {len(planes)} of {len(frames)} frames; give one for each"
        )
    if len({plane.name for plane in planes}) < len(planes):
        raise InputError("planes: two frames of one; give one frame of each")
    if len(planes) > 1:
        scan.check_planes(tuple(planes), "planes")
    if planes and given.gap_m is not None:
        raise InputError("gap_m: several planes show their gaps; leave it out")
    if masks and len(masks) != len(frames):
        raise InputError(
            f"mask: {len(masks)} for {len(frames)} frames; give one for each, in their"
            " order"
        )
    if not 0.0 < mask_sd_rows < inf:
        raise InputError(
            f"mask_sd_rows: {mask_sd_rows:g}; give the standard deviation of the mask's"
            " boundaries, rows"
        )
    if held_s is not None and not 0.0 <= held_s < inf:
        raise InputError(
            f"held_s: {held_s:g}; give the time since the push, 0 s or more"
        )

    check_calibrated(given, calibration is not None, eye)
    assumed = Scanner(refractive_index=model.study.oct.refractive_index)
    each = [
        scaled_frame(frame, size, assumed, "model's study", transpose)
        for frame in frames
    ]
    seen = each[0]
    frame = frames[0]

    if any(
        (one.scale, one.pixels.shape) != (seen.scale, seen.pixels.shape) for one in each
    ):
        raise InputError(
            "frame: of several sizes or scales; planes that are read together have one"
        )
    if (
        len(each) > 1
        and np.ptp(seen.pixels)
        and len({frame_digest(one.pixels) for one in each}) < len(each)
    ):
        raise InputError("frame: one picture for two planes; give the frame of each")

    stated = NOTHING_KNOWN if seen.info is None else known_of_recording(seen.info)
    known = completed_eye(given, stated)
    notes = list(seen.notes)

    if calibration is not None:
        summary = summary_of_calibration(calibration)
        name = eye
        if name is None and seen.info is not None:
            name = seen.info.eye.id

        if name is None:
            where = "no recording.toml beside the frame names it"
            raise InputError(
                f"eye: missing; {where}; {calibration_file.choice_of_eye(summary)}"
            )

        known = calibration_file.known_of_eye(known, summary, name)
        notes += filter(None, [calibration_file.foreign_modulus(summary, name)])

    if seen.info is not None:
        place = recording_folder.recording_of(Path(_place(frame))) or _place(frame)
        notes += (
            f"{place}: {limit}"
            for limit in model.limits(known, seen.info.oct, seen.info.needle.gauge)
        )

    if known.leak_time_s is not None:
        notes.append(
            "leak_time_s: a single frame is read as if nothing had leaked; evaluate"
            " follows the leak"
        )

    asked = model
    model = suited_reader(model, known)
    if model.path != asked.path:
        notes.append(
            f"read with the bundled reader {model.name}, which was trained"
            " for such eyes"
        )

    if held_s is not None and known.relaxation is None:
        way = "give a calibration, or relaxation in recording.toml"
        raise InputError(f"held_s: nothing says how the tissue relaxes; {way}")

    history = TissueMemory.unknown(known, model.study.needle.max_force_n)
    try:
        walls = [
            _wall(
                one,
                frame,
                mask,
                mask_sd_rows,
                transpose,
                notes,
                known.thickness_m,
                model.finder,
            )
            for one, frame, mask in zip(
                each, frames, masks or [None] * len(each), strict=True
            )
        ]
        elastic = model.read_together(
            [one.pixels for one in each], seen.scale, known, planes, walls
        )
        answers = [
            history.read(one, model.study.classes.bounds_n, held_s=held_s)[0]
            for one in elastic
        ]
    except ValueError as fault:
        raise FrameError(f"{_place(frame)}: {fault}") from fault

    if calibration is not None and name is not None:
        shown = [_appearance(answer) for answer in answers]
        doubts = [
            calibration_file.appearance_doubt(summary, name, one) for one in shown
        ]
        notes += filter(None, doubts[:1])

    return [
        FrameReading(answer, one, given, stated, known, tuple(notes), plane)
        for answer, one, plane in zip(answers, each, planes or (None,), strict=True)
    ]


def _appearance(answer: Answer) -> calibration_file.Appearance | None:
    """Return what a frame shows beside its dent; None if it was not fitted."""
    wall = answer.segmentation
    if not answer.usable or answer.fit is None or wall is None or not wall.inner_found:
        return None
    size = float(np.exp(answer.fit.unknown[SIZE]))
    return calibration_file.appearance_of([wall.thickness_m], [size])


def _wall(
    seen: ScaledFrame,
    frame: FrameSource,
    mask: "Mask | None",
    sd_rows: float,
    transpose: bool,
    notes: list[str],
    thickness_m: float | None,
    finder: WallFinder | None,
) -> Segmentation | None:
    """Return the wall that is given for a frame, or that its recording has; add a note
    on one that is not used.
    """
    if isinstance(frame, str | PathLike):
        if (
            mask is None
            and (recording := recording_folder.recording_of(Path(frame))) is not None
        ):
            walls = RecordedWalls(recording)
            found = recorded_wall(
                walls, Path(frame).name, seen.pixels.shape, seen.scale
            )
            notes += walls.notes

            return found
    elif mask is None and np.asarray(frame).dtype == bool:
        mask = frame
    elif mask is None and np.ma.is_masked(frame):
        return _judged_wall(seen, frame, thickness_m, finder, transpose)

    if mask is None:
        return None

    given = (
        read_mask(Path(mask))
        if isinstance(mask, str | PathLike)
        else mask_of(mask, "mask")
    )
    given = given.T if transpose else given
    check_mask_size(given, seen.pixels.shape, "mask")

    if np.ma.is_masked(frame):
        hidden = np.ma.getmaskarray(np.ma.asarray(frame))
        given = np.where(hidden.T if transpose else hidden, np.uint8(NOT_JUDGED), given)

    return given_wall(given, seen.scale, sd_rows)


def eye_of_arguments(given: Mapping[str, Any]) -> Known:
    """Return the known inputs of an eye, checked; `given` has all arguments of `read`
    that state one.
    """
    lean_rad = given["lean_rad"]
    if isinstance(lean_rad, str) and lean_rad != "unknown":
        raise InputError(f"lean_rad: {lean_rad!r}; give a number or 'unknown'")

    for key in (
        "youngs_modulus_pa",
        "iop_pa",
        "thickness_m",
        "gap_m",
        "polar_angle_rad",
        "lean_rad",
    ):
        if given[key] not in (None, "unknown"):
            check_quantity(key, given[key])

    for key in ("plane_direction_rad", "stiffening"):
        if given[key] is not None and not isfinite(given[key]):
            raise InputError(
                f"{key}: {given[key]} is not a finite number; leave it out if it is not"
                " known"
            )

    modulus_pa, stiffening, globe = (
        given[key] for key in ("youngs_modulus_pa", "stiffening", "globe")
    )
    if stiffening is not None and stiffening < 0.0:
        raise InputError(f"stiffening: {stiffening:g}; give at least 0")

    check_rigidity(globe, given["rigidity_pa13_per_m3"])
    return Known(
        modulus=None if modulus_pa is None else Modulus.stated(modulus_pa),
        polar_rad=given["polar_angle_rad"],
        direction_rad=given["plane_direction_rad"],
        lean_rad=(
            None
            if lean_rad is None
            else (0.0, MOST_LEAN_RAD)
            if lean_rad == "unknown"
            else (lean_rad, lean_rad)
        ),
        globe=(
            None if globe is None else known_globe(globe, given["rigidity_pa13_per_m3"])
        ),
        stiffening=stiffening,
        **{key: given[key] for key in ("iop_pa", "thickness_m", "gap_m")},
    )


def check_calibrated(given: Known, calibrated: bool, eye: str | None) -> None:
    """Check that a calibration and the given values do not state the same quantity."""
    if not calibrated:
        if eye is not None:
            raise InputError(
                f"eye: {eye!r} names an eye of a calibration; give the calibration, too"
            )
    elif given.modulus is not None:
        raise InputError(
            "youngs_modulus_pa: the calibration gives the modulus; leave out one of"
            " the two"
        )
    elif given.stiffening is not None:
        raise InputError(
            "stiffening: the calibration gives the stiffening; leave out one of the two"
        )


def scaled_frame(
    frame: FrameSource,
    given: Scanner,
    assumed: Scanner,
    source: str,
    transpose: bool = False,
) -> ScaledFrame:
    """Return a frame with its scale: given, else the recording's or the file's, else
    assumed, of a named source.
    """
    if isinstance(frame, str | PathLike):
        return recording_folder.read_scaled_frame(
            Path(frame), given, (assumed, source), transpose
        )

    pixels, notes = as_counts(frame)
    if pixels.ndim != 2 or not pixels.size:
        raise FrameError(
            f"frame: an array of shape {pixels.shape}; give one frame, rows x columns"
        )
    if given.width_m is None or given.depth_m is None:
        raise FrameError(
            "frame: nothing says how large this array is; give width_m and depth_m"
        )

    index = given.refractive_index or assumed.refractive_index or 1.0
    width = SourcedValue(given.width_m, "option")
    depth = SourcedValue(given.depth_m, "option")
    pixels = np.ma.filled(pixels, 0)
    found = ScaledFrame(
        pixels.T if transpose else pixels,
        width,
        depth,
        SourcedValue(index, "option"),
        None,
        notes,
    )

    try:
        check_quantity("width_m", given.width_m)
        check_quantity("depth_m", given.depth_m)
        _ = found.scale  # which checks the index
    except (StudyError, ValueError) as fault:
        raise FrameError(f"frame: {fault}") from fault

    return found


def as_counts(frame: Any) -> tuple[Any, tuple[str, ...]]:
    """Return an array, of one frame or a stack, as counts, and a note if they were
    scaled; flags are a mask.

    Masked pixels count as the darkest; a masked array stays one.
    """
    pixels = np.asanyarray(frame)
    if pixels.dtype in (np.uint8, np.uint16):
        return pixels, ()
    if pixels.dtype == bool:  # of a stack each frame is a mask
        return (mask_of(pixels, "frame") if pixels.ndim == 2 else pixels), ()

    known = np.ma.compressed(pixels)
    greys = find_greys([known], None, "frame")
    if missing := greys.without.get(NOT_FINITE, 0):
        raise FrameError(
            f"frame: {missing} pixels are not finite; give"
            " numpy.ma.masked_invalid(frame)"
        )

    counts: Any = greys.counts(np.ma.filled(pixels, greys.low))
    counts = (
        np.ma.masked_array(counts, pixels.mask)
        if isinstance(pixels, np.ma.MaskedArray)
        else counts
    )

    if not greys.scaled and greys.low == 0.0:
        return counts, ()

    return counts, (
        (
            f"frame: pixels of {greys.low:g} to {greys.high:g} were scaled to counts of"
            f" 0 to {counts.max()}"
        ),
        *([f"frame: {greys.words}"] if greys.words else []),
    )


def _place(frame: FrameSource) -> str:
    return str(frame) if isinstance(frame, str | PathLike) else "frame"


def summary_of_calibration(calibration: "GivenCalibration") -> CalibrationSummary:
    """Return the summary of a calibration, or of its file, that models read."""
    if isinstance(calibration, CalibrationSummary):
        return calibration
    if isinstance(calibration, str | PathLike):
        return read_calibration(calibration)

    text = json.dumps(calibration.to_dict(), allow_nan=False)
    return calibration_file.summary_of(
        calibration_file.parse_calibration_file(text.encode(), "the calibration")
    )


def opened_recordings(given: Given | Sequence[Given]) -> list[Recording]:
    """Return recordings; read folders."""
    each = [given] if isinstance(given, Recording | str | PathLike) else list(given)
    if not each:
        raise InputError("recordings: none; give at least one")

    return [
        entry if isinstance(entry, Recording) else read_recording(entry)
        for entry in each
    ]
