"""The fit of a frame by arrays: starts, damped Gauss-Newton steps, a sealed globe's valley, and the posterior.

No limbus is looked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import fit_arrays
import numpy as np

from predicted_walls import Walls, formed_wall, predict_wall
from scleraforce.arrays import Floats
from scleraforce.library import fit_frame, fit_starts, search_loops, unknowns as at
from scleraforce.library.fit import BoundaryFit, _standard_normal, law_of
from scleraforce.library.placement import Columns, Placed, Places, gauss_newton, robust_spread
from scleraforce.library.prior import HEAVY, Prior
from scleraforce.library.responses import Library
from scleraforce.library.sealed import iop_ratio_at_dent

Fit = tuple[Floats, Placed, float]  # unknowns, prediction and cost
LAW_STEPS = {at.TIP: 1e-7, at.THICKNESS: 1e-7, at.MODULUS: 1e-4, at.IOP: 1e-4, at.SIZE: 1e-4, at.PRESSURE: 1e-4}


@dataclass(frozen=True, eq=False)
class Problem:
    """The least-squares problem of one frame."""

    walls: Walls
    columns: Columns
    prior: Prior

    def off(self, unknown_su: Floats) -> Floats:
        """The deviations (sample, 2) of the force at a dent and of the pressure."""
        off, sd = fit_arrays.off_the_law(self.walls, unknown_su)
        law = off / sd if self.walls.globe.can_be_sealed else np.zeros_like(off)
        return np.stack([(unknown_su - self.prior.mean) @ self.prior.same_force, law], axis=1)

    def evaluate(self, unknown: Floats) -> tuple[Placed, float]:
        """The prediction and its cost."""
        placed, away = predict_wall(self.walls, unknown, self.columns.places), unknown - self.prior.mean
        heavy = away[HEAVY] / (search_loops.HEAVY_CAUCHY * self.prior.sd[HEAVY])
        away[HEAVY] = 0.0
        known = away @ self.prior.precision @ away + search_loops.HEAVY_CAUCHY**2 * np.log1p(heavy**2).sum()
        off = self.off(unknown[None])[0]
        return placed, self.columns.loss(placed) + float(known + off @ self.prior.calibrated @ off)

    def normal_equations(self, unknown: Floats, placed: Placed, scale: float = 1.0) -> tuple[Floats, Floats]:
        """The normal matrix (unknown, unknown) and the gradient (unknown,)."""
        normal, gradient = self.columns.normal_equations(placed, scale)
        precision, away = self.prior.precision.copy(), unknown - self.prior.mean
        precision[HEAVY, HEAVY] /= 1.0 + (away[HEAVY] / (search_loops.HEAVY_CAUCHY * self.prior.sd[HEAVY])) ** 2
        slopes = np.zeros((2, len(unknown)))
        slopes[0] = self.prior.same_force
        if self.walls.globe.can_be_sealed:
            varied = unknown + np.array([step * np.eye(len(unknown))[which] for which, step in LAW_STEPS.items()])
            off, sd = fit_arrays.off_the_law(self.walls, np.concatenate([unknown[None], varied]))
            slopes[1, list(LAW_STEPS)] = (off[1:] - off[0]) / (np.array(list(LAW_STEPS.values())) * sd[0])
        weighted = slopes.T @ self.prior.calibrated
        off = self.off(unknown[None])[0]
        return normal + precision + weighted @ slopes, gradient - precision @ away - weighted @ off

    def inside(self, unknown: Floats) -> Floats:
        """The nearest unknowns within the library."""
        library, largest, highest = self.walls.library, search_loops.LARGEST_LOG_SIZE, search_loops.HIGHEST_POLE
        unknown[at.SIZE] = np.clip(unknown[at.SIZE], -largest, largest)
        unknown[at.TIP] = np.clip(unknown[at.TIP], 0.0, library.tip_m[-1] * np.exp(unknown[at.SIZE]))
        thickness = np.clip(unknown[at.THICKNESS] / np.exp(unknown[at.SIZE]), *library.thickness_m[[0, -1]])
        log_ends = np.log(library.iop_ratio_ends(thickness)) + unknown[at.MODULUS]
        unknown[at.PRESSURE] = np.clip(unknown[at.PRESSURE], *log_ends)
        unknown[at.FORM] = np.clip(unknown[at.FORM], *at.FORM_ENDS)
        unknown[at.POLE] *= min(1.0, highest / max(float(np.hypot(*unknown[at.POLE])), highest))
        return unknown

    def best_fit(self, starts: Sequence[Floats]) -> Fit:
        """The best fit from any start."""
        if len(starts) > 1:
            starts = [
                min(
                    (gauss_newton(self, one, fit_frame.FIRST_STEPS, step_of) for one in starts), key=lambda fit: fit[2]
                )[0]
            ]
        return gauss_newton(self, starts[0], fit_frame.STOPPING, step_of)

    def spread(self, unknown: Floats, placed: Placed, scale: float = 1.0) -> Floats:
        """The matrix from standard normal numbers to draws about the unknowns (unknown, number)."""
        normal, sd = self.normal_equations(unknown, placed, scale)[0], self.prior.sd
        return np.asarray(sd[:, None] * np.linalg.inv(np.linalg.cholesky(sd[:, None] * normal * sd)).T)

    def drawn_forces(self, unknown: Floats, spread_uz: Floats) -> Floats:
        """Forces drawn from the posterior."""
        normal, (level_z, growth_z) = _standard_normal(len(unknown) + 2), _standard_normal(2, seed=1).T
        drawn = unknown + normal[:, :-2] @ spread_uz.T
        drawn[:, at.TIP] = np.maximum(drawn[:, at.TIP], 0.0)
        known = self.walls.globe
        if known.can_be_sealed:
            volume, resting_pa = fit_arrays.displaced_m3(self.walls, drawn), np.exp(drawn[:, at.IOP])
            ends = [np.log(known.globe(k).pressure(resting_pa, volume)) for k in (known.lowest, known.highest)]
            drawn[:, at.PRESSURE] = np.clip(drawn[:, at.PRESSURE], *ends)
        eye_z = np.clip(self.off(drawn), -fit_frame.FARTHEST_EYE, fit_frame.FARTHEST_EYE)
        corrected = self.prior.discrepancy.corrected_n(fit_arrays.force_n(self.walls, drawn), level_z, growth_z, eye_z)
        noise = np.exp(fit_frame.MODEL_SD * normal[:, -2]), fit_frame.MODEL_SD_N * normal[:, -1]
        return np.maximum(corrected * noise[0] + noise[1], 0.0)


def step_of(normal: Floats, gradient: Floats) -> Floats:
    """The solution of normal equations, where the pole moves no farther than its effect is straight."""
    step = np.linalg.solve(normal, gradient)
    farther = float(np.hypot(*step[at.POLE])) / search_loops.POLE_STRIDE
    if farther <= 1.0:
        return step
    pole, rest = step[at.POLE] / farther, slice(at.POLE.start)
    return np.concatenate([np.linalg.solve(normal[rest, rest], gradient[rest] - normal[rest, at.POLE] @ pole), pole])


def fit(library: Library, lateral_m: Floats, depth_bc: Floats, prior: Prior, smoothing_m: float = 0.0) -> BoundaryFit:
    """The fit of a frame."""
    step = -(-len(lateral_m) // fit_frame.COLUMNS)
    boundary, column = np.nonzero(np.isfinite(depth_bc[:, ::step]))
    places = Places(lateral_m[column * step], boundary, smoothing_m)
    surface, depth_m = places.lateral_m[: places.outer], depth_bc[boundary, column * step]
    as_one = max(1.0, fit_frame.CORRELATED_M / float(np.median(np.diff(surface))))
    sd_m = np.where(boundary == 0, fit_frame.OUTER_SD_M, fit_frame.INNER_SD_M)
    walls = Walls(library, prior.globe, gap_m=float(prior.mean[at.GAP]), thickness_m=float(prior.mean[at.THICKNESS]))
    problem = Problem(walls, Columns(places, depth_m, sd_m, as_one), prior)
    outer = surface, depth_m[: places.outer]
    best = problem.best_fit(starts(walls, prior.mean, *outer))
    if walls.globe.can_be_sealed:
        higher = higher_start(walls, prior.mean, best[0], *outer)
        others = [] if higher is None else [problem.best_fit([problem.inside(higher)])]
        known = [other for other in others if fit_arrays.force_n(walls, other[0][None])[0] < fit_starts.LARGEST_N]
        best = along_valley(problem, min([best, *known], key=lambda one: one[2]))
    return result(problem, *best)


def along_valley(problem: Problem, best: Fit) -> Fit:
    """The best fit of a sealed globe's wall, also sought at higher and lower pressures."""
    for _ in range(fit_frame.VALLEY_ROUNDS):
        unknown, placed, cost = best
        spread_uz = problem.spread(unknown, placed)
        with_pressure = spread_uz @ spread_uz[at.PRESSURE]
        sd = float(np.sqrt(with_pressure[at.PRESSURE]))
        if sd < fit_frame.VALLEY_SD:
            break
        stride = fit_frame.VALLEY_STRIDE * with_pressure / sd
        sought = [problem.best_fit([problem.inside(unknown + way * stride)]) for way in (-1.0, 1.0)]
        best = min(best, *sought, key=lambda one: one[2])
        if best[2] > cost - fit_frame.VALLEY_LOWER:
            break
    return best


