"""A recording folder: `recording.toml`, `frames.csv`, `frames/` and, if logged,
`forces.csv` (docs/recordings.md).
"""

import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from os import PathLike
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from scleraforce.base.errors import FrameError, InputError, RecordingError, StudyError
from scleraforce.base.notebook_cards import grey_picture, html_card
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import KINDS, read_bytes, read_text
from scleraforce.recordings.drawn_walls import RecordedWalls
from scleraforce.recordings.formats.image_files import read_frame, read_image
from scleraforce.recordings.frame_and_force_tables import (
    LARGEST_FORCE,
    ForceLog,
    FrameEntry,
    moments_of,
    read_force_log,
    read_frame_list,
)
from scleraforce.recordings.import_record import read_import_record
from scleraforce.records.decoder import parse_json_record, parse_record
from scleraforce.records.fields import check_quantity, computed
from scleraforce.records.frame import (
    OpenedFrame,
    Pixels,
    check_frame,
)
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Plane, Scan


@dataclass(frozen=True)
class Recording:
    """One eye's recording: its folder, metadata, frames in order, and force log (None:
    not logged).
    """

    path: Path
    info: RecordingInfo
    frames: tuple[FrameEntry, ...]
    forces: ForceLog | None

    @property
    def moments(self) -> tuple[tuple[FrameEntry, ...], ...]:
        """The frames in order, grouped by their time: one, or one of each plane that
        has a frame then.
        """
        return moments_of(self.frames)

    def __repr__(self) -> str:
        forces = (
            "no force log"
            if self.forces is None
            else f"{len(self.forces.time_s)} samples of force"
        )
        return (
            f"<Recording {self.path}: eye {self.info.eye_name}, {len(self.frames)}"
            f" frames, {forces}>"
        )

    def _repr_html_(self) -> str:
        """The first frame and what the recording states, for Jupyter."""
        forces = (
            "not logged"
            if self.forces is None
            else f"{len(self.forces.time_s)} samples"
        )
        first = self.frames[0]
        last = self.frames[-1]
        facts = {
            "eye": self.info.eye_name,
            "frames": f"{len(self.frames)} in {last.time_s - first.time_s:g} s",
            "forces": forces,
        }
        picture = None

        with suppress(InputError):  # the frame may be gone
            picture = grey_picture(self.frame(first))

        return html_card(f"Recording {self.path}", facts, picture)

    @cached_property
    def walls(self) -> RecordedWalls:
        """Its frames' walls that were given."""
        return RecordedWalls(self.path)

    @cached_property
    def remarks(self) -> tuple[Remark, ...]:
        """What its import had to say; nothing without an import.json. A damaged one
        raises `RecordingError`.
        """
        return read_import_record(self.path).all_remarks

    def frame_path(self, entry: FrameEntry) -> Path:
        """Return the path of a frame's file."""
        return self.path / "frames" / entry.file

    def frame(self, entry: FrameEntry) -> Pixels:
        """Read a frame, uint8 or uint16 (rows, columns), and check it against
        recording.toml.
        """
        pixels = read_frame(self.frame_path(entry))
        check_frame(pixels, self.info.scan, self.frame_path(entry))
        return pixels


def check_alone(recording: Recording, file: str) -> None:
    """Raise an `InputError` unless a file is a frame of the recording, whose wall is of
    no other frame.
    """
    files = [each.file for each in recording.frames]
    stem = PurePath(file).stem
    if file not in files:
        raise InputError(f"{recording.path}: no frame {file}")
    if twins := [
        each for each in files if each != file and PurePath(each).stem == stem
    ]:
        raise InputError(
            f"{file}: walls/{stem}.png would be the wall of {twins[0]} too; rename one"
            " of the frames"
        )


