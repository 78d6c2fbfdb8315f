import numpy as np
import pytest

from scleraforce.mechanics.mesh import QuadSurface, catmull_clark, half_cube, project_on_sphere


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


@pytest.mark.parametrize("divisions", [2, 6])
def test_half_cube_is_a_disc_of_the_expected_quads(divisions: int) -> None:
    surface = half_cube(divisions)
    assert len(surface.quads_qv) == 3 * divisions**2
    assert len(surface.points_vc) - len(surface.edges_ev) + len(surface.quads_qv) == 1  # Euler characteristic of a disc
    assert np.abs(surface.points_vc).max() == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("divisions", [0, 1, 3])
def test_half_cube_refuses_divisions_that_leave_no_plane_base(divisions: int) -> None:
    with pytest.raises(ValueError, match="even"):
        half_cube(divisions)


@pytest.mark.parametrize("levels", [0, 1, 2])
def test_every_quad_faces_outward_and_meets_at_most_one_other_at_an_edge(levels: int) -> None:
    surface = half_cube(4)
    for _ in range(levels):
        surface = catmull_clark(surface)
    corners = surface.points_vc[surface.quads_qv]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    assert np.all(np.sum(normals * corners.mean(axis=1), axis=1) > 0)
    assert set(surface.edge_quads_count) == {1, 2}
    # Neighbours run through their common edge in opposite senses: every directed edge occurs once.
    directed = {(q[k], q[(k + 1) % 4]) for q in surface.quads_qv.tolist() for k in range(4)}
    assert len(directed) == 4 * len(surface.quads_qv)


def test_subdivision_follows_the_rules_of_catmull_and_clark_at_every_vertex() -> None:
    coarse = half_cube(4)
    fine = catmull_clark(coarse)
    assert len(fine.quads_qv) == 4 * len(coarse.quads_qv)
    for vertex in range(len(coarse.points_vc)):
        expected = naive_catmull_clark_vertex(coarse, vertex)
        np.testing.assert_allclose(fine.points_vc[vertex], expected, atol=1e-15)
    first_face = len(coarse.points_vc) + len(coarse.edges_ev)
    np.testing.assert_allclose(fine.points_vc[first_face:], coarse.points_vc[coarse.quads_qv].mean(axis=1))


def test_an_edge_point_is_the_mean_of_its_ends_and_face_points() -> None:
    coarse = half_cube(2)
    fine = catmull_clark(coarse)
    faces = coarse.points_vc[coarse.quads_qv].mean(axis=1)
    for edge, ends in enumerate(coarse.edges_ev):
        beside = np.flatnonzero(np.any(coarse.quad_edges_qe == edge, axis=1))
        parts = [*coarse.points_vc[ends], *faces[beside]] if len(beside) == 2 else [*coarse.points_vc[ends]]
        np.testing.assert_allclose(fine.points_vc[len(coarse.points_vc) + edge], np.mean(parts, axis=0), atol=1e-15)


def test_the_base_stays_in_its_plane_exactly() -> None:
    surface = half_cube(4)
    for _ in range(3):
        surface = catmull_clark(surface)
        border = np.unique(surface.edges_ev[surface.edge_quads_count == 1])
        assert np.all(surface.points_vc[border, 2] == 0.0)


def test_projected_quads_stay_nearly_alike() -> None:
    surface = project_on_sphere(catmull_clark(half_cube(10)))
    corners = surface.points_vc[surface.quads_qv]
    np.testing.assert_allclose(np.linalg.norm(surface.points_vc, axis=1), 1.0, atol=1e-15)
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    assert areas.max() / areas.min() < 2.0
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert np.max(sides.max(axis=1) / sides.min(axis=1)) < 1.4
