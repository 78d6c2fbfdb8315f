"""The sum of symmetric element matrices over a mesh, and its factor L D L^T by rslab.

Which entries the sum has, and in which order its unknowns are eliminated, depends only
on the elements' nodes and on what is held: it is found once for all sums over a mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Integers, Reals
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.hexahedral_mesh import HexMesh

if TYPE_CHECKING:
    from rslab import LdltSymbolic

KEPT = 2  # patterns, of 15 MB each at the default mesh
THREADS = 1  # two are no faster for such matrices


def factor_sum(
    mesh: HexMesh, held_nc: Flags, element_eiajb: Reals
) -> Callable[[Floats], Floats]:
    """Sum symmetric element matrices (element, 3, node, 3, node) and factor the sum in
    their precision; it need not be definite.

    Of each pair of entries one is read, so that the sum is symmetric to the last bit.
    Returns the solve for loads on the components that are not held, (unknown,) or
    (unknown, column), in the order of `held_nc` (node, 3).

    Raises:
        SolverError: the matrix is singular or not finite.
    """
    cells_en = mesh.cells_en.astype(np.int64)
    held = held_nc.astype(np.bool_).tobytes()
    pattern = _pattern(cells_en.tobytes(), cells_en.shape, held)
    data = pattern.summed(element_eiajb)
    if not np.isfinite(data).all():
        raise SolverError("matrix: not finite")

    try:
        factor = pattern.analysed.factor(data)
    except RuntimeError as fault:  # a pivot is zero
        raise SolverError("matrix: singular") from fault

    def solve(load: Floats) -> Floats:
        solve_load = factor.solve if load.ndim == 1 else factor.solve_many
        answer = solve_load(np.ascontiguousarray(load, data.dtype))
        return np.asarray(answer, dtype=np.float64)

    return solve


@dataclass(frozen=True, eq=False)
class _Pattern:
    """The lower triangle of a sum: which entries of the element matrices make it
    (entry,), the place in the sum of each, and the order of elimination.
    """

    taken: Integers
    places: Integers
    analysed: "LdltSymbolic"
    size: int

    def summed(self, element_eiajb: Reals) -> Reals:
        """Return the entries of the sum, in the elements' precision."""
        entries = element_eiajb.reshape(-1)[self.taken]
        data = np.bincount(self.places, entries, self.size)
        return data.astype(element_eiajb.dtype, copy=False)


@lru_cache(maxsize=KEPT)
def _pattern(cells: bytes, shape: tuple[int, int], held: bytes) -> _Pattern:
    """Return the pattern of elements' nodes, int64 of a shape (element, node), and of
    what is held, bool (node, 3).
    """
    # 130 ms: not before something is solved
    import rslab
    from scipy.sparse import coo_array

    cells_en = np.frombuffer(cells, np.int64).reshape(shape)
    held_nc = np.frombuffer(held, np.bool_).reshape(-1, 3)
    nodes = len(held_nc)
    unknowns = int(held_nc.size - held_nc.sum())
    number_nc = np.cumsum(~held_nc.ravel()).reshape(-1, 3) - 1

    # Each pair of nodes has nine entries; a pair is one place, whatever its elements.
    row_eab = np.broadcast_to(cells_en[:, :, None], (*shape, shape[1]))
    column_eab = np.broadcast_to(cells_en[:, None, :], (*shape, shape[1]))
    below = np.flatnonzero(row_eab >= column_eab)
    keys = row_eab.reshape(-1)[below] * nodes + column_eab.reshape(-1)[below]
    pairs, pair_of = np.unique(keys, return_inverse=True)
    row, column = np.divmod(pairs, nodes)
    used_pij = ~held_nc[row][:, :, None] & ~held_nc[column][:, None, :]
    used_pij &= (row != column)[:, None, None] | np.tri(3, dtype=np.bool_)

    row_pij = np.broadcast_to(number_nc[row][:, :, None], used_pij.shape)
    column_pij = np.broadcast_to(number_nc[column][:, None, :], used_pij.shape)
    count = int(used_pij.sum())
    sorted_entries = coo_array(
        (np.arange(count), (row_pij[used_pij], column_pij[used_pij])),
        shape=(unknowns, unknowns),
    ).tocsc()
    place_pij = np.full(used_pij.shape, -1)
    place_of_entry = np.empty(count, np.int64)
    place_of_entry[sorted_entries.data] = np.arange(count)
    place_pij[used_pij] = place_of_entry

    # of entry (i, a, j, b) of an element
    places = place_pij[pair_of]
    element, of_pair = np.divmod(below, shape[1] ** 2)
    a, b = np.divmod(of_pair, shape[1])
    i = np.arange(3)[:, None]
    j = np.arange(3)
    taken = (
        (element[:, None, None] * 3 + i) * shape[1] + a[:, None, None]
    ) * 3 * shape[1] + (j * shape[1] + b[:, None, None])
    there = places >= 0

    return _Pattern(
        taken[there],
        places[there],
        rslab.analyze(sorted_entries.astype(np.float64), path="ldlt", threads=THREADS),
        count,
    )
