"""One compiled call: a frame's fit, from its boundaries to the force with its
posterior.

`tests/oracles/plain_fit.py` does the same by arrays.
"""

from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.compiled_loops import compiled, compiled_part
from scleraforce.base.normal_distribution import NORMAL_MEDIAN
from scleraforce.fit import compiled_search, first_guesses, unknowns
from scleraforce.fit.compiled_search import (
    MOVING,
    UNKNOWNS,
    FrameProblem,
    PriorArrays,
    SearchWorkspace,
)
from scleraforce.fit.first_guesses import Surface
from scleraforce.fit.least_squares import StoppingRule
from scleraforce.fit.shown_wall import (
    GlobeLaw,
    displaced_volume,
    force_at,
    formed_section,
    scene_of,
)
from scleraforce.library.response_splines import SplineTables
from scleraforce.library.sealed_eye import level_of, pressure_of_level
from scleraforce.records.eye import REFERENCE_N

COLUMNS = 110  # of each boundary that are fitted
# standard deviations of the boundaries along their normal
OUTER_SD_M = 5e-6
INNER_SD_M = 9e-6
CORRELATED_M = 1.5e-3  # so far apart two errors of a boundary are independent
# range of a frame's misfit, over the boundaries' SDs: a small one may be chance
LEAST_NOISE = 0.3
MOST_NOISE = 1e3
OUTLIER_SD = 8.0
# so far below the wall the choroid may end, which stretches of the inner boundary may
# follow
LAYER_M = 0.3e-3
MODEL_SD = 0.01  # relative, of the force: real walls against the library's
MODEL_SD_N = 0.1e-3
# A limbus is looked for where a fit leaves aside more than such a share of the columns,
# or loses more than 99 % of the fits of even walls of the library do (138 frames of 16
# virtual eyes).
LOST = 0.05
STRAINED = 30.0
LIMBUS_STARTS = 4  # the best ones
STOPPING = StoppingRule(
    iterations=20, converged_sd=0.05, settled_cost=0.005, retry_damping=1e-2
)
# for differences of fits
TO_THE_END = StoppingRule(iterations=20, converged_sd=0.002, retry_damping=1e-2)
# from each start
FIRST_STEPS = StoppingRule(
    iterations=8, converged_sd=0.05, settled_cost=0.005, retry_damping=1e-2
)
# Of a sealed globe's fit: how unsure the logarithm of the pressure is where others are
# sought, how far off in its standard deviations, how much lower a cost has to be, and
# how often.
VALLEY_SD = 0.08
VALLEY_STRIDE = 2.0
VALLEY_LOWER = 0.1
VALLEY_ROUNDS = 4
FARTHEST_EYE = 3.0  # standard deviations of E and k that a discrepancy is followed to
INTERVAL = (0.05, 0.95)


class UncertaintyDraws(NamedTuple):
    """Standard normal numbers (unknowns and two, draw) and (draw, 2), and the eye's
    `ForceDiscrepancy`.

    `terms` (level and growth, 4): mean, standard deviation, and effects of E and
    rigidity.
    """

    normal: Floats
    level_growth: Floats
    terms: Floats
    correlation: float


class FitArrays(NamedTuple):
    """A frame's fit as plain arrays (`one_frame.BoundaryFit`).

    `spread` (number, unknown): how standard normal numbers draw about the unknowns.
    `numbers` (6,): force, ends of its interval, misfit over the SDs, share of outliers,
    cost.
    """

    unknown: Floats
    spread: Floats
    draws_n: Floats
    wall_bmc: Floats
    numbers: Floats


@compiled
def fit_frame(
    tables: SplineTables,
    law: GlobeLaw,
    lateral_m: Floats,
    depth_bc: Floats,
    smoothing_m: float,
    belief: PriorArrays,
    doubt: UncertaintyDraws,
    borne_n: float,
    begun: Floats,
    fitted: FitArrays,
) -> bool:
    """Write the fit of a frame; from the unknowns `begun` to the end if there are any
    (0 or unknown,).

    `borne_n` is the needle's force, NaN if it is not known. Return False if the frame
    shows too few columns.
    """
    at_m, depth_m, sd_m, outer = _columns(lateral_m, depth_bc, belief.wall_sd_m)
    if outer < UNKNOWNS:
        return False

    problem = _problem(tables, law, (at_m, depth_m, sd_m, outer), smoothing_m, belief)
    work = compiled_search.work_of(problem.scene)
    unknown = fitted.unknown
    spread = fitted.spread

    if len(begun):
        unknown[:] = begun
        compiled_search.keep_inside(tables, unknown)
        cost = compiled_search.find_least_cost(problem, unknown, TO_THE_END, work)
    else:
        starts = np.empty((first_guesses.STARTS, UNKNOWNS))
        surface = first_guesses.surface_of(
            at_m[:outer], depth_m, first_guesses.FARTHEST_M
        )
        count = first_guesses.find_starts(problem, surface, work, starts)
        cost = _best_fit(problem, starts[:count], work, unknown)
        cost = _with_limbus(problem, starts[0], cost, work, unknown)

        if not law.is_open:
            cost = _beyond(problem, surface, borne_n, cost, work, unknown)
            cost = _along_valley(problem, cost, work, unknown, spread)

    _conclude(problem, cost, doubt, work, fitted)
    return True


