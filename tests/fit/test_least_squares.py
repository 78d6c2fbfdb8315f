"""The robust fit: gradient against differences, plain least squares where nothing is
wrong, outliers do not pull.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame
from scleraforce.fit.least_squares import (
    CAUCHY,
    NormalEquations,
    StoppingRule,
    WallColumns,
    gauss_newton,
)

SD_M = 5e-6
LATERAL_M = np.linspace(-2e-3, 2e-3, 200)
PLACES = PlacesOnFrame(LATERAL_M, np.zeros(len(LATERAL_M), dtype=np.intp))
TRUE = np.array([0.8e-3, 0.1, 40.0])


@dataclass(frozen=True, eq=False)
class Parabola:
    """Depth a + b x + c x² with flat priors."""

    columns: WallColumns

    def depth(self, unknown: np.ndarray) -> PlacedCurves:
        powers = LATERAL_M[:, None] ** [0, 1, 2]
        depth = powers @ unknown

        return PlacedCurves(
            depth, np.zeros_like(depth), powers, np.ones(len(depth), dtype=bool)
        )

    def evaluate(self, unknown: np.ndarray) -> tuple[NormalEquations, float]:
        placed = self.depth(unknown)
        terms = NormalEquations(*self.columns.normal_equations(placed), ())
        return terms, self.columns.loss(placed)

    def inside(self, unknown: np.ndarray) -> np.ndarray:
        return unknown


def observed(noise: np.ndarray) -> WallColumns:
    depth = LATERAL_M[:, None] ** [0, 1, 2] @ TRUE + noise
    return WallColumns(PLACES, depth, np.full(len(depth), SD_M))


def test_the_gradient_is_that_of_the_loss():
    problem = Parabola(
        observed(np.random.default_rng(0).normal(0, 3 * SD_M, len(LATERAL_M)))
    )
    at = TRUE * 1.01
    steps = np.array([1e-9, 1e-6, 1e-3])
    gradient = problem.evaluate(at)[0].gradient

    for axis, step in enumerate(steps):
        move = step * np.eye(3)[axis]
        loss = [problem.evaluate(at + sign * move)[1] for sign in (1, -1)]
        assert gradient[axis] == pytest.approx(
            -(loss[0] - loss[1]) / (4 * step), rel=1e-4
        )


def test_without_outliers_it_is_plain_least_squares():
    # so small that Cauchy's loss is quadratic
    noise = np.random.default_rng(1).normal(0, 1e-3 * SD_M, len(LATERAL_M))
    columns = observed(noise)
    plain = np.polynomial.Polynomial.fit(LATERAL_M, columns.depth_m, 2).convert().coef
    stopping = StoppingRule(iterations=50, converged_sd=1e-6)
    fitted, *_ = gauss_newton(Parabola(columns), np.zeros(3), stopping)
    np.testing.assert_allclose(fitted, plain, rtol=1e-6)


class Valley:
    """Rosenbrock's bent valley as least squares: 10 (y - x²) and 1 - x; its end is (1,
    1), with no cost.
    """

    def _off(self, unknown: np.ndarray) -> np.ndarray:
        x, y = unknown
        return np.array([10.0 * (y - x * x), 1.0 - x])

    def evaluate(self, unknown: np.ndarray) -> tuple[NormalEquations, float]:
        off = self._off(unknown)
        jacobian = np.array([[-20.0 * unknown[0], 10.0], [-1.0, 0.0]])
        terms = NormalEquations(jacobian.T @ jacobian, -jacobian.T @ off, ())
        return terms, float(off @ off)

    def inside(self, unknown: np.ndarray) -> np.ndarray:
        return unknown


@pytest.mark.parametrize("start", [(-1.2, 1.0), (-3.0, 9.0), (-10.0, 100.0)])
def test_a_short_step_because_of_damping_does_not_end_the_fit(
    start: tuple[float, float],
):
    """Steps that are cut short on the way around the bend gain little, far from the
    end.
    """
    stopping = StoppingRule(iterations=200, converged_sd=1e-9, settled_cost=0.1)
    assert gauss_newton(Valley(), np.array(start), stopping)[2] < stopping.settled_cost


def test_a_column_that_is_not_reached_costs_the_same_wherever_it_lies():
    columns = observed(np.zeros(len(LATERAL_M)))
    placed = Parabola(columns).depth(TRUE)
    seen = np.ones(len(LATERAL_M), dtype=bool)
    seen[:10] = False
    unseen = PlacedCurves(
        placed.depth_m + np.where(seen, 0.0, 1.0), placed.slope, placed.jacobian, seen
    )
    assert columns.loss(placed) == pytest.approx(0.0, abs=1e-12)
    assert columns.loss(unseen) == pytest.approx(10 * CAUCHY**2 * 3.0)
    nothing = PlacedCurves(
        unseen.depth_m, unseen.slope, unseen.jacobian, ~np.isfinite(seen)
    )
    assert not columns.normal_equations(nothing)[0].any()


def test_columns_that_share_an_error_count_as_one():
    columns = observed(np.full(len(LATERAL_M), 2 * SD_M))
    shared = WallColumns(columns.places, columns.depth_m, columns.sd_m, as_one=4.0)
    placed = Parabola(columns).depth(TRUE)
    assert shared.loss(placed) == pytest.approx(columns.loss(placed) / 4)

    for one, all_of_them in zip(
        shared.normal_equations(placed), columns.normal_equations(placed), strict=True
    ):
        np.testing.assert_allclose(4 * one, all_of_them)
