"""One fit of all frames of an eye: E from shape, with travel, a change of the pressure
and known forces.
"""

from dataclasses import replace
from functools import cache
from math import exp, log

import numpy as np
import pytest
from analytic_frames import (
    BOTH,
    LATERAL_M,
    RANGES,
    eye_of_population,
    middling_eye,
    noisy_boundaries,
)

from predicted_walls import Walls, force_n, predict_wall
from scleraforce.fit import frames_of_an_eye, unknowns as at
from scleraforce.fit.frames_of_an_eye import (
    COMPLIANCE,
    MODULUS,
    OWN,
    SHIFT,
    JointFit,
    ShownFrame,
    fit_jointly,
)
from scleraforce.library import load_library
from scleraforce.records.globe import SEALED
from scleraforce.records.model_folder import LIBRARY_FILE, SHIPPED_READER

TRUE_PA = 0.3e6
TIPS_M = tuple(1e-3 * np.linspace(0.3, 3.2, 8))
COMPLIANCE_M_PER_N = 0.02
PRIOR = eye_of_population(0.36e6, 0.12e6)
SHIFT_M = 0.3e-3
LIBRARY = load_library(SHIPPED_READER / LIBRARY_FILE).for_contact(0.6)
WALLS = Walls(LIBRARY)


def eye_of(tips_m: tuple[float, ...]) -> list[np.ndarray]:
    return [
        middling_eye(tip_m, lateral_m=1e-4 * number)
        for number, tip_m in enumerate(tips_m)
    ]


@cache
def shown(
    tips_m: tuple[float, ...] = TIPS_M, *, travel: bool = False
) -> tuple[ShownFrame, ...]:
    rng = np.random.default_rng(5)
    frames = []

    for unknown in eye_of(tips_m):
        depth_bc = noisy_boundaries(predict_wall(WALLS, unknown, BOTH), 2e-6, rng)
        gone = (
            unknown[at.TIP]
            + COMPLIANCE_M_PER_N * float(force_n(WALLS, unknown[None])[0])
            + SHIFT_M
        )
        frames.append(
            ShownFrame(
                lateral_m=LATERAL_M,
                depth_bc=depth_bc,
                travel_m=gone if travel else None,
            )
        )

    return tuple(frames)


def own_of(tips_m: tuple[float, ...]) -> np.ndarray:
    return np.array([unknown[OWN] for unknown in eye_of(tips_m)])


def fitted(
    frames: tuple[ShownFrame, ...], tips_m: tuple[float, ...] = TIPS_M
) -> JointFit:
    return fit_jointly(LIBRARY, frames, PRIOR, RANGES, 0.0, own_of(tips_m) * 1.02)


@pytest.fixture(scope="module")
def once() -> JointFit:
    return fitted(shown())


OF_PRIOR = np.sqrt(np.log1p((0.12 / 0.36) ** 2))


def test_deep_dents_tell_the_modulus_without_a_force(once):
    mean, sd = once.log_modulus
    assert abs(mean - log(TRUE_PA)) < 2.0 * sd
    assert sd < 0.6 * OF_PRIOR


def test_shallow_dents_leave_the_prior_unchanged():
    tips_m = (0.02e-3, 0.04e-3, 0.06e-3)
    mean, sd = fitted(shown(tips_m), tips_m).log_modulus
    assert sd == pytest.approx(OF_PRIOR, rel=0.1)
    assert mean == pytest.approx(log(0.36e6) - 0.5 * OF_PRIOR**2, abs=0.2 * OF_PRIOR)


def test_the_same_frames_once_more_do_not_halve_the_variance(once):
    """Frames of one contact share the discrepancy: a plain product over them would be
    surer by 1.41.
    """
    twice = fit_jointly(
        LIBRARY, shown() * 2, PRIOR, RANGES, 0.0, np.tile(once.own, (2, 1))
    )
    assert once.log_modulus[1] / twice.log_modulus[1] < 1.3


def test_the_estimate_does_not_depend_on_the_order(once):
    turned = fit_jointly(
        LIBRARY, shown()[::-1], PRIOR, RANGES, 0.0, once.own[::-1], once.shared
    )
    assert turned.log_modulus == pytest.approx(once.log_modulus, abs=0.02)


