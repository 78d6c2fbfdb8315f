"""Inverses and determinants of many 3 x 3 matrices, as compiled loops: LAPACK takes ten
times as long for matrices of this size.
"""

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled


@compiled
def inverses(H: Floats) -> Floats:
    """Return the inverse of I + H of each matrix (matrix, 3, 3), by its adjugate."""
    found = np.empty_like(H)
    for matrix in range(len(H)):
        h = H[matrix]
        inverse = found[matrix]
        a = 1.0 + h[0, 0]
        e = 1.0 + h[1, 1]
        i = 1.0 + h[2, 2]
        inverse[0, 0] = e * i - h[1, 2] * h[2, 1]
        inverse[1, 0] = h[1, 2] * h[2, 0] - h[1, 0] * i
        inverse[2, 0] = h[1, 0] * h[2, 1] - e * h[2, 0]
        inverse[0, 1] = h[0, 2] * h[2, 1] - h[0, 1] * i
        inverse[1, 1] = a * i - h[0, 2] * h[2, 0]
        inverse[2, 1] = h[0, 1] * h[2, 0] - a * h[2, 1]
        inverse[0, 2] = h[0, 1] * h[1, 2] - h[0, 2] * e
        inverse[1, 2] = h[0, 2] * h[1, 0] - a * h[1, 2]
        inverse[2, 2] = a * e - h[0, 1] * h[1, 0]
        determinant = (
            a * inverse[0, 0] + h[0, 1] * inverse[1, 0] + h[0, 2] * inverse[2, 0]
        )
        for row in range(3):
            for column in range(3):
                inverse[row, column] /= determinant

    return found


@compiled
def dilatations(H: Floats) -> Floats:
    """Return det(I + H) - 1 of each matrix (matrix, 3, 3): trace, sum of the principal
    minors and determinant, so that no digit of a tiny H is lost.
    """
    found = np.empty(len(H))
    for matrix in range(len(H)):
        h = H[matrix]
        trace = h[0, 0] + h[1, 1] + h[2, 2]
        first = h[1, 1] * h[2, 2] - h[1, 2] * h[2, 1]
        second = h[0, 0] * h[2, 2] - h[0, 2] * h[2, 0]
        third = h[0, 0] * h[1, 1] - h[0, 1] * h[1, 0]
        determinant = (
            h[0, 0] * first
            - h[0, 1] * (h[1, 0] * h[2, 2] - h[1, 2] * h[2, 0])
            + h[0, 2] * (h[1, 0] * h[2, 1] - h[1, 1] * h[2, 0])
        )
        found[matrix] = trace + (first + second + third) + determinant

    return found
