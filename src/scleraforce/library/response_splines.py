"""Interpolating cubic splines, prepared once and evaluated by four numbers each
(B-splines, not-a-knot ends).

A cubic spline through n nodes is a sum of n B-splines, of which four are not zero at
any place. The weights of the B-splines are solved for once; afterwards a value costs
four products, also in a tensor of several axes. Its second derivative is continuous,
its error of fourth order up to the ends (de Boor, A Practical Guide to Splines, IX,
XIII).

`first_crossing` finds the first state on a load path that carries a force. Where a wall
softens so far that the force falls along the path, loading jumps from the peak over the
valley behind it, and never sees the states between. A path is the force at increasing
tips with its slope there; between two tips it is a cubic (Hermite).

`SplineTables` are a library's tables as plain arrays; compiled loops interpolate them,
one state at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Places, Reals
from scleraforce.base.compiled_loops import compiled, compiled_in_place, compiled_part

Curves = NDArray[np.float32]
SUPPORT = 4  # B-splines that are not zero at a place


@dataclass(frozen=True)
class CubicSpline:
    """The cubic splines through values at increasing `nodes`, shape (node,), at least
    four.

    >>> spline = CubicSpline(np.linspace(0.0, 2.0, 5))
    >>> coefficients = spline.coefficients(spline.nodes**3)
    >>> first, weights = spline.weights(np.array([1.3]))
    >>> round(float(weights[0] @ coefficients[first[0] : first[0] + 4]), 6)
    2.197
    """

    nodes: Floats

    @cached_property
    def knots(self) -> Floats:
        """Knots, shape (node + 4,): the second node from each end is not a knot."""
        ends = [np.repeat(self.nodes[0], SUPPORT), np.repeat(self.nodes[-1], SUPPORT)]
        return np.concatenate([ends[0], self.nodes[2:-2], ends[1]])

    def coefficients(self, values: Floats, axis: int = 0) -> Floats:
        """Return the weights of the B-splines through `values` at the nodes along
        `axis`, the same shape.
        """
        moved = np.moveaxis(values, axis, 0)
        columns = moved.reshape(len(self.nodes), -1)
        with np.errstate(over="ignore", invalid="ignore"):  # values may not be finite
            # One large product: each of many small ones would wait for busy cores.
            weights: Floats = (self._inverse @ columns).reshape(moved.shape)
        return np.moveaxis(weights, 0, axis)

    def weights(self, places: Floats) -> tuple[Places, Floats]:
        """Return, for places (place,) between the ends, the first B-spline (place,) and
        four weights (place, 4).
        """
        return self.pieces.weights(places)

    def shares(self, places: Floats) -> Floats:
        """Return the weight of each node's value at places (place, node); for a few,
        cheaper than all weights.
        """
        left = self._spread(self.nodes).T.copy()
        right = self._spread(places).T.copy()

        # Elimination without pivoting: B-splines' matrices are banded and totally
        # positive (de Boor, XIII), and the threads of LAPACK wait for busy cores.
        for row in range(len(left)):
            below = slice(row + 1, row + SUPPORT)
            beside = slice(row, row + SUPPORT)
            factor = left[below, row, None] / left[row, row]
            left[below, beside] -= factor * left[row, beside]
            right[below] -= factor * right[row]

        for row in range(len(left) - 1, -1, -1):
            after = slice(row + 1, row + SUPPORT)
            right[row] = (right[row] - left[row, after] @ right[after]) / left[row, row]

        return np.ascontiguousarray(right.T)

    def slopes(self, coefficients: Floats) -> Floats:
        """Return the spline's derivative at the nodes; `coefficients` and result have
        the nodes as last axis.
        """
        knots = self.knots
        degree = SUPPORT - 1
        of_slope = np.diff(coefficients, axis=-1) * (
            degree / (knots[SUPPORT:-1] - knots[1:-SUPPORT])
        )
        first, weights = SplinePieces.of(knots[1:-1], degree - 1).weights(self.nodes)

        return (of_slope[..., first[:, None] + np.arange(degree)] * weights).sum(
            axis=-1
        )

    @cached_property
    def pieces(self) -> "SplinePieces":
        """The B-splines as polynomials between two knots."""
        return SplinePieces.of(self.knots, SUPPORT - 1)

    @cached_property
    def _inverse(self) -> Floats:
        """Inverse of the nodes' matrix (B-spline, node), which is small and well
        conditioned.
        """
        return np.asarray(np.linalg.inv(self._spread(self.nodes)))

    def _spread(self, places: Floats) -> Floats:
        """Values of all B-splines at places (place, B-spline)."""
        first, weights = self.weights(places)
        values = np.zeros((len(places), len(self.nodes)))
        np.put_along_axis(values, first[:, None] + np.arange(SUPPORT), weights, axis=1)
        return values


class SplinePieces(NamedTuple):
    """The B-splines that are not zero between two knots, as polynomials in the share of
    the way from one to the next.

    `start` and `step` are the first of two knots and their distance (interval,);
    `coefficient_ikb` (interval, power, B-spline).
    """

    start: Floats
    step: Floats
    coefficient_ikb: Floats

    @classmethod
    def of(cls, knots: Floats, degree: int) -> "SplinePieces":
        """Return the B-splines of a degree, by Cox and de Boor's recursion."""
        ends = knots[degree : len(knots) - degree]
        start = ends[:-1]
        step = np.diff(ends)
        span = degree + np.arange(len(start))
        # B-spline, power, interval
        found = np.zeros((degree + 1, degree + 1, len(start)))
        found[0, 0] = 1.0

        for order in range(1, degree + 1):
            rest = np.zeros_like(found[0])
            for number in range(order):
                right = knots[span + number + 1]
                left = knots[span + number + 1 - order]
                part = found[number] / (right - left)
                found[number] = rest + _times(part, right - start, -step)
                rest = _times(part, start - left, step)

            found[order] = rest

        return cls(start, step, np.ascontiguousarray(found.transpose(2, 1, 0)))

    def weights(self, places: Floats) -> tuple[Places, Floats]:
        """Return the first B-spline (place,) and the values of all that are not zero
        there (place, B-spline).
        """
        interval = np.searchsorted(self.start[1:], places, side="right")
        share = ((places - self.start[interval]) / self.step[interval])[:, None]
        powers = self.coefficient_ikb[interval]
        values = powers[:, -1]

        for power in range(powers.shape[1] - 2, -1, -1):
            values = values * share + powers[:, power]

        return interval, values


