import numpy as np
import pytest

from scleraforce.eye.mesh import HexMesh, build_mesh
from scleraforce.mechanics.assembly import BlockPattern, FreePart
from scleraforce.mechanics.loads import pressure_load
from scleraforce.mechanics.pressure import InnerSurface
from scleraforce.mechanics.supports import clamped_base, symmetric_base

R, T = 12e-3, 1e-3
KINDS = {"8 nodes": {"order": 1}, "20 nodes": {"order": 2, "serendipity": True}, "27 nodes": {"order": 2}}


def surface(kind: str = "27 nodes") -> tuple[HexMesh, BlockPattern, InnerSurface]:
    mesh = build_mesh(R, T, divisions=4, level=0, **KINDS[kind])
    pattern = BlockPattern(mesh.cells_en, len(mesh.points_nc))
    return mesh, pattern, InnerSurface(mesh, pattern)


def noise(mesh: HexMesh, seed: int, held: np.ndarray | None = None) -> np.ndarray:
    moves = np.random.default_rng(seed).normal(size=mesh.points_nc.shape) * 0.2 * T
    return moves if held is None else np.where(held, 0.0, moves)


def test_the_pressure_on_the_undeformed_wall_is_the_dead_load() -> None:
    mesh, _, inner = surface()
    dead = pressure_load(mesh)
    np.testing.assert_allclose(inner.forces(np.zeros_like(dead)), dead, atol=1e-14 * np.abs(dead).max())


@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_is_the_derivative_of_the_forces(kind: str) -> None:
    """The forces are quadratic in the positions, so the central difference is exact."""
    mesh, pattern, inner = surface(kind)
    u, direction = noise(mesh, 0), noise(mesh, 1)
    blocks = np.zeros((len(pattern.pairs), 3, 3))
    inner.add_tangent(blocks, u, 2.5)
    slope = (pattern.matrix(blocks) @ direction.ravel()).reshape(-1, 3)
    difference = 2.5 * (inner.forces(u + direction) - inner.forces(u - direction)) / 2
    np.testing.assert_allclose(slope, difference, atol=1e-13 * np.abs(slope).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_tangent_is_symmetric_where_the_edge_is_held_or_stays_in_its_plane(kind: str, support) -> None:
    mesh, pattern, inner = surface(kind)
    held = support(mesh)
    held[mesh.base_nodes, 2] = True
    blocks = np.zeros((len(pattern.pairs), 3, 3))
    inner.add_tangent(blocks, noise(mesh, 2, held), 1.0)
    K = FreePart(pattern, np.flatnonzero(~held.ravel())).matrix(blocks)
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()
    whole = pattern.matrix(blocks)
    assert abs(whole - whole.T).max() > 1e-3 * abs(whole).max()  # a free edge would break it


@pytest.mark.parametrize("support", [clamped_base, symmetric_base])
def test_the_forces_are_the_derivative_of_the_volume(support) -> None:
    mesh, _, inner = surface()
    held = support(mesh)
    u, direction = noise(mesh, 3, held), 1e-3 * noise(mesh, 4, held)
    change = (inner.volume(u + direction) - inner.volume(u - direction)) / 2
    assert change == pytest.approx(np.sum(inner.forces(u) * direction), rel=1e-6)


def test_the_volume_is_that_of_the_half_sphere_and_scales_with_its_cube() -> None:
    mesh, _, inner = surface()
    volume = inner.volume(np.zeros_like(mesh.points_nc))
    assert volume == pytest.approx(2 * np.pi / 3 * (R - T) ** 3, rel=2e-4)
    assert inner.volume(0.1 * mesh.points_nc) == pytest.approx(1.1**3 * volume, rel=1e-13)
