"""Where a fit begins: the best of a coarse search over dents and lateral places, on the outer boundary alone."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.fit_prediction import DEPTH, LATERAL, POLE, SIZE, TIP, Walls, place_walls

__all__ = ["starts"]

Array = NDArray[np.float64]

DENTS = 14
SHIFT_M = 0.3e-3
FARTHEST_M = 3e-3
POINTS = 40  # of the outer boundary
GRID_M = 50e-6
MUCH_WORSE = 3.0  # times as far off as the best
FAR_M = 0.3e-3  # a column that is farther off than this does not care how much


def starts(walls: Walls, mean: Array, lateral_m: Array, depth_m: Array, count: int) -> list[Array]:
    """Return where to begin: dents that lie better than their neighbours, the best first, (unknown,) each.

    Each comes with its best lateral place and depth. A dent that lies much worse than the best is none to begin from.

    Args:
        walls: that may be seen.
        mean: of the prior (unknown,).
        lateral_m: places of the outer boundary that are seen (place,).
        depth_m: its depth there (place,).
        count: the most to return.
    """
    some = np.unique(np.linspace(0, len(lateral_m) - 1, POINTS).astype(np.intp))
    lateral_m, depth_m = lateral_m[some], depth_m[some]
    # Dents crowd where they are shallow: forces grow quickest there.
    tips = walls.library.tip_m[-1] * np.exp(mean[SIZE]) * np.linspace(0.0, 1.0, DENTS) ** 1.5
    samples = np.repeat(mean[None], DENTS, axis=0)
    samples[:, TIP], samples[:, POLE] = tips, 0.0
    outer = place_walls(walls, samples)[:, 0]
    reach = int(np.ceil((np.abs(lateral_m).max() + FARTHEST_M) / GRID_M)) + 1
    grid = np.arange(-reach, reach + 1) * GRID_M
    depth_dg = np.stack([np.interp(grid, curve[:, 0], curve[:, 1]) for curve in outer])
    shifts = np.arange(-FARTHEST_M, FARTHEST_M + SHIFT_M / 2, SHIFT_M)
    at = np.rint((lateral_m - shifts[:, None]) / GRID_M).astype(np.intp) + reach
    rest = depth_m - depth_dg[:, at]  # (dent, shift, place)
    down = np.median(rest, axis=2)
    cost = np.minimum(np.abs(rest - down[..., None]), FAR_M).mean(axis=2)
    best, least = cost.argmin(axis=1), cost.min(axis=1)
    around = np.concatenate([[np.inf], least, [np.inf]])
    better = np.flatnonzero((least <= around[:-2]) & (least <= around[2:]) & (least <= MUCH_WORSE * least.min()))
    begun = []
    for dent in better[np.argsort(least[better])][:count]:
        start = mean.copy()
        start[[TIP, LATERAL, DEPTH]] = tips[dent], shifts[best[dent]], down[dent, best[dent]]
        begun.append(start)
    return begun
