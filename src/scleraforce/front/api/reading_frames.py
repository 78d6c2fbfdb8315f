"""Find the wall in a frame, load a model, read the force from a frame or from whole
recordings.

It imports the small runtime alone (NumPy, OpenCV, ONNX Runtime), unless a calibration
is given that is not a file.
"""

import getpass
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, Unpack, overload

import numpy as np
from numpy.typing import NDArray

import scleraforce.records.calibration_file as calibration_file
from scleraforce.base.errors import FrameError, InputError, StudyError
from scleraforce.base.units import from_si
from scleraforce.front.api.opened_frames import (
    Located,
    as_counts,
    finder_of,
    found_wall,
    located,
    opened_frame,
    place_of,
    planes_of,
    stated_wall,
)
from scleraforce.front.api.progress import Counting, Progress, counting_for
from scleraforce.front.api.shorthand import (
    OF_SCAN,
    ScanShorthand,
    SetupShorthand,
    declared_setup,
    stated_twice,
)
from scleraforce.reading.answer import Answer, Answers
from scleraforce.reading.eye_reader import (
    OF_POPULATION,
    EyeReader,
    Memory,
    MomentFrame,
    OpenedMoment,
    other_eye,
)
from scleraforce.reading.load_model import load_reader, opened_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings import recording_folder
from scleraforce.recordings.drawn_walls import drawn_mask, write_wall
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import (
    RecordedFile,
    Recording,
    read_recording,
)
from scleraforce.records.calibration_file import CalibrationSummary, read_calibration
from scleraforce.records.eye import Eye
from scleraforce.records.frame import (
    Frame,
    FrameSource,
    Mask,
    Moment,
    OpenedFrame,
    frame_digest,
)
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.needle import Needle
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale, Plane, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import check_mask_size
from scleraforce.wall.wall_network import WallFinder

if TYPE_CHECKING:
    from scleraforce.calibration.calibration import Calibration
    from scleraforce.calibration.evaluation import Evaluation

    GivenCalibration = Calibration | CalibrationSummary | str | PathLike[str]

Given = Recording | str | PathLike[str]  # a recording, opened or as a folder


@dataclass(frozen=True, eq=False)
class FrameReading:
    """An answer and what it was read with.

    `given`: by the caller. `stated`: by recording.toml. `listed`: both of these, and
    the pressure in frames.csv. `known`: these and the calibration. `remarks` concern
    the frame, its eye and the model; remarks on the answer itself are in `answer`.
    """

    answer: Answer
    frame: OpenedFrame
    given: Setup
    stated: Setup
    listed: Setup
    known: Setup
    remarks: tuple[Remark, ...]
    plane: Plane | None = None


