"""The filter of one eye, frame by frame: registration, observation, prediction,
correction (paper sec. 3.2).

Mechanics is linear, and knows no globe but an open one.

`begin`, then `step` for each frame; every value is a new record, and the posterior can
be read at any time. Frames of little force show where the eye lies but nothing of its
modulus. All at once or one by one, the result is the same.

Values that a frame does not determine (pose, contact angle, inner boundary, noise of
the force) are marginalised: they enter the observation noise as J Sigma J^T. That would
wrongly average away values that all frames share and none determines (zero of the
force, its drift, the contact angle, the finite elements' error); so their effect on the
estimate is followed from step to step and added to the posterior in the end (Schmidt
1966, "consider" parameters).
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.units import from_si
from scleraforce.calibration.filter import section_registration, unscented_filter
from scleraforce.calibration.filter.eye_parameters import (
    ParameterSpace,
    stated_polar_rad,
    stated_wall,
)
from scleraforce.fit.curve_placement import PlacesOnFrame, curve_depths
from scleraforce.recordings.force_errors import LABEL_SD_N, ZERO_PRIOR
from scleraforce.records.eye import Modulus
from scleraforce.records.setup import Setup
from scleraforce.records.study import CalibrationStudy, Study
from scleraforce.wall.wall_in_metres import Boundaries, Observation, observe_points

if TYPE_CHECKING:  # 7 ms: not for a program that only reads calibrations
    from scleraforce.calibration.filter.linear_sections import LinearEye

# Name on the command line -> name of the parameter.
PARAMETERS = {
    "e": "youngs_modulus_pa",
    "iop": "iop_pa",
    "thickness": "thickness_m",
    "gap": "gap_m",
}
LEAST_POINTS = 3
UNREACHED_SD_M = 1.0  # of a point that the model's section does not reach
UNSEEN = "too little of the wall is in view"
# the columns of `EyeState.sensitivity`
SHARED = (
    "zero_n",
    "drift_n_per_s",
    "polar_rad",
    "model_fraction",
)


@dataclass(frozen=True, eq=False)
class EyeFilter:
    """The constant part: the eye, its uncertain parameters, the settings of the
    filter.
    """

    model: "LinearEye"
    space: ParameterSpace
    params: unscented_filter.FilterParams
    study: CalibrationStudy


@dataclass(frozen=True, eq=False)
class EyeState:
    """The state after some frames; `sensitivity` (parameter, 4) of the estimate to the
    `SHARED` values of frames.
    """

    posterior: unscented_filter.Posterior
    belief: section_registration.PoseBelief
    sensitivity: Floats
    zero_covariance: Floats


@dataclass(frozen=True, eq=False)
class FrameStep:
    """One frame's step: the state after it, and the values that a figure or a report
    needs.
    """

    state: EyeState
    force_n: float
    registered: section_registration.Registered
    observation: Observation
    result: unscented_filter.StepResult


@dataclass(frozen=True)
class SkippedFrame:
    """The reason why a frame cannot be assimilated; it leaves the state unchanged."""

    reason: str


def eye_filter(
    model: "LinearEye",
    study: CalibrationStudy,
    parameters: tuple[str, ...] = ("e",),
) -> EyeFilter:
    """Set up the filter of an eye for parameters named as on the command line."""
    if (
        not parameters
        or set(parameters) - set(PARAMETERS)
        or len(set(parameters)) < len(parameters)
    ):
        raise ValueError(
            f"parameters {','.join(parameters)}: choose from {','.join(PARAMETERS)},"
            " each once"
        )

    stated = stated_wall(
        model.setup, study.prior_mean_pa, 0.0, stated_polar_rad(model.setup)
    )
    eye = model.setup.eye
    priors = {
        "e": (study.prior_mean_pa, study.prior_sd_pa),
        "iop": (max(stated.iop_pa, 1.0), eye.iop_sd_pa or study.iop_sd_pa),
        "thickness": (stated.thickness_m, eye.thickness_sd_m or study.thickness_sd_m),
        "gap": (max(stated.gap_m, 1e-5), study.gap_sd_m),
    }
    means, sds = np.array([priors[name] for name in parameters]).T
    space = ParameterSpace(
        tuple(PARAMETERS[name] for name in parameters),
        means,
        sds,
        np.full(len(parameters), study.positive),
    )
    points = unscented_filter.sigma_points(study.sigma_points, len(parameters))
    params = unscented_filter.FilterParams(
        points, study.iterations, gate=study.gate_sd, inflate=True
    )

    return EyeFilter(model, space, params, study)


def parameter_moments(eye: EyeFilter, state: EyeState) -> tuple[Floats, Floats]:
    """Return means and standard deviations of the parameters in SI, with the effect of
    the shared values.
    """
    shared = np.diag(
        [
            0.0,
            0.0,
            eye.model.polar_sd_rad**2,
            eye.study.model_error_fraction**2,
        ]
    )
    shared[:2, :2] = state.zero_covariance
    covariance = (
        state.posterior.covariance + state.sensitivity @ shared @ state.sensitivity.T
    )

    return eye.space.moments(state.posterior.mean, covariance)


def assimilate(
    session: "EyeSession",
    boundaries: Boundaries,
    force_n: float,
    since_start_s: float = 0.0,
) -> FrameStep | SkippedFrame:
    """Assimilate one frame; it is skipped if it shows too little.

    A frame that the model cannot be evaluated for leaves the state unchanged, and
    `result.status` says why.
    """
    eye = session.filter
    state = session.state
    if np.isfinite(boundaries.depth_m).sum() < LEAST_POINTS:
        return SkippedFrame(UNSEEN)

    prior = section_registration.frame_prior(state.belief, eye.study)
    median_pa = float(
        eye.space.values(state.posterior.mean)[eye.space.names.index(PARAMETERS["e"])]
    )
    modulus_pa = max(median_pa, 0.01 * eye.study.prior_mean_pa)
    fit = section_registration.register(
        eye.model, boundaries, force_n, modulus_pa, prior
    )
    contact_m = float(fit.nuisance[section_registration.BY_LATERAL])
    observation = observe_points(
        boundaries, eye.study.points, contact_m, eye.study.span_m
    )
    places = PlacesOnFrame(observation.lateral_m, observation.boundary)
    at = (eye.model, fit.wall, fit.nuisance, places)

    placed = section_registration.predict_frame(*at)
    if placed.seen.sum() < LEAST_POINTS:
        return SkippedFrame(UNSEEN)

    by_force = section_registration.force_derivative(*at)
    by_polar = section_registration.polar_derivative(*at)
    by_nuisance = placed.jacobian[:, : section_registration.LOG_MODULUS]
    expected = by_nuisance @ (prior.mean - fit.nuisance)

    def observe(states_rp: Floats) -> Floats:
        return _depths(eye, states_rp, force_n, fit.nuisance, places) + expected

    noise = (  # covariance (point, point): segmentation, nuisances, force, contact
        np.diag(np.where(placed.seen, observation.sd_m, UNREACHED_SD_M) ** 2)
        + by_nuisance @ prior.covariance @ by_nuisance.T
        + LABEL_SD_N**2 * np.outer(by_force, by_force)
        + eye.model.polar_sd_rad**2 * np.outer(by_polar, by_polar)
    )
    result = unscented_filter.filter_step(
        eye.params, state.posterior, observe, observation.depth_m, noise
    )
    sensitivity = state.sensitivity
    if result.observations:
        # x+ = x- + G (y - h(x-)): an error d of a shared value moves y by g d (`g`:
        # point, shared).
        g = np.stack(
            [by_force, by_force * since_start_s, by_polar, by_force * force_n], axis=1
        )
        sensitivity = result.contraction @ sensitivity + result.gain @ g

    belief = section_registration.updated_belief(state.belief, prior, fit)
    after = EyeState(result.posterior, belief, sensitivity, session.zero_covariance)
    return FrameStep(after, force_n, fit, observation, result)


def predicted_points(eye: EyeFilter, step: FrameStep, modulus_pa: float) -> Floats:
    """Return the depths (point,) that a modulus predicts at a step's observed points,
    at the pose that was found.

    The other parameters have the means of the posterior after the step.
    """
    coordinates = _with_modulus(eye, step.state.posterior.mean, modulus_pa)
    places = PlacesOnFrame(step.observation.lateral_m, step.observation.boundary)
    return _depths(
        eye, coordinates[None], step.force_n, step.registered.nuisance, places
    )[0]


def _with_modulus(eye: EyeFilter, coordinates: Floats, modulus_pa: float) -> Floats:
    """Return coordinates (p,) of the filter, changed to another modulus."""
    changed = coordinates.copy()
    place = eye.space.names.index(PARAMETERS["e"])
    ratio = modulus_pa / eye.space.means[place]
    changed[place] = np.log(ratio) if eye.study.positive else ratio
    return changed


def _depths(
    eye: EyeFilter,
    states_rp: Floats,
    force_n: float,
    nuisance: Floats,
    places: PlacesOnFrame,
) -> Floats:
    """Return predicted depths (row, place) for rows of the filter's coordinates; NaN
    for a row without such an eye.
    """
    values = eye.space.values(states_rp)
    sound = eye.space.exist(values)
    depths = np.full((len(values), len(places.lateral_m)), np.nan)

    if sound.any():
        polar_rad = float(nuisance[section_registration.BY_POLAR])
        curves = section_registration.parameter_sections(
            eye.model, eye.space.names, values[sound], force_n, polar_rad
        )
        placed = section_registration.place_section(curves, nuisance)
        inner = nuisance[section_registration.BY_INNER] * places.is_inner
        depths[sound] = [curve_depths(curve, places)[0] + inner for curve in placed]

    return depths


@dataclass(frozen=True, eq=False)
class EyeSession:
    """An eye after some frames; `last` is the result of the latest one, None before the
    first.

    `zero_covariance` (2, 2) is that of the force sensor's zero and its drift, which all
    frames share.
    """

    filter: EyeFilter
    state: EyeState
    zero_covariance: Floats
    last: FrameStep | SkippedFrame | None = None

    @property
    def modulus(self) -> Modulus:
        """Posterior of Young's modulus: the prior before the first frame."""
        means, sds = parameter_moments(self.filter, self.state)
        place = self.filter.space.names.index(PARAMETERS["e"])
        return Modulus(
            mean_pa=float(means[place]), sd_pa=float(sds[place]), source="own"
        )

    @property
    def updates(self) -> int:
        """The number of frames that the estimate rests on."""
        return self.state.posterior.updates


