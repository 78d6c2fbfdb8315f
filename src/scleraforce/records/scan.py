"""A scan: its size, its pixels and its planes."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING

from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import to_si
from scleraforce.records.fields import (
    allowed_bounds,
    check_fields,
    check_kind,
    declared,
    name_fault,
    needed,
    not_in_files,
    quantity,
    required,
)

if TYPE_CHECKING:
    from scleraforce.records.study import OctStudy


UNTABLED = ',;"'  # letters that separate and quote cells

# between two planes: a degree is 1.7e-2
LEAST_TURN_RAD = 1e-3

LEAST_OFFSET_M = 1e-6


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
        check_kind("name", self.name, str, '"across"')
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
        raise InputError(f"`planes`: {words!r}: {fault}") from None
    except ValueError:
        raise InputError(
            f"`planes`: {words!r} is not NAME:OFFSET_MM:DIRECTION_DEG, like across:0:90"
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


def check_frame_counts(counts: Mapping[str, int]) -> None:
    """Raise an `InputError` unless there are as many frames of each plane."""
    if len(set(counts.values())) > 1:
        words = ", ".join(f"{name!r} has {count}" for name, count in counts.items())
        raise InputError(
            f"`planes`: as many frames of each plane are read together; {words}"
        )


@dataclass(frozen=True, kw_only=True)
class Scan:
    """The frames of a scanner; None: not declared.

    Attributes:
        columns, rows: pixels of a frame. None: the frame's own.
        bits: of a pixel that are used. None: as many as the frame's type has.
        width_m: of a frame, black bands included. None: the recording's beside the
            frame, else as the file states; an array needs it.
        depth_m: of a frame as stored, likewise.
        refractive_index: optical over geometric depth; 1: the scanner has corrected it.
            None: the recording's, else the model's.
        direction_rad: of the lateral axis, from the meridian that leads away from the
            pole. None: any, which makes the reading less sure of the eye's slope.
        tilt_rad: of the plane, against the needle's axis. None: 0.
        planes: of a scanner that takes several at once, from its x axis; direction and
            tilt are then those of this axis.
        transposed: the depth runs along the rows of the pictures, from left to right.

    Raises:
        StudyError: a value is out of bounds, or two planes are one.

    >>> import scleraforce as sf
    >>> sf.Scan(width_m=6e-3, depth_m=3e-3).refractive_index is None
    True
    """

    columns: int | None = needed(low=16, high=16384)
    rows: int | None = needed(low=16, high=16384)
    bits: int | None = needed(low=1, high=16)
    width_m: float | None = needed(
        low=allowed_bounds("width_m").low, high=allowed_bounds("width_m").high
    )
    depth_m: float | None = needed(
        low=allowed_bounds("depth_m").low, high=allowed_bounds("depth_m").high
    )
    direction_rad: float | None = quantity(
        None, None, -6.3, 6.3, key="plane_direction_rad"
    )
    tilt_rad: float | None = quantity(
        None, None, -1.0, 1.0, key="plane_tilt_rad", absent=0.0
    )
    refractive_index: float | None = quantity(None, None, 1.0, 2.0, absent=1.0)
    planes: tuple[Plane, ...] = quantity((), key="plane")
    transposed: bool = not_in_files(False)

    def __post_init__(self) -> None:
        for plane in self.planes:
            check_kind("planes", plane, Plane, 'Plane("across", 0.0, 1.57)')
        object.__setattr__(self, "planes", tuple(self.planes))
        check_fields(self)
        check_planes(self.planes, "planes")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame; raises `InputError` where one is not
        declared.
        """
        return declared(self.rows, "scan: rows"), declared(
            self.columns, "scan: columns"
        )

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and depth of a frame; raises `InputError` where one is not declared."""
        return (
            declared(self.width_m, "scan: width_m"),
            declared(self.depth_m, "scan: depth_m"),
        )

    @property
    def pixel_bits(self) -> int:
        """Bits of a pixel that are used; raises `InputError` if not declared."""
        return declared(self.bits, "scan: bits")

    @property
    def scale(self) -> "PixelScale":
        """The size of a pixel; a refractive index that is not declared is 1."""
        return self.scale_of(self.shape)

    def scale_of(self, shape: tuple[int, ...]) -> "PixelScale":
        """Return the size of a pixel of frames of a shape, (row, column)."""
        rows, columns = shape
        width_m, depth_m = self.extent_m
        return PixelScale(
            lateral_m=width_m / columns,
            depth_m=depth_m / rows,
            refractive_index=self.refractive_index or 1.0,
        )

    def named(self, name: str | None) -> Plane | None:
        """Return the plane of a name; None if it does not exist."""
        return next((plane for plane in self.planes if plane.name == name), None)


@dataclass(frozen=True, kw_only=True)
class PixelScale:
    """The size of a frame's pixel: along a row (lateral) and along a column (optical
    depth), m.

    `refractive_index` is optical over geometric depth below the tissue surface; 1 if
    the scanner has corrected it.
    """

    lateral_m: float
    depth_m: float
    refractive_index: float = 1.0

    def __post_init__(self) -> None:
        if not (0.0 < self.lateral_m < 1.0 and 0.0 < self.depth_m < 1.0):
            raise ValueError(
                f"a pixel of {self.lateral_m} m x {self.depth_m} m: give its size in"
                " metres, above 0"
            )
        if not 1.0 <= self.refractive_index <= 2.0:
            raise ValueError(
                f"a refractive index of {self.refractive_index}: tissue lies between 1"
                " (corrected) and 2"
            )

    @classmethod
    def of(cls, scanner: "OctStudy") -> "PixelScale":
        """Return the scale of the frames of a study's scanner (of a `Scan`:
        `Scan.scale`).
        """
        lateral_m = scanner.width_m / scanner.columns
        depth_m = scanner.depth_m / scanner.rows
        return cls(
            lateral_m=lateral_m,
            depth_m=depth_m,
            refractive_index=scanner.refractive_index,
        )
