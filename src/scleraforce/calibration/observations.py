"""Observations: points on the wall's two boundaries in a segmented frame, with their noise (paper sec. 3.2, Fig. 4).

Half of the points lie on the outer boundary, half on the inner, at evenly spaced lateral places of what the frame shows
of it within a span about the needle; so a frame whose dent leaves the window still gives all its points. A point is the
value of a parabola fitted to the boundary over a short stretch: speckle makes the boundary rough, and roughness is
correlated over a few columns, so the stretch counts as fewer columns than it has.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

__all__ = ["Boundaries", "Observation", "Roughness", "observe_points", "roughness"]

Array = NDArray[np.float64]

STRETCH_M = 0.3e-3  # to either side of a point
LARGEST_CORRELATION = 0.97
PIXEL_SHARE = 0.2  # of a pixel: what the segmentation cannot resolve, common to a stretch


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Outer and inner boundary of the wall in a frame: geometric depth, free of refraction.

    `lateral_m` (column,) from the frame's middle, increasing; `depth_m` (2, column) from its top edge, NaN where unseen.
    `pixel_m`: depth of a pixel.
    """

    lateral_m: Array
    depth_m: Array
    pixel_m: float


@dataclass(frozen=True, eq=False)
class Observation:
    """Observed points, each (point,): lateral place and depth in m, boundary (0 outer, 1 inner), noise in m."""

    lateral_m: Array
    depth_m: Array
    boundary: NDArray[np.intp]
    sd_m: Array


@dataclass(frozen=True)
class Roughness:
    """How a boundary scatters about its smooth course: standard deviation along the normal, lag-1 correlation."""

    sd_m: float
    correlation: float

    def columns_as_one(self) -> float:
        """How many neighbouring columns count as one independent observation (AR(1))."""
        return (1 + self.correlation) / (1 - self.correlation)


def observe_points(boundaries: Boundaries, count: int, centre_m: float, span_m: float) -> Observation:
    """Take `count` points from a frame: half (rounded up) on the outer boundary, the rest on the inner.

    Args:
        boundaries: of the frame.
        count: how many points; fewer come back where a boundary is not seen.
        centre_m: lateral place of the needle in the frame.
        span_m: points lie within this distance of it.
    """
    parts = []
    for boundary, wanted in enumerate((ceil(count / 2), count // 2)):
        rough = roughness(boundaries, boundary)
        for place in _places(boundaries, boundary, wanted, centre_m, span_m):
            point = _point(boundaries, boundary, place, rough)
            if point is not None:
                parts.append((place, point[0], boundary, point[1]))
    lateral, depth, kind, sd = np.array(parts, dtype=np.float64).reshape(-1, 4).T
    return Observation(lateral, depth, kind.astype(np.intp), sd)


def roughness(boundaries: Boundaries, boundary: int) -> Roughness:
    """Measure how rough a boundary is, from what parabolas over short stretches leave of it."""
    seen = np.isfinite(boundaries.depth_m[boundary])
    step = float(np.median(np.diff(boundaries.lateral_m)))
    half = max(2, round(STRETCH_M / step))
    if seen.sum() < 4 * half:
        return Roughness(boundaries.pixel_m, 0.0)
    columns = np.flatnonzero(seen)
    starts = columns[: len(columns) // (2 * half) * 2 * half].reshape(-1, 2 * half)
    whole = starts[(np.diff(starts, axis=1) == 1).all(axis=1)]
    if len(whole) < 2:
        return Roughness(boundaries.pixel_m, 0.0)
    x = np.linspace(-1, 1, 2 * half)
    basis = np.linalg.qr(np.stack([np.ones_like(x), x, x * x], axis=1))[0]
    depth = boundaries.depth_m[boundary][whole]
    rest = depth - (depth @ basis) @ basis.T
    slope = (depth[:, -1] - depth[:, 0]) / (step * (2 * half - 1))
    rest = rest / np.sqrt(1 + slope[:, None] ** 2)
    variance = float(np.median((rest**2).sum(axis=1) / (2 * half - 3)))
    correlation = float(np.median((rest[:, 1:] * rest[:, :-1]).sum(axis=1) / np.maximum((rest**2).sum(axis=1), 1e-30)))
    return Roughness(max(variance, (boundaries.pixel_m / 12**0.5) ** 2) ** 0.5, min(max(correlation, 0.0), LARGEST_CORRELATION))


def _places(boundaries: Boundaries, boundary: int, count: int, centre_m: float, span_m: float) -> list[float]:
    """Return evenly spaced places of the part of a boundary that is seen within the span."""
    lateral = boundaries.lateral_m
    inside = np.abs(lateral - centre_m) <= span_m
    seen = lateral[inside & np.isfinite(boundaries.depth_m[boundary])]
    if count == 0 or len(seen) < 2 * count:
        return []
    return [float(place) for place in np.quantile(seen, np.linspace(0.02, 0.98, count) if count > 1 else 0.5)]


def _point(boundaries: Boundaries, boundary: int, place_m: float, rough: Roughness) -> tuple[float, float] | None:
    """Return depth and noise of the boundary at a place; None where too little of it is seen there."""
    offset = boundaries.lateral_m - place_m
    near = (np.abs(offset) <= STRETCH_M) & np.isfinite(boundaries.depth_m[boundary])
    if near.sum() < 5:
        return None
    x, depth = offset[near] / STRETCH_M, boundaries.depth_m[boundary, near]
    basis = np.stack([np.ones_like(x), x, x * x], axis=1)
    inverse = np.linalg.pinv(basis)
    value, slope, _ = inverse @ depth
    spread = float(inverse[0] @ inverse[0]) * rough.columns_as_one()
    variance = rough.sd_m**2 * min(spread, 1.0) + (PIXEL_SHARE * boundaries.pixel_m) ** 2
    return float(value), float(np.sqrt(variance * (1 + (slope / STRETCH_M) ** 2)))
