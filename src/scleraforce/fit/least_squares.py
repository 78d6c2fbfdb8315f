"""A section laid on a frame, and robust least squares on the depths that the frame then
shows.

The fit is a damped Gauss-Newton method on Cauchy's loss. The loss of a column that lies
r standard deviations off is c² ln(1 + (r/c)²): it grows like r² near 0 and hardly at
all far away, so a stretch that follows something else than the wall does not pull the
wall along (Huber and Ronchetti, Robust Statistics, 2009, sec. 7.8). The damping is
Marquardt's (1963), relative to the diagonal of the normal matrix.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame

CAUCHY = 2.5  # standard deviations at which a column's weight is halved
# loss of a column that the wall does not reach: as one that is 4 CAUCHY off
UNSEEN_LOSS = 3.0 * CAUCHY**2
FIRST_DAMPING = 1e-3

Deviations = TypeVar("Deviations", float, Floats)


def cauchy_loss(off: Deviations, scale: float = CAUCHY) -> Deviations:
    """Return Cauchy's loss of deviations in standard deviations; at `scale` it bends.

    >>> float(cauchy_loss(0.1).round(4)), float(cauchy_loss(100.0).round(1))
    (0.01, 46.1)
    """
    return scale**2 * np.log1p((off / scale) ** 2)


def cauchy_weight(off: Deviations, scale: float = CAUCHY) -> Deviations:
    """Return the weights with which squared deviations have the slope of Cauchy's loss.

    >>> cauchy_weight(0.0), cauchy_weight(CAUCHY)
    (1.0, 0.5)
    """
    return 1.0 / (1.0 + (off / scale) ** 2)


@dataclass(frozen=True, eq=False)
class WallColumns:
    """The wall that a frame shows: places, their depth and the standard deviation along
    the normal, (place,) in m.

    `as_one` neighbouring places share one error.
    """

    places: PlacesOnFrame
    depth_m: Floats
    sd_m: Floats
    as_one: float = 1.0

    def residual(self, placed: PlacedCurves) -> Floats:
        """Return how far the columns lie off along the normal, in standard deviations
        (place,).
        """
        return (self.depth_m - placed.depth_m) / self._depth_sd_m(placed)

    def loss(self, placed: PlacedCurves) -> float:
        """Return Cauchy's loss of all columns."""
        loss = cauchy_loss(self.residual(placed))
        return float(np.where(placed.seen, loss, UNSEEN_LOSS).sum() / self.as_one)

    def normal_equations(
        self, placed: PlacedCurves, scale: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return the weighted normal matrix (unknown, unknown) and gradient (unknown,),
        SDs times `scale`.
        """
        jacobian = placed.jacobian / self._depth_sd_m(placed)[:, None]
        residual = self.residual(placed)
        weight = np.where(placed.seen, cauchy_weight(residual), 0.0)
        weighted = jacobian * (weight / (self.as_one * scale**2))[:, None]

        return jacobian.T @ weighted, weighted.T @ residual

    def _depth_sd_m(self, placed: PlacedCurves) -> Floats:
        """Return the standard deviation of the depths (place,): that along the normal,
        seen down a column.
        """
        return self.sd_m * np.sqrt(1 + placed.slope**2)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal matrix (unknown, unknown) and gradient (unknown,) at some unknowns, and
    the misfit of each frame's columns over their SDs.
    """

    normal: Floats
    gradient: Floats
    misfits: tuple[float, ...]


class LeastSquaresProblem(Protocol):
    """A fit to frames: unknowns (unknown,), each with a prior."""

    def evaluate(self, unknown: Floats) -> tuple[NormalEquations, float]:
        """Return the normal equations, with the prior, and the cost."""

    def inside(self, unknown: Floats) -> Floats:
        """Return the nearest unknowns that can be predicted for."""


class StoppingRule(NamedTuple):
    """The end of a fit: after `iterations` steps, or a step shorter than `converged_sd`
    standard deviations.

    Or a step that is hardly damped and lowers the cost by less than `settled_cost`.
    `retry_damping` is the least damping after a step that made things worse.
    """

    iterations: int
    converged_sd: float
    settled_cost: float = 0.0
    retry_damping: float = 0.0


def judge_step(
    damping: float, gain: float, stopping: StoppingRule
) -> tuple[float, bool, bool]:
    """Return the next step's damping, whether a step that lowers the cost by `gain` is
    taken, and whether the fit then ends.

    Every descent follows this rule: `gauss_newton` here, and the compiled one of a
    frame (`compiled_search`).
    """
    if not gain > 0.0:
        return max(10.0 * damping, stopping.retry_damping), False, False

    is_hardly_damped = damping <= max(FIRST_DAMPING, stopping.retry_damping)
    return damping / 10.0, True, is_hardly_damped and gain < stopping.settled_cost


def damped_step(normal: Floats, gradient: Floats, damping: float) -> Floats:
    """Return the step (unknown,) of normal equations that are damped relative to their
    diagonal.
    """
    sd, scaled = _scaled(normal)
    damped = scaled + damping * np.eye(len(sd))
    return np.asarray(sd * np.linalg.solve(damped, sd * gradient))


def covariance_of(normal: Floats) -> Floats:
    """Return the covariance (unknown, unknown): the inverse of a normal matrix."""
    sd, scaled = _scaled(normal)
    return np.asarray(np.linalg.inv(scaled) * np.outer(sd, sd))


def _scaled(normal: Floats) -> tuple[Floats, Floats]:
    """Return units (unknown,) in which the diagonal of a normal matrix is 1, and the
    matrix in them: metres and logarithms solve badly together.
    """
    sd = 1.0 / np.sqrt(np.diag(normal))
    return sd, normal * np.outer(sd, sd)


def gauss_newton(
    problem: LeastSquaresProblem,
    start: Floats,
    stopping: StoppingRule,
    find_step: Callable[[Floats, Floats, float], Floats] = damped_step,
) -> tuple[Floats, NormalEquations, float]:
    """Return the fitted unknowns, their normal equations and their cost; `find_step`
    solves normal equations with a damping.
    """
    unknown = start
    damping = FIRST_DAMPING
    terms, cost = problem.evaluate(unknown)

    for _ in range(stopping.iterations):
        step = find_step(terms.normal, terms.gradient, damping)
        trial = problem.inside(unknown + step)
        step = trial - unknown
        if float(step @ terms.normal @ step) < stopping.converged_sd**2:
            break

        trial_terms, trial_cost = problem.evaluate(trial)
        damping, is_better, has_settled = judge_step(
            damping, cost - trial_cost, stopping
        )
        if not is_better:
            continue

        unknown = trial
        terms = trial_terms
        cost = trial_cost
        if has_settled:
            break

    return unknown, terms, cost
