"""The globe turns under a needle and a scanner that stand still."""

from math import radians

import numpy as np
import pytest

from scleraforce.laboratory.virtual_eye import STILL, EyeTurn, draw_turns, farthest_turn_rad, turned_plane
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.study import PhantomStudy, Range, fixed

PLANE = ScanPlane(Contact(polar_rad=0.7, azimuth_rad=2.9), gap_m=0.5e-3, direction_rad=-1.1, tilt_rad=0.05)
MOVING = PhantomStudy(
    eye_drift_rad=Range(min=radians(1.0), max=radians(3.0)), eye_saccade_rad=Range(min=radians(0.2), max=radians(1.0))
)


def rotated(vector, turn):
    """The rotation of space that takes the globe there, by Rodrigues' formula."""
    axis = np.array([turn.about_x_rad, turn.about_y_rad, 0.0])
    angle = np.linalg.norm(axis)
    axis /= angle
    return (
        np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector) + (1 - np.cos(angle)) * (axis @ vector) * axis
    )


@pytest.mark.parametrize(
    "turn",
    [
        EyeTurn(about_x_rad=0.05, about_y_rad=-0.02),
        EyeTurn(about_x_rad=-0.4, about_y_rad=0.3),
        EyeTurn(about_x_rad=0.0, about_y_rad=0.01),
    ],
)
def test_the_plane_stands_still_in_space_while_the_globe_turns(turn) -> None:
    seen = turned_plane(PLANE, turn)
    for name in ("lateral", "depth", "normal"):
        assert rotated(getattr(seen, name), turn) == pytest.approx(getattr(PLANE, name), abs=1e-12)
    assert rotated(seen.origin(12e-3), turn) == pytest.approx(PLANE.origin(12e-3), abs=1e-15)


def test_an_eye_that_does_not_turn_has_the_plane_that_it_had() -> None:
    seen = turned_plane(PLANE, STILL)
    assert seen.contact.polar_rad == pytest.approx(PLANE.contact.polar_rad)
    assert seen.contact.azimuth_rad == pytest.approx(PLANE.contact.azimuth_rad)
    assert (seen.direction_rad, seen.tilt_rad, seen.gap_m) == pytest.approx((-1.1, 0.05, 0.5e-3))


def test_a_drift_grows_evenly_to_one_side_and_ends_where_it_was_drawn() -> None:
    times_s = np.array([2.0, 8.0, 20.0])
    drift = PhantomStudy(eye_drift_rad=fixed(0.04))
    for seed in range(5):
        turns = np.array(
            [(turn.about_x_rad, turn.about_y_rad) for turn in draw_turns(drift, times_s, np.random.default_rng(seed))]
        )
        assert np.linalg.norm(turns[-1]) == pytest.approx(0.04)
        assert turns == pytest.approx(np.outer([0.1, 0.4, 1.0], turns[-1]))


def test_saccades_go_off_the_drift_by_as_much_as_is_drawn_and_stay_for_a_second() -> None:
    times_s = np.arange(0.05, 60.0, 0.1)
    saccades = PhantomStudy(eye_saccade_rad=Range(min=0.005, max=0.015))
    turns = np.array(
        [(turn.about_x_rad, turn.about_y_rad) for turn in draw_turns(saccades, times_s, np.random.default_rng(1))]
    )
    sizes = np.linalg.norm(turns, axis=1)
    assert 0.005 <= sizes.min() < 0.006 < 0.014 < sizes.max() <= 0.015
    jumps = np.flatnonzero(np.linalg.norm(np.diff(turns, axis=0), axis=1) > 1e-9)
    assert (jumps + 1).tolist() == list(range(10, 600, 10))
    sides = np.arctan2(*turns[::10].T)
    assert np.histogram(sides, 4, (-np.pi, np.pi))[0].min() > 5  # to every side


def test_no_turn_goes_farther_than_drift_and_saccade_together() -> None:
    assert farthest_turn_rad(PhantomStudy()) == 0.0
    assert farthest_turn_rad(MOVING) == pytest.approx(radians(4.0))
    for seed in range(50):
        for turn in draw_turns(MOVING, np.linspace(1.0, 240.0, 20), np.random.default_rng(seed)):
            assert np.hypot(turn.about_x_rad, turn.about_y_rad) <= radians(4.0)
