"""Interpolating cubic splines, prepared once and evaluated by four numbers each (B-splines, not-a-knot ends).

A cubic spline through n nodes is a sum of n B-splines, of which four are not zero at any place. The weights of the
B-splines are solved for once; afterwards a value costs four products, also in a tensor of several axes. Its second
derivative is continuous, its error of fourth order up to the ends (de Boor, A Practical Guide to Splines, IX, XIII).

`first_crossing` finds the first state on a load path that carries a force. Where a wall softens so far that the force
falls along the path, loading jumps from the peak over the valley behind it, and never sees the states between. A path
is the force at increasing tips with its slope there; between two tips it is a cubic (Hermite).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

SUPPORT = 4  # B-splines that are not zero at a place


@dataclass(frozen=True)
class CubicSpline:
    """The cubic splines through values at increasing `nodes`, shape (node,), at least four.

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
        """Return the weights of the B-splines through `values` at the nodes along `axis`, the same shape."""
        moved = np.moveaxis(values, axis, 0)
        columns = moved.reshape(len(self.nodes), -1)
        with np.errstate(over="ignore", invalid="ignore"):  # values may not be finite
            # One large product: each of many small ones would wait for busy cores.
            weights: Floats = (self._inverse @ columns).reshape(moved.shape)
        return np.moveaxis(weights, 0, axis)

    def weights(self, places: Floats) -> tuple[Integers, Floats]:
        """Return, for places (place,) between the ends, the first B-spline (place,) and four weights (place, 4)."""
        return self.pieces.weights(places)

    def shares(self, places: Floats) -> Floats:
        """Return the weight of each node's value at places (place, node); for a few, cheaper than all weights."""
        left, right = self._spread(self.nodes).T.copy(), self._spread(places).T.copy()
        # Elimination without pivoting: B-splines' matrices are banded and totally positive (de Boor, XIII), and the
        # threads of LAPACK wait for busy cores.
        for row in range(len(left)):
            below, beside = slice(row + 1, row + SUPPORT), slice(row, row + SUPPORT)
            factor = left[below, row, None] / left[row, row]
            left[below, beside] -= factor * left[row, beside]
            right[below] -= factor * right[row]
        for row in range(len(left) - 1, -1, -1):
            after = slice(row + 1, row + SUPPORT)
            right[row] = (right[row] - left[row, after] @ right[after]) / left[row, row]
        return np.ascontiguousarray(right.T)

    def slopes(self, coefficients: Floats) -> Floats:
        """Return the spline's derivative at the nodes; `coefficients` and result have the nodes as last axis."""
        knots, degree = self.knots, SUPPORT - 1
        of_slope = np.diff(coefficients, axis=-1) * (degree / (knots[SUPPORT:-1] - knots[1:-SUPPORT]))
        first, weights = Pieces.of(knots[1:-1], degree - 1).weights(self.nodes)
        slopes: Floats = (of_slope[..., first[:, None] + np.arange(degree)] * weights).sum(axis=-1)
        return slopes

    @cached_property
    def pieces(self) -> "Pieces":
        """The B-splines as polynomials between two knots."""
        return Pieces.of(self.knots, SUPPORT - 1)

    @cached_property
    def _inverse(self) -> Floats:
        """Inverse of the nodes' matrix (B-spline, node), which is small and well conditioned."""
        return np.asarray(np.linalg.inv(self._spread(self.nodes)))

    def _spread(self, places: Floats) -> Floats:
        """Values of all B-splines at places (place, B-spline)."""
        first, weights = self.weights(places)
        values = np.zeros((len(places), len(self.nodes)))
        np.put_along_axis(values, first[:, None] + np.arange(SUPPORT), weights, axis=1)
        return values


class Pieces(NamedTuple):
    """The B-splines that are not zero between two knots, as polynomials in the share of the way from one to the next.

    `start` and `step` are the first of two knots and their distance (interval,); `coefficient_ikb` (interval, power,
    B-spline).
    """

    start: Floats
    step: Floats
    coefficient_ikb: Floats

    @classmethod
    def of(cls, knots: Floats, degree: int) -> "Pieces":
        """Return the B-splines of a degree, by Cox and de Boor's recursion."""
        ends = knots[degree : len(knots) - degree]
        start, step = ends[:-1], np.diff(ends)
        span = degree + np.arange(len(start))
        found = np.zeros((degree + 1, degree + 1, len(start)))  # B-spline, power, interval
        found[0, 0] = 1.0
        for order in range(1, degree + 1):
            rest = np.zeros_like(found[0])
            for number in range(order):
                right, left = knots[span + number + 1], knots[span + number + 1 - order]
                part = found[number] / (right - left)
                found[number] = rest + _times(part, right - start, -step)
                rest = _times(part, start - left, step)
            found[order] = rest
        return cls(start, step, np.ascontiguousarray(found.transpose(2, 1, 0)))

    def weights(self, places: Floats) -> tuple[Integers, Floats]:
        """Return the first B-spline (place,) and the values of all that are not zero there (place, B-spline)."""
        interval = np.searchsorted(self.start[1:], places, side="right")
        share = ((places - self.start[interval]) / self.step[interval])[:, None]
        powers = self.coefficient_ikb[interval]
        values = powers[:, -1]
        for power in range(powers.shape[1] - 2, -1, -1):
            values = values * share + powers[:, power]
        return interval, values


