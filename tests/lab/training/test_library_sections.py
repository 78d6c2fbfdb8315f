"""Sections of virtual eyes from the library, with the motion of the base."""

from dataclasses import replace
from math import radians

import analytic_library as analytic
import numpy as np
import pytest
from analytic_frames import LIBRARY, middling_eye

from predicted_walls import Walls, formed_wall
from reference_walls import shift_in_plane
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.lab.training.library_sections import LibrarySections, library_eye
from scleraforce.lab.virtual_eye import scan_plane, simulate_eye
from scleraforce.library import Library
from scleraforce.library.moving_base import pole_directions
from scleraforce.mechanics.axisymmetric_wall import EvenWall, base_shift
from scleraforce.mechanics.contact_and_section import Contact, WallSection
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from virtual_eyes import changed, wall_of

STUDY = Study()


@pytest.fixture(scope="module")
def library() -> Library:
    return LIBRARY


# on the pole: the made-up eye is one of revolution
STATED = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.0),
)
MODULUS_PA = 0.27e6


def tip_m(force_n: float, stated: Setup = STATED) -> float:
    """The first tip at which the made-up eye carries a force, on a fine grid."""
    tips = np.linspace(0.0, 7.4e-3, 200_000)
    forces = MODULUS_PA * analytic.force_ratio(
        wall_of(stated).thickness_m, wall_of(stated).iop_pa / MODULUS_PA, tips
    )
    return float(tips[np.argmax(forces >= force_n)])


def exact_section(force_n: float, stated: Setup = STATED) -> WallSection:
    """The made-up eye's section, from the closed form at thousands of rings."""
    rings = np.linspace(0.0, np.pi / 2 - 1e-3, 4000)
    walls = analytic.curves(
        wall_of(stated).thickness_m,
        wall_of(stated).iop_pa / MODULUS_PA,
        tip_m(force_n, stated),
        rings,
    )
    sides = []

    for distance, depth in np.moveaxis(walls, -1, 1):
        across = wall_of(stated).gap_m + np.tan(scan_plane(stated).tilt_rad) * depth
        seen = distance > across
        lateral = np.sqrt(distance[seen] ** 2 - across[seen] ** 2)
        down = depth[seen] / np.cos(scan_plane(stated).tilt_rad)
        sides.append(
            np.stack(
                [np.append(-lateral[::-1], lateral), np.append(down[::-1], down)],
                axis=1,
            )
        )

    return WallSection(*sides)


@pytest.mark.parametrize(
    ("force_n", "wall"),
    [
        (0.0, {}),
        (0.02, {}),
        (0.05, {}),
        (0.04, {"tilt_rad": 0.08}),
        (0.04, {"tilt_rad": -0.08}),
        (0.03, {"thickness_m": 0.6e-3, "gap_m": 0.8e-3, "iop_pa": 400.0}),
    ],
)
def test_sections_have_the_walls_own_geometry_and_depend_on_thickness_gap_and_pressure(
    library, force_n: float, wall: dict[str, float]
):
    stated = changed(STATED, **wall)
    model = library_eye(STUDY, changed(STATED, tilt_rad=stated.scan.tilt_rad), library)
    (curves,) = model.curves([stated_wall(stated, MODULUS_PA, force_n, 0.0)])
    exact = exact_section(force_n, stated)

    for mine, other in zip(curves, (exact.outer, exact.inner), strict=True):
        off_m = mine[:, 1] - np.interp(mine[:, 0], *other.T)
        assert np.abs(off_m).max() < 3e-6


def test_an_eye_that_the_library_does_not_have_is_refused(library):
    with pytest.raises(
        CalibrationError, match="1000 µm; the library has walls of 350 to 900 µm"
    ):
        library_eye(STUDY, changed(STATED, thickness_m=1e-3), library)
    with pytest.raises(CalibrationError, match="another radius"):
        library_eye(
            replace(STUDY, eye=replace(STUDY.eye, radius_m=11e-3)), STATED, library
        )


TURNED = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.65e-3, globe=OPEN),
    needle=Needle(gap_m=0.6e-3, polar_rad=radians(40)),
    scan=Scan(direction_rad=0.7),
)
FORCE_RATIO = 0.1e-6


