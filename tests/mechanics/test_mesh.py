"""Meshes: shape functions, subdivision, grading, and directions that are located in
them.
"""

from dataclasses import replace
from itertools import product
from math import radians

import numpy as np
import pytest
import pyvista

from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.graded_mesh import study_mesh, supported_mesh
from scleraforce.mechanics.hexahedral_mesh import (
    HexMesh,
    QuadSurface,
    build_mesh,
    catmull_clark,
    half_cube,
    locate,
)
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.shape_functions import (
    node_positions,
    shape_gradients,
    shape_values,
)
from scleraforce.records.study import MeshStudy, Study, SupportsStudy

R = 12e-3
T = 0.5e-3
KINDS = {"8 nodes": 1, "27 nodes": 2}
ELEMENTS = [(2, 4), (2, 8), (2, 9), (3, 8), (3, 20), (3, 27)]
BED = SupportsStudy(kind="bed")
CONTACTS = [
    Contact(polar_rad=0.0),
    Contact(polar_rad=radians(25), azimuth_rad=0.3),
    Contact(polar_rad=radians(50), azimuth_rad=4.0),
]


def graded(contact: Contact, whole: bool = False, **size: int) -> HexMesh:
    study = Study(
        mesh=MeshStudy(kind="graded", **size),
        supports=BED if whole else SupportsStudy(),
    )
    return supported_mesh(study, T, contact)


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_shape_functions_and_slopes_reproduce_the_polynomials_of_their_order(
    dimension: int, nodes: int
):
    order = 1 if nodes == 2**dimension else 2
    places = node_positions(dimension, nodes)
    np.testing.assert_array_equal(shape_values(places, nodes), np.eye(nodes))
    points = np.random.default_rng(0).uniform(-1, 1, (50, dimension))
    slope = np.arange(1.0, dimension + 1)
    level = 0.3 + points @ slope
    values = (0.3 + places @ slope) ** order
    np.testing.assert_allclose(shape_values(points, nodes) @ values, level**order)
    np.testing.assert_allclose(
        np.einsum("pnk,n->pk", shape_gradients(points, nodes), values),
        order * level[:, None] ** (order - 1) * slope,
        atol=1e-11,
    )


SHELLS = {
    "hexahedra": lambda order: build_mesh(R, T, layers=2, order=order),
    "graded": lambda order: graded(CONTACTS[1], order=order),
    "graded far from the pole": lambda order: graded(CONTACTS[2], order=order),
    "globe": lambda order: graded(CONTACTS[2], whole=True, order=order),
}


@pytest.mark.parametrize(("shell", "kind"), list(product(SHELLS, KINDS)))
def test_elements_are_positive_and_fill_a_watertight_shell(shell: str, kind: str):
    """VTK measures them, in its order of nodes."""
    mesh = SHELLS[shell](KINDS[kind])
    nodes = mesh.cells_en.shape[1]
    vtk = pyvista.CellType.HEXAHEDRON if nodes == 8 else 29  # triquadratic
    grid = pyvista.UnstructuredGrid({vtk: mesh.cells_en}, mesh.points_nc)
    volumes = grid.compute_cell_sizes(length=False, area=False)["Volume"]
    assert volumes.min() > 0.0
    half = 2.0 / 3.0 * np.pi * (R**3 - (R - T) ** 3)
    # VTK makes of each element some tetrahedra; the far ones are large
    assert volumes.sum() == pytest.approx(
        2.0 * half if shell == "globe" else half, rel=0.08
    )
    skin = grid.extract_surface(
        algorithm="dataset_surface", nonlinear_subdivision=0
    ).triangulate()
    assert skin.n_open_edges == 0
    assert len(np.unique(mesh.cells_en)) == len(mesh.points_nc)
    places = np.unique(np.round(mesh.points_nc / R, 9), axis=0)
    assert len(places) == len(mesh.points_nc)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("thickness_m", 0.0),
        ("thickness_m", 7e-3),
        ("order", 3),
        ("divisions", 5),
        ("layers", 0),
    ],
)
def test_a_mesh_that_does_not_exist_is_an_input_error(name: str, value: float):
    message = "thickness" if name == "thickness_m" else f"{name} {value}"
    with pytest.raises(InputError, match=message):
        build_mesh(**{"radius_m": R, "thickness_m": T, name: value})


