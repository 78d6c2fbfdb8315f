"""`scleraforce segment` and `read`: the wall and the force in single frames."""

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import cv2
import numpy as np

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import KINDS, read_bytes, renamed_when_whole
from scleraforce.front.cli.options import (
    EYE,
    FRAME_SIZE,
    LEAN_DEFAULT,
    MODEL,
    PATH,
    PLANE,
    PlacedPlane,
    declared_eye,
    options,
    planes_of,
)
from scleraforce.front.cli.output import (
    Command,
    Report,
    each_of,
    is_json,
    progress_bar,
    say,
    wrapped,
)
from scleraforce.recordings import recording_folder
from scleraforce.recordings.recording_folder import RecordedFile
from scleraforce.recordings.source_files import files_of
from scleraforce.records.frame import OpenedFrame, Pixels
from scleraforce.records.model_folder import model_name
from scleraforce.records.scan import Plane, Scan, check_frame_counts
from scleraforce.records.setup import Setup
from scleraforce.records.study import OctStudy
from scleraforce.wall.needle_in_frame import needle_entry
from scleraforce.wall.wall import Segmentation, draw_overlay

if TYPE_CHECKING:  # with ONNX Runtime and Numba
    from scleraforce.front.api.reading_frames import FrameReading
    from scleraforce.reading.answer import Answer

MomentFiles = tuple[RecordedFile, ...]
SegmentFile = Callable[[Path], tuple[OpenedFrame, Segmentation]]
Value = float | str | None
# Places of the needle that `read` prints, with their units.
PLACES = {"contact_mm": " mm", "dent_mm": " mm", "gap_mm": " mm", "lean_deg": "°"}
# The known inputs that `read` prints: their names and units for people, and the value
# of an eye in the unit of the key.
KNOWN: Mapping[str, tuple[str, str, Callable[[Setup], Value]]] = {
    "youngs_modulus_mpa": (
        "modulus",
        " MPa",
        lambda eye: from_si(
            eye.eye.modulus.mean_pa if eye.eye.modulus else None, "mpa"
        ),
    ),
    "iop_mmhg": ("IOP", " mmHg", lambda eye: from_si(eye.eye.iop_pa, "mmhg")),
    "thickness_um": (
        "thickness",
        " µm",
        lambda eye: from_si(eye.eye.thickness_m, "um"),
    ),
    "gap_mm": ("gap", " mm", lambda eye: from_si(eye.needle.gap_m, "mm")),
    "polar_angle_deg": (
        "polar angle",
        "°",
        lambda eye: from_si(eye.needle.polar_rad, "deg"),
    ),
    "plane_direction_deg": (
        "plane's direction",
        "°",
        lambda eye: from_si(eye.scan.direction_rad, "deg"),
    ),
    "lean_deg": (
        "lean",
        "°",
        lambda eye: from_si(
            eye.eye.calibrated_lean_rad
            if eye.needle.lean_rad is None
            else sum(eye.needle.lean_rad) / 2,
            "deg",
        ),
    ),
    "stiffening": ("stiffening", "", lambda eye: eye.eye.stiffening),
    "globe": (
        "globe",
        "",
        lambda eye: None if eye.eye.globe is None else eye.eye.globe.kind,
    ),
    "rigidity_mmhg13_per_ul": (
        "k",
        " mmHg^(1/3)/µl",
        lambda eye: from_si(
            eye.eye.globe.mean
            if eye.eye.globe and eye.eye.globe.rigidity_told
            else None,
            "mmhg13_per_ul",
        ),
    ),
}
ONLY_IF_KNOWN = ("lean_deg", "stiffening", "rigidity_mmhg13_per_ul")
# endings of the images in a folder that is not a recording
IMAGES = (
    ".png",
    ".tif",
    ".tiff",
    ".jpg",
    ".jpeg",
    ".dcm",
)
GUESS = ".guess.png"
OVERLAY = ".overlay.png"
# endings of the pictures that `segment` may write for a frame
ENDINGS = (
    ".png",
    GUESS,
    OVERLAY,
    ".guess.overlay.png",
)


