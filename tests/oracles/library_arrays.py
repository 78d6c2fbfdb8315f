"""A library's states by arrays: tensor products of splines, and pressures of sealed
globes by root finding.
"""

from math import exp, log

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from scleraforce.base.arrays import Floats
from scleraforce.library.response_splines import first_crossing
from scleraforce.library.wall_responses import Library
from scleraforce.records.globe import PressureLaw

EXACT = 1e-12  # of a logarithm


def values_at(library: Library, values: NDArray[np.floating], *state: Floats) -> Floats:
    """Values (sample, ...) of a table of spline weights (t p d, ...) at thickness,
    pressure over E and tip.
    """
    tables = library.tables
    thickness_m, iop_ratio, tip_m = state
    t, of_t = tables.thickness.weights(np.log(thickness_m))
    p, of_p = tables.tension.weights(np.log(iop_ratio * tables.radius_m / thickness_m))
    d, of_d = tables.tip.weights(tip_m)
    table = values.reshape(-1, tables.tensions, tables.tips, *values.shape[1:])
    near = np.arange(4)
    some = table[
        t[:, None, None, None] + near[:, None, None],
        p[:, None, None, None] + near[:, None],
        d[:, None, None, None] + near,
    ]
    found: Floats = np.einsum(
        "sijk...,si,sj,sk->s...", some.astype(np.float64), of_t, of_p, of_d
    )

    return found


def undented_walls(library: Library, thickness_m: Floats, iop_ratio: Floats) -> Floats:
    """Walls without the needle (sample, boundary, node, 2), m."""
    tables = library.tables
    t, of_t = tables.thickness.weights(np.log(thickness_m))
    p, of_p = tables.tension.weights(np.log(iop_ratio * tables.radius_m / thickness_m))
    table = tables.undented.reshape(-1, tables.tensions, 2, len(tables.angles), 2)
    near = np.arange(4)
    some = table[t[:, None, None] + near[:, None], p[:, None, None] + near]
    found: Floats = np.einsum("sij...,si,sj->s...", some, of_t, of_p)

    return found


def reached_tips(
    library: Library, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats
) -> Floats:
    """Tips (sample,) at which loading first reaches forces; the library's deepest where
    it never does.
    """
    tips = first_crossing(
        library.tip_m, library._paths(thickness_m, iop_ratio), np.asarray(force_ratio)
    )
    return np.where(np.isnan(tips), library.tip_m[-1], tips)


def iop_ratio_under_force(
    library: Library,
    thickness_m: Floats,
    iop_ratio: Floats,
    force_ratio: Floats,
    globe: PressureLaw,
) -> Floats:
    """Pressure over E of sealed globes under forces (sample,), one after the other."""
    eyes = zip(
        *np.broadcast_arrays(thickness_m, iop_ratio, force_ratio, globe.rate),
        strict=True,
    )
    return np.array([_pressure(library, globe, *eye) for eye in eyes])


def _pressure(
    library: Library,
    globe: PressureLaw,
    thickness: float,
    resting: float,
    force: float,
    rate: float,
) -> float:
    if rate == 0.0 or force == 0.0:
        return resting

    wall = np.array([thickness])
    lowest, highest = (float(end[0]) for end in library.iop_ratio_ends(wall))

    def missing(log_ratio: float) -> float:
        ratio = np.array([min(max(exp(log_ratio), lowest), highest)])
        volume = library.displaced_m3(
            wall, ratio, reached_tips(library, wall, ratio, np.array([force]))
        )

        return float(
            globe.level(ratio)[0]
            - globe.level(np.array([resting]))[0]
            - rate * volume[0]
        )

    low, high = (resting, highest) if rate > 0.0 else (lowest, resting)
    if missing(log(high)) <= 0.0:
        return high

    return (
        low
        if missing(log(low)) >= 0.0
        else exp(brentq(missing, log(low), log(high), xtol=EXACT))
    )