def naive_vertex(surface: QuadSurface, vertex: int) -> np.ndarray:
    """The rule of Catmull and Clark for one old vertex, straight from its
    definition.
    """
    points = surface.points_vc
    mine = [q for q in surface.quads_qv.tolist() if vertex in q]
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


def naive_edge(surface: QuadSurface, edge: int) -> np.ndarray:
    """The mean of an edge's ends and, inside, of the middles of its faces."""
    parts = [*surface.points_vc[surface.edges[0][edge]]]
    beside = np.flatnonzero(np.any(surface.edges[1] == edge, axis=1))
    if len(beside) == 2:
        parts += [surface.points_vc[surface.quads_qv[k]].mean(axis=0) for k in beside]
    return np.mean(parts, axis=0)


def test_subdivision_follows_the_rules_of_catmull_and_clark():
    coarse = half_cube(4)
    fine = catmull_clark(coarse)
    assert len(fine.quads_qv) == 4 * len(coarse.quads_qv)
    expected = np.array(
        [naive_vertex(coarse, number) for number in range(len(coarse.points_vc))]
        + [naive_edge(coarse, number) for number in range(len(coarse.edges[0]))]
        + [coarse.points_vc[quad].mean(axis=0) for quad in coarse.quads_qv]
    )
    np.testing.assert_allclose(fine.points_vc, expected, atol=1e-15)


def test_the_grading_follows_the_contact_and_turns_with_its_azimuth():
    contact = Contact(polar_rad=radians(35), azimuth_rad=1.0)
    mesh = graded(contact)
    corners = mesh.points_nc[mesh.outer_qn[:, :4]]
    sizes = np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)
    distance = np.linalg.norm(corners.mean(axis=1) - R * contact.normal, axis=1)
    assert sizes[distance < 1e-3].max() < 0.55e-3
    assert sizes[distance > 8e-3].min() > 1.0e-3
    straight = graded(Contact(polar_rad=contact.polar_rad))
    s = np.sin(1.0)
    c = np.cos(1.0)
    turned = straight.points_nc @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mesh.points_nc, turned, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("polar_deg", [0.0, 50.0])
def test_the_linear_tip_is_within_half_a_percent_of_a_fine_mesh(
    polar_deg: float,
):
    contact = Contact(polar_rad=radians(polar_deg), azimuth_rad=0.3)
    usual, fine = (
        tip_displacement(
            mesh, contact, LinearWall(mesh, 0.45).needle_cnc([contact], 0.35e-3)[0]
        )
        for mesh in (graded(contact), graded(contact, core=10, rings=24))
    )
    assert usual == pytest.approx(fine, rel=5e-3)


@pytest.mark.parametrize(
    ("contact", "message"),
    [(None, "several"), (Contact(polar_rad=radians(65)), "polar angle: 65 deg")],
)
def test_a_graded_mesh_needs_one_contact_within_its_reach(
    contact: Contact | None, message: str
):
    with pytest.raises(InputError, match=message):
        study_mesh(Study(mesh=MeshStudy(kind="graded")), T, contact)


def test_a_bed_needs_a_graded_mesh():
    with pytest.raises(InputError, match="whole globe"):
        supported_mesh(
            Study(mesh=MeshStudy(kind="hexahedra"), supports=BED), T, CONTACTS[0]
        )


AUTOMATIC = MeshStudy()
FAR = Contact(polar_rad=radians(65.0))  # a graded mesh does not reach there


@pytest.mark.parametrize(
    ("mesh", "supports", "contact", "alone", "kind"),
    [
        (AUTOMATIC, SupportsStudy(), CONTACTS[1], True, "graded"),
        (AUTOMATIC, BED, CONTACTS[1], False, "graded"),
        (AUTOMATIC, SupportsStudy(), CONTACTS[1], False, "hexahedra"),
        (AUTOMATIC, SupportsStudy(), FAR, True, "hexahedra"),
        # their study decides
        (MeshStudy(divisions=8), SupportsStudy(), CONTACTS[1], True, "hexahedra"),
        (MeshStudy(level=0), SupportsStudy(), CONTACTS[1], True, "hexahedra"),
    ],
)
def test_an_automatic_mesh_is_graded_for_one_contact_alone_or_a_bed(
    mesh: MeshStudy,
    supports: SupportsStudy,
    contact: Contact,
    alone: bool,
    kind: str,
):
    study = Study(mesh=mesh, supports=supports)
    found = supported_mesh(study, T, contact, alone=alone)
    stated = replace(study, mesh=replace(mesh, kind=kind))
    expected = supported_mesh(stated, T, contact)
    np.testing.assert_array_equal(found.points_nc, expected.points_nc)
    assert (len(found.base_nodes) == 0) == supports.has_bed


