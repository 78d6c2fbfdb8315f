"""What is known of a globe's rigidity, as a residual of a fit.

In a sealed globe level(P) - level(P0) = k dV (`eye.globe`), with P the pressure under the needle. Of a normal k this
says that level(P) is normal about level(P0) + mean(k) dV with the standard deviation sd(k) dV. So the pressure is
fitted, which a frame shows, and not the rigidity, which it shows only where the dent is deep.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.fit_prediction import IOP, MODULUS, NAMES, PRESSURE, SIZE, THICKNESS, TIP, Walls, displaced_m3

__all__ = ["GlobeTerm", "globe_term", "keep_within"]

Array = NDArray[np.float64]

MOVING = (TIP, THICKNESS, MODULUS, IOP, SIZE, PRESSURE)
STEP_M, LOG_STEP = 1e-7, 1e-4
LEAST_SD = 3e-3  # relative, of the pressure that the law gives: volumes of the library


@dataclass(frozen=True, eq=False)
class GlobeTerm:
    """How far unknowns are off the law, in standard deviations, and how that turns with each of them (unknown,)."""

    residual: float
    slope: Array


def globe_term(walls: Walls, unknown: Array) -> GlobeTerm:
    """Return the residual of unknowns (unknown,); 0 where the globe is open."""
    slope = np.zeros(len(NAMES))
    if not walls.globe.can_be_sealed:
        return GlobeTerm(0.0, slope)
    moving = list(MOVING)
    steps = np.where(np.isin(moving, [TIP, THICKNESS]), STEP_M, LOG_STEP)
    varied = np.repeat(unknown[None], len(moving) + 1, axis=0)
    varied[1:, moving] += np.diag(steps)
    off, sd = _off(walls, varied)
    slope[moving] = (off[1:] - off[0]) / (steps * sd[0])
    return GlobeTerm(float(off[0] / sd[0]), slope)


def keep_within(walls: Walls, unknown_su: Array) -> Array:
    """Return unknowns (sample, unknown) whose pressure is that of a rigidity within the globe's bounds."""
    known, volume = walls.globe, displaced_m3(walls, unknown_su)
    if not known.can_be_sealed:
        return unknown_su
    resting_pa = np.exp(unknown_su[:, IOP])
    ends = [np.log(known.globe(k).pressure(resting_pa, volume)) for k in (known.lowest, known.highest)]
    kept = unknown_su.copy()
    kept[:, PRESSURE] = np.clip(kept[:, PRESSURE], *ends)
    return kept


def _off(walls: Walls, unknown_su: Array) -> tuple[Array, Array]:
    """Return how far level(P) is off its mean and its standard deviation, (sample,) each."""
    known, volume = walls.globe, displaced_m3(walls, unknown_su)
    mean, spread = known.globe(known.mean), known.globe(known.sd)
    pressure, resting = np.exp(unknown_su[:, PRESSURE]), np.exp(unknown_su[:, IOP])
    off = mean.level(pressure) - mean.level(resting) - mean.rate * volume
    sd = np.hypot(spread.rate * volume, LEAST_SD * mean.level_slope(resting) * resting)
    return off, sd
