"""What the base adds to a section: against the harmonics' own formula, and three-dimensional mechanics."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from reference_walls import shift_in_plane
from scleraforce.calibration.eye_model import EyeConstants
from scleraforce.calibration.library_eye import SIZE, base_moves
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.meridian import meridian_mesh
from scleraforce.mechanics.polar import base_shift
from scleraforce.study import Study

STUDY = Study()
STATED = EyeConstants(
    iop_pa=266.0, thickness_m=0.65e-3, gap_m=0.6e-3, polar_rad=radians(40), polar_sd_rad=0.0, direction_rad=0.7
)
LATERAL = np.linspace(-6e-3, 6e-3, 25)
FORCE_RATIO = 0.1e-6


def test_nothing_moves_under_a_needle_on_the_pole() -> None:
    assert not base_moves(STUDY, STATED, 0.0, LATERAL).any()


@pytest.mark.slow
def test_along_the_plane_the_motion_is_that_of_the_shift() -> None:
    moved = FORCE_RATIO * base_moves(STUDY, STATED, STATED.polar_rad, LATERAL)
    shift = base_shift(12e-3, 0.65e-3, 0.45, 0.35e-3, polar_rad=STATED.polar_rad, size=SIZE)
    mesh = meridian_mesh(12e-3, 0.65e-3, 0.35e-3, np.pi / 2, SIZE)
    rings = np.stack([mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)])
    for side in (-1.0, 1.0):
        lateral_bn = side * np.sqrt(np.maximum(rings**2 - STATED.gap_m**2, 0.0))
        expected = shift_in_plane(shift, 0.0, FORCE_RATIO, lateral_bn, STATED.gap_m, STATED.direction_rad)
        for boundary in (0, 1):
            here = (rings[boundary] > STATED.gap_m) & (np.abs(lateral_bn[boundary]) < 6e-3)
            at = lateral_bn[boundary][here]
            for mine, theirs in ((0, 0), (2, 1)):
                found = np.interp(at, LATERAL, moved[boundary, :, mine])
                assert np.abs(found - expected[boundary, here, theirs]).max() < 1e-6


@pytest.mark.slow
def test_the_dent_moves_across_a_plane_that_lies_across_the_meridian() -> None:
    # The tip's own motion in 3-D: along the meridian, so across a plane whose lateral axis is the parallel.
    contact = Contact(polar_rad=STATED.polar_rad)
    wall = LinearWall(graded_mesh(12e-3, 0.65e-3, contact), 0.45)
    displacement = FORCE_RATIO * wall.needle_cnc([contact], 0.35e-3)[0]
    tip = displacement[np.argmin(np.linalg.norm(wall.mesh.points_nc - 12e-3 * contact.normal, axis=1))]
    crosswise = replace(STATED, gap_m=1e-6, direction_rad=radians(90))
    moved = FORCE_RATIO * base_moves(STUDY, crosswise, STATED.polar_rad, np.array([1e-6]))[0, 0]
    offset = np.cross(contact.normal, contact.parallel)
    assert moved[1] == pytest.approx(float(tip @ offset), rel=0.05)
    assert abs(moved[1]) > 20e-6
    assert moved[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_a_needle_farther_than_the_mesh_goes_moves_no_more() -> None:
    far, farthest = (base_moves(STUDY, STATED, radians(angle), LATERAL) for angle in (55.0, 70.0))
    np.testing.assert_allclose(far, farthest)
