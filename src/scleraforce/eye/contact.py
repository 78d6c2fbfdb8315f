"""Where the needle pushes, and the axes there.

The eye's frame: z is the axis of the half-sphere (pole at +z), the base plane is z = 0, gravity points to -z.
"""

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A point of the outer surface, by polar angle (from the pole) and azimuth, in rad.

    >>> Contact(polar_rad=0.0).normal
    array([0., 0., 1.])
    """

    polar_rad: float
    azimuth_rad: float = 0.0

    @property
    def normal(self) -> NDArray[np.float64]:
        """Outward unit normal, shape (3,); the needle axis is its opposite."""
        s, c = sin(self.polar_rad), cos(self.polar_rad)
        return np.array([s * cos(self.azimuth_rad), s * sin(self.azimuth_rad), c])

    @property
    def meridian(self) -> NDArray[np.float64]:
        """Unit tangent along the meridian, away from the pole, shape (3,)."""
        s, c = sin(self.polar_rad), cos(self.polar_rad)
        return np.array([c * cos(self.azimuth_rad), c * sin(self.azimuth_rad), -s])

    @property
    def parallel(self) -> NDArray[np.float64]:
        """Unit tangent along the circle of latitude, to growing azimuth, shape (3,)."""
        return np.array([-sin(self.azimuth_rad), cos(self.azimuth_rad), 0.0])

    def leaning_axis(self, tilt_rad: float, direction_rad: float) -> NDArray[np.float64]:
        """Unit vector into the eye, `tilt_rad` from the inward normal, shape (3,).

        Its part along the wall lies `direction_rad` from the meridian, turned towards growing azimuth.
        """
        along = cos(direction_rad) * self.meridian + sin(direction_rad) * self.parallel
        axis: NDArray[np.float64] = -cos(tilt_rad) * self.normal + sin(tilt_rad) * along
        return axis
