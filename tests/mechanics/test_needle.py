from dataclasses import replace

import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.loads import needle_at, needle_loads, tip_at
from scleraforce.mechanics.mesh import build_mesh

R, RADIUS = 12e-3, 0.35e-3
CONTACT = Contact(polar_rad=np.radians(35.0), azimuth_rad=0.4)


def tilted(angle_rad: float) -> np.ndarray:
    return -np.cos(angle_rad) * CONTACT.normal + np.sin(angle_rad) * CONTACT.meridian


def test_the_needle_along_the_normal_of_a_sphere_is_that_of_linear_mechanics() -> None:
    mesh = build_mesh(R, 0.5e-3)
    theirs = needle_loads(mesh, [CONTACT], RADIUS)[0]
    np.testing.assert_allclose(needle_at(mesh, CONTACT, RADIUS).load_nc, theirs, atol=1e-5 * np.abs(theirs).max())


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, 20.0])
def test_the_disc_is_round_and_centred_on_the_contact_as_seen_along_the_axis(angle_deg: float) -> None:
    """Shape functions of second order reproduce first moments of the load exactly and second ones nearly."""
    mesh, axis = build_mesh(R, 0.5e-3, divisions=20), tilted(np.radians(angle_deg))
    load = needle_at(mesh, CONTACT, RADIUS, axis).load_nc
    np.testing.assert_allclose(load.sum(axis=0), axis, atol=1e-12)
    amount = load @ axis
    across = np.cross(axis, CONTACT.parallel) / np.linalg.norm(np.cross(axis, CONTACT.parallel))
    for direction in (CONTACT.parallel, across):
        offset = (mesh.points_nc - R * CONTACT.normal) @ direction
        assert abs(amount @ offset) < 1e-3 * RADIUS
        assert amount @ offset**2 == pytest.approx(RADIUS**2 / 4, rel=0.02)  # of a uniform disc


def test_a_form_moves_the_disc_with_its_surface() -> None:
    mesh = build_mesh(R, 0.5e-3, divisions=20)
    stretch = np.array([1.06, 1.0, 0.95])
    shaped = replace(mesh, points_nc=mesh.points_nc * stretch, shaped_from_nc=mesh.points_nc)
    load = needle_at(shaped, CONTACT, RADIUS).load_nc
    amount = -load @ CONTACT.normal
    centre = R * CONTACT.normal * stretch
    for direction in (CONTACT.parallel, CONTACT.meridian):
        offset = (shaped.points_nc - centre) @ direction
        assert abs(amount @ offset) < 1e-3 * RADIUS
        assert amount @ offset**2 == pytest.approx(RADIUS**2 / 4, rel=0.02)


def test_the_tip_is_the_displacement_at_the_contact_along_the_axis() -> None:
    mesh, axis = build_mesh(R, 1e-3, divisions=6), tilted(0.1)
    inward = np.array([0.2, -0.1, 0.7])
    assert np.sum(tip_at(mesh, CONTACT, axis) * inward) == pytest.approx(inward @ axis)
    assert np.sum(tip_at(mesh, CONTACT, axis) * mesh.points_nc) == pytest.approx(R * CONTACT.normal @ axis, rel=1e-4)


@pytest.mark.parametrize("axis", [np.array([0.0, 0.0, -2.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])])
def test_an_axis_that_does_not_point_into_the_eye_is_an_input_error(axis: np.ndarray) -> None:
    with pytest.raises(InputError, match="unit vector"):
        needle_at(build_mesh(R, 1e-3, divisions=4), Contact(polar_rad=0.0), RADIUS, axis)


def test_a_needle_over_the_base_is_an_input_error_and_fine_on_a_whole_globe() -> None:
    with pytest.raises(InputError, match="over the base"):
        needle_at(build_mesh(R, 1e-3, divisions=4), Contact(polar_rad=1.56), RADIUS)
    globe = graded_mesh(R, 1e-3, Contact(polar_rad=1.0), rings=4, whole=True)
    assert needle_at(globe, Contact(polar_rad=1.56), RADIUS).load_nc.sum() != 0.0
