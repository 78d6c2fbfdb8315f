"""One fit of all frames of an eye: E from shape, with travel, a change of the pressure
and known forces.
"""

from collections.abc import Sequence
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
    SHIFT,
    EyeToFit,
    JointFit,
    ShownFrame,
    fit_forces,
    fit_shape,
)
from scleraforce.library import load_library
from scleraforce.library.sealed_eye import iop_ratio_at_dent
from scleraforce.records.globe import SEALED
from scleraforce.records.model_folder import LIBRARY_FILE, SHIPPED_READER
from scleraforce.records.setup import Setup

TRUE_PA = 0.3e6
TIPS_M = tuple(1e-3 * np.linspace(0.3, 3.2, 8))
COMPLIANCE_M_PER_N = 0.02
PRIOR = eye_of_population(0.36e6, 0.12e6)
SHIFT_M = 0.3e-3
LIBRARY = load_library(SHIPPED_READER / LIBRARY_FILE).for_contact(0.6)
WALLS = Walls(LIBRARY)
SEALED_WALLS = Walls(LIBRARY, SEALED)


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


def near(tips_m: tuple[float, ...]) -> np.ndarray:
    """Unknowns of the frames, 2 % off."""
    return np.array(eye_of(tips_m)) * 1.02


def to_fit(
    frames: Sequence[ShownFrame], begun_fn: np.ndarray, setup: Setup = PRIOR
) -> EyeToFit:
    return EyeToFit(
        library=LIBRARY,
        frames=frames,
        setup=setup,
        trained=RANGES,
        smoothing_m=0.0,
        begun_fn=begun_fn,
    )


def fitted(
    frames: tuple[ShownFrame, ...], tips_m: tuple[float, ...] = TIPS_M
) -> JointFit:
    return fit_shape(to_fit(frames, near(tips_m)))


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
    twice = fit_shape(to_fit(shown() * 2, np.tile(once.unknown_fn, (2, 1))))
    assert once.log_modulus[1] / twice.log_modulus[1] < 1.3


def test_the_estimate_does_not_depend_on_the_order(once):
    turned = fit_shape(to_fit(shown()[::-1], once.unknown_fn[::-1]), once.shared)
    assert turned.log_modulus == pytest.approx(once.log_modulus, abs=0.02)


SHAPE_NAMES = frames_of_an_eye._SHARED_SHAPE


@pytest.mark.parametrize(
    ("names", "has_discrepancy"), [(SHAPE_NAMES, True), ((at.MODULUS,), False)]
)
def test_the_gradient_equals_differences_of_the_cost(
    names: tuple[int, ...], has_discrepancy: bool
):
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
    begun_fn = np.array([eye_of(TIPS_M)[5]]) * 1.01
    eye = to_fit([frame], begun_fn, known)
    problem = frames_of_an_eye._EyeProblem(eye, names, has_discrepancy)
    unknown = problem.begun(begun_fn, None)
    unknown[problem.places(at.MODULUS)] = log(0.31e6)
    unknown[problem.places(at.PRESSURE)] = log(420.0)
    terms, _ = problem.evaluate(unknown)
    extras = problem.extras.start + np.arange(5)
    lengths = dict.fromkeys(("tip_m", "depth_m"), 1e-8)
    steps = {int(problem.places(at.MODULUS)[0]): 1e-4}
    steps |= dict(zip(extras.tolist(), (1e-3, 1e-6, 1e-4, 1e-5, 1e-5), strict=True))
    steps |= {
        int(problem.places(at.NAMES.index(name))[0]): step
        for name, step in (lengths | {"log_pressure": 1e-5}).items()
    }

    for place, step in steps.items():
        costs = []
        for sign in (-1.0, 1.0):
            varied = unknown.copy()
            varied[place] += sign * step
            costs.append(problem.evaluate(varied)[1])

        slope = (costs[1] - costs[0]) / (2.0 * step)
        assert terms.gradient[place] == pytest.approx(-0.5 * slope, rel=0.05), place


@pytest.mark.parametrize(
    ("names", "has_discrepancy"), [(SHAPE_NAMES, True), ((at.MODULUS,), False)]
)
def test_eliminating_each_frame_gives_the_step_of_the_whole_matrix(
    names: tuple[int, ...], has_discrepancy: bool
):
    """Oracle: the whole normal matrix of shared and own unknowns, solved at once."""
    eye = to_fit(shown()[:3], near(TIPS_M[:3]))
    problem = frames_of_an_eye._EyeProblem(eye, names, has_discrepancy)
    unknown = problem.begun(eye.begun_fn, None)
    terms, _ = problem.evaluate(unknown)
    step = problem.arrow_step(terms.normal, terms.gradient, 0.0)
    scale = 1.0 / np.sqrt(np.diag(terms.normal))
    whole = scale * np.linalg.solve(
        terms.normal * np.outer(scale, scale), scale * terms.gradient
    )
    np.testing.assert_allclose(step / scale, whole / scale, rtol=1e-3, atol=1e-2)


