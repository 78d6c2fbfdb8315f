"""Equilibrium at a prescribed dent of a sealed globe, whose pressure follows the displaced volume.

The law (`eye.globe`) compares the dented wall with the undented one *at the same pressure P*: it is measured on whole
eyes and holds the give of their shell. So the undented wall is part of the unknowns, and the dent counts from it, which
is what one picture shows. With u the dented wall, w the undented one, f the needle's force and s the tip's functional:

    R(u, P) = f n     R(w, P) = 0     s (u - w) = tip     P = law(P0, V(w) - V(u))

Both tangents are factored; force and pressure are borders (`equilibrium.bordered`).

Such a path has an end. A pressure that rises makes the dent wider, which displaces more volume: in a wall that is soft
against its globe no pressure solves the law for a deeper dent (0.5 mm, 0.38 MPa, 2 mmHg, k = 0.03: 2.2 mm, at 73 mN).
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.eye.globe import Globe
from scleraforce.mechanics.equilibrium import (
    BALANCE_TOLERANCE,
    Balance,
    Equilibrium,
    SealedEquilibrium,
    Solve,
    bordered,
)

Floats = NDArray[np.float64]


class SealedDent:
    """Equilibrium of a sealed globe at a given dent. The unknowns x are u, w, the force and the pressure.

    Attributes:
        tip_m: the prescribed dent; `continuation` sets it along the path.
        count: how many displacements are unknown, of both walls.
        unloaded: the unknowns without the needle.
        largest_force: on the path so far; errors are relative to it where the force passes through zero.
        remedy: what to do where the path ends.
    """

    remedy = "the pressure runs away there; ask for a smaller dent or a less rigid globe"

    def __init__(self, problem: Equilibrium, start: Floats, pressure: float, globe: Globe) -> None:
        """Prepare the control.

        Args:
            problem: the wall; a `SealedEquilibrium`.
            start: its equilibrium without the needle, (unknown,).
            pressure: p/E there.
            globe: how the pressure follows the volume, over E.

        Raises:
            InputError: the wall does not know its volume.
        """
        if not isinstance(problem, SealedEquilibrium):
            raise InputError("sealed globe: this wall does not know its volume; use an open globe")
        self.problem, self.globe, self.resting = problem, globe, pressure
        self.tip_m = 0.0
        self.largest_force = 0.0
        self.count = 2 * len(start)
        self.applied = Balance(problem, pressure).applied
        self.unloaded = np.concatenate([start, start, [0.0, pressure]])
        self._needle_norm = float(np.linalg.norm(problem.needle))

    def defect(self, x: Floats) -> Floats:
        """Return the forces out of balance on both walls, and the errors of the tip and the pressure."""
        dented, undented, force, pressure = self._parts(x)
        balance = self.problem.residual(dented, pressure) - force * self.problem.needle
        undented_balance = self.problem.residual(undented, pressure)
        tip = self.problem.tip @ (dented - undented) - self.tip_m
        displaced_m3 = self.problem.volume(undented)[0] - self.problem.volume(dented)[0]
        error = pressure - self.globe.pressure(self.resting, displaced_m3)
        return np.concatenate([balance, undented_balance, [tip, error]])

    def met(self, defect: Floats, x: Floats) -> bool:
        """Return whether a defect is none."""
        _, _, force, pressure = self._parts(x)
        applied = self.applied * max(1.0, pressure / self.resting if self.resting > 0.0 else 1.0)
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
        problem, half = self.problem, self.count // 2
        solves = problem.factor(dented, pressure), problem.factor(undented, pressure)
        (inside, gradient), (undented_inside, undented_gradient) = problem.volume(dented), problem.volume(undented)
        stiffness = float(self.globe.stiffness(self.globe.pressure(self.resting, undented_inside - inside)))
        nothing = np.zeros(half)
        columns = np.stack(
            [np.append(problem.needle, nothing), np.append(gradient, undented_gradient)],
            axis=1,
        )
        rows = np.stack(
            [np.append(problem.tip, -problem.tip), stiffness * np.append(gradient, -undented_gradient)],
        )

        def solve(both: Floats) -> Floats:
            return np.concatenate([solves[0](both[:half]), solves[1](both[half:])])

        return bordered(solve, columns, rows, np.diag([0.0, 1.0]))

    def _parts(self, x: Floats) -> tuple[Floats, Floats, float, float]:
        half = self.count // 2
        return x[:half], x[half : self.count], float(x[-2]), float(x[-1])
