"""The filter of one eye, its parameters, and the registration of its frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scleraforce.calibration.filter.eye_filter import (
    EyeSession,
    parameter_moments,
    step,
)
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed, wall_of

FORCES = [float(force) for force in np.random.default_rng(0).uniform(6e-3, 58e-3, 24)]


def after_each(
    session: EyeSession, frames: Sequence[tuple[Boundaries, float]]
) -> list[EyeSession]:
    sessions = []
    for boundaries, force_n in frames:
        session = step(session, boundaries, force_n)
        sessions.append(session)

    return sessions


@pytest.mark.parametrize(
    "settings", [{}, {"sigma_points": "star"}, {"positive": False}]
)
def test_any_sigma_points_and_the_papers_gaussian_prior_give_the_modulus(
    laboratory, eye, settings: dict[str, Any]
):
    frames = laboratory.frames(eye, FORCES[:4], np.random.default_rng(1))
    found = after_each(laboratory.begun(eye, **settings), frames)[-1]
    assert found.modulus.mean_pa == pytest.approx(
        wall_of(eye).youngs_modulus_pa, rel=0.02
    )


def test_an_outlying_point_is_gated_and_does_not_move_the_modulus(laboratory, eye):
    frames = laboratory.frames(eye, FORCES[:4], np.random.default_rng(3))
    begun = laboratory.begun(eye)
    clean = after_each(begun, frames)
    seen, force_n = frames[2]
    depth = seen.depth_m.copy()
    depth[
        1, np.abs(seen.lateral_m - clean[2].last.observation.lateral_m[6]) < 0.35e-3
    ] += 0.2e-3
    frames[2] = (replace(seen, depth_m=depth), force_n)
    hurt = after_each(begun, frames)
    assert hurt[2].last.result.gated == (6,)
    assert hurt[-1].modulus.mean_pa == pytest.approx(
        clean[-1].modulus.mean_pa, rel=0.01
    )


def test_an_eye_that_softens_with_force_makes_the_filter_report_that_it_diverges(
    laboratory, eye
):
    frames = []
    for force_n in np.linspace(8e-3, 50e-3, 8).tolist():
        softer = changed(eye, youngs_modulus_pa=0.4e6 / (1 + force_n / 0.02))
        frames += laboratory.frames(softer, [force_n], np.random.default_rng(4))

    first, *_, last = after_each(laboratory.begun(eye), frames)
    assert first.last.result.status == "ok"
    assert last.last.result.status.startswith("diverged")


@pytest.mark.slow
def test_errors_that_all_frames_share_are_not_averaged_away(laboratory, eye):
    begun = laboratory.begun(eye)
    frames = laboratory.frames(eye, FORCES, np.random.default_rng(5), noise_m=1e-6)
    session = after_each(begun, frames)[-1]
    of_model = begun.filter.study.model_error_fraction
    assert session.modulus.sd_pa > of_model * wall_of(eye).youngs_modulus_pa
    exact = laboratory.begun(eye, model_error_fraction=0.0).filter
    assert parameter_moments(exact, session.state)[1][0] < 0.4 * session.modulus.sd_pa
    # an error of all forces is one of E that the followed sensitivity foretells
    shifted = [(boundaries, force_n - 0.5e-3) for boundaries, force_n in frames]
    moved = (
        after_each(begun, shifted)[-1].state.posterior.mean[0]
        - session.state.posterior.mean[0]
    )
    assert moved == pytest.approx(0.5e-3 * session.state.sensitivity[0, 0], rel=0.25)


def test_belief_of_the_recordings_pose_narrows_to_the_motion_of_the_eye(
    laboratory, eye
):
    begun = laboratory.begun(eye)
    frames = laboratory.frames(eye, [0.03] * 12, np.random.default_rng(1))
    beliefs = [session.state.belief for session in after_each(begun, frames)]
    for belief in beliefs:
        assert np.linalg.eigvalsh(belief.covariance).min() > -1e-18

    lateral, _, rotation, *_ = range(5)
    sd = np.sqrt(np.diag(beliefs[-1].covariance))
    assert beliefs[-1].mean[lateral] == pytest.approx(0.3e-3, abs=0.15e-3)
    assert sd[lateral] == pytest.approx(
        begun.filter.study.shift_sd_m / 12**0.5, rel=0.2
    )
    assert sd[rotation] < 0.004
    assert beliefs[-1].mean[rotation] == pytest.approx(0.01, abs=0.004)


def test_a_session_starts_with_any_frame_and_its_earlier_values_stay_unchanged(
    laboratory, eye
):
    ((seen, force_n),) = laboratory.frames(eye, [0.03], np.random.default_rng(0))
    before = laboratory.begun(eye)
    after, again = (step(before, seen, force_n) for _ in range(2))
    assert (before.updates, before.last) == (0, None)
    assert after.modulus == again.modulus
    assert after.modulus.mean_pa == pytest.approx(
        wall_of(eye).youngs_modulus_pa, rel=0.02
    )
    assert 0 < after.modulus.sd_pa < 0.02e6
    empty = replace(seen, depth_m=np.full_like(seen.depth_m, np.nan))
    assert step(after, empty, 0.001).state is after.state
    assert step(after, empty, 0.03).modulus.mean_pa == after.modulus.mean_pa
