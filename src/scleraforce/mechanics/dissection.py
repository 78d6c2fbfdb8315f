"""Nested dissection of a mesh: the order in which its unknowns are eliminated, and the fronts in which it is done.

The elements are halved again and again, each time across the direction in which the halves share the fewest nodes. A
node is eliminated in the smallest part that holds all of its elements; what is left of a part is a dense matrix of the
nodes that it shares with the rest. Source: George, SIAM J. Numer. Anal. 10, 1973, 345; Duff and Reid, ACM Trans. Math.
Softw. 9, 1983, 302.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.mesh import HexMesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LEAF = 6  # elements that are not halved any more: fewer fronts cost less than their zeros
CORNERS = 8  # nodes of a hexahedron that come first in its row
# Half of the directions to the faces, edges and corners of a cube.
DIRECTIONS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])


@dataclass(frozen=True, eq=False)
class Front:
    """A part of the mesh, its unknowns numbered in the order of elimination.

    Attributes:
        own: the unknowns that are eliminated here.
        shared: those that stay, ascending, (unknown,).
        children: numbers of the fronts whose parts make this one; none where it is made of elements.
        places: for every child, where its shared unknowns stand among the own and the shared ones here, ascending.
        elements: those of a front without children.
        element_places: the same of the unknowns (component, node) of every element, behind all where held, (element,
            unknown).
    """

    own: slice
    shared: Integers
    children: tuple[int, ...]
    places: tuple[Integers, ...]
    elements: Integers
    element_places: Integers


@dataclass(frozen=True, eq=False)
class Dissection:
    """Fronts, children before their parents, and the place of every free unknown in the order of elimination."""

    fronts: tuple[Front, ...]
    number_u: Integers


@dataclass(frozen=True, eq=False)
class _Part:
    elements: Integers
    halves: tuple[int, ...]


def dissect(mesh: HexMesh, held_nc: NDArray[np.bool_]) -> Dissection:
    """Return the fronts of a mesh whose components `held_nc` (node, 3) are held."""
    cells_en, nodes = mesh.cells_en, len(mesh.points_nc)
    elements_of_n = np.bincount(cells_en.ravel(), minlength=nodes)
    number_nc = np.full(held_nc.shape, -1)
    parts = list(_parts(mesh))
    owns: list[slice] = []
    shares: list[Integers] = []
    here: list[Integers] = []
    for part in parts:
        own_elements = part.elements if not part.halves else part.elements[:0]
        here_n = np.bincount(cells_en[own_elements].ravel(), minlength=nodes)
        for half in part.halves:
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
    for part, own, shared_nodes in zip(parts, owns, shares, strict=True):
        shared = np.sort(number_nc[shared_nodes][~held_nc[shared_nodes]])
        everything = np.concatenate([np.arange(own.start, own.stop), shared])
        places = tuple(np.searchsorted(everything, fronts[half].shared) for half in part.halves)
        elements = part.elements if not part.halves else part.elements[:0]
        numbers = number_nc[cells_en[elements]].transpose(0, 2, 1).reshape(len(elements), 3 * cells_en.shape[1])
        element_places = np.where(numbers < 0, len(everything), np.searchsorted(everything, numbers))
        fronts.append(Front(own, shared, part.halves, places, elements, element_places))
    return Dissection(tuple(fronts), number_nc[~held_nc])


def _parts(mesh: HexMesh) -> Iterator[_Part]:
    """Yield the parts of a mesh, halves before what they make; halves are named by their numbers in this order."""
    corners, corners_en = np.unique(mesh.cells_en[:, :CORNERS], return_inverse=True)
    centres_ec = mesh.sphere_nc[corners][corners_en].mean(axis=1)
    given = 0

    def halved(elements: Integers) -> Iterator[_Part]:
        nonlocal given
        halves: list[int] = []
        if len(elements) > LEAF:
            for half in _halves(elements, corners_en, centres_ec):
                yield from halved(half)
                halves.append(given - 1)
        given += 1
        yield _Part(elements, tuple(halves))

    yield from halved(np.arange(len(corners_en)))


def _halves(elements: Integers, corners_en: Integers, centres_ec: Floats) -> tuple[Integers, Integers]:
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
