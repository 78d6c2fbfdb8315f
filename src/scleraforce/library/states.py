"""A library's tables as plain arrays, and the compiled loops that interpolate them, one state at a time.

The loops write into arrays that the caller owns.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Floats, Places, Reals
from scleraforce.compiled import compiled, compiled_in_place
from scleraforce.library.splines import SUPPORT, Pieces


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


@compiled_in_place
def spline_weights(pieces: Pieces, place: float) -> tuple[int, tuple[float, float, float, float]]:
    """Return the first of four B-splines that are not zero at a place, and their weights (`CubicSpline.weights`)."""
    interval, after = 0, len(pieces.start)
    while after - interval > 1:
        middle = (interval + after) // 2
        if pieces.start[middle] <= place:
            interval = middle
        else:
            after = middle
    share, powers = (place - pieces.start[interval]) / pieces.step[interval], pieces.coefficient_ikb[interval]
    first, second = _power(powers, 0, share), _power(powers, 1, share)
    return interval, (first, second, _power(powers, 2, share), _power(powers, 3, share))


@compiled_in_place
def _power(powers: Floats, number: int, share: float) -> float:
    return float(
        ((powers[3, number] * share + powers[2, number]) * share + powers[1, number]) * share + powers[0, number]
    )


@compiled_in_place
def state_weights(
    tables: SplineTables, thickness_m: float, iop_ratio: float, tip_m: float, rows: Places, weights: Floats
) -> None:
    """Write the rows (64,) of the state tables that a state lies between, and their weights."""
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m))
    d, of_d = spline_weights(tables.tip, tip_m)
    for i in range(SUPPORT):
        row = ((t + i) * tables.tensions + p) * tables.tips + d
        for j, weight in enumerate((of_p[0], of_p[1], of_p[2], of_p[3])):
            place = SUPPORT * (SUPPORT * i + j)
            for k in range(SUPPORT):
                rows[place + k] = row + j * tables.tips + k
            scale = of_t[i] * weight
            weights[place], weights[place + 1] = scale * of_d[0], scale * of_d[1]
            weights[place + 2], weights[place + 3] = scale * of_d[2], scale * of_d[3]


Weights = tuple[float, float, float, float]


@compiled_in_place
def value_of(tables: SplineTables, values: Floats, thickness_m: float, iop_ratio: float, tip_m: float) -> float:
    """Return the value of a table (t p d,) at a state."""
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m))
    d, of_d = spline_weights(tables.tip, tip_m)
    tips, row = tables.tips, (t * tables.tensions + p) * tables.tips + d
    step = tips * tables.tensions  # written out: a loop over a tuple takes three times as long
    first, second = _over_tensions(values, row, tips, of_p, of_d), _over_tensions(values, row + step, tips, of_p, of_d)
    third = _over_tensions(values, row + 2 * step, tips, of_p, of_d)
    fourth = _over_tensions(values, row + 3 * step, tips, of_p, of_d)
    return float(of_t[0] * first + of_t[1] * second + of_t[2] * third + of_t[3] * fourth)


@compiled_in_place
def _over_tensions(values: Floats, row: int, tips: int, of_p: Weights, of_d: Weights) -> float:
    first, second = _over_tips(values, row, of_d), _over_tips(values, row + tips, of_d)
    third, fourth = _over_tips(values, row + 2 * tips, of_d), _over_tips(values, row + 3 * tips, of_d)
    return of_p[0] * first + of_p[1] * second + of_p[2] * third + of_p[3] * fourth


@compiled_in_place
def _over_tips(values: Floats, row: int, of_d: Weights) -> float:
    first, second = of_d[0] * values[row], of_d[1] * values[row + 1]
    return float(first + second + of_d[2] * values[row + 2] + of_d[3] * values[row + 3])


@compiled_in_place
def curves_at(curves: Curves, rows: Places, weights: Floats, first: int, found: Floats) -> None:
    """Write values of the curves (b n c,) of a state, from `first` on; four rows follow one another."""
    found[:] = 0.0
    for place in range(0, len(rows), SUPPORT):
        row, end = rows[place], first + len(found)
        a, b, c, d = weights[place], weights[place + 1], weights[place + 2], weights[place + 3]
        _add_rows(
            found, a, curves[row, first:end], b, curves[row + 1, first:end],
            c, curves[row + 2, first:end], d, curves[row + 3, first:end],
        )  # fmt: skip


@compiled_in_place
def undented_at(tables: SplineTables, thickness_m: float, iop_ratio: float, found: Floats) -> None:
    """Write the wall without the needle (b n c,)."""
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m))
    undented, found[:] = tables.undented, 0.0
    for i in range(SUPPORT):
        row = (t + i) * tables.tensions + p
        _add_rows(
            found, of_t[i] * of_p[0], undented[row], of_t[i] * of_p[1], undented[row + 1],
            of_t[i] * of_p[2], undented[row + 2], of_t[i] * of_p[3], undented[row + 3],
        )  # fmt: skip


@compiled_in_place
def _add_rows(
    found: Floats, a: float, of_a: Reals, b: float, of_b: Reals, c: float, of_c: Reals, d: float, of_d: Reals
) -> None:
    for value in range(len(found)):
        found[value] = found[value] + a * of_a[value] + b * of_b[value] + c * of_c[value] + d * of_d[value]


@compiled
def values_at(tables: SplineTables, values: Floats, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats) -> Floats:
    """Return the values of a table (t p d,) at states (sample,)."""
    found = np.empty(len(tip_m))
    for sample in range(len(found)):
        found[sample] = value_of(tables, values, thickness_m[sample], iop_ratio[sample], tip_m[sample])
    return found


@compiled
def curves_of(tables: SplineTables, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats, found: Curves) -> None:
    """Write the curves (sample, b n c) of states (sample,)."""
    rows, weights, curves = np.empty(SUPPORT**3, dtype=np.intp), np.empty(SUPPORT**3), np.empty(found.shape[1])
    for sample in range(len(found)):
        state_weights(tables, thickness_m[sample], iop_ratio[sample], tip_m[sample], rows, weights)
        curves_at(tables.curves, rows, weights, 0, curves)
        found[sample] = curves
