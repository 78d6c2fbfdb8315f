"""Fibres: a wall that is stiffer along itself than through itself, or stiffer around the eye's axis than towards it.

They add one term to the energy of `neo_hookean`. With e = (E11, E22, 2 E12), the Green strain in the plane of the wall
(1 around the eye's axis, 2 along the meridian),

    W = W0 + 1/2 e D e        D = k/(1 - nu^2) [1 nu 0; nu 1 0; 0 0 (1 - nu)/2] + c [1 0 0; 0 0 0; 0 0 0]

where W0 has the modulus E0. Small strains: without stress through the wall its isotropic part has the modulus E0 + k
and the same nu; c adds to the modulus around. The geometric mean of both directions is E. Shear through the wall has
the modulus of W0, E0/(2 (1 + nu)). In tissue that stiffens, W0 does and the term does not.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from scleraforce.arrays import Floats, Reals
from scleraforce.mechanics.elements import VolumePoints
from scleraforce.mechanics.mesh import COLUMN_NODES


@dataclass(frozen=True, eq=False)
class FibreLaw:
    """`base` is E0 and `plane` is D, (3, 3), both for E = 1 Pa."""

    base: float
    plane: Floats


def fibre_law(poisson_ratio: float, softer_through: float, stiffer_around: float) -> FibreLaw:
    """Return the law by (E0 + k)/E0, and E around the eye's axis over E along the meridian.

    W0 is nearly incompressible, which makes it stiffer between fibres: with `softer_through` of 4, 10 and 25 and nu of
    0.45 the modulus through the wall, where nothing holds it along, is 1/1.8, 1/3.4 and 1/7.3 of that along it.

    >>> law = fibre_law(0.45, 1.0, 2.0)
    >>> round(law.base, 3), law.plane[0].round(3).tolist()
    (0.627, [0.787, 0.0, 0.0])
    """
    nu, k = poisson_ratio, 1.0 - 1.0 / softer_through
    c = (stiffer_around - 1.0) / (1.0 - nu**2)
    along = sqrt(stiffer_around) / (1.0 + c)
    plane = k / (1.0 - nu**2) * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
    plane[0, 0] += c
    return FibreLaw(base=along * (1.0 - k), plane=along * plane)


class FibreTerm:
    """The term's forces and tangents at the Gauss points of a wall, for E = 1 Pa."""

    def __init__(self, law: FibreLaw, points: VolumePoints, amount_ep: Floats) -> None:
        """`amount_ep`: volume of every Gauss point times its modulus over E."""
        elements, count, nodes, _ = points.gradients_epnc.shape
        height_n = np.array(COLUMN_NODES[:nodes])[:, 0] - 1.0  # the local coordinate through the wall
        through_epc = np.einsum("n,epnc->epc", height_n, points.gradients_epnc)
        around_epc = np.cross([0.0, 0.0, 1.0], through_epc)
        directions_epkc = np.stack([around_epc, np.cross(through_epc, around_epc)], axis=2)
        self._directions_epkc = directions_epkc / np.linalg.norm(directions_epkc, axis=-1, keepdims=True)
        slopes_epkn = self._directions_epkc @ points.gradients_epnc.transpose(0, 1, 3, 2)
        self._slopes_erN = slopes_epkn.reshape(elements, 2 * count, nodes)
        self._D_epvw = amount_ep[..., None, None] * law.plane

    def local_forces(self, local_eni: Floats) -> Floats:
        """Return the forces on the nodes of every element (element, node, 3) under their displacements."""
        moved_epki, stress_epkl = self._moved_and_stress(slice(None), local_eni)
        pulls = (stress_epkl @ moved_epki).reshape(len(local_eni), -1, 3)
        return self._slopes_erN.transpose(0, 2, 1) @ pulls

    def add_tangents(self, K_eiakb: Reals, part: slice, local_eni: Floats) -> None:
        """Add the tangents of some elements, under their nodes' displacements, to `K_eiakb`."""
        moved_epki, stress_epkl = self._moved_and_stress(part, local_eni)
        elements, nodes = local_eni.shape[:2]
        slopes_erN = self._slopes_erN[part]
        slopes_epkn = slopes_erN.reshape(elements, -1, 2, nodes)
        pulled = (stress_epkl @ slopes_epkn).reshape(slopes_erN.shape)
        laplacian_enn = (slopes_erN.transpose(0, 2, 1) @ pulled).astype(K_eiakb.dtype, copy=False)
        for i in range(3):
            K_eiakb[:, i, :, i] += laplacian_enn
        products_epkliN = moved_epki[:, :, :, None, :, None] * slopes_epkn[:, :, None, :, None, :]
        strains = [products_epkliN[:, :, 0, 0], products_epkliN[:, :, 1, 1],
                   products_epkliN[:, :, 1, 0] + products_epkliN[:, :, 0, 1]]  # fmt: skip
        B_epvN = np.stack(strains, axis=2).reshape(elements, -1, 3, 3 * nodes).astype(K_eiakb.dtype, copy=False)
        weighted = self._D_epvw[part].astype(K_eiakb.dtype, copy=False) @ B_epvN
        rows = B_epvN.reshape(elements, -1, 3 * nodes).transpose(0, 2, 1)
        K_eiakb += (rows @ weighted.reshape(elements, -1, 3 * nodes)).reshape(K_eiakb.shape)

    def _moved_and_stress(self, part: slice, local_eni: Floats) -> tuple[Floats, Floats]:
        """Return both directions as the wall has moved them, (element, point, 2, 3), and D e as 2 x 2 matrices.

        The strain is summed without the 1 of the undeformed wall.
        """
        still = self._directions_epkc[part]
        change = (self._slopes_erN[part] @ local_eni).reshape(still.shape)
        mixed = still @ change.transpose(0, 1, 3, 2)
        double = mixed + mixed.transpose(0, 1, 3, 2) + change @ change.transpose(0, 1, 3, 2)
        strain_epv = np.stack([0.5 * double[..., 0, 0], 0.5 * double[..., 1, 1], double[..., 0, 1]], axis=-1)
        s = (self._D_epvw[part] @ strain_epv[..., None])[..., 0]
        stress = np.stack([s[..., 0], s[..., 2], s[..., 2], s[..., 1]], axis=-1)
        return still + change, stress.reshape(*s.shape[:2], 2, 2)
