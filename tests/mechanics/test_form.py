"""Eyes that are not spheres, walls that are not even, and the cornea."""

from dataclasses import replace
from math import asin, degrees, pi, radians, sqrt

import numpy as np
import pytest

from scleraforce.base.errors import InputError, StudyError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_elements import volume_points
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh, build_mesh, locate
from scleraforce.mechanics.uneven_form import (
    corneal_surface,
    element_modulus,
    form_mesh,
    modulus_factor,
    thickness_factor,
)
from scleraforce.records.study import FormStudy, parse_study
from scleraforce.records.study_of_eye import CorneaStudy, RegionStudy, WaveStudy

R = 12e-3
T = 0.6e-3
CONTACT = Contact(polar_rad=radians(35), azimuth_rad=0.7)
AXES = (1.06, 0.97, 0.94)
WAVY = FormStudy(
    wave=(
        WaveStudy(
            amplitude_fraction=0.12, degree=2, polar_rad=radians(60), azimuth_rad=0.3
        ),
        WaveStudy(
            amplitude_fraction=-0.05, degree=3, polar_rad=radians(20), azimuth_rad=2.0
        ),
    )
)


def back_on_the_axes(mesh: HexMesh, axes: tuple[float, ...]) -> np.ndarray:
    """The nodes in the ellipsoid's own frame, by the rigid motion that fits the base's
    rim best.
    """
    base = mesh.points_nc[mesh.base_nodes]
    sphere = mesh.sphere_nc[mesh.base_nodes]
    outer = np.linalg.norm(sphere, axis=1) > 0.9999 * R
    target = sphere[outer] * axes
    moved = base[outer]
    shift = moved.mean(axis=0)
    aim = target.mean(axis=0)
    # Kabsch: the best rotation
    u, _, vt = np.linalg.svd((moved - shift).T @ (target - aim))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt

    return (mesh.points_nc - shift) @ turn + aim


def test_a_plain_form_leaves_the_wall_unchanged() -> None:
    mesh = graded_mesh(R, T, CONTACT)
    eye = form_mesh(mesh, FormStudy(), CONTACT)
    np.testing.assert_allclose(eye.points_nc, mesh.points_nc, atol=1e-16)
    np.testing.assert_array_equal(element_modulus(eye, FormStudy()), 1.0)


def test_the_outer_nodes_lie_on_the_ellipsoid_and_the_wall_is_as_thick_as_asked_for():
    mesh = form_mesh(graded_mesh(R, T, CONTACT), FormStudy(semi_axes=AXES), CONTACT)
    own = back_on_the_axes(mesh, AXES)
    outer = own[np.unique(mesh.outer_qn)]
    inner = own[np.unique(mesh.inner_qn)]
    np.testing.assert_allclose(
        np.sum((outer / np.multiply(AXES, R)) ** 2, axis=1), 1.0, rtol=1e-12
    )
    # The nodes of both surfaces are numbered alike: inner minus outer is the wall,
    # along the normal of the ellipsoid.
    normal = outer / np.square(AXES)
    wall = outer - inner
    np.testing.assert_allclose(np.linalg.norm(wall, axis=1), T, rtol=1e-12)
    off = np.cross(wall, normal / np.linalg.norm(normal, axis=1, keepdims=True))
    assert np.abs(off).max() < 1e-15
    np.testing.assert_allclose(own[mesh.base_nodes, 2], 0.0, atol=1e-16)


@pytest.mark.parametrize("whole", [False, True])
def test_the_contact_and_its_normal_are_where_the_sphere_has_them(whole: bool) -> None:
    form = FormStudy(semi_axes=AXES, wave=WAVY.wave)
    mesh = form_mesh(
        graded_mesh(R, T, CONTACT, core=8, rings=24, whole=whole), form, CONTACT
    )
    angles = np.add(
        [CONTACT.polar_rad, CONTACT.azimuth_rad], [(0, 0), (1e-4, 0), (0, 1e-4)]
    )
    quads, weights_pn = locate(
        mesh, np.array([Contact(polar_rad=a, azimuth_rad=b).normal for a, b in angles])
    )
    points = np.einsum("pn,pnc->pc", weights_pn, mesh.points_nc[mesh.outer_qn[quads]])
    np.testing.assert_allclose(points[0], R * CONTACT.normal, atol=1e-9)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    np.testing.assert_allclose(
        normal / np.linalg.norm(normal), CONTACT.normal, atol=2e-4
    )


