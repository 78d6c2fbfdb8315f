import numpy as np
import pytest

from reference_walls import stiffness_matrix, symmetric_base
from scleraforce.mechanics.loads import InnerSurface, pressure_load
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.mechanics.supports import clamped_base

R, T = 12e-3, 1e-3
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def surface(kind: str = "27 nodes") -> tuple[HexMesh, InnerSurface]:
    mesh = build_mesh(R, T, divisions=4, level=0, **KINDS[kind])
    return mesh, InnerSurface(mesh)


def noise(mesh: HexMesh, seed: int, held: np.ndarray | None = None) -> np.ndarray:
    moves = np.random.default_rng(seed).normal(size=mesh.points_nc.shape) * 0.2 * T
    return moves if held is None else np.where(held, 0.0, moves)


def test_the_pressure_on_the_undeformed_wall_is_the_dead_load() -> None:
    mesh, inner = surface()
    dead = pressure_load(mesh)
    np.testing.assert_allclose(inner.forces(np.zeros_like(dead)), dead, atol=1e-14 * np.abs(dead).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_tangent_is_the_derivative_where_the_edge_is_held_or_stays_in_its_plane(kind: str, support) -> None:
    """The forces are quadratic in the positions, so the central difference is exact."""
    mesh, inner = surface(kind)
    held = support(mesh)
    held[mesh.base_nodes, 2] = True
    u, direction = noise(mesh, 0, held), noise(mesh, 1, held)
    nodes = mesh.cells_en.shape[1]
    elements = np.zeros((len(mesh.cells_en), 3, nodes, 3, nodes))
    inner.add_tangent(elements, u, 2.5)
    np.testing.assert_array_equal(elements, elements.transpose(0, 3, 4, 1, 2))
    slope = (stiffness_matrix(mesh, elements) @ direction.ravel()).reshape(-1, 3)
    difference = 2.5 * (inner.forces(u + direction) - inner.forces(u - direction)) / 2
    np.testing.assert_allclose(slope[~held], difference[~held], atol=1e-13 * np.abs(slope).max())
    loose = noise(mesh, 2)  # a free edge would break it
    difference = 2.5 * (inner.forces(u + loose) - inner.forces(u - loose)) / 2
    slope = (stiffness_matrix(mesh, elements) @ loose.ravel()).reshape(-1, 3)
    assert np.abs(slope - difference).max() > 1e-3 * np.abs(slope).max()


@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_forces_are_the_derivative_of_the_volume(support) -> None:
    mesh, inner = surface()
    held = support(mesh)
    u, direction = noise(mesh, 3, held), 1e-3 * noise(mesh, 4, held)
    change = (inner.volume(u + direction) - inner.volume(u - direction)) / 2
    assert change == pytest.approx(np.sum(inner.forces(u) * direction), rel=1e-6)


def test_the_volume_is_that_of_the_half_sphere_and_scales_with_its_cube() -> None:
    mesh, inner = surface()
    volume = inner.volume(np.zeros_like(mesh.points_nc))
    assert volume == pytest.approx(2 * np.pi / 3 * (R - T) ** 3, rel=2e-4)
    assert inner.volume(0.1 * mesh.points_nc) == pytest.approx(1.1**3 * volume, rel=1e-13)
