"""Tables of smooth functions in little room: their rows as sums of few rows, with an error that is known (NumPy only).

The basis is found greedily, as in reduced basis methods (Hesthaven, Rozza and Stamm, Certified Reduced Basis Methods,
2016, section 3.2): the row that is farthest off gives the next part of it, of which every row takes a whole number of
small steps. What the rounding leaves stays in the rest, so that later parts take it up, and the search ends when no
value is off by more than it may be. It sums up without BLAS: the result is the same for any number of threads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError

Floats = NDArray[np.float64]
Steps = NDArray[np.signedinteger]

STEP_TYPES = ("int32", "int16", "int8")  # of whole numbers of steps: the smallest one that holds a part's
STEP = 0.5  # of the error that is allowed; smaller ones need fewer parts and more bytes for each
BLOCK = 64  # rows that are worked on together: they stay in the cache


@dataclass(frozen=True, eq=False)
class ReducedRows:
    """Rows as sums of the rows of a basis.

    Attributes:
        basis_kv: a step of each part (part, value), float32.
        steps: how many of them every row takes (row, part); a table for each of `STEP_TYPES`, in the basis' order.
    """

    basis_kv: NDArray[np.float32]
    steps: tuple[Steps, ...]

    def rows(self) -> Floats:
        """Return the rows (row, value)."""
        steps_rk = np.concatenate([part.astype(np.float64) for part in self.steps], axis=1)
        rows: Floats = steps_rk @ self.basis_kv.astype(np.float64)
        return rows

    def mixed_rows(self, weights: Floats) -> Floats:
        """Return the sum of equal parts of the rows (row / part, value), each of a weight (part,)."""
        size = len(self.steps[0]) // len(weights)
        steps_rk = np.zeros((size, len(self.basis_kv)))
        for part in np.flatnonzero(weights):
            steps = [steps[part * size : (part + 1) * size].astype(np.float64) for steps in self.steps]
            steps_rk += weights[part] * np.concatenate(steps, axis=1)
        rows: Floats = steps_rk @ self.basis_kv.astype(np.float64)
        return rows


def reduce_rows(rows_rv: NDArray[np.floating], largest_error: float) -> ReducedRows:
    """Return rows in a reduced basis.

    Args:
        rows_rv: the rows (row, value), finite.
        largest_error: by which no value may be off.

    Raises:
        InputError: the values are too large for so small an error.
    """
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
    """Return the largest value of each row, whatever its sign (row,)."""
    worst: Floats = np.maximum(rest_rv.max(axis=1, initial=0.0), -rest_rv.min(axis=1, initial=0.0))
    return worst


def _taken_off(rest_rv: Floats, direction: Floats) -> Floats:
    """Take off the whole numbers of a direction that come nearest to each row; return them (row,)."""
    steps = np.empty(len(rest_rv))
    for start in range(0, len(rest_rv), BLOCK):
        block = slice(start, start + BLOCK)
        steps[block] = np.rint(np.einsum("rv,v->r", rest_rv[block], direction) / np.sum(direction**2))
        rest_rv[block] -= steps[block, None] * direction
    return steps


def _by_size(rows_rv: NDArray[np.floating], directions: list[NDArray[np.float32]], steps: list[Floats]) -> ReducedRows:
    """Put the parts that need the largest numbers first, and every number into the smallest type that holds it."""
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
