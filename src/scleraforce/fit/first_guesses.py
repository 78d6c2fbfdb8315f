"""Compiled loops: starts of a fit, the best of a coarse search over walls and lateral
places on the outer boundary.

In a globe that may be sealed each dent is tried at two pressures: for the least
rigidity that it may have and for its mean. A dent at which that pressure runs away is
not a start. Where it has nearly run away, dents hardly grow with the force, or shrink:
the states of such a globe are then searched by their pressure. A fit that lies badly on
a frame starts again with a limbus where the rest of the surface shows one.
"""

from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats, Places
from scleraforce.base.compiled_loops import compiled_in_place, compiled_part
from scleraforce.fit import unknowns
from scleraforce.fit.compiled_search import (
    UNKNOWNS,
    FrameProblem,
    SearchWorkspace,
    dot,
    factorise,
    solve,
)
from scleraforce.fit.curve_placement import without_folds
from scleraforce.fit.shown_wall import (
    cut_wall,
    find_curve,
    force_at,
    library_place,
    show_wall,
)
from scleraforce.library.response_splines import value_of
from scleraforce.library.sealed_eye import level_of, pressure_at_dent

DENTS = 14
STARTS = 2
SHIFT_M = 0.3e-3
FARTHEST_M = 3e-3
POINTS = 40  # of the outer boundary
GRID_M = 50e-6
MUCH_WORSE = 3.0  # times as far off as the best
SURELY = 1.0 - 1e-9  # of a lower bound: the rest is rounding
FAR_M = 0.3e-3  # a column that is farther off than this does not care how much
PRESSURES = 24  # at which the states of a sealed globe are found
HIGHER = 0.3  # a much higher pressure's logarithm is higher by this
LARGEST_N = 90e-3  # half as much again as the forces of a needle


class Surface(NamedTuple):
    """Some places of an outer boundary and their depth, m, the shifts of a wall laid on
    it, and workspace.

    `cells` (shift, place): the cell of a grid in which a place lies on a shifted wall.
    `grid_m` (grid,): depths of a wall at the places of the grid; `rest_m` (place,):
    what is left of the depths; `bounds` (shift,): how far off the wall is at least.
    """

    lateral_m: Floats
    depth_m: Floats
    shift_m: Floats
    cells: Places
    grid_m: Floats
    rest_m: Floats
    bounds: Floats


@compiled_part
def surface_of(lateral_m: Floats, depth_m: Floats, farthest_m: float) -> Surface:
    """Return some places of an outer boundary, (place,), where it is seen."""
    count = len(lateral_m)
    some = np.empty((2, min(POINTS, len(lateral_m))))

    for point in range(some.shape[1]):
        place = (
            count - 1
            if point == POINTS - 1
            else int(point * max(1.0, (count - 1) / (POINTS - 1)))
        )
        some[0, point] = lateral_m[place]
        some[1, point] = depth_m[place]

    reach = (
        int(np.ceil((max(-lateral_m[0], lateral_m[count - 1]) + farthest_m) / GRID_M))
        + 1
    )
    shift_m = np.empty(int(np.ceil(2.0 * farthest_m / SHIFT_M + 0.5)))
    cells = np.empty((len(shift_m), some.shape[1]), dtype=np.intp)
    for shift in range(len(shift_m)):
        shift_m[shift] = shift * SHIFT_M - farthest_m
        for point in range(some.shape[1]):
            along = (some[0, point] - shift_m[shift]) / GRID_M
            cells[shift, point] = int(np.rint(along)) + reach

    return Surface(
        some[0],
        some[1],
        shift_m,
        cells,
        np.empty(2 * reach + 1),
        np.empty(some.shape[1]),
        np.empty(len(shift_m)),
    )


