"""Interpolating cubic splines, prepared once and evaluated by four numbers each (B-splines, not-a-knot ends).

A cubic spline through n nodes is a sum of n B-splines, of which four are not zero at any place. The weights of the
B-splines are solved for once; afterwards a value costs four products, also in a tensor of several axes. Its second
derivative is continuous, its error of fourth order up to the ends (de Boor, A Practical Guide to Splines, IX, XIII).
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
        """Knots, shape (node + 4,): the second node from each end is none."""
        ends = [np.repeat(self.nodes[0], SUPPORT), np.repeat(self.nodes[-1], SUPPORT)]
        return np.concatenate([ends[0], self.nodes[2:-2], ends[1]])

    def coefficients(self, values: Floats, axis: int = 0) -> Floats:
        """Return the weights of the B-splines through `values` at the nodes along `axis`, the same shape."""
        moved = np.moveaxis(values, axis, 0)
        columns = moved.reshape(len(self.nodes), -1)
        with np.errstate(over="ignore", invalid="ignore"):  # of values that are not finite neither are the weights
            # One large product: each of many small ones would wait for busy cores.
            weights: Floats = (self._inverse @ columns).reshape(moved.shape)
        return np.moveaxis(weights, 0, axis)

    def weights(self, places: Floats) -> tuple[Integers, Floats]:
        """Return, for places (place,) between the ends, the first B-spline (place,) and four weights (place, 4)."""
        return self.pieces.weights(places)

    def shares(self, places: Floats) -> Floats:
        """Return how much a value at each node counts at places (place, node); for a few, cheaper than all weights."""
        return np.asarray(np.linalg.solve(self._matrix().T, self._spread(places).T).T)

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
        """What turns values at the nodes into weights (B-spline, node): the matrix is small and well conditioned."""
        return np.asarray(np.linalg.inv(self._matrix()))

    def _matrix(self) -> Floats:
        """Values of all B-splines at the nodes (node, B-spline)."""
        return self._spread(self.nodes)

    def _spread(self, places: Floats) -> Floats:
        """Values of all B-splines at places (place, B-spline)."""
        first, weights = self.weights(places)
        values = np.zeros((len(places), len(self.nodes)))
        np.put_along_axis(values, first[:, None] + np.arange(SUPPORT), weights, axis=1)
        return values


class Pieces(NamedTuple):
    """The B-splines that are not zero between two knots, as polynomials in the share of the way from one to the next.

    `start` and `step` are the first of two knots and their distance (interval,); `coefficient_ikb` those of each power
    (interval, power, B-spline).
    """

    start: Floats
    step: Floats
    coefficient_ikb: Floats

    @classmethod
    def of(cls, knots: Floats, degree: int) -> "Pieces":
        """Return those of a degree, by Cox and de Boor's recursion."""
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
    """Return what gives the values and their slopes at the nodes of one axis, by weights over the other two.

    Args:
        splines: of the three axes.
        values: at their nodes, (node, node, node).
        axis: whose nodes stay.

    Returns:
        A row for each pair of nodes of the other two axes, with values and then slopes at the n nodes, (pair, 2 n).
    """
    moved = np.moveaxis(values, axis, -1)
    slopes = splines[axis].slopes(splines[axis].coefficients(moved, axis=2))
    others = [spline for number, spline in enumerate(splines) if number != axis]
    both = tensor_coefficients(others, np.concatenate([moved, slopes], axis=2))
    return both.reshape(-1, both.shape[2])