@click.command(cls=Command)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the masks.",
)
@options(*FRAME_SIZE)
@click.option(
    "--overlay",
    is_flag=True,
    help="Write NAME.overlay.png too: the boundaries drawn on the frame.",
)
@options("sheet", "wall_finder", "force", force="Replace masks that exist.")
@click.option(
    "--strict", is_flag=True, help="Exit with code 3 if a frame is not usable."
)
def segment(
    frames: tuple[Path, ...],
    out: Path | None,
    transpose: bool,
    overlay: bool,
    sheet: Path | None,
    wall_finder: Path | None,
    force: bool,
    strict: bool,
    **size: float | None,
) -> Report:
    """Find the wall in raw frames (PNG, TIFF, JPEG, DICOM) or recordings.

    Writes a mask for each frame, of the same size and name (.png): 255 is
    wall, from the tissue's surface to the inner boundary, or to 1 mm below the
    surface where that boundary cannot be seen. Frames of several recordings go
    into a folder for each. If the size of a frame is not stated, 15 x 4 mm is
    assumed, and a note says so.

    Two methods find the wall and check each other: edge detection, and a
    network trained on drawn scenes. A frame is not usable if they differ by
    more than their uncertainties allow; its mask is NAME.guess.png, never
    NAME.png.

    FRAME may be a recording, or a folder of images.

    Examples: scleraforce segment recordings/eye-1 --out masks --overlay

    scleraforce segment my-scans --sheet sheet.png
    """
    # 180 ms: Numba and the models, not for --help
    from scleraforce.front.api import opened_frames, reading_frames

    if out is None and (overlay or sheet is None):
        raise click.UsageError(
            "--out is missing: the folder for masks and overlays; only a --sheet needs"
            " none"
        )
    if sheet is not None and wall_finder is None:
        raise click.UsageError(
            "--sheet shows how two methods differ; with --wall-finder none there is"
            " only one"
        )

    usual = OctStudy()
    finder = opened_frames.finder_of(wall_finder)
    masks = _masks(frames, out, sheet)
    assumed = Scan(
        width_m=usual.width_m,
        depth_m=usual.depth_m,
        refractive_index=usual.refractive_index,
    )
    segment_file = partial(
        reading_frames.segmented_frame,
        given=Scan(transposed=transpose, **size),  # type: ignore[arg-type]  # sizes
        assumed=assumed,
        finder=finder,
    )
    found = list(
        each_of(
            masks,
            lambda frame: _segment_frame(
                frame, masks[frame], segment_file, transpose, overlay, force
            ),
        )
    )
    entries: list[dict[str, Any]] = [
        (
            {"file": str(frame), "mask": None, "usable": False, "error": str(one)}
            if isinstance(one, InputError)
            else one
        )
        for frame, one in found
    ]
    segmented = [one for one in entries if "error" not in one]
    lines = [
        *map(_wall_line, segmented),
        *(wrapped(note, "note: ") for one in segmented for note in one["notes"]),
        *(wrapped(words, "note: ") for words in _assumed(segmented)),
    ]
    faults = [one for _, one in found if isinstance(one, InputError)]
    unusable = sum(not one["usable"] for one in entries)

    if segmented and sheet is not None:
        _write_sheet(sheet, segmented, segment_file)
        lines.append(f"wrote {sheet}")

    if segmented:
        lines.append(f"{unusable} of {len(entries)} frames are not usable")

    result = {"out": out and str(out), "sheet": sheet and str(sheet), "frames": entries}
    return Report(result, lines, faults, code=3 if strict and unusable else 0)


def _masks(
    given: Sequence[Path], out: Path | None, sheet: Path | None
) -> dict[Path, Path | None]:
    """Return the frames and their masks; raises `InputError` if two pictures could have
    the same name.
    """
    found = [pair for path in given for pair in _frames_of(path)]
    recordings = {
        recording.resolve() for _, recording in found if recording is not None
    }
    frames = {frame.resolve() for frame, _ in found}
    taken = {} if sheet is None else {sheet.resolve(): "the sheet"}

    if out is None:
        return {frame: None for frame, _ in found}

    masks: dict[Path, Path | None] = {}
    for frame, recording in found:
        folder = (
            out / recording.resolve().name
            if recording is not None and len(recordings) > 1
            else out
        )
        mask = masks[frame] = folder / f"{frame.stem}.png"

        for picture in map(mask.with_suffix, ENDINGS):
            place = picture.resolve()
            if place in taken:
                raise InputError(
                    f"{frame}: its mask would be {picture}, which is {taken[place]};"
                    " use two folders"
                )
            if place in frames:
                raise InputError(
                    f"--out: the mask {picture} would replace a frame; choose another"
                    " folder"
                )

            taken[place] = f"that of {frame}"

    return masks


