"""The needle's load, beds and straps: exact resultants, moments and motions."""

from dataclasses import replace

import numpy as np
import pytest

from reference_r1 import gaussian_load
from scleraforce.base.errors import InputError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.graded_mesh import supported_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.loads_and_supports import (
    needle_at,
    needle_loads,
    study_springs,
)
from scleraforce.records.study import MeshStudy, Study, SupportsStudy

R = 12e-3
T = 0.5e-3
NU = 0.45
E = 0.3e6
NEEDLE = 0.35e-3
LEANING = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)
STRETCH = np.array([1.06, 1.0, 0.95])


@pytest.fixture(scope="module")
def fine_mesh() -> HexMesh:
    return build_mesh(R, T, divisions=20)


def assert_disc(load_nc: np.ndarray, offset_nc: np.ndarray, axis: np.ndarray) -> None:
    """Check that 1 N acts along an axis, uniformly over the needle's disc as seen along
    it.

    Shape functions of second order reproduce first moments of the load exactly and
    second ones nearly.
    """
    np.testing.assert_allclose(load_nc.sum(axis=0), axis, atol=1e-12)
    amount = load_nc @ axis
    first = np.cross(axis, LEANING.parallel)
    first /= np.linalg.norm(first)
    for direction in (first, np.cross(axis, first)):
        offset = offset_nc @ direction
        assert abs(amount @ offset) < 1e-3 * NEEDLE
        # of a uniform disc
        assert amount @ offset**2 == pytest.approx(NEEDLE**2 / 4, rel=0.02)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0])
def test_the_disc_is_round_and_centred_on_the_contact_as_seen_along_the_axis(
    fine_mesh, angle_deg: float
):
    axis = LEANING.leaning_axis(np.radians(angle_deg), 0.0)
    load_nc = needle_at(fine_mesh, LEANING, NEEDLE, axis).load_nc
    assert_disc(load_nc, fine_mesh.points_nc - R * LEANING.normal, axis)


def test_a_form_moves_the_disc_with_its_surface(fine_mesh):
    shaped = replace(
        fine_mesh,
        points_nc=fine_mesh.points_nc * STRETCH,
        shaped_from_nc=fine_mesh.points_nc,
    )
    load_nc = needle_at(shaped, LEANING, NEEDLE).load_nc
    offset_nc = shaped.points_nc - R * LEANING.normal * STRETCH
    assert_disc(load_nc, offset_nc, -LEANING.normal)


@pytest.mark.parametrize(
    "contact",
    [LEANING, Contact(polar_rad=0.0), Contact(polar_rad=1.4, azimuth_rad=-2.0)],
    ids=["beside the pole", "pole", "near the base"],
)
def test_the_needle_of_linear_mechanics_acts_over_its_disc(fine_mesh, contact: Contact):
    (load_nc,) = needle_loads(fine_mesh, [contact], NEEDLE)
    np.testing.assert_allclose(
        load_nc, needle_at(fine_mesh, contact, NEEDLE).load_nc, atol=1e-5
    )


def test_the_tip_is_the_displacement_at_the_contact_along_the_needle():
    mesh = build_mesh(R, 1e-3, divisions=6)
    # A field that grows along the wall shows that the point is the contact.
    growing_nc = mesh.points_nc * [1.0, 2.0, 3.0]
    expected_m = -R * LEANING.normal**2 @ [1.0, 2.0, 3.0]
    assert tip_displacement(mesh, LEANING, growing_nc) == pytest.approx(
        expected_m, rel=1e-4
    )


@pytest.mark.parametrize("polar_deg", [89.0, 90.0, 120.0])
def test_a_needle_that_reaches_over_the_base_is_an_input_error(
    polar_deg: float,
):
    wall = LinearWall(build_mesh(R, T, divisions=4, level=0), NU)
    contacts = [Contact(polar_rad=0.5), Contact(polar_rad=np.radians(polar_deg))]
    with pytest.raises(InputError, match=r"polar angle.*over the base"):
        wall.needle_cnc(contacts, NEEDLE)


@pytest.mark.parametrize("axis", [[0.0, 0.0, -2.0], [0.0, 0.0, 1.0]], ids=str)
def test_an_axis_that_is_no_unit_vector_into_the_eye_is_refused(
    fine_mesh, axis: list[float]
):
    with pytest.raises(InputError, match="unit vector"):
        needle_at(fine_mesh, Contact(polar_rad=0.0), NEEDLE, np.array(axis))


NORMAL = 1.4e6
SHEAR = 0.04e6
BED = SupportsStudy(
    kind="bed",
    bed_stiffness_pa_per_m=NORMAL,
    bed_shear_stiffness_pa_per_m=SHEAR,
    strap_stiffness_n_per_m=20.0,
    medial_azimuth_rad=0.3,
)
STRAPS = replace(BED, kind="straps")


