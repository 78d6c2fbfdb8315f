from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from scleraforce.errors import InputError, StudyError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import volume_points
from scleraforce.mechanics.graded import graded_mesh, study_mesh, supported_mesh
from scleraforce.mechanics.linear import LinearWall, tip_displacement
from scleraforce.mechanics.mesh import HexMesh
from scleraforce.mechanics.shapes import shape_values
from scleraforce.study import MeshStudy, Study, SupportsStudy

R, T = 12e-3, 0.5e-3
NEEDLE_RADIUS = 0.35e-3
CONTACTS = [
    Contact(polar_rad=0.0),
    Contact(polar_rad=radians(25), azimuth_rad=0.3),
    Contact(polar_rad=radians(50), azimuth_rad=4.0),
    Contact(polar_rad=radians(60), azimuth_rad=-1.0),
]
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}


def tip_of(mesh: HexMesh, contact: Contact) -> float:
    wall = LinearWall(mesh, 0.45)
    return tip_displacement(mesh, contact, wall.needle_cnc([contact], NEEDLE_RADIUS)[0])


def directions(count: int, whole: bool) -> np.ndarray:
    rays = np.random.default_rng(0).normal(size=(count, 3))
    if not whole:
        rays[:, 2] = np.abs(rays[:, 2])
    return rays


@pytest.mark.parametrize("contact", CONTACTS[:3], ids=str)
@pytest.mark.parametrize("kind", KINDS)
def test_elements_are_positive_and_fill_the_shell(kind: str, contact: Contact) -> None:
    tolerance = {"8 nodes": 8e-2, "27 nodes": 5e-4}[kind]  # far elements are large
    half = 2.0 / 3.0 * pi * (R**3 - (R - T) ** 3)
    for mesh, volume in ((graded_mesh(R, T, contact, **KINDS[kind]), half),
                         (graded_mesh(R, T, contact, **KINDS[kind], whole=True), 2.0 * half)):  # fmt: skip
        volumes = volume_points(mesh).volumes_ep  # raises where a Jacobian is not positive
        assert volumes.sum() == pytest.approx(volume, rel=tolerance)
        assert len(np.unique(mesh.cells_en)) == len(mesh.points_nc)
        assert len(np.unique(np.round(mesh.points_nc / R, 9), axis=0)) == len(mesh.points_nc)


def test_the_grading_follows_the_contact_and_turns_with_its_azimuth() -> None:
    contact = Contact(polar_rad=radians(35), azimuth_rad=1.0)
    mesh = graded_mesh(R, T, contact)
    sizes = np.sqrt(volume_points(mesh).volumes_ep.sum(axis=1) / T)
    middles = mesh.points_nc[mesh.cells_en].mean(axis=1)
    distance = np.linalg.norm(middles - R * contact.normal, axis=1)
    assert sizes[distance < 1e-3].max() < 0.4e-3
    assert sizes[distance > 8e-3].min() > 0.7e-3
    straight = graded_mesh(R, T, Contact(polar_rad=contact.polar_rad))
    s, c = np.sin(1.0), np.cos(1.0)
    turned = straight.points_nc @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mesh.points_nc, turned, atol=1e-15)


@pytest.mark.parametrize("contact", CONTACTS, ids=str)
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("grid", [{"core": 4, "rings": 8}, {}, {"core": 8, "rings": 30}], ids=str)
def test_directions_are_found_inside_their_quads(whole: bool, contact: Contact, grid: dict) -> None:
    mesh = graded_mesh(R, T, contact, **grid, whole=whole)
    rays = directions(5_000, whole)
    rays = np.concatenate([rays, mesh.points_nc[np.unique(mesh.outer_qn)]])  # nodes: where quads meet
    quads, local = mesh.locator.locate(rays)
    assert np.abs(local).max() <= 1.0
    for surface_qn in (mesh.outer_qn, mesh.inner_qn):
        points = np.einsum("pn,pnc->pc", shape_values(local, surface_qn.shape[1]), mesh.points_nc[surface_qn[quads]])
        assert np.all(np.sum(points * rays, axis=1) > 0)
        off_ray = np.linalg.norm(np.cross(points, rays), axis=1) / np.linalg.norm(rays, axis=1)
        assert off_ray.max() < 1e-12 * R


