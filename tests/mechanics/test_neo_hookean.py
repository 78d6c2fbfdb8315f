from dataclasses import replace

import numpy as np
import pytest
import skfem
from scikit_fem import scikit_fem_basis
from skfem.helpers import ddot, grad, identity, inv, transpose

from reference_walls import stiffness_matrix
from scleraforce.errors import SolverError
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.mechanics.neo_hookean import NeoHookeanSolid

R, T, NU = 12e-3, 1e-3, 0.45
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def small_mesh(kind: str = "27 nodes") -> HexMesh:
    """A coarse mesh whose nodes are moved at random, so that no symmetry hides an error."""
    mesh = build_mesh(R, T, divisions=4, level=0, **KINDS[kind])
    moves = np.random.default_rng(0).uniform(-0.05, 0.05, mesh.points_nc.shape) * T
    return replace(mesh, points_nc=mesh.points_nc + moves)


def large_displacement(mesh: HexMesh, seed: int = 1) -> np.ndarray:
    """A smooth field with strains of some 20 % and rotations, and noise on every node."""
    random = np.random.default_rng(seed)
    linear, quadratic = random.normal(size=(3, 3)) * 0.15, random.normal(size=(3, 3, 3)) * 0.08 / R
    x = mesh.points_nc
    noise = random.normal(size=x.shape) * 0.01 * T
    return x @ linear + np.einsum("ijk,nj,nk->ni", quadratic, x, x) + noise


def random_factor(mesh: HexMesh) -> np.ndarray:
    return np.random.default_rng(2).uniform(0.6, 1.4, volume_points(mesh).volumes_ep.shape)


def tangent(mesh: HexMesh, solid: NeoHookeanSolid, u: np.ndarray):
    return stiffness_matrix(mesh, solid.tangents(u))


@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_is_the_derivative_of_the_forces_to_second_order(kind: str) -> None:
    mesh = small_mesh(kind)
    solid, u = NeoHookeanSolid(mesh, NU, random_factor(mesh)), large_displacement(mesh)
    direction = np.random.default_rng(3).normal(size=u.shape) * 0.01 * T
    forces, slope = solid.forces(u), (tangent(mesh, solid, u) @ direction.ravel()).reshape(-1, 3)
    errors = [np.linalg.norm(solid.forces(u + h * direction) - forces - h * slope) for h in (0.4, 0.2, 0.1, 0.05)]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_rigid_rotation_costs_no_force(kind: str) -> None:
    mesh = small_mesh(kind)
    rotation = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    forces = NeoHookeanSolid(mesh, NU).forces(mesh.points_nc @ rotation.T - mesh.points_nc + 0.3 * R)
    typical = np.abs(NeoHookeanSolid(mesh, NU).forces(large_displacement(mesh))).max()
    assert np.abs(forces).max() < 1e-12 * typical


@pytest.mark.parametrize("kind", KINDS)
def test_small_strains_follow_hookes_law(kind: str) -> None:
    mesh = small_mesh(kind)
    factor = random_factor(mesh)
    solid = NeoHookeanSolid(mesh, NU, factor)
    points = volume_points(mesh)
    scaled = replace(points, volumes_ep=points.volumes_ep * factor)
    K = stiffness_matrix(mesh, element_stiffness(scaled, *lame_constants(1.0, NU)))
    difference = tangent(mesh, solid, np.zeros_like(mesh.points_nc)) - K
    assert abs(difference).max() < 1e-14 * abs(K).max()
    u = 1e-7 * large_displacement(mesh)
    np.testing.assert_allclose(solid.forces(u).ravel(), K @ u.ravel(), atol=1e-5 * abs(K @ u.ravel()).max())


@pytest.mark.parametrize(
    ("kind", "element", "mesh_type"),
    [
        ("8 nodes", skfem.ElementHex1, skfem.MeshHex1),
        pytest.param("27 nodes", skfem.ElementHex2, skfem.MeshHex2, marks=pytest.mark.slow),
    ],
)
def test_forces_and_tangent_are_those_of_scikit_fem(kind: str, element: type, mesh_type: type) -> None:
    mesh = small_mesh(kind)
    basis, ours_of_theirs = scikit_fem_basis(mesh, element, mesh_type)
    u = large_displacement(mesh).ravel()
    theirs = np.empty(len(u))
    theirs[:] = u[ours_of_theirs]
    residual, matrix = scikit_fem_assembly(basis, theirs)
    solid = NeoHookeanSolid(mesh, NU)
    forces, K = solid.forces(u.reshape(-1, 3)).ravel(), tangent(mesh, solid, u.reshape(-1, 3))
    np.testing.assert_allclose(residual, forces[ours_of_theirs], atol=1e-12 * np.abs(forces).max())
    assert abs(K[ours_of_theirs][:, ours_of_theirs] - matrix).max() < 1e-12 * abs(K).max()


def scikit_fem_assembly(basis: skfem.CellBasis, u: np.ndarray):
    """Residual and tangent of the same energy in scikit-fem's weak forms."""
    lam, mu = lame_constants(1.0, NU)

    def kinematics(w):
        F = grad(w["u"]) + identity(grad(w["u"]))
        return F, inv(F), np.log(np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1))))

    @skfem.LinearForm
    def residual(v, w):
        F, F_inverse, log_J = kinematics(w)
        return ddot(mu * F + (lam * log_J - mu) * transpose(F_inverse), grad(v))

    @skfem.BilinearForm
    def stiffness(du, v, w):
        _, F_inverse, log_J = kinematics(w)
        H = np.einsum("ij...,jk...->ik...", grad(du), F_inverse)
        G = np.einsum("ij...,jk...->ik...", grad(v), F_inverse)
        volumetric = np.einsum("ii...", H) * np.einsum("ii...", G)
        return mu * ddot(grad(du), grad(v)) + (mu - lam * log_J) * ddot(transpose(H), G) + lam * volumetric

    field = basis.interpolate(u)
    return residual.assemble(basis, u=field), stiffness.assemble(basis, u=field)


def test_a_wall_turned_inside_out_has_no_forces_and_no_tangent() -> None:
    mesh = small_mesh()
    solid, inverted = NeoHookeanSolid(mesh, NU), -1.5 * mesh.points_nc
    assert np.all(np.isnan(solid.forces(inverted)))
    with pytest.raises(SolverError, match="inside out"):
        solid.tangents(inverted)


@pytest.mark.parametrize("stiffening", [0.0, 2.0])
def test_tangents_in_single_precision_are_those_in_double(stiffening: float) -> None:
    mesh = small_mesh()
    solid, u = NeoHookeanSolid(mesh, NU, random_factor(mesh), stiffening=stiffening), large_displacement(mesh)
    exact, single = solid.tangents(u), solid.tangents(u, np.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, exact, atol=3e-6 * np.abs(exact).max())
