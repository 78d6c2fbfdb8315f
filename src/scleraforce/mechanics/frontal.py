"""A symmetric matrix of finite elements, factored front by front with dense matrices (the multifrontal method).

Nested dissection orders the unknowns: the elements are halved again and again, each time across the direction in which
the halves share the fewest nodes. A node is eliminated in the smallest part that holds all of its elements; what is
left of a part is a dense matrix of the nodes that it shares with the rest (George, SIAM J. Numer. Anal. 10, 1973, 345).

A front A = [[B, C^T], [C, D]], its own unknowns in B = L U, hands D - Y Z to its parent, with C = Y U and C^T = L Z.
A definite B has Cholesky's factors, U = L^T and Z = Y^T; of any other, rows are exchanged inside of B. Only the lower
triangle of A is looked at. Source: Duff and Reid, ACM Trans. Math. Softw. 9, 1983, 302.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg.blas import get_blas_funcs
from scipy.linalg.lapack import get_lapack_funcs
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]  # it ships no types

from scleraforce.arrays import Flags, Floats, Integers, Reals
from scleraforce.errors import SolverError
from scleraforce.mechanics.mesh import HexMesh

LEAF = 6  # elements that are not halved any more: fewer fronts cost less than their zeros
CORNERS = 8  # nodes of a hexahedron that come first in its row
# Half of the directions to the faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])
_thread_pools = cache(ThreadpoolController)


@dataclass(frozen=True, eq=False)
class Front:
    """A part of the mesh, its unknowns numbered in the order of elimination.

    `own` unknowns are eliminated here, `shared` ones stay, ascending. `children` are the numbers of the fronts whose
    parts make this one, `places` for each of them the places of its shared unknowns among the own and the shared ones
    here. A front of elements has no children: `element_places`: places of the elements' unknowns (component, node),
    behind all where held, (element, unknown).
    """

    own: slice
    shared: Integers
    children: tuple[int, ...]
    places: tuple[Integers, ...]
    elements: Integers
    element_places: Integers


# Fronts, children before their parents, and the place of every free unknown in the order of elimination.
Dissection = tuple[tuple[Front, ...], Integers]


def dissect(mesh: HexMesh, held_nc: Flags) -> Dissection:
    """Return the fronts of a mesh whose components `held_nc` (node, 3) are held."""
    cells_en, nodes = mesh.cells_en, len(mesh.points_nc)
    elements_of_n = np.bincount(cells_en.ravel(), minlength=nodes)
    number_nc = np.full(held_nc.shape, -1)
    parts = list(_parts(mesh))
    owns: list[slice] = []
    shares: list[Integers] = []
    here: list[Integers] = []
    for elements, halves in parts:
        here_n = np.bincount(cells_en[elements].ravel(), minlength=nodes)
        for half in halves:
            here_n[shares[half]] += here[half]
        met = np.flatnonzero(here_n)
        done = here_n[met] == elements_of_n[met]
        own_nc = ~held_nc[met[done]]
        first = owns[-1].stop if owns else 0
        numbers = first - 1 + np.cumsum(own_nc).reshape(own_nc.shape)
        number_nc[met[done]] = np.where(own_nc, numbers, -1)
        owns.append(slice(first, first + int(np.count_nonzero(own_nc))))
        shares.append(met[~done])
        here.append(here_n[met[~done]])
    fronts: list[Front] = []
    for (elements, halves), own, shared_nodes in zip(parts, owns, shares, strict=True):
        shared = np.sort(number_nc[shared_nodes][~held_nc[shared_nodes]])
        everything = np.concatenate([np.arange(own.start, own.stop), shared])
        places = tuple(np.searchsorted(everything, fronts[half].shared) for half in halves)
        numbers = number_nc[cells_en[elements]].transpose(0, 2, 1).reshape(len(elements), 3 * cells_en.shape[1])
        element_places = np.where(numbers < 0, len(everything), np.searchsorted(everything, numbers))
        fronts.append(Front(own, shared, halves, places, elements, element_places))
    return tuple(fronts), number_nc[~held_nc]


def _parts(mesh: HexMesh) -> Iterator[tuple[Integers, tuple[int, ...]]]:
    """Yield the elements of each part without halves, or its halves' numbers in this order; halves come first."""
    corners, corners_en = np.unique(mesh.cells_en[:, :CORNERS], return_inverse=True)
    centres_ec = mesh.sphere_nc[corners][corners_en].mean(axis=1)
    given = 0

    def halved(elements: Integers) -> Iterator[tuple[Integers, tuple[int, ...]]]:
        nonlocal given
        halves: list[int] = []
        if len(elements) > LEAF:
            for half in _halves(elements, corners_en, centres_ec):
                yield from halved(half)
                halves.append(given - 1)
        given += 1
        yield (elements[:0] if halves else elements), tuple(halves)

    yield from halved(np.arange(len(corners_en)))


