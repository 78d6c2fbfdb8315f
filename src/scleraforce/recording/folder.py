"""A recording folder: `recording.toml`, `frames.csv`, `frames/` and, if logged,
`forces.csv` (docs/recordings.md).
"""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from math import cos, sin
from os import PathLike
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from scleraforce.errors import FrameError, InputError, RecordingError, StudyError
from scleraforce.pictures import grey_picture, html_card
from scleraforce.recording.images import read_frame, read_image
from scleraforce.recording.pixels import Pixels, PixelScale, Sourced
from scleraforce.recording.tables import (
    ForceLog,
    FrameEntry,
    moments_of,
    read_force_log,
    read_frame_list,
)
from scleraforce.recording.walls import RecordedWalls
from scleraforce.study import parse_record
from scleraforce.study.eye import GLOBES, RIGIDITY_LAWS, check_relaxation
from scleraforce.study.fields import (
    allowed,
    check_fields,
    check_quantity,
    option,
    quantity,
    required,
)
from scleraforce.units import HumanUnit, from_si, to_si
from scleraforce.whole_files import KINDS, read_bytes, read_text

# Outer diameters of hypodermic needles, ISO 9626 (normal wall).
GAUGE_DIAMETER_M = {
    18: 1.2e-3,
    19: 1.1e-3,
    20: 0.9e-3,
    21: 0.8e-3,
    22: 0.7e-3,
    23: 0.6e-3,
    24: 0.55e-3,
    25: 0.5e-3,
    26: 0.45e-3,
    27: 0.4e-3,
    28: 0.36e-3,
    29: 0.33e-3,
    30: 0.3e-3,
    31: 0.25e-3,
    32: 0.23e-3,
    33: 0.2e-3,
    34: 0.18e-3,
}
LONGEST_ID = 200
UNTABLED = ',;"'  # letters that separate and quote cells
# between two planes: a degree is 1.7e-2
LEAST_TURN_RAD = 1e-3
LEAST_OFFSET_M = 1e-6


def _possible(key: str, unit: HumanUnit | None = None) -> Any:
    return quantity(None, unit, allowed(key).low, allowed(key).high)


@dataclass(frozen=True)
class EyeInfo:
    """The eye: a name, and its known properties (None: unknown).

    `globe`: "open" (infused or vented: the needle leaves the pressure unchanged) or
    "sealed"; a sealed one may have a measured rigidity and its law, and a time constant
    in which it leaks (`mechanics.globe`). `relaxation`: terms of a share and a time
    constant, s (`mechanics.material`); none: the tissue is elastic.
    """

    id: str
    _: KW_ONLY
    thickness_m: float | None = _possible("thickness_m")
    iop_pa: float | None = _possible("iop_pa")
    globe: str | None = option(None, *GLOBES)
    rigidity_pa13_per_m3: float | None = _possible("rigidity", "mmhg13_per_ul")
    rigidity_law: str | None = option(None, *RIGIDITY_LAWS)
    leak_time_s: float | None = quantity(None, None, 1.0, 1e6)
    relaxation: tuple[tuple[float, ...], ...] | None = quantity(None, None, 0.0, 1e5)

    def __post_init__(self) -> None:
        check_fields(self)
        check_relaxation(self.relaxation or ())
        if fault := name_fault(self.id):
            raise StudyError(f"id: {fault}")

        stated = (self.rigidity_pa13_per_m3, self.rigidity_law, self.leak_time_s)
        for key, value in zip(
            ("rigidity_mmhg13_per_ul", "rigidity_law", "leak_time_s"),
            stated,
            strict=True,
        ):
            if value is not None and self.globe != "sealed":
                found = "missing" if self.globe is None else f'"{self.globe}"'
                raise StudyError(
                    f"{key}: of a sealed globe, globe is {found};"
                    ' write globe = "sealed", or leave it out'
                )