def _times(polynomial_ki: Floats, constant: Floats, slope: Floats) -> Floats:
    """Return polynomials (power, interval) times linear ones, without the highest power, which is 0."""
    product = constant * polynomial_ki
    product[1:] += slope * polynomial_ki[:-1]
    return product


def tensor_coefficients(splines: Sequence[CubicSpline], values: Floats) -> Floats:
    """Return the weights of the products of B-splines through values, the same shape; a spline for each first axis."""
    for axis, spline in enumerate(splines):
        values = spline.coefficients(values, axis)
    return values


def values_and_slopes(splines: Sequence[CubicSpline], values: Floats, axis: int) -> Floats:
    """Return the weights over two axes of the values and their slopes at the nodes of the third.

    `values` are at the nodes (node, node, node) of the splines' axes; the nodes of `axis` stay. There is a row for each
    pair of nodes of the other two axes, with values and then slopes at the n nodes, (pair, 2 n).
    """
    moved = np.moveaxis(values, axis, -1)
    slopes = splines[axis].slopes(splines[axis].coefficients(moved, axis=2))
    others = [spline for number, spline in enumerate(splines) if number != axis]
    both = tensor_coefficients(others, np.concatenate([moved, slopes], axis=2))
    return both.reshape(-1, both.shape[2])


MOST_STEPS = 50  # bisections of an interval of 0.25 mm end far below a rounding error of its ends
CONVERGED = 1e-13  # of an interval


def first_crossing(tip_m: Floats, force_sd: Floats, slope_sd: Floats, wanted_s: Floats) -> Floats:
    """Return the smallest tip (sample,), m, at which each path carries its force; NaN where it never does.

    `force_sd` and `slope_sd` are force and slope at the increasing tips (sample, tip). The first tip is returned where
    its force is larger already.
    """
    cubic = _cubics(np.diff(tip_m), force_sd, slope_sd)
    peak_place, peak = _peaks(cubic)
    reached = np.maximum(peak, force_sd[:, 1:]) >= wanted_s[:, None]
    interval = np.argmax(reached, axis=1)
    sample = np.arange(len(wanted_s))
    coefficients = tuple(part[sample, interval] for part in cubic)
    place = _rising_root(coefficients, wanted_s, peak_place[sample, interval])
    tip = tip_m[interval] + place * np.diff(tip_m)[interval]
    tip = np.where(force_sd[:, 0] >= wanted_s, tip_m[0], tip)
    return np.where(reached.any(axis=1), tip, np.nan)


def _cubics(step: Floats, force: Floats, slope: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Coefficients of 1, x, x^2, x^3 in every interval, x from 0 to 1, each (sample, interval)."""
    start, end = slope[:, :-1] * step, slope[:, 1:] * step
    rise = np.diff(force, axis=1)
    return force[:, :-1], start, 3.0 * rise - 2.0 * start - end, start + end - 2.0 * rise


def _rising_root(cubic: tuple[Floats, ...], wanted: Floats, high: Floats) -> Floats:
    """Place between 0 and `high` where cubics reach a value from below: Newton's steps, bisection where they leave."""
    low, place = np.zeros_like(high), 0.5 * high
    for _ in range(MOST_STEPS):
        over = _value(cubic, place) - wanted
        under = over < 0.0
        low, high = np.where(under, place, low), np.where(under, high, place)
        slope = (3.0 * cubic[3] * place + 2.0 * cubic[2]) * place + cubic[1]
        step = place - np.divide(over, slope, out=np.full_like(over, np.inf), where=slope != 0.0)
        following = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        moved = np.abs(following - place).max(initial=0.0)
        place = following
        if moved < CONVERGED:
            break
    return place


def _value(cubic: tuple[Floats, ...], x: Floats) -> Floats:
    return ((cubic[3] * x + cubic[2]) * x + cubic[1]) * x + cubic[0]


def _peaks(cubic: tuple[Floats, Floats, Floats, Floats]) -> tuple[Floats, Floats]:
    """Place in 0 to 1 and value of the largest force in every interval (sample, interval)."""
    _, b, c, d = cubic
    # The maximum of the cubic is the root of b + 2 c x + 3 d x^2 where the curvature is negative, in the form that
    # does not cancel: x = b / (-c + sqrt(c^2 - 3 b d)). No such root, or one outside: the larger end.
    under = c * c - 3.0 * b * d
    divisor = np.sqrt(np.maximum(under, 0.0)) - c
    x = np.divide(b, divisor, out=np.ones_like(b), where=divisor > 0.0)
    inside = (under > 0.0) & (x > 0.0) & (x < 1.0)
    place = np.where(inside & (_value(cubic, np.where(inside, x, 1.0)) > _value(cubic, np.ones_like(x))), x, 1.0)
    return place, _value(cubic, place)
