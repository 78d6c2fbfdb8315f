"""The supports of the wall: the displacement components that are held at zero."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.mesh import HexMesh

Flags = NDArray[np.bool_]


def clamped_base(mesh: HexMesh) -> Flags:
    """Clamp the whole base (the paper's Dirichlet condition, sec. 2.1): flags (node, 3), True where held."""
    held = np.zeros(mesh.points_nc.shape, dtype=bool)
    held[mesh.base_nodes] = True
    return held


def symmetric_base(mesh: HexMesh) -> Flags:
    """Make the base a plane of symmetry: the half-sphere stands for a whole sphere; flags (node, 3).

    Beside u_z on the base, three components are held against motion as a rigid body in the plane: u_y of the nodes at
    largest and smallest x, u_x of the one at largest y. They carry no force where the loads in the plane balance.
    """
    held = np.zeros(mesh.points_nc.shape, dtype=bool)
    base = mesh.points_nc[mesh.base_nodes]
    held[mesh.base_nodes, 2] = True
    held[mesh.base_nodes[[np.argmax(base[:, 0]), np.argmin(base[:, 0])]], 1] = True
    held[mesh.base_nodes[np.argmax(base[:, 1])], 0] = True
    return held