def test_a_globe_has_no_base_and_is_closed() -> None:
    mesh = graded_mesh(R, T, CONTACTS[1], whole=True)
    assert len(mesh.base_nodes) == 0
    sides = np.sort(np.stack([mesh.outer_qn[:, :4], np.roll(mesh.outer_qn[:, :4], -1, axis=1)], axis=-1), axis=-1)
    _, count = np.unique(sides.reshape(-1, 2), axis=0, return_counts=True)
    assert np.all(count == 2)
    upper = graded_mesh(R, T, CONTACTS[1])
    assert len(upper.cells_en) < len(mesh.cells_en) < 2 * len(upper.cells_en)


@pytest.mark.slow
@pytest.mark.parametrize("thickness_m", [0.4e-3, 0.8e-3])
@pytest.mark.parametrize("polar_deg", [0.0, 50.0])
def test_the_linear_tip_is_within_half_a_percent_of_a_fine_mesh(thickness_m: float, polar_deg: float) -> None:
    contact = Contact(polar_rad=radians(polar_deg), azimuth_rad=0.3)
    fine = tip_of(graded_mesh(R, thickness_m, contact, core=10, rings=24), contact)
    assert tip_of(graded_mesh(R, thickness_m, contact), contact) == pytest.approx(fine, rel=5e-3)


def test_a_study_chooses_the_graded_mesh() -> None:
    study = Study(mesh=MeshStudy(kind="graded", core=4, rings=8))
    mesh = study_mesh(study, T, CONTACTS[1])
    np.testing.assert_array_equal(mesh.points_nc, graded_mesh(R, T, CONTACTS[1], core=4, rings=8).points_nc)
    with pytest.raises(InputError, match="several"):
        study_mesh(study, T)
    with pytest.raises(StudyError, match="core: 5 is odd"):
        MeshStudy(core=5)


def test_a_mesh_that_does_not_exist_is_an_input_error() -> None:
    for name, value, message in (("contact", Contact(polar_rad=radians(65)), "polar angle: 65 deg"),
                                 ("core", 3, "core 3"), ("rings", 0, "rings 0"),
                                 ("thickness_m", 7e-3, "thickness"), ("layers", 0, "layers 0")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            graded_mesh(**{"radius_m": R, "thickness_m": T, "contact": CONTACTS[0], name: value})


CONTACT = Contact(polar_rad=0.6)
GRADED = MeshStudy(kind="graded", core=2, rings=4)


@pytest.mark.parametrize("kind", ["bed", "bed-and-straps"])
def test_a_bed_carries_a_whole_globe(kind: str) -> None:
    mesh = supported_mesh(Study(mesh=GRADED, supports=SupportsStudy(kind=kind)), 0.5e-3, CONTACT)
    assert mesh.points_nc[:, 2].min() == pytest.approx(-12e-3, rel=1e-2)
    assert len(mesh.base_nodes) == 0


@pytest.mark.parametrize("kind", ["clamped", "straps"])
def test_any_other_support_leaves_the_studys_mesh(kind: str) -> None:
    study = Study(mesh=GRADED, supports=SupportsStudy(kind=kind))
    expected = study_mesh(study, 0.5e-3, CONTACT)
    np.testing.assert_array_equal(supported_mesh(study, 0.5e-3, CONTACT).points_nc, expected.points_nc)


def test_a_bed_needs_a_graded_mesh() -> None:
    with pytest.raises(InputError, match="whole globe"):
        supported_mesh(Study(mesh=MeshStudy(kind="hexahedra"), supports=SupportsStudy(kind="bed")), 0.5e-3, CONTACT)


def same_mesh(study: Study, other: MeshStudy, contact: Contact, *, alone: bool) -> bool:
    mesh = supported_mesh(study, T, contact, alone=alone)
    return np.array_equal(mesh.points_nc, supported_mesh(replace(study, mesh=other), T, contact).points_nc)


def test_an_automatic_mesh_is_graded_for_one_contact_alone_or_a_bed() -> None:
    graded, even = MeshStudy(kind="graded"), MeshStudy(kind="hexahedra")
    assert same_mesh(Study(), graded, CONTACT, alone=True)
    assert same_mesh(Study(supports=SupportsStudy(kind="bed")), graded, CONTACT, alone=False)
    assert same_mesh(Study(), even, CONTACT, alone=False)
    assert same_mesh(Study(), even, Contact(polar_rad=radians(65.0)), alone=True)  # a graded mesh does not reach there
    for stated in (even, MeshStudy(divisions=8), MeshStudy(level=0)):  # their study decides
        assert same_mesh(Study(mesh=stated), replace(stated, kind="hexahedra"), CONTACT, alone=True)
