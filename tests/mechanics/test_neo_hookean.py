"""Hooke's and the neo-Hookean solid, and tissue that stiffens, on hexahedra."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from energy import LAMBDA, MU, NU, STEP, energy, stress
from numpy.typing import NDArray
from scikit_fem import scikit_fem_basis
from skfem.helpers import ddot, grad, identity, inv, transpose

from reference_walls import stiffness_matrix
from scleraforce.errors import SolverError
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.material import strain_measure
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.mechanics.neo_hookean import NeoHookeanSolid

R, T, B = 12e-3, 1e-3, 12.0
ORDERS = (1, 2)


def distorted(order: int = 2, **size: int) -> HexMesh:
    """A coarse mesh whose nodes are moved at random, so that no symmetry hides an error."""
    mesh = build_mesh(R, T, **({"divisions": 4, "level": 0, "order": order} | size))
    moves = np.random.default_rng(0).uniform(-0.05, 0.05, mesh.points_nc.shape) * T
    return replace(mesh, points_nc=mesh.points_nc + moves)


def large_displacement(mesh: HexMesh) -> np.ndarray:
    """A smooth field with strains of some 20 % and rotations, and noise on every node."""
    random = np.random.default_rng(1)
    linear, quadratic = random.normal(size=(3, 3)) * 0.15, random.normal(size=(3, 3, 3)) * 0.08 / R
    x = mesh.points_nc
    return x @ linear + np.einsum("ijk,nj,nk->ni", quadratic, x, x) + random.normal(size=x.shape) * 0.01 * T


def random_factor(mesh: HexMesh) -> np.ndarray:
    return np.random.default_rng(2).uniform(0.6, 1.4, volume_points(mesh).volumes_ep.shape)


@pytest.mark.parametrize("order", ORDERS)
def test_patch_test_a_linear_displacement_is_in_equilibrium_and_has_the_exact_energy(order: int) -> None:
    mesh = distorted(order, layers=2)
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    u = (mesh.points_nc @ gradient.T).ravel()
    points = volume_points(mesh)
    K = stiffness_matrix(mesh, element_stiffness(points, LAMBDA, MU))
    forces = (K @ u).reshape(-1, 3)
    boundary = np.concatenate([mesh.outer_qn.ravel(), mesh.inner_qn.ravel(), mesh.base_nodes])
    inside = np.setdiff1d(np.arange(len(mesh.points_nc)), boundary)
    assert len(inside) > 40
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()
    strain = 0.5 * (gradient + gradient.T)
    hooke = LAMBDA * np.trace(strain) * np.eye(3) + 2 * MU * strain
    assert u @ K @ u == pytest.approx(np.sum(hooke * strain) * points.volumes_ep.sum(), rel=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_only_the_six_rigid_motions_cost_no_energy(order: int) -> None:
    """Full integration: no hourglass modes. Reduced integration of the 27-node element would give some."""
    mesh = build_mesh(R, T, divisions=4, level=0, order=order)
    element = element_stiffness(volume_points(mesh), LAMBDA, MU)[0]
    energies = np.linalg.eigvalsh(element.reshape(2 * (3 * mesh.cells_en.shape[1],)))
    assert np.abs(energies[:6]).max() < 1e-12 * energies[-1]
    assert energies[6] > 1e-6 * energies[-1]


def test_lame_constants_give_back_the_uniaxial_test() -> None:
    strain = np.diag([1.0, -NU, -NU])
    hooke = LAMBDA * np.trace(strain) * np.eye(3) + 2 * MU * strain
    np.testing.assert_allclose(hooke, np.diag([1.0, 0.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_small_strains_follow_hookes_law_and_a_rigid_rotation_costs_no_force(order: int) -> None:
    mesh = distorted(order)
    factor, points = random_factor(mesh), volume_points(mesh)
    solid, large = NeoHookeanSolid(mesh, NU, factor), large_displacement(mesh)
    scaled = replace(points, volumes_ep=points.volumes_ep * factor)
    K = stiffness_matrix(mesh, element_stiffness(scaled, LAMBDA, MU))
    assert abs(stiffness_matrix(mesh, solid.tangents(0.0 * large)) - K).max() < 1e-14 * abs(K).max()
    u = 1e-7 * large
    np.testing.assert_allclose(solid.forces(u).ravel(), K @ u.ravel(), atol=1e-5 * abs(K @ u.ravel()).max())
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    forces = solid.forces(mesh.points_nc @ rotation.T - mesh.points_nc + 0.3 * R)
    assert np.abs(forces).max() < 1e-12 * np.abs(solid.forces(large)).max()


@pytest.mark.parametrize("order", ORDERS)
def test_forces_and_tangent_are_the_derivatives_of_the_energy_at_any_deformation(order: int) -> None:
    mesh = distorted(order)
    points, factor_ep = volume_points(mesh), random_factor(mesh)
    u_nc, moved_nc = large_displacement(mesh), np.random.default_rng(3).normal(size=mesh.points_nc.shape)

    def gradient(field_nc: NDArray) -> NDArray:
        return np.einsum("eni,epnj->epij", field_nc[mesh.cells_en], points.gradients_epnc)

    F = np.eye(3) + gradient(u_nc) + 1j * STEP * gradient(moved_nc)
    volumes_ep = factor_ep * points.volumes_ep
    solid = NeoHookeanSolid(mesh, NU, factor_ep, stiffening=B)
    forces_nc = solid.forces(u_nc)
    assert np.sum(forces_nc * moved_nc) == pytest.approx(np.sum(volumes_ep * energy(F, B).imag) / STEP, rel=1e-11)

    local_eni = np.einsum("ep,epij,epnj->eni", volumes_ep, stress(F, B).imag / STEP, points.gradients_epnc)
    change_nc = np.zeros_like(forces_nc)
    np.add.at(change_nc, mesh.cells_en, local_eni)
    K = stiffness_matrix(mesh, solid.tangents(u_nc))
    slope_nc = (K @ moved_nc.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(slope_nc, change_nc, rtol=0.0, atol=1e-12 * np.abs(change_nc).max())
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()


def test_a_vanishing_stiffening_is_the_neo_hookean_solid_and_the_first_order_is_that_of_the_law() -> None:
    mesh = distorted()
    u_nc = large_displacement(mesh)
    soft, tiny, small, double = (NeoHookeanSolid(mesh, NU, stiffening=b) for b in (0.0, 1e-300, 1e-6, 2e-6))
    np.testing.assert_allclose(tiny.forces(u_nc), soft.forces(u_nc), rtol=1e-14)
    tangents = soft.tangents(u_nc)
    np.testing.assert_allclose(tiny.tangents(u_nc), tangents, atol=1e-14 * np.abs(tangents).max())
    once, twice = (solid.forces(u_nc) - soft.forces(u_nc) for solid in (small, double))
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-5 * np.abs(once).max())


def test_the_strain_measure_is_twice_the_energy_over_mu() -> None:
    F = np.eye(3) + 0.2 * np.random.default_rng(4).normal(size=(5, 3, 3))
    J = np.linalg.det(F)
    neo = MU / 2.0 * (np.sum(F**2, axis=(1, 2)) - 3.0) - MU * np.log(J) + LAMBDA / 2.0 * np.log(J) ** 2
    np.testing.assert_allclose(strain_measure(np.sum(F**2, axis=(1, 2)) - 3.0, np.log(J), NU), 2.0 * neo / MU)


@pytest.mark.parametrize(
    ("order", "element", "mesh_type"),
    [
        (1, skfem.ElementHex1, skfem.MeshHex1),
        pytest.param(2, skfem.ElementHex2, skfem.MeshHex2, marks=pytest.mark.slow),
    ],
)
def test_forces_and_tangent_agree_with_scikit_fem(order: int, element: type, mesh_type: type) -> None:
    mesh = distorted(order)
    basis, ours_of_theirs = scikit_fem_basis(mesh, element, mesh_type)
    u = large_displacement(mesh)
    theirs = np.empty(u.size)
    theirs[:] = u.ravel()[ours_of_theirs]
    residual, matrix = scikit_fem_assembly(basis, theirs)
    solid = NeoHookeanSolid(mesh, NU)
    forces, K = solid.forces(u).ravel(), stiffness_matrix(mesh, solid.tangents(u))
    np.testing.assert_allclose(residual, forces[ours_of_theirs], atol=1e-12 * np.abs(forces).max())
    assert abs(K[ours_of_theirs][:, ours_of_theirs] - matrix).max() < 1e-12 * abs(K).max()


def scikit_fem_assembly(basis: skfem.CellBasis, u: np.ndarray):
    """Residual and tangent of the same energy in scikit-fem's weak forms."""

    def kinematics(w):
        F = grad(w["u"]) + identity(grad(w["u"]))
        return F, inv(F), np.log(np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1))))

    @skfem.LinearForm
    def residual(v, w):
        F, F_inverse, log_J = kinematics(w)
        return ddot(MU * F + (LAMBDA * log_J - MU) * transpose(F_inverse), grad(v))

    @skfem.BilinearForm
    def stiffness(du, v, w):
        _, F_inverse, log_J = kinematics(w)
        H = np.einsum("ij...,jk...->ik...", grad(du), F_inverse)
        G = np.einsum("ij...,jk...->ik...", grad(v), F_inverse)
        volumetric = np.einsum("ii...", H) * np.einsum("ii...", G)
        return MU * ddot(grad(du), grad(v)) + (MU - LAMBDA * log_J) * ddot(transpose(H), G) + LAMBDA * volumetric

    field = basis.interpolate(u)
    return residual.assemble(basis, u=field), stiffness.assemble(basis, u=field)


def test_a_wall_turned_inside_out_has_no_forces_and_no_tangent() -> None:
    mesh = distorted()
    solid, inverted = NeoHookeanSolid(mesh, NU), -1.5 * mesh.points_nc
    assert np.all(np.isnan(solid.forces(inverted)))
    with pytest.raises(SolverError, match="inside out"):
        solid.tangents(inverted)
    with pytest.raises(SolverError, match="negative volume"):
        volume_points(replace(mesh, points_nc=-mesh.points_nc))
    stiff = NeoHookeanSolid(distorted(1), NU, stiffening=200.0)
    assert np.all(np.isfinite(stiff.forces(0.1 * distorted(1).points_nc)))
    assert np.any(np.isnan(stiff.forces(9.0 * distorted(1).points_nc)))


def test_tangents_in_single_precision_are_exact_to_its_rounding() -> None:
    mesh = distorted()
    solid, u = NeoHookeanSolid(mesh, NU, random_factor(mesh), stiffening=2.0), large_displacement(mesh)
    exact, single = solid.tangents(u), solid.tangents(u, np.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, exact, atol=3e-6 * np.abs(exact).max())
