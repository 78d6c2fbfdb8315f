"""What a frame shows of a library's wall at given columns, and how that turns with everything that is unknown.

The wall is a surface of revolution about the needle axis. The B-scan plane, parallel to that axis at a distance of one
gap, sees a point of it at the distance r from the axis at the lateral place sqrt(r² - gap²), to both sides. An eye that
is larger by a factor is the same eye at another length unit: thickness and dent count relative to it, and so does F/E,
by its square.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.responses import Library

__all__ = [
    "DEPTH", "GAP", "INNER", "IOP", "LATERAL", "MODULUS", "NAMES", "ROTATION", "SIZE", "THICKNESS", "TIP", "Places",
    "Predicted", "force_n", "place_walls", "predict",
]  # fmt: skip

Array = NDArray[np.float64]

# The unknowns of a fit, (unknown,): dent and pose in m and rad; logarithms of the eye's size over the library's, of E
# in Pa and of IOP in Pa; and an offset of the inner boundary in m, which the segmentation may see a little too deep.
NAMES = (
    "tip_m", "lateral_m", "depth_m", "rotation_rad", "gap_m", "thickness_m", "log_modulus", "log_iop", "log_size",
    "inner_m",
)  # fmt: skip
TIP, LATERAL, DEPTH, ROTATION, GAP, THICKNESS, MODULUS, IOP, SIZE, INNER = range(len(NAMES))

TIP_STEP_M, GAP_STEP_M, THICKNESS_STEP_M, LOG_PRESSURE_STEP = 20e-6, 10e-6, 5e-6, 0.05


@dataclass(frozen=True, eq=False)
class Places:
    """Where a frame was looked at, (place,): lateral m from its middle, and the boundary (0 outer, 1 inner).

    The outer boundary's come first. `smoothing_m`: over which it was smoothed (a Gaussian's standard deviation).
    """

    lateral_m: Array
    boundary: NDArray[np.intp]
    smoothing_m: float = 0.0

    @property
    def outer(self) -> int:
        """How many lie on the outer boundary."""
        return int(np.searchsorted(self.boundary, 1))


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a frame shows at places: depth in m and slope (place,), derivatives (place, unknown), whether reached."""

    depth_m: Array
    slope: Array
    jacobian: Array
    seen: NDArray[np.bool_]


def force_n(library: Library, unknown_su: Array) -> Array:
    """Return the needle's force for each set of unknowns (sample, unknown), (sample,) in N."""
    size, modulus = np.exp(unknown_su[:, SIZE]), np.exp(unknown_su[:, MODULUS])
    forces: Array = modulus * size**2 * library.forces(*_library_place(library, unknown_su))
    return forces


def place_walls(library: Library, unknown_su: Array) -> Array:
    """Return the two boundaries of walls in the frame (sample, boundary, point, 2): lateral from its middle, depth, m.

    All lie at the first sample's pose.
    """
    return _placed(_cut_walls(library, unknown_su), unknown_su[0])


def predict(library: Library, unknown: Array, places: Places) -> Predicted:
    """Return what a frame shows at places.

    Args:
        library: responses of walls.
        unknown: (unknown,), in the order of `NAMES`.
        places: where the frame was looked at.
    """
    steps = np.array([TIP_STEP_M, GAP_STEP_M, THICKNESS_STEP_M, LOG_PRESSURE_STEP])
    varied = np.repeat(unknown[None], 5, axis=0)
    varied[1:, [TIP, GAP, THICKNESS, IOP]] += np.diag(_inward(library, unknown, steps))
    moved = varied[1:, [TIP, GAP, THICKNESS, IOP]].diagonal() - unknown[[TIP, GAP, THICKNESS, IOP]]
    found = [_depths(curves, places) for curves in place_walls(library, varied)]
    (depth, slope, seen), others = found[0], found[1:]
    by_tip, by_gap, by_thickness, by_pressure = (
        (other[0] - depth) / step for other, step in zip(others, moved, strict=True)
    )
    across, down = places.lateral_m - unknown[LATERAL], depth - unknown[DEPTH]
    inner = (places.boundary == 1).astype(np.float64)
    by_size = down - slope * across
    by_size -= unknown[TIP] * by_tip + unknown[GAP] * by_gap + unknown[THICKNESS] * by_thickness
    jacobian = np.stack(
        [by_tip, -slope, np.ones_like(depth), across + slope * down, by_gap, by_thickness, -by_pressure, by_pressure,
         by_size, inner], axis=1,
    )  # fmt: skip
    jacobian[~seen] = 0.0
    return Predicted(depth + unknown[INNER] * inner, slope, jacobian, seen)


