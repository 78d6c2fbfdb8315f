"""A section laid on a frame: what the frame then shows at given lateral places, and how that turns with the pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeModel, stated_wall

__all__ = [
    "DEPTH",
    "INNER",
    "LATERAL",
    "NUISANCES",
    "POLAR",
    "ROTATION",
    "Placed",
    "Places",
    "curve_depths",
    "force_derivative",
    "place_curves",
    "polar_derivative",
    "predict",
]

Array = NDArray[np.float64]

# What a frame depends on beside the eye: the pose, the contact's polar angle, and an offset of the inner boundary (the
# segmentation's, or a wall that is not as thick as stated).
NUISANCES = ("lateral_m", "depth_m", "rotation_rad", "polar_rad", "inner_m")
LATERAL, DEPTH, ROTATION, POLAR, INNER = range(5)

MODULUS_STEP = 0.01
FORCE_STEP_N = 1e-4


@dataclass(frozen=True, eq=False)
class Places:
    """Where a frame is looked at: lateral places (place,) in m; boundaries (place,), first the outer's, 0, then 1."""

    lateral_m: Array
    boundary: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Placed:
    """What a frame shows at places, (place,) or (place, quantity), in m and SI per unit.

    `by_nuisance` (place, 5) in the order of `NUISANCES`, `by_log_modulus` (place,). `seen`: whether the section reaches
    the place at all.
    """

    depth_m: Array
    slope: Array
    by_nuisance: Array
    by_log_modulus: Array
    seen: NDArray[np.bool_]


def place_curves(curves_rbsc: Array, nuisance: Array) -> Array:
    """Return sections (..., sample, 2) in the frame: turned about the section's origin, then shifted (`Pose.place`)."""
    c, s = np.cos(nuisance[ROTATION]), np.sin(nuisance[ROTATION])
    placed: Array = curves_rbsc @ np.array([[c, s], [-s, c]]) + nuisance[[LATERAL, DEPTH]]
    return placed


def curve_depths(curves_bsc: Array, places: Places) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves (boundary, sample, 2).

    Where a wall folds over, the part that comes first in the order of the material counts.
    """
    split = int(np.searchsorted(places.boundary, 1))
    parts = [
        _depths_along(curve[:, 0], curve[:, 1], lateral)
        for curve, lateral in zip(curves_bsc, (places.lateral_m[:split], places.lateral_m[split:]), strict=True)
    ]
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return depth, slope, seen


def _depths_along(lateral_s: Array, down_s: Array, at: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    if (lateral_s[1:] <= lateral_s[:-1]).any():
        ahead = np.concatenate([[True], lateral_s[1:] > np.maximum.accumulate(lateral_s)[:-1]])
        lateral_s, down_s = lateral_s[ahead], down_s[ahead]
    segment = np.minimum(np.maximum(lateral_s.searchsorted(at) - 1, 0), len(lateral_s) - 2)
    left, top = lateral_s[segment], down_s[segment]
    slope = (down_s[segment + 1] - top) / (lateral_s[segment + 1] - left)
    return top + slope * (at - left), slope, (at >= lateral_s[0]) & (at <= lateral_s[-1])


def polar_derivative(model: EyeModel, modulus_pa: float, force_n: float, nuisance: Array, places: Places) -> Array:
    """Return how the depths at places turn with the contact's polar angle, (place,) in m/rad; 0 where it is stated."""
    low, high = model.polar_ends_rad
    if low == high:
        return np.zeros(len(places.lateral_m))
    ends = model.curves([stated_wall(model.constants, modulus_pa, force_n, polar) for polar in (low, high)])
    below, above = (curve_depths(curves, places)[0] for curves in place_curves(ends, nuisance))
    slope: Array = (above - below) / (high - low)
    return slope


def predict(model: EyeModel, modulus_pa: float, force_n: float, nuisance: Array, places: Places) -> Placed:
    """Return what a frame shows at places, with its derivatives.

    Args:
        model: the eye.
        modulus_pa: Young's modulus.
        force_n: force of the needle.
        nuisance: pose and its kin (5,), in the order of `NUISANCES`.
        places: where the frame is looked at.
    """
    moduli = (modulus_pa, modulus_pa * (1 + MODULUS_STEP))
    states = [stated_wall(model.constants, modulus, force_n, nuisance[POLAR]) for modulus in moduli]
    curves = place_curves(model.curves(states), nuisance)
    (depth, slope, seen), stiffer = (curve_depths(curve, places) for curve in curves)
    lateral, down = places.lateral_m - nuisance[LATERAL], depth - nuisance[DEPTH]
    inner = (places.boundary == 1).astype(np.float64)
    fixed = np.zeros_like(depth)  # the polar angle, see `polar_derivative`
    by_nuisance = np.stack([-slope, np.ones_like(depth), lateral + slope * down, fixed, inner], axis=1)
    return Placed(depth + nuisance[INNER] * inner, slope, by_nuisance, (stiffer[0] - depth) / MODULUS_STEP, seen)


def force_derivative(model: EyeModel, modulus_pa: float, force_n: float, nuisance: Array, places: Places) -> Array:
    """Return how the depths at places turn with the force, (place,) in m/N."""
    forces = (force_n - FORCE_STEP_N, force_n + FORCE_STEP_N)
    states = [stated_wall(model.constants, modulus_pa, force, nuisance[POLAR]) for force in forces]
    less, more = (curve_depths(curve, places)[0] for curve in place_curves(model.curves(states), nuisance))
    slope: Array = (more - less) / (2 * FORCE_STEP_N)
    return slope
