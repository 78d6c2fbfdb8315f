"""Gauss points of quads and hexahedra, and the geometry of the elements there."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import SolverError
from scleraforce.eye.mesh import HexMesh
from scleraforce.eye.shapes import shape_gradients, shape_values

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class VolumePoints:
    """The Gauss points of all elements.

    `values_pn` (point, node); `gradients_epnc` (element, point, node, 3): derivatives of the shape functions by x in
    1/m; `volumes_ep` (element, point): volume that belongs to the point in m^3.
    """

    values_pn: Floats
    gradients_epnc: Floats
    volumes_ep: Floats


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Gauss points on surface quads.

    `values_pn` (point, node of a quad); `positions_qpc` (quad, point, 3) in m; `areas_qpc` (quad, point, 3): area that
    belongs to the point times the normal (seen from where the quads are counter-clockwise) in m^2.
    """

    values_pn: Floats
    positions_qpc: Floats
    areas_qpc: Floats


@cache
def gauss_points(dimension: int, count: int) -> tuple[Floats, Floats]:
    """Return Gauss-Legendre points on [-1, 1]^d (point, d) and weights (point,), `count` along each direction."""
    points, weights = np.polynomial.legendre.leggauss(count)
    places = np.stack(np.meshgrid(*[points] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    products = np.prod(np.stack(np.meshgrid(*[weights] * dimension, indexing="ij"), axis=-1), axis=-1)
    return places, products.ravel()


def volume_points(mesh: HexMesh, count: int | None = None) -> VolumePoints:
    """Return the Gauss points of the elements, `count` along each direction (by default order + 1: full integration).

    Raises:
        SolverError: an element is turned inside out.
    """
    places, weights = gauss_points(3, count or mesh.order + 1)
    nodes = mesh.cells_en.shape[1]
    slopes_pnk = shape_gradients(places, nodes)
    corners_enc = mesh.points_nc[mesh.cells_en]
    jacobian_epck = np.einsum("enc,pnk->epck", corners_enc, slopes_pnk, optimize=True)
    determinant_ep = np.linalg.det(jacobian_epck)
    if not np.all(determinant_ep > 0.0):
        raise SolverError("mesh: an element has a negative volume; use fewer layers or a finer mesh")
    gradients = slopes_pnk @ np.linalg.inv(jacobian_epck)
    return VolumePoints(shape_values(places, nodes), gradients, determinant_ep * weights)


def surface_points(mesh: HexMesh, quads_qn: Integers, count: int) -> SurfacePoints:
    """Return Gauss points of the quads `quads_qn` (quad, 4, 8 or 9), `count` along each direction."""
    places, weights = gauss_points(2, count)
    nodes = quads_qn.shape[1]
    values_pn, slopes_pnk = shape_values(places, nodes), shape_gradients(places, nodes)
    corners_qnc = mesh.points_nc[quads_qn]
    tangents_qpck = np.einsum("qnc,pnk->qpck", corners_qnc, slopes_pnk, optimize=True)
    normals = np.cross(tangents_qpck[..., 0], tangents_qpck[..., 1])
    return SurfacePoints(values_pn, values_pn @ corners_qnc, normals * weights[:, None])