def _halves(elements: Integers, corners_en: Integers, centres_ec: Reals) -> tuple[Integers, Integers]:
    """Halve elements where the halves share the fewest corners."""
    ranks_ed = np.argsort(centres_ec[elements] @ DIRECTIONS.T, axis=0, kind="stable")
    middle = len(elements) // 2
    nodes = int(corners_en.max()) + 1
    fewest, best = nodes + 1, 0
    for direction in range(ranks_ed.shape[1]):
        sides = np.zeros((2, nodes), dtype=bool)
        sides[0, corners_en[elements[ranks_ed[:middle, direction]]]] = True
        sides[1, corners_en[elements[ranks_ed[middle:, direction]]]] = True
        common = int(np.count_nonzero(sides[0] & sides[1]))
        if common < fewest:
            fewest, best = common, direction
    return elements[ranks_ed[:middle, best]], elements[ranks_ed[middle:, best]]


@dataclass(frozen=True, eq=False)
class _Factored:
    """Factors of a front: L and U in one matrix, Y (shared, own), Z (own, shared), and the exchange of rows.

    `rows`: the places from which the rows of B came; None where they stayed and U = L^T.
    """

    own: slice
    shared: Integers
    LU: Reals
    Y: Reals
    Z: Reals
    rows: Integers | None


