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
from numpy.typing import NDArray

from scleraforce.arrays import Flags, Floats


@dataclass(frozen=True, eq=False)
class Places:
    """Places on a frame, (place,): lateral m, and the boundary (0 outer, 1 inner),
    outer places first.

    `smoothing_m`: standard deviation of the Gaussian that smoothed the outer boundary;
    the fit of a library heeds it.
    """

    lateral_m: Floats
    boundary: NDArray[np.intp]
    smoothing_m: float = 0.0

    @property
    def outer(self) -> int:
        """Number of places on the outer boundary."""
        return int(np.searchsorted(self.boundary, 1))

    @property
    def is_inner(self) -> Floats:
        """1 on the inner boundary, 0 on the outer, (place,)."""
        return np.asarray(self.boundary == 1, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Placed:
    """Depths at places in m and slopes (place,), derivatives (place, unknown), and
    whether each place is reached.
    """

    depth_m: Floats
    slope: Floats
    jacobian: Floats
    seen: Flags


def place_curves(
    curves: Floats, lateral_m: float, depth_m: float, rotation_rad: float
) -> Floats:
    """Return curves (..., sample, 2) in the frame: turned about the section's origin,
    then shifted.
    """
    c = np.cos(rotation_rad)
    s = np.sin(rotation_rad)
    return curves @ np.array([[c, s], [-s, c]]) + np.array([lateral_m, depth_m])


def pose_derivatives(
    places: Places, depth_m: Floats, slope: Floats, pose: tuple[float, float]
) -> tuple[Floats, ...]:
    """Return the derivatives of depths (place,) by lateral shift, depth and rotation of
    the pose, (place,) each.
    """
    across = places.lateral_m - pose[0]
    down = depth_m - pose[1]
    return -slope, np.ones_like(depth_m), across + slope * down


def curve_depths(curves_bsc: Floats, places: Places) -> tuple[Floats, Floats, Flags]:
    """Return depth, slope and whether it is reached, each (place,), of placed curves
    (boundary, sample, 2).

    Of a wall that folds back under itself, the part that comes first along the curve
    counts: light sees that.
    """
    parts = map(depths_along, curves_bsc, np.split(places.lateral_m, [places.outer]))
    depth, slope, seen = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return depth, slope, seen


def depths_along(curve_sc: Floats, at: Floats) -> tuple[Floats, Floats, Flags]:
    """Interpolate a polyline without the parts that fold back; nothing is seen of one
    that only folds back.
    """
    lateral, down = curve_sc.T
    if (lateral[1:] <= lateral[:-1]).any():
        ahead = np.concatenate(
            [[True], lateral[1:] > np.maximum.accumulate(lateral)[:-1]]
        )
        lateral = lateral[ahead]
        down = down[ahead]

        if len(lateral) == 1:
            return (
                np.full(at.shape, down[0]),
                np.zeros(at.shape),
                np.zeros(at.shape, dtype=np.bool_),
            )

    segment = np.minimum(np.maximum(lateral.searchsorted(at) - 1, 0), len(lateral) - 2)
    left = lateral[segment]
    top = down[segment]
    slope = (down[segment + 1] - top) / (lateral[segment + 1] - left)

    return top + slope * (at - left), slope, (at >= lateral[0]) & (at <= lateral[-1])


CAUCHY = 2.5  # standard deviations at which a column's weight is halved
# loss of a column that the wall does not reach: as one that is 4 CAUCHY off
UNSEEN_LOSS = 3.0
FIRST_DAMPING = 1e-3
# standard deviation of a normal distribution over the median of its size
NORMAL_MEDIAN = 1.4826


@dataclass(frozen=True, eq=False)
class Columns:
    """The wall that a frame shows: places, their depth and the standard deviation along
    the normal, (place,) in m.

    `as_one` neighbouring places share one error.
    """

    places: Places
    depth_m: Floats
    sd_m: Floats
    as_one: float = 1.0

    def residual(self, placed: Placed) -> Floats:
        """Return how far the columns lie off along the normal, in standard deviations
        (place,).
        """
        return (self.depth_m - placed.depth_m) / self._depth_sd_m(placed)

    def loss(self, placed: Placed) -> float:
        """Return Cauchy's loss of all columns."""
        size = self.residual(placed)[placed.seen]
        lost = np.log1p((size / CAUCHY) ** 2).sum() + UNSEEN_LOSS * np.count_nonzero(
            ~placed.seen
        )
        return float(CAUCHY**2 * lost / self.as_one)

    def normal_equations(
        self, placed: Placed, scale: float = 1.0
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

    def _depth_sd_m(self, placed: Placed) -> Floats:
        """Return the standard deviation of the depths (place,): that along the normal,
        seen down a column.
        """
        return self.sd_m * np.sqrt(1 + placed.slope**2)


Prediction = TypeVar("Prediction")


class Problem(Protocol[Prediction]):
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


class Stopping(NamedTuple):
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
    problem: Problem[Prediction],
    start: Floats,
    stopping: Stopping,
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


def robust_spread(size: Floats) -> float:
    """Return the standard deviation of residuals from the median of their size, which
    outliers do not move.
    """
    return NORMAL_MEDIAN * float(np.median(size))
