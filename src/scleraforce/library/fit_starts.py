"""Starts of a fit: the best of a coarse search over walls and lateral places, on the outer boundary alone.

In a globe that may be sealed each dent is tried at two pressures: for the least rigidity that it may have and for its
mean. A dent at which that pressure runs away is not a start. Where it has nearly run away, dents hardly grow with the
force, or shrink: the states of such a globe are then searched by their pressure. A fit that lies badly on a frame
starts again with a limbus where the rest of the surface shows one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.library import unknowns as at
from scleraforce.library.placement import Columns, Placed
from scleraforce.library.prediction import Walls, force_n, place_walls, predict_wall
from scleraforce.library.sealed import iop_ratio_at_dent

Array = NDArray[np.float64]

DENTS = 14
SHIFT_M = 0.3e-3
FARTHEST_M = 3e-3
POINTS = 40  # of the outer boundary
GRID_M = 50e-6
MUCH_WORSE = 3.0  # times as far off as the best
FAR_M = 0.3e-3  # a column that is farther off than this does not care how much
PRESSURES = 24  # at which the states of a sealed globe are found
HIGHER = 0.3  # a much higher pressure's logarithm is higher by this
LARGEST_N = 90e-3  # half as much again as the forces of a needle


def starts(
    walls: Walls, mean: Array, lateral_m: Array, depth_m: Array, count: int, farthest_m: float = FARTHEST_M
) -> list[Array]:
    """Return at most `count` starts: dents that lie better than their neighbours, the best first, (unknown,) each.

    Each has its best lateral place, at most `farthest_m` from the frame's middle, and depth. A dent that lies much
    worse than the best is not a start. `mean` (unknown,) is the prior's; `lateral_m` and `depth_m` (place,) are the
    outer boundary where it is seen.
    """
    # Dents crowd where they are shallow: forces grow quickest there.
    tips = walls.library.tip_m[-1] * np.exp(mean[at.SIZE]) * np.linspace(0.0, 1.0, DENTS) ** 1.5
    samples = np.repeat(mean[None], DENTS, axis=0)
    samples[:, at.TIP] = tips
    samples, dent_s = _at_pressures(walls, samples)
    laid, cost = _laid(walls, samples, lateral_m, depth_m, farthest_m)
    least = np.full(DENTS, np.inf)
    np.minimum.at(least, dent_s, cost)
    around = np.concatenate([[np.inf], least, [np.inf]])
    better = np.flatnonzero((least <= around[:-2]) & (least <= around[2:]) & (least <= MUCH_WORSE * least.min()))
    best = better[np.argsort(least[better])][:count]
    return [laid[int(np.argmin(np.where(dent_s == dent, cost, np.inf)))] for dent in best]


def bearing_start(walls: Walls, mean: Array, borne_n: float, lateral_m: Array, depth_m: Array) -> Array:
    """Return the start (unknown,) in a sealed globe whose needle is known to bear a force; arguments of `starts`."""
    states = _by_pressure(walls, mean)
    nearest = int(np.argmin(np.abs(force_n(walls, states) - borne_n)))
    start: Array = _laid(walls, states[[nearest]], lateral_m, depth_m)[0][0]
    return start


def higher_start(walls: Walls, mean: Array, fitted: Array, lateral_m: Array, depth_m: Array) -> Array | None:
    """Return the best state of a sealed globe among those at much higher pressures than `fitted`.

    None if all lie much worse than that one, or the globe has none; other arguments as for `starts`.
    """
    states = _by_pressure(walls, mean)
    higher = (states[:, at.PRESSURE] > fitted[at.PRESSURE] + HIGHER) & (force_n(walls, states) < LARGEST_N)
    laid, cost = _laid(walls, np.concatenate([fitted[None], states[higher]]), lateral_m, depth_m)
    best = int(np.argmin(cost[1:])) + 1 if higher.any() else 0
    return laid[best] if best and cost[best] <= MUCH_WORSE * cost[0] else None


def _laid(
    walls: Walls, samples: Array, lateral_m: Array, depth_m: Array, farthest_m: float = FARTHEST_M
) -> tuple[Array, Array]:
    """Return the best poses of walls on an outer boundary (sample, unknown), and how far off they are (sample,)."""
    some = np.unique(np.linspace(0, len(lateral_m) - 1, POINTS).astype(np.intp))
    lateral_m, depth_m = lateral_m[some], depth_m[some]
    over_pole = samples.copy()
    over_pole[:, at.POLE] = 0.0
    outer = place_walls(walls, over_pole)[:, 0]
    reach = int(np.ceil((np.abs(lateral_m).max() + farthest_m) / GRID_M)) + 1
    grid = np.arange(-reach, reach + 1) * GRID_M
    depth_sg = np.stack([np.interp(grid, curve[:, 0], curve[:, 1]) for curve in outer])
    shifts = np.arange(-farthest_m, farthest_m + SHIFT_M / 2, SHIFT_M)
    cell = np.rint((lateral_m - shifts[:, None]) / GRID_M).astype(np.intp) + reach
    rest = depth_m - depth_sg[:, cell]  # (sample, shift, place)
    down = np.median(rest, axis=2)
    cost = np.minimum(np.abs(rest - down[..., None]), FAR_M).mean(axis=2)
    every, best = np.arange(len(samples)), cost.argmin(axis=1)
    laid = samples.copy()
    laid[:, at.LATERAL], laid[:, at.DEPTH] = shifts[best], down[every, best]
    return laid, cost[every, best]


def _at_pressures(walls: Walls, dents_du: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return dents (sample, unknown) at their possible pressures, and the number of the dent of each (sample,)."""
    globe, dents = walls.globe, np.arange(len(dents_du))
    if not globe.can_be_sealed:
        return dents_du, dents
    thickness, resting, size, modulus = _resting(walls, dents_du)
    rigidity = np.repeat([globe.lowest, globe.mean], len(dents))
    tips = np.minimum(dents_du[:, at.TIP] / size, walls.library.tip_m[-1])
    thickness, resting, tips, size, modulus = (np.tile(part, 2) for part in (thickness, resting, tips, size, modulus))
    law = globe.globe(rigidity * size**3).over(modulus)
    ratio = iop_ratio_at_dent(walls.library, thickness, resting, tips, law)
    borne = np.isfinite(ratio)
    samples = np.tile(dents_du, (2, 1))
    samples[:, at.PRESSURE] = np.log(np.where(borne, ratio, 1.0) * modulus)
    return samples[borne], np.tile(dents, 2)[borne]


