"""A library's tables as plain arrays, and the compiled loops that interpolate them, one state at a time.

The loops write into arrays that the caller owns.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.library.splines import SUPPORT, Pieces

Floats = NDArray[np.float64]


class SplineTables(NamedTuple):
    """Spline weights and axes of a library.

    `curves` (t p d, b n c), `undented` (t p, b n c), `forces` and `volumes` (t p d,) are the weights; the splines run
    over log thickness, log tension and tip, which have `tensions` and `tips` nodes and lie between `thickness_ends_m`
    and `tension_ends`. `paths` (t p, 2 d) are the weights of force and slope at the tips `tip_m` (d,). `angles` (node,)
    belong to the walls without the needle.
    """

    thickness: Pieces
    tension: Pieces
    tip: Pieces
    tensions: int
    tips: int
    curves: NDArray[np.float32]
    undented: Floats
    forces: Floats
    volumes: Floats
    paths: Floats
    tip_m: Floats
    thickness_ends_m: tuple[float, float]
    tension_ends: tuple[float, float]
    angles: Floats
    radius_m: float
    poisson_ratio: float


Curves = NDArray[np.float32]


@dataclass(frozen=True)
class Responses:
    """States of walls, one for each sample.

    `curves_sbnc` (sample, boundary, node, 2), m: distance from the needle axis and depth below the undeformed contact
    of material points of the outer and the inner surface, from the axis outwards; float32, exact to 1 nm.
    `tip_m` (sample,): inward displacement of the contact relative to the wall under IOP alone.
    `force_ratio` (sample,): F/E, m^2.
    """

    curves_sbnc: Curves
    tip_m: Floats
    force_ratio: Floats


@compiled
def spline_weights(pieces: Pieces, place: float, weights: Floats) -> int:
    """Write the weights of the four B-splines at a place between the ends; return the first (`CubicSpline.weights`)."""
    interval = 0
    while interval + 1 < len(pieces.start) and place >= pieces.start[interval + 1]:
        interval += 1
    share = (place - pieces.start[interval]) / pieces.step[interval]
    for number in range(SUPPORT):
        value = pieces.coefficient_ikb[interval, SUPPORT - 1, number]
        for power in range(SUPPORT - 2, -1, -1):
            value = value * share + pieces.coefficient_ikb[interval, power, number]
        weights[number] = value
    return interval


@compiled
def state_weights(
    tables: SplineTables, thickness_m: float, iop_ratio: float, tip_m: float, rows: NDArray[np.intp], weights: Floats
) -> None:
    """Write the rows (64,) of the state tables that a state lies between, and their weights."""
    of_t, of_p, of_d = np.empty(SUPPORT), np.empty(SUPPORT), np.empty(SUPPORT)
    t = spline_weights(tables.thickness, np.log(thickness_m), of_t)
    p = spline_weights(tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m), of_p)
    d = spline_weights(tables.tip, tip_m, of_d)
    place = 0
    for i in range(SUPPORT):
        for j in range(SUPPORT):
            row = ((t + i) * tables.tensions + p + j) * tables.tips + d
            for k in range(SUPPORT):
                rows[place], weights[place] = row + k, of_t[i] * of_p[j] * of_d[k]
                place += 1


@compiled
def value_at(values: Floats, rows: NDArray[np.intp], weights: Floats) -> float:
    """Return the value of a table (t p d,) at a state."""
    value = 0.0
    for place in range(len(rows)):
        value += weights[place] * values[rows[place]]
    return value


@compiled
def curves_at(curves: Curves, rows: NDArray[np.intp], weights: Floats, found: Floats) -> None:
    """Write the curves (b n c,) of a state."""
    found[:] = 0.0
    for place in range(len(rows)):
        weight, row = weights[place], curves[rows[place]]
        for value in range(len(found)):
            found[value] += weight * row[value]


@compiled
def undented_at(tables: SplineTables, thickness_m: float, iop_ratio: float, found: Floats) -> None:
    """Write the wall without the needle (b n c,)."""
    of_t, of_p = np.empty(SUPPORT), np.empty(SUPPORT)
    t = spline_weights(tables.thickness, np.log(thickness_m), of_t)
    p = spline_weights(tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m), of_p)
    found[:] = 0.0
    for i in range(SUPPORT):
        for j in range(SUPPORT):
            weight, row = of_t[i] * of_p[j], tables.undented[(t + i) * tables.tensions + p + j]
            for value in range(len(found)):
                found[value] += weight * row[value]


@compiled
def values_at(tables: SplineTables, values: Floats, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats) -> Floats:
    """Return the values of a table (t p d,) at states (sample,)."""
    rows, weights, found = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3), np.empty(len(tip_m))
    for sample in range(len(found)):
        state_weights(tables, thickness_m[sample], iop_ratio[sample], tip_m[sample], rows, weights)
        found[sample] = value_at(values, rows, weights)
    return found


@compiled
def curves_of(tables: SplineTables, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats, found: Curves) -> None:
    """Write the curves (sample, b n c) of states (sample,)."""
    rows, weights, curves = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3), np.empty(found.shape[1])
    for sample in range(len(found)):
        state_weights(tables, thickness_m[sample], iop_ratio[sample], tip_m[sample], rows, weights)
        curves_at(tables.curves, rows, weights, curves)
        found[sample] = curves