def result(problem: Problem, unknown: Floats, placed: Placed, cost: float) -> BoundaryFit:
    """The fit with its uncertainty."""
    residual = np.where(placed.seen, np.abs(problem.columns.residual(placed)), np.inf)
    misfit, law = robust_spread(residual), law_of(problem.walls.globe)
    spread_uz = problem.spread(unknown, placed, float(np.clip(misfit, fit_frame.LEAST_NOISE, fit_frame.MOST_NOISE)))
    draws_n = problem.drawn_forces(unknown, spread_uz)
    low_n, force, high_n = np.quantile(draws_n, [0.05, 0.5, 0.95])
    iop_pa, radius_m = np.exp(unknown[law.pressure]), problem.walls.library.radius_m * np.exp(unknown[at.SIZE])
    below_m = problem.columns.residual(placed) * fit_frame.INNER_SD_M
    layer = (problem.columns.places.boundary == 1) & placed.seen & (below_m > 0.0) & (below_m < fit_frame.LAYER_M)
    return BoundaryFit(
        force_n=force, interval_n=(low_n, high_n), draws_n=draws_n, contact_m=unknown[at.LATERAL],
        tip_m=unknown[at.TIP], misfit_m=misfit * fit_frame.OUTER_SD_M,
        outliers=float(np.mean((residual > fit_frame.OUTLIER_SD * max(1.0, misfit)) & ~layer)),
        wall_bmc=formed_wall(problem.walls, unknown), unknown=unknown, spread=spread_uz.T,
        iop_pa=iop_pa, tension=iop_pa / np.exp(unknown[at.MODULUS]) * radius_m / unknown[at.THICKNESS], loss=cost,
    )  # fmt: skip