def _times(polynomial_ki: Floats, constant: Floats, slope: Floats) -> Floats:
    """Return polynomials (power, interval) times linear ones, without the highest
    power, which is 0.
    """
    product = constant * polynomial_ki
    product[1:] += slope * polynomial_ki[:-1]
    return product


def tensor_coefficients(splines: Sequence[CubicSpline], values: Floats) -> Floats:
    """Return the weights of the products of B-splines through values, the same shape; a
    spline for each first axis.
    """
    for axis, spline in enumerate(splines):
        values = spline.coefficients(values, axis)
    return values


def values_and_slopes(
    splines: Sequence[CubicSpline], values: Floats, axis: int
) -> Floats:
    """Return the weights over two axes of the values and their slopes at the nodes of
    the third.

    `values` are at the nodes (node, node, node) of the splines' axes; the nodes of
    `axis` stay. There is a row for each pair of nodes of the other two axes, with
    values and then slopes at the n nodes, (pair, 2 n).
    """
    moved = np.moveaxis(values, axis, -1)
    slopes = splines[axis].slopes(splines[axis].coefficients(moved, axis=2))
    others = [spline for number, spline in enumerate(splines) if number != axis]
    both = tensor_coefficients(others, np.concatenate([moved, slopes], axis=2))
    return both.reshape(-1, both.shape[2])


# bisections of an interval of 0.25 mm end far below a rounding error of its ends
MOST_STEPS = 50
CONVERGED = 1e-13  # of an interval


@compiled
def first_crossing(tip_m: Floats, paths: Floats, wanted: Floats) -> Floats:
    """Return the smallest tip (sample,), m, at which each path (sample, 2 tip) carries
    its force; NaN where none does.

    A path is the force, and then its slope, at the increasing tips.
    """
    found = np.empty(len(wanted))
    for sample in range(len(found)):
        found[sample] = first_place(tip_m, paths[sample], wanted[sample])
    return found


@compiled_part
def first_place(tip_m: Floats, path: Floats, wanted: float) -> float:
    """Return where a path first reaches a value; the first place if it is larger there
    already.
    """
    tips = len(tip_m)
    if path[0] >= wanted:
        return float(tip_m[0])

    for tip in range(tips - 1):
        step = tip_m[tip + 1] - tip_m[tip]
        start = path[tips + tip] * step
        end = path[tips + tip + 1] * step
        rise = path[tip + 1] - path[tip]
        cubic = (
            path[tip],
            start,
            3.0 * rise - 2.0 * start - end,
            start + end - 2.0 * rise,
        )

        place, peak = _peak(cubic)
        if max(peak, path[tip + 1]) >= wanted:
            return float(tip_m[tip] + step * _rising_root(cubic, wanted, place))

    return np.nan