@pytest.mark.parametrize(
    "form",
    [FormStudy(semi_axes=AXES), WAVY, FormStudy(semi_axes=AXES, wave=WAVY.wave)],
    ids=str,
)
def test_the_volume_is_that_of_the_form(form: FormStudy) -> None:
    """Half an ellipsoid's wall: by a fine sum over latitude and longitude of area,
    thickness and curvature.
    """
    mesh = form_mesh(build_mesh(R, T), form, CONTACT)
    axes = np.array(form.semi_axes)
    count = 400
    u = (
        np.arange(count) + 0.5
    ) / count  # z of the direction: equal steps are equal areas of the sphere
    v = (np.arange(2 * count) + 0.5) * pi / count
    z, azimuth = np.meshgrid(u, v, indexing="ij")
    flat = np.sqrt(1 - z**2)
    d = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), z], axis=-1)
    normal = d / axes
    # Nanson: area of the ellipsoid over that of the sphere
    stretch = np.prod(axes) * np.linalg.norm(normal, axis=-1)
    h2 = 1.0 / np.sum(d**2 / axes**2, axis=-1)
    total = axes**2 @ np.ones(3)
    product = np.prod(axes**2)
    mean = (total - np.sum((axes * d) ** 2, axis=-1)) * h2**1.5 / (2 * product)
    gauss = h2**2 / product
    t = T * thickness_factor(form, d)
    # V = integral over the area of t - H t^2 + K t^3 / 3 (parallel surfaces),
    # curvatures of the unit ellipsoid over R
    thick = t - mean / R * t**2 + gauss / R**2 * t**3 / 3
    exact = 2 * pi * R**2 * np.mean(stretch * thick)
    assert volume_points(mesh).volumes_ep.sum() == pytest.approx(exact, rel=2e-4)


def test_thickness_waves_are_legendre_polynomials_of_the_angle_to_their_axis() -> None:
    x = np.linspace(-1, 1, 7)
    d = np.stack([np.sqrt(1 - x**2), 0 * x, x], axis=-1)
    by_degree = {1: x, 2: (3 * x**2 - 1) / 2, 3: (5 * x**3 - 3 * x) / 2}

    for degree, legendre in by_degree.items():
        form = FormStudy(wave=(WaveStudy(amplitude_fraction=0.2, degree=degree),))
        np.testing.assert_allclose(
            thickness_factor(form, d), 1 + 0.2 * legendre, atol=1e-15
        )

    sideways = replace(
        form.wave[0], degree=1, polar_rad=radians(90), azimuth_rad=radians(90)
    )
    np.testing.assert_allclose(
        thickness_factor(FormStudy(wave=(sideways,)), np.eye(3)),
        [1.0, 1.2, 1.0],
        atol=1e-15,
    )


def test_a_region_has_its_modulus_inside_and_the_eyes_outside_with_a_smooth_edge():
    cornea = RegionStudy(
        modulus_ratio=0.6, half_angle_rad=asin(5.75 / 12), edge_rad=radians(4)
    )
    form = FormStudy(region=(cornea,))
    edge = degrees(asin(5.75 / 12))
    polar = np.radians([0.0, edge - 2.1, edge, edge + 2.1, 80.0])
    d = np.stack([np.sin(polar), 0 * polar, np.cos(polar)], axis=-1)
    np.testing.assert_allclose(
        modulus_factor(form, d), [0.6, 0.6, 0.8, 1.0, 1.0], atol=1e-12
    )
    fine = np.radians(np.linspace(edge - 3, edge + 3, 601))
    values = modulus_factor(
        form, np.stack([np.sin(fine), 0 * fine, np.cos(fine)], axis=-1)
    )
    assert np.all(np.diff(values) >= 0)
    assert np.abs(np.diff(values, 2)).max() < 3e-5  # no kink
    eye = form_mesh(graded_mesh(R, T, CONTACT), form, CONTACT)
    per_point = element_modulus(eye, form)
    assert per_point.shape == (len(eye.cells_en), 27)
    assert per_point.min() == pytest.approx(0.6)
    assert per_point.max() == 1.0
    # regions are of the sphere
    stretched = FormStudy(AXES, region=(cornea,))
    mesh = graded_mesh(R, T, CONTACT)
    modulus_ep = element_modulus(form_mesh(mesh, stretched, CONTACT), stretched)
    np.testing.assert_array_equal(modulus_ep, element_modulus(mesh, stretched))
    volumes = volume_points(eye).volumes_ep
    soft = np.sum(volumes * (1 - per_point)) / 0.4 / volumes.sum()
    # share of a cap of the half-sphere's area
    assert soft == pytest.approx(1 - np.cos(asin(5.75 / 12)), rel=2e-2)


def test_a_form_out_of_range_is_refused() -> None:
    with pytest.raises(StudyError, match=r"degree: 4 is above"):
        parse_study("[form]\n[[form.wave]]\namplitude_percent = 12.0\ndegree = 4\n")

    with pytest.raises(StudyError, match="three ratios"):
        FormStudy(semi_axes=(1.0, 1.0))

    with pytest.raises(StudyError, match="add up"):
        FormStudy(
            wave=(WaveStudy(amplitude_fraction=0.3), WaveStudy(amplitude_fraction=-0.3))
        )


