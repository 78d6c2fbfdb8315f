"""Where a fit begins: the best of a coarse search over dents and lateral places, on the outer boundary alone.

A globe that may be sealed is followed along two paths: by dents, at the pressures of the least rigidity that it may
have, and by pressures, at the dents of the one that it is taken to have. Near the pressure that runs away a path by
dents would end, or turn back.
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
HIGHEST_RISE = 16.0  # times the pressure without the needle
FAR_M = 0.3e-3  # a column that is farther off than this does not care how much


def starts(walls: Walls, mean: Array, lateral_m: Array, depth_m: Array, count: int) -> list[Array]:
    """Return where to begin: states that lie better than their neighbours, the best first, (unknown,) each.

    Each comes with its best lateral place and depth. What lies much worse than the best is nothing to begin from.

    Args:
        walls: that may be seen.
        mean: of the prior (unknown,).
        lateral_m: places of the outer boundary that are seen (place,).
        depth_m: its depth there (place,).
        count: the most to return of a path.
    """
    some = np.unique(np.linspace(0, len(lateral_m) - 1, POINTS).astype(np.intp))
    lateral_m, depth_m = lateral_m[some], depth_m[some]
    # Dents crowd where they are shallow: forces grow quickest there.
    tips = walls.library.tip_m[-1] * np.exp(mean[SIZE]) * np.linspace(0.0, 1.0, DENTS) ** 1.5
    samples = np.repeat(mean[None], DENTS, axis=0)
    samples[:, TIP], samples[:, POLE] = tips, 0.0
    paths = [_along_dents(walls, samples)]
    if walls.globe.mean > 0.0:
        paths.append(_along_pressures(walls, samples))
    samples = np.concatenate(paths)
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
    begun, least = [], cost.min()
    for path in np.split(np.arange(len(samples)), np.cumsum([len(path) for path in paths[:-1]])):
        around = np.concatenate([[np.inf], cost[path], [np.inf]])
        better = path[(cost[path] <= around[:-2]) & (cost[path] <= around[2:]) & (cost[path] <= MUCH_WORSE * least)]
        begun += better[np.argsort(cost[better])][:count].tolist()
    found = []
    for sample in sorted(begun, key=lambda sample: cost[sample]):
        start = mean.copy()
        start[[TIP, PRESSURE]] = samples[sample, [TIP, PRESSURE]]
        start[[LATERAL, DEPTH]] = shifts[best[sample]], down[sample, best[sample]]
        found.append(start)
    return found


def _along_dents(walls: Walls, dents_su: Array) -> Array:
    """Return dents (sample, unknown) at the pressures of the least rigidity, where the law bears them."""
    globe = walls.globe
    if not globe.can_be_sealed:
        return dents_su
    thickness, resting, size, modulus = _resting(walls, dents_su)
    law = globe.globe(globe.lowest * size**3).over(modulus)
    tips = np.minimum(dents_su[:, TIP] / size, walls.library.tip_m[-1])
    ratio = iop_ratio_at_dent(walls.library, thickness, resting, tips, law)
    borne, samples = np.isfinite(ratio), dents_su.copy()
    samples[borne, PRESSURE] = np.log(ratio[borne] * modulus[borne])
    return samples[borne]


def _along_pressures(walls: Walls, dents_su: Array) -> Array:
    """Return pressures (sample, unknown) at the dents of the rigidity that the globe is taken to have."""
    library = walls.library
    thickness, resting, size, modulus = (values[0] for values in _resting(walls, dents_su))
    law = walls.globe.globe(walls.globe.mean * size**3).over(modulus)
    ratios = np.geomspace(resting, min(HIGHEST_RISE * resting, library.iop_ratio_ends(thickness)[1]), DENTS + 1)[1:]
    volumes = (law.level(ratios) - law.level(resting)) / law.rate
    tips = np.tile(library.tip_m, (DENTS, 1))
    held = library.displaced_m3(np.full(tips.size, thickness), np.repeat(ratios, tips.shape[1]), tips.ravel())
    samples = dents_su.copy()
    samples[:, PRESSURE] = np.log(ratios * modulus)
    samples[:, TIP] = size * np.array(
        [np.interp(volume, row, library.tip_m) for volume, row in zip(volumes, held.reshape(tips.shape), strict=True)]
    )
    return samples


def _resting(walls: Walls, dents_su: Array) -> tuple[Array, Array, Array, Array]:
    """Return thickness and pressure over E without the needle, in the library's size, that size and E (sample,)."""
    library, size, modulus = walls.library, np.exp(dents_su[:, SIZE]), np.exp(dents_su[:, MODULUS])
    thickness = np.clip(dents_su[:, THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    resting = np.clip(np.exp(dents_su[:, IOP]) / modulus, *library.iop_ratio_ends(thickness))
    return thickness, resting, size, modulus
