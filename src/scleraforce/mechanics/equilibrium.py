"""Equilibrium at a prescribed dent: the equations, and Newton's method for them.

The displacement of the needle's tip is prescribed and the force is an unknown of its
own; in a sealed globe the pressure is another (`SealedDent`). They enter as borders of
the tangent: K du - b df = -r is split into one solve per column, and a small matrix
gives their increments (Batoz and Dhatt, Int. J. Num. Meth. Engng 14, 1979). Newton's
steps are damped by the natural monotonicity test, and a factor is used again while it
contracts fast (Deuflhard, Newton Methods for Nonlinear Problems, sec. 3.3): neither
depends on units or conditioning.

Everything is at E = 1 Pa: forces are F/E in m^2 and pressures p/E.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import SolverError
from scleraforce.records.globe import PressureLaw

Solve = Callable[[Floats], Floats]

# largest force out of balance, over the forces applied; also of the tip and the
# pressure
BALANCE_TOLERANCE = 1e-9
SETTLED = 1e-10  # of the displacement by the needle: smaller corrections count as zero
MOST_FACTORS = 10  # for one equilibrium
# a factor is reused while each step leaves less than this share of the error
FAST = 0.3
SMALLEST_DAMPING = 1.0 / 32.0


class Equilibrium(Protocol):
    """A wall whose free displacements are sought, at E = 1 Pa."""

    @property
    def needle(self) -> Floats:
        """Nodal forces of 1 N through the needle, (unknown,)."""

    @property
    def tip(self) -> Floats:
        """Functional whose product with the displacement is the tip's inward
        displacement, (unknown,).
        """

    def residual(self, u: Floats, pressure: float) -> Floats:
        """Internal minus external forces without the needle, (unknown,); not finite
        where u is inadmissible.
        """

    def factor(self, u: Floats, pressure: float) -> Solve:
        """Factor the derivative of the residual by u; return its solve for (unknown,)
        or (unknown, column).

        Raises:
            SolverError, ArithmeticError: there is no factor; a shorter step is then
                tried.
        """

    def volume(self, u: Floats) -> tuple[float, Floats]:
        """Return the volume in m^3 and its derivative by u, (unknown,).

        Pressure does work on this volume: the derivative of the residual by the
        pressure is minus that by u.
        """


class Balance:
    """Equilibrium at a given pressure without the needle: no borders. The unknowns x
    are u.

    A control has `count` displacements, the first of its unknowns, and `unloaded`
    unknowns without the load that it adds; `applied` is the size of the forces applied.
    """

    def __init__(self, problem: Equilibrium, pressure: float) -> None:
        self.problem = problem
        self.pressure = pressure
        self.count = len(problem.needle)
        self.unloaded = np.zeros(self.count)
        self.applied = float(
            np.linalg.norm(problem.residual(np.zeros_like(problem.needle), pressure))
        )

    def defect(self, x: Floats) -> Floats:
        """Return the forces out of balance."""
        return self.problem.residual(x, self.pressure)

    def met(self, defect: Floats, x: Floats) -> bool:  # noqa: ARG002 (what is applied depends on x in other controls)
        """Return whether a defect is negligible."""
        return bool(np.linalg.norm(defect) <= BALANCE_TOLERANCE * self.applied)

    def factor(self, x: Floats) -> Solve:
        """Factor the derivative of the defect."""
        return self.problem.factor(x, self.pressure)


class Dent(Balance):
    """Equilibrium at a given displacement of the tip from `start`. The unknowns x are u
    and the force.

    `load_path_tracing` sets `tip_m` along the path; errors are relative to
    `largest_force`, on the path so far, where the force passes through zero.
    """

    remedy = "ask for a smaller dent"

    def __init__(self, problem: Equilibrium, start: Floats, pressure: float) -> None:
        super().__init__(problem, pressure)
        self.start = start
        self.unloaded = np.append(start, 0.0)
        self.tip_m = self.largest_force = 0.0
        self._needle_norm = float(np.linalg.norm(problem.needle))

    def defect(self, x: Floats) -> Floats:
        """Return the forces out of balance and the error of the tip."""
        u = x[: self.count]
        force = x[self.count]
        balance = self.problem.residual(u, self.pressure) - force * self.problem.needle
        return np.append(balance, self.problem.tip @ (u - self.start) - self.tip_m)

    def met(self, defect: Floats, x: Floats) -> bool:
        """Return whether a defect is negligible."""
        force = max(abs(float(x[self.count])), self.largest_force)
        applied = self.applied + force * self._needle_norm
        balanced = np.linalg.norm(defect[: self.count]) <= BALANCE_TOLERANCE * applied
        return bool(
            balanced and abs(defect[self.count]) <= BALANCE_TOLERANCE * self.tip_m
        )

    def force(self, x: Floats) -> float:
        """Return the needle's force."""
        return float(x[self.count])

    def travel_m(self, x: Floats) -> float:
        """Return the tip's inward displacement from `start`; in a sealed globe it is
        less than the dent.
        """
        return float(self.problem.tip @ (x[: len(self.start)] - self.start))

    def factor(self, x: Floats) -> Solve:
        """Factor the derivative of the defect."""
        tangent = self.problem.factor(x[: self.count], self.pressure)
        return solve_bordered(
            tangent,
            self.problem.needle[:, None],
            self.problem.tip[None],
            np.zeros((1, 1)),
        )


