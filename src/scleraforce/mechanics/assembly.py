"""The stiffness matrix of Hooke's law on hexahedra (paper eq. 1 and 2)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from scleraforce.eye.mesh import HexMesh
from scleraforce.mechanics.quadrature import VolumePoints

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ELEMENTS_AT_ONCE = 64  # 27-node matrices of 64 elements take 3 MB: they stay in the processor's cache


def element_stiffness(points: VolumePoints, lame_lambda: float, lame_mu: float) -> Floats:
    """Return the stiffness of every element, shape (element, 3, node, 3, node), in N/m for Lame constants in Pa.

    K_iajb = integral of lambda N_a,i N_b,j + mu (N_a,j N_b,i + delta_ij N_a,k N_b,k). All of it follows from the one
    tensor G_iajb = integral of N_a,i N_b,j, a matrix product over the Gauss points.
    """
    elements, count, nodes, _ = points.gradients_epnc.shape
    K: Floats = np.empty((elements, 3, nodes, 3, nodes))
    for start in range(0, elements, ELEMENTS_AT_ONCE):
        part = slice(start, start + ELEMENTS_AT_ONCE)
        gradients = points.gradients_epnc[part].transpose(0, 1, 3, 2).reshape(-1, count, 3 * nodes)
        weighted = gradients * points.volumes_ep[part, :, None]
        G = (weighted.transpose(0, 2, 1) @ gradients).reshape(-1, 3, nodes, 3, nodes)
        np.multiply(G, lame_lambda, out=K[part])
        K[part] += lame_mu * G.transpose(0, 3, 2, 1, 4)
        trace = lame_mu * (G[:, 0, :, 0] + G[:, 1, :, 1] + G[:, 2, :, 2])
        for i in range(3):
            K[part, i, :, i] += trace
    return K


def stiffness_matrix(mesh: HexMesh, element_eiajb: Floats) -> "sparse.csr_array":
    """Sum element matrices (element, 3, node, 3, node) to a sparse matrix; unknown 3 n + c is node n, component c."""
    pattern = BlockPattern(mesh.cells_en, len(mesh.points_nc))
    return pattern.matrix(pattern.sum(element_eiajb.transpose(0, 2, 4, 1, 3)))


class FacePlaces:
    """Where the unknowns of faces stand in the matrices of the elements that the faces belong to."""

    def __init__(self, cells_en: Integers, faces_qn: Integers) -> None:
        """`faces_qn`: nodes of faces of the elements `cells_en`, (face, node); a face may occur more than once."""
        nodes = int(cells_en.max()) + 1
        common = (_incidence(faces_qn, nodes) @ _incidence(cells_en, nodes).T).tocoo()
        whole = common.data == faces_qn.shape[1]
        element_q = np.empty(len(faces_qn), dtype=np.int64)
        element_q[common.coords[0][whole]] = common.coords[1][whole]
        local_qn = np.argmax(cells_en[element_q][:, None, :] == faces_qn[:, :, None], axis=2)
        unknown_qin = np.arange(3)[:, None] * cells_en.shape[1] + local_qn[:, None, :]
        size = 3 * cells_en.shape[1]
        row = (element_q[:, None, None] * size + unknown_qin) * size
        self._entries = (row[..., None, None] + unknown_qin[:, None, None]).ravel()

    def add(self, element_eiajb: NDArray[np.floating[Any]], face_qiajb: Floats) -> None:
        """Add matrices of the faces (face, 3, node, 3, node) to those of the elements, in place."""
        entries = element_eiajb.reshape(-1)  # a view: element matrices are made in one piece
        np.add.at(entries, self._entries, face_qiajb.ravel().astype(entries.dtype))


def _incidence(cells_en: Integers, nodes: int) -> "sparse.csr_array":
    """One where an element (row) has a node (column)."""
    starts = np.arange(len(cells_en) + 1) * cells_en.shape[1]
    return sparse.csr_array((np.ones(cells_en.size), cells_en.ravel(), starts), shape=(len(cells_en), nodes))


class BlockPattern:
    """The pairs of nodes that share an element, and the sum of the 3 x 3 blocks of element matrices there.

    Blocks are stored as (pair, 3, 3), pairs row by row.

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

    def matrix(self, blocks_bii: Floats) -> "sparse.csr_array":
        """Return the blocks as a sparse matrix of all unknowns."""
        starts = np.searchsorted(self.pairs, np.arange(self.nodes + 1) * self.nodes).astype(np.int32)
        columns = (self.pairs % self.nodes).astype(np.int32)
        return sparse.bsr_array((blocks_bii, columns, starts), shape=(3 * self.nodes, 3 * self.nodes)).tocsr()