@compiled_part
def _peak(cubic: tuple[float, float, float, float]) -> tuple[float, float]:
    """Return place and value of the largest force of an interval."""
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


@compiled_part
def _rising_root(
    cubic: tuple[float, float, float, float], wanted: float, high: float
) -> float:
    """Return where a cubic reaches a value from below."""
    low = 0.0
    place = 0.5 * high

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


@compiled_part
def _value(cubic: tuple[float, float, float, float], x: float) -> float:
    return ((cubic[3] * x + cubic[2]) * x + cubic[1]) * x + cubic[0]


class SplineTables(NamedTuple):
    """Spline weights and axes of a library.

    `curves` (t p d, b n c), `undented` (t p, b n c), `forces` and `volumes` (t p d,)
    are the weights; the splines run over log thickness, log tension and tip, which have
    `tensions` and `tips` nodes and lie between `thickness_ends_m` and `tension_ends`.
    `paths` (t p, 2 d) are the weights of force and slope at the tips `tip_m` (d,), and
    `volumes_along_tension` (t d, 2 p) of volume and slope at `log_tension` (p,).
    `angles` (node,) belong to the walls without the needle, `sines` and `cosines` to
    them.
    """

    thickness: SplinePieces
    tension: SplinePieces
    tip: SplinePieces
    tensions: int
    tips: int
    curves: Curves
    undented: Floats
    forces: Floats
    volumes: Floats
    paths: Floats
    volumes_along_tension: Floats
    log_tension: Floats
    tip_m: Floats
    thickness_ends_m: tuple[float, float]
    tension_ends: tuple[float, float]
    angles: Floats
    sines: Floats
    cosines: Floats
    radius_m: float
    poisson_ratio: float


@compiled_in_place
def node_before(nodes: Floats, place: float) -> int:
    """Return the last of increasing nodes below a place, which has a next one.

    Not np.searchsorted: to load its machine code, Numba imports SciPy's linear algebra,
    for 0.1 s.
    """
    node = 0
    after = len(nodes) - 1

    while after - node > 1:
        middle = (node + after) // 2
        if nodes[middle] < place:
            node = middle
        else:
            after = middle

    return node


@compiled_in_place
def spline_weights(
    pieces: SplinePieces, place: float
) -> tuple[int, tuple[float, float, float, float]]:
    """Return the first of four B-splines that are not zero at a place, and their
    weights (`CubicSpline.weights`).
    """
    interval = 0
    after = len(pieces.start)

    while after - interval > 1:
        middle = (interval + after) // 2
        if pieces.start[middle] <= place:
            interval = middle
        else:
            after = middle

    share = (place - pieces.start[interval]) / pieces.step[interval]
    powers = pieces.coefficient_ikb[interval]
    first = _power(powers, 0, share)
    second = _power(powers, 1, share)

    return interval, (first, second, _power(powers, 2, share), _power(powers, 3, share))


@compiled_in_place
def _power(powers: Floats, number: int, share: float) -> float:
    return float(
        ((powers[3, number] * share + powers[2, number]) * share + powers[1, number])
        * share
        + powers[0, number]
    )


@compiled_in_place
def state_weights(
    tables: SplineTables,
    thickness_m: float,
    iop_ratio: float,
    tip_m: float,
    rows: Places,
    weights: Floats,
) -> None:
    """Write the rows (64,) of the state tables that a state lies between, and their
    weights.
    """
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(
        tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m)
    )
    d, of_d = spline_weights(tables.tip, tip_m)

    for i in range(SUPPORT):
        row = ((t + i) * tables.tensions + p) * tables.tips + d
        for j, weight in enumerate((of_p[0], of_p[1], of_p[2], of_p[3])):
            place = SUPPORT * (SUPPORT * i + j)
            for k in range(SUPPORT):
                rows[place + k] = row + j * tables.tips + k

            scale = of_t[i] * weight
            weights[place] = scale * of_d[0]
            weights[place + 1] = scale * of_d[1]
            weights[place + 2] = scale * of_d[2]
            weights[place + 3] = scale * of_d[3]


Weights = tuple[float, float, float, float]