def _inward(library: Library, unknown: Array, steps: Array) -> Array:
    """Turn the steps that would leave the library, where derivatives are 0, the other way."""
    size = np.exp(unknown[SIZE])
    out = [
        unknown[TIP] / size + TIP_STEP_M > library.tip_m[-1],
        False,
        unknown[THICKNESS] / size + THICKNESS_STEP_M > library.thickness_m[-1],
        np.exp(unknown[IOP] - unknown[MODULUS] + LOG_PRESSURE_STEP) > library.iop_ratio[-1],
    ]
    return np.where(out, -steps, steps)


def _library_place(library: Library, unknown_su: Array) -> tuple[Array, Array, Array]:
    """Return thickness, IOP/E and tip of samples in the library's own size, kept within what it holds."""
    size = np.exp(unknown_su[:, SIZE])
    thickness = unknown_su[:, THICKNESS] / size
    pressure = np.exp(unknown_su[:, IOP] - unknown_su[:, MODULUS])
    return (
        np.clip(thickness, library.thickness_m[0], library.thickness_m[-1]),
        np.clip(pressure, library.iop_ratio[0], library.iop_ratio[-1]),
        np.clip(unknown_su[:, TIP] / size, library.tip_m[0], library.tip_m[-1]),
    )


def _cut_walls(library: Library, unknown_su: Array) -> Array:
    """Return the curves that the B-scan plane cuts out of walls (sample, boundary, point, 2), not yet in a frame."""
    size = np.exp(unknown_su[:, SIZE])[:, None, None, None]
    curves = library.shapes(*_library_place(library, unknown_su)).astype(np.float64)
    return cut_by_plane(curves * size, unknown_su[:, GAP])


def cut_by_plane(curves_sbnc: Array, gap_s: Array) -> Array:
    """Return both sides of surfaces of revolution, cut by a plane parallel to their axis.

    Args:
        curves_sbnc: distance from the axis and depth (sample, boundary, node, 2), nodes from the axis outwards.
        gap_s: distance of the plane from the axis, m.

    Returns:
        Lateral place and depth (sample, boundary, 2 node, 2); nodes nearer to the axis than the plane lie in the
        middle, at the depth that the plane's nearest point has.
    """
    distance, depth = curves_sbnc[..., 0], curves_sbnc[..., 1]
    square = distance**2 - gap_s[:, None, None] ** 2
    beyond = np.maximum.accumulate(square > 0.0, axis=2)
    first = np.argmax(beyond, axis=2, keepdims=True)
    before = np.maximum(first - 1, 0)
    near, far = (np.take_along_axis(square, at, axis=2) for at in (before, first))
    share = np.where(first > 0, -near / np.maximum(far - near, 1e-30), 1.0)
    top, below = (np.take_along_axis(depth, at, axis=2) for at in (before, first))
    middle = top + np.clip(share, 0.0, 1.0) * (below - top)
    lateral = np.where(beyond, np.sqrt(np.maximum(square, 0.0)), 0.0)
    down = np.where(beyond, depth, middle)
    return np.stack(
        [np.concatenate([-lateral[..., ::-1], lateral], axis=2), np.concatenate([down[..., ::-1], down], axis=2)],
        axis=3,
    )


def _placed(curves_sbmc: Array, unknown: Array) -> Array:
    """Return curves in the frame: turned about the undeformed contact, then shifted."""
    c, s = np.cos(unknown[ROTATION]), np.sin(unknown[ROTATION])
    placed: Array = curves_sbmc @ np.array([[c, s], [-s, c]]) + unknown[[LATERAL, DEPTH]]
    return placed


def _depths(curves_bmc: Array, places: Places) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves."""
    outer, inner = places.lateral_m[: places.outer], places.lateral_m[places.outer :]
    parts = (_smoothed(curves_bmc[0], outer, places.smoothing_m), _depths_along(curves_bmc[1], inner))
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return depth, slope, seen


def _smoothed(curve_mc: Array, at: Array, sd_m: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the same of a curve under a Gaussian: the three-point rule of Gauss and Hermite."""
    if not sd_m:
        return _depths_along(curve_mc, at)
    apart = sqrt(3.0) * sd_m
    found = _depths_along(curve_mc, (at + np.array([[-apart], [0.0], [apart]])).ravel())
    depth, slope = (np.array([1.0, 4.0, 1.0]) @ part.reshape(3, -1) / 6.0 for part in found[:2])
    return depth, slope, found[2].reshape(3, -1)[1]


def _depths_along(curve_mc: Array, at: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Interpolate a polyline; of a part that folds back under itself, what comes first counts: light sees that."""
    lateral, down = curve_mc.T
    reached = np.maximum.accumulate(lateral)
    ahead = np.concatenate([[True], lateral[1:] > reached[:-1]])
    lateral, down = lateral[ahead], down[ahead]
    segment = np.minimum(np.maximum(lateral.searchsorted(at) - 1, 0), len(lateral) - 2)
    left, top = lateral[segment], down[segment]
    slope = (down[segment + 1] - top) / (lateral[segment + 1] - left)
    return top + slope * (at - left), slope, (at >= lateral[0]) & (at <= lateral[-1])
