"""The frames of several B-scan planes, and the material lines (stations) along which sections are followed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.section.plane import ScanPlane
from scleraforce.units import from_si

Floats = NDArray[np.float64]

STATION_M = 0.12e-3  # between stations at the contact: a chord is 2 um off where the wall bends with a radius of 1 mm
GRADING_M = 3.2e-3  # from about there on they spread out: chords are 9 um off at the far side of the eye
BEYOND_BASE_M = 0.1e-3  # the first and last station lie below the base: there the section ends on the base's rim


@dataclass(frozen=True)
class PlaneFrames:
    """The axes of several planes, lateral, depth, normal (plane, axis, 3), and their origins (plane, 3).

    On the undeformed sphere latitude and longitude are counted about the normal of each plane; longitude 0 is where the
    depth is smallest, and it grows towards the lateral axis.
    """

    axes_pac: Floats
    origins_pc: Floats

    @classmethod
    def of(cls, planes: Sequence[ScanPlane], radius_m: float) -> "PlaneFrames":
        """Stack the frames of planes through an eye of this radius."""
        axes = np.array([[plane.lateral, plane.depth, plane.normal] for plane in planes])
        return cls(axes, np.array([plane.origin(radius_m) for plane in planes]))

    def latitudes(self, radius_m: float) -> Floats:
        """Latitude of the circle that each plane cuts out of an undeformed sphere, shape (plane,).

        Raises:
            InputError: a plane passes by the sphere.
        """
        sine = np.sum(self.axes_pac[:, 2] * self.origins_pc, axis=1) / radius_m
        if np.any(np.abs(sine) > 0.98):
            raise InputError(
                f"B-scan plane: it passes {from_si(np.abs(sine).max() * radius_m, 'mm'):.2f} mm from the eye's centre "
                f"and misses the sphere of {from_si(radius_m, 'mm'):.2f} mm, or only grazes it; "
                "use a smaller gap or tilt"
            )
        latitude: Floats = np.arcsin(sine)
        return latitude

    def directions(self, longitudes: Floats, latitudes: Floats) -> Floats:
        """Directions from the centre, (plane, ...) to (plane, ..., 3); below the base plane: to the base's rim."""
        lateral, depth, normal = (self._spread(self.axes_pac[:, axis], longitudes.ndim) for axis in range(3))
        along = np.sin(longitudes)[..., None] * lateral - np.cos(longitudes)[..., None] * depth
        directions: Floats = np.cos(latitudes)[..., None] * along + np.sin(latitudes)[..., None] * normal
        directions[..., 2] = np.maximum(directions[..., 2], 0.0)
        return directions

    def project(self, fields: Floats) -> Floats:
        """Turn fields (plane, ..., 1 + mode, 3), a position and displacements, to the planes' axes."""
        moved = fields.copy()
        moved[..., 0, :] -= self._spread(self.origins_pc, fields.ndim - 2)
        axes = self.axes_pac.reshape(len(fields), *(1,) * (fields.ndim - 3), 3, 3)
        projected: Floats = moved @ np.swapaxes(axes, -1, -2)
        return projected

    @staticmethod
    def _spread(vectors_pc: Floats, dimensions: int) -> Floats:
        return vectors_pc.reshape(len(vectors_pc), *(1,) * (dimensions - 1), 3)


def place_stations(frames: PlaneFrames, circles_xp: Floats, radius_m: float) -> Floats:
    """Return the longitudes of the material lines, dense at the contact, from base to base, shape (plane, station).

    Args:
        frames: the planes.
        circles_xp: latitudes of the undeformed circles (surface, plane).
        radius_m: outer radius.

    Raises:
        InputError: a plane does not meet the wall above its base.
    """
    ends = np.array([_ends_at_base(frames, circle, BEYOND_BASE_M / radius_m) for circle in circles_xp])
    low, high = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
    # Distance s = b sinh(x h / b), x = 0, 1, 2 ...: spacing h at the contact, growing as sqrt(1 + (s/b)^2).
    first, last = np.arcsinh(low * radius_m / GRADING_M), np.arcsinh(high * radius_m / GRADING_M)
    count = 2 + int((last - first).max() * GRADING_M / STATION_M)
    stations_ps: Floats = np.sinh(np.linspace(first, last, count, axis=1)) * GRADING_M / radius_m
    return stations_ps


def _ends_at_base(frames: PlaneFrames, latitude_p: Floats, beyond: float) -> Floats:
    """Longitudes a little `beyond` those where a circle of latitude meets z = 0; -pi and pi where it does not.

    Shape (2, plane).
    """
    lateral_z, depth_z, normal_z = frames.axes_pac[:, :, 2].T
    amplitude = np.cos(latitude_p) * np.hypot(lateral_z, depth_z)  # z = amplitude cos(longitude - middle) + offset
    offset = np.sin(latitude_p) * normal_z
    if np.any(offset < -0.999 * amplitude):
        raise InputError("B-scan plane: it does not meet the wall above its base; use a smaller gap or tilt")
    closed = offset >= amplitude
    middle = np.where(closed, 0.0, np.arctan2(lateral_z, -depth_z))
    half = np.arccos(np.clip(-offset / np.maximum(amplitude, 1e-12), -1.0, 1.0)) + beyond
    half = np.where(closed, np.pi, np.minimum(half, np.pi))
    return np.stack([middle - half, middle + half])
