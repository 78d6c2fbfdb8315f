"""A section laid on a frame: the depths that the frame then shows at given lateral places."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Places:
    """Where a frame is looked at, (place,): lateral m, and the boundary (0 outer, 1 inner).

    The outer boundary's places come first. `smoothing_m`: over which the outer boundary was smoothed (a Gaussian's
    standard deviation).
    """

    lateral_m: Array
    boundary: NDArray[np.intp]
    smoothing_m: float = 0.0

    @property
    def outer(self) -> int:
        """How many lie on the outer boundary."""
        return int(np.searchsorted(self.boundary, 1))

    @property
    def is_inner(self) -> Array:
        """1 on the inner boundary, 0 on the outer, (place,)."""
        inner: Array = (self.boundary == 1).astype(np.float64)
        return inner


@dataclass(frozen=True, eq=False)
class Placed:
    """What a frame shows at places: depth in m and slope (place,), derivatives (place, unknown), whether reached.

    The unknowns are those of whoever predicts.
    """

    depth_m: Array
    slope: Array
    jacobian: Array
    seen: NDArray[np.bool_]


def place_curves(curves: Array, lateral_m: float, depth_m: float, rotation_rad: float) -> Array:
    """Return curves (..., sample, 2) in the frame: turned about the section's origin, then shifted."""
    c, s = np.cos(rotation_rad), np.sin(rotation_rad)
    placed: Array = curves @ np.array([[c, s], [-s, c]]) + np.array([lateral_m, depth_m])
    return placed


def pose_derivatives(places: Places, depth_m: Array, slope: Array, pose: tuple[float, float]) -> tuple[Array, ...]:
    """Return how the depths change with lateral shift, depth and rotation of the pose, (place,) each.

    Args:
        places: where the frame is looked at.
        depth_m: of the placed curves (place,).
        slope: of the placed curves (place,).
        pose: lateral place and depth of the section's origin, m.
    """
    across, down = places.lateral_m - pose[0], depth_m - pose[1]
    return -slope, np.ones_like(depth_m), across + slope * down


def curve_depths(curves_bsc: Array, places: Places) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves (boundary, sample, 2).

    Of a wall that folds back under itself, the part that comes first along the curve counts: light sees that.
    """
    outer, inner = places.lateral_m[: places.outer], places.lateral_m[places.outer :]
    parts = (_smoothed(curves_bsc[0], outer, places.smoothing_m), _depths_along(curves_bsc[1], inner))
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return depth, slope, seen


def _smoothed(curve_sc: Array, at: Array, sd_m: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the same of a curve under a Gaussian: the three-point rule of Gauss and Hermite."""
    if not sd_m:
        return _depths_along(curve_sc, at)
    apart = sqrt(3.0) * sd_m
    found = _depths_along(curve_sc, (at + np.array([[-apart], [0.0], [apart]])).ravel())
    depth, slope = (np.array([1.0, 4.0, 1.0]) @ part.reshape(3, -1) / 6.0 for part in found[:2])
    return depth, slope, found[2].reshape(3, -1)[1]


def _depths_along(curve_sc: Array, at: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Interpolate a polyline, without what folds back; of one that only does nothing is seen."""
    lateral, down = curve_sc.T
    if (lateral[1:] <= lateral[:-1]).any():
        ahead = np.concatenate([[True], lateral[1:] > np.maximum.accumulate(lateral)[:-1]])
        lateral, down = lateral[ahead], down[ahead]
        if len(lateral) == 1:
            return np.full(at.shape, down[0]), np.zeros(at.shape), np.zeros(at.shape, dtype=np.bool_)
    segment = np.minimum(np.maximum(lateral.searchsorted(at) - 1, 0), len(lateral) - 2)
    left, top = lateral[segment], down[segment]
    slope = (down[segment + 1] - top) / (lateral[segment + 1] - left)
    return top + slope * (at - left), slope, (at >= lateral[0]) & (at <= lateral[-1])