CORNEA = CorneaStudy()
FLAT = CorneaStudy(radius_m=16e-3, limbus_radius_m=6e-3)
LIMBUS_RAD = asin(5.75 / 12)
HALF_EDGE_RAD = 1.0 / 12
CENTRE_M = sqrt(12**2 - 5.75**2) * 1e-3 - sqrt(7.8**2 - 5.75**2) * 1e-3


def meridian(angles_rad: np.ndarray) -> np.ndarray:
    """Directions in the plane of x and z."""
    return np.stack([np.sin(angles_rad), 0 * angles_rad, np.cos(angles_rad)], axis=-1)


def test_the_cornea_is_a_sphere_through_the_limbus_and_the_globe_outside_is_the_globe():
    inside = np.linspace(0.0, LIMBUS_RAD - HALF_EDGE_RAD, 9)
    points, normals = corneal_surface(meridian(inside), CORNEA, R)
    centre = np.array([0.0, 0.0, CENTRE_M])
    np.testing.assert_allclose(
        np.linalg.norm(points - centre, axis=1), 7.8e-3, rtol=1e-12
    )
    np.testing.assert_allclose(normals, (points - centre) / 7.8e-3, atol=1e-12)
    # the apex, 1.06 mm in front
    np.testing.assert_allclose(points[0], [0.0, 0.0, CENTRE_M + 7.8e-3], atol=1e-15)
    ring = R * meridian(np.array([LIMBUS_RAD]))
    # the two spheres meet here
    np.testing.assert_allclose(
        np.linalg.norm(ring - centre, axis=1), 7.8e-3, rtol=1e-12
    )
    outside = meridian(np.linspace(LIMBUS_RAD + HALF_EDGE_RAD, 0.5 * pi, 9))
    points, normals = corneal_surface(outside, CORNEA, R)
    np.testing.assert_allclose(points, R * outside, rtol=1e-12)
    np.testing.assert_allclose(normals, outside, rtol=1e-12)


@pytest.mark.parametrize("cornea", [CORNEA, FLAT], ids=["steep", "flat"])
def test_the_surface_has_no_kink_and_its_normals_are_its_own(
    cornea: CorneaStudy,
) -> None:
    angles = np.linspace(0.0, 0.9, 40_001)
    points, normals = corneal_surface(meridian(angles), cornea, R)
    along = np.gradient(points, angles, axis=0)[1:-1]
    assert np.abs(np.sum(along * normals[1:-1], axis=1)).max() < 1e-4 * R
    turned = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    # the curvature is finite: a kink would turn by 0.33 rad at once
    assert turned.max() < 6.0 * np.diff(angles)[0]
    at_the_ends = np.array([LIMBUS_RAD - HALF_EDGE_RAD, LIMBUS_RAD + HALF_EDGE_RAD])

    for angle in at_the_ends:
        two = corneal_surface(meridian(angle + np.array([-1e-9, 1e-9])), CORNEA, R)
        np.testing.assert_allclose(two[0][0], two[0][1], atol=1e-10)
        np.testing.assert_allclose(two[1][0], two[1][1], atol=1e-7)


def test_a_cornea_of_the_globes_own_radius_changes_nothing() -> None:
    directions = meridian(np.linspace(0.0, 1.5, 31))
    points, normals = corneal_surface(directions, CorneaStudy(radius_m=R), R)
    np.testing.assert_allclose(points, R * directions, atol=1e-15)
    np.testing.assert_allclose(normals, directions, atol=1e-12)


def test_a_cornea_lies_about_its_own_axis() -> None:
    axis = Contact(polar_rad=0.5, azimuth_rad=2.0)
    aside = replace(CORNEA, polar_rad=0.5, azimuth_rad=2.0)
    points, normals = corneal_surface(axis.normal[None], aside, R)
    np.testing.assert_allclose(points[0], (CENTRE_M + 7.8e-3) * axis.normal, atol=1e-15)
    np.testing.assert_allclose(normals[0], axis.normal, atol=1e-12)


