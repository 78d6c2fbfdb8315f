"""A solid of revolution by arrays: stress from the deformation gradient, tangents as its derivative (complex step)."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.mechanics.material import LARGEST_EXPONENT
from scleraforce.mechanics.meridian import MeridianMesh, SolidOfRevolution

Floats = NDArray[np.float64]

STEP = 1e-30


def gradient_operator(solid: SolidOfRevolution) -> Floats:
    """G (element, point, 5, 18) with dF = G du, F in the order rr, rz, zr, zz, tt."""
    r, z, around = np.moveaxis(solid.tables.shapes_epgn, 2, 0)
    G = np.zeros((*r.shape[:2], 5, 9, 2))
    G[:, :, 0, :, 0], G[:, :, 1, :, 0], G[:, :, 2, :, 1], G[:, :, 3, :, 1], G[:, :, 4, :, 0] = r, z, r, z, around
    return G.reshape(*r.shape[:2], 5, 18)


def forces_and_tangents(mesh: MeridianMesh, solid: SolidOfRevolution, u: Floats) -> tuple[Floats, Floats]:
    """Nodal forces (all unknowns,) and the derivative of every element's forces (element, 18, 18)."""
    u_eN = u[solid.unknowns_eN]
    local_eN = _local_forces(solid, u_eN.astype(complex)).real
    tangents = np.empty((*u_eN.shape, 18))
    for number in range(18):
        moved = u_eN.astype(complex)
        moved[:, number] += 1j * STEP
        tangents[..., number] = _local_forces(solid, moved).imag / STEP
    return np.bincount(solid.unknowns_eN.ravel(), local_eN.ravel(), minlength=mesh.points_nc.size), tangents


def _local_forces(solid: SolidOfRevolution, u_eN: NDArray[np.complex128]) -> NDArray[np.complex128]:
    tables, G = solid.tables, gradient_operator(solid)
    F = np.einsum("epkN,eN->kep", G, u_eN) + np.array([1.0, 0.0, 0.0, 1.0, 1.0])[:, None, None]
    rr, rz, zr, zz, tt = F
    plane = rr * zz - rz * zr
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.where((plane.real > 0.0) & (tt.real > 0.0), np.log(plane * tt), np.nan)
        H = np.stack([zz / plane, -zr / plane, -rz / plane, rr / plane, 1.0 / tt])
    P = tables.mu_ep * F + (tables.lambda_ep * log_ratio - tables.mu_ep) * H
    strain = (F**2).sum(axis=0) - 3.0 - 2.0 * log_ratio + tables.lame_ratio * log_ratio**2
    exponent = tables.stiffening * strain
    with np.errstate(over="ignore", invalid="ignore"):
        P = P * np.where(exponent.real <= LARGEST_EXPONENT, np.exp(exponent), np.nan)
        return np.einsum("kep,epkN->eN", P, G)
