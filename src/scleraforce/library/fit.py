"""The force from the wall's boundaries alone: the wall of the response library that lies best on them.

Least squares with a robust loss (Cauchy's), by a damped Gauss-Newton method. Unknown are the dent and the pose;
thickness, gap, E, IOP and the eye's size are unknown too, with priors, so that an unknown property widens the force's
interval by as much as it should; so is the rigidity of a globe that may be sealed. The force follows from the dent: F =
E f(dent, wall, pressure under the needle).

`docs/reader.md` gives the sources of the noise and the other constants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scleraforce.library import unknowns as at
from scleraforce.library.fit_starts import (
    LARGEST_N,
    bearing_start,
    higher_start,
    limbus_starts,
    one_sided_starts,
    starts,
)
from scleraforce.library.placement import Columns, Placed, Places, Stopping, gauss_newton, robust_spread
from scleraforce.library.prediction import (
    HIGHEST_POLE,
    Walls,
    force_n,
    formed_wall,
    keep_within,
    law_slope,
    off_the_law,
    predict_wall,
)
from scleraforce.library.prior import HEAVY, Prior
from scleraforce.library.responses import Library

Array = NDArray[np.float64]
_Fit = tuple[Array, Placed, float]  # unknowns, prediction and cost

COLUMNS = 110  # of each boundary that are fitted
POINT_SD_M = np.array([5e-6, 9e-6])  # of the outer and the inner boundary along their normal
CORRELATED_M = 1.5e-3  # so far apart two errors of a boundary are independent
# Beyond it a surface is not a wall. Virtual eyes reach 9 um, with a cornea in view 13 um.
NO_WALL_M = 20e-6
LEAST_NOISE = 0.3  # of a frame's boundaries, over POINT_SD_M: a small misfit may be chance
OUTLIER_SD = 8.0
LAYER_M = 0.3e-3  # so far below the wall the choroid may end, which stretches of the inner boundary may follow
HEAVY_CAUCHY = 2.0  # standard deviations, of unknowns with a heavy prior
MODEL_SD = 0.01  # relative, of the force: real walls against the library's
MODEL_SD_N = 0.1e-3
STARTS = 2
LARGEST_LOG_SIZE = 0.5
# A limbus is looked for where a fit leaves aside more than such a share of the columns, or loses more than 99 % of the
# fits of even walls of the library do (138 frames of 16 virtual eyes).
LOST, STRAINED = 0.05, 30.0
LIMBUS_STARTS = 4  # the best ones
STOPPING = Stopping(iterations=20, converged_sd=0.05, settled_cost=0.005, retry_damping=1e-2)
TO_THE_END = Stopping(iterations=20, converged_sd=0.002, retry_damping=1e-2)  # for differences of fits
FIRST_STEPS = replace(STOPPING, iterations=8)  # from each of several starts; the best is then followed to its end
# Of where the pole lies, in one step: towards the base the wall's bulge turns quickly with it, and a fit that strides
# farther goes to and fro.
POLE_STRIDE = 0.05
DRAWS = 512
# Of a sealed globe's fit: how unsure the logarithm of the pressure is where others are sought, how far off in its
# standard deviations, how much lower a cost has to be, and how often.
VALLEY_SD, VALLEY_STRIDE, VALLEY_LOWER, VALLEY_ROUNDS = 0.08, 2.0, 0.1, 4
FARTHEST_EYE = 3.0  # standard deviations of E and k that a discrepancy is followed to
INTERVAL = (0.05, 0.95)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundaryFit:
    """The wall of the library that lies best on a frame's boundaries.

    `force_n` is the median, `interval_n` holds 90 %; `draws_n` (draw,) are forces drawn from the posterior. `contact_m`
    is the contact's lateral place from the frame's middle, `tip_m` its depth of indentation. `misfit_m` is the robust
    root mean square distance from the wall, `outliers` the share of columns farther off than a segmented wall ever is,
    not counting an inner boundary at the end of a layer below the wall. `wall_bmc` (boundary, point, 2) is the wall in
    the frame, m; `unknown` and `sd` (unknown,) are the values in the order of `NAMES`. `iop_pa` is the pressure in the
    eye under the needle, `tension` that times the eye's radius over E times thickness. `loss` is the cost of boundaries
    and prior, in squares of standard deviations.
    """

    force_n: float
    interval_n: tuple[float, float]
    draws_n: Array
    contact_m: float
    tip_m: float
    misfit_m: float
    outliers: float
    wall_bmc: Array
    unknown: Array
    sd: Array
    iop_pa: float
    tension: float
    loss: float

    def probabilities(self, bounds_n: tuple[float, ...]) -> tuple[float, ...]:
        """Return the probability of each class; no class is ever certain, as the number of draws is finite."""
        above = [(int((self.draws_n > bound).sum()) + 0.5) / (len(self.draws_n) + 1.0) for bound in bounds_n]
        edges = (1.0, *above, 0.0)
        return tuple(high - low for high, low in pairwise(edges))


def fit_boundaries(
    library: Library,
    lateral_m: Array,
    depth_bc: Array,
    prior: Prior,
    smoothing_m: float = 0.0,
    borne_n: float | None = None,
) -> BoundaryFit | None:
    """Fit the library to the boundaries of a frame; None if it shows fewer columns than there are unknowns.

    `lateral_m` (column,): places of the frame's columns from its middle. `depth_bc` (2, column), m: depth of the outer
    and the inner boundary below the frame's top, free of refraction; NaN where unseen. `smoothing_m`: standard
    deviation of the Gaussian with which the segmentation smooths the outer boundary. `borne_n`: the needle's force, if
    known: one more start in a sealed globe.
    """
    columns = _thinned(lateral_m, depth_bc, smoothing_m)
    outer = columns.places.outer
    if outer < 2 * len(at.NAMES):
        return None
    problem = _problem(library, columns, prior)
    walls = problem.walls
    begun = starts(walls, prior.mean, columns.places.lateral_m[:outer], columns.depth_m[:outer], STARTS)
    best = _best_fit(problem, begun)
    if problem.outliers(best[1]) > LOST or best[2] > STRAINED:
        near = ((best[0], best[1]), (begun[0], problem.evaluate(begun[0])[0]))
        again = [start for where in near for start in limbus_starts(columns, *where)]
        again += one_sided_starts(walls, columns, prior.mean, STARTS)
        again = sorted((problem.inside(start) for start in again), key=lambda start: problem.evaluate(start)[1])
        best = min(best, _best_fit(problem, again[:LIMBUS_STARTS]), key=lambda fit: fit[2]) if again else best
    if walls.globe.can_be_sealed:
        best = _along_valley(problem, _beyond(problem, best, borne_n))
    return problem.result(*best)


def fit_from(
    library: Library, lateral_m: Array, depth_bc: Array, prior: Prior, smoothing_m: float, unknown: Array
) -> BoundaryFit:
    """Fit as `fit_boundaries` from the unknowns of another fit only, to the end: for small changes of the prior."""
    problem = _problem(library, _thinned(lateral_m, depth_bc, smoothing_m), prior)
    return problem.result(*gauss_newton(problem, problem.inside(unknown.copy()), TO_THE_END, _step))


def _problem(library: Library, columns: Columns, prior: Prior) -> "_Problem":
    walls = Walls(library, prior.globe, gap_m=float(prior.mean[at.GAP]), thickness_m=float(prior.mean[at.THICKNESS]))
    return _Problem(walls, columns, prior)


def _best_fit(problem: "_Problem", starts: Sequence[Array]) -> _Fit:
    """Return unknowns, prediction and cost of the best fit from any start."""
    if len(starts) > 1:
        begun = (gauss_newton(problem, start, FIRST_STEPS, _step) for start in starts)
        starts = [min(begun, key=lambda fit: fit[2])[0]]
    return gauss_newton(problem, starts[0], STOPPING, _step)


def _beyond(problem: "_Problem", best: _Fit, borne_n: float | None) -> _Fit:
    """Return the best fit of a sealed globe's wall, also begun where a known force lies and at a higher pressure.

    Where the pressure has nearly run away, two dents that are alike may be under very different forces.
    """
    walls, mean = problem.walls, problem.prior.mean
    if walls.globe.mean <= 0.0:
        return best
    outer = problem.columns.places.outer
    surface = problem.columns.places.lateral_m[:outer], problem.columns.depth_m[:outer]
    begun = [higher_start(walls, mean, best[0], *surface)]
    if borne_n is not None:
        begun.append(bearing_start(walls, mean, borne_n, *surface))
    others = [_best_fit(problem, [problem.inside(start)]) for start in begun if start is not None]
    known = [fit for fit in others if force_n(walls, fit[0][None])[0] < LARGEST_N]
    return min([best, *known], key=lambda fit: fit[2])


def _along_valley(problem: "_Problem", best: _Fit) -> _Fit:
    """Return the best fit of a sealed globe's wall, also sought at higher and lower pressures.

    Where the pressure has nearly run away, dents of very different forces look nearly alike: a long bent valley with
    more than one lowest place.
    """
    for _ in range(VALLEY_ROUNDS):
        unknown, placed, cost = best
        spread_uz = problem.spread(unknown, placed)
        with_pressure = spread_uz @ spread_uz[at.PRESSURE]
        sd = float(np.sqrt(with_pressure[at.PRESSURE]))
        if sd < VALLEY_SD:
            break
        stride = VALLEY_STRIDE * with_pressure / sd
        sought = [_best_fit(problem, [problem.inside(unknown + way * stride)]) for way in (-1.0, 1.0)]
        best = min(best, *sought, key=lambda fit: fit[2])
        if best[2] > cost - VALLEY_LOWER:
            break
    return best


def _step(normal: Array, gradient: Array) -> Array:
    """Return the solution of normal equations, where the pole moves no farther than its effect is straight."""
    step: Array = np.asarray(np.linalg.solve(normal, gradient), dtype=np.float64)
    farther = float(np.hypot(*step[at.POLE])) / POLE_STRIDE
    if farther <= 1.0:
        return step
    pole, rest = step[at.POLE] / farther, slice(at.POLE.start)
    return np.concatenate([np.linalg.solve(normal[rest, rest], gradient[rest] - normal[rest, at.POLE] @ pole), pole])


def _thinned(lateral_m: Array, depth_bc: Array, smoothing_m: float) -> Columns:
    """Return at most COLUMNS places of each boundary, evenly among the columns, where they are seen."""
    step = max(1, -(-len(lateral_m) // COLUMNS))
    boundary, column = np.nonzero(np.isfinite(depth_bc[:, ::step]))
    column = column * step
    places = Places(lateral_m[column], boundary, smoothing_m)
    outer = places.lateral_m[: places.outer]
    as_one = max(1.0, CORRELATED_M / float(np.median(np.diff(outer)))) if len(outer) > 1 else 1.0
    return Columns(places, depth_bc[boundary, column], POINT_SD_M[boundary], as_one)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The least-squares problem of one frame."""

    walls: Walls
    columns: Columns
    prior: Prior

    def outliers(self, placed: Placed) -> float:
        """Return the share of columns that the loss leaves aside."""
        return float(np.mean(np.where(placed.seen, np.abs(self.columns.residual(placed)), np.inf) > OUTLIER_SD))

    def evaluate(self, unknown: Array) -> tuple[Placed, float]:
        """Return the prediction and its cost: the loss of the columns, and of leaving the prior."""
        placed = predict_wall(self.walls, unknown, self.columns.places)
        away = unknown - self.prior.mean
        heavy = away[HEAVY] / (HEAVY_CAUCHY * self.prior.sd[HEAVY])
        away[HEAVY] = 0.0
        known = away @ self.prior.precision @ away + HEAVY_CAUCHY**2 * np.log1p(heavy**2).sum()
        off = self._off(unknown[None])[0]
        known += off @ self.prior.calibrated @ off
        return placed, self.columns.loss(placed) + float(known)

    def normal_equations(self, unknown: Array, placed: Placed, scale: float = 1.0) -> tuple[Array, Array]:
        """Return the normal matrix (unknown, unknown) and the gradient (unknown,)."""
        normal, gradient = self.columns.normal_equations(placed, scale)
        precision, away = self.prior.precision.copy(), unknown - self.prior.mean
        precision[HEAVY, HEAVY] /= 1.0 + (away[HEAVY] / (HEAVY_CAUCHY * self.prior.sd[HEAVY])) ** 2
        slopes = np.stack([self.prior.same_force, law_slope(self.walls, unknown)])
        weighted = slopes.T @ self.prior.calibrated
        off = self._off(unknown[None])[0]
        return normal + precision + weighted @ slopes, gradient - precision @ away - weighted @ off

    def _off(self, unknown_su: Array) -> Array:
        """Return the deviations (sample, 2), in standard deviations, of the force at a dent and of the pressure."""
        same_force = (unknown_su - self.prior.mean) @ self.prior.same_force
        return np.stack([same_force, off_the_law(self.walls, unknown_su)], axis=1)

    def inside(self, unknown: Array) -> Array:
        """Keep dent and pressure within the library; a search strides beyond, even to walls of no thickness."""
        library = self.walls.library
        unknown[at.SIZE] = np.clip(unknown[at.SIZE], -LARGEST_LOG_SIZE, LARGEST_LOG_SIZE)
        unknown[at.TIP] = np.clip(unknown[at.TIP], 0.0, library.tip_m[-1] * np.exp(unknown[at.SIZE]))
        thickness = np.clip(unknown[at.THICKNESS] / np.exp(unknown[at.SIZE]), *library.thickness_m[[0, -1]])
        log_ends = np.log(library.iop_ratio_ends(thickness)) + unknown[at.MODULUS]
        unknown[at.PRESSURE] = np.clip(unknown[at.PRESSURE], *log_ends)
        unknown[at.FORM] = np.clip(unknown[at.FORM], *at.FORM_ENDS)
        unknown[at.POLE] *= min(1.0, HIGHEST_POLE / max(float(np.hypot(*unknown[at.POLE])), HIGHEST_POLE))
        return unknown

    def result(self, unknown: Array, placed: Placed, cost: float) -> BoundaryFit:
        """Return the fit with its uncertainty: the curvature's, with the noise estimated from the misfit (Birge)."""
        signed = self.columns.residual(placed)
        residual = np.where(placed.seen, np.abs(signed), np.inf)
        misfit = robust_spread(residual)
        below_m = signed * POINT_SD_M[1]
        layer = (self.columns.places.boundary == 1) & placed.seen & (below_m > 0.0) & (below_m < LAYER_M)
        spread_uz = self.spread(unknown, placed, float(np.clip(misfit, LEAST_NOISE, 1e3)))
        draws_n = self._drawn_forces(unknown, spread_uz)
        per_modulus = np.exp(unknown[self.walls.pressure] - unknown[at.MODULUS])
        radius_m = self.walls.library.radius_m * np.exp(unknown[at.SIZE])
        low_n, force, high_n = np.quantile(draws_n, [INTERVAL[0], 0.5, INTERVAL[1]])
        return BoundaryFit(
            force_n=float(force),
            interval_n=(float(low_n), float(high_n)),
            draws_n=draws_n,
            contact_m=float(unknown[at.LATERAL]),
            tip_m=float(unknown[at.TIP]),
            misfit_m=misfit * float(POINT_SD_M[0]),
            outliers=float(np.mean((residual > OUTLIER_SD * max(1.0, misfit)) & ~layer)),
            wall_bmc=formed_wall(self.walls, unknown),
            unknown=unknown,
            sd=np.linalg.norm(spread_uz, axis=1),
            iop_pa=float(np.exp(unknown[self.walls.pressure])),
            tension=float(per_modulus * radius_m / unknown[at.THICKNESS]),
            loss=cost,
        )

    def spread(self, unknown: Array, placed: Placed, scale: float = 1.0) -> Array:
        """Return the matrix from standard normal numbers to draws about the unknowns (unknown, number)."""
        normal, _ = self.normal_equations(unknown, placed, scale)
        sd = self.prior.sd  # in these units the matrix is well conditioned
        lower = np.linalg.cholesky(sd[:, None] * normal * sd)
        return np.asarray(sd[:, None] * np.linalg.inv(lower).T)

    def _drawn_forces(self, unknown: Array, spread_uz: Array) -> Array:
        """Return forces drawn from the posterior, with the model error of the library on top."""
        normal, (level_z, growth_z) = _standard_normal(len(at.NAMES) + 2), _standard_normal(2, seed=1).T
        drawn = unknown + normal[:, :-2] @ spread_uz.T
        drawn[:, at.TIP] = np.maximum(drawn[:, at.TIP], 0.0)
        drawn = keep_within(self.walls, drawn)
        library_n = force_n(self.walls, drawn)
        eye_z = np.clip(self._off(drawn), -FARTHEST_EYE, FARTHEST_EYE)
        corrected_n = self.prior.discrepancy.corrected_n(library_n, level_z, growth_z, eye_z)
        return np.maximum(corrected_n * np.exp(MODEL_SD * normal[:, -2]) + MODEL_SD_N * normal[:, -1], 0.0)


@lru_cache(maxsize=4)
def _standard_normal(size: int, seed: int = 0) -> Array:
    """Return DRAWS points of a standard normal distribution (draw, size), always the same, symmetric about 0."""
    half = np.random.default_rng(seed).standard_normal((DRAWS // 2, size))
    both = np.concatenate([half, -half])
    exact: Array = both / both.std(axis=0)
    return exact
