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
UNSEEN_LOSS = 3.0
FIRST_DAMPING = 1e-3


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
        size = self.residual(placed)[placed.seen]
        lost = np.log1p((size / CAUCHY) ** 2).sum() + UNSEEN_LOSS * np.count_nonzero(
            ~placed.seen
        )
        return float(CAUCHY**2 * lost / self.as_one)

    def normal_equations(
        self, placed: PlacedCurves, scale: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return the weighted normal matrix (unknown, unknown) and gradient (unknown,),
        SDs times `scale`.
        """
        jacobian = placed.jacobian / self._depth_sd_m(placed)[:, None]
        residual = self.residual(placed)
        weight = np.where(placed.seen, 1 / (1 + (residual / CAUCHY) ** 2), 0.0) / (
            self.as_one * scale**2
        )
        weighted = jacobian * weight[:, None]

        return jacobian.T @ weighted, weighted.T @ residual

    def _depth_sd_m(self, placed: PlacedCurves) -> Floats:
        """Return the standard deviation of the depths (place,): that along the normal,
        seen down a column.
        """
        return self.sd_m * np.sqrt(1 + placed.slope**2)


Prediction = TypeVar("Prediction")


class LeastSquaresProblem(Protocol[Prediction]):
    """A fit to a frame: unknowns (unknown,), each with a prior."""

    def evaluate(self, unknown: Floats) -> tuple[Prediction, float]:
        """Return the prediction and its cost."""

    def normal_equations(
        self, unknown: Floats, placed: Prediction
    ) -> tuple[Floats, Floats]:
        """Return the normal matrix (unknown, unknown) and the gradient (unknown,), with
        the prior.
        """

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


def gauss_newton(
    problem: LeastSquaresProblem[Prediction],
    start: Floats,
    stopping: StoppingRule,
    step_of: Callable[[Floats, Floats], Floats] | None = None,
) -> tuple[Floats, Prediction, float]:
    """Return the fitted unknowns, their prediction and their cost; `step_of` solves the
    damped equations.
    """
    unknown = start
    damping = FIRST_DAMPING
    placed, cost = problem.evaluate(unknown)

    for _ in range(stopping.iterations):
        normal, gradient = problem.normal_equations(unknown, placed)
        damped = normal + damping * np.diag(np.diag(normal))
        trial = problem.inside(unknown + (step_of or np.linalg.solve)(damped, gradient))

        step = trial - unknown
        if float(step @ normal @ step) < stopping.converged_sd**2:
            break

        trial_placed, trial_cost = problem.evaluate(trial)
        if trial_cost >= cost:
            damping = max(10 * damping, stopping.retry_damping)
            continue

        hardly_damped = damping <= max(FIRST_DAMPING, stopping.retry_damping)
        settled = hardly_damped and cost - trial_cost < stopping.settled_cost
        unknown = trial
        placed = trial_placed
        cost = trial_cost
        damping = damping / 10

        if settled:
            break

    return unknown, placed, cost