def starts(walls: Walls, mean: Floats, lateral_m: Floats, depth_m: Floats) -> list[Floats]:
    """Dents that lie better than their neighbours, the best first, (unknown,) each."""
    dents, globe = fit_starts.DENTS, walls.globe
    samples, dent_s = np.repeat(mean[None], dents, axis=0), np.arange(dents)
    samples[:, at.TIP] = walls.library.tip_m[-1] * np.exp(mean[at.SIZE]) * np.linspace(0.0, 1.0, dents) ** 1.5
    if globe.can_be_sealed:
        thickness, resting, size, modulus = resting_wall(walls, mean)
        rigidity = np.repeat([globe.lowest, globe.mean], dents)
        tips = np.tile(np.minimum(samples[:, at.TIP] / size, walls.library.tip_m[-1]), 2)
        law = globe.globe(rigidity * size**3).over(modulus)
        ratio = iop_ratio_at_dent(walls.library, np.array(thickness), np.array(resting), tips, law)
        borne, samples, dent_s = np.isfinite(ratio), np.tile(samples, (2, 1)), np.tile(dent_s, 2)
        samples[:, at.PRESSURE] = np.log(np.where(borne, ratio, 1.0) * modulus)
        samples, dent_s = samples[borne], dent_s[borne]
    placed, cost = laid(walls, samples, lateral_m, depth_m)
    least = np.full(dents, np.inf)
    np.minimum.at(least, dent_s, cost)
    around, worst = np.concatenate([[np.inf], least, [np.inf]]), fit_starts.MUCH_WORSE * least.min()
    better = np.flatnonzero((least <= around[:-2]) & (least <= around[2:]) & (least <= worst))
    best = better[np.argsort(least[better])][: fit_starts.STARTS]
    return [placed[int(np.argmin(np.where(dent_s == dent, cost, np.inf)))] for dent in best]


