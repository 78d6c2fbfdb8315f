"""The stiffness matrix of Hooke's law on hexahedra (paper eq. 1 and 2)."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from scleraforce.eye.mesh import HexMesh
from scleraforce.mechanics.quadrature import VolumePoints

__all__ = ["element_stiffness", "lame_constants", "stiffness_matrix"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def lame_constants(youngs_modulus_pa: float, poisson_ratio: float) -> tuple[float, float]:
    """Return lambda and mu in Pa.

    >>> lame_constants(2.5, 0.25)
    (1.0, 1.0)
    """
    E, nu = youngs_modulus_pa, poisson_ratio
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


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
    count, nodes = len(mesh.points_nc), mesh.cells_en.shape[1]
    rows = np.repeat(mesh.cells_en, nodes, axis=1).ravel()
    columns = np.tile(mesh.cells_en, (1, nodes)).ravel()
    pairs, block_of = np.unique(rows * count + columns, return_inverse=True)
    # A sparse matrix of ones adds up the 3 x 3 blocks that meet at a pair of nodes: faster than adding entries.
    gather = sparse.csr_array((np.ones(len(rows)), (block_of, np.arange(len(rows)))), shape=(len(pairs), len(rows)))
    blocks = gather @ element_enini.transpose(0, 1, 3, 2, 4).reshape(-1, 9)
    starts = np.searchsorted(pairs, np.arange(count + 1) * count).astype(np.int32)  # what SuperLU takes
    block_columns = (pairs % count).astype(np.int32)
    matrix = sparse.bsr_array((blocks.reshape(-1, 3, 3), block_columns, starts), shape=(3 * count, 3 * count))
    return matrix.tocsr()
