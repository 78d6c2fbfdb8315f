"""Compiled loops: the least-squares problem of one frame, and the damped Gauss-Newton
method that solves it.

`tests/oracles/plain_fit.py` does the same by arrays.
"""

from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled_in_place, compiled_part
from scleraforce.fit import least_squares, unknowns
from scleraforce.fit.least_squares import FIRST_DAMPING, UNSEEN_LOSS, StoppingRule
from scleraforce.fit.prior_of_an_eye import HEAVY
from scleraforce.fit.shown_wall import (
    FitGeometry,
    GlobeLaw,
    ShownWall,
    WallDepths,
    derive,
    empty_wall,
    off_the_law,
    show_wall,
)
from scleraforce.library.response_splines import SplineTables

UNKNOWNS = len(unknowns.NAMES)
BLOCK = 4  # columns that are added together
HEAVY_CAUCHY = 2.0  # standard deviations, of unknowns with a heavy prior
LARGEST_LOG_SIZE = 0.5
HIGHEST_POLE = 0.85  # sine of the largest polar angle of a contact that a fit takes
# Of where the pole lies, in one step: towards the base the wall's bulge turns quickly
# with it, and a fit that strides farther goes to and fro.
POLE_STRIDE = 0.05
POLE = unknowns.POLE.start
FORM = unknowns.FORM.start
MOVING = (
    unknowns.TIP,
    unknowns.THICKNESS,
    unknowns.MODULUS,
    unknowns.IOP,
    unknowns.SIZE,
    unknowns.PRESSURE,
)  # the law's
LENGTH_STEP_M = 1e-7
LOG_STEP = 1e-4
NO_PIVOT = 1e-15  # of a diagonal: what is left of it is rounding

cauchy_loss = compiled_part(least_squares.cauchy_loss)
cauchy_weight = compiled_part(least_squares.cauchy_weight)
judge_step = compiled_part(least_squares.judge_step)


class PriorArrays(NamedTuple):
    """A `prior_of_an_eye.Prior` as plain arrays."""

    mean: Floats
    sd: Floats
    precision: Floats
    same_force: Floats
    calibrated: Floats
    wall_sd_m: float


class FrameProblem(NamedTuple):
    """The least-squares problem of one frame: its scene, the globe's law, the depths it
    shows, and what is known.

    `depth_m` and `sd_m` (place,) belong to the places; `as_one` neighbouring places
    share one error.
    """

    scene: FitGeometry
    law: GlobeLaw
    depth_m: Floats
    sd_m: Floats
    as_one: float
    belief: PriorArrays


class SearchWorkspace(NamedTuple):
    """The wall of the unknowns that were evaluated last, a workspace for walls beside
    it, and the normal equations.

    `off` (place,): how far the columns lie off along the normal, in standard
    deviations. `last`: the unknowns, their cost and the number of nodes that were
    found. `derived` (unknown,): the unknowns of the derivatives.
    """

    wall: ShownWall
    other: ShownWall
    depths: WallDepths
    normal: Floats
    gradient: Floats
    lower: Floats
    step: Floats
    rows: Floats
    off: Floats
    last: Floats
    derived: Floats


@compiled_part
def work_of(scene: FitGeometry) -> SearchWorkspace:
    """Return a workspace without values."""
    count = len(scene.at_m)
    square = (UNKNOWNS, UNKNOWNS)
    seen = np.empty(count, dtype=np.bool_)
    jacobian = np.empty((count, UNKNOWNS))
    depths = WallDepths(
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        seen,
        jacobian,
    )

    return SearchWorkspace(
        empty_wall(scene),
        empty_wall(scene),
        depths,
        np.empty(square),
        np.empty(UNKNOWNS),
        np.empty(square),
        np.empty(UNKNOWNS),
        np.empty((BLOCK, UNKNOWNS)),
        np.empty(count),
        np.full(UNKNOWNS + 2, np.nan),
        np.full(UNKNOWNS, np.nan),
    )


