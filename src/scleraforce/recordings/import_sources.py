"""Sources of all kinds: the kind of each, by its content or else its name; their frames
and forces together.
"""

import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path, PurePath
from typing import Literal

import numpy as np

from scleraforce.base.errors import FrameError, InputError
from scleraforce.base.whole_files import FileKind, check_regular
from scleraforce.recordings import frame_and_force_tables
from scleraforce.recordings.formats import (
    dicom_files,
    foreign_force_logs,
    image_files,
    log_text,
    ros_bags,
    tiff_files,
    volume_files,
    zarr_files,
)
from scleraforce.recordings.formats.picture_streams import (
    FrameTimes,
    OtherPictureError,
    PictureSource,
    parse_axes,
    rising,
)
from scleraforce.recordings.frame_and_force_tables import ForceLog
from scleraforce.recordings.frame_names import natural_order
from scleraforce.recordings.frame_order import (
    FramesBy,
    can_order,
    ordered_files,
    parse_frames_by,
)
from scleraforce.recordings.paired_planes import pair_moments
from scleraforce.recordings.source_files import (
    BAG_MARK,
    MOST_NAMED,
    TEXT_NAMES,
    listed_files,
)
from scleraforce.records.remark import Remark, sentences
from scleraforce.records.scan import Plane, check_frame_counts, check_planes

# Files that are not read, by their first bytes and by their endings: what they are, and
# what to do.
FOREIGN = tomllib.loads(
    files("scleraforce.recordings.formats").joinpath("foreign.toml").read_text("utf-8")
)
ANALYZE_BYTES = 348  # of a header, which begins with this number


def _foreign_kind(name: str, head: bytes) -> str | None:
    ending = PurePath(name).suffix.lower()
    if ending in (".hdr", ".img") and ANALYZE_BYTES in (
        int.from_bytes(head[:4], order) for order in ("little", "big")
    ):
        return (
            "an Analyze 7.5 volume, whose header has no unit; convert it to NIfTI"
            " (nibabel, MRIcroGL, fslchfiletype)"
        )

    found: list[str] | None = FOREIGN["endings"].get(ending)
    if head.startswith(b"PK"):
        sheet = ending in (".xlsx", ".ods", ".xlsm")
        found = ["a spreadsheet", "{table}"] if sheet else ["a zip archive", "{unpack}"]

    for mark, words in FOREIGN["marks"].items():
        if head.startswith(mark.encode("latin-1")):
            found = words
        elif found is None and ending in re.findall(r"\.\w+", words[0]):
            found = [f"named as {words[0]}", words[1]]

    return None if found is None else "; ".join(found).format(**FOREIGN["remedies"])


LEFT_OUT = "files-left-out"
OPTION = "option"  # the source of a value given by an option or an argument
SINCE_1970_S = 1e8  # a clock beyond counts from 1970
SOURCE = FileKind("source", 64 * 2**30, "", FrameError)
HEAD_BYTES = 512
SQLITE = b"SQLite format 3\0"
MCAP = b"\x89MCAP0\r\n"
NIFTI_NAMES = (".nii", ".nii.gz")
KINDS = (
    "PNG, JPEG, TIFF, DICOM, NumPy (.npy, .npz), NIfTI, MetaImage (.mha, .mhd), NRRD,"
    " films (AVI, MP4, MOV, MKV), ROS bags (.bag, .db3, .mcap), Thorlabs .oct,"
    " OME-Zarr, force"
    " logs (.csv, .txt, .lvm)"
)


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """The values of all options of `scleraforce import`, in the units of their names;
    None: open.
    """

    axes: str | None = None
    flip: Literal["rows", "columns"] | None = None
    array: str | None = None
    width_mm: float | None = None
    depth_mm: float | None = None
    refractive_index: float | None = None
    bits: int | None = None
    first_frame: int | None = None
    last_frame: int | None = None
    grey_range: tuple[float, float] | None = None
    rate_hz: float | None = None
    times: Path | None = None
    frames_by: str | None = None
    clock_offset_s: float | Literal["auto"] | None = None
    columns: tuple[str, ...] = ()
    axis: str | None = None
    contact_sign: str | int | None = None
    average_s: float | None = None
    range_n: float | None = None
    image_topic: str | None = None
    force_topic: str | None = None
    by_arrival: bool = False
    eye: str | None = None
    thickness_um: float | None = None
    iop_mmhg: float | None = None
    globe: str | None = None
    gauge: int | None = None
    gap_mm: float | None = None
    polar_angle_deg: float | None = None
    relaxation: str | None = None


