"""A section laid on a frame: what the frame then shows at given lateral places, and how that turns with the pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeModel
from scleraforce.calibration.response import WallResponse

__all__ = ["INNER", "LATERAL", "DEPTH", "NUISANCES", "POLAR", "ROTATION", "Placed", "Places", "place_curves", "predict"]

Array = NDArray[np.float64]

# What a frame depends on beside the eye: the pose, the contact's polar angle, and an offset of the inner boundary (the
# segmentation's, or a wall that is not as thick as stated).
NUISANCES = ("lateral_m", "depth_m", "rotation_rad", "polar_rad", "inner_m")
LATERAL, DEPTH, ROTATION, POLAR, INNER = range(5)

POLAR_STEP_RAD = 0.02
MODULUS_STEP = 0.01
FORCE_STEP_N = 1e-4


@dataclass(frozen=True, eq=False)
class Places:
    """Where a frame is looked at: lateral places (place,) in m and boundaries (place,), 0 outer, 1 inner."""

    lateral_m: Array
    boundary: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Placed:
    """What a frame shows at places, (place,) or (place, quantity), in m and SI per unit.

    `by_nuisance` (place, 5) in the order of `NUISANCES`, `by_log_modulus` (place,), `by_force` (place,). `seen`: whether
    the section reaches the place at all.
    """

    depth_m: Array
    slope: Array
    by_nuisance: Array
    by_log_modulus: Array
    by_force: Array
    seen: NDArray[np.bool_]


def place_curves(curves_rbsc: Array, nuisance: Array) -> Array:
    """Return sections (..., sample, 2) in the frame: turned about the section's origin, then shifted (`Pose.place`)."""
    c, s = np.cos(nuisance[ROTATION]), np.sin(nuisance[ROTATION])
    placed: Array = curves_rbsc @ np.array([[c, s], [-s, c]]) + nuisance[[LATERAL, DEPTH]]
    return placed


def curve_depths(curves_bsc: Array, places: Places) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves (boundary, sample, 2).

    Where a wall folds over, the part that light meets first counts.
    """
    depth, slope = np.empty(len(places.lateral_m)), np.empty(len(places.lateral_m))
    seen = np.zeros(len(places.lateral_m), dtype=bool)
    for boundary in (0, 1):
        mine = places.boundary == boundary
        lateral, down = curves_bsc[boundary].T
        ahead = np.concatenate([[True], lateral[1:] > np.maximum.accumulate(lateral)[:-1]])
        lateral, down = lateral[ahead], down[ahead]
        segment = np.clip(np.searchsorted(lateral, places.lateral_m[mine]) - 1, 0, len(lateral) - 2)
        slope[mine] = (np.diff(down) / np.diff(lateral))[segment]
        depth[mine] = down[segment] + slope[mine] * (places.lateral_m[mine] - lateral[segment])
        seen[mine] = (places.lateral_m[mine] >= lateral[0]) & (places.lateral_m[mine] <= lateral[-1])
    return depth, slope, seen


def predict(model: EyeModel, response: WallResponse, modulus_pa: float, force_n: float, nuisance: Array, places: Places) -> Placed:
    """Return what a frame shows at places, with all derivatives; `response` is the model's at the polar angle."""
    states = [
        model.state(modulus_pa, force_n),
        model.state(modulus_pa * (1 + MODULUS_STEP), force_n),
        model.state(modulus_pa, force_n + FORCE_STEP_N),
    ]
    curves = place_curves(response.curves(states), nuisance)
    (depth, slope, seen), stiffer, pushed = (curve_depths(curve, places) for curve in curves)
    lateral, down = places.lateral_m - nuisance[LATERAL], depth - nuisance[DEPTH]
    inner = (places.boundary == 1).astype(np.float64)
    by_polar = np.zeros_like(depth)
    if len(model.polar_nodes_rad) > 1:
        turned = model.at(nuisance[POLAR] + POLAR_STEP_RAD).curves(states[:1])[0]
        by_polar = (curve_depths(place_curves(turned, nuisance), places)[0] - depth) / POLAR_STEP_RAD
    by_nuisance = np.stack([-slope, np.ones_like(depth), lateral + slope * down, by_polar, inner], axis=1)
    return Placed(
        depth + nuisance[INNER] * inner,
        slope,
        by_nuisance,
        (stiffer[0] - depth) / MODULUS_STEP,
        (pushed[0] - depth) / FORCE_STEP_N,
        seen,
    )