@compiled_part
def _lay(
    problem: FrameProblem,
    surface: Surface,
    unknown: Floats,
    pose: Floats,
    limit: float,
    work: SearchWorkspace,
) -> float:
    """Write the best lateral place and depth of a wall on a surface; return how far off
    it then is, infinity if that is beyond a limit.

    The wall is taken at the pose of other unknowns, `pose`, as one over the pole.
    """
    wall = work.other
    tables = problem.scene.tables
    nodes = work.other.curve.shape[1]
    posed = unknown.copy()

    for place in (unknowns.LATERAL, unknowns.DEPTH, unknowns.ROTATION):
        posed[place] = pose[place]

    find_curve(
        tables, library_place(tables, posed, problem.law.pressure), nodes, wall, 1
    )
    wall.motion[0] = 0.0
    wall.pushed[:] = 0.0
    cut_wall(wall.curve[0], wall.motion[0], wall.pushed, nodes, posed, wall)
    length = without_folds(wall.lateral, wall.down, 2 * nodes)
    segment = 0
    after = 0
    lateral = wall.lateral
    down = wall.down
    grid_m = surface.grid_m
    reach = len(surface.grid_m) // 2
    steep = 0.0

    for place in range(len(grid_m)):
        along = min(max((place - reach) * GRID_M, lateral[0]), lateral[length - 1])
        while segment < length - 2 and lateral[segment + 1] <= along:
            segment += 1

        if after <= segment < length - 1:
            after = segment + 1
            steep = (down[after] - down[segment]) / (lateral[after] - lateral[segment])

        grid_m[place] = down[segment] + steep * (along - lateral[segment])

    return _shift_best(surface, unknown, limit)


