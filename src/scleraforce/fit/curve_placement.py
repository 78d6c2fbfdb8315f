"""Curves of a wall placed in a frame: shift and turn, and the depths beside it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.compiled_loops import compiled, compiled_in_place

# places, weights
GAUSS_HERMITE = (
    np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)]),
    np.array([1.0, 4.0, 1.0]) / 6.0,
)


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
    counts: light sees that. Of one that only folds back nothing is seen.
    """
    lateral_m = np.ascontiguousarray(places.lateral_m, dtype=np.float64)
    return _depths_of(np.ascontiguousarray(curves_bsc), lateral_m, places.outer)


@compiled
def _depths_of(
    curves_bsc: Floats, lateral_m: Floats, outer: int
) -> tuple[Floats, Floats, Flags]:
    """Return depth, slope and whether it is reached, each (place,)."""
    samples = curves_bsc.shape[1]
    depth = np.empty(len(lateral_m))
    slope = np.empty(len(lateral_m))
    seen = np.empty(len(lateral_m), dtype=np.bool_)
    steep = np.empty(samples)

    for boundary in range(2):
        lateral = curves_bsc[boundary, :, 0].copy()
        down = curves_bsc[boundary, :, 1].copy()
        length = without_folds(lateral, down, samples)
        begin, end = (outer, len(lateral_m)) if boundary else (0, outer)
        line = Polyline(lateral, down, steep)
        read_depths(
            line, length, lateral_m[begin:end], 0.0, depth[begin:end], slope[begin:end]
        )
        for place in range(begin, end):
            seen[place] = (
                length > 1 and lateral[0] <= lateral_m[place] <= lateral[length - 1]
            )

    return depth, slope, seen


class Polyline(NamedTuple):
    """Points in a frame, lateral and down in m, and the slope from each to the next
    (point,), which is workspace.
    """

    lateral: Floats
    down: Floats
    steep: Floats


@compiled_in_place
def without_folds(lateral: Floats, down: Floats, length: int) -> int:
    """Move the points that lie ahead of all before to the front; return their
    number.
    """
    kept = 1
    for node in range(1, length):
        if lateral[node] > lateral[kept - 1]:
            lateral[kept] = lateral[node]
            down[kept] = down[node]
            kept += 1

    return kept


@compiled_in_place
def read_depths(
    line: Polyline,
    length: int,
    at_m: Floats,
    smoothing_m: float,
    depth_m: Floats,
    slope: Floats,
) -> None:
    """Write depth and slope of the first points of a polyline at places (place,),
    averaged by a Gaussian of a standard deviation.
    """
    lateral = line.lateral
    down = line.down
    steep = line.steep
    depth_m[:] = down[0] if length == 1 else 0.0
    slope[:] = 0.0

    for segment in range(length - 1):
        steep[segment] = (down[segment + 1] - down[segment]) / (
            lateral[segment + 1] - lateral[segment]
        )

    for point in range(3) if smoothing_m > 0.0 else range(1, 2):
        weight = GAUSS_HERMITE[1][point] if smoothing_m > 0.0 else 1.0
        segment = 0

        for place in range(len(at_m) if length > 1 else 0):
            along = at_m[place] + GAUSS_HERMITE[0][point] * smoothing_m
            while segment > 0 and lateral[segment] >= along:
                segment -= 1
            while segment < length - 2 and lateral[segment + 1] < along:
                segment += 1

            depth_m[place] += weight * (
                down[segment] + steep[segment] * (along - lateral[segment])
            )
            slope[place] += weight * steep[segment]