def read_recording(path: str | PathLike[str]) -> Recording:
    """Read and check a recording folder; its frames are looked for, but not opened.

    Raises:
        RecordingError: naming the file, the line and the field.

    >>> import scleraforce as sf
    >>> recording = sf.read_recording("eye-a")
    >>> [recording.frame(entry).shape for entry in recording.frames]
    [(512, 512), (512, 512), (512, 512)]
    """
    path = Path(path)
    info = read_info(path / "recording.toml")
    frames = read_frame_list(path / "frames.csv")
    _check_files(path, frames)
    _check_planes(path / "frames.csv", frames, info.scan.planes)

    if not os.path.lexists(path / "forces.csv"):
        return Recording(path, info, frames, None)
    if info.force is None:
        raise RecordingError(
            f"{path / 'recording.toml'}: force: missing; forces.csv needs [force] axis,"
            " contact_sign"
        )

    log = read_force_log(
        path / "forces.csv", info.force.axis, info.force.range_n or np.inf
    )

    return Recording(path, info, frames, log)


def tables_digest(recording: Recording) -> str:
    """Return the SHA-256 of a recording's tables (recording.toml, frames.csv,
    forces.csv), hexadecimal.
    """
    tables = (
        ("recording", "recording.toml"),
        ("frames", "frames.csv"),
        ("forces", "forces.csv"),
    )
    return hashlib.sha256(
        b"".join(
            read_bytes(recording.path / name, KINDS[kind]) for kind, name in tables
        )
    ).hexdigest()


@dataclass(frozen=True)
class _TrueForce:
    """The true force at a frame of a virtual acquisition."""

    file: str
    force_n: float = computed(-LARGEST_FORCE, LARGEST_FORCE)


@dataclass(frozen=True)
class _Truth:
    """What is read of truth.json."""

    frames: tuple[_TrueForce, ...]


def true_forces(recording: Path) -> dict[str, float]:
    """Return the true force at each frame of a virtual acquisition, N, by the frame's
    file; of real ones nothing.
    """
    path = recording / "truth.json"
    if not path.exists():
        return {}

    try:
        truth = parse_json_record(_Truth, read_text(path, KINDS["truth"]), str(path))
    except StudyError as fault:
        raise RecordingError(
            f"{fault}; not the truth of a virtual acquisition"
        ) from fault
    return {frame.file: frame.force_n for frame in truth.frames}


def read_info(path: Path) -> RecordingInfo:
    """Read and check a recording.toml."""
    if not path.parent.is_dir():
        raise RecordingError(f"{path.parent}: no such folder; give a recording folder")

    try:
        return parse_record(
            RecordingInfo, read_text(path, KINDS["recording"]), str(path)
        )
    except StudyError as fault:
        raise RecordingError(str(fault)) from fault


def _check_planes(
    path: Path, frames: tuple[FrameEntry, ...], planes: tuple[Plane, ...]
) -> None:
    names = [plane.name for plane in planes]
    for entry in frames:
        if entry.plane is None and planes:
            raise RecordingError(
                f"{path}: plane: missing for {entry.file}; give one of"
                f" {', '.join(names)}"
            )
        if entry.plane is not None and entry.plane not in names:
            known = (
                f"[[oct.plane]] has {', '.join(names)}"
                if names
                else "recording.toml has no [[oct.plane]]"
            )
            raise RecordingError(
                f"{path}: plane: {entry.plane!r} of {entry.file} is unknown; {known}"
            )

    times_s = {entry.time_s for entry in frames}
    shown = {entry.plane for entry in frames}
    if len(shown) > 1 and len(times_s) == len(frames):
        raise RecordingError(
            f"{path}: plane: no two frames have one time_s; frames of one moment need"
            " the same"
        )


def _check_files(path: Path, frames: tuple[FrameEntry, ...]) -> None:
    folder = (path / "frames").resolve()
    for entry in frames:
        file = path / "frames" / entry.file
        place = f"{path / 'frames.csv'}: file"

        try:
            inside = file.resolve().is_relative_to(folder)
            there = file.is_file()
        except (
            OSError,
            RuntimeError,
        ) as fault:  # a name that is too long, links that go round
            reason = fault.strerror if isinstance(fault, OSError) else fault
            raise RecordingError(f"{place}: {entry.file}: {reason}") from fault

        if not inside:
            raise RecordingError(
                f"{place}: {entry.file} leads out of {path / 'frames'}"
            )
        if not there:
            raise RecordingError(f"{place}: {file} does not exist")


def recording_of(path: Path) -> Path | None:
    """Return the recording folder of a frame, which has `frames/` beside
    recording.toml; None for other images.
    """
    folder = path.parent.resolve()
    inside = folder.name == "frames" and os.path.isfile(
        folder.parent / "recording.toml"
    )
    return folder.parent if inside else None