class FrontalFactor:
    """The factors of a matrix, in the precision of its elements."""

    def __init__(self, dissection: Dissection, element_eiajb: Reals) -> None:
        """Sum up and factor symmetric element matrices (element, 3, node, 3, node)."""
        self._dissected, self._number_u = dissection
        self._dtype = element_eiajb.dtype
        size = element_eiajb.shape[1] * element_eiajb.shape[2]
        element_eNN = element_eiajb.reshape(-1, size, size)
        self._trsm, self._trsv, self._syrk, self._gemm = (
            get_blas_funcs(name, dtype=self._dtype) for name in ("trsm", "trsv", "syrk", "gemm")
        )
        self._potrf: Any = get_lapack_funcs("potrf", dtype=self._dtype)
        self._getrf: Any = get_lapack_funcs("getrf", dtype=self._dtype)
        left: dict[int, Reals] = {}
        self._fronts: list[_Factored] = []
        with one_blas_thread():
            for number, front in enumerate(self._dissected):
                A = _summed(front, element_eNN, [left.pop(child) for child in front.children])
                factored, left[number] = self._eliminated(front, A)
                self._fronts.append(factored)

    def solve(self, load: Reals, wanted_u: Flags | None = None) -> Floats:
        """Return the answer (unknown,) or (unknown, column) to a load on the free unknowns, of the same shape.

        With `wanted_u` (unknown,) only these are answered, others mean nothing: parts without them are not read.
        """
        x = np.empty(load.shape, self._dtype)
        x[self._number_u] = load
        with one_blas_thread():
            self._substitute(x[:, 0] if load.ndim == 2 and load.shape[1] == 1 else x, self._asked(wanted_u))
        return np.asarray(x[self._number_u], dtype=np.float64)

    def _asked(self, wanted_u: Flags | None) -> list[bool]:
        """Return for each front whether it, or one below it, has wanted unknowns."""
        fronts = self._dissected
        if wanted_u is None:
            return [True] * len(fronts)
        first = [front.own.start for front in fronts]
        own = np.searchsorted(first, self._number_u[wanted_u], side="right") - 1
        asked: list[bool] = (np.bincount(own, minlength=len(fronts)) > 0).tolist()
        for number, front in enumerate(fronts):  # children come first
            asked[number] = asked[number] or any(asked[child] for child in front.children)
        return asked

    def _substitute(self, column: Reals, asked: list[bool]) -> None:
        """Put the answer in place of a load, both in the order of elimination."""
        for one in self._fronts:
            y = column[one.own]
            if y.any():  # nothing comes of no load
                column[one.own] = y = self._divided(one, y if one.rows is None else y[one.rows], upper=False)
                column[one.shared] -= one.Y @ y
        for one, needed in zip(reversed(self._fronts), reversed(asked), strict=True):
            if needed and one.own.start < one.own.stop:
                y = column[one.own] - one.Z @ column[one.shared]
                column[one.own] = self._divided(one, y, upper=True)

    def _divided(self, one: _Factored, y: Reals, *, upper: bool) -> Reals:
        """Return the inverse of U or L times y, (own,) or (own, column)."""
        definite = one.rows is None
        lower, turned, unit = definite or not upper, definite and upper, not (definite or upper)
        if y.ndim == 1:
            return np.asarray(self._trsv(one.LU, y, lower=lower, trans=turned, diag=unit))
        return np.asarray(self._trsm(1.0, one.LU, y, lower=lower, trans_a=turned, diag=unit))

    def _eliminated(self, front: Front, A: Reals) -> tuple[_Factored, Reals]:
        """Eliminate a front's own unknowns; return its factors and what is left for the shared ones."""
        own = front.own.stop - front.own.start
        C, D = np.asfortranarray(A[own:, :own]), np.asfortranarray(A[own:, own:])
        if own == 0:
            return _Factored(front.own, front.shared, C, C, C.T, None), D
        L, fault = self._potrf(A[:own, :own], lower=1, clean=0)
        if fault == 0 and np.isfinite(L[-1, -1]):  # a value that is not finite comes down to there
            Y = self._trsm(1.0, L, C, side=1, lower=1, trans_a=1, overwrite_b=1)
            rest = self._syrk(-1.0, Y, beta=1.0, c=D, lower=1, overwrite_c=1) if len(D) else D
            return _Factored(front.own, front.shared, L, Y, Y.T, None), rest
        B = np.tril(A[:own, :own]) + np.tril(A[:own, :own], -1).T
        LU, swaps, fault = self._getrf(B)
        if fault != 0 or not np.isfinite(LU).all():
            raise SolverError("matrix: singular")
        rows = np.arange(own)
        for row, other in enumerate(swaps):
            rows[[row, other]] = rows[[other, row]]
        Y = self._trsm(1.0, LU, C, side=1, lower=0)
        Z = self._trsm(1.0, LU, C.T[rows], lower=1, diag=1)
        rest = self._gemm(-1.0, Y, Z, beta=1.0, c=D, overwrite_c=1) if len(D) else D
        return _Factored(front.own, front.shared, LU, Y, Z, rows), rest


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS to one thread: matrices are small, and a second thread that waits for a busy core costs tenfold."""
    return _thread_pools().limit(limits=1, user_api="blas")


def _summed(front: Front, element_eNN: Reals, rests: list[Reals]) -> Reals:
    """Sum a front from its elements, or from the rests of its children; its lower triangle counts."""
    size = front.own.stop - front.own.start + len(front.shared)
    stride = size + 1  # the last row and column are of unknowns that are held
    entries = np.zeros(stride**2, element_eNN.dtype)
    for part, places in (*zip(element_eNN[front.elements], front.element_places, strict=True),
                         *zip(rests, front.places, strict=True)):  # fmt: skip
        entries[(places[:, None] * stride + places).ravel()] += part.ravel(order="F")
    return entries.reshape(stride, stride).T[:size, :size]
