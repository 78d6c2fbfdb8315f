"""Eyes that are not spheres, walls that are not even, and the cornea."""

from functools import cache
from math import asin, radians, sqrt

import numpy as np
import pytest

from scleraforce.base.errors import InputError, StudyError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.hexahedral_mesh import HexMesh, locate
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.uneven_form import (
    corneal_surface,
    modulus_factor,
    thickness_factor,
)
from scleraforce.records.study import (
    FormStudy,
    MeshStudy,
    Study,
    SupportsStudy,
    parse_study,
)
from scleraforce.records.study_of_eye import CorneaStudy, RegionStudy, WaveStudy

R = 12e-3
T = 0.6e-3
CONTACT = Contact(polar_rad=radians(48), azimuth_rad=0.7)
AXES = (1.06, 0.97, 0.94)
WAVES = (
    WaveStudy(
        amplitude_fraction=0.12, degree=2, polar_rad=radians(60), azimuth_rad=0.3
    ),
    WaveStudy(
        amplitude_fraction=-0.05, degree=3, polar_rad=radians(20), azimuth_rad=2.0
    ),
)
COARSE = MeshStudy(kind="graded", core=2, rings=6)


@cache
def bent_mesh(form: FormStudy, whole: bool = False) -> HexMesh:
    """The undeformed mesh of an eye that was bent, which its elements must allow."""
    supports = SupportsStudy(kind="bed" if whole else "clamped")
    study = Study(mesh=COARSE, form=form, supports=supports)
    wall = {"thickness_m": T, "youngs_modulus_pa": 0.3e6, "iop_pa": 0.0}
    return bend_eye(study, CONTACT, PathEnd(max_tip_m=1e-6), **wall).mesh


def back_on_the_axes(mesh: HexMesh, surface_nc: np.ndarray) -> np.ndarray:
    """The nodes in the form's own frame, by the rigid motion that fits the outer
    surface best.
    """
    outer = np.unique(mesh.outer_qn)
    moved = mesh.points_nc[outer]
    target = surface_nc[outer]
    shift = moved.mean(axis=0)
    aim = target.mean(axis=0)
    # Kabsch: the best rotation
    u, _, vt = np.linalg.svd((moved - shift).T @ (target - aim))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt

    return (mesh.points_nc - shift) @ turn + aim


def outer_and_inner(mesh: HexMesh, nodes_nc: np.ndarray) -> tuple[np.ndarray, ...]:
    """Nodes of both surfaces, which are numbered alike."""
    return tuple(nodes_nc[np.unique(nodes)] for nodes in (mesh.outer_qn, mesh.inner_qn))


@pytest.mark.parametrize(
    ("waves", "whole"), [((), True), (WAVES, False)], ids=["globe", "waves"]
)
def test_the_outer_nodes_lie_on_the_ellipsoid_and_the_wall_is_as_thick_as_asked_for(
    waves: tuple[WaveStudy, ...], whole: bool
):
    form = FormStudy(semi_axes=AXES, wave=waves)
    mesh = bent_mesh(form, whole)
    own_nc = back_on_the_axes(mesh, mesh.sphere_nc * AXES)
    outer, inner = outer_and_inner(mesh, own_nc)
    np.testing.assert_allclose(
        np.sum((outer / np.multiply(AXES, R)) ** 2, axis=1), 1.0, rtol=1e-10
    )
    # along the normal of the ellipsoid
    wall = outer - inner
    sphere = mesh.sphere_nc[np.unique(mesh.outer_qn)] / R
    np.testing.assert_allclose(
        np.linalg.norm(wall, axis=1), T * thickness_factor(form, sphere), rtol=1e-10
    )
    normal = outer / np.square(AXES)
    off = np.cross(wall, normal / np.linalg.norm(normal, axis=1, keepdims=True))
    assert np.abs(off).max() < 1e-12


FORMS = {
    "ellipsoid": FormStudy(semi_axes=AXES, wave=WAVES),
    "cornea": FormStudy(semi_axes=(1.05, 1.0, 0.97), cornea=CorneaStudy()),
}