def segment(
    frame: FrameSource,
    *,
    scan: Scan | None = None,
    wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER,
    **short: Unpack[ScanShorthand],
) -> Segmentation:
    """Find the wall in a raw frame.

    Args:
        frame: an image file, or an array (row, column), as `read` takes it; rows go
            down into the eye.
        scan: width, depth and refractive index of the frame; None: the recording's
            beside the file, or the file's own, and an index of 1. An array needs width
            and depth.
        wall_finder: model folder of a network that checks the wall, and whose wall it
            is where the two methods differ; by default the bundled one. None: nothing
            checks it.
        short: `width_m`, `depth_m`, `refractive_index` in place of a scan.

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
    given = declared_setup(None, None, scan, short, OF_SCAN).scan
    assumed = Scan(refractive_index=1.0)
    opened, wall = segmented_frame(frame, given, assumed, finder_of(wall_finder))
    return replace(wall, pixels=opened.pixels)


def segmented_frame(
    frame: FrameSource, given: Scan, assumed: Scan, finder: WallFinder | None
) -> tuple[OpenedFrame, Segmentation]:
    """Return a frame with its scale, as `opened_frame`, and its wall."""
    source = located(frame)
    opened = opened_frame(source, given, assumed, "assumed")
    thickness_m = None if opened.info is None else opened.info.eye.thickness_m
    with _faults_of_frame(source):
        return opened, found_wall(opened, source, given, thickness_m, finder)


@contextmanager
def _faults_of_frame(frame: Located) -> Iterator[None]:
    """Raise what a method says against a frame as a `FrameError`."""
    try:
        yield
    except ValueError as fault:
        raise FrameError(f"{place_of(frame)}: {fault}") from fault


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


Frames = Frame | FrameSource | Sequence[Frame | FrameSource]


@overload
def read(
    model: Reader | str | PathLike[str],
    frame: Sequence[Moment],
    *,
    eye: Eye | str | None = ...,
    needle: Needle | None = ...,
    scan: Scan | None = ...,
    calibration: "Calibration | str | PathLike[str] | None" = ...,
    progress: Progress | None = ...,
    **short: Unpack[SetupShorthand],
) -> Answers: ...


@overload
def read(
    model: Reader | str | PathLike[str],
    frame: Moment | Frame | str | PathLike[str] | Sequence[Frame | FrameSource],
    *,
    eye: Eye | str | None = ...,
    needle: Needle | None = ...,
    scan: Scan | None = ...,
    calibration: "Calibration | str | PathLike[str] | None" = ...,
    mask: Mask | Sequence[Mask] | None = ...,
    progress: Progress | None = ...,
    **short: Unpack[SetupShorthand],
) -> Answer: ...


@overload
def read(
    model: Reader | str | PathLike[str],
    frame: NDArray[Any],
    *,
    eye: Eye | str | None = ...,
    needle: Needle | None = ...,
    scan: Scan | None = ...,
    calibration: "Calibration | str | PathLike[str] | None" = ...,
    mask: Mask | Sequence[Mask] | None = ...,
    progress: Progress | None = ...,
    **short: Unpack[SetupShorthand],
) -> Any: ...


def read(
    model: Reader | str | PathLike[str],
    frame: Moment | Sequence[Moment] | Frames | NDArray[Any],
    *,
    eye: Eye | str | None = None,
    needle: Needle | None = None,
    scan: Scan | None = None,
    calibration: "Calibration | str | PathLike[str] | None" = None,
    mask: Mask | Sequence[Mask] | None = None,
    progress: Progress | None = None,
    **short: Unpack[SetupShorthand],
) -> Any:
    """Read the force from one raw frame, or from one of each plane that a scanner takes
    at once.

    What eye, needle and scan leave undeclared is the recording's beside the file, then
    the calibration's; the records say what a reading does without a value.

    Args:
        model: of `load_model` or `train`, or its folder or name.
        frame: an image file, or an array (row, column); rows go down into the eye. Of
            several planes, a list of these, which are read together. An array (n, row,
            column) is a stack of single frames. Floats are scaled to counts; columns
            that a masked array masks are not judged; an array of bool is a mask without
            a frame. A `Frame` or a `Moment` states more of it. A list of moments is a
            sequence: each is read with what those before it tell of it.
        eye: what is known of the eye, or its name in the calibration.
        needle: its gap from the B-scan, the place of its contact, its lean.
        scan: of the frames; an array needs its width and depth. Its planes are those of
            a list of frames, one for each: the gap is then found, not given.
        calibration: of `calibrate`, or its file: gives the eye's modulus, or the
            population's.
        mask: the wall, in place of the one that is found: an image file or an array of
            the frame's shape, 255 or True where wall is, 128 in columns that are not
            judged; of several planes a list. By default the recording's.
        progress: called with 1 after each frame of a stack or moment of a sequence.
        short: `iop_pa`, `thickness_m`, `youngs_modulus_pa`, `globe` ("open", "sealed")
            of the eye, `gap_m` of the needle, `width_m`, `depth_m`, `refractive_index`
            of the scan, in place of a record that holds them alone.

    Returns:
        An `Answer`: `force_n` with its 90 % `interval_n`, the pressure `iop_at_dent_pa`
        (None with a classifier), the class `predicted`, `probabilities`, and `remarks`
        that limit the answer. A frame that cannot be judged is not `usable`, for a
        `reason`, and of the highest class. Of a stack or a sequence `Answers`, with
        `to_dataframe` and `to_xarray`.

    Raises:
        FrameError: the frame cannot be read, or nothing says how large it is.
        InputError: a value is stated twice or out of bounds, a calibration comes
            without the name of an eye, or frames without their planes.
        CalibrationError: the calibration file cannot be used.

    >>> import scleraforce as sf
    >>> model = sf.load_model("./reader")
    >>> answer = sf.read(model, "eye-a/frames/0002.png", youngs_modulus_pa=0.3e6)
    >>> print(f"{answer.force_n * 1e3:.0f} mN, class {answer.predicted}")
    2... mN, class 1
    >>> eye = sf.Eye("a", modulus=sf.Modulus.stated(0.3e6))
    >>> sf.read(model, "eye-a/frames/0002.png", eye=eye).force_n == answer.force_n
    True
    """
    reader = opened_reader(model)
    given = declared_setup(eye, needle, scan, short)
    if isinstance(eye, str) and calibration is None:
        raise InputError(
            f"eye: {eye!r} names an eye of a calibration; give the calibration, too"
        )

    sequence = SequenceReader(reader, given, calibration)
    counting = counting_for(progress, "frames")
    if _is_sequence(frame):
        if mask is not None:
            raise InputError("mask: of moments, each frame has its own; leave it out")
        return _answers(sequence, frame, counting)
    if not isinstance(frame, np.ndarray) or frame.ndim != 3:
        return _answer(sequence.read(_moment(frame, mask)))
    if not frame.size:
        raise FrameError(
            f"frame: an array of shape {frame.shape}; give frames x rows x columns, at"
            " least one"
        )

    stack, notes = as_counts(frame)
    masks: Any = _list_of(mask) if not isinstance(mask, np.ndarray) else mask
    if len(masks) not in (0, len(stack)):
        raise InputError(
            f"mask: {len(masks)} for a stack of {len(stack)} frames; give one for each"
        )

    moments = [
        Moment((Frame(pixels, mask=masks[nth] if len(masks) else None),))
        for nth, pixels in enumerate(stack)
    ]
    scaled = tuple(Remark("pixels-scaled", note) for note in notes)
    return Answers(
        tuple(
            replace(answer, remarks=(*answer.remarks, *scaled))
            for answer in _answers(sequence, moments, counting)
        )
    )


def _answers(
    sequence: "SequenceReader", moments: Sequence[Moment], counting: Counting
) -> Answers:
    """Return the answers to moments, in their order."""
    answers = dict[int, Answer]()
    with counting("frames", len(moments)) as advance:
        for number, moment, files in sequence.in_time(moments):
            answers[number] = _answer(sequence.read(moment, files))
            advance(1)

    return Answers(tuple(answers[number] for number in range(len(moments))))


def _answer(readings: Sequence[FrameReading]) -> Answer:
    """Return the answer to a moment, with all remarks on it, and the pixels of the
    first frame with its wall.
    """
    first = readings[0]
    wall = first.answer.segmentation
    # the remark on the eye names the calibration as well
    own = (remark for remark in first.answer.remarks if remark != OF_POPULATION)
    return replace(
        first.answer,
        remarks=(*own, *first.remarks),
        segmentation=wall and replace(wall, pixels=first.frame.pixels),
    )


def _is_sequence(frame: Any) -> TypeGuard[Sequence[Moment]]:
    """Return whether moments are given, one after the other."""
    if not isinstance(frame, list | tuple) or not frame:
        return False
    moments = sum(isinstance(one, Moment) for one in frame)
    if 0 < moments < len(frame):
        raise InputError("frame: moments among frames; make each frame a Moment")
    return moments > 0


def _moment(frame: Any, mask: Mask | Sequence[Mask] | None) -> Moment:
    """Return what a caller gives to be read at once, with the masks of its frames."""
    masks = _list_of(mask)
    if isinstance(frame, Moment):
        if masks:
            raise InputError("mask: of a moment, each frame has its own; leave it out")
        return frame

    sources: Any = frame if _is_list(frame) else [frame]
    if masks and len(masks) != len(sources):
        raise InputError(
            f"mask: {len(masks)} for {len(sources)} frames; give one for each, in their"
            " order"
        )

    frames = [one if isinstance(one, Frame) else Frame(one) for one in sources]
    if masks and any(frame.mask is not None for frame in frames):
        raise stated_twice("mask", "frame")
    return Moment(
        tuple(
            replace(one, mask=drawn) for one, drawn in zip(frames, masks, strict=True)
        )
        if masks
        else tuple(frames)
    )


def _is_list(frame: Any) -> bool:
    """Return whether frames are given, and not the numbers of a frame in lists."""
    return isinstance(frame, list | tuple) and all(
        isinstance(one, Frame | str | PathLike | np.ndarray) for one in frame
    )


def _list_of(mask: Mask | Sequence[Mask] | None) -> list[Any]:
    if mask is None:
        return []
    return list(mask) if isinstance(mask, list | tuple) else [mask]


def evaluate(
    model: Reader | str | PathLike[str],
    recordings: Given | Sequence[Given],
    calibration: "Calibration | str | PathLike[str] | None" = None,
    *,
    progress: Progress | None = None,
) -> "Evaluation":
    """Read every frame of recordings and compare with their force logs.

    Args:
        model: of `load_model` or `train`, or its folder or name.
        recordings: one or more, opened or as folders.
        calibration: of `calibrate`, or its file: gives a reader the eyes' moduli; its
            frames are not scored.
        progress: called with 1 after each frame.

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
    # 12 ms: not to read single frames
    from scleraforce.calibration.evaluation import evaluate_recordings

    reader = opened_reader(model)
    each = opened_recordings(recordings)
    summary = None if calibration is None else summary_of_calibration(calibration)
    counting = counting_for(progress, "frames")
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
    drawn = drawn_mask(mask)
    check_mask_size(drawn, found.info.scan.shape, "mask")

    if author is not None and not author.isprintable():
        raise InputError(
            f"author: {author!r}: a line break or another unprintable character; give a"
            " name of one line"
        )

    write_wall(found.path, file, drawn, author or getpass.getuser(), utc_now())


