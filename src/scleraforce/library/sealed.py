"""Sealed globes: the state of the library whose pressure solves the globe's law, at a dent or under a force.

A sealed globe at a dent is the open one at the pressure P with level(P) = level(P0) + rate dV, and dV the volume that
the library has for each state (`mechanics.globe`, docs/library.md). Of several solutions the lowest counts: loading
meets it first. All pressures are over E, all arguments are arrays (sample,) that broadcast.

Under a force a higher pressure leaves a shallower dent, which displaces less. So the error of the law rises with the
pressure, by jumps where a wall snaps through: compiled loops find the root by bisection, one eye at a time, and between
the last two pressures by a straight line.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.library.responses import Library
from scleraforce.library.splines import CONVERGED, MOST_STEPS, SUPPORT, first_crossing
from scleraforce.library.states import SplineTables, spline_weights, state_weights, value_at
from scleraforce.mechanics.globe import Globe
from scleraforce.study.eye import RIGIDITY_LAWS

Floats = NDArray[np.float64]


def iop_ratio_at_dent(library: Library, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats, globe: Globe) -> Floats:
    """Return the pressure over E at dents (sample,); NaN where no pressure of the library solves the law.

    It then runs away (`mechanics.equilibrium.SealedDent`), or rises beyond the library. Dents count from the undented
    wall at that pressure. `iop_ratio` is the pressure without the needle over E; the globe is over E, and its rate a
    number or (sample,). Walls without the needle, and dents, outside the library raise `InputError`.
    """
    library.check_walls(thickness_m, iop_ratio)
    thickness_m, iop_ratio, tip_m, rate = np.broadcast_arrays(thickness_m, iop_ratio, tip_m, globe.rate)
    volumes, slopes = library.displaced_along_pressure(thickness_m, tip_m)
    ratios = library.tension * (thickness_m / library.radius_m)[:, None]
    missing = globe.level(ratios) - rate[:, None] * volumes
    rise = globe.level_slope(ratios) * ratios - rate[:, None] * slopes
    log_tension = first_crossing(np.log(library.tension), missing, rise, globe.level(iop_ratio))
    return np.where(rate != 0.0, np.exp(log_tension) * thickness_m / library.radius_m, iop_ratio)


SPARE = 1e-3  # of the volume: the pressure of an end of the bracket lies beyond the solution


class SealedEyes(NamedTuple):
    """Sealed eyes under forces, (sample,) each: walls, resting pressures over E, F/E, and rates of their globes.

    `lowest` and `highest` are the library's pressures over E of these walls.
    """

    thickness_m: Floats
    resting: Floats
    force_ratio: Floats
    rate: Floats
    lowest: Floats
    highest: Floats


class SealedEye(NamedTuple):
    """One of them, with the weights over the tension of its wall's paths (p, 2 d) and a workspace (2 d,)."""

    thickness_m: float
    resting: float
    force_ratio: float
    rate: float
    is_logarithmic: bool
    along: Floats
    path: Floats


@compiled
def pressures_under_forces(
    tables: SplineTables, eyes: SealedEyes, is_logarithmic: bool, tolerance: float, found: Floats
) -> None:
    """Write the pressure over E of each eye (sample,); `tolerance` is that of its logarithm."""
    columns = tables.paths.shape[1]
    along, path = np.empty((tables.tensions, columns)), np.empty(columns)
    for n in range(len(found)):
        _paths_of_thickness(tables, eyes.thickness_m[n], along)
        thickness_m, resting = eyes.thickness_m[n], eyes.resting[n]
        eye = SealedEye(thickness_m, resting, eyes.force_ratio[n], eyes.rate[n], is_logarithmic, along, path)
        found[n] = _pressure(tables, eye, eyes.lowest[n], eyes.highest[n], tolerance)


@compiled
def _pressure(tables: SplineTables, eye: SealedEye, lowest: float, highest: float, tolerance: float) -> float:
    resting, rate = eye.resting, eye.rate
    most = _displaced(tables, eye, resting)
    bound = _pressure_of_level(level_of(resting, eye.is_logarithmic) + rate * (1.0 + SPARE) * most, eye.is_logarithmic)
    if rate > 0.0:
        low, high, below = np.log(resting), np.log(min(max(bound, resting), highest)), -rate * most
    else:
        low, high = np.log(lowest), np.log(resting)
        below = _missing(tables, eye, low)
    above = _missing(tables, eye, high)
    if above <= 0.0:
        high = np.log(highest)
        above = _missing(tables, eye, high)
    if below >= 0.0:
        return float(np.exp(low))
    if above <= 0.0:
        return float(np.exp(high))
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        missing = _missing(tables, eye, middle)
        if missing < 0.0:
            low, below = middle, missing
        else:
            high, above = middle, missing
    return float(np.exp(low - below * (high - low) / (above - below)))


@compiled
def _missing(tables: SplineTables, eye: SealedEye, log_ratio: float) -> float:
    """Return the error of the law at a pressure."""
    ratio = np.exp(log_ratio)
    risen = level_of(ratio, eye.is_logarithmic) - level_of(eye.resting, eye.is_logarithmic)
    return float(risen - eye.rate * _displaced(tables, eye, ratio))


