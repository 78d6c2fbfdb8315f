"""A compressible neo-Hookean solid at finite strain on hexahedra: forces and their
derivative, at E = 1 Pa.

Energy per undeformed volume W = mu/2 (tr C - 3) - mu ln J + lambda/2 (ln J)^2; F = I +
du/dX, C = F^T F, J = det F. Total Lagrangian: every integral is over the undeformed
wall. Source: Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis,
sec. 6.4.3 and 9.4. For small strains it is Hooke's law with the same lambda and mu.
Tissue that stiffens (`stiffening`) multiplies its stress by exp(b Q), where mu Q/2 is
this energy.

Fibres make a wall stiffer along itself than through itself, or stiffer around the eye's
axis than towards it. They add one term to the energy. With e = (E11, E22, 2 E12), the
Green strain in the plane of the wall (1 around the eye's axis, 2 along the meridian),

    W = W0 + 1/2 e D e
    D = k/(1 - nu^2) [1 nu 0; nu 1 0; 0 0 (1 - nu)/2] + c [1 0 0; 0 0 0; 0 0 0]

where W0 has the modulus E0. Small strains: without stress through the wall its
isotropic part has the modulus E0 + k and the same nu; c adds to the modulus around. The
geometric mean of both directions is E. Shear through the wall has the modulus of W0,
E0/(2 (1 + nu)). In tissue that stiffens, W0 does and the term does not.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from scleraforce.base.arrays import Floats, Reals
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.finite_elements import (
    ELEMENTS_AT_ONCE,
    VolumePoints,
    volume_points,
)
from scleraforce.mechanics.hexahedral_mesh import COLUMN_NODES, HexMesh, sum_at
from scleraforce.mechanics.tissue_material import growth, lame_constants, strain_measure


@dataclass(frozen=True, eq=False)
class FibreLaw:
    """`base` is E0 and `plane` is D, (3, 3), both for E = 1 Pa."""

    base: float
    plane: Floats


def fibre_law(
    poisson_ratio: float, softer_through: float, stiffer_around: float
) -> FibreLaw:
    """Return the law by (E0 + k)/E0, and E around the eye's axis over E along the
    meridian.

    W0 is nearly incompressible, which makes it stiffer between fibres: with
    `softer_through` of 4, 10 and 25 and nu of 0.45 the modulus through the wall, where
    nothing holds it along, is 1/1.8, 1/3.4 and 1/7.3 of that along it.

    >>> law = fibre_law(0.45, 1.0, 2.0)
    >>> round(law.base, 3), law.plane[0].round(3).tolist()
    (0.627, [0.787, 0.0, 0.0])
    """
    nu = poisson_ratio
    k = 1.0 - 1.0 / softer_through
    c = (stiffer_around - 1.0) / (1.0 - nu**2)
    along = sqrt(stiffer_around) / (1.0 + c)
    plane = (
        k
        / (1.0 - nu**2)
        * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
    )
    plane[0, 0] += c

    return FibreLaw(base=along * (1.0 - k), plane=along * plane)


class FibreTerm:
    """The term's forces and tangents at the Gauss points of a wall, for E = 1 Pa."""

    def __init__(self, law: FibreLaw, points: VolumePoints, amount_ep: Floats) -> None:
        """`amount_ep`: volume of every Gauss point times its modulus over E."""
        elements, count, nodes, _ = points.gradients_epnc.shape
        # the local coordinate through the wall
        height_n = np.array(COLUMN_NODES[:nodes])[:, 0] - 1.0
        through_epc = np.einsum("n,epnc->epc", height_n, points.gradients_epnc)
        around_epc = np.cross([0.0, 0.0, 1.0], through_epc)
        directions_epkc = np.stack(
            [around_epc, np.cross(through_epc, around_epc)], axis=2
        )
        self._directions_epkc = directions_epkc / np.linalg.norm(
            directions_epkc, axis=-1, keepdims=True
        )
        slopes_epkn = self._directions_epkc @ points.gradients_epnc.transpose(
            0, 1, 3, 2
        )
        self._slopes_erN = slopes_epkn.reshape(elements, 2 * count, nodes)
        self._D_epvw = amount_ep[..., None, None] * law.plane

    def local_forces(self, local_eni: Floats) -> Floats:
        """Return the forces on the nodes of every element (element, node, 3) under
        their displacements.
        """
        moved_epki, stress_epkl = self._moved_and_stress(slice(None), local_eni)
        pulls = (stress_epkl @ moved_epki).reshape(len(local_eni), -1, 3)
        return self._slopes_erN.transpose(0, 2, 1) @ pulls

    def add_tangents(self, K_eiakb: Reals, part: slice, local_eni: Floats) -> None:
        """Add the tangents of some elements, under their nodes' displacements, to
        `K_eiakb`.
        """
        moved_epki, stress_epkl = self._moved_and_stress(part, local_eni)
        elements, nodes = local_eni.shape[:2]
        slopes_erN = self._slopes_erN[part]
        slopes_epkn = slopes_erN.reshape(elements, -1, 2, nodes)
        pulled = (stress_epkl @ slopes_epkn).reshape(slopes_erN.shape)
        laplacian_enn = (slopes_erN.transpose(0, 2, 1) @ pulled).astype(
            K_eiakb.dtype, copy=False
        )

        for i in range(3):
            K_eiakb[:, i, :, i] += laplacian_enn

        products_epkliN = (
            moved_epki[:, :, :, None, :, None] * slopes_epkn[:, :, None, :, None, :]
        )
        strains = [
            products_epkliN[:, :, 0, 0],
            products_epkliN[:, :, 1, 1],
            products_epkliN[:, :, 1, 0] + products_epkliN[:, :, 0, 1],
        ]
        B_epvN = (
            np.stack(strains, axis=2)
            .reshape(elements, -1, 3, 3 * nodes)
            .astype(K_eiakb.dtype, copy=False)
        )
        weighted = self._D_epvw[part].astype(K_eiakb.dtype, copy=False) @ B_epvN
        rows = B_epvN.reshape(elements, -1, 3 * nodes).transpose(0, 2, 1)
        K_eiakb += (rows @ weighted.reshape(elements, -1, 3 * nodes)).reshape(
            K_eiakb.shape
        )

    def _moved_and_stress(
        self, part: slice, local_eni: Floats
    ) -> tuple[Floats, Floats]:
        """Return both directions as the wall has moved them, (element, point, 2, 3),
        and D e as 2 x 2 matrices.

        The strain is summed without the 1 of the undeformed wall.
        """
        still = self._directions_epkc[part]
        change = (self._slopes_erN[part] @ local_eni).reshape(still.shape)
        mixed = still @ change.transpose(0, 1, 3, 2)
        double = (
            mixed + mixed.transpose(0, 1, 3, 2) + change @ change.transpose(0, 1, 3, 2)
        )
        strain_epv = np.stack(
            [0.5 * double[..., 0, 0], 0.5 * double[..., 1, 1], double[..., 0, 1]],
            axis=-1,
        )
        s = (self._D_epvw[part] @ strain_epv[..., None])[..., 0]
        stress = np.stack([s[..., 0], s[..., 2], s[..., 2], s[..., 1]], axis=-1)

        return still + change, stress.reshape(*s.shape[:2], 2, 2)


