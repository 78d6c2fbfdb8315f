import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.mechanics import locate as locate_module
from scleraforce.mechanics.mesh import HexMesh, build_mesh
from scleraforce.mechanics.shapes import shape_values

R, T = 12e-3, 0.5e-3
KINDS = {"4 nodes": {"order": 1}, "9 nodes": {"order": 2}}


def directions(count: int, seed: int = 0) -> np.ndarray:
    normal = np.random.default_rng(seed).normal(size=(count, 3))
    normal[:, 2] = np.abs(normal[:, 2])
    return normal  # of any length: locate normalises


def pierced(mesh: HexMesh, quads_qn: np.ndarray, quads: np.ndarray, local: np.ndarray) -> np.ndarray:
    return np.einsum("pn,pnc->pc", shape_values(local, quads_qn.shape[1]), mesh.points_nc[quads_qn[quads]])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("grid", [{"divisions": 2, "level": 0}, {"divisions": 10, "level": 1}])
def test_the_point_found_lies_on_the_ray_inside_its_quad(kind: str, grid: dict) -> None:
    mesh = build_mesh(R, T, **grid, **KINDS[kind])
    rays = directions(20_000)
    quads, local = mesh.locator.locate(rays)
    assert np.abs(local).max() <= 1.0
    for surface_qn in (mesh.outer_qn, mesh.inner_qn):  # local coordinates found on the outer surface serve the inner
        points = pierced(mesh, surface_qn, quads, local)
        assert np.all(np.sum(points * rays, axis=1) > 0)
        off_ray = np.linalg.norm(np.cross(points, rays), axis=1) / np.linalg.norm(rays, axis=1)
        assert off_ray.max() < 1e-13 * R


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_are_found_at_themselves(kind: str) -> None:
    """Nodes lie on edges and corners, where quads meet, at the base and at the cube's corners of valence 3."""
    mesh = build_mesh(R, T, divisions=6, level=1, **KINDS[kind])
    nodes = np.unique(mesh.outer_qn)
    quads, local = mesh.locator.locate(mesh.points_nc[nodes])
    points = pierced(mesh, mesh.outer_qn, quads, local)
    np.testing.assert_allclose(points, mesh.points_nc[nodes], atol=1e-13 * R)


def test_a_direction_that_rounding_put_below_the_base_is_found_at_the_base() -> None:
    mesh = build_mesh(R, T)
    azimuth = np.linspace(-np.pi, np.pi, 997)
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), np.full_like(azimuth, -5e-10)], axis=1)
    quads, local = mesh.locator.locate(rays)
    np.testing.assert_allclose(pierced(mesh, mesh.outer_qn, quads, local) / R, rays, atol=2e-5)


def test_the_quad_is_the_one_that_a_search_over_all_quads_finds() -> None:
    mesh = build_mesh(R, T, divisions=4, level=1, order=1)
    rays = directions(300, seed=1)
    corners = mesh.points_nc[mesh.outer_qn]
    # Inside the spherical polygon: on the inner side of the plane through the centre and each edge.
    planes = np.cross(corners, np.roll(corners, -1, axis=1))
    inside = np.all(np.einsum("qec,dc->dqe", planes, rays) >= 0, axis=2)
    assert np.all(inside.sum(axis=1) == 1)
    np.testing.assert_array_equal(mesh.locator.locate(rays)[0], np.argmax(inside, axis=1))


def test_answers_do_not_depend_on_what_else_is_asked_for() -> None:
    mesh = build_mesh(R, T)
    rays = directions(40_000)
    quads, local = mesh.locator.locate(rays)
    for pick in (slice(0, 1), slice(16_380, 16_390), slice(39_999, None)):
        alone = mesh.locator.locate(rays[pick])
        np.testing.assert_array_equal(alone[0], quads[pick])
        np.testing.assert_allclose(alone[1], local[pick], atol=1e-13)
    assert mesh.locator.locate(rays[:0])[0].shape == (0,)


@pytest.mark.parametrize("ray", [[0.0, 0.0, -1.0], [1.0, 0.0, -1e-6], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]])
def test_a_direction_that_misses_the_half_sphere_is_an_input_error(ray: list[float]) -> None:
    mesh = build_mesh(R, T, divisions=2, level=0)
    with pytest.raises(InputError, match="direction"):
        mesh.locator.locate(np.array([[0.0, 0.0, 1.0], ray]))


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_loops_find_the_same_to_the_last_bit(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few directions and many give the same recordings and data sets."""
    rays = directions(20_000)
    rays[:50, 2] = 0.0
    found = []
    for many in (10**9, 1):
        monkeypatch.setattr(locate_module, "MANY", many)
        found.append(build_mesh(R, T, divisions=4, level=1, **KINDS[kind]).locator.locate(rays))
    (quads, local), (quads_compiled, local_compiled) = found
    np.testing.assert_array_equal(quads_compiled, quads)
    np.testing.assert_array_equal(local_compiled, local)
