"""Compiled loops: what a frame shows of a wall and how that turns with the unknowns, and the law of its globe.

`fit_prediction.predict_wall` and `globe_term` do the same by arrays, and are their oracle.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.fitting.compiled_depths import Rings, States, depths_of_walls
from scleraforce.fitting.resting_form import SOFT_M
from scleraforce.fitting.unknowns import (
    DEPTH,
    FORM,
    GAP,
    GAP_STEP_M,
    INNER_OFFSET,
    IOP,
    LATERAL,
    LOG_PRESSURE_STEP,
    MODULUS,
    POLE,
    POLE_STEP,
    PRESSURE,
    ROTATION,
    SAME_CURVES_AND_MOTION,
    SHINE,
    SHINING_SLOPE,
    SIZE,
    THICKNESS,
    THICKNESS_STEP_M,
    TIP,
    TIP_STEP_M,
)
from scleraforce.library.compiled_pressures import level_of
from scleraforce.library.compiled_states import state_weights, value_at
from scleraforce.library.splines import SUPPORT
from scleraforce.library.tables import SplineTables

Floats = NDArray[np.float64]

ALONG, ACROSS = POLE.start, POLE.start + 1
LEFT, RIGHT, WEDGE = FORM.start, FORM.start + 3, FORM.start + 6
CURVES_OF, MOTION_OF = SAME_CURVES_AND_MOTION.astype(np.intp)


class Law(NamedTuple):
    """The law of a globe that may be sealed: the rates of its mean rigidity and of its standard deviation.

    `least_sd` is relative, of the pressure that the law gives.
    """

    is_logarithmic: bool
    mean_rate: float
    spread_rate: float
    least_sd: float


@compiled
def off_the_laws(tables: SplineTables, law: Law, unknown_su: Floats, off: Floats, sd: Floats) -> None:
    """Write how far level(P) is off its mean, and its standard deviation (sample,) (`globe_term`)."""
    rows, weights = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3)
    for sample in range(len(off)):
        unknown = unknown_su[sample]
        thickness, ratio, tip = _library_place(tables, unknown, PRESSURE)
        state_weights(tables, thickness, ratio, tip, rows, weights)
        volume = np.exp(3.0 * unknown[SIZE]) * value_at(tables.volumes, rows, weights)
        pressure, resting = np.exp(unknown[PRESSURE]), np.exp(unknown[IOP])
        risen = level_of(pressure, law.is_logarithmic) - level_of(resting, law.is_logarithmic)
        slope = 1.0 if law.is_logarithmic else np.cbrt(resting) / 3.0  # of the level by the logarithm of the pressure
        off[sample] = risen - law.mean_rate * volume
        sd[sample] = np.hypot(law.spread_rate * volume, law.least_sd * slope)


@compiled
def predict(
    tables: SplineTables,
    rings: Rings,
    unknown: Floats,
    pressure: int,
    at_m: Floats,
    outer: int,
    smoothing_m: float,
    depth_m: Floats,
    slope: Floats,
    jacobian: Floats,
    seen: NDArray[np.bool_],
) -> None:
    """Write what a frame shows at places (`placement.Placed`); `pressure`: which unknown is that under the needle."""
    moving = np.array([TIP, GAP, THICKNESS, pressure, ALONG, ACROSS])
    moved = np.empty(len(moving))
    varied = np.empty((len(moving) + 1, len(unknown)))
    varied[:] = unknown
    for number in range(len(moving)):
        place = moving[number]
        varied[number + 1, place] += _step(tables, unknown, place, pressure)
        moved[number] = varied[number + 1, place] - unknown[place]
    depths = np.empty((len(varied), len(at_m)))
    depths_of_walls(tables, rings, _states(tables, varied, pressure), at_m, outer, smoothing_m, depths, slope, seen)
    jacobian[:] = 0.0
    for place in range(len(at_m)):
        is_inner = 0.0 if place < outer else 1.0
        across, deep = at_m[place] - unknown[LATERAL], depths[0, place]
        formed, form_slope = _form(unknown, across, is_inner, jacobian[place])
        row, steep = jacobian[place], slope[place]
        by_size = deep - unknown[DEPTH] - steep * across
        for number in range(len(moving)):
            row[moving[number]] = (depths[number + 1, place] - deep) / moved[number]
        for number in (TIP, GAP, THICKNESS):
            by_size -= unknown[number] * row[number]
        row[MODULUS], row[SIZE], row[INNER_OFFSET] = -row[pressure], by_size, is_inner
        row[LATERAL], row[DEPTH] = -steep - form_slope, 1.0
        row[ROTATION] = across + steep * (deep - unknown[DEPTH])
        slope[place] = steep + form_slope
        shine = (1.0 - is_inner) * np.exp(-((slope[place] / SHINING_SLOPE) ** 2))
        row[SHINE] = -shine
        if not seen[place]:
            row[:] = 0.0
        depth_m[place] = deep + unknown[INNER_OFFSET] * is_inner + formed - unknown[SHINE] * shine


@compiled
def _library_place(tables: SplineTables, unknown: Floats, pressure: int) -> tuple[float, float, float]:
    """Return thickness, pressure over E and tip in the library's own size (`fit_prediction`)."""
    size = np.exp(unknown[SIZE])
    low, high = tables.thickness_ends_m
    thickness = min(max(unknown[THICKNESS] / size, low), high)
    per_tension = thickness / tables.radius_m
    least, most = tables.tension_ends[0] * per_tension, tables.tension_ends[1] * per_tension
    ratio = min(max(np.exp(unknown[pressure] - unknown[MODULUS]), least), most)
    return thickness, ratio, min(max(unknown[TIP] / size, tables.tip_m[0]), tables.tip_m[-1])


