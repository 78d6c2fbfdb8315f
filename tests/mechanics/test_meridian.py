"""The compiled loops of a solid of revolution: derivatives of the energy; not finite where the wall is inverted."""

from collections.abc import Callable

import numpy as np
import pytest
from energy import NU, STEP, energy, stress
from numpy.typing import NDArray

from scleraforce.arrays import Floats
from scleraforce.mechanics import meridian
from scleraforce.mechanics.material import LARGEST_EXPONENT, lame_constants, strain_measure
from scleraforce.mechanics.meridian import ElementTables, MeridianMesh, MeridianSize, meridian_mesh

RADIUS, B = 12e-3, 12.0
ENTRIES = [0, 0, 1, 1, 2], [0, 1, 0, 1, 2]  # of F that are not zero


@pytest.fixture(scope="module")
def mesh() -> MeridianMesh:
    return meridian_mesh(RADIUS, 1e-3, 0.35e-3, 0.5 * np.pi, MeridianSize(8, 2))


def gradient_operator(solid: ElementTables) -> Floats:
    """G (element, point, 5, 18) with dF = G du, F in the order rr, rz, zr, zz, tt."""
    r, z, around = np.moveaxis(solid.shapes_epgn, 2, 0)
    G = np.zeros((*r.shape[:2], 5, 9, 2))
    G[:, :, 0, :, 0], G[:, :, 1, :, 0], G[:, :, 2, :, 1], G[:, :, 3, :, 1], G[:, :, 4, :, 0] = r, z, r, z, around
    return G.reshape(*r.shape[:2], 5, 18)


def deformation(solid: ElementTables, u: NDArray) -> NDArray:
    """F (element, point, 3, 3)."""
    F = np.zeros((*solid.mu_ep.shape, 3, 3), dtype=u.dtype)
    F[(..., *ENTRIES)] = np.einsum("epkN,eN->epk", gradient_operator(solid), u[solid.unknowns_en])
    return F + np.eye(3)


def bent(mesh: MeridianMesh) -> Floats:
    """Strains of some 15 % with rotation and noise on them, none of them across the axis."""
    r, z = mesh.points_nc.T
    noise = np.random.default_rng(1).normal(size=mesh.points_nc.shape) * 5e-6
    return np.stack(
        [0.12 * r + 0.1 * r * z / RADIUS + noise[:, 0] * (r > 0.0), 0.2 * r - 0.08 * z + noise[:, 1]], axis=1
    ).ravel()


def test_forces_and_tangent_are_the_derivatives_of_the_energy(mesh: MeridianMesh) -> None:
    u, solid = bent(mesh), meridian.solid_of_revolution(mesh, NU, B)
    volumes_ep, moved = solid.mu_ep / lame_constants(1.0, NU)[1], np.random.default_rng(3).normal(size=u.shape)
    F = deformation(solid, u + 1j * STEP * moved)
    assert np.all(np.linalg.det(F.real) > 0.1)
    assert meridian.nodal_forces(solid, u) @ moved == pytest.approx(
        np.sum(volumes_ep * energy(F, B).imag) / STEP, rel=1e-11
    )
    P = stress(F, B).imag[(..., *ENTRIES)] / STEP
    change_eN = np.einsum("ep,epk,epkN->eN", volumes_ep, P, gradient_operator(solid))
    tangents = meridian.element_tangents(solid, u)
    slope_eN = np.einsum("eMN,eN->eM", tangents, moved[solid.unknowns_en])
    np.testing.assert_allclose(slope_eN, change_eN, rtol=0.0, atol=1e-12 * np.abs(change_eN).max())
    np.testing.assert_array_equal(tangents, tangents.transpose(0, 2, 1))


def test_a_vanishing_stiffening_is_the_neo_hookean_solid(mesh: MeridianMesh) -> None:
    u, (flat, faint) = bent(mesh), (meridian.solid_of_revolution(mesh, NU, b) for b in (0.0, 1e-300))
    np.testing.assert_allclose(meridian.nodal_forces(faint, u), meridian.nodal_forces(flat, u), rtol=1e-12)
    tangents = meridian.element_tangents(flat, u)
    np.testing.assert_allclose(meridian.element_tangents(faint, u), tangents, atol=1e-13 * np.abs(tangents).max())


def turned_over(mesh: MeridianMesh) -> Floats:
    """A node pushed through the inner boundary."""
    u_nc = np.zeros((len(mesh.points_nc), 2))
    u_nc[mesh.outer_n[4], 1] = -2e-3
    return u_nc.ravel()


def across_the_axis(mesh: MeridianMesh) -> Floats:
    """All moved sideways: on its meridian the wall is unchanged, and near the axis it is on the other side."""
    return np.tile([-1e-3, 0.0], len(mesh.points_nc))


def mirrored(mesh: MeridianMesh) -> Floats:
    """Its middle mirrored in the axis: two signs change there, and the product of the stretches is unchanged."""
    away_n = mesh.points_nc[:, 0]
    return np.stack([np.where(away_n < 3e-3, -2.0 * away_n, 0.0), np.zeros_like(away_n)], axis=1).ravel()


@pytest.mark.parametrize("displaced", [turned_over, across_the_axis, mirrored])
def test_elements_that_are_turned_inside_out_and_no_others_are_not_finite(
    mesh: MeridianMesh, displaced: Callable[[MeridianMesh], Floats]
) -> None:
    solid, u = meridian.solid_of_revolution(mesh, NU), displaced(mesh)
    F = deformation(solid, u)
    inverted_e = np.any((np.linalg.det(F[..., :2, :2]) <= 0.0) | (F[..., 2, 2] <= 0.0), axis=1)
    assert 0 < np.count_nonzero(inverted_e) < len(inverted_e)
    np.testing.assert_array_equal(np.isnan(meridian.element_tangents(solid, u)).all(axis=(1, 2)), inverted_e)
    expected = np.isin(np.arange(len(u)), solid.unknowns_en[inverted_e])
    np.testing.assert_array_equal(np.isnan(meridian.nodal_forces(solid, u)), expected)


@pytest.mark.parametrize(("share", "finite"), [(0.99, True), (1.01, False), (20.0, False)])  # of the largest exponent
def test_tissue_that_is_stretched_too_far_is_not_finite(mesh: MeridianMesh, share: float, finite: bool) -> None:
    stretched, log_ratio = 0.5 * mesh.points_nc.ravel(), 3.0 * np.log(1.5)  # by a half in every direction
    strain = strain_measure(np.array(3.0 * 1.5**2 - 3.0), np.array(log_ratio), NU)
    solid = meridian.solid_of_revolution(mesh, NU, share * LARGEST_EXPONENT / float(strain))
    for values in (meridian.nodal_forces(solid, stretched), meridian.element_tangents(solid, stretched)):
        assert np.isfinite(values).all() if finite else np.isnan(values).all()