def test_the_gradient_equals_differences_of_the_cost():
    """The gradient is half the cost's slope, with all numbers: travel, a known force, a
    sealed globe's law.
    """
    known = replace(PRIOR, eye=replace(PRIOR.eye, globe=SEALED))
    frame = replace(
        shown(travel=True)[5],
        force_n=0.02,
        force_sd_n=0.2e-3,
        iop_pa=1.1 * exp(log(270.0)),
    )
    problem = frames_of_an_eye._EyeProblem(LIBRARY, [frame], known, RANGES, 0.0)
    shared = problem.mean.copy()
    own = eye_of(TIPS_M)[5][OWN] * 1.01
    shared[MODULUS] = log(0.31e6)
    own[-1] = log(420.0)
    (one,) = problem.frames
    seen = problem.compare_frame(one, shared, own)
    names = [at.NAMES.index(name) for name in ("tip_m", "depth_m", "log_pressure")]
    steps = {MODULUS: 1e-4, COMPLIANCE: 1e-3, SHIFT: 1e-6}
    steps |= {
        len(shared) + OWN.tolist().index(name): step
        for name, step in zip(names, (1e-8, 1e-8, 1e-5), strict=True)
    }

    for place, step in steps.items():
        costs = []
        for sign in (-1.0, 1.0):
            both = np.concatenate([shared, own])
            both[place] += sign * step
            costs.append(
                problem.compare_frame(
                    one, both[: len(shared)], both[len(shared) :], derive=False
                ).cost
            )

        assert seen.gradient[place] == pytest.approx(
            -(costs[1] - costs[0]) / (4.0 * step), rel=0.05
        ), place


def test_eliminating_each_frame_gives_the_step_of_the_whole_matrix():
    """Oracle: the whole normal matrix of shared and own unknowns, solved at once."""
    problem = frames_of_an_eye._EyeProblem(LIBRARY, shown()[:3], PRIOR, RANGES, 0.0)
    shared = problem.mean.copy()
    own = own_of(TIPS_M[:3])
    seen = [
        problem.compare_frame(frame, shared, one)
        for frame, one in zip(problem.frames, own, strict=True)
    ]
    _, normal, gradient = problem.prior(shared)
    count = len(shared)
    each = len(OWN)
    whole = np.zeros((count + 3 * each,) * 2)
    right = np.zeros(count + 3 * each)
    whole[:count, :count] = normal
    right[:count] = gradient

    for number, one in enumerate(seen):
        places = np.r_[:count, count + number * each : count + (number + 1) * each]
        whole[np.ix_(places, places)] += one.normal
        right[places] += one.gradient

    eliminated, pull, _ = frames_of_an_eye._eliminated(seen, count, 0.0)
    step = np.linalg.solve(normal + eliminated, gradient + pull)
    scale = np.sqrt(np.diag(np.linalg.inv(whole)))[:count]
    np.testing.assert_allclose(
        step / scale, np.linalg.solve(whole, right)[:count] / scale, atol=1e-4
    )


def test_travel_makes_the_modulus_surer_and_finds_compliance_and_shift(
    once,
):
    found = fitted(shown(travel=True))
    assert found.log_modulus[1] < once.log_modulus[1]
    assert abs(found.log_modulus[0] - log(TRUE_PA)) < 2.0 * found.log_modulus[1]
    sd = np.sqrt(np.diag(found.covariance))
    assert (
        abs(found.shared[COMPLIANCE] - log(COMPLIANCE_M_PER_N)) < 2.5 * sd[COMPLIANCE]
    )
    assert abs(found.shared[SHIFT] - SHIFT_M) < 2.5 * sd[SHIFT]


def test_one_known_force_counts_in_the_same_posterior(once):
    force = float(force_n(WALLS, eye_of(TIPS_M)[6][None])[0])
    frames = list(shown())
    frames[6] = replace(frames[6], force_n=force, force_sd_n=0.2e-3)
    found = fitted(tuple(frames))
    assert found.log_modulus[0] == pytest.approx(log(TRUE_PA), abs=0.06)
    assert found.log_modulus[1] < 0.5 * once.log_modulus[1]
    assert found.forces_n[6] == pytest.approx(force, rel=0.03)


def test_a_known_change_of_the_pressure_is_followed():
    """Half of the frames at twice the pressure; taken for one pressure they would
    contradict one another.
    """
    rng = np.random.default_rng(6)
    frames = list[ShownFrame]()

    for number, tip_m in enumerate(TIPS_M):
        iop_pa = 270.0 * (1 + number % 2)
        unknown = middling_eye(tip_m, log_iop=log(iop_pa))
        depth_bc = noisy_boundaries(predict_wall(WALLS, unknown, BOTH), 2e-6, rng)
        frames.append(ShownFrame(lateral_m=LATERAL_M, depth_bc=depth_bc, iop_pa=iop_pa))

    told, untold = (
        fitted(each)
        for each in (frames, [replace(frame, iop_pa=None) for frame in frames])
    )
    off, off_untold = (
        abs(each.log_modulus[0] - log(TRUE_PA)) for each in (told, untold)
    )
    assert off < 2.0 * told.log_modulus[1]
    assert off_untold > 2.0 * off