@compiled_in_place
def value_of(
    tables: SplineTables,
    values: Floats,
    thickness_m: float,
    iop_ratio: float,
    tip_m: float,
) -> float:
    """Return the value of a table (t p d,) at a state."""
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(
        tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m)
    )
    d, of_d = spline_weights(tables.tip, tip_m)
    tips = tables.tips
    row = (t * tables.tensions + p) * tables.tips + d
    # written out: a loop over a tuple takes three times as long
    step = tips * tables.tensions
    first = _over_tensions(values, row, tips, of_p, of_d)
    second = _over_tensions(values, row + step, tips, of_p, of_d)
    third = _over_tensions(values, row + 2 * step, tips, of_p, of_d)
    fourth = _over_tensions(values, row + 3 * step, tips, of_p, of_d)

    return float(
        of_t[0] * first + of_t[1] * second + of_t[2] * third + of_t[3] * fourth
    )


@compiled_in_place
def _over_tensions(
    values: Floats, row: int, tips: int, of_p: Weights, of_d: Weights
) -> float:
    first = _over_tips(values, row, of_d)
    second = _over_tips(values, row + tips, of_d)
    third = _over_tips(values, row + 2 * tips, of_d)
    fourth = _over_tips(values, row + 3 * tips, of_d)
    return of_p[0] * first + of_p[1] * second + of_p[2] * third + of_p[3] * fourth


@compiled_in_place
def _over_tips(values: Floats, row: int, of_d: Weights) -> float:
    first = of_d[0] * values[row]
    second = of_d[1] * values[row + 1]
    return float(first + second + of_d[2] * values[row + 2] + of_d[3] * values[row + 3])


@compiled_in_place
def curves_at(
    curves: Curves, rows: Places, weights: Floats, first: int, found: Floats
) -> None:
    """Write values of the curves (b n c,) of a state, from `first` on; four rows follow
    one another.
    """
    found[:] = 0.0
    for place in range(0, len(rows), SUPPORT):
        row = rows[place]
        of_row = (
            weights[place],
            weights[place + 1],
            weights[place + 2],
            weights[place + 3],
        )
        _add_rows(found, curves, row, first, of_row)


@compiled_in_place
def undented_at(
    tables: SplineTables, thickness_m: float, iop_ratio: float, found: Floats
) -> None:
    """Write the wall without the needle (b n c,)."""
    t, of_t = spline_weights(tables.thickness, np.log(thickness_m))
    p, of_p = spline_weights(
        tables.tension, np.log(iop_ratio * tables.radius_m / thickness_m)
    )
    undented = tables.undented
    found[:] = 0.0

    for i in range(SUPPORT):
        row = (t + i) * tables.tensions + p
        scale = of_t[i]
        of_row = (scale * of_p[0], scale * of_p[1], scale * of_p[2], scale * of_p[3])
        _add_rows(found, undented, row, 0, of_row)


@compiled_in_place
def _add_rows(
    found: Floats, table: Reals, row: int, first: int, of_row: Weights
) -> None:
    """Add four rows of a table (row, value) from `row` on, times their weights; values
    from `first` on.
    """
    a, b, c, d = of_row
    end = first + len(found)
    of_a = table[row, first:end]
    of_b = table[row + 1, first:end]
    of_c = table[row + 2, first:end]
    of_d = table[row + 3, first:end]

    for value in range(len(found)):
        found[value] = (
            found[value]
            + a * of_a[value]
            + b * of_b[value]
            + c * of_c[value]
            + d * of_d[value]
        )


@compiled
def values_at(
    tables: SplineTables,
    values: Floats,
    thickness_m: Floats,
    iop_ratio: Floats,
    tip_m: Floats,
) -> Floats:
    """Return the values of a table (t p d,) at states (sample,)."""
    found = np.empty(len(tip_m))
    for sample in range(len(found)):
        found[sample] = value_of(
            tables, values, thickness_m[sample], iop_ratio[sample], tip_m[sample]
        )
    return found


@compiled
def curves_of(
    tables: SplineTables,
    thickness_m: Floats,
    iop_ratio: Floats,
    tip_m: Floats,
    found: Curves,
) -> None:
    """Write the curves (sample, b n c) of states (sample,)."""
    rows = np.empty(SUPPORT**3, dtype=np.intp)
    weights = np.empty(SUPPORT**3)
    curves = np.empty(found.shape[1])

    for sample in range(len(found)):
        state_weights(
            tables, thickness_m[sample], iop_ratio[sample], tip_m[sample], rows, weights
        )
        curves_at(tables.curves, rows, weights, 0, curves)
        found[sample] = curves