class SealedDent(Dent):
    """Equilibrium of a sealed globe at a given dent. The unknowns x are u, w, the force
    and the pressure.

    The law (`records.globe`) compares the dented wall with the undented one *at the
    same pressure P*: it is measured on whole eyes and includes the give of their shell.
    So the undented wall is part of the unknowns, and the dent counts from it, which is
    what one picture shows. With u the dented wall, w the undented one, f the needle's
    force, s the functional of the tip, and P0 the given `pressure`, that at rest,

        R(u, P) = f n     R(w, P) = 0     s (u - w) = tip     P = law(P0, V(w) - V(u))

    Both tangents are factored; force and pressure are borders (`solve_bordered`).

    Such a path has an end. A pressure that rises makes the dent wider, which displaces
    more volume: in a wall that is soft against its globe no pressure solves the law for
    a deeper dent (0.5 mm, 0.38 MPa, 2 mmHg, k = 0.03: 2.2 mm, at 73 mN).
    """

    remedy = (
        "the pressure runs away there; ask for a smaller dent or a less rigid globe"
    )

    def __init__(
        self, problem: Equilibrium, start: Floats, pressure: float, globe: PressureLaw
    ) -> None:
        super().__init__(problem, start, pressure)
        self.globe = globe
        self.count = 2 * len(start)
        self.unloaded = np.concatenate([start, start, [0.0, pressure]])

    def defect(self, x: Floats) -> Floats:
        """Return the forces out of balance on both walls, and the errors of the tip and
        the pressure.
        """
        dented, undented, force, pressure = self._parts(x)
        balance = self.problem.residual(dented, pressure) - force * self.problem.needle
        undented_balance = self.problem.residual(undented, pressure)
        tip = self.problem.tip @ (dented - undented) - self.tip_m
        displaced_m3 = self.problem.volume(undented)[0] - self.problem.volume(dented)[0]
        error = pressure - self.globe.pressure(self.pressure, displaced_m3)

        return np.concatenate([balance, undented_balance, [tip, error]])

    def met(self, defect: Floats, x: Floats) -> bool:
        """Return whether a defect is negligible."""
        _, _, force, pressure = self._parts(x)
        applied = self.applied * max(
            1.0, pressure / self.pressure if self.pressure > 0.0 else 1.0
        )
        applied += max(abs(force), self.largest_force) * self._needle_norm
        balanced = np.linalg.norm(defect[: self.count]) <= BALANCE_TOLERANCE * applied

        return bool(
            balanced
            and abs(defect[-2]) <= BALANCE_TOLERANCE * self.tip_m
            and abs(defect[-1]) <= BALANCE_TOLERANCE * pressure
        )

    def factor(self, x: Floats) -> Solve:
        """Factor the derivative of the defect."""
        dented, undented, _, pressure = self._parts(x)
        problem = self.problem
        half = self.count // 2
        solves = problem.factor(dented, pressure), problem.factor(undented, pressure)
        inside, gradient = problem.volume(dented)
        undented_inside, undented_gradient = problem.volume(undented)
        stiffness = float(
            self.globe.stiffness(
                self.globe.pressure(self.pressure, undented_inside - inside)
            )
        )
        nothing = np.zeros(half)
        columns = np.stack(
            [
                np.append(problem.needle, nothing),
                np.append(gradient, undented_gradient),
            ],
            axis=1,
        )
        rows = np.stack(
            [
                np.append(problem.tip, -problem.tip),
                stiffness * np.append(gradient, -undented_gradient),
            ]
        )

        def solve(both: Floats) -> Floats:
            return np.concatenate([solves[0](both[:half]), solves[1](both[half:])])

        return solve_bordered(solve, columns, rows, np.diag([0.0, 1.0]))

    def _parts(self, x: Floats) -> tuple[Floats, Floats, float, float]:
        half = self.count // 2
        return x[:half], x[half : self.count], float(x[-2]), float(x[-1])