def test_a_fit_begins_at_the_frames_own_pressures_and_gaps():
    """Fits of single frames have them already: they must not count twice."""
    frames = [
        replace(shown()[number], iop_pa=270.0 * number, gap_m=0.5e-3 + 1e-4 * number)
        for number in (1, 2)
    ]
    alone_fn = np.array(eye_of(TIPS_M[1:3]))
    alone_fn[:, at.IOP] = np.log([270.0, 540.0])
    alone_fn[:, at.GAP] = 0.6e-3, 0.7e-3
    problem = frames_of_an_eye._EyeProblem(
        to_fit(frames, alone_fn), (at.MODULUS,), False
    )
    begun = problem.begun(alone_fn, None)

    for number, frame in enumerate(problem.frames):
        found = problem.named(frame, begun[problem.of_frame(number)])
        for name in (at.IOP, at.GAP):
            assert found[name] == pytest.approx(alone_fn[number, name], abs=1e-9)


@pytest.mark.parametrize("level", [0.0, 0.03])
def test_the_modulus_makes_up_for_a_level_of_the_forces_and_says_so(level: float):
    forces_n = force_n(WALLS, np.array(eye_of(TIPS_M))) * np.exp(level)
    frames = [
        replace(frame, force_n=float(borne_n), force_sd_n=0.2e-3)
        for frame, borne_n in zip(shown(), forces_n, strict=True)
    ][3:]
    found = fit_forces(to_fit(frames, near(TIPS_M[3:])), {})
    mean, sd = found.log_modulus
    assert found.forces_n == pytest.approx(forces_n[3:], rel=0.01)
    assert sd < 0.01
    assert found.declared is not None
    assert abs(mean - log(TRUE_PA)) < 2.0 * np.hypot(sd, found.declared.others_sd)


@pytest.mark.parametrize("rigidity", [0.3, 1.0, 1.5])
def test_known_forces_give_modulus_and_rigidity_of_any_closed_globe(rigidity: float):
    """Single frames tell the pressure over E by their shape, whatever E they were
    fitted with; the fit begins where they and their forces lie.
    """
    tips_m = (1.0e-3, 1.4e-3, 1.6e-3)
    law = SEALED.pressure_law(rigidity * SEALED.mean).over(TRUE_PA)
    eyes = np.array(eye_of(tips_m))
    walls = eyes[:, at.THICKNESS], np.exp(eyes[:, at.IOP]) / TRUE_PA
    pressures_pa = TRUE_PA * iop_ratio_at_dent(LIBRARY, *walls, eyes[:, at.TIP], law)
    eyes[:, at.PRESSURE] = np.log(pressures_pa)
    rng = np.random.default_rng(8)
    frames = [
        ShownFrame(
            lateral_m=LATERAL_M,
            depth_bc=noisy_boundaries(predict_wall(SEALED_WALLS, eye, BOTH), 2e-6, rng),
            force_n=float(force_n(SEALED_WALLS, eye[None])[0]),
            force_sd_n=0.2e-3,
        )
        for eye in eyes
    ]
    alone_fn = eyes.copy()
    alone_fn[:, [at.MODULUS, at.PRESSURE]] += 0.3
    setup = replace(PRIOR, eye=replace(PRIOR.eye, globe=SEALED))
    found = fit_forces(to_fit(frames, alone_fn, setup), {})
    log_modulus, ratio = found.stiffness[0]
    assert log_modulus == pytest.approx(log(TRUE_PA), abs=0.03)
    assert ratio == pytest.approx(rigidity, rel=0.05)
    assert found.cost < 10.0 * len(frames)


def test_travel_makes_the_modulus_surer_and_finds_compliance_and_shift(
    once,
):
    found = fitted(shown(travel=True))
    assert found.log_modulus[1] < once.log_modulus[1]
    assert abs(found.log_modulus[0] - log(TRUE_PA)) < 2.0 * found.log_modulus[1]
    extras = slice(len(found.names), None)
    sd = np.sqrt(np.diag(found.covariance))[extras]
    off = abs(found.shared[extras][COMPLIANCE] - log(COMPLIANCE_M_PER_N))
    assert off < 2.5 * sd[COMPLIANCE]
    assert abs(found.shared[extras][SHIFT] - SHIFT_M) < 2.5 * sd[SHIFT]


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
