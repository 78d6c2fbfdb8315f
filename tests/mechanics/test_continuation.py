"""Paths of tiny structures whose equilibria are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics.load_path_tracing import (
    PathEnd,
    PathStates,
    pressurise,
    trace_load_path,
)

HALF_SPAN = 1.0
HEIGHT = 0.2
# softer than the truss's steepest descent
SOFT = 0.01


@dataclass(frozen=True, eq=False)
class Truss:
    """Von Mises' shallow truss of two bars (Green's strain, E A = 1), pushed through a
    spring: u = (apex, needle).
    """

    spring: float
    factored: list[float] = field(default_factory=list)  # the apex of every factor

    needle = np.array([0.0, 1.0])
    tip = np.array([0.0, 1.0])

    def residual(self, u: Floats, pressure: float) -> Floats:
        pull = self.spring * (u[1] - u[0])
        return np.array([truss_force(u[0]) - pull - pressure, pull])

    def factor(self, u: Floats, pressure: float) -> Callable[[Floats], Floats]:  # noqa: ARG002
        self.factored.append(float(u[0]))
        left = HEIGHT - u[0]
        slope = (3.0 * left**2 - HEIGHT**2) / (HALF_SPAN**2 + HEIGHT**2) ** 1.5
        tangent = np.array(
            [[slope + self.spring, -self.spring], [-self.spring, self.spring]]
        )

        return lambda rhs: np.asarray(np.linalg.solve(tangent, rhs))


def truss_force(apex: Any) -> Any:
    """Force that holds the apex down by `apex`: the derivative of the energy of both
    bars.
    """
    left = HEIGHT - apex
    return left * (HEIGHT**2 - left**2) / (HALF_SPAN**2 + HEIGHT**2) ** 1.5


def followed(spring: float, end: PathEnd) -> tuple[PathStates, int]:
    """Return a path that lies on the truss, and the number of its factors."""
    truss = Truss(spring)
    path = trace_load_path(truss, np.zeros(2), 0.0, end)
    np.testing.assert_allclose(
        path.force,
        truss_force(path.tip_m - path.force / spring),
        rtol=1e-8,
        atol=1e-9 * np.abs(path.force).max(),
    )
    return path, len(truss.factored)


@pytest.mark.parametrize("largest_m", [0.3, 0.05, 0.003])
def test_path_follows_the_exact_snap_through_past_both_limits_with_any_steps(
    largest_m: float,
):
    tips_m = np.linspace(0.02, 0.5, 25)
    path, _ = followed(1.0, PathEnd(tips_m=tips_m, largest_step_m=largest_m))
    np.testing.assert_array_equal(path.tip_m, [0.0, *tips_m])
    assert path.force.min() < 0.0  # it did snap


def test_path_that_keeps_its_own_steps_ends_at_the_first_state_over_the_force():
    limit = 0.5 * truss_force(HEIGHT * (1.0 - 1.0 / np.sqrt(3.0)))
    path, _ = followed(1.0, PathEnd(max_force=limit, largest_step_m=0.004))
    assert np.all(path.force[:-1] < limit)
    assert path.force[-1] >= limit
    assert len(path.tip_m) > 5


def test_where_the_tip_turns_back_a_path_is_refused_or_ends_there_and_is_not_sought_closer():
    largest_m = 0.05
    apex = HEIGHT * (1.0 - np.linspace(1.0, 0.0, 100_001))
    turn_m = np.max(apex + truss_force(apex) / SOFT)  # of the tip
    end = PathEnd(max_tip_m=2.0, largest_step_m=largest_m)
    path, factors = followed(SOFT, replace(end, as_far_as_found=True))
    assert 0.0 < turn_m - path.tip_m[-1] < largest_m / 32.0
    truss = Truss(SOFT)

    with pytest.raises(SolverError, match=r"beyond a dent of \d+(\.\d+)? mm, F/E = "):
        trace_load_path(truss, np.zeros(2), 0.0, end)

    assert factors < 0.75 * len(truss.factored)


@dataclass(frozen=True, eq=False)
class Limited:
    """A balloon of one unknown, p = tanh(u) / 200: no equilibrium above p = 1 / 200."""

    needle = np.array([1.0])
    tip = np.array([1.0])

    def residual(self, u: Floats, pressure: float) -> Floats:
        return np.tanh(u) / 200.0 - pressure

    def factor(self, u: Floats, pressure: float) -> Callable[[Floats], Floats]:  # noqa: ARG002
        return lambda rhs: rhs * 200.0 * np.cosh(u[0]) ** 2


def test_pressure_close_to_the_limit_is_reached_in_steps_and_none_above():
    assert np.tanh(pressurise(Limited(), 0.995 / 200.0)[0]) == pytest.approx(
        0.995, rel=1e-9
    )
    with pytest.raises(SolverError, match=r"found up to p/E = 0\.00(4\d+|5) of 0\.006"):
        pressurise(Limited(), 1.2 / 200.0)


@pytest.mark.parametrize("tips_m", [[], [0.0, 0.1], [0.2, 0.1], None], ids=str)
def test_a_path_without_an_end_or_with_tips_that_do_not_ascend_is_refused(
    tips_m: list[float] | None,
):
    with pytest.raises(InputError, match="load path: "):
        PathEnd(tips_m=None if tips_m is None else np.array(tips_m))