@pytest.fixture(scope="module")
def globe() -> HexMesh:
    study = Study(mesh=MeshStudy(kind="graded", core=2, rings=8), supports=BED)
    return supported_mesh(study, 0.8e-3, LEANING)


def held_by(mesh: HexMesh, supports: SupportsStudy, moved_nc: np.ndarray) -> np.ndarray:
    return study_springs(supports, mesh).forces(
        np.broadcast_to(moved_nc, mesh.points_nc.shape)
    )


def work(mesh: HexMesh, supports: SupportsStudy, moved_nc: np.ndarray) -> float:
    return float(np.sum(held_by(mesh, supports, moved_nc) * moved_nc))


@pytest.mark.parametrize("axis", np.eye(3), ids="xyz")
def test_the_beds_stiffness_is_that_of_the_integrals_over_the_half_sphere(
    globe, axis: np.ndarray
):
    """The mean of each squared component of the normal is 1/3; a turn slides
    everywhere, by 2/3 R^2 of its square.
    """
    area = 2 * np.pi * R**2
    assert work(globe, BED, axis) == pytest.approx(
        area * (NORMAL + 2 * SHEAR) / 3, rel=6e-3
    )
    assert work(globe, BED, np.cross(axis, globe.points_nc)) == pytest.approx(
        area * SHEAR * R**2 * 2 / 3, rel=6e-3
    )
    forces_nc = held_by(globe, BED, axis)
    outer_below = np.unique(globe.outer_qn)
    outer_below = outer_below[globe.points_nc[outer_below, 2] < 1e-9]
    assert not np.delete(forces_nc, outer_below, axis=0).any()


# Apt 1980: mm behind the limbus along the spiral of Tillaux, mm of width, and the
# quarter turn from the medial rectus
INSERTIONS = {
    "medial": (5.5, 10.3, 0),
    "superior": (7.7, 10.6, 1),
    "lateral": (6.9, 9.2, 2),
    "inferior": (6.5, 9.8, 3),
}


def test_four_straps_hold_along_their_meridians(globe):
    """Naive sum over many points of each insertion's arc."""
    motion = np.array([0.3, -0.5, 0.8])
    expected = 0.0

    for behind_mm, width_mm, turns in INSERTIONS.values():
        polar = np.arcsin(5.75 / 12.0) + behind_mm / 12.0
        half_arc = 0.5 * width_mm / 12.0 / np.sin(polar)
        along_pc = np.array(
            [
                Contact(polar_rad=polar, azimuth_rad=azimuth).meridian
                for azimuth in 0.3
                + 0.5 * np.pi * turns
                + np.linspace(-half_arc, half_arc, 2001)
            ]
        )
        expected += 20.0 * np.mean((along_pc @ motion) ** 2)

    assert work(globe, STRAPS, motion) == pytest.approx(expected, rel=2e-3)
    # a turn about z slides across
    turn_nc = np.cross([0.0, 0.0, 1.0], globe.points_nc)
    assert work(globe, STRAPS, turn_nc) < 1e-6 * R**2


def test_a_bed_and_straps_hold_together_and_a_clamped_eye_has_no_springs(
    globe,
):
    moved_nc = np.random.default_rng(1).normal(size=globe.points_nc.shape)
    both = held_by(globe, replace(BED, kind="bed-and-straps"), moved_nc)
    np.testing.assert_allclose(
        both,
        held_by(globe, BED, moved_nc) + held_by(globe, STRAPS, moved_nc),
        atol=1e-12 * np.abs(both).max(),
    )
    assert study_springs(SupportsStudy(), globe) is None


def test_a_half_sphere_has_no_bed():
    with pytest.raises(InputError, match="lower half"):
        study_springs(BED, build_mesh(R, T, divisions=4, level=0))


@pytest.fixture(scope="module")
def pushed(globe: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    """A load on a globe on its bed, and its displacement at E."""
    load_nc = gaussian_load(globe, LEANING, NEEDLE)
    springs = study_springs(BED, globe)
    wall = LinearWall(globe, NU, springs=springs, springs_modulus_pa=E)
    return load_nc, wall.solve_one(load_nc) / E


def test_a_globe_on_a_bed_balances_its_load_with_the_beds_force(globe, pushed):
    load_nc, moved_nc = pushed
    rest_nc = held_by(globe, BED, moved_nc) - load_nc
    np.testing.assert_allclose(rest_nc.sum(axis=0), 0.0, atol=1e-8)
    moments = np.cross(globe.points_nc, rest_nc).sum(axis=0)
    np.testing.assert_allclose(moments, 0.0, atol=1e-8 * R)