@compiled_part
def evaluate_cost(
    problem: FrameProblem, unknown: Floats, work: SearchWorkspace
) -> tuple[float, int]:
    """Return the cost, the loss of the columns and of leaving the prior, and the number
    of nodes that are found.
    """
    belief = problem.belief
    depths = work.depths
    off = work.off
    lost = 0.0
    known = 0.0

    if _are_same(work.last[:UNKNOWNS], unknown):
        return work.last[UNKNOWNS], int(work.last[UNKNOWNS + 1])

    count = show_wall(problem.scene, unknown, work.wall, depths)
    seen = depths.seen
    slope = depths.slope
    off[:] = (problem.depth_m - depths.depth_m) / (
        problem.sd_m * np.sqrt(1.0 + slope**2)
    )

    for place in range(len(off)):
        lost += cauchy_loss(off[place]) if seen[place] else UNSEEN_LOSS

    away = unknown - belief.mean
    apart = np.array(deviations(problem, unknown))

    for place in HEAVY:
        known += cauchy_loss(away[place] / belief.sd[place], HEAVY_CAUCHY)
        away[place] = 0.0

    known += _square(belief.precision, away) + _square(belief.calibrated, apart)
    work.last[:UNKNOWNS] = unknown
    work.last[UNKNOWNS] = lost / problem.as_one + known
    work.last[UNKNOWNS + 1] = count

    return work.last[UNKNOWNS], count


@compiled_in_place
def _are_same(first: Floats, second: Floats) -> bool:
    """Return whether unknowns are the same ones."""
    are_same = True
    for place in range(len(first)):
        are_same = are_same and first[place] == second[place]
    return are_same


@compiled_in_place
def _square(matrix: Floats, vector: Floats) -> float:
    """Return a vector's squared length by a matrix."""
    length = 0.0
    for i in range(len(vector)):
        length += vector[i] * dot(matrix[i], vector)
    return length


@compiled_in_place
def dot(first: Floats, second: Floats) -> float:
    """Return a product without an array between."""
    total = 0.0
    for i in range(len(first)):
        total += first[i] * second[i]
    return total


@compiled_in_place
def add_times(values: Floats, times: float, others: Floats) -> None:
    """Add other values, times a number, without an array between."""
    for i in range(len(values)):
        values[i] += times * others[i]


@compiled_in_place
def deviations(problem: FrameProblem, unknown: Floats) -> tuple[float, float]:
    """Return the deviations, in standard deviations, of the force at a dent and of the
    pressure.
    """
    belief = problem.belief
    of_force = 0.0
    for place in range(len(unknown)):
        away = unknown[place] - belief.mean[place]
        of_force += away * belief.same_force[place]

    if problem.law.is_open:
        return of_force, 0.0

    off, sd = off_the_law(problem.scene.tables, problem.law, unknown)
    return of_force, off / sd


@compiled_part
def find_normal(
    problem: FrameProblem,
    unknown: Floats,
    count: int,
    work: SearchWorkspace,
    scale: float,
) -> None:
    """Write normal matrix and gradient of the wall that was evaluated last, the
    columns' SDs times `scale`.
    """
    belief = problem.belief
    law = problem.law
    normal = work.normal
    gradient = work.gradient
    away = unknown.copy()
    if not _are_same(work.derived, unknown):
        derive(problem.scene, unknown, count, work.wall, work.other, work.depths)
        work.derived[:] = unknown

    normal[:] = belief.precision
    away[:] = unknown - belief.mean

    for place in HEAVY:
        normal[place, place] *= cauchy_weight(
            away[place] / belief.sd[place], HEAVY_CAUCHY
        )

    slopes = np.zeros((2, UNKNOWNS))
    off = np.array(deviations(problem, unknown))
    varied = unknown.copy()
    slopes[0] = belief.same_force

    if not law.is_open:
        here, sd = off_the_law(problem.scene.tables, law, unknown)
        for place in MOVING:
            step = (
                LENGTH_STEP_M
                if place in (unknowns.TIP, unknowns.THICKNESS)
                else LOG_STEP
            )
            varied[place] += step
            slopes[1, place] = (
                off_the_law(problem.scene.tables, law, varied)[0] - here
            ) / (step * sd)
            varied[place] = unknown[place]

    for i in range(UNKNOWNS):
        gradient[i] = -dot(normal[i], away)
        for m in range(2):
            weighted = (
                slopes[0, i] * belief.calibrated[0, m]
                + slopes[1, i] * belief.calibrated[1, m]
            )
            gradient[i] -= weighted * off[m]
            add_times(normal[i], weighted, slopes[m])

    _add_columns(problem, scale, work)


