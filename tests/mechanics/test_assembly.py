from dataclasses import replace

import numpy as np
import pytest
import skfem
from scikit_fem import scikit_fem_basis
from skfem.models.elasticity import linear_elasticity

from reference_walls import stiffness_matrix
from scleraforce.errors import SolverError
from scleraforce.mechanics.elements import element_stiffness, volume_points
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.mesh import HexMesh, build_mesh

R, T, NU = 12e-3, 1e-3, 0.45
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def small_mesh(kind: str, layers: int = 2) -> HexMesh:
    return build_mesh(R, T, divisions=4, level=0, layers=layers, **KINDS[kind])


def distorted(mesh: HexMesh) -> HexMesh:
    """Every node, mid-edge and middle ones too, moved at random by up to a tenth of the element's thickness."""
    moves = np.random.default_rng(0).uniform(-0.05, 0.05, mesh.points_nc.shape) * T
    return replace(mesh, points_nc=mesh.points_nc + moves)


def stiffness(mesh: HexMesh):
    return stiffness_matrix(mesh, element_stiffness(volume_points(mesh), *lame_constants(1.0, NU)))


def boundary_nodes(mesh: HexMesh) -> np.ndarray:
    return np.unique(np.concatenate([mesh.outer_qn.ravel(), mesh.inner_qn.ravel(), mesh.base_nodes]))


@pytest.mark.parametrize("kind", KINDS)
def test_patch_test_a_linear_displacement_is_in_equilibrium_and_has_the_exact_energy(kind: str) -> None:
    mesh = distorted(small_mesh(kind))
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    u = (mesh.points_nc @ gradient.T).ravel()
    K = stiffness(mesh)
    forces = (K @ u).reshape(-1, 3)
    inside = np.setdiff1d(np.arange(len(mesh.points_nc)), boundary_nodes(mesh))
    assert len(inside) > 40
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()
    lam, mu = lame_constants(1.0, NU)
    strain = 0.5 * (gradient + gradient.T)
    stress = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    assert u @ K @ u == pytest.approx(np.sum(stress * strain) * volume_points(mesh).volumes_ep.sum(), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_six_rigid_motions_cost_no_energy(kind: str) -> None:
    """Full integration: no hourglass modes. Reduced integration of the 27-node element would give some."""
    mesh = small_mesh(kind, layers=1)
    element = element_stiffness(volume_points(mesh), *lame_constants(1.0, NU))[0]
    size = 3 * mesh.cells_en.shape[1]
    energies = np.linalg.eigvalsh(element.reshape(size, size))
    assert np.abs(energies[:6]).max() < 1e-12 * energies[-1]
    assert energies[6] > 1e-6 * energies[-1]


@pytest.mark.parametrize(
    ("kind", "element", "mesh_type"),
    [("8 nodes", skfem.ElementHex1, skfem.MeshHex1), ("27 nodes", skfem.ElementHex2, skfem.MeshHex2)],
)
def test_the_matrix_is_that_of_scikit_fem(kind: str, element: type, mesh_type: type) -> None:
    mesh = distorted(small_mesh(kind, layers=1))
    basis, unknowns = scikit_fem_basis(mesh, element, mesh_type)
    theirs = linear_elasticity(*lame_constants(1.0, NU)).assemble(basis)
    assert len(np.unique(unknowns)) == len(unknowns) == 3 * len(mesh.points_nc)
    difference = stiffness(mesh)[unknowns][:, unknowns] - theirs
    assert abs(difference).max() < 1e-12 * abs(theirs).max()


def test_lame_constants_give_back_the_uniaxial_test() -> None:
    E, nu = 0.25e6, 0.45
    lam, mu = lame_constants(E, nu)
    strain = np.diag([1.0, -nu, -nu])
    stress = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    np.testing.assert_allclose(stress, np.diag([E, 0.0, 0.0]), atol=1e-9 * E)


def test_an_element_turned_inside_out_is_refused() -> None:
    mesh = small_mesh("8 nodes")
    with pytest.raises(SolverError, match="negative volume"):
        volume_points(replace(mesh, points_nc=-mesh.points_nc))
