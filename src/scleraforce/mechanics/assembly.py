"""The stiffness matrix of Hooke's law on hexahedra (paper eq. 1 and 2)."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from scleraforce.eye.mesh import HexMesh
from scleraforce.mechanics.quadrature import VolumePoints

__all__ = ["BlockPattern", "FreePart", "element_stiffness", "stiffness_matrix"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def element_stiffness(points: VolumePoints, lame_lambda: float, lame_mu: float) -> Floats:
    """Return the stiffness of every element, shape (element, node, 3, node, 3), in N/m for Lame constants in Pa.

    K_aibj = integral of lambda N_a,i N_b,j + mu (N_a,j N_b,i + delta_ij N_a,k N_b,k). All of it follows from the one
    tensor G_aibj = integral of N_a,i N_b,j, a matrix product over the Gauss points.
    """
    elements, _, nodes, _ = points.gradients_epnc.shape
    weighted = points.gradients_epnc * points.volumes_ep[..., None, None]
    flat = (elements, -1, 3 * nodes)
    product = weighted.reshape(flat).transpose(0, 2, 1) @ points.gradients_epnc.reshape(flat)
    G = product.reshape(elements, nodes, 3, nodes, 3)
    K: Floats = lame_lambda * G + lame_mu * G.transpose(0, 1, 4, 3, 2)
    trace = lame_mu * np.einsum("eaibi->eab", G)
    for i in range(3):
        K[:, :, i, :, i] += trace
    return K


def stiffness_matrix(mesh: HexMesh, element_enini: Floats) -> "sparse.csr_array":
    """Sum element matrices (element, node, 3, node, 3) to a sparse matrix; unknown 3 n + c is node n, component c."""
    pattern = BlockPattern(mesh.cells_en, len(mesh.points_nc))
    return pattern.matrix(pattern.sum(element_enini.transpose(0, 1, 3, 2, 4)))


class BlockPattern:
    """The pairs of nodes that share an element, and the sum of the 3 x 3 blocks of element matrices there.

    It is found once for a mesh; every assembly is then one gather. Blocks are stored as (pair, 3, 3), pairs row by row.

    Attributes:
        nodes: number of nodes.
        pairs: row node times `nodes` plus column node of every block, ascending, (pair,).
    """

    def __init__(self, cells_en: Integers, nodes: int) -> None:
        rows, columns = np.repeat(cells_en, cells_en.shape[1], axis=1), np.tile(cells_en, (1, cells_en.shape[1]))
        self.nodes = nodes
        self.pairs, block_of = np.unique(rows.ravel() * nodes + columns.ravel(), return_inverse=True)
        # A sparse matrix of ones adds up the 3 x 3 blocks that meet at a pair of nodes: faster than adding entries.
        shape = (len(self.pairs), block_of.size)
        self._gather = sparse.csr_array((np.ones(block_of.size), (block_of, np.arange(block_of.size))), shape=shape)

    def sum(self, element_ennii: Floats) -> Floats:
        """Return the blocks (pair, 3, 3) of the sum of element matrices (element, node, node, 3, 3)."""
        blocks: Floats = self._gather @ element_ennii.reshape(-1, 9)
        return blocks.reshape(-1, 3, 3)

    def places(self, nodes_en: Integers) -> Integers:
        """Return the row of every pair of nodes in the blocks, (element, node, node), for faces of the elements."""
        places: Integers = np.searchsorted(self.pairs, nodes_en[:, :, None] * self.nodes + nodes_en[:, None, :])
        return places

    def matrix(self, blocks_bii: Floats) -> "sparse.csr_array":
        """Return the blocks as a sparse matrix of all unknowns."""
        starts = np.searchsorted(self.pairs, np.arange(self.nodes + 1) * self.nodes).astype(np.int32)  # for SuperLU
        columns = (self.pairs % self.nodes).astype(np.int32)
        return sparse.bsr_array((blocks_bii, columns, starts), shape=(3 * self.nodes, 3 * self.nodes)).tocsr()


class FreePart:
    """Takes the rows and columns of the free unknowns from blocks to a compressed sparse column matrix."""

    def __init__(self, pattern: BlockPattern, free: Integers) -> None:
        """`free`: the unknowns that are not held, ascending, (unknown,)."""
        numbered = np.arange(1.0, 9.0 * len(pattern.pairs) + 1.0).reshape(-1, 3, 3)
        part = pattern.matrix(numbered)[free][:, free].tocsc()
        part.sort_indices()
        self._entry_of = part.data.astype(np.int64) - 1
        self._indices, self._starts, self._shape = part.indices, part.indptr, part.shape

    def matrix(self, blocks_bii: Floats) -> "sparse.csc_array":
        """Return the matrix of the free unknowns."""
        return sparse.csc_array((blocks_bii.ravel()[self._entry_of], self._indices, self._starts), shape=self._shape)