@dataclass(frozen=True)
class RecordedFile:
    """A frame's file, with the recording that it is in.

    `recording` and `info` are None for other images, `entry` for those that frames.csv
    does not list, `plane` where the recording is not of several planes. `is_faulty`:
    the recording could not be read.
    """

    path: Path
    recording: Path | None = None
    info: RecordingInfo | None = None
    entry: FrameEntry | None = None
    plane: Plane | None = None
    is_faulty: bool = False

    @property
    def time_s(self) -> float | None:
        """Time of the frame on the clock of its recording; None if it is not listed."""
        return None if self.entry is None else self.entry.time_s


def recorded_file(path: Path) -> RecordedFile:
    """Return a frame's file with what its recording states; raises `RecordingError`.

    frames.csv is read again where it has changed.
    """
    recording = recording_of(path)
    if recording is None:
        return RecordedFile(path)

    info = read_info(recording / "recording.toml")
    table = recording / "frames.csv"
    entry = None
    if info.scan.planes or os.path.lexists(table):
        entry = _listed(table, _stamp(table)).get(path.name)

    plane = None if entry is None else info.scan.named(entry.plane)
    if info.scan.planes and plane is None:
        raise RecordingError(f"{table}: plane: none for {path.name}")
    return RecordedFile(path, recording, info, entry, plane)


def _stamp(path: Path) -> tuple[int, ...]:
    """Return numbers that change with a file; of a missing one none."""
    if not path.exists():  # reading it says why
        return ()
    stat = path.stat()
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


@lru_cache(maxsize=8)  # recordings whose frames are read in turns
def _listed(table: Path, _: tuple[int, ...]) -> Mapping[str, FrameEntry]:
    """Read frames.csv, by the names of files; by path and stamp."""
    return {entry.file: entry for entry in read_frame_list(table)}


SIZES = ("width_m", "depth_m", "refractive_index")


def open_frame(
    file: RecordedFile, given: Scan, assumed: Scan, assumption: str
) -> OpenedFrame:
    """Read one frame and find its scale: `given`, else recording.toml's, the file's, or
    the `assumed` one, whose source is the `assumption`.
    """
    path = file.path
    info = file.info
    pixels, image = read_image(path)
    if given.transposed:
        pixels = pixels.T
        image = image.turned()
    if info is not None:
        check_frame(pixels, info.scan, path)

    lateral_m = image.size.lateral_m
    depth_m = image.size.depth_m
    of_file = {
        "width_m": lateral_m and lateral_m * image.columns,
        "depth_m": depth_m and depth_m * image.rows,
    }
    stated: tuple[tuple[Mapping[str, Any], str], ...] = (
        (vars(given), "option"),
        (vars(info.scan) if info else {}, "recording.toml"),
        (of_file, "file"),
        (vars(assumed), assumption),
        ({"refractive_index": 1.0}, "assumed"),
    )
    sizes = dict[str, float]()
    sources = dict[str, str]()
    for name in SIZES:
        for values, source in stated:
            if name not in sizes and values.get(name):
                sizes[name] = values[name]
                sources[name] = source

    if image.scale_fault and info is None and None in (given.width_m, given.depth_m):
        raise FrameError(f"{image.scale_fault}; give `width_m` and `depth_m`")
    if not sizes.keys() >= {"width_m", "depth_m"}:
        lost = "its size is neither in the file nor in a recording.toml"
        raise FrameError(f"{path}: {lost}; give `width_m` and `depth_m`")

    for key, name in (("width_mm", "width_m"), ("depth_mm", "depth_m")):
        try:
            check_quantity(key, from_si(sizes[name], "mm"))
        except StudyError as fault:
            raise FrameError(
                f"{path}: {fault} (stated by: {sources[name]}); give `{name}`"
            ) from None

    scan = Scan(
        width_m=sizes["width_m"],
        depth_m=sizes["depth_m"],
        refractive_index=sizes["refractive_index"],
    )
    notes = (*image.notes, *([image.scale_fault] if image.scale_fault else []))
    return OpenedFrame(pixels, scan, sources, info, notes)
