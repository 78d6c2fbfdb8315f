"""A frame's least-squares problem by arrays: the cost of any unknowns, and the
posterior there.

It does not search. No limbus is looked for.
"""

from dataclasses import dataclass

import fit_arrays
import numpy as np

from predicted_walls import Walls, formed_wall, predict_wall
from scleraforce.base.arrays import Floats
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.fit import compiled_fit, compiled_search, unknowns
from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame
from scleraforce.fit.least_squares import WallColumns
from scleraforce.fit.one_frame import BoundaryFit, _standard_normal, law_of
from scleraforce.fit.prior_of_an_eye import HEAVY, Prior
from scleraforce.library.wall_responses import Library

LAW_STEPS = {
    unknowns.TIP: 1e-7,
    unknowns.THICKNESS: 1e-7,
    unknowns.MODULUS: 1e-4,
    unknowns.IOP: 1e-4,
    unknowns.SIZE: 1e-4,
    unknowns.PRESSURE: 1e-4,
}


@dataclass(frozen=True, eq=False)
class Problem:
    """The least-squares problem of one frame."""

    walls: Walls
    columns: WallColumns
    prior: Prior

    def off(self, unknown_su: Floats) -> Floats:
        """The deviations (sample, 2) of the force at a dent and of the pressure."""
        off, sd = fit_arrays.off_the_law(self.walls, unknown_su)
        law = off / sd if self.walls.globe.can_be_sealed else np.zeros_like(off)
        return np.stack(
            [(unknown_su - self.prior.mean) @ self.prior.same_force, law], axis=1
        )

    def evaluate(self, unknown: Floats) -> tuple[PlacedCurves, float]:
        """The prediction and its cost."""
        placed = predict_wall(self.walls, unknown, self.columns.places)
        away = unknown - self.prior.mean
        heavy = away[HEAVY] / (compiled_search.HEAVY_CAUCHY * self.prior.sd[HEAVY])
        away[HEAVY] = 0.0
        known = (
            away @ self.prior.precision @ away
            + compiled_search.HEAVY_CAUCHY**2 * np.log1p(heavy**2).sum()
        )
        off = self.off(unknown[None])[0]

        return placed, self.columns.loss(placed) + float(
            known + off @ self.prior.calibrated @ off
        )

    def normal_equations(
        self, unknown: Floats, placed: PlacedCurves, scale: float = 1.0
    ) -> tuple[Floats, Floats]:
        """The normal matrix (unknown, unknown) and the gradient (unknown,)."""
        normal, gradient = self.columns.normal_equations(placed, scale)
        precision = self.prior.precision.copy()
        away = unknown - self.prior.mean
        precision[HEAVY, HEAVY] /= (
            1.0
            + (away[HEAVY] / (compiled_search.HEAVY_CAUCHY * self.prior.sd[HEAVY])) ** 2
        )
        slopes = np.zeros((2, len(unknown)))
        slopes[0] = self.prior.same_force

        if self.walls.globe.can_be_sealed:
            varied = unknown + np.array(
                [
                    step * np.eye(len(unknown))[which]
                    for which, step in LAW_STEPS.items()
                ]
            )
            off, sd = fit_arrays.off_the_law(
                self.walls, np.concatenate([unknown[None], varied])
            )
            slopes[1, list(LAW_STEPS)] = (off[1:] - off[0]) / (
                np.array(list(LAW_STEPS.values())) * sd[0]
            )

        weighted = slopes.T @ self.prior.calibrated
        off = self.off(unknown[None])[0]
        return (
            normal + precision + weighted @ slopes,
            gradient - precision @ away - weighted @ off,
        )

    def spread(
        self, unknown: Floats, placed: PlacedCurves, scale: float = 1.0
    ) -> Floats:
        """The matrix from standard normal numbers to draws about the unknowns (unknown,
        number).
        """
        normal = self.normal_equations(unknown, placed, scale)[0]
        sd = self.prior.sd
        return np.asarray(
            sd[:, None] * np.linalg.inv(np.linalg.cholesky(sd[:, None] * normal * sd)).T
        )

    def drawn_forces(self, unknown: Floats, spread_uz: Floats) -> Floats:
        """Forces drawn from the posterior."""
        normal = _standard_normal(len(unknown) + 2)
        level_z, growth_z = _standard_normal(2, seed=1).T
        drawn = unknown + normal[:, :-2] @ spread_uz.T
        drawn[:, unknowns.TIP] = np.maximum(drawn[:, unknowns.TIP], 0.0)

        known = self.walls.globe
        if known.can_be_sealed:
            volume = fit_arrays.displaced_m3(self.walls, drawn)
            resting_pa = np.exp(drawn[:, unknowns.IOP])
            ends = [
                np.log(known.pressure_law(k).pressure(resting_pa, volume))
                for k in (known.lowest, known.highest)
            ]
            drawn[:, unknowns.PRESSURE] = np.clip(drawn[:, unknowns.PRESSURE], *ends)

        eye_z = np.clip(
            self.off(drawn), -compiled_fit.FARTHEST_EYE, compiled_fit.FARTHEST_EYE
        )
        corrected = self.prior.discrepancy.corrected_n(
            fit_arrays.force_n(self.walls, drawn), level_z, growth_z, eye_z
        )
        noise = (
            np.exp(compiled_fit.MODEL_SD * normal[:, -2]),
            compiled_fit.MODEL_SD_N * normal[:, -1],
        )

        return np.maximum(corrected * noise[0] + noise[1], 0.0)