@compiled
def _displaced(tables: SplineTables, eye: SealedEye, ratio: float) -> float:
    """Return the volume that the force displaces at a pressure over E, m^3."""
    weights, path = np.empty(SUPPORT), eye.path
    first = spline_weights(tables.tension, np.log(ratio * tables.radius_m / eye.thickness_m), weights)
    path[:] = 0.0
    for number in range(SUPPORT):
        for column in range(len(path)):
            path[column] += weights[number] * eye.along[first + number, column]
    tip = _reached_tip(tables.tip_m, path, eye.force_ratio)
    rows, of_rows = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3)
    state_weights(tables, eye.thickness_m, ratio, tip, rows, of_rows)
    return value_at(tables.volumes, rows, of_rows)


@compiled
def _paths_of_thickness(tables: SplineTables, thickness_m: float, along: Floats) -> None:
    """Write the weights over the tension of a wall's paths (p, 2 d)."""
    weights = np.empty(SUPPORT)
    first = spline_weights(tables.thickness, np.log(thickness_m), weights)
    along[:] = 0.0
    for number in range(SUPPORT):
        for tension in range(tables.tensions):
            row = tables.paths[(first + number) * tables.tensions + tension]
            for column in range(len(row)):
                along[tension, column] += weights[number] * row[column]


@compiled
def _reached_tip(tip_m: Floats, path: Floats, wanted: float) -> float:
    """Return where loading first reaches a force; the deepest tip where it never does (`splines.first_crossing`)."""
    tips = len(tip_m)
    if path[0] >= wanted:
        return float(tip_m[0])
    for tip in range(tips - 1):
        step = tip_m[tip + 1] - tip_m[tip]
        start, end = path[tips + tip] * step, path[tips + tip + 1] * step
        rise = path[tip + 1] - path[tip]
        cubic = path[tip], start, 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise
        place, peak = _peak(cubic)
        if max(peak, path[tip + 1]) >= wanted:
            return float(tip_m[tip] + step * _rising_root(cubic, wanted, place))
    return float(tip_m[-1])


@compiled
def _peak(cubic: tuple[float, float, float, float]) -> tuple[float, float]:
    """Return place and value of the largest force of an interval (`splines._peaks`)."""
    _, b, c, d = cubic
    end = _value(cubic, 1.0)
    under = c * c - 3.0 * b * d
    if under > 0.0:
        divisor = np.sqrt(under) - c
        if divisor > 0.0:
            place = b / divisor
            if 0.0 < place < 1.0 and _value(cubic, place) > end:
                return place, _value(cubic, place)
    return 1.0, end


@compiled
def _rising_root(cubic: tuple[float, float, float, float], wanted: float, high: float) -> float:
    """Return where a cubic reaches a value from below (`splines._rising_root`)."""
    low, place = 0.0, 0.5 * high
    for _ in range(MOST_STEPS):
        over = _value(cubic, place) - wanted
        if over < 0.0:
            low = place
        else:
            high = place
        slope = (3.0 * cubic[3] * place + 2.0 * cubic[2]) * place + cubic[1]
        step = place - over / slope if slope != 0.0 else np.inf
        following = step if low <= step <= high else 0.5 * (low + high)
        moved = abs(following - place)
        place = following
        if moved < CONVERGED:
            break
    return place


@compiled
def _value(cubic: tuple[float, float, float, float], x: float) -> float:
    return ((cubic[3] * x + cubic[2]) * x + cubic[1]) * x + cubic[0]


@compiled
def level_of(pressure: float, is_logarithmic: bool) -> float:
    """Return the level of a pressure, which is linear in the volume (`mechanics.globe`)."""
    return float(np.log(pressure)) if is_logarithmic else float(np.cbrt(pressure))


@compiled
def _pressure_of_level(level: float, is_logarithmic: bool) -> float:
    return np.exp(level) if is_logarithmic else max(level, 0.0) ** 3


def iop_ratio_under_force(
    library: Library, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats, globe: Globe, tolerance: float = 1e-7
) -> Floats:
    """Return the pressure over E under forces F/E (sample,), m^2; the library's highest where it rises beyond.

    Where a force is more than a wall carries, the dent counts as the library's deepest. `tolerance` is that of the
    logarithm of the pressure; other arguments and errors as for `iop_ratio_at_dent`.
    """
    walls = np.broadcast_arrays(thickness_m, iop_ratio, force_ratio, globe.rate)
    found: Floats = walls[1].astype(np.float64)
    (sealed,) = np.nonzero((walls[3] != 0.0) & (walls[2] > 0.0))
    if not len(sealed):
        return found
    thickness, resting, force, rate = (np.asarray(values[sealed], dtype=np.float64) for values in walls)
    library.check_walls(thickness, resting)
    pressures = np.empty_like(resting)
    eyes = SealedEyes(thickness, resting, force, rate, *library.iop_ratio_ends(thickness))
    pressures_under_forces(library.tables, eyes, globe.law == RIGIDITY_LAWS[1], tolerance, pressures)
    found[sealed] = pressures
    return found
