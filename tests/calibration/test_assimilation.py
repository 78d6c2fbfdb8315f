"""The filter of one eye, its parameters, and the registration of its frames."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calibration_eyes import drawn_eye
from scleraforce.calibration.assimilation import assimilate, eye_filter, first_state, moments, predicted_points
from scleraforce.calibration.eye_model import Parameter, ParameterSpace, spread, stated_wall
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
from scleraforce.segmentation.observations import Boundaries

FORCES = [float(force) for force in np.random.default_rng(0).uniform(6e-3, 58e-3, 24)]


def calibrate(laboratory: Any, model: Any, frames: list[Any], study: Any = None, parameters: Any = ("e",)) -> Any:
    filtered = eye_filter(model, study or laboratory.study.calibration, parameters)
    state, steps = first_state(filtered), []
    for _, frame in frames:
        steps.append(assimilate(filtered, state, frame))
        state = steps[-1].state
    return filtered, state, steps


@pytest.mark.slow
def test_modulus_is_within_2_percent_and_10_kpa_after_24_frames(laboratory: Any, eye: PhantomEye) -> None:
    frames = laboratory.frames(eye, FORCES, np.random.default_rng(1))
    _, state, steps = calibrate(laboratory, laboratory.model(laboratory.stated(eye)), frames)
    (mean,), (sd,) = steps[-1].moments
    assert mean == pytest.approx(eye.youngs_modulus_pa, rel=0.02)
    assert sd < 10e3
    assert abs(mean - eye.youngs_modulus_pa) < 2 * sd
    assert state.posterior.updates == 24
    assert all(step.result.status == "ok" for step in steps)


@pytest.mark.parametrize("rule", [pytest.param("canonical", marks=pytest.mark.slow), "star"])
def test_other_sigma_points_agree(laboratory: Any, eye: PhantomEye, rule: str) -> None:
    frames = laboratory.frames(eye, FORCES[:6], np.random.default_rng(1))
    model = laboratory.model(laboratory.stated(eye))
    study = laboratory.study.calibration
    _, _, simplex = calibrate(laboratory, model, frames)
    _, _, other = calibrate(laboratory, model, frames, replace(study, sigma_points=rule))
    assert other[-1].moments[0][0] == pytest.approx(simplex[-1].moments[0][0], rel=3e-3)


def test_the_papers_gaussian_prior_gives_the_same_modulus(laboratory: Any, eye: PhantomEye) -> None:
    frames = laboratory.frames(eye, FORCES[:8], np.random.default_rng(1))
    study = replace(laboratory.study.calibration, positive=False)
    _, _, steps = calibrate(laboratory, laboratory.model(laboratory.stated(eye)), frames, study)
    assert steps[-1].moments[0][0] == pytest.approx(eye.youngs_modulus_pa, rel=0.02)


@pytest.mark.slow
def test_thickness_is_corrected_when_it_is_uncertain(laboratory: Any, eye: PhantomEye) -> None:
    wrong = replace(laboratory.stated(eye), thickness_m=0.65e-3)
    frames = laboratory.frames(eye, FORCES[:10], np.random.default_rng(2))
    study = replace(laboratory.study.calibration, thickness_sd_m=50e-6, inner_sd_m=3e-6)
    _, _, alone = calibrate(laboratory, laboratory.model(wrong), frames, study)
    _, _, both = calibrate(laboratory, laboratory.model(wrong, True), frames, study, ("e", "thickness"))
    mean, sd = both[-1].moments
    assert alone[-1].moments[0][0] > 1.08 * eye.youngs_modulus_pa
    assert mean[1] == pytest.approx(eye.thickness_m, abs=max(2.5 * sd[1], 10e-6))
    assert mean[0] == pytest.approx(eye.youngs_modulus_pa, rel=0.05)


def test_an_outlying_point_is_gated_and_does_not_move_the_modulus(laboratory: Any, eye: PhantomEye) -> None:
    frames = laboratory.frames(eye, FORCES[:4], np.random.default_rng(3))
    model = laboratory.model(laboratory.stated(eye))
    _, _, clean = calibrate(laboratory, model, frames)
    pose, frame = frames[2]
    depth = frame.boundaries.depth_m.copy()
    near = np.abs(frame.boundaries.lateral_m - clean[2].observation.lateral_m[6]) < 0.35e-3
    depth[1, near] += 0.2e-3
    hurt = replace(frame, boundaries=Boundaries(frame.boundaries.lateral_m, depth, frame.boundaries.pixel_m))
    _, _, steps = calibrate(laboratory, model, [*frames[:2], (pose, hurt), frames[3]])
    assert steps[2].result.gated == (6,)
    assert steps[-1].moments[0][0] == pytest.approx(clean[-1].moments[0][0], rel=0.01)


def test_an_eye_that_softens_with_force_makes_the_filter_say_that_it_diverges(laboratory: Any, eye: PhantomEye) -> None:
    made = [
        laboratory.frames(replace(eye, youngs_modulus_pa=0.4e6 / (1 + force / 0.02)), [force], np.random.default_rng(4))
        for force in np.linspace(8e-3, 50e-3, 8).tolist()
    ]
    _, _, steps = calibrate(laboratory, laboratory.model(laboratory.stated(eye)), [frame for (frame,) in made])
    assert steps[-1].result.status.startswith("diverged")


@pytest.mark.slow
def test_what_all_frames_share_is_not_averaged_away(laboratory: Any, eye: PhantomEye) -> None:
    model, study = laboratory.model(laboratory.stated(eye)), laboratory.study.calibration
    frames = laboratory.frames(eye, FORCES, np.random.default_rng(5), noise_m=1e-6)
    filtered, state, _ = calibrate(laboratory, model, frames)
    assert moments(filtered, state)[1][0] > study.model_error_fraction * eye.youngs_modulus_pa
    exact, same = eye_filter(model, replace(study, model_error_fraction=0.0)), state
    assert moments(exact, same)[1][0] < 0.4 * moments(filtered, state)[1][0]
    # 1 mN on all forces is an error of E that the followed sensitivity foretells
    shifted = [(pose, replace(frame, force_n=frame.force_n - 0.5e-3)) for pose, frame in frames]
    _, other, _ = calibrate(laboratory, model, shifted)
    moved = other.posterior.mean[0] - state.posterior.mean[0]
    assert moved == pytest.approx(0.5e-3 * state.sensitivity[0, 0], rel=0.25)


def test_predicted_points_meet_the_observed_ones_at_the_final_modulus_only(laboratory: Any, eye: PhantomEye) -> None:
    frames = laboratory.frames(eye, [0.04] * 3, np.random.default_rng(6))
    filtered, _, steps = calibrate(laboratory, laboratory.model(laboratory.stated(eye)), frames)
    step = steps[-1]
    final = predicted_points(filtered, step, step.moments[0][0]) - step.observation.depth_m
    first = predicted_points(filtered, step, 0.49e6) - step.observation.depth_m
    assert np.abs(final).max() < 30e-6
    assert np.abs(first).max() > 200e-6


@pytest.mark.parametrize("parameters", [(), ("e", "e"), ("stiffness",)])
def test_parameters_that_do_not_exist_are_refused(laboratory: Any, eye: PhantomEye, parameters: Any) -> None:
    model = laboratory.model(laboratory.stated(eye))
    with pytest.raises(ValueError, match="choose from"):
        eye_filter(model, laboratory.study.calibration, parameters)


@pytest.mark.long
@pytest.mark.slow
def test_the_true_modulus_lies_within_two_sd_for_at_least_90_percent_of_30_eyes(laboratory: Any) -> None:
    rng, honest, right = np.random.default_rng(7), 0, 0
    for number in range(30):
        eye = drawn_eye(number, rng, (0.45, 0.78))
        stated = replace(laboratory.stated(eye, 0.1), polar_rad=0.61)  # the contact's angle is not known
        frames = laboratory.frames(eye, rng.uniform(6e-3, 58e-3, 24).tolist(), rng)
        _, _, steps = calibrate(laboratory, laboratory.model.__wrapped__(stated), frames)
        (mean,), (sd,) = steps[-1].moments
        honest += abs(mean - eye.youngs_modulus_pa) < 2 * sd
        right += abs(mean / eye.youngs_modulus_pa - 1) < 0.02
        assert sd < 10e3
    assert honest >= 27
    assert right >= 27


@given(mean=st.floats(1e-3, 1e6), ratio=st.floats(0.01, 3.0), positive=st.booleans())
def test_prior_has_the_moments_that_were_asked_for(mean: float, ratio: float, positive: bool) -> None:
    space = ParameterSpace((Parameter("x", mean=mean, sd=ratio * mean, positive=positive),))
    (found_mean,), (found_sd,) = space.moments(*space.prior())
    assert found_mean == pytest.approx(mean)
    assert found_sd == pytest.approx(ratio * mean)


def test_lognormal_moments_equal_those_of_a_large_sample() -> None:
    space = ParameterSpace((Parameter("x", mean=2.0, sd=1.0),))
    mean, covariance = space.prior()
    drawn = np.random.default_rng(0).normal(mean[0], np.sqrt(covariance[0, 0]), (200_000, 1))
    values = space.values(drawn)
    assert values.mean() == pytest.approx(2.0, rel=0.01)
    assert values.std() == pytest.approx(1.0, rel=0.02)


@given(st.floats(-50.0, 50.0))
def test_a_positive_parameter_is_positive_at_any_coordinate(coordinate: float) -> None:
    space = ParameterSpace((Parameter("x", mean=0.49, sd=0.34),))
    assert space.values(np.array([coordinate]))[0] > 0


def test_an_unchanged_parameter_may_become_negative() -> None:
    space = ParameterSpace((Parameter("x", mean=0.49, sd=0.34, positive=False),))
    assert space.values(np.array([-1.0]))[0] == pytest.approx(-0.49)


def test_mixed_space_treats_each_parameter_by_its_own_rule() -> None:
    space = ParameterSpace((Parameter("a", mean=2.0, sd=1.0), Parameter("b", mean=3.0, sd=0.5, positive=False)))
    np.testing.assert_allclose(space.values(np.array([[0.0, 1.0]])), [[2.0, 3.0]])


@pytest.mark.parametrize(("mean", "sd"), [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0)])
def test_a_prior_without_width_or_sign_is_refused(mean: float, sd: float) -> None:
    with pytest.raises(ValueError, match="x: a prior"):
        Parameter("x", mean=mean, sd=sd)


def test_spread_is_the_sample_standard_deviation() -> None:
    assert spread([0.27, 0.22, 0.24, 0.29]) == pytest.approx((0.255, np.std([0.27, 0.22, 0.24, 0.29], ddof=1)))
    assert spread([0.3]) == (0.3, None)


@pytest.mark.parametrize("either_sign", [False, True])
def test_what_is_no_number_is_no_eye(either_sign: bool) -> None:
    space = ParameterSpace((Parameter("x", mean=1.0, sd=1.0, positive=False, either_sign=either_sign),))
    values = np.array([[1.0], [-1.0], [np.nan], [np.inf], [-np.inf]])
    assert space.exist(values).tolist() == [True, either_sign, False, False, False]


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
