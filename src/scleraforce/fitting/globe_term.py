"""What is known of a globe's rigidity, as a residual of a fit.

In a sealed globe level(P) - level(P0) = k dV (`mechanics.globe`), with P the pressure under the needle. Of a normal k this
says that level(P) is normal about level(P0) + mean(k) dV with the standard deviation sd(k) dV. So the pressure is
fitted, which a frame shows, and not the rigidity, which it shows only where the dent is deep.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scleraforce.known import KnownGlobe
from scleraforce.library.fit_loops import Law, off_the_laws
from scleraforce.library.prediction import Walls, displaced_m3
from scleraforce.library.unknowns import IOP, MODULUS, NAMES, PRESSURE, SIZE, THICKNESS, TIP
from scleraforce.mechanics.globe import Globe
from scleraforce.study.eye import RIGIDITY_LAWS

Array = NDArray[np.float64]

MOVING = (TIP, THICKNESS, MODULUS, IOP, SIZE, PRESSURE)
STEPS = np.where(np.isin(MOVING, [TIP, THICKNESS]), 1e-7, 1e-4)  # m, or of a logarithm
LEAST_SD = 3e-3  # relative, of the pressure that the law gives: volumes of the library


def off_the_law(walls: Walls, unknown_su: Array) -> Array:
    """Return how far unknowns (sample, unknown) are off the law, in standard deviations; 0 where the globe is open."""
    if not walls.globe.can_be_sealed:
        return np.zeros(len(unknown_su))
    off, sd = _off(walls, unknown_su)
    return np.asarray(off / sd)


def law_slope(walls: Walls, unknown: Array) -> Array:
    """Return how `off_the_law` turns with each unknown (unknown,)."""
    slope = np.zeros(len(NAMES))
    if walls.globe.can_be_sealed:
        moving = list(MOVING)
        varied = np.repeat(unknown[None], len(moving) + 1, axis=0)
        varied[1:, moving] += np.diag(STEPS)
        off, sd = _off(walls, varied)
        slope[moving] = (off[1:] - off[0]) / (STEPS * sd[0])
    return slope


def keep_within(walls: Walls, unknown_su: Array) -> Array:
    """Return unknowns (sample, unknown) whose pressure is that of a rigidity within the globe's bounds."""
    known = walls.globe
    if not known.can_be_sealed:
        return unknown_su
    volume = displaced_m3(walls, unknown_su)
    resting_pa = np.exp(unknown_su[:, IOP])
    ends = [np.log(known.globe(k).pressure(resting_pa, volume)) for k in (known.lowest, known.highest)]
    kept = unknown_su.copy()
    kept[:, PRESSURE] = np.clip(kept[:, PRESSURE], *ends)
    return kept


@lru_cache(maxsize=8)
def _laws(known: KnownGlobe) -> tuple[Globe, Globe]:
    """Return the globes of the mean rigidity and of its standard deviation."""
    return known.globe(known.mean), known.globe(known.sd)


def _off(walls: Walls, unknown_su: Array) -> tuple[Array, Array]:
    """Return how far level(P) is off its mean and its standard deviation, (sample,) each."""
    mean, spread = _laws(walls.globe)
    off, sd = np.empty(len(unknown_su)), np.empty(len(unknown_su))
    law = Law(mean.law == RIGIDITY_LAWS[1], float(mean.rate), float(spread.rate), LEAST_SD)
    off_the_laws(walls.library.tables, law, unknown_su, off, sd)
    return off, sd
