"""R1, the project's reference problem for linear mechanics: a clamped half-sphere of 12
mm under one Gaussian force.

0.25 MPa, nu 0.45, 30 mN at 35 degrees with a Gaussian of 0.35 mm, no pressure, no
weight. What is read is the inward displacement along the load at its centre.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import surface_points
from scleraforce.mechanics.hexahedral_mesh import HexMesh

RADIUS_M = 12e-3
NU = 0.45
E_PA = 0.25e6
FORCE_N = 0.03
SPREAD_M = 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0))
# By thickness: 60 quads along an edge (0.5 mm), 40 (0.8 mm), one layer of 20-node
# elements.
CONVERGED_MM = {0.5e-3: 2.168, 0.8e-3: 0.9084}


def gaussian_load(
    mesh: HexMesh, contact: Contact, spread_m: float
) -> NDArray[np.float64]:
    """Return a load of 1 N, (node, 3), integrated over the outer surface."""
    values_pn, areas_qpc = surface_points(mesh, mesh.outer_qn, 8)
    positions_qpc = values_pn @ mesh.points_nc[mesh.outer_qn]
    away_qp = np.sum((positions_qpc - mesh.radius_m * contact.normal) ** 2, axis=-1)
    load_qp = np.exp(-away_qp / (2 * spread_m**2)) * np.linalg.norm(areas_qpc, axis=-1)
    weights = (load_qp @ values_pn).ravel() / load_qp.sum()
    nodal_n = np.bincount(mesh.outer_qn.ravel(), weights, minlength=len(mesh.points_nc))
    load_nc: NDArray[np.float64] = -nodal_n[:, None] * contact.normal

    return load_nc
