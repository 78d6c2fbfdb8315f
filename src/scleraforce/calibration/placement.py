"""What a frame shows of an eye at a pose, a modulus and a force, and how that turns with each of them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.eye_model import EyeModel, WallState
from scleraforce.fitting.placement import Placed, Places, curve_depths, place_curves, pose_derivatives
from scleraforce.known.globe import REFERENCE_RIGIDITY

Array = NDArray[np.float64]

# What a frame depends on beside the eye: the pose, the contact's polar angle, and an offset of the inner boundary (the
# segmentation's, or a wall that is not as thick as stated).
NUISANCES = ("lateral_m", "depth_m", "rotation_rad", "polar_rad", "inner_m")
BY_LATERAL, BY_DEPTH, BY_ROTATION, BY_POLAR, BY_INNER = range(5)
# Come after the nuisances among the unknowns of a frame: ln E, and the globe's rigidity over `REFERENCE_RIGIDITY`.
LOG_MODULUS, RELATIVE_RIGIDITY = 5, 6

MODULUS_STEP, RIGIDITY_STEP = 0.01, 0.02
FORCE_STEP_N = 1e-4


def place_section(curves: Array, nuisance: Array) -> Array:
    """Return sections (..., sample, 2) in the frame at the pose of `nuisance` (5,)."""
    return place_curves(curves, nuisance[BY_LATERAL], nuisance[BY_DEPTH], nuisance[BY_ROTATION])


def polar_derivative(model: EyeModel, state: WallState, nuisance: Array, places: Places) -> Array:
    """Return how the depths at places turn with the contact's polar angle, (place,) in m/rad; 0 where it is stated."""
    low, high = model.polar_ends_rad
    if low == high:
        return np.zeros(len(places.lateral_m))
    ends = model.curves([replace(state, polar_rad=polar) for polar in (low, high)])
    below, above = (curve_depths(curves, places)[0] for curves in place_section(ends, nuisance))
    slope: Array = (above - below) / (high - low)
    return slope


def predict_frame(model: EyeModel, state: WallState, nuisance: Array, places: Places) -> Placed:
    """Return what a frame shows at places; derivatives by the `NUISANCES`, ln E and the relative rigidity, (place, 7).

    Args:
        model: the eye.
        state: of its wall.
        nuisance: pose and its kin (5,), in the order of `NUISANCES`; the polar angle counts as the state has it.
        places: where the frame is looked at.
    """
    states = [state, replace(state, youngs_modulus_pa=state.youngs_modulus_pa * (1 + MODULUS_STEP))]
    if model.constants.globe.can_be_sealed:
        stiffer_globe = state.rigidity_pa13_per_m3 + RIGIDITY_STEP * REFERENCE_RIGIDITY
        states.append(replace(state, rigidity_pa13_per_m3=stiffer_globe))
    curves = place_section(model.curves(states), nuisance)
    (depth, slope, seen), stiffer, *sealed = (curve_depths(curve, places) for curve in curves)
    by_pose = pose_derivatives(places, depth, slope, (nuisance[BY_LATERAL], nuisance[BY_DEPTH]))
    by_polar = np.zeros_like(depth)  # held while a frame is fitted, see `polar_derivative`
    by_modulus = (stiffer[0] - depth) / MODULUS_STEP
    by_rigidity = (sealed[0][0] - depth) / RIGIDITY_STEP if sealed else np.zeros_like(depth)
    jacobian = np.stack([*by_pose, by_polar, places.is_inner, by_modulus, by_rigidity], axis=1)
    return Placed(depth + nuisance[BY_INNER] * places.is_inner, slope, jacobian, seen)


def force_derivative(model: EyeModel, state: WallState, nuisance: Array, places: Places) -> Array:
    """Return how the depths at places turn with the force, (place,) in m/N."""
    states = [replace(state, force_n=state.force_n + step) for step in (-FORCE_STEP_N, FORCE_STEP_N)]
    less, more = (curve_depths(curve, places)[0] for curve in place_section(model.curves(states), nuisance))
    slope: Array = (more - less) / (2 * FORCE_STEP_N)
    return slope
