"""The sum of element matrices over a mesh, as a compiled loop."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Reals
from scleraforce.base.compiled_loops import compiled

Numbers = NDArray[np.int32]


@compiled
def sum_elements(
    K_eiajb: Reals, pair_eab: Numbers, place_pij: Numbers, summed: Floats
) -> None:
    """Add symmetric element matrices (element, 3, node, 3, node) to the entries of
    their sum (place,).

    `pair_eab` is the number of each pair of an element's nodes, of which one order is
    read, and -1 of the other; `place_pij` the place in the sum of each of a pair's
    entries, -1 of those that it lacks.
    """
    elements, nodes, _ = pair_eab.shape
    for element in range(elements):
        for a in range(nodes):
            for b in range(nodes):
                pair = pair_eab[element, a, b]
                if pair < 0:
                    continue

                for i in range(3):
                    for j in range(3):
                        place = place_pij[pair, i, j]
                        if place >= 0:
                            summed[place] += K_eiajb[element, i, a, j, b]