class NeoHookeanSolid:
    """The wall's material on its mesh, E = 1 Pa times a factor: forces are divided by
    E.
    """

    def __init__(
        self,
        mesh: HexMesh,
        poisson_ratio: float,
        modulus_factor_ep: Floats | None = None,
        *,
        stiffening: float = 0.0,
        fibres: FibreLaw | None = None,
    ) -> None:
        """Prepare everything that does not depend on the displacement.

        `modulus_factor_ep`: modulus over E at every Gauss point of `volume_points`,
        (element, point) or anything that broadcasts to it; `stiffening`: b of
        `tissue_material`, 0 for the neo-Hookean solid; `fibres`: of a wall from
        spheres.
        """
        points = volume_points(mesh)
        elements, count, nodes, _ = points.gradients_epnc.shape
        lame_lambda, lame_mu = lame_constants(
            1.0 if fibres is None else fibres.base, poisson_ratio
        )
        amount_ep = points.volumes_ep * (
            1.0 if modulus_factor_ep is None else modulus_factor_ep
        )
        self.points: VolumePoints = points
        self._fibres = None if fibres is None else FibreTerm(fibres, points, amount_ep)
        self._cells_en = mesh.cells_en
        self._poisson_ratio = poisson_ratio
        self._stiffening = stiffening
        self._lambda_ep = lame_lambda * amount_ep
        self._mu_ep = lame_mu * amount_ep
        # Rows of D are (point, direction J): D u gives all deformation gradients of an
        # element in one product.
        self._gradients_erN = (
            points.gradients_epnc.transpose(0, 1, 3, 2)
            .reshape(elements, 3 * count, nodes)
            .copy()
        )
        self._laplacian_enn = self._laplacian(slice(None), self._mu_ep)

    def forces(self, displacement_nc: Floats) -> Floats:
        """Return the nodal forces (node, 3) that hold a displacement (node, 3) in m; N
        per Pa of modulus.

        f_ai = integral of P_iJ N_a,J with P = mu (F - F^-T) + lambda ln J F^-T. Not a
        number where J <= 0, or where the tissue is stretched too far. Without loss of
        digits where strains are tiny: with H = F - I, F - F^-T = H + H^T F^-T, and J -
        1 is summed without the 1.
        """
        H_epJi = self._displacement_gradient(displacement_nc)
        dilatation_ep = _dilatation(H_epJi)
        if not np.all(dilatation_ep > -1.0):
            return np.full(displacement_nc.shape, np.nan)

        inverse_epiJ = _inverse(H_epJi)
        log_J_ep = np.log1p(dilatation_ep)
        P_epJi = self._stress(slice(None), H_epJi, inverse_epiJ, log_J_ep)
        if self._stiffening > 0.0:
            P_epJi *= self._growth(H_epJi, log_J_ep)[..., None, None]

        local_eni = self._gradients_erN.transpose(0, 2, 1) @ P_epJi.reshape(
            len(P_epJi), -1, 3
        )
        if self._fibres is not None:
            local_eni += self._fibres.local_forces(displacement_nc[self._cells_en])

        return sum_at(self._cells_en, local_eni, len(displacement_nc))

    def tangents(
        self, displacement_nc: Floats, precision: type[np.floating[Any]] = np.float64
    ) -> Reals:
        """Return the derivative of the forces by the displacement of every element,
        (element, 3, node, 3, node).

        K_iakb = integral of mu delta_ik N_a,J N_b,J + lambda g_ai g_bk + (mu - lambda
        ln J) g_ak g_bi, where g = F^-T grad N is the gradient by the deformed position.
        The first term does not depend on the displacement. In tissue that stiffens all
        of it is times exp(b Q), and so is (2 b/mu) p_ai p_bk with p_ai = P_iJ N_a,J of
        b = 0.
        """
        H_epJi = self._displacement_gradient(displacement_nc)
        J_ep = 1.0 + _dilatation(H_epJi)
        if not np.all(J_ep > 0.0):
            raise SolverError(
                "neo-Hookean: the wall is turned inside out; use a smaller step"
            )

        elements, nodes = self._cells_en.shape
        matrices = np.empty((elements, 3, nodes, 3, nodes), precision)

        for start in range(0, elements, ELEMENTS_AT_ONCE):
            part = slice(start, start + ELEMENTS_AT_ONCE)
            self._add_up(matrices[part], part, H_epJi[part], J_ep[part])

            if self._fibres is not None:
                self._fibres.add_tangents(
                    matrices[part], part, displacement_nc[self._cells_en[part]]
                )

        return matrices

    def _displacement_gradient(self, displacement_nc: Floats) -> Floats:
        """H^T = F^T - I at the Gauss points, (element, point, J, i)."""
        local_eni = displacement_nc[self._cells_en]
        gradient: Floats = self._gradients_erN @ local_eni
        return gradient.reshape(len(local_eni), -1, 3, 3)

    def _stress(
        self, part: slice, H_epJi: Floats, inverse_epiJ: Floats, log_J_ep: Floats
    ) -> Floats:
        """Stress of b = 0 of some elements times the volumes, P^T, (element, point, J,
        i).
        """
        inverse_epJi = inverse_epiJ.transpose(0, 1, 3, 2)
        P_epJi = self._mu_ep[part][..., None, None] * (
            H_epJi + inverse_epJi @ H_epJi.transpose(0, 1, 3, 2)
        )
        P_epJi += (self._lambda_ep[part] * log_J_ep)[..., None, None] * inverse_epJi
        return P_epJi

    def _growth(self, H_epJi: Floats, log_J_ep: Floats) -> Floats:
        """Factor of the stiffening on the stress, (element, point); I1 - 3 is summed
        without the 3.
        """
        excess_ep = 2.0 * np.trace(H_epJi, axis1=-2, axis2=-1) + np.sum(
            H_epJi**2, axis=(-2, -1)
        )
        return growth(
            self._stiffening, strain_measure(excess_ep, log_J_ep, self._poisson_ratio)
        )

    def _laplacian(self, part: slice, weight_ep: Floats) -> Floats:
        """Integral of weight N_a,J N_b,J over some elements, (element, node, node)."""
        gradients_erN = self._gradients_erN[part]
        weighted = gradients_erN * np.repeat(weight_ep, 3, axis=1)[..., None]
        return weighted.transpose(0, 2, 1) @ gradients_erN

    def _add_up(
        self, K_eiakb: Reals, part: slice, H_epJi: Floats, J_ep: Floats
    ) -> None:
        """Write the tangents of some elements to `K_eiakb`, in its precision."""
        elements, count = J_ep.shape
        nodes = self._cells_en.shape[1]
        precision = K_eiakb.dtype
        gradients = (
            self._gradients_erN[part]
            .reshape(elements, count, 3, nodes)
            .astype(precision, copy=False)
        )
        log_J_ep = np.log(J_ep)
        inverse_epiJ = _inverse(H_epJi)
        g = (inverse_epiJ.astype(precision, copy=False) @ gradients).reshape(
            elements, count, 3 * nodes
        )
        bulk_ep = self._lambda_ep[part]
        shear_ep = self._mu_ep[part] - self._lambda_ep[part] * log_J_ep
        laplacian_enn = self._laplacian_enn[part]

        if self._stiffening > 0.0:
            growth_ep = self._growth(H_epJi, log_J_ep)
            bulk_ep = growth_ep * bulk_ep
            shear_ep = growth_ep * shear_ep
            laplacian_enn = self._laplacian(part, growth_ep * self._mu_ep[part])

        def products(rows: Reals, weight_ep: Floats) -> Reals:
            weighted = weight_ep.astype(precision, copy=False)[..., None] * rows
            return (rows.transpose(0, 2, 1) @ weighted).reshape(K_eiakb.shape)

        shear = products(g, shear_ep)
        np.add(products(g, bulk_ep), shear.transpose(0, 3, 2, 1, 4), out=K_eiakb)
        for i in range(3):
            K_eiakb[:, i, :, i] += laplacian_enn

        if self._stiffening > 0.0:
            P_epiJ = self._stress(part, H_epJi, inverse_epiJ, log_J_ep).transpose(
                0, 1, 3, 2
            )
            p = (P_epiJ.astype(precision, copy=False) @ gradients).reshape(
                elements, count, 3 * nodes
            )
            K_eiakb += products(
                p, 2.0 * self._stiffening * growth_ep / self._mu_ep[part]
            )


def _inverse(H_epJi: Floats) -> Floats:
    """Inverse of F^T = I + H^T, (element, point, i, J)."""
    # 0.2 s: Numba, not before a wall is bent
    from scleraforce.mechanics.small_matrices import inverses

    return inverses(np.ascontiguousarray(H_epJi).reshape(-1, 3, 3)).reshape(
        H_epJi.shape
    )


def _dilatation(H_epJi: Floats) -> Floats:
    """det(I + H) - 1 (element, point)."""
    from scleraforce.mechanics.small_matrices import dilatations  # with Numba

    return dilatations(np.ascontiguousarray(H_epJi).reshape(-1, 3, 3)).reshape(
        H_epJi.shape[:2]
    )
