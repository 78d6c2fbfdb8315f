"""The same walls in tissue of other stiffenings, and the reduced basis in which a model folder stores them.

Every state changes smoothly with ln(1 + 5 b): under deep dents a little stiffening counts. So a library holds its walls
of four values of b or more, and the states of a b between them follow from cubic splines. A model folder has the curves
in a reduced basis: there the splines are through the steps of the basis, and the walls of one b are unpacked at a time.

The basis is found greedily, as in reduced basis methods (Hesthaven, Rozza and Stamm, Certified Reduced Basis Methods,
2016, section 3.2): the row that is farthest off gives the next part of it, of which every row takes a whole number of
small steps. What the rounding leaves stays in the rest, so that later parts take it up, and the search ends when no
value is off by more than it may be. It sums up without BLAS: the result is the same for any number of threads.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.library.plan import stiffening_place
from scleraforce.library.splines import SUPPORT, CubicSpline

Floats = NDArray[np.float64]
Steps = NDArray[np.signedinteger]

STEP_TYPES = ("int32", "int16", "int8")  # of whole numbers of steps: the smallest one that holds a part's
STEP = 0.5  # of the error that is allowed; smaller ones need fewer parts and more bytes for each
BLOCK = 64  # rows that are worked on together: they stay in the cache


@dataclass(frozen=True, eq=False)
class ReducedRows:
    """Rows as sums of the rows of a basis.

    `basis_kv`: a step of each part (part, value), float32. `steps`: integers (row, part) that multiply them; a table
    for each of `STEP_TYPES`, in the basis' order.
    """

    basis_kv: NDArray[np.float32]
    steps: tuple[Steps, ...]

    def rows(self) -> Floats:
        """Return the rows (row, value)."""
        steps_rk = np.concatenate([part.astype(np.float64) for part in self.steps], axis=1)
        return steps_rk @ self.basis_kv.astype(np.float64)

    def mixed_rows(self, weights: Floats) -> Floats:
        """Return the sum of equal parts of the rows (row / part, value), each of a weight (part,)."""
        size = len(self.steps[0]) // len(weights)
        steps_rk = np.zeros((size, len(self.basis_kv)))
        for part in np.flatnonzero(weights):
            steps = [steps[part * size : (part + 1) * size].astype(np.float64) for steps in self.steps]
            steps_rk += weights[part] * np.concatenate(steps, axis=1)
        return steps_rk @ self.basis_kv.astype(np.float64)


def reduce_rows(rows_rv: NDArray[np.floating], largest_error: float) -> ReducedRows:
    """Return finite rows (row, value) in a reduced basis, with no value off by more than `largest_error`."""
    rest_rv, step = rows_rv.astype(np.float64), STEP * largest_error
    found = _worst(rest_rv)
    directions, steps = [], []
    while found.max(initial=0.0) > largest_error:
        farthest = rest_rv[np.argmax(found)]
        directions.append((step / np.linalg.norm(farthest) * farthest).astype(np.float32))
        steps.append(_taken_off(rest_rv, directions[-1].astype(np.float64)))
        found = _worst(rest_rv)
    return _by_size(rows_rv, directions, steps)


def _worst(rest_rv: Floats) -> Floats:
    """Return the largest absolute value of each row (row,)."""
    worst: Floats = np.maximum(rest_rv.max(axis=1, initial=0.0), -rest_rv.min(axis=1, initial=0.0))
    return worst


def _taken_off(rest_rv: Floats, direction: Floats) -> Floats:
    """Subtract the integer multiple of a direction that comes nearest to each row; return the multiples (row,)."""
    steps = np.empty(len(rest_rv))
    for start in range(0, len(rest_rv), BLOCK):
        block = slice(start, start + BLOCK)
        steps[block] = np.rint(np.einsum("rv,v->r", rest_rv[block], direction) / np.sum(direction**2))
        rest_rv[block] -= steps[block, None] * direction
    return steps


def _by_size(rows_rv: NDArray[np.floating], directions: list[NDArray[np.float32]], steps: list[Floats]) -> ReducedRows:
    """Put the parts with the largest integers first, and every integer into the smallest type that holds it."""
    rows, values = rows_rv.shape
    basis_kv, steps_kr = np.reshape(np.array(directions, np.float32), (-1, values)), np.reshape(steps, (-1, rows))
    most = np.abs(steps_kr).max(axis=1, initial=0.0)
    ends = [float(np.iinfo(name).max) for name in STEP_TYPES]
    if most.max(initial=0.0) > ends[0]:
        raise InputError(f"values up to {np.abs(rows_rv).max():.3g} cannot be stored by such small steps")
    order = np.argsort(-most, kind="stable")
    bounds = [*(int(np.count_nonzero(most > end)) for end in ends), len(order)]
    tables = (
        np.ascontiguousarray(steps_kr[order[first:last]].T.astype(name))
        for name, first, last in zip(STEP_TYPES, bounds[:-1], bounds[1:], strict=True)
    )
    return ReducedRows(basis_kv[order], tuple(tables))


Curves = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class WholeCurves:
    """Curves as they were computed (b, t, p, d, boundary, node, 2), m."""

    curves_btpdbnc: Curves

    def __post_init__(self) -> None:
        if not np.isfinite(self.curves_btpdbnc).all():
            raise InputError("library: values that are not finite")

    def mixed(self, weights_b: Floats) -> Curves:
        """Return the sum of the curves by weights (t, p, d, boundary, node, 2), m."""
        used = np.flatnonzero(weights_b)
        mixed: Curves = self.curves_btpdbnc[used[0]]
        if len(used) > 1:
            mixed = np.tensordot(weights_b.astype(np.float32), self.curves_btpdbnc, axes=1)
        return mixed

    def whole(self) -> Curves:
        """Return all curves (b, t, p, d, boundary, node, 2), m."""
        return self.curves_btpdbnc


@dataclass(frozen=True, eq=False)
class ReducedCurves:
    """Curves in a reduced basis: rows of (b t p d,), and the shape of all (b, t, p, d, boundary, node, 2)."""

    rows: ReducedRows
    shape: tuple[int, ...]

    def mixed(self, weights_b: Floats) -> Curves:
        """Return the sum of the curves by weights (t, p, d, boundary, node, 2), m."""
        values = self.rows.mixed_rows(weights_b)
        return values.astype(np.float32).reshape(self.shape[1:])

    def whole(self) -> Curves:
        """Return all curves (b, t, p, d, boundary, node, 2), m."""
        return self.rows.rows().astype(np.float32).reshape(self.shape)


@dataclass(frozen=True, eq=False, kw_only=True)
class StiffenedWalls:
    """A library's walls of each stiffening b, `stiffening` (b,), which increase: one, or at least four.

    `force_ratio_btpd`, `displaced_btpd`, `undented_btpbnc` and `curves` are the arrays of `Library`, for each b. Of the
    curves only the first `nodes` are given.
    """

    stiffening: Floats
    force_ratio_btpd: Floats
    displaced_btpd: Floats
    undented_btpbnc: Curves
    curves: WholeCurves | ReducedCurves
    nodes: int | None = None

    def __post_init__(self) -> None:
        count = len(self.stiffening)
        shapes = {len(self.force_ratio_btpd), len(self.displaced_btpd), len(self.undented_btpbnc)}
        if shapes != {count} or 1 < count < SUPPORT or count == 0:
            raise InputError(f"library: {count} stiffenings of walls of {shapes}; must be one, or at least {SUPPORT}")
        inside = np.isfinite(self.stiffening).all() and self.stiffening[0] >= 0.0
        if not inside or not (np.diff(self.stiffening) > 0.0).all():
            raise InputError("library: stiffenings that do not increase from 0 or more")
        arrays = (self.force_ratio_btpd, self.displaced_btpd, self.undented_btpbnc)
        if not all(np.isfinite(values).all() for values in arrays):
            raise InputError("library: values that are not finite")

    def at(self, stiffening: float) -> dict[str, Any]:
        """Return the arrays of `Library` that change with the stiffening, by name."""
        weights = self._weights(stiffening)
        undented = np.tensordot(weights, self.undented_btpbnc.astype(np.float64), axes=1)
        return {
            "force_ratio_tpd": np.tensordot(weights, self.force_ratio_btpd, axes=1),
            "displaced_tpd": np.tensordot(weights, self.displaced_btpd, axes=1),
            "undented_tpbnc": undented.astype(np.float32),
            "curves_tpdbnc": np.ascontiguousarray(self.curves.mixed(weights)[..., : self.nodes, :]),
        }

    @property
    def curves_btpdbnc(self) -> Curves:
        """All curves."""
        return np.ascontiguousarray(self.curves.whole()[..., : self.nodes, :])

    def within(self, nodes: int) -> "StiffenedWalls":
        """Return the walls with the first nodes of their curves."""
        return replace(self, nodes=nodes)

    def _weights(self, stiffening: float) -> Floats:
        """Return the weight of each b at another (b,)."""
        here: Floats = (self.stiffening == stiffening).astype(np.float64)
        if here.any():
            return here
        low, high = float(self.stiffening[0]), float(self.stiffening[-1])
        if not low <= stiffening <= high:  # nor is NaN
            raise InputError(f"stiffening: {stiffening:g} is outside the library's range, {low:g} to {high:g}")
        spline = CubicSpline(stiffening_place(self.stiffening))
        return np.asarray(spline.shares(stiffening_place(np.array([stiffening])))[0])
