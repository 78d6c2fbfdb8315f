"""The wall beside the pole under the eye's pressure: motions that are known, and three
dimensions.
"""

import numpy as np
import pytest
from analytic_library import RADIUS_M, analytic_library, bulging

from predicted_walls import Walls, formed_wall
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.calibration.filter.library_sections import LibrarySections
from scleraforce.fit import unknowns
from scleraforce.library.moving_base import (
    base_bulge,
    base_push,
    pole_directions,
    undented_motion,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from virtual_eyes import wall_of

ANGLES = np.linspace(0.0, np.pi / 2, 91)
THICKNESS = np.array([0.6e-3])


def places(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors to places around the needle axis (1, 2, place, 3)."""
    found = rng.uniform(-0.4, 0.4, (1, 2, count, 3))
    found[..., 2] = np.sqrt(1.0 - found[..., 0] ** 2 - found[..., 1] ** 2)
    return found


def test_a_wall_that_is_lifted_is_lifted_along_the_eye_s_axis() -> None:
    motion = np.broadcast_to([0.0, 1e-4], (1, 2, 91, 2))
    moved = base_bulge(
        motion, ANGLES, places(np.random.default_rng(3), 50), np.array([[-0.3, 0.4]])
    )
    expected = 1e-4 * np.array([-0.3, 0.4, 1.0 - np.sqrt(1.0 - 0.25)])
    np.testing.assert_allclose(
        moved, np.broadcast_to(expected, moved.shape), atol=1e-12
    )


def test_the_motion_counts_from_the_sphere_at_rest() -> None:
    grown = 1e-4
    radii = RADIUS_M - np.array([0.0, 0.6e-3])[:, None] + grown
    undented = np.stack(
        [radii * np.sin(ANGLES), RADIUS_M - radii * np.cos(ANGLES)], axis=-1
    )[None]
    expected = np.broadcast_to(
        grown * np.stack([np.sin(ANGLES), np.cos(ANGLES)], -1), (1, 2, 91, 2)
    )
    np.testing.assert_allclose(
        undented_motion(undented, ANGLES, RADIUS_M, THICKNESS), expected, atol=1e-12
    )


def test_the_pole_lies_behind_the_contact_along_the_meridian() -> None:
    contact = Contact(polar_rad=0.6, azimuth_rad=1.1)
    for direction in (0.0, 0.7, -2.0):
        plane = ScanPlane(contact, gap_m=0.0, direction_rad=direction)
        expected = np.array([0.0, 0.0, 1.0]) @ np.stack(
            [plane.lateral, plane.offset], axis=1
        )
        np.testing.assert_allclose(
            pole_directions(0.6, direction), expected, atol=1e-15
        )


@pytest.mark.parametrize("polar_deg", [20.0, 40.0])
def test_the_needle_s_force_moves_the_dent_as_in_three_dimensions(
    polar_deg: float,
) -> None:
    contact = Contact(polar_rad=float(np.radians(polar_deg)))
    force_ratio = 1e-7
    wall = LinearWall(graded_mesh(RADIUS_M, 0.6e-3, contact), 0.45)
    displacement = force_ratio * wall.needle_cnc([contact], 0.35e-3)[0]
    tip = displacement[
        np.argmin(
            np.linalg.norm(wall.mesh.points_nc - RADIUS_M * contact.normal, axis=1)
        )
    ]
    pushed = (
        base_push(np.array([force_ratio]), THICKNESS, 0.45)[0]
        * pole_directions(contact.polar_rad, 0.0)[0]
    )
    assert pushed == pytest.approx(float(tip @ contact.meridian), rel=0.1)


def eye(tip_m: float = 0.0) -> np.ndarray:
    """Unknowns (1, unknown) of an eye under 300 Pa, the pole above the needle."""
    unknown = np.zeros((1, len(unknowns.NAMES)))
    values = tip_m, 0.5e-3, 0.6e-3, np.log(0.3e6), np.log(300.0)
    unknown[
        0,
        [
            unknowns.TIP,
            unknowns.GAP,
            unknowns.THICKNESS,
            unknowns.MODULUS,
            unknowns.IOP,
        ],
    ] = values
    return unknown


def stated(direction_rad: float | None) -> Setup:
    return Setup(
        eye=Eye(iop_pa=300.0, thickness_m=0.6e-3, globe=OPEN),
        needle=Needle(gap_m=0.5e-3, polar_rad=0.6),
        scan=Scan(direction_rad=direction_rad),
    )


def calibrating(constants: Setup, lateral: np.ndarray) -> LibrarySections:
    library = (
        bulging(analytic_library())
        .within(0.9 * RADIUS_M)
        .for_contact(wall_of(constants).polar_rad)
    )
    return LibrarySections(
        constants,
        library,
        lateral,
        (wall_of(constants).polar_rad,),
        np.zeros((1, 2, len(lateral), 3)),
    )


def test_calibration_and_fit_see_the_same_section() -> None:
    lateral = np.arange(-6e-3, 6.01e-3, 0.1e-3)
    constants = stated(0.8)
    unknown = eye()
    model = calibrating(constants, lateral)
    theirs = model.curves([stated_wall(constants, 0.3e6, 1e-9, 0.6)])[0]
    even = formed_wall(Walls(model.library), unknown[0])
    unknown[0, unknowns.POLE] = pole_directions(0.6, 0.8)
    mine = formed_wall(Walls(model.library), unknown[0])

    for boundary in (0, 1):
        found, upright = (
            np.interp(lateral, *curves[boundary].T) for curves in (mine, even)
        )
        np.testing.assert_allclose(found, theirs[boundary, :, 1], atol=3e-6)
        assert np.abs(upright - theirs[boundary, :, 1]).max() > 10e-6


def test_the_fit_s_dent_is_pushed_along_the_section_and_across_it() -> None:
    library = analytic_library()
    pole = np.array([-0.3, 0.4])
    unknown = eye(2e-3)
    force_ratio = library.forces(THICKNESS, np.array([1e-3]), np.array([2e-3]))
    pushed = base_push(force_ratio, THICKNESS, library.poisson_ratio)[0] * pole
    shifted = unknown.copy()
    shifted[0, [unknowns.GAP, unknowns.LATERAL]] = 0.5e-3 - pushed[1], pushed[0]
    # this even wall has nothing else to move
    expected = formed_wall(Walls(library), shifted[0])
    unknown[0, unknowns.POLE] = pole
    found = formed_wall(Walls(library), unknown[0])
    assert np.abs(pushed).min() > 20e-6
    lateral = np.linspace(-5e-3, 5e-3, 101)

    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(
            np.interp(lateral, *mine.T), np.interp(lateral, *theirs.T), atol=2e-6
        )


def test_where_no_direction_is_stated_a_calibration_sees_an_even_section() -> None:
    lateral = np.linspace(-6e-3, 6e-3, 121)
    uneven = []

    for constants in (stated(0.0), stated(None)):
        depth = calibrating(constants, lateral).curves(
            [stated_wall(constants, 0.3e6, 0.01, 0.6)]
        )[0, :, :, 1]
        uneven.append(np.abs(depth - depth[:, ::-1]).max())

    assert uneven[0] > 5e-6
    assert uneven[1] < 1e-12
