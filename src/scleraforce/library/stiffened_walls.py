"""The same walls in tissue of other stiffenings, and the reduced basis in which a model
folder stores them.

Every state changes smoothly with ln(1 + 5 b): under deep dents a little stiffening
counts. So a library holds its walls of four values of b or more, and the states of a b
between them follow from cubic splines. A model folder has the curves in a reduced
basis: there the splines are through the steps of the basis, and the walls of one b are
unpacked at a time.

The basis is found greedily, as in reduced basis methods (Hesthaven, Rozza and Stamm,
Certified Reduced Basis Methods, 2016, section 3.2): the row that is farthest off gives
the next part of it, of which every row takes a whole number of small steps. What the
rounding leaves stays in the rest, so that later parts take it up, and the search ends
when no value is off by more than it may be. It sums up without BLAS: the result is the
same for any number of threads.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from math import prod

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Reals
from scleraforce.base.errors import InputError
from scleraforce.base.kept_arrays import kept_array
from scleraforce.base.whole_files import hash_sources
from scleraforce.library.library_plan import stiffening_place
from scleraforce.library.response_splines import (
    SUPPORT,
    CubicSpline,
    Curves,
    tensor_coefficients,
)

Steps = NDArray[np.signedinteger]

# of whole numbers of steps: the smallest one that holds a part's
STEP_TYPES = (
    "int32",
    "int16",
    "int8",
)
# of the error that is allowed; smaller ones need fewer parts and more bytes for each
STEP = 0.5
BLOCK = 64  # rows that are worked on together: they stay in the cache


@dataclass(frozen=True, eq=False)
class LateSteps:
    """Tables of steps that are read at the first need; a pickle has what `read`
    holds, and what was read.
    """

    read: Callable[[], tuple[Steps, ...]]

    @cached_property
    def tables(self) -> tuple[Steps, ...]:
        """The tables, in the order of `STEP_TYPES`."""
        return self.read()


@dataclass(frozen=True, eq=False)
class ReducedRows:
    """Rows as sums of the rows of a basis.

    `basis_kv`: a step of each part (part, value), float32. `differences`: the integers
    that multiply them change smoothly along the last axis of the rows; these are their
    second differences along it (part, row / along, along), a table for each of
    `STEP_TYPES`, in the basis' order. Integers wrap around at both ends of their type,
    here and in their sums: nothing is lost.
    """

    basis_kv: NDArray[np.float32]
    differences: tuple[Steps, ...] | LateSteps

    @property
    def tables(self) -> tuple[Steps, ...]:
        """The differences, read."""
        if isinstance(self.differences, LateSteps):
            return self.differences.tables
        return self.differences

    def steps(self) -> Floats:
        """Return the integers that multiply the parts (row, part)."""
        count = prod(self.tables[0].shape[1:])
        summed = [_summed(part).reshape(len(part), count) for part in self.tables]
        return np.ascontiguousarray(np.concatenate(summed, dtype=np.float64).T)

    def rows(self) -> Floats:
        """Return the rows (row, value)."""
        return self.steps() @ self.basis_kv.astype(np.float64)

    def share(self, number: int, shares: int) -> "ReducedRows":
        """Return one of equal shares of the rows."""
        size = self.tables[0].shape[1] // shares
        own = slice(number * size, (number + 1) * size)
        return replace(self, differences=tuple(part[:, own] for part in self.tables))


def _differences(steps_kr: Steps, along: int) -> Steps:
    """Return second differences of steps (part, row) along the last axis of the rows
    (part, row / along, along).
    """
    parts, rows = steps_kr.shape
    steps_kra = steps_kr.reshape(parts, rows // along, along)
    for _ in range(2):
        steps_kra = np.diff(steps_kra, axis=-1, prepend=steps_kra.dtype.type(0))
    return np.ascontiguousarray(steps_kra)


def _summed(differences_kra: Steps) -> Steps:
    """Return the steps of second differences, both (part, row / along, along)."""
    steps_kra = differences_kra
    for _ in range(2):
        steps_kra = np.cumsum(steps_kra, axis=-1, dtype=steps_kra.dtype)
    return steps_kra


def reduce_rows(rows_rv: Reals, largest_error: float, along: int = 1) -> ReducedRows:
    """Return finite rows (row, value) in a reduced basis, with no value off by more
    than `largest_error`; `along`: length of the last axis of the rows.
    """
    rest_rv = rows_rv.astype(np.float64)
    step = STEP * largest_error
    found = _worst(rest_rv)
    directions = []
    steps = []

    while found.max(initial=0.0) > largest_error:
        farthest = rest_rv[np.argmax(found)]
        directions.append(
            (step / np.linalg.norm(farthest) * farthest).astype(np.float32)
        )
        steps.append(_taken_off(rest_rv, directions[-1].astype(np.float64)))
        found = _worst(rest_rv)

    return _by_size(rows_rv, directions, steps, along)


def _worst(rest_rv: Floats) -> Floats:
    """Return the largest absolute value of each row (row,)."""
    return np.maximum(
        rest_rv.max(axis=1, initial=0.0), -rest_rv.min(axis=1, initial=0.0)
    )


def _taken_off(rest_rv: Floats, direction: Floats) -> Floats:
    """Subtract the integer multiple of a direction that comes nearest to each row;
    return the multiples (row,).
    """
    steps = np.empty(len(rest_rv))
    for start in range(0, len(rest_rv), BLOCK):
        block = slice(start, start + BLOCK)
        steps[block] = np.rint(
            np.einsum("rv,v->r", rest_rv[block], direction) / np.sum(direction**2)
        )
        rest_rv[block] -= steps[block, None] * direction

    return steps


def _by_size(
    rows_rv: Reals,
    directions: list[NDArray[np.float32]],
    steps: list[Floats],
    along: int,
) -> ReducedRows:
    """Put the parts with the largest integers first, and every integer into the
    smallest type that holds it.
    """
    rows, values = rows_rv.shape
    basis_kv = np.reshape(np.array(directions, np.float32), (-1, values))
    steps_kr = np.reshape(steps, (-1, rows))
    most = np.abs(steps_kr).max(axis=1, initial=0.0)

    ends = [float(np.iinfo(name).max) for name in STEP_TYPES]
    if most.max(initial=0.0) > ends[0]:
        raise InputError(
            f"values up to {np.abs(rows_rv).max():.3g} cannot be stored by such small"
            " steps"
        )

    order = np.argsort(-most, kind="stable")
    bounds = [*(int(np.count_nonzero(most > end)) for end in ends), len(order)]
    tables = (
        _differences(steps_kr[order[first:last]].astype(name), along)
        for name, first, last in zip(STEP_TYPES, bounds[:-1], bounds[1:], strict=True)
    )

    return ReducedRows(basis_kv[order], tuple(tables))


Splines = Sequence[CubicSpline]


@cache
def _source_sha256() -> str:
    """Return the hash of the sources that decide the weights of a library's steps."""
    return hash_sources("library/stiffened_walls.py", "library/response_splines.py")