def _frames_of(path: Path) -> list[tuple[Path, Path | None]]:
    """Return the frames of a recording, of a folder of images, or the one at a path,
    with their recording.
    """
    if not os.path.isdir(path):
        return [(path, recording_folder.recording_of(path))]
    if (path / "recording.toml").exists():
        recording = recording_folder.read_recording(path)
        return [(recording.frame_path(entry), path) for entry in recording.frames]

    images = [file for file in files_of([path]) if file.suffix.lower() in IMAGES]
    if not images:
        raise InputError(
            f"{path}: neither a recording.toml nor images ({', '.join(IMAGES)}) in this"
            " folder"
        )

    return [(file, recording_folder.recording_of(file)) for file in images]


def _segment_frame(
    path: Path,
    mask: Path | None,
    segment_file: SegmentFile,
    transpose: bool,
    overlay: bool,
    force: bool,
) -> dict[str, Any]:
    frame, found = segment_file(path)
    if mask is not None:
        mask, other = (
            (mask, mask.with_suffix(GUESS))
            if found.usable
            else (mask.with_suffix(GUESS), mask)
        )
        pictures = {
            ".png": found.mask,
            **({OVERLAY: draw_overlay(frame.pixels, found)} if overlay else {}),
        }

        for ending, picture in pictures.items():
            upright = picture.swapaxes(0, 1) if transpose else picture
            _write(
                mask.with_suffix(ending),
                (other, other.with_suffix(OVERLAY)),
                upright,
                force,
            )

    return {
        "file": str(path),
        "mask": mask and str(mask),
        "usable": found.usable,
        "reason": found.reason,
        "disagreement": None if found.methods is None else found.methods.disagreement,
        "inner_found": found.inner_found,
        "thickness_um": (
            None if isnan(found.thickness_m) else from_si(found.thickness_m, "um")
        ),
        "needle": needle_entry(found.needle),
        "conjunctiva_um": from_si(found.conjunctiva_m, "um"),
        "scale": _scale_entry(frame),
        "notes": list(frame.notes),
    }


def _write(path: Path, others: Sequence[Path], picture: Pixels, force: bool) -> None:
    """Write a picture under the name for its verdict; `others`, of the other verdict,
    never exist at the same time.
    """
    data = cv2.imencode(".png", np.ascontiguousarray(picture))[1].tobytes()
    for one in (path, *others):
        if not force and one.exists() and read_bytes(one, KINDS["frame"]) != data:
            raise InputError(
                f"{one}: exists already and differs; choose another --out, or --force"
                " to replace it"
            )

    path.parent.mkdir(parents=True, exist_ok=True)
    with renamed_when_whole(path) as part:
        part.write_bytes(data)
        for other in others:
            other.unlink(missing_ok=True)


def _write_sheet(
    sheet: Path, entries: Sequence[Mapping[str, Any]], segment_file: SegmentFile
) -> None:
    """Draw frames with the walls of both methods, which are found again: all pictures
    need not be kept.
    """
    # 520 ms: Matplotlib, not without --sheet
    from scleraforce.front.report.figure_files import write_figure
    from scleraforce.front.report.frame_figures import (
        MOST,
        WORST,
        draw_sheet,
        sheet_frame,
        shown_on_sheet,
    )

    numbers = shown_on_sheet(
        [(not one["usable"], one["disagreement"] or 0.0) for one in entries]
    )
    paths = [Path(entries[number]["file"]) for number in numbers]
    base = os.path.commonpath([path.absolute().parent for path in paths])
    frames = [
        sheet_frame(os.path.relpath(path, base), *segment_file(path))
        for path in progress_bar(paths, "sheet")
    ]
    title = f"{len(entries)} frames, {sum(one['usable'] for one in entries)} usable"
    note = ""

    if len(frames) < len(entries):
        note = f"Shown: the {WORST} worst and {MOST - WORST} of the others."
        say(f"{sheet}: {note}", err=True)

    write_figure(draw_sheet(frames, title, note), sheet)


def _wall_line(entry: Mapping[str, Any]) -> str:
    if not entry["usable"]:
        return f"{entry['file']}: not usable: {entry['reason']}"
    if entry["thickness_um"] is None:
        return (
            f"{entry['file']}: inner boundary not seen; the mask ends 1 mm below the"
            " surface"
        )

    guess = (
        ""
        if entry["inner_found"]
        else "; the network estimated the inner boundary, which is not visible"
    )
    return f"{entry['file']}: wall of {entry['thickness_um']:.0f} µm{guess}"