def source_kind(path: Path) -> str:
    """Return the kind of a source: a kind of `read_scan`, "bag" or "log"."""
    if path.is_dir():
        return "bag" if (path / BAG_MARK).exists() else "zarr"

    try:
        check_regular(path, path.stat(), SOURCE)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault

    kind = _known_kind(path.name.lower(), head)
    if (
        kind is None
        and path.suffix.lower() == ".img"
        and path.with_suffix(".hdr").exists()
    ):
        return source_kind(path.with_suffix(".hdr"))

    binary = kind == "log" and b"\0" in head  # a log is text
    if (binary or (kind is None and head)) and (
        foreign := _foreign_kind(path.name, head)
    ) is not None:
        raise InputError(f"{path}: {foreign}")
    if kind is None:
        raise InputError(
            f"{path}: {'of no kind that is read' if head else 'an empty file'}; give"
            f" {KINDS}"
        )

    return kind


VOLUMES = {
    "nifti": volume_files.read_nifti,
    "nrrd": volume_files.read_nrrd,
    "metaimage": volume_files.read_metaimage,
}
FRAMES = {
    "tiff": tiff_files.read_tiff,
    "dicom": dicom_files.read_dicom,
    "film": image_files.read_film,
}
FRAMES["picture"] = lambda path: image_files.read_image(path)[1]


def read_scan(
    path: Path, kind: str, axes: tuple[str, ...] | None = None, array: str | None = None
) -> PictureSource:
    """Return the frames of a source of a kind that `source_kind` returns."""
    if kind == "thorlabs":
        return volume_files.read_thorlabs(path)
    if kind == "zarr":
        return zarr_files.read_zarr(path, axes)
    if kind == "numpy":
        return image_files.read_numpy(path, axes, array)
    if kind in VOLUMES:
        return VOLUMES[kind](path, axes)

    return _oriented(path, FRAMES[kind](path), axes)


def _oriented(
    path: Path, scan: PictureSource, axes: tuple[str, ...] | None
) -> PictureSource:
    """Return pictures, whose rows are depth unless the axes name their columns as
    depth.
    """
    if axes is None:
        return scan
    if axes[0] != "frame" and len(axes) == 3:
        raise InputError(
            f"`axes`: {','.join(axes)}: {path} has frame after frame; begin with frame"
        )

    return scan.turned() if axes[-2:] == ("lateral", "depth") else scan


def _known_kind(name: str, head: bytes) -> str | None:
    avi = head[:4] == b"RIFF" and head[8:12] == b"AVI "
    marks = (
        ("picture", head.startswith((b"\x89PNG", b"\xff\xd8\xff"))),
        (
            "dicom",
            head[128:132] == b"DICM",
        ),  # before TIFF: its preamble may be the head of one
        ("tiff", head.startswith(image_files.TIFF_MARKS)),
        ("numpy", head.startswith(b"\x93NUMPY")),
        ("nrrd", head.startswith(b"NRRD")),
        ("bag", head.startswith((b"#ROSBAG", SQLITE, MCAP))),
        ("film", head.startswith(image_files.MATROSKA) or head[4:8] == b"ftyp" or avi),
        ("nifti", head[344:347] in (b"n+1", b"ni1") or head[4:7] == b"n+2"),
        ("metaimage", re.match(rb"\s*(ObjectType|NDims|Comment)\s*=", head)),
        ("numpy", name.endswith(".npz")),
        ("thorlabs", name.endswith(".oct") and head.startswith(b"PK")),
        ("nifti", name.endswith(NIFTI_NAMES) and head),
        ("log", name.endswith(TEXT_NAMES) and head),
    )

    return next((kind for kind, found in marks if found), None)


