"""Meshes: shape functions, subdivision, grading, and directions that are located in
them.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from math import radians

import numpy as np
import pytest

from scleraforce.base.errors import InputError, StudyError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import volume_points
from scleraforce.mechanics.graded_mesh import graded_mesh, study_mesh, supported_mesh
from scleraforce.mechanics.hexahedral_mesh import (
    HexMesh,
    QuadSurface,
    build_mesh,
    catmull_clark,
    half_cube,
    project_on_sphere,
)
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.shape_functions import (
    node_positions,
    shape_gradients,
    shape_values,
)
from scleraforce.records.study import MeshStudy, Study, SupportsStudy

ELEMENTS = [(2, 4), (2, 8), (2, 9), (3, 8), (3, 20), (3, 27)]


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_each_shape_function_is_one_at_its_node_and_zero_at_the_others(
    dimension: int, nodes: int
) -> None:
    np.testing.assert_array_equal(
        shape_values(node_positions(dimension, nodes), nodes), np.eye(nodes)
    )


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_shape_functions_reproduce_the_polynomials_of_their_order(
    dimension: int, nodes: int
) -> None:
    order = 1 if nodes == 2**dimension else 2
    points = np.random.default_rng(0).uniform(-1, 1, (50, dimension))
    slope = np.arange(1.0, dimension + 1)

    def field(x: np.ndarray) -> np.ndarray:
        return (0.3 + x @ slope) ** order

    interpolated = shape_values(points, nodes) @ field(node_positions(dimension, nodes))
    np.testing.assert_allclose(interpolated, field(points), atol=1e-13)


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_gradients_are_the_slopes_of_the_values(dimension: int, nodes: int) -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (20, dimension))
    for axis in range(dimension):
        # central differences are exact for quadratics
        step = 1e-3 * np.eye(dimension)[axis]
        slopes = (
            shape_values(points + step, nodes) - shape_values(points - step, nodes)
        ) / 2e-3
        np.testing.assert_allclose(
            shape_gradients(points, nodes)[..., axis], slopes, atol=1e-11
        )


def test_an_unknown_element_is_refused() -> None:
    with pytest.raises(ValueError, match="7 nodes"):
        shape_values(np.zeros((1, 3)), 7)


R = 12e-3
# outward
HEX_FACES = [
    (0, 3, 2, 1),
    (4, 5, 6, 7),
    (0, 1, 5, 4),
    (1, 2, 6, 5),
    (2, 3, 7, 6),
    (3, 0, 4, 7),
]
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def exact_volume(thickness_m: float) -> float:
    return 2.0 / 3.0 * np.pi * (R**3 - (R - thickness_m) ** 3)


def test_the_volume_of_curved_elements_converges_with_fourth_order() -> None:
    errors = [
        abs(
            volume_points(build_mesh(R, 1e-3, divisions=n, level=0)).volumes_ep.sum()
            - exact_volume(1e-3)
        )
        for n in (4, 8, 16)
    ]
    np.testing.assert_allclose(
        np.log2(np.divide(errors[:-1], errors[1:])), 4.0, atol=0.2
    )


@pytest.mark.parametrize("kind", KINDS)
def test_every_node_is_on_its_sphere_and_rays_pass_through_the_wall(kind: str) -> None:
    t = 0.6e-3
    layers = 3
    mesh = build_mesh(R, t, divisions=4, level=1, layers=layers, **KINDS[kind])
    radii = np.linalg.norm(mesh.points_nc, axis=1)
    spheres = R - t * np.linspace(0, 1, mesh.order * layers + 1)
    assert np.abs(radii[:, None] - spheres).min(axis=1).max() < 1e-17
    outer = mesh.points_nc[mesh.outer_qn]
    inner = mesh.points_nc[mesh.inner_qn]
    np.testing.assert_allclose(inner / (R - t), outer / R, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(outer, axis=2), R, rtol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_of_an_element_lie_where_vtk_says(kind: str) -> None:
    """The nodes must be near the trilinear image of VTK's reference positions
    (curvature moves them a little).
    """
    mesh = build_mesh(R, 1e-3, divisions=6, level=1, layers=2, **KINDS[kind])
    nodes = mesh.cells_en.shape[1]
    corners = mesh.points_nc[mesh.cells_en[:, :8]]
    straight = shape_values(node_positions(3, nodes), 8) @ corners
    assert np.abs(mesh.points_nc[mesh.cells_en] - straight).max() < 0.1e-3


@pytest.mark.parametrize(("kind", "layers"), list(product(KINDS, [1, 2])))
def test_the_wall_is_watertight_and_has_the_topology_of_a_ball(
    kind: str, layers: int
) -> None:
    mesh = build_mesh(R, 1e-3, divisions=4, level=1, layers=layers, **KINDS[kind])
    faces = np.concatenate([mesh.cells_en[:, list(face)] for face in HEX_FACES])
    same, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    # a face is shared by two elements or lies on the boundary
    assert set(count) == {
        1,
        2,
    }
    skin = faces[first[count == 1]].tolist()
    directed = {(q[k], q[(k + 1) % 4]) for q in skin for k in range(4)}
    assert len(directed) == 4 * len(skin)
    # closed: no edge of the skin is open
    assert all((b, a) in directed for a, b in directed)
    vertices = len({v for q in skin for v in q})
    # Euler characteristic of a closed surface without holes
    assert vertices - len(directed) // 2 + len(skin) == 2
    volume_edges = {
        frozenset(e) for q in faces.tolist() for e in zip(q, q[1:] + q[:1], strict=True)
    }
    assert (
        len(np.unique(mesh.cells_en[:, :8]))
        - len(volume_edges)
        + len(same)
        - len(mesh.cells_en)
        == 1
    )


def test_a_mesh_that_does_not_exist_is_an_input_error() -> None:
    for name, value in [
        ("thickness_m", 0.0),
        ("thickness_m", 7e-3),
        ("order", 3),
        ("divisions", 5),
        ("layers", 0),
    ]:
        message = "thickness" if name == "thickness_m" else f"{name} {value}"
        with pytest.raises(InputError, match=message):
            build_mesh(**{"radius_m": R, "thickness_m": 0.5e-3, name: value})


def naive_catmull_clark_vertex(surface: QuadSurface, vertex: int) -> np.ndarray:
    """The rule of Catmull and Clark for one old vertex, straight from its
    definition.
    """
    points = surface.points_vc
    quads = surface.quads_qv.tolist()
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
    np.testing.assert_allclose(
        fine.points_vc[first_face:], coarse.points_vc[coarse.quads_qv].mean(axis=1)
    )


def test_an_edge_point_is_the_mean_of_its_ends_and_face_points() -> None:
    coarse = half_cube(2)
    fine = catmull_clark(coarse)
    faces = coarse.points_vc[coarse.quads_qv].mean(axis=1)

    for edge, ends in enumerate(coarse.edges[0]):
        beside = np.flatnonzero(np.any(coarse.edges[1] == edge, axis=1))
        parts = (
            [*coarse.points_vc[ends], *faces[beside]]
            if len(beside) == 2
            else [*coarse.points_vc[ends]]
        )
        np.testing.assert_allclose(
            fine.points_vc[len(coarse.points_vc) + edge],
            np.mean(parts, axis=0),
            atol=1e-15,
        )


def test_the_base_stays_in_its_plane_exactly() -> None:
    surface = half_cube(4)
    for _ in range(3):
        surface = catmull_clark(surface)
        border = np.unique(surface.edges[0][surface.edges[2]])
        assert np.all(surface.points_vc[border, 2] == 0.0)


def test_projected_quads_stay_nearly_alike() -> None:
    surface = project_on_sphere(catmull_clark(half_cube(10)))
    corners = surface.points_vc[surface.quads_qv]
    np.testing.assert_allclose(
        np.linalg.norm(surface.points_vc, axis=1), 1.0, atol=1e-15
    )
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1
    )
    assert areas.max() / areas.min() < 2.0
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert np.max(sides.max(axis=1) / sides.min(axis=1)) < 1.4


T = 0.5e-3
NEEDLE_RADIUS = 0.35e-3
CONTACTS = [
    Contact(polar_rad=0.0),
    Contact(polar_rad=radians(25), azimuth_rad=0.3),
    Contact(polar_rad=radians(50), azimuth_rad=4.0),
    Contact(polar_rad=radians(60), azimuth_rad=-1.0),
]


def tip_of(mesh: HexMesh, contact: Contact) -> float:
    wall = LinearWall(mesh, 0.45)
    return tip_displacement(mesh, contact, wall.needle_cnc([contact], NEEDLE_RADIUS)[0])


def directions(count: int, whole: bool = False) -> np.ndarray:
    """Return rays of any length, upwards unless they are of a whole globe."""
    rays = np.random.default_rng(0).normal(size=(count, 3))
    if not whole:
        rays[:, 2] = np.abs(rays[:, 2])
    return rays


@pytest.mark.parametrize("kind", KINDS)
def test_elements_are_positive_fill_the_shell_and_share_their_nodes(kind: str) -> None:
    # far elements are large
    linear = kind == "8 nodes"
    far = 8e-2 if kind == "8 nodes" else 5e-4
    shells = [
        (
            build_mesh(R, t, layers=2, **KINDS[kind]),
            exact_volume(t),
            4e-3 if linear else 2e-6,
        )
        for t in (0.3e-3, 0.75e-3, 1.2e-3)
    ]

    for contact in CONTACTS[:3]:
        shells.append((graded_mesh(R, T, contact, **KINDS[kind]), exact_volume(T), far))
        shells.append(
            (
                graded_mesh(R, T, contact, **KINDS[kind], whole=True),
                2.0 * exact_volume(T),
                far,
            )
        )

    for mesh, volume, tolerance in shells:
        volumes = volume_points(
            mesh
        ).volumes_ep  # raises where a Jacobian is not positive
        assert volumes.sum() == pytest.approx(volume, rel=tolerance)
        assert len(np.unique(mesh.cells_en)) == len(mesh.points_nc)
        assert len(np.unique(np.round(mesh.points_nc / R, 9), axis=0)) == len(
            mesh.points_nc
        )


def test_the_grading_follows_the_contact_and_turns_with_its_azimuth() -> None:
    contact = Contact(polar_rad=radians(35), azimuth_rad=1.0)
    mesh = graded_mesh(R, T, contact)
    sizes = np.sqrt(volume_points(mesh).volumes_ep.sum(axis=1) / T)
    middles = mesh.points_nc[mesh.cells_en].mean(axis=1)
    distance = np.linalg.norm(middles - R * contact.normal, axis=1)
    assert sizes[distance < 1e-3].max() < 0.4e-3
    assert sizes[distance > 8e-3].min() > 0.7e-3
    straight = graded_mesh(R, T, Contact(polar_rad=contact.polar_rad))
    s = np.sin(1.0)
    c = np.cos(1.0)
    turned = straight.points_nc @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mesh.points_nc, turned, atol=1e-15)


def test_a_globe_has_no_base_and_is_closed() -> None:
    mesh = graded_mesh(R, T, CONTACTS[1], whole=True)
    assert len(mesh.base_nodes) == 0
    sides = np.sort(
        np.stack(
            [mesh.outer_qn[:, :4], np.roll(mesh.outer_qn[:, :4], -1, axis=1)], axis=-1
        ),
        axis=-1,
    )
    _, count = np.unique(sides.reshape(-1, 2), axis=0, return_counts=True)
    assert np.all(count == 2)
    upper = graded_mesh(R, T, CONTACTS[1])
    assert len(upper.cells_en) < len(mesh.cells_en) < 2 * len(upper.cells_en)


@pytest.mark.slow
@pytest.mark.parametrize("thickness_m", [0.4e-3, 0.8e-3])
@pytest.mark.parametrize("polar_deg", [0.0, 50.0])
def test_the_linear_tip_is_within_half_a_percent_of_a_fine_mesh(
    thickness_m: float, polar_deg: float
) -> None:
    contact = Contact(polar_rad=radians(polar_deg), azimuth_rad=0.3)
    fine = tip_of(graded_mesh(R, thickness_m, contact, core=10, rings=24), contact)
    assert tip_of(graded_mesh(R, thickness_m, contact), contact) == pytest.approx(
        fine, rel=5e-3
    )


def test_a_study_chooses_the_graded_mesh() -> None:
    study = Study(mesh=MeshStudy(kind="graded", core=4, rings=8))
    mesh = study_mesh(study, T, CONTACTS[1])
    np.testing.assert_array_equal(
        mesh.points_nc, graded_mesh(R, T, CONTACTS[1], core=4, rings=8).points_nc
    )

    with pytest.raises(InputError, match="several"):
        study_mesh(study, T)

    with pytest.raises(StudyError, match="core: 5 is odd"):
        MeshStudy(core=5)


def test_a_graded_mesh_that_does_not_exist_is_an_input_error() -> None:
    for name, value, message in (
        ("contact", Contact(polar_rad=radians(65)), "polar angle: 65 deg"),
        ("core", 3, "core 3"),
        ("rings", 0, "rings 0"),
        ("thickness_m", 7e-3, "thickness"),
        ("layers", 0, "layers 0"),
    ):
        with pytest.raises(InputError, match=message):
            graded_mesh(
                **{"radius_m": R, "thickness_m": T, "contact": CONTACTS[0], name: value}
            )


CONTACT = Contact(polar_rad=0.6)
GRADED = MeshStudy(kind="graded", core=2, rings=4)


@pytest.mark.parametrize("kind", ["bed", "bed-and-straps"])
def test_a_bed_carries_a_whole_globe(kind: str) -> None:
    mesh = supported_mesh(
        Study(mesh=GRADED, supports=SupportsStudy(kind=kind)), 0.5e-3, CONTACT
    )
    assert mesh.points_nc[:, 2].min() == pytest.approx(-12e-3, rel=1e-2)
    assert len(mesh.base_nodes) == 0


@pytest.mark.parametrize("kind", ["clamped", "straps"])
def test_any_other_support_leaves_the_studys_mesh(kind: str) -> None:
    study = Study(mesh=GRADED, supports=SupportsStudy(kind=kind))
    expected = study_mesh(study, 0.5e-3, CONTACT)
    np.testing.assert_array_equal(
        supported_mesh(study, 0.5e-3, CONTACT).points_nc, expected.points_nc
    )


def test_a_bed_needs_a_graded_mesh() -> None:
    with pytest.raises(InputError, match="whole globe"):
        supported_mesh(
            Study(mesh=MeshStudy(kind="hexahedra"), supports=SupportsStudy(kind="bed")),
            0.5e-3,
            CONTACT,
        )


def same_mesh(study: Study, other: MeshStudy, contact: Contact, *, alone: bool) -> bool:
    mesh = supported_mesh(study, T, contact, alone=alone)
    return np.array_equal(
        mesh.points_nc, supported_mesh(replace(study, mesh=other), T, contact).points_nc
    )


def test_an_automatic_mesh_is_graded_for_one_contact_alone_or_a_bed() -> None:
    graded = MeshStudy(kind="graded")
    even = MeshStudy(kind="hexahedra")
    assert same_mesh(Study(), graded, CONTACT, alone=True)
    assert same_mesh(
        Study(supports=SupportsStudy(kind="bed")), graded, CONTACT, alone=False
    )
    assert same_mesh(Study(), even, CONTACT, alone=False)
    # a graded mesh does not reach there
    assert same_mesh(Study(), even, Contact(polar_rad=radians(65.0)), alone=True)

    for stated in (
        even,
        MeshStudy(divisions=8),
        MeshStudy(level=0),
    ):
        # their study decides
        assert same_mesh(
            Study(mesh=stated), replace(stated, kind="hexahedra"), CONTACT, alone=True
        )


def pierced(
    mesh: HexMesh, quads_qn: np.ndarray, quads: np.ndarray, local: np.ndarray
) -> np.ndarray:
    return np.einsum(
        "pn,pnc->pc",
        shape_values(local, quads_qn.shape[1]),
        mesh.points_nc[quads_qn[quads]],
    )


def meshes_to_look_in() -> Iterator[HexMesh]:
    """Yield half-spheres of both kinds and whole globes."""
    for kind, grid in product(
        KINDS.values(), ({"divisions": 2, "level": 0}, {}, {"divisions": 6})
    ):
        yield build_mesh(R, T, **grid, **kind)

    grids = {"core": 4, "rings": 8}, {}, {"core": 8, "rings": 30}
    for contact, whole, grid in product(CONTACTS, (False, True), grids):
        yield graded_mesh(R, T, contact, **grid, whole=whole)


def test_the_point_found_lies_on_the_ray_inside_its_quad() -> None:
    """Nodes are looked for too: they lie where quads meet, at the base, and at a cube's
    corners of valence 3.
    """
    for mesh in meshes_to_look_in():
        rays = np.concatenate(
            [
                directions(5_000, len(mesh.base_nodes) == 0),
                mesh.points_nc[np.unique(mesh.outer_qn)],
            ]
        )
        quads, local = mesh.locator.locate(rays)
        assert np.abs(local).max() <= 1.0

        for surface_qn in (
            mesh.outer_qn,
            mesh.inner_qn,
        ):
            # coordinates found on the outer surface serve the inner
            points = pierced(mesh, surface_qn, quads, local)
            assert np.all(np.sum(points * rays, axis=1) > 0)
            off_ray = np.linalg.norm(np.cross(points, rays), axis=1) / np.linalg.norm(
                rays, axis=1
            )
            assert off_ray.max() < 1e-12 * R


def test_a_direction_that_rounding_put_below_the_base_is_found_at_the_base() -> None:
    mesh = build_mesh(R, T)
    azimuth = np.linspace(-np.pi, np.pi, 997)
    rays = np.stack(
        [np.cos(azimuth), np.sin(azimuth), np.full_like(azimuth, -5e-10)], axis=1
    )
    quads, local = mesh.locator.locate(rays)
    np.testing.assert_allclose(
        pierced(mesh, mesh.outer_qn, quads, local) / R, rays, atol=2e-5
    )


def test_the_quad_is_the_one_that_a_search_over_all_quads_finds() -> None:
    mesh = build_mesh(R, T, divisions=4, level=1, order=1)
    rays = directions(300)
    corners = mesh.points_nc[mesh.outer_qn]
    # Inside the spherical polygon: on the inner side of the plane through the centre
    # and each edge.
    planes = np.cross(corners, np.roll(corners, -1, axis=1))
    inside = np.all(np.einsum("qec,dc->dqe", planes, rays) >= 0, axis=2)
    assert np.all(inside.sum(axis=1) == 1)
    np.testing.assert_array_equal(
        mesh.locator.locate(rays)[0], np.argmax(inside, axis=1)
    )


def test_answers_do_not_depend_on_what_else_is_asked_for() -> None:
    mesh = build_mesh(R, T)
    rays = directions(40_000)
    quads, local = mesh.locator.locate(rays)

    for pick in (slice(0, 1), slice(16_380, 16_390), slice(39_999, None)):
        alone = mesh.locator.locate(rays[pick])
        np.testing.assert_array_equal(alone[0], quads[pick])
        np.testing.assert_allclose(alone[1], local[pick], atol=1e-13)

    assert mesh.locator.locate(rays[:0])[0].shape == (0,)


@pytest.mark.parametrize(
    "ray", [[0.0, 0.0, -1.0], [1.0, 0.0, -1e-6], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]]
)
def test_a_direction_that_misses_the_half_sphere_is_an_input_error(
    ray: list[float],
) -> None:
    mesh = build_mesh(R, T, divisions=2, level=0)
    with pytest.raises(InputError, match="direction"):
        mesh.locator.locate(np.array([[0.0, 0.0, 1.0], ray]))