def higher_start(walls: Walls, mean: Floats, fitted: Floats, lateral_m: Floats, depth_m: Floats) -> Floats | None:
    """The best state of a sealed globe at much higher pressures than `fitted`, if any lies about as well."""
    library, (thickness, resting, size, modulus) = walls.library, resting_wall(walls, mean)
    law = walls.globe.globe(walls.globe.mean * size**3).over(modulus)
    ratios = np.geomspace(resting, library.iop_ratio_ends(np.array(thickness))[1], fit_starts.PRESSURES)
    volumes = (law.level(ratios) - law.level(resting)) / law.rate
    tips = np.tile(library.tip_m, (len(ratios), 1))
    held = library.displaced_m3(np.full(tips.size, thickness), np.repeat(ratios, tips.shape[1]), tips.ravel())
    states = np.repeat(mean[None], len(ratios), axis=0)
    states[:, at.PRESSURE], held = np.log(ratios * modulus), held.reshape(tips.shape)
    states[:, at.TIP] = size * np.array([np.interp(*one, library.tip_m) for one in zip(volumes, held, strict=True)])
    states = states[volumes <= held[:, -1]]
    higher = states[:, at.PRESSURE] > fitted[at.PRESSURE] + fit_starts.HIGHER
    states = states[higher & (fit_arrays.force_n(walls, states) < fit_starts.LARGEST_N)]
    placed, cost = laid(walls, np.concatenate([fitted[None], states]), lateral_m, depth_m)
    best = int(np.argmin(cost[1:])) + 1 if len(states) else 0
    return placed[best] if best and cost[best] <= fit_starts.MUCH_WORSE * cost[0] else None


def resting_wall(walls: Walls, mean: Floats) -> tuple[float, float, float, float]:
    """Thickness and pressure over E without the needle, in the library's size; that size, and E."""
    library, size, modulus = walls.library, np.exp(mean[at.SIZE]), np.exp(mean[at.MODULUS])
    thickness = np.clip(mean[at.THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    return thickness, np.clip(np.exp(mean[at.IOP]) / modulus, *library.iop_ratio_ends(thickness)), size, modulus


def laid(walls: Walls, samples: Floats, lateral_m: Floats, depth_m: Floats) -> tuple[Floats, Floats]:
    """The best poses of walls on an outer boundary (sample, unknown), and how far off they are (sample,)."""
    some = np.unique(np.linspace(0, len(lateral_m) - 1, fit_starts.POINTS).astype(np.intp))
    lateral_m, depth_m, grid_m, farthest_m = lateral_m[some], depth_m[some], fit_starts.GRID_M, fit_starts.FARTHEST_M
    upright, pose = samples.copy(), [at.LATERAL, at.DEPTH, at.ROTATION]
    upright[:, at.POLE], upright[:, at.FORM], upright[:, pose] = 0.0, 0.0, samples[0, pose]
    reach = int(np.ceil((np.abs(lateral_m).max() + farthest_m) / grid_m)) + 1
    grid = np.arange(-reach, reach + 1) * grid_m
    depth_sg = np.stack([np.interp(grid, *formed_wall(walls, one)[0].T) for one in upright])
    shifts = np.arange(-farthest_m, farthest_m + fit_starts.SHIFT_M / 2, fit_starts.SHIFT_M)
    rest = depth_m - depth_sg[:, np.rint((lateral_m - shifts[:, None]) / grid_m).astype(np.intp) + reach]
    down = np.median(rest, axis=2)
    cost = np.minimum(np.abs(rest - down[..., None]), fit_starts.FAR_M).mean(axis=2)
    every, best, placed = np.arange(len(samples)), cost.argmin(axis=1), samples.copy()
    placed[:, at.LATERAL], placed[:, at.DEPTH] = shifts[best], down[every, best]
    return placed, cost[every, best]
