from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scleraforce.calibration.eye_model import stated_wall
from scleraforce.calibration.registration import (
    BY_DEPTH,
    BY_LATERAL,
    BY_POLAR,
    BY_ROTATION,
    first_belief,
    frame_prior,
    place_section,
    predict_frame,
    register,
    updated_belief,
)
from scleraforce.laboratory.light import Pose
from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.library.placement import Places
from scleraforce.mechanics.contact import Section


@pytest.mark.slow
def test_poses_are_found_to_50_um_with_the_contact_angle_unknown(laboratory: Any, eye: PhantomEye) -> None:
    elsewhere = replace(laboratory.stated(eye, polar_sd_rad=0.1), polar_rad=eye.polar_rad + 0.1)
    model, study = laboratory.model(elsewhere), laboratory.study.calibration
    belief, errors_m = first_belief(model), []
    for pose, frame in laboratory.frames(eye, [0.02, 0.008, 0.05, 0.035, 0.006, 0.015], np.random.default_rng(0)):
        prior = frame_prior(belief, study)
        fit = register(model, frame.boundaries, frame.force_n, 0.49e6, prior)
        belief = updated_belief(belief, prior, fit)
        errors_m.append([fit.nuisance[BY_LATERAL] - pose.lateral_m, fit.nuisance[BY_DEPTH] - pose.depth_m])
        assert fit.youngs_modulus_pa == pytest.approx(eye.youngs_modulus_pa, rel=0.12)
    assert np.sqrt(np.mean(np.square(errors_m), axis=0)).max() < 50e-6


def test_belief_of_the_recordings_pose_narrows_to_how_far_the_eye_moves(laboratory: Any, eye: PhantomEye) -> None:
    model, study = laboratory.model(laboratory.stated(eye)), laboratory.study.calibration
    belief = first_belief(model)
    for _, frame in laboratory.frames(eye, [0.03] * 12, np.random.default_rng(1)):
        prior = frame_prior(belief, study)
        fit = register(model, frame.boundaries, frame.force_n, 0.3e6, prior)
        belief = updated_belief(belief, prior, fit)
        assert np.linalg.eigvalsh(belief.covariance).min() > -1e-18
    sd = np.sqrt(np.diag(belief.covariance))
    assert belief.mean[BY_LATERAL] == pytest.approx(0.3e-3, abs=0.15e-3)
    assert sd[BY_LATERAL] == pytest.approx(study.shift_sd_m / 12**0.5, rel=0.2)
    assert sd[BY_ROTATION] < 0.004
    assert belief.mean[BY_ROTATION] == pytest.approx(0.01, abs=0.004)


def test_a_section_is_placed_as_the_virtual_scanner_places_it() -> None:
    rng = np.random.default_rng(2)
    outer, inner = rng.normal(size=(2, 7, 2))
    pose = Pose(lateral_m=0.3, depth_m=-0.2, tilt_rad=0.4)
    placed = place_section(np.stack([outer, inner]), np.array([pose.lateral_m, pose.depth_m, pose.tilt_rad, 0.0, 0.0]))
    np.testing.assert_allclose(placed[1], pose.place(Section(outer, inner)).inner)


def test_derivatives_of_what_a_frame_shows_are_those_of_differences(laboratory: Any, eye: PhantomEye) -> None:
    model = laboratory.model(laboratory.stated(eye))
    places = Places(np.linspace(-5e-3, 5e-3, 12), np.repeat([0, 1], 6))
    nuisance = np.array([0.1e-3, 0.4e-3, 0.02, eye.polar_rad, 10e-6])
    state = stated_wall(model.constants, 0.27e6, 0.03, eye.polar_rad)
    placed = predict_frame(model, state, nuisance, places)
    for index, step in ((BY_LATERAL, 1e-5), (BY_DEPTH, 1e-5), (BY_ROTATION, 1e-3), (4, 1e-6)):
        ends = []
        for sign in (-1, 1):
            moved = nuisance.copy()
            moved[index] += sign * step
            ends.append(predict_frame(model, state, moved, places).depth_m)
        difference = (ends[1] - ends[0]) / (2 * step)
        scale = np.abs(difference).max()
        np.testing.assert_allclose(placed.jacobian[:, index], difference, atol=0.03 * scale)
    assert not placed.jacobian[:, BY_POLAR].any()