def problem_of(
    library: Library,
    lateral_m: Floats,
    depth_bc: Floats,
    prior: Prior,
    smoothing_m: float = 0.0,
) -> Problem:
    """The problem of a frame."""
    step = -(-len(lateral_m) // compiled_fit.COLUMNS)
    boundary, column = np.nonzero(np.isfinite(depth_bc[:, ::step]))
    places = PlacesOnFrame(lateral_m[column * step], boundary, smoothing_m)
    apart_m = float(np.median(np.diff(places.lateral_m[: places.outer])))
    sd_m = np.where(boundary == 0, compiled_fit.OUTER_SD_M, compiled_fit.INNER_SD_M)
    columns = WallColumns(
        places,
        depth_bc[boundary, column * step],
        sd_m,
        max(1.0, compiled_fit.CORRELATED_M / apart_m),
    )
    walls = Walls(
        library,
        prior.globe,
        gap_m=float(prior.mean[unknowns.GAP]),
        thickness_m=float(prior.mean[unknowns.THICKNESS]),
    )

    return Problem(walls, columns, prior)


def fit_at(problem: Problem, unknown: Floats) -> BoundaryFit:
    """The fit that these unknowns are, with its uncertainty."""
    placed, cost = problem.evaluate(unknown)
    residual = np.where(placed.seen, np.abs(problem.columns.residual(placed)), np.inf)
    misfit = robust_spread(residual)
    law = law_of(problem.walls.globe)
    spread_uz = problem.spread(
        unknown,
        placed,
        float(np.clip(misfit, compiled_fit.LEAST_NOISE, compiled_fit.MOST_NOISE)),
    )
    draws_n = problem.drawn_forces(unknown, spread_uz)
    low_n, force, high_n = np.quantile(draws_n, [0.05, 0.5, 0.95])
    iop_pa = np.exp(unknown[law.pressure])
    radius_m = problem.walls.library.radius_m * np.exp(unknown[unknowns.SIZE])
    below_m = problem.columns.residual(placed) * compiled_fit.INNER_SD_M
    layer = (
        (problem.columns.places.boundary == 1)
        & placed.seen
        & (below_m > 0.0)
        & (below_m < compiled_fit.LAYER_M)
    )

    return BoundaryFit(
        force_n=force,
        interval_n=(low_n, high_n),
        draws_n=draws_n,
        contact_m=unknown[unknowns.LATERAL],
        tip_m=unknown[unknowns.TIP],
        misfit_m=misfit * compiled_fit.OUTER_SD_M,
        outliers=float(
            np.mean((residual > compiled_fit.OUTLIER_SD * max(1.0, misfit)) & ~layer)
        ),
        wall_bmc=formed_wall(problem.walls, unknown),
        unknown=unknown,
        spread=spread_uz.T,
        iop_pa=iop_pa,
        tension=iop_pa
        / np.exp(unknown[unknowns.MODULUS])
        * radius_m
        / unknown[unknowns.THICKNESS],
        loss=cost,
    )