def _by_pressure(walls: Walls, mean: Array) -> Array:
    """Return states of a globe of the mean rigidity (state, unknown), by their pressure."""
    library = walls.library
    thickness, resting, size, modulus = (values[0] for values in _resting(walls, mean[None]))
    law = walls.globe.globe(walls.globe.mean * size**3).over(modulus)
    ratios = np.geomspace(resting, library.iop_ratio_ends(thickness)[1], PRESSURES)
    volumes = (law.level(ratios) - law.level(resting)) / law.rate
    tips = np.tile(library.tip_m, (PRESSURES, 1))
    held = library.displaced_m3(np.full(tips.size, thickness), np.repeat(ratios, tips.shape[1]), tips.ravel())
    reached = zip(volumes, held.reshape(tips.shape), strict=True)
    states = np.repeat(mean[None], PRESSURES, axis=0)
    states[:, at.PRESSURE] = np.log(ratios * modulus)
    states[:, at.TIP] = size * np.array([np.interp(volume, row, library.tip_m) for volume, row in reached])
    return states[volumes <= held.reshape(tips.shape)[:, -1]]


def _resting(walls: Walls, unknown_su: Array) -> tuple[Array, Array, Array, Array]:
    """Return thickness and pressure over E without the needle, in the library's size; that size, and E (sample,)."""
    library, size, modulus = walls.library, np.exp(unknown_su[:, at.SIZE]), np.exp(unknown_su[:, at.MODULUS])
    thickness = np.clip(unknown_su[:, at.THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    resting = np.clip(np.exp(unknown_su[:, at.IOP]) / modulus, *library.iop_ratio_ends(thickness))
    return thickness, resting, size, modulus


PLACES_M = np.arange(1.5e-3, 6.0e-3, 0.25e-3)
LEAST_COLUMNS = 5  # beyond a limbus
SIDES = (-1.0, 1.0)
POSE = [at.DEPTH, at.ROTATION]
CURVATURE = 2  # of a side's form
MIDDLE_M = 1.5e-3  # to either side of the frame's: there lies the contact of a frame that can be read


def limbus_starts(columns: Columns, unknown: Array, placed: Placed, sides: Sequence[float] = SIDES) -> list[Array]:
    """Return unknowns with a limbus on each of some sides, where enough of the surface is seen there.

    The limbus's place is searched; the angle and the curvature beyond, and the depth and the turn of the wall with
    them, follow by linear least squares on the outer boundary. `unknown` and `placed` are a fit without that limbus and
    its prediction; side -1 is the left one, 1 the right one.
    """
    outer = columns.places.outer
    rest_m, pose = (columns.depth_m - placed.depth_m)[:outer], placed.jacobian[:outer, POSE]
    found = []
    for sign in sides:
        along_m = sign * (columns.places.lateral_m[:outer] - unknown[at.LATERAL])
        tried = [_limbus(place_m, along_m, rest_m, pose) for place_m in PLACES_M]
        off_m, moved, limbus = min(tried, key=lambda one: one[0])
        if np.isfinite(off_m):
            start, first = unknown.copy(), at.FORM.start + (0 if sign < 0.0 else 3)
            start[POSE] += moved
            start[first : first + 3] = limbus
            found.append(start)
    return found


def one_sided_starts(walls: Walls, columns: Columns, mean: Array, count: int) -> list[Array]:
    """Return unknowns with a limbus on one side, of walls that are laid on the middle and the other side alone.

    A needle that hardly dents the wall 2 mm beside a limbus shows less than the furrow there, which a search over the
    whole surface takes for the dent. `count` dents are tried on each side.
    """
    lateral_m, depth_m = columns.places.lateral_m[: columns.places.outer], columns.depth_m[: columns.places.outer]
    found = list[Array]()
    for sign in SIDES:
        near = sign * lateral_m <= MIDDLE_M
        if np.count_nonzero(near) < LEAST_COLUMNS:
            continue
        for start in starts(walls, mean, lateral_m[near], depth_m[near], count, MIDDLE_M):
            found += limbus_starts(columns, start, predict_wall(walls, start, columns.places), (sign,))
    return found


def _limbus(place_m: float, along_m: Array, rest_m: Array, pose: Array) -> tuple[float, Array, Array]:
    """Return the mean misfit of the surface with the best limbus at a place, the change of the pose, and that limbus.

    `along_m`: places of the surface towards it, from the contact; `rest_m`: depths below the wall without it; `pose`
    (place, 2): derivatives of the wall's depth by the pose.
    """
    beyond_m = np.maximum(along_m - place_m, 0.0)
    if np.count_nonzero(beyond_m) < LEAST_COLUMNS:
        return np.inf, np.zeros(2), np.zeros(3)
    basis = np.column_stack([pose, beyond_m, 0.5 * beyond_m**2])
    solution = np.linalg.lstsq(basis, rest_m, rcond=None)[0]
    curvature = np.clip(solution[-1], *at.FORM_ENDS[:, CURVATURE])
    if curvature != solution[-1]:
        bent_m = rest_m - curvature * basis[:, -1]
        solution[:-1], solution[-1] = np.linalg.lstsq(basis[:, :-1], bent_m, rcond=None)[0], curvature
    off_m = float(np.abs(rest_m - basis @ solution).mean())
    return off_m, solution[: len(POSE)], np.array([place_m, *solution[len(POSE) :]])
