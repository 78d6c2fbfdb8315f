"""The volume inside a wall, by Gauss points on its curved inner quads."""

import numpy as np

from scleraforce.mechanics.hexahedral_mesh import HexMesh

GRID = np.array([[0, 4, 1], [7, 8, 5], [3, 6, 2]])  # a quad's nodes, row by row
PLACES, WEIGHTS = np.polynomial.legendre.leggauss(3)
# of Lagrange's polynomials through -1, 0 and 1
COEFFICIENTS = np.linalg.inv(np.vander([-1.0, 0.0, 1.0]))
VALUES = np.vander(PLACES, 3) @ COEFFICIENTS
SLOPES = np.stack([2.0 * PLACES, np.ones(3), np.zeros(3)], axis=1) @ COEFFICIENTS


def cavity_m3(mesh: HexMesh, displacement_nc: np.ndarray) -> float:
    """V = 1/3 of the integral of x . n; a base on z = 0 adds nothing."""
    nodes_qijc = (mesh.points_nc + displacement_nc)[mesh.inner_qn[:, GRID]]
    points, along, across = (
        np.einsum("qijc,ui,vj->quvc", nodes_qijc, of_rows, of_columns)
        for of_rows, of_columns in (
            (VALUES, VALUES),
            (VALUES, SLOPES),
            (SLOPES, VALUES),
        )
    )
    fluxes_quv = np.sum(points * np.cross(along, across), axis=-1)

    return float(np.einsum("quv,u,v->", fluxes_quv, WEIGHTS, WEIGHTS)) / 3.0
