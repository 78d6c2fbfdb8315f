"""Pressure that follows the deformed inner surface, and the volume of the cavity behind it.

The force f_a = p * integral of N_a (x,1 x x,2) over the local coordinates of the inner quads is the derivative by the
nodes' positions of p times the cavity's volume, as long as the edge of the surface is held or stays in its plane:
then the derivative of f is symmetric. Source: Bonet and Wood, Nonlinear Continuum Mechanics, sec. 8.5 and 9.5.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.mesh import HexMesh
from scleraforce.eye.shapes import shape_gradients, shape_values
from scleraforce.mechanics.assembly import FacePlaces
from scleraforce.mechanics.loads import PRESSURE_POINTS
from scleraforce.mechanics.quadrature import gauss_points

Floats = NDArray[np.float64]

# (e_k x a)_i = a_m for these (i, k, m), and -a_m with i and k exchanged.
TURNS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


class InnerSurface:
    """The inner surface of the wall, on which the vitreous presses; displacements are (node, 3) in m."""

    def __init__(self, mesh: HexMesh) -> None:
        """Prepare everything that does not depend on the displacement."""
        places, weights = gauss_points(2, PRESSURE_POINTS)
        nodes = mesh.inner_qn.shape[1]
        self._points_nc, self._quads_qn = mesh.points_nc, mesh.inner_qn
        base = mesh.points_nc[np.intersect1d(mesh.base_nodes, mesh.inner_qn)]
        self._origin_c = base.mean(axis=0) if len(base) else np.zeros(3)
        self._values_pn = shape_values(places, nodes)
        self._slopes_kpn = shape_gradients(places, nodes).transpose(2, 0, 1)
        self._weights_p = weights
        self._places = FacePlaces(mesh.cells_en, mesh.inner_qn)
        # integral of N_a N_b,k for the derivative: w_p N_a N_b,k, (k, a, b, point)
        self._products = np.einsum("p,pa,kpb->kabp", weights, self._values_pn, self._slopes_kpn)

    def volume(self, displacement_nc: Floats) -> float:
        """Return the volume of the cavity in m^3: that inside a whole globe, or above the base of a half.

        V = 1/3 integral of x . n with x from a point of the base, so that the base, which is plane, adds nothing.
        """
        x_qnc = (self._points_nc + displacement_nc - self._origin_c)[self._quads_qn]
        areas = self._areas(x_qnc)
        return float(np.einsum("p,pn,qnc,qpc->", self._weights_p, self._values_pn, x_qnc, areas, optimize=True)) / 3.0

    def forces(self, displacement_nc: Floats) -> Floats:
        """Return the nodal forces of 1 Pa, normal to the deformed surface, outward: (node, 3) in N.

        They are the derivative of `volume` by the displacement where the edge is held.
        """
        areas = self._areas((self._points_nc + displacement_nc)[self._quads_qn])
        local_qnc = np.einsum("p,pn,qpc->qnc", self._weights_p, self._values_pn, areas, optimize=True)
        flat, count = self._quads_qn.ravel(), len(self._points_nc)
        return np.stack([np.bincount(flat, local_qnc[..., c].ravel(), minlength=count) for c in range(3)], axis=1)

    def add_tangent(self, element_eiajb: NDArray[np.floating[Any]], displacement_nc: Floats, factor: float) -> None:
        """Add `factor` times the derivative of the forces by the displacement to the element matrices, in place.

        df_a / du_b = integral of N_a (N_b,1 e_k x x,2 - N_b,2 e_k x x,1). Of every quad its symmetric part is added:
        what is left out cancels between neighbours, and at the edge where it is held.
        """
        x_qnc = (self._points_nc + displacement_nc)[self._quads_qn]
        first, second = (slopes_pn @ x_qnc for slopes_pn in self._slopes_kpn)
        vectors = np.einsum("abp,qpm->qabm", self._products[0], second, optimize=True)
        vectors -= np.einsum("abp,qpm->qabm", self._products[1], first, optimize=True)
        vectors = 0.5 * factor * (vectors - vectors.transpose(0, 2, 1, 3))
        nodes = self._quads_qn.shape[1]
        local = np.zeros((len(vectors), 3, nodes, 3, nodes))
        for i, k, m in TURNS:
            local[:, i, :, k] = vectors[..., m]
            local[:, k, :, i] = -vectors[..., m]
        self._places.add(element_eiajb, local)

    def _areas(self, x_qnc: Floats) -> Floats:
        """x,1 x x,2 at the Gauss points of quads with nodes at x, (quad, point, 3)."""
        first, second = (slopes_pn @ x_qnc for slopes_pn in self._slopes_kpn)
        areas: Floats = np.cross(first, second)
        return areas
