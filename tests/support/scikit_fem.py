"""Our meshes in scikit-fem, an independent program."""

import numpy as np
import skfem

from scleraforce.mechanics.mesh import HexMesh
from scleraforce.mechanics.shapes import node_positions


def scikit_fem_basis(mesh: HexMesh, element: type, mesh_type: type) -> tuple[skfem.CellBasis, np.ndarray]:
    """Their basis on our mesh, and our unknown (3 n + c: node n, component c) for each of theirs."""
    reference = node_positions(3, mesh.cells_en.shape[1]) / 2 + 0.5
    ours_for = [int(np.argmin(np.linalg.norm(reference - place, axis=1))) for place in element.doflocs]
    corners, vertex_of = np.unique(mesh.cells_en[:, ours_for[:8]], return_inverse=True)
    linear = skfem.MeshHex1(mesh.points_nc[corners].T, vertex_of.reshape(-1, 8).T.astype(np.int32))
    scalar = skfem.CellBasis(linear, element(), intorder=2)
    places = np.empty((scalar.N, 3))
    places[scalar.element_dofs.T] = mesh.points_nc[mesh.cells_en[:, ours_for]]
    curved = mesh_type(places.T, linear.t) if mesh.order == 2 else linear
    # 5: three Gauss points along each direction; 3, for trilinear elements: two.
    basis = skfem.CellBasis(curved, skfem.ElementVector(element()), intorder=5 if mesh.order == 2 else 3)
    ours = np.empty(basis.N, dtype=int)
    unknowns = 3 * mesh.cells_en[:, ours_for][..., None] + np.arange(3)
    ours[basis.element_dofs.T] = unknowns.reshape(len(mesh.cells_en), -1)
    return basis, ours