def utc_now() -> str:
    """Return the time, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


class SequenceReader:
    """Reads moments with a model, as a caller declares the eye.

    Moments with a time follow each other: each is read with the memory of the earlier
    ones of its recording.
    """

    def __init__(
        self,
        model: Reader,
        given: Setup,
        calibration: "GivenCalibration | None" = None,
    ) -> None:
        check_calibrated(given, calibrated=calibration is not None)
        self.model = model
        self._given = given
        self._calibration = (
            None if calibration is None else summary_of_calibration(calibration)
        )
        self._eyes = dict[tuple[Path | None, Setup], EyeReader]()
        self._memories = dict[Path | None, Memory]()

    def in_time(
        self, moments: Sequence[Moment]
    ) -> Iterator[tuple[int, Moment, Sequence[Located]]]:
        """Yield moments in the order of their times, each with its place in the list
        and its files.

        Moments without a time have that of their recording, where several of it are
        read. A single one has none: what was before it is not known.
        """
        each = [
            [located(frame.pixels) for frame in moment.frames] for moment in moments
        ]
        followed = followed_recordings(files[0] for files in each)
        timed = [
            replace(moment, time_s=listed_time(files[0], followed))
            if moment.time_s is None
            else moment
            for moment, files in zip(moments, each, strict=True)
        ]
        for number in sorted(range(len(timed)), key=lambda n: timed[n].time_s or 0.0):
            yield number, timed[number], each[number]

    def read(
        self, moment: Moment, files: Sequence[Located] | None = None
    ) -> list[FrameReading]:
        """Read the frames of a moment together; return each answer with its inputs.
        `files`: the frames', where they have been located before.
        """
        given = self._given
        frames: Sequence[Located] = files or [
            located(frame.pixels) for frame in moment.frames
        ]
        planes = planes_of(moment, frames, given.scan.planes)
        if planes and given.needle.gap_m is not None:
            raise InputError("gap_m: several planes show their gaps; leave it out")

        opened = _opened_together(frames, given.scan, self.model)
        first = opened[0]
        stated = NOTHING_KNOWN if first.info is None else first.info.setup
        listed = given.completed_by(stated)
        eye = self._eye_of(frames[0], first, listed)
        needs_hold = eye.setup.eye.relaxation or eye.setup.eye.leak_time_s
        if moment.held_s is not None and needs_hold is None:
            way = "give a calibration, or relaxation in recording.toml"
            raise InputError(f"held_s: nothing says how the tissue relaxes; {way}")

        moment = _completed(moment, frames[0], given.eye)
        remarks = list(self._ignored_inputs())
        for file, one in zip(frames, opened, strict=True):
            code = "picture-read" if isinstance(file, RecordedFile) else "pixels-scaled"
            remarks += (Remark(code, note) for note in one.notes)

        now = eye.at(moment.iop_pa)
        about = _recording_of(frames[0]) or place_of(frames[0])
        remarks += (remark.on(about) for remark in now.remarks)
        thickness_m = eye.setup.eye.thickness_m
        read = list[MomentFrame]()

        with _faults_of_frame(frames[0]):
            for number, one in enumerate(opened):
                wall, of_wall = stated_wall(
                    one,
                    frames[number],
                    moment.frames[number],
                    given.scan,
                    thickness_m,
                    eye.model.finder,
                )
                plane = planes[number] if planes else None
                read.append(MomentFrame(one.pixels, plane, wall))
                remarks += (remark.on(place_of(frames[number])) for remark in of_wall)

            answers = self._answers(eye, frames[0], moment, tuple(read), first.scale)

        remarks = list(dict.fromkeys(remarks))  # planes may repeat one
        if self._calibration is not None and eye.setup.eye.name is not None:
            remarks += other_eye(answers[:1], self._calibration, eye.setup.eye.name)

        if moment.iop_pa is not None:
            listed = replace(listed, eye=replace(listed.eye, iop_pa=moment.iop_pa))
        return [
            FrameReading(
                answer,
                one,
                given,
                stated,
                listed,
                now.setup,
                tuple(remarks),
                frame.plane,
            )
            for answer, one, frame in zip(answers, opened, read, strict=True)
        ]

    def _ignored_inputs(self) -> tuple[Remark, ...]:
        """Return a remark on what the caller declares of an eye to a classifier."""
        modulus_pa = self.model.fixed_modulus_pa
        eye = replace(self._given.eye, name=None, thickness_m=None, thickness_sd_m=None)
        direction_rad = self._given.scan.direction_rad
        declared = Setup(
            eye=eye,
            needle=self._given.needle,
            scan=Scan(direction_rad=direction_rad),
        )
        is_ignored = self._calibration is not None or declared != NOTHING_KNOWN
        if modulus_pa is None or not is_ignored:
            return ()
        words = (
            "a classifier ignores the known inputs of an eye but its thickness; it"
            f" reads each as one of {from_si(modulus_pa, 'mpa'):g} MPa"
        )
        return (Remark("inputs-ignored", words),)

    def _eye_of(
        self, frame: Located, opened: OpenedFrame, declared: Setup
    ) -> EyeReader:
        """Return the reader of the eye of a frame: one of each recording, or of what is
        declared without one.
        """
        declared = replace(declared, scan=_scan_of(opened, declared.scan))
        key = _recording_of(frame), declared
        if key not in self._eyes:
            self._eyes[key] = EyeReader.of(self.model, declared, self._calibration)
        return self._eyes[key]

    def _answers(
        self,
        eye: EyeReader,
        frame: Located,
        moment: Moment,
        frames: tuple[MomentFrame, ...],
        scale: PixelScale,
    ) -> tuple[Answer, ...]:
        """Read a moment with the memory of its recording, and keep it."""
        entry = _entry_of(frame)
        opened = OpenedMoment(
            frames,
            scale,
            moment.time_s,
            moment.held_s,
            moment.iop_pa,
            moment.travel_m,
            None if entry is None else entry.pierced,
        )
        if moment.time_s is None:
            answers, _ = eye.read(opened, eye.start())
            return answers

        place = _recording_of(frame)
        before = self._memories.get(place) or eye.start()
        answers, self._memories[place] = eye.read(opened, before)
        return answers


def _scan_of(opened: OpenedFrame, declared: Scan) -> Scan:
    """Return a scan with the size and scale of a frame; the scale alone of one that is
    too small for any scanner, which is refused when it is read.
    """
    scan = replace(
        declared,
        width_m=opened.scan.width_m,
        depth_m=opened.scan.depth_m,
        refractive_index=opened.scan.refractive_index,
    )
    rows, columns = opened.pixels.shape
    try:
        return replace(scan, rows=rows, columns=columns)
    except StudyError:
        return scan


def followed_recordings(firsts: Iterable[Located]) -> frozenset[Path]:
    """Return the recordings of which several listed moments are read, by the first
    frame of each: these moments follow each other.
    """
    count = Counter(
        frame.recording
        for frame in firsts
        if isinstance(frame, RecordedFile) and frame.entry is not None
    )
    return frozenset(
        recording for recording, n in count.items() if recording is not None and n > 1
    )


def listed_time(frame: Located, followed: frozenset[Path]) -> float | None:
    """Return the time of a frame in a recording that is followed; None of others."""
    entry = _entry_of(frame)
    is_followed = entry is not None and _recording_of(frame) in followed
    return entry.time_s if entry is not None and is_followed else None


def _entry_of(frame: Located) -> FrameEntry | None:
    return frame.entry if isinstance(frame, RecordedFile) else None


def _recording_of(frame: Located) -> Path | None:
    return frame.recording if isinstance(frame, RecordedFile) else None


def _completed(moment: Moment, frame: Located, declared: Eye) -> Moment:
    """Return a moment with what frames.csv states of it; a declared pressure takes
    precedence.
    """
    entry = _entry_of(frame)
    if entry is None:
        return moment

    iop_pa = entry.iop_pa if declared.iop_pa is None else None
    return replace(
        moment,
        held_s=entry.held_s if moment.held_s is None else moment.held_s,
        travel_m=entry.travel_m if moment.travel_m is None else moment.travel_m,
        iop_pa=iop_pa if moment.iop_pa is None else moment.iop_pa,
    )


def _opened_together(
    frames: Sequence[Located], given: Scan, model: Reader
) -> list[OpenedFrame]:
    """Return the frames of a moment in memory; raises `InputError` unless they have one
    size and scale, and different pixels.
    """
    assumed = Scan(refractive_index=model.study.oct.refractive_index)
    opened = [opened_frame(one, given, assumed, "model's study") for one in frames]
    first = opened[0]

    if any(
        (one.scale, one.pixels.shape) != (first.scale, first.pixels.shape)
        for one in opened
    ):
        raise InputError(
            "frame: of several sizes or scales; planes that are read together have one"
        )
    if (
        len(opened) > 1
        and np.ptp(first.pixels)
        and len({frame_digest(one.pixels) for one in opened}) < len(opened)
    ):
        raise InputError("frame: one picture for two planes; give the frame of each")

    return opened


def check_calibrated(given: Setup, *, calibrated: bool) -> None:
    """Check that a calibration and the given values do not state the same quantity."""
    eye = given.eye
    if not calibrated:
        return
    if eye.modulus is not None:
        raise InputError(
            "youngs_modulus_pa: the calibration gives the modulus; leave out one of"
            " the two"
        )
    if eye.stiffening is not None:
        raise InputError(
            "stiffening: the calibration gives the stiffening; leave out one of the two"
        )


def summary_of_calibration(calibration: "GivenCalibration") -> CalibrationSummary:
    """Return the summary of a calibration, or of its file, that models read."""
    if isinstance(calibration, CalibrationSummary):
        return calibration
    if isinstance(calibration, str | PathLike):
        return read_calibration(calibration)
    if not hasattr(calibration, "to_dict"):
        raise InputError(
            f"calibration: found {type(calibration).__name__}; give what `calibrate`"
            " returns, or its file"
        )

    file = calibration_file.CalibrationFile("the calibration", calibration.to_dict())
    return calibration_file.summary_of(file)


def opened_recordings(given: Given | Sequence[Given]) -> list[Recording]:
    """Return recordings; read folders."""
    each = [given] if isinstance(given, Recording | str | PathLike) else list(given)
    if not each:
        raise InputError("recordings: none; give at least one")

    return [
        entry if isinstance(entry, Recording) else read_recording(entry)
        for entry in each
    ]