@compiled
def _states(tables: SplineTables, varied: Floats, pressure: int) -> States:
    """Return walls as `depths_of_walls` takes them, all at the first one's pose."""
    walls = len(varied)
    thickness, ratio, tip, size = np.empty(walls), np.empty(walls), np.empty(walls), np.empty(walls)
    for wall in range(walls):
        thickness[wall], ratio[wall], tip[wall] = _library_place(tables, varied[wall], pressure)
        size[wall] = np.exp(varied[wall, SIZE])
    return States(
        thickness, ratio, tip, size, varied[:, GAP].copy(), varied[:, ALONG : ACROSS + 1].copy(), CURVES_OF, MOTION_OF,
        varied[0, LATERAL], varied[0, DEPTH], varied[0, ROTATION],
    )  # fmt: skip


@compiled
def _step(tables: SplineTables, unknown: Floats, place: int, pressure: int) -> float:
    """Return the step of an unknown; one that would leave the library goes the other way (`fit_prediction`)."""
    size = np.exp(unknown[SIZE])
    if place == TIP:
        return -TIP_STEP_M if unknown[TIP] / size + TIP_STEP_M > tables.tip_m[-1] else TIP_STEP_M
    if place == GAP:
        return GAP_STEP_M
    thickness = unknown[THICKNESS] / size
    if place == THICKNESS:
        return -THICKNESS_STEP_M if thickness + THICKNESS_STEP_M > tables.thickness_ends_m[1] else THICKNESS_STEP_M
    if place == pressure:
        highest = tables.tension_ends[1] * (thickness / tables.radius_m)
        beyond = np.exp(unknown[pressure] - unknown[MODULUS] + LOG_PRESSURE_STEP) > highest
        return -LOG_PRESSURE_STEP if beyond else LOG_PRESSURE_STEP
    return -POLE_STEP if unknown[place] > 0.0 else POLE_STEP


@compiled
def _form(unknown: Floats, from_contact_m: float, is_inner: float, row: Floats) -> tuple[float, float]:
    """Return what a form adds to depth and slope, and write how the depth turns with it (`resting_form`)."""
    depth, slope = unknown[WEDGE] * from_contact_m * is_inner, unknown[WEDGE] * is_inner
    row[WEDGE] = from_contact_m * is_inner
    for side, first in ((-1.0, LEFT), (1.0, RIGHT)):
        angle, curvature = unknown[first + 1], unknown[first + 2]
        beyond = side * from_contact_m - unknown[first]
        root = np.sqrt(beyond**2 + SOFT_M**2)
        ramp, rise = 0.5 * (beyond + root), 0.5 * (1.0 + beyond / root)
        by_beyond = (angle + curvature * ramp) * rise
        depth += (angle + 0.5 * curvature * ramp) * ramp
        slope += side * by_beyond
        row[first], row[first + 1], row[first + 2] = -by_beyond, ramp, 0.5 * ramp**2
    return depth, slope