def _assumed(entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    scanner = OctStudy()
    taken = {
        "width_mm": (
            f"width (taken as {from_si(scanner.width_m, 'mm'):g} mm; give --width-mm)"
        ),
        "depth_mm": (
            f"depth (taken as {from_si(scanner.depth_m, 'mm'):g} mm; give --depth-mm)"
        ),
        "refractive_index": (
            f"refractive index (taken as {scanner.refractive_index:g}; give"
            " --refractive-index)"
        ),
    }
    missing = Counter(
        tuple(
            words
            for key, words in taken.items()
            if entry["scale"][key]["source"] == "assumed"
        )
        for entry in entries
    )

    for words, count in missing.items():
        if words:
            yield (
                f"of {count} of {len(entries)} frames nothing states the"
                f" {', the '.join(words)}"
            )


@click.command(cls=Command)
@click.argument("model", type=MODEL)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@options(*FRAME_SIZE)
@options(
    *EYE,
    default="unknown",
    stiffening="the calibration's, else 0 (no stiffening)",
    globe="unknown, which widens intervals",
    lean_rad=LEAN_DEFAULT,
)
@options(
    "calibration",
    calibration=(
        "File of `calibrate`: gives the modulus of the eye, or of the population."
    ),
)
@click.option(
    "--eye", help="Name of the eye in the calibration; default: the recording's."
)
@click.option(
    "--held-s",
    type=click.FloatRange(0.0),
    help=(
        "Time since the needle's push, in tissue that relaxes; "
        "default: as in the frames of the calibration."
    ),
)
@click.option(
    "--plane",
    "planes",
    cls=PlacedPlane,
    metavar=PLANE,
    multiple=True,
    help=(
        "Plane of the frames that follow: its distance from the scanner's axis, and the"
        " direction of its columns. The n-th frames of all planes are read together."
    ),
)
@click.option(
    "--mask",
    "masks",
    multiple=True,
    type=PATH,
    help=(
        "Picture of the wall in place of the one that is found: 255 wall, 0 none, 128"
        " column not judged. Give one for each frame, in their order."
    ),
)
@click.option(
    "--mask-sd-rows",
    type=click.FloatRange(0.0, min_open=True),
    help="Standard deviation of the mask's boundaries, rows; default: 2.",
)
@options("wall_finder")
def read(
    model: Path,
    frames: tuple[Path, ...],
    planes: tuple[tuple[int, str], ...],
    transpose: bool,
    calibration: Path | None,
    eye: str | None,
    held_s: float | None,
    masks: tuple[Path, ...],
    mask_sd_rows: float | None,
    wall_finder: Path | None,
    **given: Any,
) -> Report:
    """Read the force, or its class, from raw frames (PNG, TIFF, JPEG, DICOM).

    MODEL is `default`, the bundled reader, or the path of a folder that
    `train` wrote: ./mine.

    A model of kind "reader" reads the force as well; the more is known of the
    eye, the narrower its interval. A model of kind "classifier" knows one
    modulus only. A frame that cannot be judged is class 2 (withdraw) and not
    usable.

    Precedence for the size of a frame and the known inputs of its eye: options,
    the recording.toml beside its folder, the file. `evaluate` reads whole
    recordings. `classify` is another name of `read`.

    Frames of several planes, as a cross of two, are read together: with
    --plane, or of one time_s in a recording that has [[oct.plane]]. They need
    no gap.

    Example: scleraforce read default frames/0001.png
    --youngs-modulus-mpa 0.27 --iop-mmhg 2 --thickness-um 650 --gap-mm 0.5
    --globe open
    """
    # 180 ms: Numba and the models, not for --help
    from scleraforce.front.api.reading_frames import (
        SequenceReader,
        check_calibrated,
        followed_recordings,
        listed_time,
        summary_of_calibration,
    )
    from scleraforce.reading.answer import unusable_answer
    from scleraforce.records.frame import MASK_SD_ROWS, Frame, Moment

    for path in filter(os.path.isdir, frames):
        raise InputError(
            f"{path}: a folder; `scleraforce evaluate {model_name(model)} {path}` reads"
            " a recording, this one frames"
        )

    if masks and len(masks) != len(frames):
        raise InputError(
            f"--mask: {len(masks)} for {len(frames)} frames; give one for each, in"
            " their order"
        )

    mask_of = dict(zip(frames, masks, strict=bool(masks)))
    declared = declared_eye({name: given.pop(name) for name in EYE})
    if eye is not None and calibration is None:
        raise InputError(
            f"eye: {eye!r} names an eye of a calibration; give the calibration, too"
        )
    check_calibrated(declared, calibrated=calibration is not None)
    scan = replace(declared.scan, transposed=transpose, **given)
    moments = _moments(frames, planes)
    shown = [file.plane for file in moments[0] if planes and file.plane]
    summary = None if calibration is None else summary_of_calibration(calibration)
    setup = replace(
        declared,
        eye=replace(declared.eye, name=eye),
        scan=replace(scan, planes=tuple(shown)),
    )
    sequence = cache(
        lambda: SequenceReader(
            sf.load_model(model, wall_finder=wall_finder), setup, summary
        )
    )
    followed = followed_recordings(files[0] for files in moments)

    def answer(number: int) -> "list[FrameReading]":
        files = moments[number]
        for file in files:
            os.stat(file.path)  # a missing frame is reported before the model is loaded

        moment = Moment(
            tuple(
                Frame(
                    file.path,
                    mask=mask_of.get(file.path),
                    mask_sd_rows=mask_sd_rows or MASK_SD_ROWS,
                )
                for file in files
            ),
            time_s=listed_time(files[0], followed),
            held_s=held_s,
        )
        located = None if any(file.is_faulty for file in files) else files
        return sequence().read(moment, located)

    in_time = sorted(range(len(moments)), key=lambda number: _time_s(moments[number]))
    read_by_number = dict(each_of(in_time, answer))
    found = [
        (file.path, one if isinstance(one, InputError) else one[place])
        for number, files in enumerate(moments)
        for one in [read_by_number[number]]
        for place, file in enumerate(files)
    ]
    answered = [(path, one) for path, one in found if not isinstance(one, InputError)]
    faults = [one for _, one in found if isinstance(one, InputError)]

    if not (answered or is_json()):
        return Report({}, (), faults)

    reader = sequence().model
    all_remarks = (remark for _, one in answered for remark in one.remarks)
    remarks = list(dict.fromkeys(all_remarks))
    notes = list(map(str, remarks))

    entries = [  # a frame that could not be read means withdrawal, and has an `error`
        (
            {
                "file": str(path),
                **reader.signed(unusable_answer(reader.classes, str(one))).to_dict(),
                "error": str(one),
            }
            if isinstance(one, InputError)
            else _entry(path, one)
        )
        for path, one in found
    ]
    lines = [
        *(_answer_line(path, one.answer) for path, one in answered),
        f"model: {reader.words}",
        *_read_with([one for one in entries if "error" not in one]),
        *(wrapped(note, "note: ") for note in notes),
    ]

    return Report(
        {
            "model": model_name(reader.path),
            "kind": reader.kind,
            "class_bounds_mn": reader.bounds_mn,
            "notes": notes,
            "remarks": [remark.to_dict() for remark in remarks],
            "frames": entries,
        },
        lines,
        faults,
    )


def _moments(
    frames: Sequence[Path], given: Sequence[tuple[int, str]]
) -> list[MomentFiles]:
    """Return the frames that are read together, each with its plane: one for each, or
    one frame of each plane.
    """
    if not given:
        found = dict[Any, list[RecordedFile]]()
        for file in map(_recorded, frames):
            of_moment = (
                file.path if file.plane is None else (file.recording, file.time_s)
            )
            found.setdefault(of_moment, []).append(file)

        return [tuple(moment) for moment in found.values()]

    if given[0][0] > 1:
        raise InputError(f"--plane: after {frames[0]}, whose plane is not given")

    of_plane = dict[Plane | None, list[RecordedFile]]()
    after_model = [(max(count - 1, 0), words) for count, words in given]
    for path, plane in zip(frames, planes_of(frames, after_model), strict=True):
        file = replace(_recorded(path), plane=plane)
        of_plane.setdefault(plane, []).append(file)

    check_frame_counts(
        {plane.name: len(files) for plane, files in of_plane.items() if plane}
    )
    return list(zip(*of_plane.values(), strict=True))


def _time_s(files: MomentFiles) -> float:
    """Return when a moment was: those of one recording are read in their order in
    time.
    """
    time_s = files[0].time_s
    return 0.0 if time_s is None else time_s


def _recorded(path: Path) -> RecordedFile:
    """Return a frame's file with what its recording states; of one that has a fault its
    path alone, which is reported when the frame is read.
    """
    try:
        return recording_folder.recorded_file(path)
    except (InputError, OSError):
        return RecordedFile(path, is_faulty=True)


def _entry(path: Path, one: "FrameReading") -> dict[str, Any]:
    plane = {} if one.plane is None else {"plane": one.plane.name}
    return {
        "file": str(path),
        **plane,
        **one.answer.to_dict(),
        "scale": _scale_entry(one.frame),
        "known": _known(one),
    }


def _answer_line(path: Path, answer: "Answer") -> str:
    if answer.probabilities is None:
        return (
            f"{path}: class {answer.predicted} (withdraw): not usable: {answer.reason}"
        )

    probabilities = ", ".join(f"{one:.3f}" for one in answer.probabilities)
    words = f"{path}: class {answer.predicted} (probabilities {probabilities})"
    if answer.force_n is not None and answer.interval_n is not None:
        low, high = (f"{from_si(end, 'mn'):.1f}" for end in answer.interval_n)
        words += f", {from_si(answer.force_n, 'mn'):.1f} mN (90 %: {low} to {high})"

    if answer.iop_at_dent_pa is not None:
        words += f", {from_si(answer.iop_at_dent_pa, 'mmhg'):.1f} mmHg at the dent"

    places = answer.to_dict()
    words += (
        f"; wall: {places['wall']}" if places["wall"] in ("mask", "corrected") else ""
    )
    found = [
        f"{key.partition('_')[0]} {places[key]:.2f}{unit} ({ends[0]:.2f} to"
        f" {ends[1]:.2f})"
        for key, unit in PLACES.items()
        if (ends := places[f"{key}_interval"]) is not None
    ]
    words += "\n" + wrapped(", ".join(found), "  ") if found else ""

    return "\n".join(
        [words, *(wrapped(warning, "  warning: ") for warning in answer.warnings)]
    )


def _read_with(entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the inputs of frames, equal ones together: "15 x 4 mm (file); modulus 0.3
    MPa (option), IOP unknown".
    """
    equal: dict[str, list[str]] = {}
    for entry in entries:
        known = ", ".join(
            _input_words(key, **given) for key, given in entry["known"].items()
        )
        equal.setdefault(f"{_size_words(entry['scale'])}; {known}", []).append(
            entry["file"]
        )

    for words, files in equal.items():
        names = f"{files[0]} and {len(files) - 1} more" if files[1:] else files[0]
        yield wrapped(f"{names}: {words}", "read with: ")


def _input_words(key: str, value: Value, source: str) -> str:
    name, unit, _ = KNOWN[key]
    if value is None:
        return f"{name} unknown"
    return (
        f"{name} {value if isinstance(value, str) else f'{value:.4g}{unit}'} ({source})"
    )


def _scale_entry(frame: OpenedFrame) -> dict[str, Any]:
    width_m, depth_m = frame.scan.extent_m
    values = {
        "width_m": ("width_mm", from_si(width_m, "mm")),
        "depth_m": ("depth_mm", from_si(depth_m, "mm")),
        "refractive_index": ("refractive_index", frame.scan.refractive_index),
    }
    return {
        key: {"value": value, "source": frame.sources[name]}
        for name, (key, value) in values.items()
    }


def _size_words(scale: Mapping[str, Any]) -> str:
    """Return the scale for people, equal sources once: "15 x 4 mm (recording.toml),
    refractive index 1 (option)".
    """
    (width, of_width), (depth, of_depth), (index, of_index) = (
        one.values() for one in scale.values()
    )
    between = "" if of_width == of_depth else f" mm ({of_width})"
    return (
        f"{width:.4g}{between} x {depth:.4g} mm ({of_depth}), refractive index"
        f" {index:g} ({of_index})"
    )


def _known(one: "FrameReading") -> dict[str, dict[str, Any]]:
    """Return value and source of each known input; of stiffening, k and lean only if
    they are known.
    """
    sources = {
        "option": one.given,
        "recording.toml": one.given.completed_by(one.stated),
        "frames.csv": one.listed,
        "calibration": one.known,
    }
    found = {}

    for key, (_, _, value_of) in KNOWN.items():
        found_by = {source: value_of(eye) for source, eye in sources.items()}
        values = {
            source: float(f"{one:.12g}") if isinstance(one, float) else one
            for source, one in found_by.items()
        }
        value = values["calibration"]
        source = (
            "unknown"
            if value is None
            else next(name for name, other in values.items() if other == value)
        )

        if value is not None or key not in ONLY_IF_KNOWN:
            found[key] = {"value": value, "source": source}

    return found