def solve_bordered(
    tangent: Solve, columns_uk: Floats, rows_ku: Floats, corner_kk: Floats
) -> Solve:
    """Solve K du - C dy = r, R du + D dy = c for (du, dy): one solve for C, one for
    each r, and a small matrix.
    """
    answers_uk = tangent(columns_uk)
    small_kk = rows_ku @ answers_uk + corner_kk
    unknowns = len(columns_uk)

    def solve(defect: Floats) -> Floats:
        without = tangent(defect[:unknowns])
        borders = np.linalg.solve(small_kk, defect[unknowns:] - rows_ku @ without)
        return np.concatenate([without + answers_uk @ borders, borders])

    return solve


def solve_balance(control: Balance, x: Floats) -> tuple[Floats, int]:
    """Return the unknowns that meet the control, from a guess x, and the number of
    factors.
    """
    defect = control.defect(x)
    found = control.met(defect, x)

    for factors in range(MOST_FACTORS + 1):
        if found:
            return x, factors
        if factors == MOST_FACTORS or not np.all(np.isfinite(defect)):
            break

        x, defect, found = _newton_step(control, x, defect)

    raise SolverError(
        "equilibrium: Newton's method did not converge; use a shorter step"
    )


def _newton_step(
    control: Balance, x: Floats, defect: Floats
) -> tuple[Floats, Floats, bool]:
    """Factor at x, take a damped step, and continue with the same factor while it
    converges fast.

    Returns the new x, its defect, and whether it is an equilibrium.
    """
    try:
        solve = control.factor(x)
        x, defect, step, left = _damped(control, solve, x, -solve(defect))

        while left < FAST and not _found(control, x, defect, step):
            trial = x + step
            trial_defect = control.defect(trial)
            trial_step = -solve(trial_defect)

            left = _size(control, trial_step) / _size(control, step)
            if not left < 1.0:
                break

            x = trial
            defect = trial_defect
            step = trial_step
    except (ArithmeticError, np.linalg.LinAlgError) as fault:
        raise SolverError(f"equilibrium: {fault}; use a shorter step") from fault

    return x, defect, _found(control, x, defect, step)


def _found(control: Balance, x: Floats, defect: Floats, step: Floats) -> bool:
    """Return whether the forces balance, or the correction by `step` is negligible.

    The second test is for tiny forces, where the rounding of the stresses exceeds the
    tolerance.
    """
    return control.met(defect, x) or _size(control, step) <= SETTLED * _size(
        control, x - control.unloaded
    )


def _damped(
    control: Balance, solve: Solve, x: Floats, step: Floats
) -> tuple[Floats, Floats, Floats, float]:
    """Shorten a step until the next correction with the same factor is small enough.

    Returns the new x, its defect, that next correction, and its size over the size of
    this step.
    """
    damping = 1.0
    while damping >= SMALLEST_DAMPING:
        trial = x + damping * step
        defect = control.defect(trial)
        if np.all(np.isfinite(defect)):
            following = -solve(defect)
            left = _size(control, following) / _size(control, step)
            if left <= 1.0 - 0.25 * damping or _found(
                control, trial, defect, following
            ):
                return trial, defect, following, left

        damping *= 0.5

    raise SolverError("equilibrium: no step reduces the error; use a shorter step")


def _size(control: Balance, step: Floats) -> float:
    """Return the size of a step by its displacements alone; the borders have other
    units.
    """
    return float(np.linalg.norm(step[: control.count]))