def directions(count: int, whole: bool = False) -> np.ndarray:
    """Return rays of any length, upwards unless they are of a whole globe."""
    rays = np.random.default_rng(0).normal(size=(count, 3))
    if not whole:
        rays[:, 2] = np.abs(rays[:, 2])
    return rays


LOOKED_IN = {
    "8 nodes": lambda: build_mesh(R, T, order=1),
    "few quads": lambda: build_mesh(R, T, divisions=2, level=0),
    "27 nodes": lambda: build_mesh(R, T),
    "graded": lambda: graded(CONTACTS[2]),
    "globe": lambda: graded(CONTACTS[1], whole=True),
    "fine globe": lambda: graded(CONTACTS[2], whole=True, core=8, rings=30),
}


@pytest.mark.parametrize("name", LOOKED_IN)
def test_the_point_found_lies_on_the_ray_inside_its_quad(name: str):
    """Nodes are looked for too: they lie where quads meet, at the base, and at a cube's
    corners of valence 3.
    """
    mesh = LOOKED_IN[name]()
    whole = len(mesh.base_nodes) == 0
    rays = np.concatenate(
        [directions(3_000, whole), mesh.points_nc[np.unique(mesh.outer_qn)]]
    )
    exact = len(rays)
    if not whole:
        # below the base by rounding
        around = np.linspace(-np.pi, np.pi, 197)
        rim = np.stack(
            [np.cos(around), np.sin(around), np.full_like(around, -5e-10)], axis=1
        )
        rays = np.concatenate([rays, rim])
    quads, local = mesh.locator.locate(rays)
    assert np.abs(local).max() <= 1.0
    _, weights_dn = locate(mesh, rays)

    # weights found on the outer surface serve the inner
    for surface_qn in (mesh.outer_qn, mesh.inner_qn):
        points = np.einsum("dn,dnc->dc", weights_dn, mesh.points_nc[surface_qn[quads]])
        assert np.all(np.sum(points * rays, axis=1) > 0)
        off_ray = np.linalg.norm(np.cross(points, rays), axis=1)
        off_ray /= np.linalg.norm(rays, axis=1)
        assert off_ray[:exact].max() < 1e-12 * R
        assert off_ray.max() < 2e-5 * R


def test_the_quad_is_the_one_that_a_search_over_all_quads_finds():
    mesh = build_mesh(R, T, divisions=4, level=1, order=1)
    rays = directions(300)
    corners = mesh.points_nc[mesh.outer_qn]
    # Inside the spherical polygon: on the inner side of the plane through the centre
    # and each edge.
    planes = np.cross(corners, np.roll(corners, -1, axis=1))
    inside = np.all(np.einsum("qec,dc->dqe", planes, rays) >= 0, axis=2)
    assert np.all(inside.sum(axis=1) == 1)
    np.testing.assert_array_equal(locate(mesh, rays)[0], np.argmax(inside, axis=1))


def test_answers_do_not_depend_on_what_else_is_asked_for():
    mesh = build_mesh(R, T)
    rays = directions(20_000)
    quads, weights_dn = locate(mesh, rays)

    for pick in (slice(0, 1), slice(16_380, 16_390), slice(19_999, None)):
        alone = locate(mesh, rays[pick])
        np.testing.assert_array_equal(alone[0], quads[pick])
        np.testing.assert_allclose(alone[1], weights_dn[pick], atol=1e-13)

    assert locate(mesh, rays[:0])[0].shape == (0,)


@pytest.mark.parametrize(
    "ray", [[0.0, 0.0, -1.0], [1.0, 0.0, -1e-6], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]]
)
def test_a_direction_that_misses_the_half_sphere_is_an_input_error(
    ray: list[float],
):
    mesh = build_mesh(R, T, divisions=2, level=0)
    with pytest.raises(InputError, match="direction"):
        locate(mesh, np.array([[0.0, 0.0, 1.0], ray]))


def test_a_mesh_whose_elements_are_turned_inside_out_is_refused():
    mesh = build_mesh(R, T, divisions=2, level=0)
    with pytest.raises(SolverError, match="negative volume"):
        LinearWall(replace(mesh, points_nc=-mesh.points_nc), 0.45)
