"""The compiled loops of `hexahedral_mesh.SurfaceLocator`."""

import numpy as np

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.compiled_loops import compiled

OUTSIDE = 1e-9  # how far a local coordinate may exceed 1
NEWTON_STEPS = 12
CONVERGED = 1e-7  # the next step is below 1e-14
CROSSINGS = 12


@compiled
def _local_coordinates(
    polynomials: Floats, frames_qkc: Floats, quads: Integers, directions_dc: Floats
) -> Floats:
    """Return local coordinates (direction, 2) in given quads, by Newton's method until
    the last one has converged.
    """
    count = len(quads)
    local = np.zeros((count, 2))
    u = np.empty((count, 3, 3))
    v = np.empty((count, 3, 3))
    along = np.empty(3)

    for n in range(count):
        quad = quads[n]
        for axis in range(3):
            frame = frames_qkc[quad, axis]
            along[axis] = (
                frame[0] * directions_dc[n, 0]
                + frame[2] * directions_dc[n, 2]
                + frame[1] * directions_dc[n, 1]
            )

        a = along[0] / along[2]
        b = along[1] / along[2]

        for i in range(3):
            for j in range(3):
                third = polynomials[i, j, 2, quad]
                u[n, i, j] = polynomials[i, j, 0, quad] - a * third
                v[n, i, j] = polynomials[i, j, 1, quad] - b * third

    for _ in range(NEWTON_STEPS):
        largest = 0.0
        for n in range(count):
            x = local[n, 0]
            y = local[n, 1]
            p = u[n]
            q = v[n]
            p0 = p[0, 0] + y * (p[0, 1] + y * p[0, 2])
            p1 = p[1, 0] + y * (p[1, 1] + y * p[1, 2])
            p2 = p[2, 0] + y * (p[2, 1] + y * p[2, 2])
            q0 = q[0, 0] + y * (q[0, 1] + y * q[0, 2])
            q1 = q[1, 0] + y * (q[1, 1] + y * q[1, 2])
            q2 = q[2, 0] + y * (q[2, 1] + y * q[2, 2])
            twice = 2.0 * y
            f = p0 + x * (p1 + x * p2)
            g = q0 + x * (q1 + x * q2)
            f_x = p1 + 2.0 * x * p2
            g_x = q1 + 2.0 * x * q2
            f_y = (
                p[0, 1]
                + twice * p[0, 2]
                + x * (p[1, 1] + twice * p[1, 2] + x * (p[2, 1] + twice * p[2, 2]))
            )
            g_y = (
                q[0, 1]
                + twice * q[0, 2]
                + x * (q[1, 1] + twice * q[1, 2] + x * (q[2, 1] + twice * q[2, 2]))
            )
            determinant = f_x * g_y - f_y * g_x
            dx = (f_y * g - g_y * f) / determinant
            dy = (g_x * f - f_x * g) / determinant
            local[n, 0] = min(max(x + dx, -2.0), 2.0)
            local[n, 1] = min(max(y + dy, -2.0), 2.0)
            largest = max(largest, abs(dx), abs(dy))

        if largest < CONVERGED:
            break

    return local


@compiled
def cross_quads(
    polynomials: Floats,
    frames_qkc: Floats,
    neighbours_qe: Integers,
    quads: Integers,
    directions_dc: Floats,
) -> tuple[Floats, bool]:
    """Go from each direction's quad in `quads`, which is changed, to the one that it
    pierces.

    The first three arguments are from `SurfaceLocator`. Return local coordinates
    (direction, 2), not clipped to the quad, and whether all were found.
    """
    local = _local_coordinates(polynomials, frames_qkc, quads, directions_dc)
    beyond = np.empty(4)
    leaving = np.empty(len(quads), dtype=np.int64)

    for _ in range(CROSSINGS):
        count = 0
        for n in range(len(quads)):
            x = local[n, 0]
            y = local[n, 1]
            beyond[0] = -y - 1.0
            beyond[1] = x - 1.0
            beyond[2] = y - 1.0
            beyond[3] = -x - 1.0
            # of no side without a neighbour: at the base only rounding leads outside
            side = 0
            farthest = -np.inf

            for edge in range(4):
                if neighbours_qe[quads[n], edge] >= 0 and beyond[edge] > farthest:
                    side = edge
                    farthest = beyond[edge]

            if farthest > OUTSIDE:
                quads[n] = neighbours_qe[quads[n], side]
                leaving[count] = n
                count += 1

        if count == 0:
            return local, True

        crossed = leaving[:count]
        found = _local_coordinates(
            polynomials, frames_qkc, quads[crossed], directions_dc[crossed]
        )

        for k in range(count):
            local[crossed[k]] = found[k]

    return local, False
