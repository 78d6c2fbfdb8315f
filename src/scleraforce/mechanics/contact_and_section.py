"""The contact, where the needle pushes; the B-scan plane there, the section that it
cuts, and the slice's window.

The eye's frame: z is the axis of the half-sphere (pole at +z), the base plane is z = 0,
gravity points to -z.
"""

from dataclasses import KW_ONLY, dataclass
from math import cos, sin

import numpy as np

from scleraforce.base.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A point of the outer surface, by polar angle (from the pole) and azimuth, in rad.

    >>> Contact(polar_rad=0.0).normal
    array([0., 0., 1.])
    """

    polar_rad: float
    azimuth_rad: float = 0.0

    @property
    def normal(self) -> Floats:
        """Outward unit normal, shape (3,); the needle axis is its opposite."""
        s = sin(self.polar_rad)
        c = cos(self.polar_rad)
        return np.array([s * cos(self.azimuth_rad), s * sin(self.azimuth_rad), c])

    @property
    def meridian(self) -> Floats:
        """Unit tangent along the meridian, away from the pole, shape (3,)."""
        s = sin(self.polar_rad)
        c = cos(self.polar_rad)
        return np.array([c * cos(self.azimuth_rad), c * sin(self.azimuth_rad), -s])

    @property
    def parallel(self) -> Floats:
        """Unit tangent along the circle of latitude, to growing azimuth, shape (3,)."""
        return np.array([-sin(self.azimuth_rad), cos(self.azimuth_rad), 0.0])

    def leaning_axis(self, tilt_rad: float, direction_rad: float) -> Floats:
        """Unit vector into the eye, `tilt_rad` from the inward normal, shape (3,).

        Its part along the wall lies `direction_rad` from the meridian, turned towards
        growing azimuth.
        """
        along = cos(direction_rad) * self.meridian + sin(direction_rad) * self.parallel
        return -cos(tilt_rad) * self.normal + sin(tilt_rad) * along


@dataclass(frozen=True)
class ScanPlane:
    """The plane of a B-scan at a contact.

    Its lateral axis lies `direction_rad` from the meridian, turned about the outward
    normal towards growing azimuth. The plane is offset by `gap_m` along its normal from
    the needle axis; `tilt_rad` turns it about its lateral axis.
    """

    contact: Contact
    _: KW_ONLY
    gap_m: float
    direction_rad: float = 0.0
    tilt_rad: float = 0.0

    @property
    def lateral(self) -> Floats:
        """Unit vector along the columns of the image, shape (3,)."""
        return (
            cos(self.direction_rad) * self.contact.meridian
            + sin(self.direction_rad) * self.contact.parallel
        )

    @property
    def offset(self) -> Floats:
        """Unit vector from the needle axis towards the (untilted) plane, shape (3,)."""
        return np.cross(self.contact.normal, self.lateral)

    @property
    def depth(self) -> Floats:
        """Unit vector along the rows of the image, into the eye, shape (3,)."""
        return (
            -cos(self.tilt_rad) * self.contact.normal + sin(self.tilt_rad) * self.offset
        )

    @property
    def normal(self) -> Floats:
        """Unit normal of the plane, shape (3,): `offset` where it is not tilted."""
        return (
            cos(self.tilt_rad) * self.offset + sin(self.tilt_rad) * self.contact.normal
        )

    def origin(self, radius_m: float) -> Floats:
        """Return the frame's origin: the undeformed contact, moved by the gap, shape
        (3,).
        """
        return radius_m * self.contact.normal + self.gap_m * self.offset


@dataclass(frozen=True)
class WallSection:
    """The wall's cut by the B-scan plane: two curves in the plane's frame.

    `outer` and `inner` have shape (points, 2): lateral and depth in m (depth grows into
    the eye), both in the order of the material, from negative to positive lateral side.
    `outer` followed by reversed `inner` is the closed contour.
    """

    outer: Floats
    inner: Floats

    @property
    def contour(self) -> Floats:
        """Closed contour of the wall, shape (outer + inner points, 2)."""
        return np.concatenate([self.outer, self.inner[::-1]])

    def shifted(self, lateral_m: float, depth_m: float) -> "WallSection":
        """Return the section moved in its plane."""
        move = np.array([lateral_m, depth_m])
        return WallSection(self.outer + move, self.inner + move)


@dataclass(frozen=True, kw_only=True)
class SliceWindow:
    """The window of the slice in the plane's frame: position of its upper left corner,
    pixels, pixel size.
    """

    left_m: float
    top_m: float
    columns: int
    rows: int
    pixel_m: float
