"""Following a load path: one equilibrium after another, by the displacement of the
needle's tip.

The force may fall while the dent grows (snap-through of a wall without pressure), so
the tip is what advances. Steps start from a polynomial through the states before, and
adapt: shorter after a failure, longer while they are easy. The dent counts from the
undented wall at the same pressure: in an open globe, from the first state. Everything
is at E = 1 Pa: forces are F/E in m^2 and pressures p/E.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import from_si
from scleraforce.mechanics.equilibrium import (
    Balance,
    Dent,
    Equilibrium,
    SealedDent,
    solve_balance,
)
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw

Progress = Callable[[float], object]

SMALLEST_STEP = 1e-4  # of the path, or of its largest step: no shorter steps are tried
# ... where a path may end early: most attempts near its end fail
EARLY_END = 1.0 / 64.0
FIRST_STEP_M = 1e-4  # of the tip
LARGEST_STEP_M = 5e-4  # of the tip, unless the end of the path says otherwise
# maximum number of states that a step starts from: their polynomial takes one factor a
# step, a parabola two
STATES = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class PathEnd:
    """Where a load path ends, and the steps up to there.

    A path ends at a dent of `max_tip_m` or the last of `tips_m`, or before that at the
    first kept state that carries `max_force` or whose tip is `max_travel_m` from the
    state without the needle. Where no equilibrium is found, `SolverError` is raised;
    with `as_far_as_found` the path ends there, to 1/32 of the largest step.

    `max_force` has the unit of the function that follows the path: F/E in m^2 in
    `trace_load_path` and `axisymmetric_path`, N in `FiniteWall.load_path` and
    `bend_eye`; `over` converts it. `tips_m`: dents at which states are kept, positive
    and ascending, (state,), with as many steps between them as needed; None keeps every
    step. `largest_step_m`: of the tip; None leaves it to that function.

    Raises `InputError` if the tips do not ascend from above 0 or nothing ends the path.
    """

    tips_m: Floats | None = None
    max_tip_m: float | None = None
    max_force: float = np.inf
    max_travel_m: float = np.inf
    largest_step_m: float | None = None
    as_far_as_found: bool = False

    def __post_init__(self) -> None:
        tips_m = self.tips_m
        if tips_m is not None and (
            len(tips_m) == 0 or tips_m[0] <= 0.0 or np.any(np.diff(tips_m) <= 0.0)
        ):
            raise InputError("load path: tips must be positive and ascending")

        if (
            tips_m is None
            and self.max_tip_m is None
            and not np.isfinite(min(self.max_force, self.max_travel_m))
        ):
            raise InputError(
                "load path: no end is given; give a largest tip displacement or force"
            )

    @property
    def last_tip_m(self) -> float:
        """The dent in m beyond which the path does not go, infinite if only a force or
        travel ends it.
        """
        ends_m = (
            self.max_tip_m,
            None if self.tips_m is None else float(self.tips_m[-1]),
        )
        return min((end_m for end_m in ends_m if end_m is not None), default=np.inf)

    def over(self, youngs_modulus_pa: float) -> "PathEnd":
        """Return the same end where forces are given over a modulus, F/E in m^2.

        >>> PathEnd(max_force=0.03).over(0.3e6).max_force
        1e-07
        """
        return replace(self, max_force=self.max_force / youngs_modulus_pa)


@dataclass(frozen=True, eq=False)
class PathStates:
    """States along a load path, (state,) each; the first is the one without the needle.

    `tip_m`: inward displacement of the tip from the undented wall at the state's
    pressure, ascending. `force` is F/E in m^2, `pressure` p/E. `displacement_su` and
    `undented_su` (state, unknown) in m: free displacements of the wall, and of the
    undented wall at the state's pressure.
    """

    tip_m: Floats
    force: Floats
    pressure: Floats
    displacement_su: Floats
    undented_su: Floats


def pressurise(problem: Equilibrium, pressure: float) -> Floats:
    """Return the displacement (unknown,) under a pressure p/E and no needle."""
    reached = 0.0
    step = 1.0
    u = np.zeros_like(problem.needle)
    if pressure == 0.0:
        return solve_balance(Balance(problem, 0.0), u)[0]

    while reached < 1.0:
        share = min(reached + step, 1.0)
        try:
            # Displacement grows with the pressure about in proportion.
            guess = u * (share / reached) if reached > 0.0 else u
            u, factors = solve_balance(Balance(problem, share * pressure), guess)
        except SolverError as fault:
            step *= 0.5
            if step < SMALLEST_STEP:
                found = f"found up to p/E = {reached * pressure:.4g} of {pressure:.4g}"
                remedy = "use a thicker or stiffer wall, or less pressure"
                raise SolverError(f"pressure: equilibrium {found}; {remedy}") from fault

            continue

        reached = share
        step = step * (2.0 if factors <= 2 else 1.0)

    return u


def trace_load_path(
    problem: Equilibrium,
    start: Floats,
    pressure: float,
    end: PathEnd,
    *,
    globe: PressureLaw = CONSTANT_PRESSURE,
    progress: Progress | None = None,
) -> PathStates:
    """Follow the path from the state without the needle, by the tip's inward
    displacement.

    `start` is the equilibrium without the needle at `pressure`, p/E, as from
    `pressurise`. The force of `end` is F/E in m^2, its steps at most `LARGEST_STEP_M`
    unless it gives others; the globe is over E. `progress` is called after each step
    with the finished share of the largest force or travel.
    """
    end_m = end.last_tip_m
    tips_m = end.tips_m
    control = (
        SealedDent(problem, start, pressure, globe)
        if globe.is_sealed
        else Dent(problem, start, pressure)
    )
    walk = _Walk(
        control,
        LARGEST_STEP_M if end.largest_step_m is None else end.largest_step_m,
        end_m,
        EARLY_END if end.as_far_as_found else SMALLEST_STEP,
    )
    kept = [walk.history[0]]

    for goal_m in (
        [end_m] if tips_m is None else [float(tip) for tip in tips_m if tip <= end_m]
    ):
        while (
            walk.tip_m < goal_m
            and control.force(kept[-1][1]) < end.max_force
            and control.travel_m(kept[-1][1]) < end.max_travel_m
        ):
            try:
                walk.step_towards(goal_m)
            except SolverError:
                if end.as_far_as_found:
                    return _states(kept, len(start), control)

                raise

            if progress is not None:
                travel_m = control.travel_m(walk.history[-1][1])
                progress(
                    min(
                        max(
                            control.largest_force / end.max_force,
                            travel_m / end.max_travel_m,
                        ),
                        1.0,
                    )
                )

            if tips_m is None or walk.tip_m >= goal_m:
                kept.append(walk.history[-1])

    return _states(kept, len(start), control)


def _states(
    kept: list[tuple[float, Floats]], unknowns: int, control: Dent
) -> PathStates:
    tips = np.array([tip for tip, _ in kept])
    unknowns_sx = np.stack([x for _, x in kept])
    forces = unknowns_sx[:, control.count]
    displacement_su = unknowns_sx[:, :unknowns]

    if isinstance(control, SealedDent):
        return PathStates(
            tips,
            forces,
            unknowns_sx[:, -1],
            displacement_su,
            unknowns_sx[:, unknowns : 2 * unknowns],
        )

    undented_su = np.broadcast_to(control.start, displacement_su.shape)
    return PathStates(
        tips, forces, np.full(len(tips), control.pressure), displacement_su, undented_su
    )


class _Walk:
    """Steps along the path; each starts from a polynomial through the last states (tip
    in m, unknowns).
    """

    def __init__(
        self, control: Dent, largest_m: float, end_m: float, smallest: float
    ) -> None:
        """`smallest`: of the path, or of its largest step, the shortest step that is
        tried.
        """
        self.control = control
        self.step_m = min(FIRST_STEP_M, largest_m)
        self.largest_m = largest_m
        self.shortest_m = smallest * min(end_m, largest_m)
        self.history: list[tuple[float, Floats]] = [(0.0, control.unloaded)]

    @property
    def tip_m(self) -> float:
        return self.history[-1][0]

    def step_towards(self, goal_m: float) -> None:
        """Take one step, at most to `goal_m`; shorter after failures, the next one
        longer after success at once.
        """
        easy = 2.0
        while True:
            left_m = goal_m - self.tip_m
            # Two equal steps rather than a long and a very short one.
            tip_m = (
                goal_m
                if left_m <= self.step_m
                else self.tip_m + min(self.step_m, 0.5 * left_m)
            )
            self.control.tip_m = tip_m

            try:
                x, factors = solve_balance(self.control, self._extrapolated(tip_m))
            except SolverError as fault:
                easy = 1.0
                self.step_m = 0.5 * (tip_m - self.tip_m)
                if self.step_m >= self.shortest_m:
                    continue

                ratio_mm2 = from_si(self.control.force(self.history[-1][1]), "mm2")
                reached = (
                    f"a dent of {from_si(self.tip_m, 'mm'):.4g} mm,"
                    f" F/E = {ratio_mm2:.4g} mm^2; {self.control.remedy}"
                )
                raise SolverError(
                    f"load path: no equilibrium found beyond {reached}"
                ) from fault

            self.step_m = min(
                self.largest_m,
                self.step_m * (easy if factors == 1 else 1.0 if factors <= 3 else 0.5),
            )
            self.control.largest_force = max(
                self.control.largest_force, abs(self.control.force(x))
            )
            self.history = [*self.history[1 - STATES :], (tip_m, x)]

            return

    def _extrapolated(self, tip_m: float) -> Floats:
        """Lagrange's polynomial through the last states."""
        tips = [tip for tip, _ in self.history]
        guess = np.zeros_like(self.history[0][1])

        for i, (own, x) in enumerate(self.history):
            guess += x * np.prod(
                [
                    (tip_m - other) / (own - other)
                    for j, other in enumerate(tips)
                    if j != i
                ]
            )

        return guess
