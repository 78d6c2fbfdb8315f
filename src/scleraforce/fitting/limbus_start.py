"""Where a fit begins anew that lies badly on a frame: with a limbus where the rest of the surface shows one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.fit_prediction import Walls, predict_wall
from scleraforce.fitting.fit_start import starts
from scleraforce.fitting.least_squares import Columns
from scleraforce.fitting.placement import Placed
from scleraforce.fitting.resting_form import FORM_ENDS
from scleraforce.fitting.unknowns import DEPTH, FORM, LATERAL, ROTATION

Array = NDArray[np.float64]

PLACES_M = np.arange(1.5e-3, 6.0e-3, 0.25e-3)
LEAST_COLUMNS = 5  # beyond a limbus
SIDES = (-1.0, 1.0)
POSE = [DEPTH, ROTATION]
CURVATURE = 2  # of a side's form
MIDDLE_M = 1.5e-3  # to either side of the frame's: there lies the contact of a frame that can be read


def limbus_starts(columns: Columns, unknown: Array, placed: Placed, sides: Sequence[float] = SIDES) -> list[Array]:
    """Return unknowns with a limbus on each of some sides, where enough of the surface is seen there.

    Its place is searched; the angle and the curvature beyond, and the depth and the turn of the wall with them, follow
    by linear least squares on the outer boundary.

    Args:
        columns: of the frame.
        unknown: of a fit without that limbus (unknown,).
        placed: what it predicts.
        sides: -1 is the left one, 1 the right one.
    """
    outer = columns.places.outer
    rest_m, pose = (columns.depth_m - placed.depth_m)[:outer], placed.jacobian[:outer, POSE]
    found = []
    for sign in sides:
        along_m = sign * (columns.places.lateral_m[:outer] - unknown[LATERAL])
        tried = [_limbus(place_m, along_m, rest_m, pose) for place_m in PLACES_M]
        off_m, moved, limbus = min(tried, key=lambda one: one[0])
        if np.isfinite(off_m):
            start, first = unknown.copy(), FORM.start + (0 if sign < 0.0 else 3)
            start[POSE] += moved
            start[first : first + 3] = limbus
            found.append(start)
    return found


def one_sided_starts(walls: Walls, columns: Columns, mean: Array, count: int) -> list[Array]:
    """Return unknowns with a limbus on one side, of walls that are laid on the middle and the other side alone.

    A needle that hardly dents the wall 2 mm beside a limbus shows less than the furrow there, which a search over the
    whole surface takes for the dent.

    Args:
        walls: that may be seen.
        columns: of the frame.
        mean: of the prior (unknown,).
        count: of dents to begin from on each side.
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
    """Return how far off the surface is in the mean with the best limbus at a place, how the pose moves, that limbus.

    Args:
        place_m: of the limbus from the contact.
        along_m: places of the surface towards it, from the contact (place,).
        rest_m: how far the surface lies below the wall without it (place,).
        pose: derivatives of the wall's depth by the unknowns of `POSE` (place, 2).
    """
    beyond_m = np.maximum(along_m - place_m, 0.0)
    if np.count_nonzero(beyond_m) < LEAST_COLUMNS:
        return np.inf, np.zeros(2), np.zeros(3)
    basis = np.column_stack([pose, beyond_m, 0.5 * beyond_m**2])
    solution = np.linalg.lstsq(basis, rest_m, rcond=None)[0]
    curvature = np.clip(solution[-1], *FORM_ENDS[:, CURVATURE])
    if curvature != solution[-1]:
        bent_m = rest_m - curvature * basis[:, -1]
        solution[:-1], solution[-1] = np.linalg.lstsq(basis[:, :-1], bent_m, rcond=None)[0], curvature
    off_m = float(np.abs(rest_m - basis @ solution).mean())
    return off_m, solution[: len(POSE)], np.array([place_m, *solution[len(POSE) :]])