@compiled_part
def _columns(
    lateral_m: Floats, depth_bc: Floats, wall_sd_m: float
) -> tuple[Floats, Floats, Floats, int]:
    """Return place, depth and its standard deviation of some columns, (place,), m, and
    how many are outer ones.
    """
    step = max(1, -(-len(lateral_m) // COLUMNS))
    count = 0
    outer = 0
    at_m = np.empty(2 * COLUMNS)
    depth_m = np.empty(2 * COLUMNS)
    sd_m = np.empty(2 * COLUMNS)

    for boundary in range(2):
        outer = count
        for column in range(0, len(lateral_m), step):
            if np.isfinite(depth_bc[boundary, column]):
                at_m[count] = lateral_m[column]
                depth_m[count] = depth_bc[boundary, column]
                sd_m[count] = np.hypot(
                    INNER_SD_M if boundary else OUTER_SD_M, wall_sd_m
                )
                count += 1

    return at_m[:count], depth_m[:count], sd_m[:count], outer


@compiled_part
def _problem(
    tables: SplineTables,
    law: GlobeLaw,
    columns: tuple[Floats, Floats, Floats, int],
    smoothing_m: float,
    belief: PriorArrays,
) -> FrameProblem:
    """Return the least-squares problem of some columns."""
    at_m, depth_m, sd_m, outer = columns
    as_one = max(1.0, CORRELATED_M / np.median(at_m[1:outer] - at_m[: outer - 1]))
    places = at_m, outer, smoothing_m
    scene = scene_of(
        tables,
        law.pressure,
        places,
        belief.mean[unknowns.GAP],
        belief.mean[unknowns.THICKNESS],
    )

    return FrameProblem(scene, law, depth_m, sd_m, as_one, belief)


@compiled
def fit_plane(
    tables: SplineTables,
    law: GlobeLaw,
    lateral_m: Floats,
    depth_bc: Floats,
    smoothing_m: float,
    belief: PriorArrays,
    doubt: UncertaintyDraws,
    tilt: float,
    scale: float,
    normal: Floats,
    gradient: Floats,
    fitted: FitArrays,
) -> float:
    """Write the normal equations of one of several planes at its unknowns
    `fitted.unknown`, and return its cost.

    `normal` and `gradient` end with the plane's tilt against the needle axis, whose
    tangent is `tilt`; the columns' SDs count `scale` times. Without a `gradient` (0,)
    write the fit instead, whose spread there is.
    """
    problem = _problem(
        tables,
        law,
        _columns(lateral_m, depth_bc, belief.wall_sd_m),
        smoothing_m,
        belief,
    )
    work = compiled_search.work_of(problem.scene)
    unknown = fitted.unknown
    work.wall.pushed[2] = tilt
    work.other.pushed[2] = tilt
    cost, nodes = compiled_search.evaluate_cost(problem, unknown, work)

    if len(gradient) == 0:
        _write_fit(problem, cost, _misfit(problem, work), doubt, work, fitted)
    else:
        fitted.numbers[3], fitted.numbers[4] = _misfit(problem, work)
        compiled_search.find_normal(problem, unknown, nodes, work, scale)
        normal[:UNKNOWNS, :UNKNOWNS] = work.normal
        gradient[:UNKNOWNS] = work.gradient
        compiled_search.add_tilt(problem, unknown, scale, work, normal, gradient)

    return cost


@compiled
def into_library(tables: SplineTables, unknown: Floats) -> None:
    """Keep unknowns within the library."""
    compiled_search.keep_inside(tables, unknown)


@compiled_part
def _best_fit(
    problem: FrameProblem, starts: Floats, work: SearchWorkspace, unknown: Floats
) -> float:
    """Write the unknowns of the best fit from any start (start, unknown); return its
    cost.
    """
    unknown[:] = starts[0]
    best = np.inf

    if len(starts) > 1:
        for start in starts:
            tried = start.copy()
            cost = compiled_search.find_least_cost(problem, tried, FIRST_STEPS, work)
            if cost < best:
                best = cost
                unknown[:] = tried

    return compiled_search.find_least_cost(problem, unknown, STOPPING, work)


@compiled_part
def _better(
    problem: FrameProblem,
    starts: Floats,
    best: float,
    work: SearchWorkspace,
    unknown: Floats,
) -> float:
    """Put the best fit from any start in place of `unknown` if its cost is lower than
    `best`; return the cost.
    """
    tried = np.empty(UNKNOWNS)
    cost = _best_fit(problem, starts, work, tried)
    if cost < best:
        unknown[:] = tried
        best = cost
    return best


@compiled_part
def _with_limbus(
    problem: FrameProblem,
    first: Floats,
    best: float,
    work: SearchWorkspace,
    unknown: Floats,
) -> float:
    """Put the best fit with a limbus in place of one that leaves much aside, if it is
    better; return the cost.
    """
    if best <= STRAINED:
        compiled_search.evaluate_cost(problem, unknown, work)
        lost = 0

        for place in range(len(work.off)):
            lost += not (
                work.depths.seen[place] and np.abs(work.off[place]) <= OUTLIER_SD
            )

        if lost <= LOST * len(work.off):
            return best

    begun = np.empty((4 + 2 * first_guesses.STARTS, UNKNOWNS))
    count = 0

    for near in (unknown, first):
        for sign in (-1.0, 1.0):
            if first_guesses.limbus_start(problem, near, sign, work, begun[count]):
                count += 1

    count += first_guesses.one_sided_starts(problem, work, begun[count:])
    costs = np.empty(count)
    chosen = np.empty((min(count, LIMBUS_STARTS), UNKNOWNS))
    for number in range(count):
        compiled_search.keep_inside(problem.scene.tables, begun[number])
        costs[number] = compiled_search.evaluate_cost(problem, begun[number], work)[0]

    for number in range(len(chosen)):
        least = int(np.argmin(costs))
        chosen[number] = begun[least]
        costs[least] = np.inf

    return _better(problem, chosen, best, work, unknown) if count else best


@compiled_part
def _beyond(
    problem: FrameProblem,
    surface: Surface,
    borne_n: float,
    best: float,
    work: SearchWorkspace,
    unknown: Floats,
) -> float:
    """Put a sealed globe's fit begun where a known force lies, or at a higher pressure,
    in place of a worse one.

    Where the pressure has nearly run away, two dents that are alike may be under very
    different forces.
    """
    if problem.law.mean <= 0.0:
        return best

    starts = np.empty((2, UNKNOWNS))
    tried = np.empty(UNKNOWNS)
    count = (
        1
        if first_guesses.higher_start(problem, surface, unknown, work, starts[0])
        else 0
    )

    if not np.isnan(borne_n):
        first_guesses.bearing_start(problem, surface, borne_n, work, starts[count])
        count += 1

    for number in range(count):
        compiled_search.keep_inside(problem.scene.tables, starts[number])
        cost = _best_fit(problem, starts[number : number + 1], work, tried)
        if (
            cost < best
            and force_at(problem.scene.tables, problem.law, tried)
            < first_guesses.LARGEST_N
        ):
            unknown[:] = tried
            best = cost

    return best


@compiled_part
def _along_valley(
    problem: FrameProblem,
    best: float,
    work: SearchWorkspace,
    unknown: Floats,
    spread: Floats,
) -> float:
    """Put a sealed globe's fit at a higher or lower pressure in place of a worse one;
    return the cost.

    Where the pressure has nearly run away, dents of very different forces look nearly
    alike: a long bent valley with more than one lowest place.
    """
    for _ in range(VALLEY_ROUNDS):
        _, count = compiled_search.evaluate_cost(problem, unknown, work)
        compiled_search.find_spread(problem, unknown, count, 1.0, work, spread)
        with_pressure = np.zeros(UNKNOWNS)
        for number in range(UNKNOWNS):
            with_pressure += spread[number] * spread[number, unknowns.PRESSURE]

        sd = np.sqrt(with_pressure[unknowns.PRESSURE])
        if sd < VALLEY_SD:
            break

        before = best
        starts = np.empty((2, UNKNOWNS))

        for number in range(2):
            starts[number] = (
                unknown + (2.0 * number - 1.0) * VALLEY_STRIDE * with_pressure / sd
            )
            compiled_search.keep_inside(problem.scene.tables, starts[number])

        for number in range(2):
            best = _better(problem, starts[number : number + 1], best, work, unknown)

        if best > before - VALLEY_LOWER:
            break

    return best


@compiled_part
def _conclude(
    problem: FrameProblem,
    cost: float,
    doubt: UncertaintyDraws,
    work: SearchWorkspace,
    fitted: FitArrays,
) -> None:
    """Write the fit with its uncertainty: the curvature's, with the noise estimated
    from the misfit (Birge).
    """
    _, nodes = compiled_search.evaluate_cost(problem, fitted.unknown, work)
    found = _misfit(problem, work)
    scale = min(
        max(found[0], LEAST_NOISE if problem.belief.wall_sd_m == 0.0 else 1.0),
        MOST_NOISE,
    )
    compiled_search.find_spread(
        problem, fitted.unknown, nodes, scale, work, fitted.spread
    )
    _write_fit(problem, cost, found, doubt, work, fitted)


@compiled_part
def _misfit(problem: FrameProblem, work: SearchWorkspace) -> tuple[float, float]:
    """Return the misfit over the SDs, and the share of outliers, of the wall that was
    evaluated last.
    """
    seen = work.depths.seen
    off = work.off
    lost = 0
    size = np.where(seen, np.abs(off), np.inf)
    misfit = NORMAL_MEDIAN * np.median(size)

    for place in range(len(off)):
        is_layer = (
            place >= problem.scene.outer
            and seen[place]
            and 0.0 < off[place] * INNER_SD_M < LAYER_M
        )
        lost += size[place] > OUTLIER_SD * max(1.0, misfit) and not is_layer

    return misfit, lost / len(off)


@compiled_part
def _write_fit(
    problem: FrameProblem,
    cost: float,
    found: tuple[float, float],
    doubt: UncertaintyDraws,
    work: SearchWorkspace,
    fitted: FitArrays,
) -> None:
    """Write a fit of a misfit and a share of outliers, whose spread there is."""
    _draw_forces(problem, fitted.unknown, fitted.spread, doubt, fitted.draws_n)
    formed_section(problem.scene, fitted.unknown, work.wall, fitted.wall_bmc)
    fitted.numbers[:3] = np.quantile(
        fitted.draws_n, np.array([0.5, INTERVAL[0], INTERVAL[1]])
    )
    fitted.numbers[3] = found[0] * (problem.sd_m[0] / OUTER_SD_M)
    fitted.numbers[4] = found[1]
    fitted.numbers[5] = cost


@compiled_part
def _draw_forces(
    problem: FrameProblem,
    unknown: Floats,
    spread: Floats,
    doubt: UncertaintyDraws,
    draws_n: Floats,
) -> None:
    """Write forces drawn from the posterior, with the model error of the library on
    top.
    """
    tables = problem.scene.tables  # once: each look into the problem counts references
    law = problem.law
    drawn = unknown.copy()
    normals, grown, terms, across = doubt
    moved = np.zeros((len(MOVING), len(draws_n)))
    follows_eye = np.abs(doubt.terms[:, 2:]).max() > 0.0

    for place in range(len(moved)):
        for number in range(UNKNOWNS):
            share = spread[number, MOVING[place]]
            if share != 0.0:
                compiled_search.add_times(moved[place], share, normals[number])

    for draw in range(len(draws_n)):
        for place in range(len(moved)):
            drawn[MOVING[place]] = unknown[MOVING[place]] + moved[place, draw]

        drawn[unknowns.TIP] = max(drawn[unknowns.TIP], 0.0)
        if not law.is_open:
            volume = displaced_volume(tables, law, drawn)
            resting = np.exp(drawn[unknowns.IOP])
            level = level_of(resting, law.is_logarithmic)
            low = np.log(
                pressure_of_level(level + law.lowest * volume, law.is_logarithmic)
            )
            high = np.log(
                pressure_of_level(level + law.highest * volume, law.is_logarithmic)
            )
            drawn[unknowns.PRESSURE] = min(max(drawn[unknowns.PRESSURE], low), high)

        borne_n = force_at(tables, law, drawn)
        level_z, growth_z = grown[draw]
        level = terms[0, 0] + terms[0, 1] * level_z
        growth = terms[1, 0] + terms[1, 1] * (
            across * level_z + np.sqrt(1.0 - across**2) * growth_z
        )

        if follows_eye:
            of_force, of_pressure = compiled_search.deviations(problem, drawn)
            for place, off in enumerate((of_force, of_pressure)):
                eye_z = min(max(off, -FARTHEST_EYE), FARTHEST_EYE)
                level = level + eye_z * terms[0, 2 + place]
                growth = growth + eye_z * terms[1, 2 + place]

        level += growth * (min(max(borne_n / REFERENCE_N, 0.0), 1.0) - 0.5)
        borne_n = (
            borne_n * np.exp(level) * np.exp(MODEL_SD * normals[UNKNOWNS, draw])
            + MODEL_SD_N * normals[UNKNOWNS + 1, draw]
        )
        draws_n[draw] = max(borne_n, 0.0)