@pytest.mark.parametrize("name", FORMS)
def test_the_contact_and_its_normal_are_where_the_sphere_has_them(name: str):
    mesh = bent_mesh(FORMS[name])
    polar = CONTACT.polar_rad
    azimuth = CONTACT.azimuth_rad
    beside = [(polar, azimuth), (polar + 1e-4, azimuth), (polar, azimuth + 1e-4)]
    rays = [Contact(polar_rad=a, azimuth_rad=b).normal for a, b in beside]
    quads, weights_pn = locate(mesh, np.array(rays))
    points = np.einsum("pn,pnc->pc", weights_pn, mesh.points_nc[mesh.outer_qn[quads]])
    np.testing.assert_allclose(points[0], R * CONTACT.normal, atol=1e-7)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    np.testing.assert_allclose(
        normal / np.linalg.norm(normal), CONTACT.normal, atol=5e-3
    )


def test_thickness_waves_are_legendre_polynomials_of_the_angle_to_their_axis():
    x = np.linspace(-1, 1, 7)
    d = np.stack([np.sqrt(1 - x**2), 0 * x, x], axis=-1)
    by_degree = {1: x, 2: (3 * x**2 - 1) / 2, 3: (5 * x**3 - 3 * x) / 2}

    for degree, legendre in by_degree.items():
        form = FormStudy(wave=(WaveStudy(amplitude_fraction=0.2, degree=degree),))
        np.testing.assert_allclose(
            thickness_factor(form, d), 1 + 0.2 * legendre, atol=1e-15
        )

    sideways = WaveStudy(
        amplitude_fraction=0.2,
        degree=1,
        polar_rad=radians(90),
        azimuth_rad=radians(90),
    )
    np.testing.assert_allclose(
        thickness_factor(FormStudy(wave=(sideways,)), np.eye(3)),
        [1.0, 1.2, 1.0],
        atol=1e-15,
    )


LIMBUS_RAD = asin(5.75 / 12)


def meridian(angles_rad: np.ndarray) -> np.ndarray:
    """Directions in the plane of x and z."""
    return np.stack([np.sin(angles_rad), 0 * angles_rad, np.cos(angles_rad)], axis=-1)


def test_a_region_has_its_modulus_inside_and_the_eyes_outside_with_a_smooth_edge():
    region = RegionStudy(
        modulus_ratio=0.6, half_angle_rad=LIMBUS_RAD, edge_rad=radians(4)
    )
    form = FormStudy(region=(region,))
    near = LIMBUS_RAD + np.radians(np.linspace(-3.0, 3.0, 601))
    values = modulus_factor(form, meridian(near))
    np.testing.assert_allclose(
        values[[0, 90, 300, 510, 600]], [0.6, 0.6, 0.8, 1.0, 1.0], atol=1e-12
    )
    assert np.all(np.diff(values) >= 0)
    assert np.abs(np.diff(values, 2)).max() < 3e-5  # no kink


CENTRE_M = sqrt(12**2 - 5.75**2) * 1e-3 - sqrt(7.8**2 - 5.75**2) * 1e-3
HALF_EDGE_RAD = 1.0 / 12
PLACES = {
    "on the axis": CorneaStudy(),
    "aside": CorneaStudy(polar_rad=0.3, azimuth_rad=2.0),
}


