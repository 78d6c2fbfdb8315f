"""A compressible neo-Hookean solid of revolution at finite strain: forces and their derivative, at E = 1 Pa.

The energy is that of `neo_hookean`. The deformation gradient has five entries that are not zero, in the order
F_rr, F_rz, F_zr, F_zz, F_tt (t: around the axis, F_tt = 1 + u_r / R). Every integral is over the undeformed wall.
Tissue that stiffens (`stiffening`) multiplies its stress by exp(b Q). Where this process uses compiled loops
(`compiled_solid`), they take less than half of the time of the arrays here.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import loops_are_compiled
from scleraforce.mechanics.axisymmetric.mesh import MeridianMesh
from scleraforce.mechanics.elasticity import lame_constants
from scleraforce.mechanics.quadrature import gauss_points
from scleraforce.mechanics.stiffening import growth, strain_measure

if TYPE_CHECKING:
    from scleraforce.mechanics.axisymmetric.compiled_solid import ElementTables

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

POINTS = 3  # along each direction of a 9-node quad


def line_shapes(places_p: Floats) -> tuple[Floats, Floats]:
    """Return values and slopes (point, 3) of the quadratic shape functions of nodes at -1, 0, 1.

    >>> line_shapes(np.array([-1.0]))[0]
    array([[ 1.,  0., -0.]])
    """
    s = places_p
    values = np.stack([0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)], axis=-1)
    return values, np.stack([s - 0.5, -2.0 * s, s + 0.5], axis=-1)


@dataclass(frozen=True, eq=False)
class _State:
    """Deformation at the Gauss points: F and its inverse's transpose H (element, 5, point); ln J (element, point)."""

    F: Floats
    H: Floats
    log_ratio: Floats


class SolidOfRevolution:
    """The wall's material on its meridian; unknown 2 n + c is node n, component c (from the axis, along it)."""

    def __init__(self, mesh: MeridianMesh, poisson_ratio: float, stiffening: float = 0.0) -> None:
        """Prepare everything that does not depend on the displacement; `stiffening`: b, 0 is the neo-Hookean solid."""
        lame_lambda, lame_mu = lame_constants(1.0, poisson_ratio)
        self.unknowns_eN: Integers = (2 * mesh.cells_en[:, :, None] + np.arange(2)).reshape(len(mesh.cells_en), -1)
        self._size = mesh.points_nc.size
        self._poisson_ratio, self._stiffening = poisson_ratio, stiffening
        self._G, volumes_ep = _gradient_operator(mesh)
        self._lambda_ep, self._mu_ep = lame_lambda * volumes_ep, lame_mu * volumes_ep
        elements, points = volumes_ep.shape
        self._flat = (elements, 5 * points, -1)
        # Rows are (component, point): every component of all points lies in one piece.
        self._rows_erN = self._G.transpose(0, 2, 1, 3).reshape(self._flat)
        self._laplacian = self._products(self._mu_ep[..., None, None] * np.eye(5))

    def forces(self, u: Floats) -> Floats:
        """Return the nodal forces that hold a displacement u, both (all unknowns,).

        They are not finite where J <= 0, or where the tissue is stretched too far.
        """
        if loops_are_compiled():
            return self._forces_by_loops(u)
        state = self._state(u)
        P = self._stress(state)
        if self._stiffening > 0.0:
            P *= self._growth(state)[:, None]
        local_eN = (P.reshape(len(P), 1, -1) @ self._rows_erN)[:, 0]
        forces = np.bincount(self.unknowns_eN.ravel(), local_eN.ravel(), minlength=self._size)
        return np.asarray(forces, dtype=np.float64)

    def tangents(self, u: Floats) -> Floats:
        """Return the derivative of the forces of every element, (element, 18, 18).

        mu dF:dF + lambda (H:dF)^2 + (mu - lambda ln J) H dF^T:(H dF^T)^T; the first does not depend on u. In tissue
        that stiffens all of it is times exp(b Q), and so is (2 b/mu) (P:dF)^2 with P of b = 0.
        """
        if loops_are_compiled():
            return self._tangents_by_loops(u)
        state = self._state(u)
        H = np.ascontiguousarray(state.H.transpose(0, 2, 1))
        A = (self._lambda_ep[..., None] * H)[..., :, None] * H[..., None, :]
        A += (self._mu_ep - self._lambda_ep * state.log_ratio)[..., None, None] * _exchange(H)
        if self._stiffening > 0.0:
            return self._products(self._stiffened(A, state))
        tangents: Floats = self._products(A) + self._laplacian
        return tangents

    def _forces_by_loops(self, u: Floats) -> Floats:
        from scleraforce.mechanics.axisymmetric.compiled_solid import nodal_forces

        forces = np.empty(self._size)
        nodal_forces(self._tables, u, forces)
        return forces

    def _tangents_by_loops(self, u: Floats) -> Floats:
        from scleraforce.mechanics.axisymmetric.compiled_solid import element_tangents

        tangents = np.empty((*self.unknowns_eN.shape, self.unknowns_eN.shape[1]))
        element_tangents(self._tables, u, tangents)
        return tangents

    @cached_property
    def _tables(self) -> "ElementTables":
        from scleraforce.mechanics.axisymmetric.compiled_solid import ElementTables

        shapes_epgn = np.ascontiguousarray(self._G[:, :, (0, 1, 4), ::2])
        lame_ratio = float(self._lambda_ep[0, 0] / self._mu_ep[0, 0])
        material = (self._lambda_ep, self._mu_ep, float(self._stiffening), lame_ratio)
        return ElementTables(shapes_epgn, self.unknowns_eN, *material)

    def _stress(self, state: _State) -> Floats:
        """Stress of b = 0 times the volumes, (element, 5, point)."""
        along_H = self._lambda_ep * state.log_ratio - self._mu_ep
        stress: Floats = self._mu_ep[:, None] * state.F + along_H[:, None] * state.H
        return stress

    def _growth(self, state: _State) -> Floats:
        """Factor of the stiffening on the stress, (element, point)."""
        excess = np.sum(state.F**2, axis=1) - 3.0
        return growth(self._stiffening, strain_measure(excess, state.log_ratio, self._poisson_ratio))

    def _stiffened(self, A: Floats, state: _State) -> Floats:
        """Elasticity of tissue that stiffens, from that of b = 0 without mu dF:dF: both (element, point, 5, 5)."""
        P = self._stress(state).transpose(0, 2, 1)
        rise = 2.0 * self._stiffening / self._mu_ep
        whole = A + self._mu_ep[..., None, None] * np.eye(5) + rise[..., None, None] * P[..., :, None] * P[..., None, :]
        stiffened: Floats = self._growth(state)[..., None, None] * whole
        return stiffened

    def _products(self, A: Floats) -> Floats:
        """Return dF A dF of every element by its displacements, (element, 18, 18)."""
        products: Floats = (A @ self._G).reshape(self._flat).transpose(0, 2, 1) @ self._G.reshape(self._flat)
        return products

    def _state(self, u: Floats) -> _State:
        elements, points = self._mu_ep.shape
        F = (self._rows_erN @ u[self.unknowns_eN][..., None]).reshape(elements, 5, points)
        F[:, 0] += 1.0
        F[:, 3:] += 1.0
        rr, rz, zr, zz, tt = (F[:, component] for component in range(5))
        plane = rr * zz - rz * zr
        H = np.empty_like(F)
        with np.errstate(divide="ignore", invalid="ignore"):
            log_ratio = np.where((plane > 0.0) & (tt > 0.0), np.log(plane * tt), np.nan)
            inverse = 1.0 / plane
            H[:, 0], H[:, 3], H[:, 4] = zz * inverse, rr * inverse, 1.0 / tt
            H[:, 1], H[:, 2] = -zr * inverse, -rz * inverse
        return _State(F, H, log_ratio)