def begin(
    study: Study,
    setup: Setup,
    parameters: tuple[str, ...] = ("e",),
    zero_covariance: Floats = ZERO_PRIOR,
    *,
    polar_sd_rad: float = 0.0,
) -> EyeSession:
    """Return an eye before its first frame; raises `CalibrationError`.

    The setup has IOP, thickness, gap and polar angle; the latter is uncertain by
    `polar_sd_rad`, 0 if it is stated. The globe counts as open.
    """
    # 7 ms: not for a program that only reads calibrations
    from scleraforce.calibration.filter.linear_sections import linear_eye

    model = linear_eye(study, setup, "thickness" in parameters, polar_sd_rad)

    return begin_with(model, study.calibration, parameters, zero_covariance)


def begin_with(
    model: "LinearEye",
    study: CalibrationStudy,
    parameters: tuple[str, ...] = ("e",),
    zero_covariance: Floats = ZERO_PRIOR,
) -> EyeSession:
    """Return an eye of a model before its first frame."""
    eye = eye_filter(model, study, parameters)
    prior = unscented_filter.initial_posterior(*eye.space.prior())
    belief = section_registration.first_belief(model)
    state = EyeState(
        prior, belief, np.zeros((len(prior.mean), len(SHARED))), ZERO_PRIOR
    )

    return EyeSession(eye, state, zero_covariance)


def step(
    session: EyeSession,
    boundaries: Boundaries,
    force_n: float,
    since_start_s: float = 0.0,
) -> EyeSession:
    """Return the eye after one more frame; one of little force shows where it lies, but
    nothing of its modulus.
    """
    eye = session.filter
    state = session.state
    if force_n > eye.study.min_force_n:
        found = assimilate(session, boundaries, force_n, since_start_s)
        return replace(
            session,
            state=state if isinstance(found, SkippedFrame) else found.state,
            last=found,
        )

    if np.isfinite(boundaries.depth_m).sum() >= LEAST_POINTS:
        prior = section_registration.frame_prior(state.belief, eye.study)
        fit = section_registration.register(
            eye.model,
            boundaries,
            max(force_n, 0.0),
            session.modulus.mean_pa,
            prior,
        )
        state = replace(
            state, belief=section_registration.updated_belief(state.belief, prior, fit)
        )

    reason = (
        f"at most {from_si(eye.study.min_force_n, 'mn'):g} mN: used as a reference of"
        " the pose"
    )
    return replace(session, state=state, last=SkippedFrame(reason))