@dataclass(frozen=True)
class Plane:
    """One of several planes that a scanner takes at once, parallel to its depth axis.

    Its lateral axis lies `direction_rad` from the scanner's x axis, turned as seen from
    outside the eye from the meridian towards growing azimuth; the plane lies `offset_m`
    from the scanner's axis, to the left of its lateral axis as seen from there. The
    middle of its frames is the foot of that axis.

    >>> import scleraforce as sf
    >>> sf.Plane("across", 0.0, 1.5708).direction_rad
    1.5708
    """

    name: str
    offset_m: float = required(low=-10e-3, high=10e-3)
    direction_rad: float = required(low=-6.3, high=6.3)

    def __post_init__(self) -> None:
        check_fields(self)
        if fault := name_fault(self.name, "plane"):
            raise StudyError(f"name: {fault}")
        if self.name != self.name.strip() or any(
            letter in self.name for letter in UNTABLED
        ):
            raise StudyError(
                f"name: {self.name!r}; a table cannot hold {UNTABLED}, or a space at"
                " an end"
            )

    def lies_at(self, other: "Plane") -> bool:
        """Return whether another plane is the same one, as well where its columns run
        the other way.
        """
        turn_rad = self.direction_rad - other.direction_rad
        same_m = self.offset_m - cos(turn_rad) * other.offset_m
        return abs(sin(turn_rad)) < LEAST_TURN_RAD and abs(same_m) < LEAST_OFFSET_M


def parse_plane(words: str) -> Plane:
    """Return a plane of a scan, by its name, distance from the scanner's axis and
    direction: NAME:MM:DEGREES.

    >>> parse_plane("across:0.2:90").offset_m
    0.0002
    """
    name, *numbers = words.rsplit(":", 2)
    try:
        offset_mm, direction_deg = map(float, numbers)
        return Plane(name, to_si(offset_mm, "mm"), to_si(direction_deg, "deg"))
    except InputError as fault:
        raise InputError(f"--plane: {words!r}: {fault}") from None
    except ValueError:
        raise InputError(
            f"--plane: {words!r} is not NAME:OFFSET_MM:DIRECTION_DEG, like across:0:90"
        ) from None


def check_planes(planes: tuple[Plane, ...], given: str = "plane") -> None:
    """Raise a `StudyError` that names `given` unless planes can be read together: of
    different names and places.
    """
    if len(planes) == 1:
        raise StudyError(
            f"{given}: only one; give each plane of the scan, or slice_gap_m"
            " without any"
        )

    for number, plane in enumerate(planes):
        for before in planes[:number]:
            if before.name == plane.name:
                raise StudyError(f"{given}: name: {plane.name!r} is there twice")
            if before.lies_at(plane):
                raise StudyError(
                    f"{given}: {before.name!r} and {plane.name!r} are at one place"
                )


def check_counts(counts: Mapping[str, int]) -> None:
    """Raise an `InputError` unless there are as many frames of each plane."""
    if len(set(counts.values())) > 1:
        words = ", ".join(f"{name!r} has {count}" for name, count in counts.items())
        raise InputError(
            f"--plane: as many frames of each plane are read together; {words}"
        )