@compiled_part
def _add_columns(problem: FrameProblem, scale: float, work: SearchWorkspace) -> None:
    """Add the columns' normal matrix and gradient, by blocks: the matrix is touched
    once for several columns.
    """
    normal = work.normal
    gradient = work.gradient
    rows = work.rows
    rest = np.empty(BLOCK)
    off = work.off
    jacobian = work.depths.jacobian
    weight = np.sqrt(cauchy_weight(off) / (problem.as_one * scale**2))
    per_m = weight / (problem.sd_m * np.sqrt(1.0 + work.depths.slope**2))
    seen = work.depths.seen

    for first in range(0, len(off), BLOCK):
        rows[:] = 0.0
        rest[:] = 0.0

        for place in range(first, min(first + BLOCK, len(off))):
            if seen[place]:
                rest[place - first] = weight[place] * off[place]
                add_times(rows[place - first], per_m[place], jacobian[place])

        for i in range(UNKNOWNS):
            a = rows[0, i]
            b = rows[1, i]
            c = rows[2, i]
            d = rows[3, i]
            gradient[i] += a * rest[0] + b * rest[1] + c * rest[2] + d * rest[3]

            if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
                for j in range(UNKNOWNS):
                    normal[i, j] += (
                        a * rows[0, j]
                        + b * rows[1, j]
                        + c * rows[2, j]
                        + d * rows[3, j]
                    )


@compiled_in_place
def add_tilt(
    problem: FrameProblem,
    unknown: Floats,
    scale: float,
    work: SearchWorkspace,
    normal: Floats,
    gradient: Floats,
) -> None:
    """Write the last row of normal equations that end with the tilt of the plane.

    With the depth the gap grows by it, and the way down the plane is longer than that
    along the needle axis.
    """
    tilt = UNKNOWNS
    c = np.cos(unknown[unknowns.ROTATION])
    s = np.sin(unknown[unknowns.ROTATION])
    normal[tilt, :] = 0.0
    gradient[tilt] = 0.0
    depths = work.depths

    for place in range(len(work.off)):
        if depths.seen[place]:
            row = depths.jacobian[place]
            off = work.off[place]
            weight = cauchy_weight(off) / (problem.as_one * scale**2)
            sd_m = problem.sd_m[place] * np.sqrt(1.0 + depths.slope[place] ** 2)
            across = problem.scene.at_m[place] - unknown[unknowns.LATERAL]
            down = depths.even_m[place] - unknown[unknowns.DEPTH]
            deep = c * down - s * across
            by_tilt = (
                (
                    row[unknowns.GAP]
                    + (c + depths.even_slope[place] * s) * work.wall.pushed[2]
                )
                * deep
                / sd_m
            )
            gradient[tilt] += weight * off * by_tilt
            normal[tilt, tilt] += weight * by_tilt**2
            add_times(normal[tilt, :tilt], weight * by_tilt / sd_m, row)

    for i in range(tilt):
        normal[i, tilt] = normal[tilt, i]


@compiled_in_place
def keep_inside(tables: SplineTables, unknown: Floats) -> None:
    """Keep dent and pressure within the library; a search strides beyond, even to walls
    of no thickness.
    """
    unknown[unknowns.SIZE] = min(
        max(unknown[unknowns.SIZE], -LARGEST_LOG_SIZE), LARGEST_LOG_SIZE
    )
    size = np.exp(unknown[unknowns.SIZE])
    low, high = tables.thickness_ends_m
    modulus = unknown[unknowns.MODULUS]
    unknown[unknowns.TIP] = min(
        max(unknown[unknowns.TIP], 0.0), tables.tip_m[-1] * size
    )
    per_tension = (
        min(max(unknown[unknowns.THICKNESS] / size, low), high) / tables.radius_m
    )
    least = np.log(tables.tension_ends[0] * per_tension)
    most = np.log(tables.tension_ends[1] * per_tension)
    unknown[unknowns.PRESSURE] = min(
        max(unknown[unknowns.PRESSURE], least + modulus), most + modulus
    )

    for place in range(unknowns.FORM_ENDS.shape[1]):
        form = FORM + place
        least = unknowns.FORM_ENDS[0, place]
        most = unknowns.FORM_ENDS[1, place]
        unknown[form] = min(max(unknown[form], least), most)

    farthest = min(
        1.0,
        HIGHEST_POLE / max(np.hypot(unknown[POLE], unknown[POLE + 1]), HIGHEST_POLE),
    )
    unknown[POLE] *= farthest
    unknown[POLE + 1] *= farthest