@pytest.mark.parametrize("polar_deg", [38.0, 46.0, 55.0])
@pytest.mark.parametrize("whole", [False, True])
def test_the_wall_behind_a_cornea_has_sound_elements_even_thickness_and_its_contact_in_place(
    whole, polar_deg
) -> None:
    contact = Contact(polar_rad=radians(polar_deg), azimuth_rad=0.7)
    sphere = graded_mesh(R, T, contact, core=8, rings=20, whole=whole)
    form = FormStudy(cornea=CORNEA)
    mesh = form_mesh(sphere, form, contact)
    outer = mesh.points_nc[np.unique(mesh.outer_qn)]
    inner = mesh.points_nc[np.unique(mesh.inner_qn)]
    np.testing.assert_allclose(np.linalg.norm(outer - inner, axis=1), T, rtol=1e-12)
    sizes = volume_points(mesh).volumes_ep / volume_points(sphere).volumes_ep
    assert sizes.min() > 0.5  # every Jacobian is positive, and far from 0
    assert sizes.max() < 2.0
    up = sphere.points_nc[:, 2] / np.linalg.norm(sphere.points_nc, axis=1)
    behind = np.arccos(up) > LIMBUS_RAD + HALF_EDGE_RAD  # the contact is there, too
    np.testing.assert_allclose(
        mesh.points_nc[behind], sphere.points_nc[behind], atol=1e-15
    )


def test_the_volume_of_the_wall_is_that_of_the_surface() -> None:
    """Of a surface of revolution: by a fine sum of area, thickness and curvatures along
    the meridian.
    """
    contact = Contact(polar_rad=radians(45))
    mesh = form_mesh(
        graded_mesh(R, T, contact, core=8, rings=28), FormStudy(cornea=CORNEA), contact
    )
    angles = np.linspace(0.0, 0.5 * pi, 100_001)
    points, normals = corneal_surface(meridian(angles), CORNEA, R)
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    middle = 0.5 * (points[1:] + points[:-1])
    across = 0.5 * (normals[1:] + normals[:-1])
    # principal curvatures
    along = np.sum(np.diff(normals, axis=0) * step, axis=1) / length**2
    around = across[:, 0] / middle[:, 0]
    thick = T - 0.5 * (along + around) * T**2 + along * around * T**3 / 3
    exact = 2 * pi * np.sum(middle[:, 0] * length * thick)
    assert volume_points(mesh).volumes_ep.sum() == pytest.approx(exact, rel=1e-3)


def test_semi_axes_stretch_the_cornea_too_and_waves_act_on_its_wall() -> None:
    contact = Contact(polar_rad=radians(45), azimuth_rad=0.3)
    wave = WaveStudy(amplitude_fraction=0.1, degree=1)
    plain = graded_mesh(R, T, contact)
    both = form_mesh(
        plain, FormStudy((1.05, 1.0, 0.97), (wave,), cornea=CORNEA), contact
    )
    outer = both.points_nc[np.unique(both.outer_qn)]
    inner = both.points_nc[np.unique(both.inner_qn)]
    up = plain.points_nc[np.unique(plain.outer_qn), 2] / R
    np.testing.assert_allclose(
        np.linalg.norm(outer - inner, axis=1), T * (1.0 + 0.1 * up), rtol=1e-12
    )
    stretched = form_mesh(plain, FormStudy(cornea=CORNEA), contact).points_nc[
        np.unique(plain.outer_qn)
    ]
    stretched = stretched * (1.05, 1.0, 0.97)
    # the rest is a rigid motion
    between = np.linalg.norm(stretched[::50, None] - stretched[None, ::50], axis=-1)
    np.testing.assert_allclose(
        np.linalg.norm(outer[::50, None] - outer[None, ::50], axis=-1),
        between,
        atol=1e-12,
    )


def test_a_cornea_that_does_not_fit_the_globe_is_refused() -> None:
    directions = meridian(np.array([0.1]))
    wide = CorneaStudy(radius_m=14e-3, limbus_radius_m=13e-3)

    with pytest.raises(
        InputError,
        match=r"^form\.cornea: limbus_radius_mm: 13 mm; must be below .*, 12 mm$",
    ):
        corneal_surface(directions, wide, R)

    with pytest.raises(
        InputError,
        match=(
            r"^form\.cornea: edge_mm: 3 mm; must be narrower than the cornea is wide$"
        ),
    ):
        corneal_surface(directions, CorneaStudy(limbus_radius_m=1e-3, edge_m=3e-3), R)

    with pytest.raises(
        InputError,
        match=(
            r"^form\.cornea: .*polar_deg: 60; the limbus must lie above the base plane$"
        ),
    ):
        corneal_surface(directions, CorneaStudy(polar_rad=radians(60)), R)

    with pytest.raises(
        StudyError, match=r"^study:2: form\.cornea\.radius_mm: 1 is below"
    ):
        parse_study("[form.cornea]\nradius_mm = 1.0\n")

    with pytest.raises(
        StudyError,
        match=(
            r"^study:1: form\.cornea\.limbus_radius_mm: 5\.75; .* below .*"
            r" radius_mm, 5$"
        ),
    ):
        parse_study("[form.cornea]\nradius_mm = 5.0\n")
