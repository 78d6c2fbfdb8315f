"""The whole filter on virtual eyes: sections of the mesh, ideal boundaries with noise, eyes that move."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calibration_eyes import drawn_eye
from scleraforce.calibration.assimilation import assimilate, eye_filter, first_state, moments, predicted_points
from scleraforce.laboratory.virtual_eye import PhantomEye
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
