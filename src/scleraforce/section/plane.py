"""The B-scan plane, the section that it cuts out of the wall, and the window that becomes the slice."""

from dataclasses import KW_ONLY, dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.contact import Contact

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class ScanPlane:
    """The plane of a B-scan at a contact.

    Its lateral axis lies `direction_rad` from the meridian, turned about the outward normal towards growing azimuth.
    The plane is offset by `gap_m` along its normal from the needle axis; `tilt_rad` turns it about its lateral axis.
    """

    contact: Contact
    _: KW_ONLY
    gap_m: float
    direction_rad: float = 0.0
    tilt_rad: float = 0.0

    @property
    def lateral(self) -> Vector:
        """Unit vector along the columns of the image, shape (3,)."""
        return cos(self.direction_rad) * self.contact.meridian + sin(self.direction_rad) * self.contact.parallel

    @property
    def offset(self) -> Vector:
        """Unit vector from the needle axis towards the (untilted) plane, shape (3,)."""
        return np.cross(self.contact.normal, self.lateral)

    @property
    def depth(self) -> Vector:
        """Unit vector along the rows of the image, into the eye, shape (3,)."""
        return -cos(self.tilt_rad) * self.contact.normal + sin(self.tilt_rad) * self.offset

    @property
    def normal(self) -> Vector:
        """Unit normal of the plane, shape (3,): `offset` where it is not tilted."""
        return cos(self.tilt_rad) * self.offset + sin(self.tilt_rad) * self.contact.normal

    def origin(self, radius_m: float) -> Vector:
        """Return the frame's origin: the undeformed contact, moved by the gap, shape (3,)."""
        return radius_m * self.contact.normal + self.gap_m * self.offset


@dataclass(frozen=True)
class Section:
    """What the B-scan plane cuts out of the wall: two curves in the plane's frame.

    `outer` and `inner` have shape (points, 2): lateral and depth in m (depth grows into the eye), both in the order of
    the material, from negative to positive lateral side. `outer` followed by reversed `inner` is the closed contour.
    """

    outer: NDArray[np.float64]
    inner: NDArray[np.float64]

    @property
    def contour(self) -> NDArray[np.float64]:
        """Closed contour of the wall, shape (outer + inner points, 2)."""
        return np.concatenate([self.outer, self.inner[::-1]])

    def shifted(self, lateral_m: float, depth_m: float) -> "Section":
        """Return the section moved in its plane."""
        move = np.array([lateral_m, depth_m])
        return Section(self.outer + move, self.inner + move)


@dataclass(frozen=True, kw_only=True)
class SliceWindow:
    """The window of the slice in the plane's frame: position of its upper left corner, pixels, pixel size."""

    left_m: float
    top_m: float
    columns: int
    rows: int
    pixel_m: float
