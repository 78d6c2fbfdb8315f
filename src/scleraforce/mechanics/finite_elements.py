"""Gauss points of quads and hexahedra, and the element matrices of Hooke's law there
(paper eq. 1 and 2).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from scleraforce.base.arrays import Floats, Integers, Reals
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.hexahedral_mesh import COLUMN_NODES, HexMesh
from scleraforce.mechanics.shape_functions import shape_gradients, shape_values


@dataclass(frozen=True, eq=False)
class VolumePoints:
    """The Gauss points of all elements.

    `values_pn` (point, node); `gradients_epnc` (element, point, node, 3): derivatives
    of the shape functions by x in 1/m; `volumes_ep` (element, point): volume that
    belongs to the point in m^3.
    """

    values_pn: Floats
    gradients_epnc: Floats
    volumes_ep: Floats


@cache
def gauss_points(dimension: int, count: int) -> tuple[Floats, Floats]:
    """Return Gauss-Legendre points on [-1, 1]^d (point, d) and weights (point,),
    `count` along each direction.
    """
    points, weights = np.polynomial.legendre.leggauss(count)
    places = np.stack(
        np.meshgrid(*[points] * dimension, indexing="ij"), axis=-1
    ).reshape(-1, dimension)
    products = np.prod(
        np.stack(np.meshgrid(*[weights] * dimension, indexing="ij"), axis=-1), axis=-1
    )

    return places, products.ravel()


def volume_points(mesh: HexMesh) -> VolumePoints:
    """Return the Gauss points of the elements, order + 1 along each direction: full
    integration.
    """
    places, weights = gauss_points(3, mesh.order + 1)
    nodes = mesh.cells_en.shape[1]
    slopes_pnk = shape_gradients(places, nodes)
    corners_enc = mesh.points_nc[mesh.cells_en]
    jacobian_epck = np.einsum("enc,pnk->epck", corners_enc, slopes_pnk, optimize=True)

    determinant_ep = np.linalg.det(jacobian_epck)
    if not np.all(determinant_ep > 0.0):
        raise SolverError(
            "mesh: an element has a negative volume; use fewer layers or a finer mesh"
        )

    gradients = slopes_pnk @ np.linalg.inv(jacobian_epck)
    return VolumePoints(
        shape_values(places, nodes), gradients, determinant_ep * weights
    )


def surface_points(
    mesh: HexMesh, quads_qn: Integers, count: int
) -> tuple[Floats, Floats]:
    """Return shape functions and areas at Gauss points of quads (quad, 4, 8 or 9),
    `count` along each direction.

    values_pn (point, node of a quad); areas_qpc (quad, point, 3): area that belongs to
    the point times the normal (seen from where the quads are counter-clockwise) in m^2.
    """
    places, weights = gauss_points(2, count)
    nodes = quads_qn.shape[1]
    values_pn = shape_values(places, nodes)
    slopes_pnk = shape_gradients(places, nodes)
    tangents_qpck = np.einsum(
        "qnc,pnk->qpck", mesh.points_nc[quads_qn], slopes_pnk, optimize=True
    )
    normals = np.cross(tangents_qpck[..., 0], tangents_qpck[..., 1])

    return values_pn, normals * weights[:, None]


# 27-node matrices of 64 elements take 3 MB: they stay in the processor's cache
ELEMENTS_AT_ONCE = 64


def element_stiffness(
    points: VolumePoints, lame_lambda: float, lame_mu: float
) -> Floats:
    """Return the stiffness of every element, shape (element, 3, node, 3, node), in N/m
    for Lame constants in Pa.

    K_iajb = integral of lambda N_a,i N_b,j + mu (N_a,j N_b,i + delta_ij N_a,k N_b,k).
    All of it follows from the one tensor G_iajb = integral of N_a,i N_b,j, a matrix
    product over the Gauss points.
    """
    elements, count, nodes, _ = points.gradients_epnc.shape
    K: Floats = np.empty((elements, 3, nodes, 3, nodes))

    for start in range(0, elements, ELEMENTS_AT_ONCE):
        part = slice(start, start + ELEMENTS_AT_ONCE)
        gradients = (
            points.gradients_epnc[part]
            .transpose(0, 1, 3, 2)
            .reshape(-1, count, 3 * nodes)
        )
        weighted = gradients * points.volumes_ep[part, :, None]
        G = (weighted.transpose(0, 2, 1) @ gradients).reshape(-1, 3, nodes, 3, nodes)
        np.multiply(G, lame_lambda, out=K[part])
        K[part] += lame_mu * G.transpose(0, 3, 2, 1, 4)
        trace = lame_mu * (G[:, 0, :, 0] + G[:, 1, :, 1] + G[:, 2, :, 2])

        for i in range(3):
            K[part, i, :, i] += trace

    return K


def add_faces(
    element_eiajb: Reals,
    mesh: HexMesh,
    face_qiajb: Floats,
    quads_q: Integers | None = None,
    *,
    layer: int,
) -> None:
    """Add matrices of faces (face, 3, node, 3, node) to the matrices of their elements,
    in place.

    `quads_q`: numbers of the faces, by default all, on the outer (`layer` 2) or inner
    surface (0); they may repeat.
    """
    nodes = mesh.cells_en.shape[1]
    quads = len(mesh.outer_qn)
    local_n = np.array(
        [COLUMN_NODES.index((layer, node)) for node in range(mesh.outer_qn.shape[1])]
    )
    unknown_in = np.arange(3)[:, None] * nodes + local_n
    # Elements come layer by layer, the outermost first.
    element_q = (np.arange(quads) if quads_q is None else quads_q) + (
        0 if layer == 2 else len(mesh.cells_en) - quads
    )
    row_qin = (element_q[:, None, None] * 3 * nodes + unknown_in) * 3 * nodes
    # a view: element matrices are made in one piece
    entries = element_eiajb.reshape(-1)
    np.add.at(
        entries,
        (row_qin[..., None, None] + unknown_in).ravel(),
        face_qiajb.ravel().astype(entries.dtype),
    )
