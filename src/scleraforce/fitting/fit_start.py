"""Where a fit begins: the best of a coarse search over dents and lateral places, on the outer boundary alone.

In a globe that may be sealed each dent is tried at two pressures: those of the least rigidity that it may have and of
the one that it is taken to have. A dent at which that pressure runs away is none to begin from.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.fit_prediction import (
    DEPTH,
    IOP,
    LATERAL,
    MODULUS,
    POLE,
    PRESSURE,
    SIZE,
    THICKNESS,
    TIP,
    Walls,
    place_walls,
)
from scleraforce.library.sealed import iop_ratio_at_dent

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
    samples, dent_s = _at_pressures(walls, samples)
    outer = place_walls(walls, samples)[:, 0]
    reach = int(np.ceil((np.abs(lateral_m).max() + FARTHEST_M) / GRID_M)) + 1
    grid = np.arange(-reach, reach + 1) * GRID_M
    depth_sg = np.stack([np.interp(grid, curve[:, 0], curve[:, 1]) for curve in outer])
    shifts = np.arange(-FARTHEST_M, FARTHEST_M + SHIFT_M / 2, SHIFT_M)
    at = np.rint((lateral_m - shifts[:, None]) / GRID_M).astype(np.intp) + reach
    rest = depth_m - depth_sg[:, at]  # (sample, shift, place)
    down = np.median(rest, axis=2)
    cost = np.minimum(np.abs(rest - down[..., None]), FAR_M).mean(axis=2)
    best, cost = cost.argmin(axis=1), cost.min(axis=1)
    least = np.full(DENTS, np.inf)
    np.minimum.at(least, dent_s, cost)
    around = np.concatenate([[np.inf], least, [np.inf]])
    better = np.flatnonzero((least <= around[:-2]) & (least <= around[2:]) & (least <= MUCH_WORSE * least.min()))
    begun = []
    for dent in better[np.argsort(least[better])][:count]:
        sample = int(np.argmin(np.where(dent_s == dent, cost, np.inf)))
        start = mean.copy()
        start[[TIP, PRESSURE]] = samples[sample, [TIP, PRESSURE]]
        start[[LATERAL, DEPTH]] = shifts[best[sample]], down[sample, best[sample]]
        begun.append(start)
    return begun


def _at_pressures(walls: Walls, dents_du: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return dents (sample, unknown) at the pressures that they may be under, and which dent each is (sample,)."""
    globe, dents = walls.globe, np.arange(len(dents_du))
    if not globe.can_be_sealed:
        return dents_du, dents
    library, size, modulus = walls.library, np.exp(dents_du[:, SIZE]), np.exp(dents_du[:, MODULUS])
    thickness = np.clip(dents_du[:, THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    resting = np.clip(np.exp(dents_du[:, IOP]) / modulus, *library.iop_ratio_ends(thickness))
    rigidity = np.repeat([globe.lowest, globe.mean], len(dents))
    tips = np.minimum(dents_du[:, TIP] / size, library.tip_m[-1])
    thickness, resting, tips, size, modulus = (np.tile(part, 2) for part in (thickness, resting, tips, size, modulus))
    ratio = iop_ratio_at_dent(library, thickness, resting, tips, globe.globe(rigidity * size**3).over(modulus))
    borne = np.isfinite(ratio)
    samples = np.tile(dents_du, (2, 1))
    samples[:, PRESSURE] = np.log(np.where(borne, ratio, 1.0) * modulus)
    return samples[borne], np.tile(dents, 2)[borne]
