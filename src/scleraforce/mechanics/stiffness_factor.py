"""The sum of symmetric element matrices over a mesh, and its factor L D L^T by rslab.

Which entries the sum has, and in which order its unknowns are eliminated, depends only
on the elements' nodes and on what is held: it is found once for all sums over a mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Flags, Floats, Integers, Reals
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.hexahedral_mesh import HexMesh

if TYPE_CHECKING:
    from rslab import LdltSymbolic
    from scipy.sparse import csc_array

Numbers = NDArray[np.int32]

KEPT = 1  # pattern, of 5 MB for the graded mesh, 15 MB for the even one
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
    """The lower triangle of a sum, of so many entries: the numbers of the pairs of an
    element's nodes and the places in the sum of their entries (`sum_elements`), and the
    order of elimination.
    """

    pair_eab: Numbers
    place_pij: Numbers
    analysed: "LdltSymbolic"
    size: int

    def summed(self, element_eiajb: Reals) -> Reals:
        """Return the entries of the sum, in the elements' precision."""
        # 0.2 s: Numba, not before something is solved
        from scleraforce.mechanics.summed_elements import sum_elements

        data = np.zeros(self.size)
        sum_elements(
            np.ascontiguousarray(element_eiajb), self.pair_eab, self.place_pij, data
        )
        return data.astype(element_eiajb.dtype, copy=False)


@lru_cache(maxsize=KEPT)
def _pattern(cells: bytes, shape: tuple[int, int], held: bytes) -> _Pattern:
    """Return the pattern of elements' nodes, int64 of a shape (element, node), and of
    what is held, bool (node, 3).
    """
    import rslab  # 130 ms with SciPy: not before something is solved

    cells_en = np.frombuffer(cells, np.int64).reshape(shape)
    held_nc = np.frombuffer(held, np.bool_).reshape(-1, 3)
    pairs = _node_pairs(cells_en)
    place_pij, lower = _places_of(pairs, held_nc)
    analysed = rslab.analyze(lower, path="ldlt", threads=THREADS)
    return _Pattern(pairs.number_eab, place_pij, analysed, lower.nnz)


class _NodePairs(NamedTuple):
    """The pairs of nodes that share an element, the larger number first: nine entries
    of the sum belong to each, whatever its elements.

    `larger` and `smaller` (pair,) are the nodes; `number_eab` (element, node, node)
    says which pair an element's nodes are, -1 with the smaller one first.
    """

    larger: Integers
    smaller: Integers
    number_eab: Numbers


def _node_pairs(cells_en: Integers) -> _NodePairs:
    first, second = np.broadcast_arrays(cells_en[:, :, None], cells_en[:, None, :])
    is_read = first >= second
    nodes = int(cells_en.max()) + 1
    keys, number = np.unique(
        first[is_read] * nodes + second[is_read], return_inverse=True
    )
    number_eab = np.full(first.shape, -1, np.int32)
    number_eab[is_read] = number
    return _NodePairs(*np.divmod(keys, nodes), number_eab)


def _places_of(pairs: _NodePairs, held_nc: Flags) -> tuple[Numbers, "csc_array"]:
    """Return the places in the sum of the entries of pairs (pair, 3, 3), -1 for those
    that it lacks: of held components, and above the diagonal; and its lower triangle,
    of zeros.
    """
    from scipy.sparse import coo_array, csc_array

    free_nc = ~held_nc
    number_nc = (np.cumsum(free_nc, dtype=np.int32) - np.int32(1)).reshape(-1, 3)
    used_pij = free_nc[pairs.larger][:, :, None] & free_nc[pairs.smaller][:, None, :]
    is_one_node = pairs.larger == pairs.smaller
    used_pij &= ~is_one_node[:, None, None] | np.tri(3, dtype=np.bool_)

    row = np.broadcast_to(number_nc[pairs.larger][:, :, None], used_pij.shape)
    column = np.broadcast_to(number_nc[pairs.smaller][:, None, :], used_pij.shape)
    count = int(used_pij.sum())
    unknowns = int(free_nc.sum())
    numbers = np.arange(count, dtype=np.int32)
    numbered = coo_array(
        (numbers, (row[used_pij], column[used_pij])), shape=(unknowns, unknowns)
    ).tocsc()  # sorts the entries as the sum has them
    places = np.empty(count, np.int32)
    places[numbered.data] = numbers
    place_pij = np.full(used_pij.shape, -1, np.int32)
    place_pij[used_pij] = places

    zeros = np.zeros(count), numbered.indices, numbered.indptr
    return place_pij, csc_array(zeros, shape=numbered.shape)