@dataclass(frozen=True, eq=False)
class GatheredSources:
    """The files with their kinds, the frames, the force log and its columns (None: no
    source has forces), and remarks.

    Of several `planes`, `scan` has a frame of each moment, with its time; `frames` has
    all, moment by moment, and `places` their moments and planes. `one_clock`: frames
    and forces come from bags, of which one has both.
    """

    files: tuple[tuple[Path, str], ...]
    scan: PictureSource
    log: ForceLog | None
    columns: tuple[foreign_force_logs.LogColumn, ...]
    remarks: tuple[Remark, ...]
    frames: PictureSource
    planes: tuple[Plane, ...] = ()
    places: tuple[tuple[int, Plane], ...] = ()
    one_clock: bool = False
    frames_by: str | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the remarks."""
        return sentences(self.remarks)


@dataclass(eq=False)
class _Content:
    """What files hold: frames of each plane (None: without planes), logs with the
    columns of one of text, and files that are no sources.
    """

    scans: dict[Plane | None, list[PictureSource]]
    logs: list[tuple[Path, ForceLog]]
    columns: tuple[foreign_force_logs.LogColumn, ...] = ()
    left_out: tuple[Remark, ...] = ()
    one_clock: bool = False  # a bag has frames and forces

    def log(self) -> ForceLog | None:
        """Return the only log, or None; refuse a second one."""
        if len(self.logs) > 1:
            raise InputError(
                f"{self.logs[1][0]}: a second force log beside {self.logs[0][0]};"
                " import one recording at a time"
            )
        return self.logs[0][1] if self.logs else None


def gather_sources(
    sources: Sequence[Path],
    options: ImportOptions,
    seen: Callable[[int], None] = lambda _: None,
    planes: Sequence[Plane | None] = (),
    usual_frames_by: str | None = None,
) -> GatheredSources:
    """Read all sources, of several `planes` one for each source; `seen` is called with
    1 after each file.

    Ask for answers that `options` do not give; `usual_frames_by` orders the frames of
    a laboratory where the files allow it and `options` do not say otherwise.
    """
    by = parse_frames_by(options.frames_by)
    sources_of = dict[Plane | None, list[Path]]()
    for source, plane in zip_longest(sources, planes):
        sources_of.setdefault(plane, []).append(source)

    listings = {
        plane: listed_files(of_plane, options.times)
        for plane, of_plane in sources_of.items()
    }
    files = [
        (path, source_kind(path), plane)
        for plane, listing in listings.items()
        for path in listing.files
    ]
    _check_apart(files)
    inside = frozenset().union(*(each.of_folders for each in listings.values()))
    content = _content(files, options, inside, seen)
    if not content.scans:
        raise InputError(
            f"{sources[0]}: no frames in the sources; give images, a volume, a film or"
            " a bag with images"
        )

    log = content.log()
    frames_by = options.frames_by
    usual = parse_frames_by(usual_frames_by)
    if (
        by is None
        and usual is not None
        and all(
            can_order(of_plane, usual, options.times, options.rate_hz)
            for of_plane in content.scans.values()
        )
    ):
        by = usual
        frames_by = usual_frames_by

    wholes = {
        plane: ordered_files(found, by, options.times, options.rate_hz)
        .flipped(options.flip)
        .between(options.first_frame, options.last_frame)
        for plane, found in content.scans.items()
    }
    scan, frames, places, lacking = _planes_together(wholes, sources_of, by)
    by_position = scan.times is None and not scan.numbers and scan.steps is None
    of_folders = [words for each in listings.values() for words in each.notes]
    in_order = _order_notes(files, wholes) if by_position else _number_notes(wholes)
    remarks = [
        *(Remark("picture-read", words) for words in scan.notes),
        *(Remark(LEFT_OUT, words) for words in of_folders),
        *content.left_out,
        *(Remark("moments-incomplete", words) for words in lacking),
        *(Remark("frames-ordered", words) for words in in_order),
        *(log.remarks if log else ()),
    ]

    return GatheredSources(
        tuple((path, kind) for path, kind, _ in files),
        scan,
        log,
        content.columns,
        tuple(remarks),
        frames,
        tuple(plane for plane in wholes if plane),
        places,
        content.one_clock and all(kind == "bag" for _, kind, _ in files),
        frames_by,
    )


Sources = Sequence[tuple[Path, str, Plane | None]]  # with their kinds


def _check_apart(files: Sources) -> None:
    place_of = dict[Path, Plane]()
    for path, _, plane in files:
        if plane and place_of.setdefault(path.resolve(), plane) != plane:
            raise InputError(
                f"`planes`: {path} is of two planes; give the frames of each"
            )


def _content(
    files: Sources,
    options: ImportOptions,
    inside: frozenset[Path],
    seen: Callable[[int], None],
) -> _Content:
    """Read all files; those of folders (`inside`) may be other pictures."""
    axes = None if options.axes is None else parse_axes(options.axes)
    given = [foreign_force_logs.parse_column(text) for text in options.columns]
    found = _Content({}, [])
    others: list[tuple[Path, OtherPictureError]] = []
    of_bags: list[tuple[Path, ForceLog]] = []

    for path, kind, plane in files:
        if kind == "bag":
            scan, log = ros_bags.read_bag(
                path, options.image_topic, options.force_topic, options.by_arrival
            )
            if scan is not None:
                found.scans.setdefault(plane, []).append(_oriented(path, scan, axes))
            if log is not None:
                of_bags.append((path, log))

            both = scan is not None and log is not None
            found.one_clock = found.one_clock or both
        elif kind == "log":
            log, found.columns = foreign_force_logs.read_force_text(
                log_text.read_log_text(path), given
            )
            found.logs.append((path, log))
        else:
            try:
                scan = read_scan(path, kind, axes, options.array)
                found.scans.setdefault(plane, []).append(scan)
            except OtherPictureError as other:
                if path not in inside:
                    raise
                others.append((path, other))

        seen(1)

    if of_bags:
        path, log = ros_bags.joined_logs(of_bags)
        gaps = frame_and_force_tables.gap_remarks(path, log.wrench_sc)
        place = f"{path}: message {{}} of the forces".format
        checked = frame_and_force_tables.checked_samples(
            replace(log, remarks=(*log.remarks, *gaps)), path, place
        )
        found.logs.insert(0, (path, checked))

    if others and not found.scans:
        raise others[0][1]
    if others:
        names = ", ".join(path.name for path, _ in others[:MOST_NAMED])
        more = ", ..." if len(others) > MOST_NAMED else ""
        count = f"{len(others)} picture{'s' * (len(others) > 1)}"
        words = f"left out: {count} from the front, not B-scans ({names}{more})"
        found.left_out = (Remark(LEFT_OUT, words),)

    return found


def _planes_together(
    wholes: Mapping[Plane | None, PictureSource],
    sources_of: Mapping[Plane | None, Sequence[Path]],
    by: FramesBy | None,
) -> tuple[
    PictureSource, PictureSource, tuple[tuple[int, Plane], ...], tuple[str, ...]
]:
    """Return the moments' scan, that of all frames, their places, and notes."""
    of_planes = {plane: whole for plane, whole in wholes.items() if plane}
    if of_planes and None in wholes:
        raise InputError(
            f"`planes`: missing for {wholes[None].names[0]}; give one before the frames"
            " of each plane"
        )

    check_planes(tuple(of_planes))
    counts = {
        plane.name: len(wholes[plane].names) if plane in wholes else 0
        for plane in sources_of
        if plane
    }
    if 0 in counts.values():
        check_frame_counts(counts)
    if not of_planes:
        return wholes[None], wholes[None], (), ()

    both = pair_moments(of_planes, by)
    return both.scan, both.frames, both.places, both.notes


