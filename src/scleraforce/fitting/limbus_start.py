"""Where a fit begins anew that leaves much of a frame aside: with a limbus where the rest of the surface shows one."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.least_squares import Columns
from scleraforce.fitting.placement import Placed
from scleraforce.fitting.unknowns import FORM, LATERAL

__all__ = ["limbus_starts"]

Array = NDArray[np.float64]

PLACES_M = np.arange(1.5e-3, 6.0e-3, 0.25e-3)
LEAST_COLUMNS = 5  # beyond a limbus


def limbus_starts(columns: Columns, unknown: Array, placed: Placed) -> list[Array]:
    """Return unknowns with a limbus to the left, and with one to the right, where enough of the surface is seen there.

    Its place is searched; the angle and the curvature beyond follow by linear least squares on the outer boundary.

    Args:
        columns: of the frame.
        unknown: of a fit without that limbus (unknown,).
        placed: what it predicts.
    """
    outer = columns.places.outer
    rest_m = (columns.depth_m - placed.depth_m)[:outer]
    found = []
    for sign, first in ((-1.0, FORM.start), (1.0, FORM.start + 3)):
        along_m = sign * (columns.places.lateral_m[:outer] - unknown[LATERAL])
        side = along_m > 0.0
        tried = [_limbus(place_m, along_m[side], rest_m[side]) for place_m in PLACES_M]
        off_m, limbus = min(tried, key=lambda one: one[0], default=(np.inf, None))
        if limbus is not None and np.isfinite(off_m):
            start = unknown.copy()
            start[first : first + 3] = limbus
            found.append(start)
    return found


def _limbus(place_m: float, along_m: Array, rest_m: Array) -> tuple[float, Array]:
    """Return how far off one side's surface is in the mean with the best limbus at a place, and that limbus (3,)."""
    beyond_m = np.maximum(along_m - place_m, 0.0)
    if np.count_nonzero(beyond_m) < LEAST_COLUMNS:
        return np.inf, np.zeros(3)
    basis = np.stack([np.ones_like(beyond_m), beyond_m, 0.5 * beyond_m**2], axis=1)
    (_, angle, curvature), *_ = np.linalg.lstsq(basis, rest_m, rcond=None)
    off_m = float(np.abs(rest_m - angle * beyond_m - 0.5 * curvature * beyond_m**2).mean())
    return off_m, np.array([place_m, angle, curvature])
