"""Curves of a wall placed in a frame: shift and turn, and the depths beside it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats


@dataclass(frozen=True, eq=False)
class PlacesOnFrame:
    """Places on a frame, (place,): lateral m, and the boundary (0 outer, 1 inner),
    outer places first.

    `smoothing_m`: standard deviation of the Gaussian that smoothed the outer boundary;
    the fit of a library heeds it.
    """

    lateral_m: Floats
    boundary: NDArray[np.intp]
    smoothing_m: float = 0.0

    @property
    def outer(self) -> int:
        """Number of places on the outer boundary."""
        return int(np.searchsorted(self.boundary, 1))

    @property
    def is_inner(self) -> Floats:
        """1 on the inner boundary, 0 on the outer, (place,)."""
        return np.asarray(self.boundary == 1, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PlacedCurves:
    """Depths at places in m and slopes (place,), derivatives (place, unknown), and
    whether each place is reached.
    """

    depth_m: Floats
    slope: Floats
    jacobian: Floats
    seen: Flags


def place_curves(
    curves: Floats, lateral_m: float, depth_m: float, rotation_rad: float
) -> Floats:
    """Return curves (..., sample, 2) in the frame: turned about the section's origin,
    then shifted.
    """
    c = np.cos(rotation_rad)
    s = np.sin(rotation_rad)
    return curves @ np.array([[c, s], [-s, c]]) + np.array([lateral_m, depth_m])


def pose_derivatives(
    places: PlacesOnFrame, depth_m: Floats, slope: Floats, pose: tuple[float, float]
) -> tuple[Floats, ...]:
    """Return the derivatives of depths (place,) by lateral shift, depth and rotation of
    the pose, (place,) each.
    """
    across = places.lateral_m - pose[0]
    down = depth_m - pose[1]
    return -slope, np.ones_like(depth_m), across + slope * down


def curve_depths(
    curves_bsc: Floats, places: PlacesOnFrame
) -> tuple[Floats, Floats, Flags]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves
    (boundary, sample, 2).

    Of a wall that folds back under itself, the part that comes first along the curve
    counts: light sees that.
    """
    parts = map(depths_along, curves_bsc, np.split(places.lateral_m, [places.outer]))
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return depth, slope, seen


def depths_along(curve_sc: Floats, at: Floats) -> tuple[Floats, Floats, Flags]:
    """Interpolate a polyline without the parts that fold back; nothing is seen of one
    that only folds back.
    """
    lateral, down = curve_sc.T
    if (lateral[1:] <= lateral[:-1]).any():
        ahead = np.concatenate(
            [[True], lateral[1:] > np.maximum.accumulate(lateral)[:-1]]
        )
        lateral = lateral[ahead]
        down = down[ahead]

        if len(lateral) == 1:
            return (
                np.full(at.shape, down[0]),
                np.zeros(at.shape),
                np.zeros(at.shape, dtype=np.bool_),
            )

    segment = np.minimum(np.maximum(lateral.searchsorted(at) - 1, 0), len(lateral) - 2)
    left = lateral[segment]
    top = down[segment]
    slope = (down[segment + 1] - top) / (lateral[segment + 1] - left)

    return top + slope * (at - left), slope, (at >= lateral[0]) & (at <= lateral[-1])