def _order_notes(
    files: Sources, wholes: Mapping[Plane | None, PictureSource]
) -> list[str]:
    """Return notes on files whose order is not that of the numbers in their names."""
    notes = []
    for of_plane in wholes:
        shown = [
            path
            for path, kind, plane in files
            if plane == of_plane and kind not in ("bag", "log")
        ]
        if shown != sorted(shown, key=lambda path: natural_order(path.name)):
            order = f"{shown[0].name} to {shown[-1].name}; their numbers have another"
            notes.append(f"frames are taken in the order given, {order}")

    return notes


def _number_notes(wholes: Mapping[Plane | None, PictureSource]) -> list[str]:
    """Return notes on frames that numbers put in another order than their names."""
    return [
        f"frames are taken in the order of {whole.numbers[0].source},"
        f" {Path(whole.names[0]).name} to {Path(whole.names[-1]).name}"
        for whole in wholes.values()
        if whole.numbers and list(whole.names) != sorted(whole.names, key=natural_order)
    ]


def on_one_clock(
    times: FrameTimes, log: ForceLog | None, offset_s: float
) -> tuple[FrameTimes, ForceLog | None, float]:
    """Return times and log on the log's clock, `offset_s` ahead of the frames', and its
    new zero; both must overlap.
    """
    time_s = times.time_s + offset_s
    if not rising(time_s):
        way = "give the files in their order, or their times by `times` or `rate_hz`"
        raise InputError(
            f"the frames' times do not rise from each frame to the next; {way}"
        )

    first_s = float(min([time_s[0], *([] if log is None else log.time_s[:1])]))
    origin_s = float(np.floor(first_s)) if first_s > SINCE_1970_S else 0.0
    moved = None if log is None else replace(log, time_s=log.time_s - origin_s)

    time_s = time_s - origin_s
    if moved is not None and (
        time_s[-1] < moved.time_s[0] or time_s[0] > moved.time_s[-1]
    ):
        frames, forces = (
            f"{each[0]:.3f} to {each[-1]:.3f} s" for each in (time_s, moved.time_s)
        )
        found = f"frames at {frames}, forces at {forces}"
        raise InputError(
            f"the clocks do not overlap: {found}; `clock_offset_s` brings both to one"
            " clock"
        )

    return FrameTimes(time_s, times.source), moved, origin_s