@compiled_part
def _shift_best(surface: Surface, unknown: Floats, limit: float) -> float:
    """Write the best lateral place and depth of the wall on the surface's grid; return
    how far off it then is, infinity if that is beyond a limit.

    Shifts are tried in the order of their lower bounds, until no other can be better.
    """
    best = np.inf
    best_shift = len(surface.shift_m)
    bounds = surface.bounds
    rest_m = surface.rest_m
    count = len(rest_m)

    for shift in range(len(bounds)):
        _find_rest(surface, shift)
        bounds[shift] = _least_off(rest_m)

    for _ in range(len(bounds)):
        shift = int(np.argmin(bounds))
        if bounds[shift] > min(best, limit):
            break

        bounds[shift] = np.inf
        _find_rest(surface, shift)
        halves_m = np.partition(rest_m, count // 2)
        upper = halves_m[count // 2]
        middle = 0.5 * (upper + (upper if count % 2 else halves_m[: count // 2].max()))
        off = 0.0
        for place in range(count):
            off += min(np.abs(rest_m[place] - middle), FAR_M) / count

        if off < best or (off == best and shift < best_shift):
            best = off
            best_shift = shift
            unknown[unknowns.LATERAL] = surface.shift_m[shift]
            unknown[unknowns.DEPTH] = middle

    return best


@compiled_in_place
def _find_rest(surface: Surface, shift: int) -> None:
    """Write what a shifted wall leaves of the surface's depths."""
    cells = surface.cells[shift]
    depth_m = surface.depth_m
    grid_m = surface.grid_m
    rest_m = surface.rest_m
    for place in range(len(rest_m)):
        rest_m[place] = depth_m[place] - grid_m[cells[place]]


@compiled_in_place
def _least_off(rest_m: Floats) -> float:
    """Return a lower bound of how far off a wall is at any depth.

    Of two places, one is off by at least what the other is not of their difference.
    """
    half = len(rest_m) // 2
    off = 0.0
    for place in range(half):
        off += min(np.abs(rest_m[place] - rest_m[place + half]), FAR_M)
    return SURELY * off / len(rest_m)


@compiled_part
def find_starts(
    problem: FrameProblem, surface: Surface, work: SearchWorkspace, found: Floats
) -> int:
    """Write at most STARTS starts (start, unknown), dents that lie better than their
    neighbours; return their number.

    The best comes first. Each has its best lateral place and depth. A dent that lies
    much worse than the best is not a start. Where no pressure bears any dent, the mean
    is one.
    """
    tables = problem.scene.tables
    law = problem.law
    mean = problem.belief.mean
    laid = np.empty((DENTS, UNKNOWNS))
    least = np.full(DENTS + 2, np.inf)
    tried = np.empty(UNKNOWNS)
    thickness, resting, size, modulus, per_rate = _resting(problem)

    for rigidity in range(1 if law.is_open else 2):
        for dent in range(DENTS):
            # they crowd where they are shallow: forces grow quickest there
            tried[:] = mean
            tried[unknowns.TIP] = tables.tip_m[-1] * size * (dent / (DENTS - 1)) ** 1.5

            if not law.is_open:
                rate = (law.mean if rigidity else law.lowest) * per_rate
                state = (
                    thickness,
                    resting,
                    min(tried[unknowns.TIP] / size, tables.tip_m[-1]),
                )
                ratio = pressure_at_dent(tables, state, rate, law.is_logarithmic)
                if np.isnan(ratio):
                    continue

                tried[unknowns.PRESSURE] = np.log(ratio * modulus)

            # one that lies much worse matters no more, however far off it is
            limit = MUCH_WORSE * least.min()
            off = _lay(problem, surface, tried, mean, limit, work)
            if off < least[dent + 1]:
                least[dent + 1] = off
                laid[dent] = tried

    worst = MUCH_WORSE * least.min()
    count = 0
    costs = np.full(DENTS, np.inf)

    for dent in range(DENTS):
        off = least[dent + 1]
        if off <= least[dent] and off <= least[dent + 2] and off <= worst:
            costs[dent] = off

    while count < STARTS and costs.min() < np.inf:
        best = int(np.argmin(costs))
        found[count] = laid[best]
        costs[best] = np.inf
        count += 1

    if count == 0:
        found[0] = mean
        count = 1

    return count


@compiled_in_place
def _resting(problem: FrameProblem) -> tuple[float, float, float, float, float]:
    """Return the mean's thickness and pressure over E without the needle, in the
    library's size; that size, and E.

    The last number is the rate of its globe's law there over that of the globe
    (`records.globe`).
    """
    mean = problem.belief.mean
    thickness, ratio, _ = library_place(problem.scene.tables, mean, unknowns.IOP)
    size = np.exp(mean[unknowns.SIZE])
    modulus = np.exp(mean[unknowns.MODULUS])

    return (
        thickness,
        ratio,
        size,
        modulus,
        size**3 / (1.0 if problem.law.is_logarithmic else np.cbrt(modulus)),
    )


@compiled_part
def bearing_start(
    problem: FrameProblem,
    surface: Surface,
    borne_n: float,
    work: SearchWorkspace,
    start: Floats,
) -> None:
    """Write the start in a sealed globe whose needle is known to bear a force."""
    states = np.empty((PRESSURES, UNKNOWNS))
    best = np.inf

    for state in range(_find_states(problem, states)):
        off = np.abs(
            force_at(problem.scene.tables, problem.law, states[state]) - borne_n
        )
        if off < best:
            best = off
            start[:] = states[state]

    _lay(problem, surface, start, problem.belief.mean, np.inf, work)


@compiled_part
def higher_start(
    problem: FrameProblem,
    surface: Surface,
    fitted: Floats,
    work: SearchWorkspace,
    start: Floats,
) -> bool:
    """Write the best state of a sealed globe among those at much higher pressures than
    `fitted`.

    Return False if all lie much worse than that one, or the globe has none.
    """
    states = np.empty((PRESSURES, UNKNOWNS))
    tried = fitted.copy()
    found = False
    best = MUCH_WORSE * _lay(problem, surface, tried, fitted, np.inf, work)

    for state in range(_find_states(problem, states)):
        tried[:] = states[state]
        borne_n = force_at(problem.scene.tables, problem.law, tried)
        if (
            tried[unknowns.PRESSURE] > fitted[unknowns.PRESSURE] + HIGHER
            and borne_n < LARGEST_N
        ):
            off = _lay(problem, surface, tried, fitted, best, work)
            if off < best or (off == best and not found):
                best = off
                start[:] = tried
                found = True

    return found


@compiled_part
def _find_states(problem: FrameProblem, states: Floats) -> int:
    """Write states of a globe of the mean rigidity (state, unknown), by their pressure;
    return their number.
    """
    tables = problem.scene.tables
    law = problem.law
    count = 0
    thickness, resting, size, modulus, per_rate = _resting(problem)
    tips = tables.tip_m
    highest = tables.tension_ends[1] * thickness / tables.radius_m

    for number in range(PRESSURES):
        ratio = resting * (highest / resting) ** (number / (PRESSURES - 1))
        tip = 0
        risen = level_of(ratio, law.is_logarithmic) - level_of(
            resting, law.is_logarithmic
        )
        volume = risen / (law.mean * per_rate)
        low = value_of(tables, tables.volumes, thickness, ratio, tips[0])

        if volume <= value_of(tables, tables.volumes, thickness, ratio, tips[-1]):
            high = value_of(tables, tables.volumes, thickness, ratio, tips[1])
            while tip < len(tips) - 2 and high <= volume:
                tip = tip + 1
                low = high
                high = value_of(tables, tables.volumes, thickness, ratio, tips[tip + 1])

            states[count] = problem.belief.mean
            states[count, unknowns.PRESSURE] = np.log(ratio * modulus)
            states[count, unknowns.TIP] = size * (
                tips[tip] + (volume - low) / (high - low) * (tips[tip + 1] - tips[tip])
            )
            count += 1

    return count


LIMBUS_PLACES_M = np.arange(1.5e-3, 6.0e-3, 0.25e-3)
LEAST_COLUMNS = 5  # beyond a limbus
CURVATURE = 2  # of a side's form
# how far to either side of the middle the contact of a readable frame lies
MIDDLE_M = 1.5e-3


@compiled_part
def limbus_start(
    problem: FrameProblem,
    unknown: Floats,
    sign: float,
    work: SearchWorkspace,
    start: Floats,
) -> bool:
    """Write unknowns with a limbus on one side; return False where too little of the
    surface is seen there.

    The limbus's place is searched; the angle and the curvature beyond, and the depth
    and the turn of the wall with them, follow by linear least squares on the outer
    boundary. `unknown` is a fit without that limbus; side -1 is the left one, 1 the
    right one.
    """
    scene = problem.scene
    depths = work.depths
    work.last[0] = np.nan
    show_wall(scene, unknown, work.wall, depths)
    basis = np.zeros((scene.outer, 4))
    along_m = np.empty(scene.outer)
    rest_m = np.empty(scene.outer)

    for place in range(scene.outer):
        across = scene.at_m[place] - unknown[unknowns.LATERAL]
        along_m[place] = sign * across
        rest_m[place] = problem.depth_m[place] - depths.depth_m[place]

        if depths.seen[place]:
            basis[place, 0] = 1.0
            basis[place, 1] = across + depths.even_slope[place] * (
                depths.even_m[place] - unknown[unknowns.DEPTH]
            )

    best = np.inf
    solution = np.empty(4)
    first = unknowns.FORM.start + (0 if sign < 0.0 else 3)

    for limbus_m in LIMBUS_PLACES_M:
        off_m = _fit_limbus(limbus_m, along_m, rest_m, basis, solution)
        if off_m < best:
            best = off_m
            start[:] = unknown
            start[unknowns.DEPTH] += solution[0]
            start[unknowns.ROTATION] += solution[1]
            start[first] = limbus_m
            start[first + 1] = solution[2]
            start[first + 2] = solution[3]

    return best < np.inf


@compiled_part
def _fit_limbus(
    limbus_m: float, along_m: Floats, rest_m: Floats, basis: Floats, solution: Floats
) -> float:
    """Write depth, turn, angle and curvature of the best limbus at a place; return the
    mean misfit of the surface.

    `along_m`: places of the surface towards it, from the contact; `rest_m`: depths
    below the wall without it; `basis` (place, 4): derivatives by the pose, and
    workspace.
    """
    count = 0
    for place in range(len(along_m)):
        beyond_m = max(along_m[place] - limbus_m, 0.0)
        count += beyond_m > 0.0
        basis[place, 2] = beyond_m
        basis[place, 3] = 0.5 * beyond_m**2

    if count < LEAST_COLUMNS:
        return np.inf

    matrix = np.zeros((4, 4))
    solution[:] = 0.0

    for place in range(len(along_m)):
        for i in range(4):
            solution[i] += basis[place, i] * rest_m[place]
            for j in range(4):
                matrix[i, j] += basis[place, i] * basis[place, j]

    towards = solution.copy()
    lower = matrix.copy()
    off_m = 0.0
    factorise(lower)
    solve(lower, solution)

    curvature = min(
        max(solution[3], unknowns.FORM_ENDS[0, CURVATURE]),
        unknowns.FORM_ENDS[1, CURVATURE],
    )
    if curvature != solution[3]:
        solution[:3] = towards[:3] - curvature * matrix[:3, 3]
        solution[3] = curvature
        solve(lower[:3, :3], solution[:3])

    for place in range(len(along_m)):
        off_m += np.abs(rest_m[place] - dot(basis[place], solution))

    return off_m / len(along_m)


@compiled_part
def one_sided_starts(
    problem: FrameProblem, work: SearchWorkspace, found: Floats
) -> int:
    """Write unknowns with a limbus on one side, of walls laid on the middle and the
    other side; return their number.

    A needle that hardly dents the wall 2 mm beside a limbus shows less than the furrow
    there, which a search over the whole surface takes for the dent.
    """
    count = 0
    begun = np.empty((STARTS, UNKNOWNS))
    lateral_m = problem.scene.at_m[: problem.scene.outer]
    depth_m = problem.depth_m[: problem.scene.outer]

    for sign in (-1.0, 1.0):
        near = sign * lateral_m <= MIDDLE_M
        if np.count_nonzero(near) < LEAST_COLUMNS:
            continue

        surface = surface_of(lateral_m[near], depth_m[near], MIDDLE_M)
        for number in range(find_starts(problem, surface, work, begun)):
            if limbus_start(problem, begun[number], sign, work, found[count]):
                count += 1

    return count