@pytest.mark.parametrize(("place", "whole"), [("on the axis", False), ("aside", True)])
def test_a_cornea_is_a_sphere_through_the_limbus_and_the_globe_outside_is_the_globe(
    place: str, whole: bool
):
    cornea = PLACES[place]
    axis = Contact(polar_rad=cornea.polar_rad, azimuth_rad=cornea.azimuth_rad).normal
    mesh = bent_mesh(FormStudy(cornea=cornea), whole)
    outer, inner = outer_and_inner(mesh, mesh.points_nc)
    sphere = mesh.sphere_nc[np.unique(mesh.outer_qn)]
    angles = np.arccos(np.clip(sphere @ axis / R, -1.0, 1.0))
    inside = angles < LIMBUS_RAD - HALF_EDGE_RAD
    outside = angles > LIMBUS_RAD + HALF_EDGE_RAD  # the contact is there, too
    assert min(np.count_nonzero(inside), np.count_nonzero(outside)) > 8
    np.testing.assert_allclose(outer[outside], sphere[outside], atol=1e-15)
    to_centre = outer[inside] - CENTRE_M * axis
    np.testing.assert_allclose(np.linalg.norm(to_centre, axis=1), 7.8e-3, rtol=1e-12)
    np.testing.assert_allclose(
        outer[inside] - inner[inside], T / 7.8e-3 * to_centre, atol=1e-15
    )
    np.testing.assert_allclose(np.linalg.norm(outer - inner, axis=1), T, rtol=1e-12)


def test_semi_axes_stretch_the_cornea_too():
    axes = FORMS["cornea"].semi_axes
    plain = bent_mesh(FormStudy(cornea=CorneaStudy())).points_nc * axes
    mesh = bent_mesh(FORMS["cornea"])
    (own, _), (expected, _) = (
        outer_and_inner(mesh, nodes_nc)
        for nodes_nc in (back_on_the_axes(mesh, plain), plain)
    )
    np.testing.assert_allclose(own, expected, atol=1e-12)


@pytest.mark.parametrize(
    "cornea",
    [
        CorneaStudy(),
        CorneaStudy(radius_m=16e-3, limbus_radius_m=6e-3),
        CorneaStudy(radius_m=R),
    ],
    ids=["steep", "flat", "the globe's own"],
)
def test_the_surface_has_no_kink_and_its_normals_are_its_own(
    cornea: CorneaStudy,
):
    angles = np.linspace(0.0, 0.9, 40_001)
    points, normals = corneal_surface(meridian(angles), cornea, R)
    along = np.gradient(points, angles, axis=0)[1:-1]
    assert np.abs(np.sum(along * normals[1:-1], axis=1)).max() < 1e-4 * R
    turned = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    # the curvature is finite: a kink would turn by 0.33 rad at once
    assert turned.max() < 6.0 * np.diff(angles)[0]
    rise = np.abs(np.linalg.norm(points, axis=1) - R)
    assert (rise.max() < 1e-15) == (cornea.radius_m == R)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[[form.wave]]\namplitude_percent = 12.0\ndegree = 4\n",
            r"degree: 4 is above",
        ),
        ("[form]\nsemi_axes = [1.0, 1.0]\n", "three ratios"),
        (
            "[[form.wave]]\namplitude_percent = 30.0\n"
            "[[form.wave]]\namplitude_percent = -30.0\n",
            "add up",
        ),
        ("[form.cornea]\nradius_mm = 1.0\n", r"radius_mm: 1 is below"),
        ("[form.cornea]\nradius_mm = 5.0\n", r"limbus_radius_mm: 5\.75; .* below"),
    ],
)
def test_a_form_out_of_range_is_refused(text: str, message: str):
    with pytest.raises(StudyError, match=message):
        parse_study(text)


@pytest.mark.parametrize(
    ("cornea", "message"),
    [
        (
            CorneaStudy(radius_m=14e-3, limbus_radius_m=13e-3),
            "limbus_radius_mm: 13 mm; must be below .*, 12 mm",
        ),
        (
            CorneaStudy(limbus_radius_m=1e-3, edge_m=3e-3),
            "edge_mm: 3 mm; must be narrower than the cornea",
        ),
        (
            CorneaStudy(polar_rad=radians(60)),
            "polar_deg: 60; the limbus must lie above the base",
        ),
    ],
)
def test_a_cornea_that_does_not_fit_the_globe_is_refused(
    cornea: CorneaStudy, message: str
):
    with pytest.raises(InputError, match=rf"^form\.cornea: .*{message}"):
        bent_mesh(FormStudy(cornea=cornea))