def _gradient_operator(mesh: MeridianMesh) -> tuple[Floats, Floats]:
    """Return G (element, point, 5, 18) with dF = G du, and the volume of every Gauss point, (element, point) in m^3."""
    places_pk, weights_p = gauss_points(2, POINTS)
    (along, along_slope), (across, across_slope) = line_shapes(places_pk[:, 0]), line_shapes(places_pk[:, 1])
    values_pn = np.einsum("pj,pi->pji", across, along).reshape(len(weights_p), 9)
    slopes_pnk = np.stack(
        [np.einsum("pj,pi->pji", across, along_slope), np.einsum("pj,pi->pji", across_slope, along)], axis=-1
    ).reshape(len(weights_p), 9, 2)
    corners_enc = mesh.points_nc[mesh.cells_en]
    jacobian_epck = np.einsum("enc,pnk->epck", corners_enc, slopes_pnk)
    gradients_epnc = slopes_pnk @ np.linalg.inv(jacobian_epck)
    distance_ep = np.einsum("pn,en->ep", values_pn, corners_enc[..., 0])
    G = np.zeros((*distance_ep.shape, 5, 9, 2))
    for i in range(2):
        G[:, :, 2 * i : 2 * i + 2, :, i] = gradients_epnc.transpose(0, 1, 3, 2)
    G[:, :, 4, :, 0] = values_pn / distance_ep[..., None]
    areas_ep = np.abs(np.linalg.det(jacobian_epck)) * weights_p
    return G.reshape(*distance_ep.shape, 5, 18), 2.0 * np.pi * distance_ep * areas_ep


def _exchange(H: Floats) -> Floats:
    """Return B with dF : B dF = tr(H dF^T H dF^T): B_iJ,kL = H_iL H_kJ, (element, point, 5, 5)."""
    plane = H[..., :4].reshape(*H.shape[:-1], 2, 2)
    B = np.zeros((*H.shape, 5))
    exchanged = plane[..., :, None, None, :] * plane[..., None, :, :, None].swapaxes(-3, -2)
    B[..., :4, :4] = exchanged.reshape(*H.shape[:-1], 4, 4)
    B[..., 4, 4] = H[..., 4] ** 2
    return B
