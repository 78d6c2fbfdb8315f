from itertools import product

import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.mechanics.elements import volume_points
from scleraforce.mechanics.mesh import QuadSurface, build_mesh, catmull_clark, half_cube, project_on_sphere
from scleraforce.mechanics.shapes import node_positions, shape_values

R = 12e-3
HEX_FACES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]  # outward
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def exact_volume(thickness_m: float) -> float:
    return 2.0 / 3.0 * np.pi * (R**3 - (R - thickness_m) ** 3)


@pytest.mark.parametrize("thickness_m", [0.3e-3, 0.75e-3, 1.2e-3])
@pytest.mark.parametrize("kind", KINDS)
def test_every_element_is_positive_and_their_volume_is_that_of_the_shell(kind: str, thickness_m: float) -> None:
    mesh = build_mesh(R, thickness_m, divisions=10, level=1, layers=2, **KINDS[kind])
    volumes = volume_points(mesh).volumes_ep  # raises where a Jacobian is not positive
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(exact_volume(thickness_m), rel=4e-3 if mesh.order == 1 else 2e-6)


def test_the_volume_of_curved_elements_converges_with_fourth_order() -> None:
    errors = [
        abs(volume_points(build_mesh(R, 1e-3, divisions=n, level=0)).volumes_ep.sum() - exact_volume(1e-3))
        for n in (4, 8, 16)
    ]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 4.0, atol=0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_every_node_is_on_its_sphere_and_rays_pass_through_the_wall(kind: str) -> None:
    t, layers = 0.6e-3, 3
    mesh = build_mesh(R, t, divisions=4, level=1, layers=layers, **KINDS[kind])
    radii = np.linalg.norm(mesh.points_nc, axis=1)
    spheres = R - t * np.linspace(0, 1, mesh.order * layers + 1)
    assert np.abs(radii[:, None] - spheres).min(axis=1).max() < 1e-17
    outer, inner = mesh.points_nc[mesh.outer_qn], mesh.points_nc[mesh.inner_qn]
    np.testing.assert_allclose(inner / (R - t), outer / R, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(outer, axis=2), R, rtol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_of_an_element_lie_where_vtk_says(kind: str) -> None:
    """The nodes must be near the trilinear image of VTK's reference positions (curvature moves them a little)."""
    mesh = build_mesh(R, 1e-3, divisions=6, level=1, layers=2, **KINDS[kind])
    nodes = mesh.cells_en.shape[1]
    corners = mesh.points_nc[mesh.cells_en[:, :8]]
    straight = shape_values(node_positions(3, nodes), 8) @ corners
    assert np.abs(mesh.points_nc[mesh.cells_en] - straight).max() < 0.1e-3


@pytest.mark.parametrize(("kind", "layers"), list(product(KINDS, [1, 2])))
def test_the_wall_is_watertight_and_has_the_topology_of_a_ball(kind: str, layers: int) -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=1, layers=layers, **KINDS[kind])
    faces = np.concatenate([mesh.cells_en[:, list(face)] for face in HEX_FACES])
    same, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    assert set(count) == {1, 2}  # a face is shared by two elements or lies on the boundary
    skin = faces[first[count == 1]].tolist()
    directed = {(q[k], q[(k + 1) % 4]) for q in skin for k in range(4)}
    assert len(directed) == 4 * len(skin)
    assert all((b, a) in directed for a, b in directed)  # closed: no edge of the skin is open
    vertices = len({v for q in skin for v in q})
    assert vertices - len(directed) // 2 + len(skin) == 2  # Euler characteristic of a closed surface without holes
    volume_edges = {frozenset(e) for q in faces.tolist() for e in zip(q, q[1:] + q[:1], strict=True)}
    assert len(np.unique(mesh.cells_en[:, :8])) - len(volume_edges) + len(same) - len(mesh.cells_en) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_every_node_belongs_to_an_element_and_no_two_coincide(kind: str) -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=0, layers=2, **KINDS[kind])
    assert len(np.unique(mesh.cells_en)) == len(mesh.points_nc)
    assert len(np.unique(np.round(mesh.points_nc / R, 9), axis=0)) == len(mesh.points_nc)


def test_a_mesh_that_does_not_exist_is_an_input_error() -> None:
    for name, value in [("thickness_m", 0.0), ("thickness_m", 7e-3), ("order", 3), ("divisions", 5), ("layers", 0)]:
        message = "thickness" if name == "thickness_m" else f"{name} {value}"
        with pytest.raises(InputError, match=message):
            build_mesh(**{"radius_m": R, "thickness_m": 0.5e-3, name: value})


def naive_catmull_clark_vertex(surface: QuadSurface, vertex: int) -> np.ndarray:
    """The rule of Catmull and Clark for one old vertex, straight from its definition."""
    points, quads = surface.points_vc, surface.quads_qv.tolist()
    mine = [q for q in quads if vertex in q]
    sides = [frozenset((q[k], q[(k + 1) % 4])) for q in mine for k in range(4)]
    at_vertex = {side for side in sides if vertex in side}
    border = [side for side in at_vertex if sides.count(side) == 1]
    if border:
        ends = [points[next(iter(side - {vertex}))] for side in border]
        return 0.75 * points[vertex] + 0.125 * sum(ends)
    faces = np.mean([points[q].mean(axis=0) for q in mine], axis=0)
    middles = np.mean([points[list(side)].mean(axis=0) for side in at_vertex], axis=0)
    n = len(at_vertex)
    return (faces + 2 * middles + (n - 3) * points[vertex]) / n


def test_subdivision_follows_the_rules_of_catmull_and_clark_at_every_vertex() -> None:
    coarse = half_cube(4)
    fine = catmull_clark(coarse)
    assert len(fine.quads_qv) == 4 * len(coarse.quads_qv)
    for vertex in range(len(coarse.points_vc)):
        expected = naive_catmull_clark_vertex(coarse, vertex)
        np.testing.assert_allclose(fine.points_vc[vertex], expected, atol=1e-15)
    first_face = len(coarse.points_vc) + len(coarse.edges[0])
    np.testing.assert_allclose(fine.points_vc[first_face:], coarse.points_vc[coarse.quads_qv].mean(axis=1))


def test_an_edge_point_is_the_mean_of_its_ends_and_face_points() -> None:
    coarse = half_cube(2)
    fine = catmull_clark(coarse)
    faces = coarse.points_vc[coarse.quads_qv].mean(axis=1)
    for edge, ends in enumerate(coarse.edges[0]):
        beside = np.flatnonzero(np.any(coarse.edges[1] == edge, axis=1))
        parts = [*coarse.points_vc[ends], *faces[beside]] if len(beside) == 2 else [*coarse.points_vc[ends]]
        np.testing.assert_allclose(fine.points_vc[len(coarse.points_vc) + edge], np.mean(parts, axis=0), atol=1e-15)


def test_the_base_stays_in_its_plane_exactly() -> None:
    surface = half_cube(4)
    for _ in range(3):
        surface = catmull_clark(surface)
        border = np.unique(surface.edges[0][surface.edges[2]])
        assert np.all(surface.points_vc[border, 2] == 0.0)


def test_projected_quads_stay_nearly_alike() -> None:
    surface = project_on_sphere(catmull_clark(half_cube(10)))
    corners = surface.points_vc[surface.quads_qv]
    np.testing.assert_allclose(np.linalg.norm(surface.points_vc, axis=1), 1.0, atol=1e-15)
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    assert areas.max() / areas.min() < 2.0
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert np.max(sides.max(axis=1) / sides.min(axis=1)) < 1.4
