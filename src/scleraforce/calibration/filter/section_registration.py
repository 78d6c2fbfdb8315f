"""Rigid registration: fits the predicted section to a frame (paper sec. 3.2).

Pose and modulus are fitted together, frame by frame, to the whole of both boundaries:
at high forces the arc as a whole moves, so no part of it is a fixed reference. The pose
about which the eye of a recording moves is carried from frame to frame as a belief; a
frame's pose is a draw about it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from typing import TYPE_CHECKING

import numpy as np

from scleraforce.base import normal_distribution
from scleraforce.base.arrays import Floats
from scleraforce.calibration.filter.eye_parameters import (
    WallState,
    stated_polar_rad,
    stated_wall,
)
from scleraforce.fit import curve_placement, least_squares
from scleraforce.records.study import CalibrationStudy
from scleraforce.wall.wall_in_metres import Boundaries

if TYPE_CHECKING:  # 7 ms: not for a program that only reads calibrations
    from scleraforce.calibration.filter.linear_sections import LinearEye

# What a frame depends on beside the eye: the pose, the contact's polar angle, and an
# offset of the inner boundary (the segmentation's, or a wall that is not as thick as
# stated).
NUISANCES = ("lateral_m", "depth_m", "rotation_rad", "polar_rad", "inner_m")
BY_LATERAL, BY_DEPTH, BY_ROTATION, BY_POLAR, BY_INNER = range(5)
LOG_MODULUS = 5  # ln E, which comes after the nuisances among a frame's unknowns

MODULUS_STEP = 0.01
FORCE_STEP_N = 1e-4


def parameter_sections(
    model: "LinearEye",
    names: Sequence[str],
    values_rp: Floats,
    force_n: float,
    polar_rad: float,
) -> Floats:
    """Return the sections for rows of uncertain parameters, shape (row, boundary,
    sample, 2).
    """
    stated = stated_wall(model.setup, 1.0, force_n, polar_rad)
    return model.curves(
        [
            replace(stated, **dict(zip(names, row, strict=True)))
            for row in values_rp.tolist()
        ]
    )


def place_section(curves: Floats, nuisance: Floats) -> Floats:
    """Return sections (..., sample, 2) in the frame at the pose of `nuisance` (5,)."""
    return curve_placement.place_curves(
        curves, nuisance[BY_LATERAL], nuisance[BY_DEPTH], nuisance[BY_ROTATION]
    )


def polar_derivative(
    model: "LinearEye",
    state: WallState,
    nuisance: Floats,
    places: curve_placement.PlacesOnFrame,
) -> Floats:
    """Return the slope of the depths at places by the contact's polar angle, (place,)
    m/rad; 0 if that is stated.
    """
    low = model.polar_nodes_rad[0]
    high = model.polar_nodes_rad[-1]
    if low == high:
        return np.zeros(len(places.lateral_m))

    return _growth(
        model,
        [replace(state, polar_rad=polar) for polar in (low, high)],
        nuisance,
        places,
    ) / (high - low)


def _growth(
    model: "LinearEye",
    ends: Sequence[WallState],
    nuisance: Floats,
    places: curve_placement.PlacesOnFrame,
) -> Floats:
    """Return the growth of the depths at places from one state to another, (place,)
    m.
    """
    curves = place_section(model.curves(ends), nuisance)
    less, more = (curve_placement.curve_depths(curve, places)[0] for curve in curves)
    return more - less


def predict_frame(
    model: "LinearEye",
    state: WallState,
    nuisance: Floats,
    places: curve_placement.PlacesOnFrame,
) -> curve_placement.PlacedCurves:
    """Return the prediction at places; derivatives by the `NUISANCES` and ln E, (place,
    6).
    """
    states = [
        state,
        replace(state, youngs_modulus_pa=state.youngs_modulus_pa * (1 + MODULUS_STEP)),
    ]
    curves = place_section(model.curves(states), nuisance)
    (depth, slope, seen), stiffer = (
        curve_placement.curve_depths(curve, places) for curve in curves
    )
    by_pose = curve_placement.pose_derivatives(
        places, depth, slope, (nuisance[BY_LATERAL], nuisance[BY_DEPTH])
    )
    # held while a frame is fitted, see `polar_derivative`
    by_polar = np.zeros_like(depth)
    by_modulus = (stiffer[0] - depth) / MODULUS_STEP
    jacobian = np.stack([*by_pose, by_polar, places.is_inner, by_modulus], axis=1)

    return curve_placement.PlacedCurves(
        depth + nuisance[BY_INNER] * places.is_inner, slope, jacobian, seen
    )


def force_derivative(
    model: "LinearEye",
    state: WallState,
    nuisance: Floats,
    places: curve_placement.PlacesOnFrame,
) -> Floats:
    """Return the derivative of the depths at places by the force, (place,) in m/N."""
    states = [
        replace(state, force_n=state.force_n + step)
        for step in (-FORCE_STEP_N, FORCE_STEP_N)
    ]
    return _growth(model, states, nuisance, places) / (2 * FORCE_STEP_N)


# Of a recording's nuisances before its first frame. The polar angle stays as stated, or
# in the middle of its range: it turns the section by a few um, which a fit could not
# tell from an uneven segmentation.
FIRST_SD = np.array([2e-3, 1.5e-3, 0.1, 0.0, 0.0])
COLUMNS = 48  # of each boundary that are fitted
COLUMN_SD_M = 10e-6
# number of frames that show the common offset of the inner boundary as well as one
# would alone
INNER_FRAMES = 25
# a frame's own modulus is free: the pose must not follow what the filter believes
LOG_MODULUS_SD = 1.0
STOPPING = least_squares.StoppingRule(
    iterations=25, converged_sd=0.1, settled_cost=0.01, retry_damping=1e-2
)
START_LATERAL_M = np.linspace(-2.5e-3, 2.5e-3, 11)
START_MODULUS = (0.15, 0.3, 0.6, 1.0, 2.0)  # of the modulus that is given


@dataclass(frozen=True, eq=False)
class PoseBelief:
    """The distribution of the values that frames share: mean (5,) and covariance (5,
    5), ordered as `NUISANCES`.
    """

    mean: Floats
    covariance: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class Registered:
    """A frame's fit: nuisances (5,), their covariance (5, 5), and the wall, of the
    frame's own modulus.
    """

    nuisance: Floats
    covariance: Floats
    wall: WallState


def first_belief(model: "LinearEye") -> PoseBelief:
    """Return the belief before the first frame: a wide one of the pose."""
    mean = np.zeros(5)
    mean[BY_POLAR] = stated_polar_rad(model.setup)
    return PoseBelief(mean, np.diag(FIRST_SD**2))


def frame_prior(belief: PoseBelief, study: CalibrationStudy) -> PoseBelief:
    """Return the prior of the next frame's nuisances: the recording's belief, and that
    the eye may have moved.
    """
    inner_m = INNER_FRAMES**0.5 * study.inner_sd_m
    moved = np.array(
        [study.shift_sd_m, study.shift_sd_m, study.turn_sd_rad, 0.0, inner_m]
    )
    return PoseBelief(belief.mean, belief.covariance + np.diag(moved**2))


def updated_belief(
    belief: PoseBelief, prior: PoseBelief, fit: Registered
) -> PoseBelief:
    """Return the belief after a frame (Rauch, Tung and Striebel 1965: the frame's fit,
    smoothed back).
    """
    free = np.diag(prior.covariance) > 0
    gain = np.zeros((5, 5))
    both = np.ix_(free, free)
    gain[both] = belief.covariance[both] @ np.linalg.inv(prior.covariance[both])
    mean = belief.mean + gain @ (fit.nuisance - belief.mean)
    covariance = belief.covariance + gain @ (fit.covariance - prior.covariance) @ gain.T

    return PoseBelief(mean, (covariance + covariance.T) / 2)


def register(
    model: "LinearEye",
    boundaries: Boundaries,
    force_n: float,
    modulus_pa: float,
    prior: PoseBelief,
) -> Registered:
    """Fit pose and modulus to a frame by a damped Gauss-Newton method on Cauchy's
    loss.
    """
    sought = stated_wall(model.setup, modulus_pa, force_n, float(prior.mean[BY_POLAR]))
    fit = _SectionProblem(model, _thinned(boundaries), sought, prior)
    unknown, _, _ = least_squares.gauss_newton(fit, fit.start(), STOPPING)
    return fit.result(unknown)


def _thinned(boundaries: Boundaries) -> least_squares.WallColumns:
    """Return at most COLUMNS places of each boundary, evenly among the seen columns."""
    columns = []
    for depth in boundaries.depth_m:
        seen = np.flatnonzero(np.isfinite(depth))
        columns.append(
            seen[np.linspace(0, len(seen) - 1, min(COLUMNS, len(seen))).astype(np.intp)]
        )

    boundary = np.repeat([0, 1], [len(part) for part in columns]).astype(np.intp)
    column = np.concatenate(columns)
    places = curve_placement.PlacesOnFrame(boundaries.lateral_m[column], boundary)
    return least_squares.WallColumns(
        places, boundaries.depth_m[boundary, column], np.full(len(column), COLUMN_SD_M)
    )


class _SectionProblem:
    """The least-squares problem of one frame; certain values stay fixed.

    Unknown (6,): the nuisances and ln E.
    """

    def __init__(
        self,
        model: "LinearEye",
        columns: least_squares.WallColumns,
        sought: WallState,
        prior: PoseBelief,
    ) -> None:
        self.model = model
        self.columns = columns
        self.sought = sought
        self.mean = np.append(prior.mean, log(sought.youngs_modulus_pa))
        self.free = np.append(np.diag(prior.covariance) > 0, True)
        covariance = np.zeros((6, 6))
        covariance[:5, :5] = prior.covariance
        covariance[LOG_MODULUS, LOG_MODULUS] = LOG_MODULUS_SD**2
        self.precision = self._inverse(covariance)
        self.wide = covariance[BY_LATERAL, BY_LATERAL] > (0.5e-3) ** 2

    def _inverse(self, matrix: Floats) -> Floats:
        """Return the inverse (6, 6) of the part of free unknowns; 0 elsewhere."""
        inverse = np.zeros((6, 6))
        free = np.ix_(self.free, self.free)
        inverse[free] = np.linalg.inv(matrix[free])
        return inverse

    def start(self) -> Floats:
        """Return the start: the prior's mean, or the best of a coarse search if the
        pose is unknown.
        """
        if not self.wide:
            return self.mean.copy()

        moduli = np.log(START_MODULUS) + self.mean[LOG_MODULUS]
        curves = self.model.curves([self._state(log_modulus) for log_modulus in moduli])
        best = np.inf
        unknown = self.mean.copy()

        for log_modulus, curve in zip(moduli, curves, strict=True):
            for lateral in START_LATERAL_M:
                nuisance = self.mean[:5].copy()
                nuisance[BY_LATERAL] = lateral
                depth = curve_placement.curve_depths(
                    place_section(curve, nuisance), self.columns.places
                )[0]
                rest = self.columns.depth_m - depth
                shift = float(np.median(rest))

                cost = float(np.abs(rest - shift).sum())
                if cost < best:
                    nuisance[BY_DEPTH] += shift
                    best = cost
                    unknown = np.append(nuisance, log_modulus)

        return unknown

    def _state(self, log_modulus: float) -> WallState:
        return replace(self.sought, youngs_modulus_pa=float(np.exp(log_modulus)))

    def evaluate(self, unknown: Floats) -> tuple[least_squares.NormalEquations, float]:
        """Return the normal equations, in which fixed unknowns do not move, and the
        cost.
        """
        placed = self._predict(unknown)
        away = unknown - self.mean
        normal, gradient = self.columns.normal_equations(placed)
        normal += self.precision
        normal[~self.free, ~self.free] = 1.0
        terms = least_squares.NormalEquations(
            normal, gradient - self.precision @ away, ()
        )

        return terms, self.columns.loss(placed) + float(away @ self.precision @ away)

    def inside(self, unknown: Floats) -> Floats:
        """Return the unknowns as they are: linear mechanics has no bounds."""
        return unknown

    def _predict(self, unknown: Floats) -> curve_placement.PlacedCurves:
        """Return what the frame shows; fixed unknowns do not move it."""
        placed = predict_frame(
            self.model,
            self._state(unknown[LOG_MODULUS]),
            unknown[:5],
            self.columns.places,
        )
        return replace(placed, jacobian=placed.jacobian * self.free)

    def result(self, unknown: Floats) -> Registered:
        """Return the fit, its covariance scaled by the misfit (Birge 1932)."""
        placed = self._predict(unknown)
        size = np.abs(self.columns.residual(placed)[placed.seen])
        scale = max(1.0, normal_distribution.robust_spread(size)) if len(size) else 1.0
        data, _ = self.columns.normal_equations(placed, scale)
        covariance = self._inverse(data + self.precision)
        wall = self._state(unknown[LOG_MODULUS])

        return Registered(
            nuisance=unknown[:5].copy(), covariance=covariance[:5, :5], wall=wall
        )