@compiled_part
def find_least_cost(
    problem: FrameProblem,
    unknown: Floats,
    stopping: StoppingRule,
    work: SearchWorkspace,
) -> float:
    """Move unknowns to the least cost near them, and return it; as
    `least_squares.gauss_newton`.
    """
    damping = FIRST_DAMPING
    trial = np.empty(UNKNOWNS)
    is_better = True
    cost, count = evaluate_cost(problem, unknown, work)

    for _ in range(stopping.iterations):
        if is_better:
            find_normal(problem, unknown, count, work, 1.0)

        _find_step(work, damping)
        trial[:] = unknown + work.step
        keep_inside(problem.scene.tables, trial)
        if _square(work.normal, trial - unknown) < stopping.converged_sd**2:
            break

        trial_cost, count = evaluate_cost(problem, trial, work)
        damping, is_better, has_settled = judge_step(
            damping, cost - trial_cost, stopping
        )
        if not is_better:
            continue

        unknown[:] = trial
        cost = trial_cost
        if has_settled:
            break

    return cost


@compiled_part
def _find_step(work: SearchWorkspace, damping: float) -> None:
    """Write the step of damped normal equations, where the pole moves no farther than
    its effect is straight.
    """
    lower = work.lower
    step = work.step
    lower[:] = work.normal
    step[:] = work.gradient

    for i in range(UNKNOWNS):
        lower[i, i] += damping * work.normal[i, i]

    factorise(lower)
    solve(lower, step)

    farther = np.hypot(step[POLE], step[POLE + 1]) / POLE_STRIDE
    if farther > 1.0:
        rest = step[:POLE]
        along = step[POLE] / farther
        across = step[POLE + 1] / farther
        rest[:] = (
            work.gradient[:POLE]
            - work.normal[:POLE, POLE] * along
            - work.normal[:POLE, POLE + 1] * across
        )
        solve(lower[:POLE], rest)
        step[POLE] = along
        step[POLE + 1] = across


@compiled_in_place
def factorise(matrix: Floats) -> None:
    """Write the Cholesky factor of a symmetric matrix into its lower half; what it does
    not determine becomes 0.
    """
    for i in range(len(matrix)):
        for j in range(i):
            matrix[i, j] = (matrix[i, j] - dot(matrix[i, :j], matrix[j, :j])) / matrix[
                j, j
            ]

        rest = matrix[i, i] - dot(matrix[i, :i], matrix[i, :i])
        matrix[i, i] = np.sqrt(rest) if rest > NO_PIVOT * matrix[i, i] else np.inf


@compiled_in_place
def solve(lower: Floats, values: Floats) -> None:
    """Solve the equations of a factor's matrix for their right-hand side, in place."""
    for i in range(len(values)):
        values[i] = (values[i] - dot(lower[i, :i], values[:i])) / lower[i, i]
    for i in range(len(values) - 1, -1, -1):
        values[i] /= lower[i, i]
        add_times(values[:i], -values[i], lower[i, :i])


@compiled_part
def find_spread(
    problem: FrameProblem,
    unknown: Floats,
    count: int,
    scale: float,
    work: SearchWorkspace,
    spread: Floats,
) -> None:
    """Write how standard normal numbers draw about the unknowns (number, unknown)."""
    find_normal(problem, unknown, count, work, scale)
    # in these units the matrix is well conditioned
    sd = problem.belief.sd
    lower = work.lower
    for i in range(UNKNOWNS):
        lower[i] = sd[i] * work.normal[i] * sd

    factorise(lower)
    spread[:] = 0.0

    for number in range(UNKNOWNS):  # the factor's inverse, row by row
        row = spread[number]
        row[number] = 1.0
        for i in range(number, -1, -1):
            row[i] /= lower[i, i]
            add_times(row[:i], -row[i], lower[i, :i])

        row *= sd
