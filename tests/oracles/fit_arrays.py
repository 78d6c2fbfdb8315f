"""What a frame shows of a library's wall, and the law of its globe, by arrays: places and differences one by one."""

import numpy as np
from library_arrays import values_at
from numpy.typing import NDArray

from scleraforce.library import prediction
from scleraforce.library.placement import Placed, Places, curve_depths, place_curves, pose_derivatives
from scleraforce.library.prediction import LEAST_SD, Walls, cut_by_plane, shining
from scleraforce.library.unknowns import (
    DEPTH,
    FORM,
    GAP,
    GAP_STEP_M,
    INNER_OFFSET,
    IOP,
    LATERAL,
    LOG_PRESSURE_STEP,
    MODULUS,
    NAMES,
    POLE,
    POLE_STEP,
    PRESSURE,
    ROTATION,
    SHINE,
    SIZE,
    THICKNESS,
    THICKNESS_STEP_M,
    TIP,
    TIP_STEP_M,
    form_depths,
)

Array = NDArray[np.float64]


def predict_wall(walls: Walls, unknown: Array, places: Places) -> Placed:
    """What a frame shows at places, and its derivatives by differences; pose and form have formulas of their own."""
    depth, slope, seen = _shown(walls, unknown, unknown, places)
    jacobian = np.zeros((len(depth), len(NAMES)))
    for place, step in _inward(walls, unknown).items():
        moved = unknown.copy()
        moved[place] += step
        jacobian[:, place] = (_shown(walls, moved, unknown, places)[0] - depth) / (moved[place] - unknown[place])
    pose = unknown[LATERAL], unknown[DEPTH]
    jacobian[:, [LATERAL, DEPTH, ROTATION]] = np.stack(pose_derivatives(places, depth, slope, pose), axis=1)
    jacobian[:, MODULUS] = -jacobian[:, walls.pressure]
    jacobian[:, SIZE] = depth - unknown[DEPTH] - slope * (places.lateral_m - unknown[LATERAL])
    for place in (TIP, GAP, THICKNESS):
        jacobian[:, SIZE] -= unknown[place] * jacobian[:, place]
    jacobian[:, INNER_OFFSET] = places.is_inner
    formed, form_slope, jacobian[:, FORM] = form_depths(
        unknown[FORM], places.lateral_m - unknown[LATERAL], places.is_inner
    )
    jacobian[:, LATERAL] -= form_slope
    shine = (1.0 - places.is_inner) * shining(slope + form_slope)
    jacobian[:, SHINE] = -shine
    jacobian[~seen] = 0.0
    offset = unknown[INNER_OFFSET] * places.is_inner + formed - unknown[SHINE] * shine
    return Placed(depth + offset, slope + form_slope, jacobian, seen)


def _shown(walls: Walls, unknown: Array, pose: Array, places: Places) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Depths and slopes of an even wall at places, and whether they are reached."""
    state, size, pole = prediction._library_place(walls, unknown[None]), np.exp(unknown[SIZE]), unknown[None, POLE]
    library = walls.library
    curves = values_at(library, library.tables.curves, *state).reshape(1, 2, -1, 2) * size
    section = cut_by_plane(curves, unknown[None, GAP], prediction.ring_motion(library, walls.rings, state, pole) * size)
    return curve_depths(place_curves(section, pose[LATERAL], pose[DEPTH], pose[ROTATION])[0], places)


def _inward(walls: Walls, unknown: Array) -> dict[int, float]:
    """Steps of the unknowns that move a wall; those that would leave the library go the other way."""
    library, size = walls.library, np.exp(unknown[SIZE])
    thickness = unknown[THICKNESS] / size
    beyond = np.exp(unknown[walls.pressure] - unknown[MODULUS] + LOG_PRESSURE_STEP)
    outside = {
        TIP: unknown[TIP] / size + TIP_STEP_M > library.tip_m[-1],
        GAP: False,
        THICKNESS: thickness + THICKNESS_STEP_M > library.thickness_m[-1],
        walls.pressure: beyond > library.iop_ratio_ends(thickness)[1],
        POLE.start: unknown[POLE.start] > 0.0,
        POLE.start + 1: unknown[POLE.start + 1] > 0.0,
    }
    steps = (TIP_STEP_M, GAP_STEP_M, THICKNESS_STEP_M, LOG_PRESSURE_STEP, POLE_STEP, POLE_STEP)
    return {place: -step if out else step for (place, out), step in zip(outside.items(), steps, strict=True)}


def off_the_law(walls: Walls, unknown_su: Array) -> tuple[Array, Array]:
    """How far pressures are off their globe's law, and the standard deviation of that, (sample,) each."""
    known, library = walls.globe, walls.library
    volume = np.exp(3.0 * unknown_su[:, SIZE]) * values_at(
        library, library.tables.volumes, *prediction._library_place(walls, unknown_su)
    )
    mean, spread = known.globe(known.mean), known.globe(known.sd)
    pressure, resting = np.exp(unknown_su[:, PRESSURE]), np.exp(unknown_su[:, IOP])
    off = mean.level(pressure) - mean.level(resting) - mean.rate * volume
    return off, np.hypot(spread.rate * volume, LEAST_SD * mean.level_slope(resting) * resting)
