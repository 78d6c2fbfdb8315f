"""A laboratory's frames and force log as a recording folder."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from math import degrees
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import folder_when_whole
from scleraforce.front.api.progress import Counting, Progress, counting_for
from scleraforce.front.api.shorthand import (
    SetupShorthand,
    declared_setup,
    with_values,
)
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.reading.trained_ranges import limit_remarks
from scleraforce.recordings import import_answers
from scleraforce.recordings.clock_offsets import MOST_FRAMES
from scleraforce.recordings.force_errors import label_sds
from scleraforce.recordings.forces_under_frames import (
    label_frames,
    labels_n,
    unit_fault,
    unsure_remark,
)
from scleraforce.recordings.formats.picture_streams import (
    GreyMap,
    PictureSource,
    UnansweredError,
    find_greys,
)
from scleraforce.recordings.import_answers import (
    Asker,
    LikeRecording,
    PreparedImport,
    read_like,
)
from scleraforce.recordings.import_record import IMPORT_RECORD
from scleraforce.recordings.import_sources import (
    OPTION,
    GatheredSources,
    ImportOptions,
    gather_sources,
)
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.recordings.recording_writer import (
    RecordingWriter,
    frame_files,
    read_written,
    write_log,
)
from scleraforce.recordings.source_files import files_of
from scleraforce.records.eye import FOUND_BY_CALIBRATION, Eye
from scleraforce.records.frame import Pixels
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.model_folder import SHIPPED_READER, SHIPPED_WALL_FINDER
from scleraforce.records.needle import (
    Needle,
    gauge_diameter_m,
    is_gauge,
    one_lean,
)
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale, Plane, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import ClassesStudy
from scleraforce.records.study_of_eye import relaxation_text
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import dent_measures, surface_places

PREVIEW = "preview.png"
# frames, from the first: of an eye that the needle does not dent yet, as a rule
LOOKED_AT = 5


@dataclass(frozen=True, kw_only=True)
class ImportSettings:
    """How sources are read; None: they state it, or do not need it.

    Attributes:
        axes: their order in an array or volume, like "frame,depth,lateral".
        flip: "rows" of pictures that are upside down, "columns" of mirrored ones.
        array: its name in a .npz.
        first_frame: that is imported, counted from 1; `times` and `rate_hz` are of the
            frames that are.
        last_frame: that is imported.
        grey_range: pixel values that become black and white.
        planes: that the scanner took at once, one for each of the sources (None: a
            force log). The n-th frames of all planes are of one moment; the gap is then
            found, not given.
        rate_hz: frames taken in a second.
        times: table of the frames' times, by the names of files or in their order.
        frames_by: what orders and times frames in files of their own: "numbers" in
            their names (or DICOM's), of which a missing one is a missing frame at
            `rate_hz`; "times" in their names, also in a unit like "times:ms"; or
            "order", evenly spaced as they are listed.
        clock_offset_s: force log's clock minus the frames' clock; "auto", and None
            unless one bag has both: found from the dents, and refused if these leave
            it open. 0 says that both share one clock.
        columns: of a force log, like "time=Clock:ms" and "fz=Pull:mN".
        axis: of the force sensor along the needle: "fx", "fy" or "fz".
        contact_sign: of that axis in contact: 1 or -1.
        average_s: time over which a label averages.
        range_n: largest force that the sensor measures; larger readings are none.
        image_topic: of a ROS bag, where there are several.
        force_topic: of a ROS bag, where there are several.
        by_arrival: take the times at which a bag's messages arrived, where they have no
            capture stamp.

    >>> import scleraforce as sf
    >>> sf.ImportSettings(rate_hz=20.0, clock_offset_s=0.0).rate_hz
    20.0
    """

    axes: str | None = None
    flip: Literal["rows", "columns"] | None = None
    array: str | None = None
    first_frame: int | None = None
    last_frame: int | None = None
    grey_range: tuple[float, float] | None = None
    planes: Sequence[Plane | None] = ()
    rate_hz: float | None = None
    times: str | PathLike[str] | None = None
    frames_by: str | None = None
    clock_offset_s: float | Literal["auto"] | None = None
    columns: Sequence[str] = ()
    axis: str | None = None
    contact_sign: int | None = None
    average_s: float | None = None
    range_n: float | None = None
    image_topic: str | None = None
    force_topic: str | None = None
    by_arrival: bool = False

    def __post_init__(self) -> None:
        if self.flip not in (None, "rows", "columns"):
            raise InputError(f"flip: {self.flip!r}; give 'rows' or 'columns'")
        for name in ("first_frame", "last_frame"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise InputError(f"{name}: {number}; frames are counted from 1")


class ImportShorthand(SetupShorthand, total=False):
    """Fields of an eye, a needle (by its gauge) and a scan, and those of
    `ImportSettings` that most sources need.
    """

    gauge: int | None
    bits: int | None
    rate_hz: float | None
    times: str | PathLike[str] | None
    clock_offset_s: float | Literal["auto"] | None
    columns: Sequence[str]
    axis: str | None
    contact_sign: int | None


OF_SETTINGS = ("rate_hz", "times", "clock_offset_s", "columns", "axis", "contact_sign")


def import_recording(
    sources: str | PathLike[str] | Sequence[str | PathLike[str]],
    out: str | PathLike[str],
    *,
    like: str | PathLike[str] | None = None,
    eye: Eye | str | None = None,
    needle: Needle | None = None,
    scan: Scan | None = None,
    settings: ImportSettings | None = None,
    progress: Progress | None = None,
    **short: Unpack[ImportShorthand],
) -> Recording:
    """Write frames and force log of other programs as a recording folder
    (docs/formats.md lists what is read).

    Nothing is assumed: give what the sources do not state; the error names all that is
    missing. Look at `preview.png` in the folder; its `import.json` says where each
    value comes from.

    Args:
        sources: images, stacks, volumes, films, ROS bags, a force log, or folders of
            images.
        out: the folder to make.
        like: another recording, whose scanner, needle, sensor and form of the sources
            hold where the sources state none. A remark names the keys of its
            recording.toml on its eye and contact, which are not copied.
        eye: what was measured of the eye, with its name, or the name alone.
        needle: its diameter and gap; contact and lean where they are known.
        scan: width, depth, refractive index (1 if the scanner has corrected it) and
            used bits of the frames; direction and tilt where they are known.
        settings: how the sources are read.
        progress: called with 1 after each frame that is written.
        short: `thickness_m`, `iop_pa`, `globe` of the eye, `gauge` and `gap_m` of the
            needle, `width_m`, `depth_m`, `refractive_index`, `bits` of the scan, and
            `rate_hz`, `times`, `clock_offset_s`, `columns`, `axis`, `contact_sign` of
            the settings, in place of these records.

    Raises:
        InputError: a source cannot be read, something is missing or has nothing to act
            on, or `out` exists.

    >>> import scleraforce as sf
    >>> frames = [f"eye-a/frames/000{nth}.png" for nth in range(1, 4)]
    >>> recording = sf.import_recording(
    ...     frames, "eye-b", like="eye-a", eye="b", rate_hz=0.5
    ... )
    >>> [(frame.file, frame.time_s) for frame in recording.frames]
    [('0001.png', 0.0), ('0002.png', 2.0), ('0003.png', 4.0)]
    """
    options: dict[str, Any] = dict(short)
    of_settings = {name: options.pop(name) for name in OF_SETTINGS if name in options}
    settings = with_values(settings or ImportSettings(), of_settings, "settings")
    gauge = options.pop("gauge", None)
    diameter_m = None if gauge is None else gauge_diameter_m(gauge)
    needle = with_values(needle or Needle(), {"diameter_m": diameter_m}, "needle")
    bits = {"bits": options.pop("bits", None)}
    scan = with_values(scan or Scan(), bits, "scan")
    declared = declared_setup(eye, needle, scan, options)
    given = _options_of(declared, settings)
    planes = settings.planes
    paths = [
        Path(path)
        for path in ([sources] if isinstance(sources, str | PathLike) else sources)
    ]

    try:
        if not paths:
            raise InputError("sources: none; give at least one")
        if planes and len(planes) != len(paths):
            raise InputError(
                f"planes: {len(planes)} for {len(paths)} sources; give one for each, or"
                " None for a log"
            )

        other = None if like is None else read_like(Path(like))
        others = {} if other is None else other.answers
        answers = ImportOptions(**(others | given))
        origins = dict.fromkeys(others, f"like {like}") | dict.fromkeys(given, OPTION)
        request = ImportRequest(
            sources=paths,
            out=Path(out),
            answers=answers,
            origins=origins,
            planes=planes,
            declared=declared,
            like=other,
        )
        write_imported(request, counting_for(progress, "frames"))
    except UnansweredError as fault:
        if not fault.forms:
            raise

        forms = ", ".join(map(repr, fault.forms))
        raise InputError(f"{fault.question}; give columns=[{forms}]") from fault

    return read_recording(out)


def _options_of(setup: Setup, settings: ImportSettings) -> dict[str, Any]:
    """Return the answers that records give, by the names of `ImportOptions`; raises
    `InputError` for a value that a recording does not state.
    """
    eye = setup.eye
    needle = setup.needle
    scan = setup.scan
    for name in FOUND_BY_CALIBRATION:
        if getattr(eye, name) is not None:
            raise InputError(f"{name}: no recording states it; leave it out")
    for name in ("rows", "columns"):
        if getattr(scan, name) is not None:
            raise InputError(f"{name}: the frames show it; leave it out")
    if scan.planes:
        raise InputError("planes: of a scan; give settings.planes, one for each source")
    if scan.transposed:
        raise InputError("transposed: give settings.axes or settings.flip")
    if needle.azimuth_rad is not None:
        raise InputError("azimuth_rad: no recording states it; leave it out")
    if needle.lean_rad is not None and one_lean(needle.lean_rad) is None:
        raise InputError("lean_rad: a recording states one angle; give two equal ends")
    if needle.diameter_m is not None and not is_gauge(needle.diameter_m):
        raise InputError(
            f"diameter_m: {needle.diameter_m:g}; a recording states the gauge, and this"
            f" is none: {needle.gauge} gauge is"
            f" {gauge_diameter_m(needle.gauge or 0):g} m"
        )

    terms = None if eye.relaxation is None else eye.relaxation.terms
    given = {
        **{name: getattr(settings, name) for name in _SETTINGS},
        "times": None if settings.times is None else Path(settings.times),
        "columns": tuple(settings.columns) or None,
        "by_arrival": settings.by_arrival or None,
        "eye": eye.name,
        "thickness_um": from_si(eye.thickness_m, "um"),
        "iop_mmhg": from_si(eye.iop_pa, "mmhg"),
        "globe": None if eye.globe is None else eye.globe.kind,
        "relaxation": None if terms is None else relaxation_text(terms),
        "gauge": needle.gauge,
        "gap_mm": from_si(needle.gap_m, "mm"),
        "polar_angle_deg": (
            None if needle.polar_rad is None else degrees(needle.polar_rad)
        ),
        "width_mm": from_si(scan.width_m, "mm"),
        "depth_mm": from_si(scan.depth_m, "mm"),
        "refractive_index": scan.refractive_index,
        "bits": scan.bits,
    }
    return {name: value for name, value in given.items() if value is not None}


_SETTINGS = (
    "axes",
    "flip",
    "array",
    "first_frame",
    "last_frame",
    "grey_range",
    "rate_hz",
    "frames_by",
    "clock_offset_s",
    "axis",
    "contact_sign",
    "average_s",
    "range_n",
    "image_topic",
    "force_topic",
)


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    """What is imported, and to where.

    `origins` say where each of the answers is from. Of several `planes` there is one
    for each source. `declared` has what the answers leave out, as uncertainties.
    The answers of a recording `like` this one are among `answers` already, but for what
    orders frames, which only their files can tell.
    """

    sources: Sequence[Path]
    out: Path
    answers: ImportOptions
    origins: Mapping[str, str]
    planes: Sequence[Plane | None] = ()
    declared: Setup = NOTHING_KNOWN
    like: LikeRecording | None = None


def write_imported(
    request: ImportRequest,
    counting: Counting,
    asker: Asker | None = None,
    model: Path = SHIPPED_READER,
) -> PreparedImport:
    """Write a recording folder, whole or not at all; counts "sources", "grey levels",
    "frames". `asker`: asks for what is missing; None: that is an error. `model`:
    remarks say what it could not read.
    """
    out = request.out
    if out.exists() or out.is_symlink():
        raise InputError(f"{out}: exists already; remove it or choose another `out`")

    with folder_when_whole(out) as part:
        gathered, answers = _gathered(
            request.sources,
            request.answers,
            counting,
            asker,
            request.planes,
            request.like,
        )
        scan = gathered.frames

        with counting("grey levels", len(scan.names)) as advance:
            greys = find_greys(
                _counted(scan.pictures(), advance), answers.grey_range, scan.names[0]
            )

        done = import_answers.complete_import(
            gathered,
            greys,
            answers,
            request.origins,
            asker,
            import_answers.PictureMeasures(
                partial(_wall_um, scan, greys), partial(_dents, gathered.scan, greys)
            ),
        )
        declared = request.declared
        like = request.like
        if like is not None:
            declared = declared.completed_by(like.declared)
        done = done.declaring(declared)
        if like is not None:
            done = done.with_remarks(like.not_copied(done.info))

        missing = missing_inputs(done.info.setup, forces=done.log is not None)
        done = done.with_remarks((*missing, *limit_remarks(model, done.info)))
        comment = (
            f"imported by scleraforce {__version__}; import.json names the sources"
        )

        with (
            counting("frames", len(scan.names)) as advance,
            closing(
                RecordingWriter(
                    part, done.info, comment, ("plane",) if gathered.planes else ()
                )
            ) as to,
        ):
            times_s = done.times.time_s.tolist()
            places: list[tuple[float, tuple[str, ...]]] = [
                (times_s[moment], (plane.name,)) for moment, plane in gathered.places
            ] or [(time_s, ()) for time_s in times_s]
            entries = zip(frame_files(scan.names), places, strict=True)

            for (file, (time_s, more)), picture in zip(
                entries, _counted(scan.pictures(), advance), strict=True
            ):
                to.add(file, time_s, greys.counts(picture), more)

        if done.log is not None:
            write_log(part, done.log)

        recording = read_written(part, out)
        if (
            fault := unit_fault(recording, labels_n(recording), ClassesStudy())
        ) is not None:
            path = next(path for path, kind in gathered.files if kind in ("log", "bag"))
            read = (
                ", ".join(column.answer() for column in gathered.columns)
                or "forces of a bag are in N"
            )
            raise InputError(
                f"{path}: {fault}; read as {read}: check the unit (`columns`, for a log"
                " of text)"
            )

        done = done.with_remarks(_label_remarks(recording))
        (part / IMPORT_RECORD).write_text(
            import_answers.record_text(done, answers, __version__), encoding="utf-8"
        )

        # 300 ms: Matplotlib, not for the app and imports that are refused
        from scleraforce.front.report.figure_files import write_figure
        from scleraforce.front.report.recording_figures import draw_recording

        write_figure(draw_recording(recording), recording.path / PREVIEW)

    return done


def import_result(done: PreparedImport, out: Path) -> dict[str, Any]:
    """Return what an import to `out` wrote, as `scleraforce import` prints it as
    JSON.
    """
    scan = done.info.scan
    return {
        "recording": str(out),
        "preview": str(out / PREVIEW),
        "frames": len(done.gathered.frames.names),
        "force_samples": None if done.log is None else len(done.log.time_s),
        "width_mm": from_si(scan.width_m, "mm"),
        "depth_mm": from_si(scan.depth_m, "mm"),
        "refractive_index": scan.refractive_index,
        "bits": scan.bits,
        **import_answers.provenance(done),
    }


def _gathered(
    sources: Sequence[Path],
    answers: ImportOptions,
    counting: Counting,
    asker: Asker | None,
    planes: Sequence[Plane | None],
    like: LikeRecording | None,
) -> tuple[GatheredSources, ImportOptions]:
    """Read the sources, asking until they leave nothing open; an answer that they
    contradict is asked for again.
    """
    usual = None if like is None else like.frames_by
    last: tuple[ImportOptions, UnansweredError] | None = None
    while True:
        try:
            with counting("sources", len(files_of(sources))) as seen:
                gathered = gather_sources(sources, answers, seen, planes, usual)
                return gathered, replace(answers, frames_by=gathered.frames_by)
        except UnansweredError as open_point:
            if asker is None:
                raise

            last = answers, open_point
        except InputError as fault:
            if last is None or asker is None:
                raise

            asker.again(fault)

        answers = asker.settle(*last)


def _wall_um(scan: PictureSource, greys: GreyMap, shape: Scan) -> float | None:
    """Return the median thickness of the wall in the first frames, um; None where none
    of them shows it.
    """
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    scale = shape.scale
    found = [
        find_wall(greys.counts(picture), scale, finder=finder)
        for picture in islice(scan.pictures(), LOOKED_AT)
    ]
    thickness_m = [
        wall.thickness_m
        for wall in found
        if wall.usable and wall.thickness_m is not None
    ]
    seen_m = [value for value in thickness_m if np.isfinite(value)]

    return round(from_si(float(np.median(seen_m)), "um")) if seen_m else None


def _label_remarks(recording: Recording) -> tuple[Remark, ...]:
    """Return a remark if the labels of a recording are not sure."""
    try:
        trials = label_frames(recording, ClassesStudy())
    except RecordingError:  # which later commands report
        return ()

    sds_n = [sd_n for sd_n in label_sds(recording, trials) if sd_n is not None]
    return unsure_remark(sds_n, ClassesStudy())


def _dents(scan: PictureSource, greys: GreyMap, scanner: Scan) -> Floats:
    """Return measures of the dent in evenly chosen frames, (measure, frame); NaN in
    others, and where no wall is seen.
    """
    count = len(scan.names)
    chosen = np.linspace(0, count - 1, min(count, MOST_FRAMES)).astype(np.intp)
    wanted = set(chosen.tolist())
    scale = scanner.scale
    dents = np.full((2, count), np.nan)

    for index, picture in enumerate(scan.pictures()):
        if index in wanted:
            dents[:, index] = picture_dents(greys.counts(picture), scale)

    return dents


def picture_dents(counts: Pixels, scale: PixelScale) -> tuple[float, float]:
    """Return measures of the dent in a frame (row, column); NaN without a wall."""
    try:
        wall = find_wall(counts, scale)
    except (FrameError, ValueError):  # an empty, damaged or tiny frame
        return float("nan"), float("nan")
    if not wall.usable:
        return float("nan"), float("nan")
    return dent_measures(*surface_places(wall, scale))


def _counted(
    pictures: Iterator[NDArray[Any]], advance: Callable[[int], None]
) -> Iterator[NDArray[np.generic]]:
    for picture in pictures:
        yield picture
        advance(1)