@dataclass(frozen=True, kw_only=True)
class OctInfo:
    """The frames: pixels, used bits, field of view (black bands included), and the
    plane's direction and tilt.

    With several planes, `plane`, direction and tilt are of the scanner's x axis.
    """

    columns: int = required(low=16, high=16384)
    rows: int = required(low=16, high=16384)
    bits: int = required(low=1, high=16)
    width_m: float = required(low=allowed("width_m").low, high=allowed("width_m").high)
    depth_m: float = required(low=allowed("depth_m").low, high=allowed("depth_m").high)
    plane_direction_rad: float | None = quantity(None, None, -6.3, 6.3)
    plane_tilt_rad: float = quantity(0.0, None, -1.0, 1.0)
    refractive_index: float = quantity(1.0, None, 1.0, 2.0)
    plane: tuple[Plane, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        check_planes(self.plane)

    def named(self, name: str | None) -> Plane | None:
        """Return the plane of a name; None if it does not exist."""
        return next((plane for plane in self.plane if plane.name == name), None)


@dataclass(frozen=True, kw_only=True)
class NeedleInfo:
    """The needle: gauge, distance of the one B-scan plane from its axis; polar angle of
    the contact and lean, if known.

    `lean_rad`: angle between its axis and the wall's normal; `lean_azimuth_rad`:
    direction in which it leans on its way up, from the B-scan's lateral axis.
    """

    gauge: int = required(low=10, high=36)
    slice_gap_m: float | None = _possible("gap_m")
    polar_angle_rad: float | None = _possible("polar_angle_rad")
    lean_rad: float | None = _possible("lean_rad")
    lean_azimuth_rad: float | None = quantity(None, None, -6.3, 6.3)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.lean_azimuth_rad is not None and self.lean_rad is None:
            raise StudyError(
                "lean_azimuth_rad: of a needle that leans; give lean_rad as well, or"
                " leave it out"
            )


@dataclass(frozen=True)
class ForceInfo:
    """The force log: sensor axis along the needle, its sign in contact, how long a
    label averages, and the largest force that the sensor measures (None: not stated).
    """

    axis: str = required("fx", "fy", "fz")
    contact_sign: int = required(low=-1, high=1)
    average_s: float = quantity(2.0, None, 0.01, 60.0)
    range_n: float | None = quantity(None, None, 1e-3, 1e6)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.contact_sign == 0:
            raise StudyError("contact_sign: 0 is not a sign; give 1 or -1")


@dataclass(frozen=True)
class RecordingInfo:
    """The contents of `recording.toml`; `force` may be omitted without a force log."""

    eye: EyeInfo
    oct: OctInfo
    needle: NeedleInfo
    force: ForceInfo | None = None

    def __post_init__(self) -> None:
        if self.needle.slice_gap_m is None and not self.oct.plane:
            raise StudyError(
                "needle.slice_gap_m: missing; give it, or [[oct.plane]] for each of"
                " several planes"
            )
        if self.needle.slice_gap_m is not None and self.oct.plane:
            raise StudyError(
                "needle.slice_gap_m: of a single plane, and there are [[oct.plane]]:"
                " leave it out"
            )


def name_fault(name: str, what: str = "eye") -> str | None:
    """Return why a text cannot name an eye or a plane in a table, log or message, None
    if it can.
    """
    if not name.strip():
        return f"empty; give the {what} a name"
    if not name.isprintable():
        return (
            f"{name[:LONGEST_ID]!r} has a line break or another unprintable character;"
            " give a name of one line"
        )
    if len(name) > LONGEST_ID:
        return f"{len(name)} characters; give the {what} a name of at most {LONGEST_ID}"

    return None


def nearest_gauge(outer_diameter_m: float) -> int:
    """Return the gauge of a needle.

    >>> nearest_gauge(0.7e-3)
    22
    """
    return min(
        GAUGE_DIAMETER_M,
        key=lambda gauge: abs(GAUGE_DIAMETER_M[gauge] - outer_diameter_m),
    )


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
            f"<Recording {self.path}: eye {self.info.eye.id}, {len(self.frames)}"
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
            "eye": self.info.eye.id,
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

    def frame_path(self, entry: FrameEntry) -> Path:
        """Return the path of a frame's file."""
        return self.path / "frames" / entry.file

    def frame(self, entry: FrameEntry) -> Pixels:
        """Read a frame, uint8 or uint16 (rows, columns), and check it against
        recording.toml.
        """
        pixels = read_frame(self.frame_path(entry))
        check_frame(pixels, self.info.oct, self.frame_path(entry))
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


def check_frame(pixels: Pixels, stated: OctInfo, path: Path) -> None:
    """Check a frame against its recording.toml."""
    fault = None
    largest = int(pixels.max())

    if pixels.shape != (stated.rows, stated.columns):
        found = " x ".join(map(str, pixels.shape))
        fault = (
            f"{found} pixels (rows x columns); recording.toml says {stated.rows} x"
            f" {stated.columns}"
        )
    elif pixels.dtype == np.uint8 and stated.bits > 8:
        fault = f"8 bits a pixel; recording.toml says {stated.bits}"
    elif largest >= 2**stated.bits:
        fault = (
            f"a pixel of {largest} is more than {stated.bits} bits; check bits in"
            " recording.toml"
        )

    if fault is not None:
        raise FrameError(f"{path}: {fault}")


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
    _check_planes(path / "frames.csv", frames, info.oct.plane)

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


def frame_digest(pixels: Pixels) -> str:
    """Return the SHA-256 of a frame's size and pixels, hexadecimal.

    >>> import numpy as np
    >>> narrow, wide = (np.zeros((2, 3), kind) for kind in (np.uint8, np.uint16))
    >>> frame_digest(narrow) == frame_digest(wide)
    True
    """
    size = f"{pixels.shape[0]} x {pixels.shape[1]}\n".encode()
    return hashlib.sha256(size + pixels.astype("<u2").tobytes()).hexdigest()


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


def true_forces(recording: Path) -> dict[str, float]:
    """Return the true force at each frame of a virtual acquisition, N, by the frame's
    file; of real ones nothing.
    """
    path = recording / "truth.json"
    if not path.exists():
        return {}

    try:
        frames = json.loads(read_text(path, KINDS["truth"]))["frames"]
        return {frame["file"]: float(frame["force_n"]) for frame in frames}
    except (ValueError, KeyError, TypeError) as fault:
        raise RecordingError(
            f"{path}: not the truth of a virtual acquisition: {fault}"
        ) from fault


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


@dataclass(frozen=True, kw_only=True)
class Scanner:
    """Width and depth of frames in m, and the refractive index of the depth axis; None:
    not stated.
    """

    width_m: float | None = None
    depth_m: float | None = None
    refractive_index: float | None = None


@dataclass(frozen=True, eq=False)
class ScaledFrame:
    """A frame (rows: depth, columns: lateral) with its scale, notes, and its
    recording's metadata if it has any.
    """

    pixels: Pixels
    width_m: Sourced
    depth_m: Sourced
    refractive_index: Sourced
    info: RecordingInfo | None
    notes: tuple[str, ...] = ()

    @property
    def scale(self) -> PixelScale:
        """Size of a pixel as stored, with the refractive index."""
        rows, columns = self.pixels.shape
        lateral_m = self.width_m.value / columns
        depth_m = self.depth_m.value / rows
        return PixelScale(
            lateral_m=lateral_m,
            depth_m=depth_m,
            refractive_index=self.refractive_index.value,
        )


def recording_of(path: Path) -> Path | None:
    """Return the recording folder of a frame, which has `frames/` beside
    recording.toml; None for other images.
    """
    folder = path.parent.resolve()
    inside = folder.name == "frames" and os.path.isfile(
        folder.parent / "recording.toml"
    )
    return folder.parent if inside else None


def stated_plane(frame: Path) -> tuple[Path, float, Plane] | None:
    """Return the recording of a frame, its time and its plane; None if it is not in a
    recording of several planes.
    """
    recording = recording_of(frame)
    if (
        recording is None
        or not (oct_info := read_info(recording / "recording.toml").oct).plane
    ):
        return None

    for entry in read_frame_list(recording / "frames.csv"):
        if (
            entry.file == frame.name
            and (plane := oct_info.named(entry.plane)) is not None
        ):
            return recording, entry.time_s, plane

    raise RecordingError(f"{recording / 'frames.csv'}: plane: none for {frame.name}")


def read_scaled_frame(
    path: Path, given: Scanner, assumed: tuple[Scanner, str], transpose: bool = False
) -> ScaledFrame:
    """Read one frame and find its scale: `given`, else recording.toml's, the file's, or
    `assumed` with its source.
    """
    pixels, image = read_image(path)
    if transpose:
        pixels = pixels.T
        image = image.turned()

    recording = recording_of(path)
    info = None if recording is None else read_info(recording / "recording.toml")
    if info is not None:
        check_frame(pixels, info.oct, path)

    lateral_m = image.size.lateral_m
    depth_m = image.size.depth_m
    file = Scanner(
        width_m=lateral_m and lateral_m * image.columns,
        depth_m=depth_m and depth_m * image.rows,
    )
    stated = (
        (given, "option"),
        (info.oct if info else Scanner(), "recording.toml"),
        (file, "file"),
        assumed,
    )
    width, depth, index = (
        next(
            (
                Sourced(value, source)
                for scanner, source in stated
                if (value := getattr(scanner, name))
            ),
            None,
        )
        for name in ("width_m", "depth_m", "refractive_index")
    )

    if image.scale_fault and info is None and None in (given.width_m, given.depth_m):
        raise FrameError(f"{image.scale_fault}; give --width-mm and --depth-mm")
    if width is None or depth is None:
        lost = "its size is neither in the file nor in a recording.toml"
        raise FrameError(f"{path}: {lost}; give --width-mm and --depth-mm")

    for key, extent in (("width_mm", width), ("depth_mm", depth)):
        try:
            check_quantity(key, from_si(extent.value, "mm"))
        except StudyError as fault:
            raise FrameError(
                f"{path}: {fault} (stated by: {extent.source}); give"
                f" --{key.replace('_', '-')}"
            ) from None

    notes = (*image.notes, *([image.scale_fault] if image.scale_fault else []))
    return ScaledFrame(
        pixels, width, depth, index or Sourced(1.0, "assumed"), info, notes
    )