@dataclass(frozen=True, eq=False)
class WholeCurves:
    """Curves as they were computed (b, t, p, d, boundary, node, 2), m."""

    curves_btpdbnc: Curves

    def __post_init__(self) -> None:
        if not np.isfinite(self.curves_btpdbnc).all():
            raise InputError("library: values that are not finite")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of all curves."""
        return self.curves_btpdbnc.shape

    def mixed(self, weights_b: Floats) -> Curves:
        """Return the sum of the curves by weights (t, p, d, boundary, node, 2), m."""
        used = np.flatnonzero(weights_b)
        mixed: Curves = self.curves_btpdbnc[used[0]]

        if len(used) > 1:
            mixed = np.tensordot(
                weights_b.astype(np.float32), self.curves_btpdbnc, axes=1
            )

        return mixed

    def coefficients(self, weights_b: Floats, splines: Splines) -> Curves:
        """Return the spline weights of `mixed` over the first three axes (t p d, b n
        c).
        """
        weights = tensor_coefficients(
            splines, self.mixed(weights_b).astype(np.float64)
        ).astype(np.float32)
        return weights.reshape(prod(self.shape[1:4]), -1)

    def within(self, nodes: int) -> "WholeCurves":
        """Return the first nodes of the curves."""
        return WholeCurves(np.ascontiguousarray(self.curves_btpdbnc[..., :nodes, :]))

    def whole(self) -> Curves:
        """Return all curves (b, t, p, d, boundary, node, 2), m."""
        return self.curves_btpdbnc


@dataclass(frozen=True, eq=False)
class ReducedCurves:
    """Curves in a reduced basis: rows of (b t p d,), and the shape of all (b, t, p, d,
    boundary, node, 2).

    Splines over t, p and d are through the steps. Their weights for each b, cached, are
    the sums' of different b, too. `file_sha256`: of the file that the rows are from;
    the user's cache keeps the weights of its steps. "": of no file.
    """

    rows: ReducedRows
    shape: tuple[int, ...]
    file_sha256: str = ""
    _cached: dict[int, Curves] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        basis_kv = self.rows.basis_kv
        most = float(np.iinfo(STEP_TYPES[0]).max) * len(basis_kv)
        if not np.abs(basis_kv).max(initial=0.0) * most < np.finfo(np.float32).max:
            raise InputError("library: values that are not finite")

    def mixed(self, weights_b: Floats) -> Curves:
        """Return the sum of the curves by weights (t, p, d, boundary, node, 2), m."""
        used = np.flatnonzero(weights_b).tolist()
        values = sum(
            weights_b[b] * self.rows.share(b, len(weights_b)).rows() for b in used
        )
        return np.asarray(values, dtype=np.float32).reshape(self.shape[1:])

    def coefficients(self, weights_b: Floats, splines: Splines) -> Curves:
        """Return the spline weights of `mixed` over the first three axes (t p d, b n
        c), as exact as the curves.
        """
        steps_rk = sum(
            np.float32(weights_b[b]) * self._steps(b, splines)
            for b in np.flatnonzero(weights_b).tolist()
        )
        return np.asarray(steps_rk @ self.rows.basis_kv)

    def _steps(self, b: int, splines: Splines) -> Curves:
        """Return the spline weights of the steps of one b (t p d, part)."""
        if b not in self._cached:
            compute = partial(self._computed_steps, b, splines)
            if self.file_sha256:
                # reading takes a tenth of the time, and the file is not inflated
                shape = (prod(self.shape[1:4]), len(self.rows.basis_kv))
                nodes = [spline.nodes.tobytes() for spline in splines]
                origin = (self.file_sha256, _source_sha256(), np.__version__)
                self._cached[b] = kept_array((*origin, str(b), *nodes), shape, compute)
            else:
                self._cached[b] = compute()

        return self._cached[b]

    def _computed_steps(self, b: int, splines: Splines) -> Curves:
        """Compute the spline weights of the steps of one b (t p d, part)."""
        steps_rk = self.rows.share(b, self.shape[0]).steps()
        weights = tensor_coefficients(splines, steps_rk.reshape(*self.shape[1:4], -1))
        return weights.astype(np.float32).reshape(steps_rk.shape)

    def within(self, nodes: int) -> "ReducedCurves":
        """Return the first nodes of the curves."""
        parts = len(self.rows.basis_kv)
        shape = (*self.shape[:5], nodes, 2)
        basis_kbnc = self.rows.basis_kv.reshape(parts, *self.shape[4:])[:, :, :nodes]
        return replace(
            self,
            rows=replace(self.rows, basis_kv=basis_kbnc.reshape(parts, -1)),
            shape=shape,
        )

    def whole(self) -> Curves:
        """Return all curves (b, t, p, d, boundary, node, 2), m."""
        return self.rows.rows().astype(np.float32).reshape(self.shape)


@dataclass(frozen=True, eq=False, kw_only=True)
class StiffenedWalls:
    """Walls of each stiffening b, `stiffening` (b,), which increase: one, or at least
    four.

    `force_ratio_btpd` is F/E in m^2, `displaced_btpd` the volume in m^3 between the
    wall without the needle and with it, at one pressure, and `curves` are as in
    `Responses`, of walls clamped 90 degrees from the needle axis. `undented_btpbnc` are
    the walls without the needle, from axis to clamp.
    """

    stiffening: Floats
    force_ratio_btpd: Floats
    displaced_btpd: Floats
    undented_btpbnc: Curves
    curves: WholeCurves | ReducedCurves

    def __post_init__(self) -> None:
        count = len(self.stiffening)
        shapes = {
            len(self.force_ratio_btpd),
            len(self.displaced_btpd),
            len(self.undented_btpbnc),
        }
        if shapes != {count} or 1 < count < SUPPORT or count == 0:
            raise InputError(
                f"library: {count} stiffenings of walls of {shapes}; must be one, or at"
                f" least {SUPPORT}"
            )

        inside = np.isfinite(self.stiffening).all() and self.stiffening[0] >= 0.0
        if not inside or not (np.diff(self.stiffening) > 0.0).all():
            raise InputError("library: stiffenings that do not increase from 0 or more")

        arrays = (self.force_ratio_btpd, self.displaced_btpd, self.undented_btpbnc)
        if not all(np.isfinite(values).all() for values in arrays):
            raise InputError("library: values that are not finite")

    def within(self, nodes: int) -> "StiffenedWalls":
        """Return the walls with the first nodes of their curves."""
        return replace(self, curves=self.curves.within(nodes))

    def weights(self, stiffening: float) -> Floats:
        """Return the weight of each b at another (b,)."""
        here: Floats = (self.stiffening == stiffening).astype(np.float64)
        if here.any():
            return here

        low = float(self.stiffening[0])
        high = float(self.stiffening[-1])
        if low == high:
            raise InputError(
                f"stiffening: the library only holds tissue of {low:g}, not of"
                f" {stiffening:g}"
            )
        if not low <= stiffening <= high:  # nor is NaN
            raise InputError(
                f"stiffening: {stiffening:g} is outside the library's range, {low:g} to"
                f" {high:g}"
            )

        spline = CubicSpline(stiffening_place(self.stiffening))
        return np.asarray(spline.shares(stiffening_place(np.array([stiffening])))[0])
