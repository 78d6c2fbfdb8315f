"""The places at which directions from the centre pierce the curved quads of a spherical surface."""

import numpy as np

from scleraforce.arrays import Floats, Integers
from scleraforce.errors import InputError, SolverError
from scleraforce.mechanics.shapes import shape_monomials

BATCH = 16384  # directions at a time: the working arrays stay in the processor's cache
BELOW_BASE = 1e-9  # how far below z = 0 a unit direction may lie by rounding
OUTSIDE = 1e-9  # how far a local coordinate may exceed 1
SEEDS_PER_QUAD = 4.0  # cells of the seed table along a quad
NEWTON_STEPS = 12
CONVERGED = 1e-7  # the next step is below 1e-14
FEW = 400  # quads: comparing all of them is quicker than to import a tree
CROSSINGS = 12


class SurfaceLocator:
    """Finds directions on a sphere of quads (4, 8 or 9 nodes), or on its upper half with all nodes on z >= 0.

    A table over the stereographic disc (two for a whole sphere, one from either pole) gives the quad whose middle is
    nearest; Newton's method then solves for the local coordinates where the surface point is parallel to the direction,
    and crosses to a neighbour when they leave the quad. In a quad's own frame (a, b, c), c through its middle, parallel
    means  x.a - (d.a/d.c) x.c = 0  and the same for b: two biquadratic polynomials.
    """

    def __init__(self, points_nc: Floats, quad_qn: Integers) -> None:
        corners = points_nc[quad_qn[:, :4]]
        middle = corners.mean(axis=1)
        self._frames_qkc = _frames(middle, corners[:, 1] - corners[:, 0])
        self._polynomials = _polynomials(points_nc[quad_qn], self._frames_qkc)
        self._neighbours_qe = _neighbours(quad_qn)
        self._whole = bool(np.all(self._neighbours_qe >= 0))
        side = np.sqrt(2.0 * np.pi / len(quad_qn))
        self._table_cells = int(np.ceil(2.0 * SEEDS_PER_QUAD / side))
        self._seeds = self._seed_table(self._frames_qkc[:, 2])

    def locate(self, directions_dc: Floats) -> tuple[Integers, Floats]:
        """Return the quad (direction,) and local coordinates in [-1, 1]^2 (direction, 2) of every direction."""
        lengths = np.linalg.norm(directions_dc, axis=1)
        above = np.full(len(lengths), self._whole) | (directions_dc[:, 2] >= -BELOW_BASE * lengths)
        if not np.all(above & (lengths > 0.0) & np.isfinite(lengths)):
            raise InputError("direction: it does not pierce the half-sphere; must have z >= 0 and a positive length")
        quads = np.empty(len(directions_dc), dtype=np.int64)
        local = np.empty((len(directions_dc), 2))
        for start in range(0, len(directions_dc), BATCH):
            part = slice(start, start + BATCH)
            quads[part], local[part] = self._locate_batch(directions_dc[part] / lengths[part, None])
        return quads, local

    def _locate_batch(self, directions_dc: Floats) -> tuple[Integers, Floats]:
        quads = self._seeds[self._cell(directions_dc)]
        from scleraforce.mechanics.loops import cross_quads  # not before something is solved: Numba takes 0.2 s

        local, found = cross_quads(self._polynomials, self._frames_qkc, self._neighbours_qe, quads, directions_dc)
        if not found:
            raise SolverError("locate: a direction was not found on the surface")
        return quads, np.clip(local, -1.0, 1.0)

    def _seed_table(self, middles_qc: Floats) -> Integers:
        """Quad with the nearest middle for every cell of the square around the stereographic disc, flat.

        A whole sphere's second table, for z < 0, follows the first.
        """
        middles = (np.arange(self._table_cells) + 0.5) * 2.0 / self._table_cells - 1.0
        p, q = np.meshgrid(middles, middles, indexing="ij")
        square = p**2 + q**2
        cells = np.stack([2.0 * p, 2.0 * q, 1.0 - square], axis=-1) / (1.0 + square)[..., None]
        sides = np.concatenate([cells, cells * (1.0, 1.0, -1.0)] if self._whole else [cells]).reshape(-1, 3)
        if len(middles_qc) <= FEW:
            return np.asarray(np.argmax(sides @ middles_qc.T, axis=1), dtype=np.int64)
        from scipy.spatial import cKDTree  # a tenth of a second

        return np.asarray(cKDTree(middles_qc).query(sides)[1], dtype=np.int64)

    def _cell(self, directions_dc: Floats) -> Integers:
        """Cell of the seed table: stereographic projection from the far pole maps a half-sphere to a disc."""
        disc = directions_dc[:, :2] / (1.0 + np.abs(directions_dc[:, 2:]))
        cell = np.clip(((disc + 1.0) * (0.5 * self._table_cells)).astype(np.int64), 0, self._table_cells - 1)
        below = self._whole & (directions_dc[:, 2] < 0.0)
        return below * self._table_cells**2 + cell[:, 0] * self._table_cells + cell[:, 1]


def _frames(middle_qc: Floats, along_qc: Floats) -> Floats:
    """Orthonormal frames (a, b, c) with c through the quad's middle, shape (quad, 3, 3)."""
    c = middle_qc / np.linalg.norm(middle_qc, axis=1, keepdims=True)
    a = along_qc - np.sum(along_qc * c, axis=1, keepdims=True) * c
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return np.stack([a, np.cross(c, a), c], axis=1)


def _polynomials(nodes_qnc: Floats, frames_qkc: Floats) -> Floats:
    """Each quad's surface in its frame as polynomial coefficients, shape (power of x, power of y, axis, quad)."""
    exponents_md, coefficients_mn = shape_monomials(2, nodes_qnc.shape[1])
    table = np.zeros((3, 3, 3, len(nodes_qnc)))
    table[*exponents_md.T] = np.einsum("mn,qnc,qkc->mkq", coefficients_mn, nodes_qnc, frames_qkc)
    return table


def _neighbours(quad_qn: Integers) -> Integers:
    """The quad across each of the four edges, -1 at the boundary, shape (quad, 4)."""
    sides = np.sort(np.stack([quad_qn[:, :4], np.roll(quad_qn[:, :4], -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    edge_of_side = np.unique(sides, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(edge_of_side, kind="stable")
    pair = np.flatnonzero(np.diff(edge_of_side[order]) == 0)
    neighbours = np.full(len(sides), -1)
    neighbours[order[pair]], neighbours[order[pair + 1]] = order[pair + 1] // 4, order[pair] // 4
    return neighbours.reshape(-1, 4)