@pytest.mark.slow
def test_along_the_plane_the_motion_is_that_of_the_shift(library):
    polar_rad = wall_of(TURNED).polar_rad
    gap_m = wall_of(TURNED).gap_m
    model = library_eye(STUDY, TURNED, library)
    moved = FORCE_RATIO * model.moves_bxc
    shift = base_shift(EvenWall(12e-3, 0.65e-3, 0.45, 0.35e-3), polar_rad)
    mesh = meridian_mesh(12e-3, 0.65e-3, 0.35e-3, np.pi / 2, MeridianSize())
    rings = np.stack(
        [mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)]
    )

    for side in (-1.0, 1.0):
        lateral_bn = side * np.sqrt(np.maximum(rings**2 - gap_m**2, 0.0))
        direction_rad = scan_plane(TURNED).direction_rad
        expected = shift_in_plane(
            shift, 0.0, FORCE_RATIO, lateral_bn, gap_m, direction_rad
        )

        for boundary in (0, 1):
            here = (rings[boundary] > gap_m) & (np.abs(lateral_bn[boundary]) < 6e-3)
            at = lateral_bn[boundary][here]

            for mine, theirs in ((0, 0), (2, 1)):
                found = np.interp(at, model.lateral_m, moved[boundary, :, mine])
                assert np.abs(found - expected[boundary, here, theirs]).max() < 1e-6


@pytest.mark.slow
def test_the_dent_moves_across_a_plane_that_lies_across_the_meridian(
    library,
):
    """As the tip does in 3-D: along the meridian, so across a plane whose lateral axis
    is the parallel.
    """
    contact = Contact(polar_rad=wall_of(TURNED).polar_rad)
    force_n = FORCE_RATIO * STUDY.eye.youngs_modulus_pa
    whole = simulate_eye(STUDY, 0.65e-3, force_n, contact)
    away_m = np.linalg.norm(whole.mesh.points_nc - 12e-3 * contact.normal, axis=1)
    tip = whole.needle_nc[np.argmin(away_m)]
    crosswise = changed(TURNED, gap_m=1e-6, direction_rad=radians(90))
    model = library_eye(STUDY, crosswise, library)
    moved = FORCE_RATIO * model.moves_bxc[0]
    along, across = (np.interp(0.0, model.lateral_m, moved[:, axis]) for axis in (0, 1))
    offset = np.cross(contact.normal, contact.parallel)
    assert across == pytest.approx(float(tip @ offset), rel=0.05)
    assert abs(across) > 20e-6
    assert along == pytest.approx(0.0, abs=1e-6)


def bulging_eye(
    direction_rad: float | None, lateral: np.ndarray
) -> tuple[Library, np.ndarray]:
    """A library, and the depths of a virtual eye (boundary, place)."""
    setup = Setup(
        eye=Eye(iop_pa=300.0, thickness_m=0.6e-3, globe=OPEN),
        needle=Needle(gap_m=0.5e-3, polar_rad=0.6),
        scan=Scan(direction_rad=direction_rad),
    )
    polar_rad = wall_of(setup).polar_rad
    library = (
        analytic.bulging(analytic.analytic_library())
        .within(0.9 * analytic.RADIUS_M)
        .for_contact(polar_rad)
    )
    nowhere = np.zeros((2, len(lateral), 3))
    sections = LibrarySections(setup, library, lateral, nowhere)
    wall = stated_wall(setup, 0.3e6, 1e-9, 0.6)
    return library, sections.curves([wall])[0, :, :, 1]


def fitted_depths(library: Library, lateral: np.ndarray, **pole: float) -> np.ndarray:
    """Both boundaries of the eye under 300 Pa as the fit sees them (boundary,
    place).
    """
    at_origin = {"lateral_m": 0.0, "depth_m": 0.0, "shine_m": 0.0}
    wall = {"gap_m": 0.5e-3, "thickness_m": 0.6e-3, "log_iop": np.log(300.0)}
    unknown = middling_eye(0.0, **at_origin, **wall, **pole)
    return np.array(
        [np.interp(lateral, *curve.T) for curve in formed_wall(Walls(library), unknown)]
    )


def test_virtual_eyes_and_fit_have_the_same_section():
    lateral = np.arange(-6e-3, 6.01e-3, 0.1e-3)
    library, theirs = bulging_eye(0.8, lateral)
    along, across = pole_directions(0.6, 0.8)
    leaning = fitted_depths(library, lateral, pole_along=along, pole_across=across)
    np.testing.assert_allclose(leaning, theirs, atol=3e-6)
    upright = np.abs(fitted_depths(library, lateral) - theirs)
    assert (upright.max(axis=1) > 10e-6).all()


@pytest.mark.parametrize(("direction", "even"), [(0.0, False), (None, True)])
def test_a_virtual_eye_without_a_direction_has_an_even_section(
    direction: float | None, even: bool
):
    _, depth = bulging_eye(direction, np.linspace(-6e-3, 6e-3, 121))
    uneven_m = np.abs(depth - depth[:, ::-1]).max()
    assert uneven_m < 1e-12 if even else uneven_m > 5e-6
