"""Loads on a wall of revolution: the needle on its outer boundary, the eye pressure on its inner one.

Nodal forces are those on the full circle; unknown 2 n + c is node n, component c (from the axis, along it).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.axisymmetric.mesh import MeridianMesh
from scleraforce.mechanics.axisymmetric.solid import line_shapes
from scleraforce.mechanics.quadrature import gauss_points

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BOUNDARY_POINTS = 3  # exact for r^2 dz along a quadratic curve
SPREAD_POINTS = 6


def needle_load(mesh: MeridianMesh) -> Floats:
    """Return nodal forces of 1 N, uniform over the needle's disc seen along the axis, inward: (all unknowns,).

    The disc is that of the first element.
    """
    nodes_en, values_pn, slopes_pn, weights_p = _boundary(mesh.outer_n)
    nodes_en = nodes_en[:1]
    distance_en = mesh.points_nc[nodes_en, 0]
    rim_m = distance_en[-1, -1]
    weight_ep = 2.0 * (distance_en @ values_pn.T) * (distance_en @ slopes_pn.T) * weights_p / rim_m**2
    return _inward(mesh, nodes_en, weight_ep @ values_pn)


def spread_load(mesh: MeridianMesh, spread: Callable[[Floats], Floats]) -> Floats:
    """Return nodal forces of 1 N, spread over the outer surface by the distance from the contact: (all unknowns,)."""
    nodes_en, values_pn, slopes_pn, weights_p = _boundary(mesh.outer_n, SPREAD_POINTS)
    points_enc = mesh.points_nc[nodes_en]
    positions_epc = np.einsum("pn,enc->epc", values_pn, points_enc)
    length_ep = np.linalg.norm(np.einsum("pn,enc->epc", slopes_pn, points_enc), axis=-1)
    weight_ep = positions_epc[..., 0] * length_ep * weights_p
    weight_ep *= spread(np.linalg.norm(positions_epc - mesh.points_nc[mesh.outer_n[0]], axis=-1))
    return _inward(mesh, nodes_en, (weight_ep / weight_ep.sum()) @ values_pn)


def _inward(mesh: MeridianMesh, nodes_en: Integers, amount_en: Floats) -> Floats:
    flat = 2 * nodes_en + 1
    along = np.bincount(flat.ravel(), amount_en.ravel(), minlength=mesh.points_nc.size)
    return np.asarray(-along, dtype=np.float64)


class Interior:
    """The space inside the inner boundary: V = pi times the integral of r^2 dz from the support to the axis.

    Pressure does work on V, so that dV is its load and the second derivative its part of the tangent, symmetric. The
    support holds z; what lies beyond it does not move.
    """

    def __init__(self, mesh: MeridianMesh) -> None:
        """Prepare everything that does not depend on the displacement."""
        self._points_nc = mesh.points_nc
        self._nodes_en, self._values_pn, slopes_pn, self._weights_p = _boundary(mesh.inner_n)
        self._slopes_pn = -slopes_pn  # from the support to the axis
        self._unknowns = np.concatenate([2 * self._nodes_en.ravel(), 2 * self._nodes_en.ravel() + 1])
        # The inner nodes of an element of the innermost layer are its last three.
        layers = len(mesh.cells_en) // len(self._nodes_en)
        self._elements = np.arange(layers - 1, len(mesh.cells_en), layers)
        rows = self._weights_p[:, None] * self._values_pn
        self._mass_pab = (rows[:, :, None] * self._values_pn[:, None, :]).reshape(-1, 9)
        self._mixed_pab = (rows[:, :, None] * self._slopes_pn[:, None, :]).reshape(-1, 9)

    def volume(self, everywhere: Floats) -> tuple[float, Floats]:
        """Return V in m^3 and its derivative, (all unknowns,)."""
        r_ep, slope_ep = self._curve(everywhere)
        along = (2.0 * np.pi * r_ep * slope_ep * self._weights_p) @ self._values_pn
        up = (np.pi * r_ep**2 * self._weights_p) @ self._slopes_pn
        forces = np.concatenate([along.ravel(), up.ravel()])
        gradient: Floats = np.bincount(self._unknowns, forces, minlength=len(everywhere)).astype(np.float64, copy=False)
        return float(np.pi * np.sum(r_ep**2 * slope_ep * self._weights_p)), gradient

    def subtract_curvature(self, tangents: Floats, everywhere: Floats, pressure: float) -> None:
        """Subtract p times the second derivative of V from the element tangents (element, 18, 18)."""
        r_ep, slope_ep = self._curve(everywhere)
        block = tangents.reshape(len(tangents), 9, 2, 9, 2)
        part = np.zeros((len(self._elements), 3, 2, 3, 2))
        mixed = 2.0 * np.pi * (r_ep @ self._mixed_pab).reshape(-1, 3, 3)
        part[:, :, 0, :, 0] = 2.0 * np.pi * (slope_ep @ self._mass_pab).reshape(-1, 3, 3)
        part[:, :, 0, :, 1] = mixed
        part[:, :, 1, :, 0] = mixed.transpose(0, 2, 1)
        block[self._elements, 6:, :, 6:, :] -= pressure * part

    def _curve(self, everywhere: Floats) -> tuple[Floats, Floats]:
        """Distance from the axis and slope of the height along the deformed inner boundary, (element, point)."""
        points_enc = (self._points_nc + everywhere.reshape(-1, 2))[self._nodes_en]
        return points_enc[..., 0] @ self._values_pn.T, points_enc[..., 1] @ self._slopes_pn.T


def _boundary(nodes_n: Integers, points: int = BOUNDARY_POINTS) -> tuple[Integers, Floats, Floats, Floats]:
    """Nodes (element, 3) of a boundary's elements; shape functions, slopes (point, 3) and weights (point,) on each."""
    places_pk, weights_p = gauss_points(1, points)
    nodes_en = np.stack([nodes_n[:-2:2], nodes_n[1::2], nodes_n[2::2]], axis=1)
    return nodes_en, *line_shapes(places_pk[:, 0]), weights_p
