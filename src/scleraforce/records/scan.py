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
    name_fault,
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
class OctInfo:
    """The frames: pixels, used bits, field of view (black bands included), and the
    plane's direction and tilt.

    With several planes, `plane`, direction and tilt are of the scanner's x axis.
    """

    columns: int = required(low=16, high=16384)
    rows: int = required(low=16, high=16384)
    bits: int = required(low=1, high=16)
    width_m: float = required(
        low=allowed_bounds("width_m").low, high=allowed_bounds("width_m").high
    )
    depth_m: float = required(
        low=allowed_bounds("depth_m").low, high=allowed_bounds("depth_m").high
    )
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
class Scanner:
    """Width and depth of frames in m, and the refractive index of the depth axis; None:
    not stated.
    """

    width_m: float | None = None
    depth_m: float | None = None
    refractive_index: float | None = None


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
    def of(cls, scanner: "OctStudy | OctInfo") -> "PixelScale":
        """Return the scale of a scanner's frames (`OctStudy`, `OctInfo`)."""
        lateral_m = scanner.width_m / scanner.columns
        depth_m = scanner.depth_m / scanner.rows
        return cls(
            lateral_m=lateral_m,
            depth_m=depth_m,
            refractive_index=scanner.refractive_index,
        )
