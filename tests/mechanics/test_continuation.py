"""Paths of tiny structures whose equilibria are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise, trace_load_path
from scleraforce.records.globe import PressureLaw
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

HALF_SPAN = 1.0
HEIGHT = 0.2
# softer than the truss's steepest descent
SOFT = 0.01
FAR = PathEnd(max_tip_m=2.0, largest_step_m=0.02)


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


def assert_on_truss(spring: float, tips: Floats, forces: Floats) -> None:
    apex = tips - forces / spring
    np.testing.assert_allclose(
        forces, truss_force(apex), rtol=1e-8, atol=1e-9 * np.abs(forces).max()
    )


def test_path_follows_the_exact_snap_through_past_both_limits_of_the_force() -> None:
    tips = np.linspace(0.02, 0.5, 25)
    end = PathEnd(tips_m=tips, largest_step_m=0.05)
    path = trace_load_path(Truss(1.0), np.zeros(2), 0.0, end)
    assert_on_truss(1.0, path.tip_m, path.force)
    np.testing.assert_array_equal(path.tip_m, [0.0, *tips])
    assert path.force.min() < 0.0  # it did snap


def test_states_do_not_depend_on_the_steps() -> None:
    tips = np.array([0.1, 0.3, 0.5])
    runs = [
        trace_load_path(
            Truss(1.0), np.zeros(2), 0.0, PathEnd(tips_m=tips, largest_step_m=step)
        )
        for step in (0.3, 0.05, 0.003)
    ]

    for run in runs[1:]:
        np.testing.assert_allclose(
            run.displacement_su, runs[0].displacement_su, rtol=0.0, atol=1e-8
        )
        np.testing.assert_allclose(run.force, runs[0].force, rtol=0.0, atol=1e-10)


def test_path_that_keeps_its_own_steps_ends_at_the_first_state_over_the_force() -> None:
    limit = 0.5 * truss_force(HEIGHT * (1.0 - 1.0 / np.sqrt(3.0)))
    end = PathEnd(max_force=limit, largest_step_m=0.004)
    path = trace_load_path(Truss(1.0), np.zeros(2), 0.0, end)
    assert np.all(path.force[:-1] < limit)
    assert path.force[-1] >= limit
    assert len(path.tip_m) > 5
    assert_on_truss(1.0, path.tip_m, path.force)


def test_a_path_whose_tip_turns_back_raises_and_says_where() -> None:
    with pytest.raises(SolverError, match=r"dent of \d+(\.\d+)? mm, F/E = "):
        # the tip itself must go back
        trace_load_path(Truss(SOFT), np.zeros(2), 0.0, FAR)


def test_a_path_that_may_end_where_it_is_lost_keeps_what_was_found() -> None:
    end = replace(FAR, as_far_as_found=True)
    path = trace_load_path(Truss(SOFT), np.zeros(2), 0.0, end)
    assert_on_truss(SOFT, path.tip_m, path.force)
    peak = truss_force(HEIGHT * (1.0 - 1.0 / np.sqrt(3.0)))
    assert path.force.max() == pytest.approx(peak, rel=0.01)  # there the tip turns back


def test_the_end_of_a_path_is_found_to_a_32nd_of_its_largest_step_and_not_sought_closer():
    largest_m = 0.05
    apex = HEIGHT * (1.0 - np.linspace(1.0, 0.0, 100_001))
    turn_m = np.max(apex + truss_force(apex) / SOFT)  # of the tip
    truss = Truss(SOFT)
    end = replace(FAR, largest_step_m=largest_m)
    as_found = replace(end, as_far_as_found=True)
    path = trace_load_path(truss, np.zeros(2), 0.0, as_found)
    assert 0.0 < turn_m - path.tip_m[-1] < largest_m / 32.0
    ended_early = len(truss.factored)
    truss.factored.clear()

    with pytest.raises(SolverError, match="no equilibrium found beyond"):
        trace_load_path(truss, np.zeros(2), 0.0, end)

    assert ended_early < 0.75 * len(truss.factored)


def test_pressure_above_the_limit_raises_and_says_what_was_reached() -> None:
    with pytest.raises(SolverError, match=r"found up to p/E = 0\.00(4\d+|5) of 0\.006"):
        pressurise(Limited(), 1.2 / 200.0)


@dataclass(frozen=True, eq=False)
class Limited:
    """A balloon of one unknown, p = tanh(u) / 200: no equilibrium above p = 1 / 200."""

    needle = np.array([1.0])
    tip = np.array([1.0])

    def residual(self, u: Floats, pressure: float) -> Floats:
        return np.tanh(u) / 200.0 - pressure

    def factor(self, u: Floats, pressure: float) -> Callable[[Floats], Floats]:  # noqa: ARG002
        return lambda rhs: rhs * 200.0 * np.cosh(u[0]) ** 2


def test_pressure_close_to_the_limit_is_reached_in_steps() -> None:
    assert np.tanh(pressurise(Limited(), 0.995 / 200.0)[0]) == pytest.approx(
        0.995, rel=1e-9
    )


@dataclass(frozen=True, eq=False)
class SealedSprings:
    """A linear structure K u = p g + f b, whose volume is 1 + g u; `factored` has the
    pressure of every factor.
    """

    stiffness: Floats
    gradient: Floats
    needle: Floats
    tip: Floats
    factored: list[float]

    def residual(self, u: Floats, pressure: float) -> Floats:
        return self.stiffness @ u - pressure * self.gradient

    def factor(self, u: Floats, pressure: float) -> Callable[[Floats], Floats]:  # noqa: ARG002
        self.factored.append(pressure)
        return lambda rhs: np.asarray(np.linalg.solve(self.stiffness, rhs))

    def volume(self, u: Floats) -> tuple[float, Floats]:
        return 1.0 + float(self.gradient @ u), self.gradient


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_a_sealed_linear_structure_takes_the_exact_force_and_pressure(law: str) -> None:
    random = np.random.default_rng(3)
    root = random.normal(size=(6, 6))
    K = root @ root.T + np.eye(6)
    g = random.normal(size=6)
    b = random.normal(size=6)
    needle = np.linalg.solve(K, b)
    # it displaces volume
    b = -np.sign(g @ needle) * b
    needle = -np.sign(g @ needle) * needle
    tips = np.array([0.1, 0.4, 1.0])
    pressure = 0.3
    globe = PressureLaw(law, 0.7)
    springs = SealedSprings(K, g, b, b, [])
    start = pressurise(springs, pressure)
    np.testing.assert_allclose(start, pressure * np.linalg.solve(K, g), rtol=1e-8)
    end = PathEnd(tips_m=tips, largest_step_m=1.0)
    path = trace_load_path(springs, start, pressure, end, globe=globe)

    # the dent counts from the undented wall at the same pressure
    force = np.append(0.0, tips / (b @ needle))
    rising = globe.pressure(pressure, -force * (g @ needle))
    undented = rising[:, None] * np.linalg.solve(K, g)
    np.testing.assert_allclose(path.force, force, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(path.pressure, rising, rtol=1e-8)
    np.testing.assert_allclose(path.undented_su, undented, rtol=1e-7)
    np.testing.assert_allclose(
        path.displacement_su, undented + force[:, None] * needle, atol=1e-8
    )


def test_tips_that_do_not_ascend_from_above_zero_and_a_path_without_an_end_are_refused():
    for tips, fault in (
        ([], "tips"),
        ([0.0, 0.1], "tips"),
        ([0.2, 0.1], "tips"),
        (None, "no end"),
    ):
        with pytest.raises(InputError, match=fault):
            PathEnd(tips_m=None if tips is None else np.array(tips))
