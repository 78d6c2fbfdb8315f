"""Sealed globes: the state of the library whose pressure solves the globe's law at a dent (NumPy only).

A sealed globe at a dent is the open one at the pressure P with level(P) = level(P0) + rate dV, and dV the volume that
the library knows of each state (`eye.globe`, docs/library.md). Of several solutions the lowest counts: loading meets it
first. All pressures stand over E, all arguments are arrays (sample,) that broadcast.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.eye.globe import Globe
from scleraforce.library.crossing import first_crossing
from scleraforce.library.responses import Library

Floats = NDArray[np.float64]


def iop_ratio_at_dent(library: Library, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats, globe: Globe) -> Floats:
    """Return the pressure over E at dents (sample,); NaN where no pressure of the library solves the law.

    It then runs away (`mechanics.sealed_dent`), or rises beyond the library. Dents count from the undented wall at that
    pressure, as they do in all states of the library.

    Args:
        library: of responses.
        thickness_m: wall thickness, m.
        iop_ratio: pressure without the needle over E.
        tip_m: dent, m.
        globe: how the pressure follows the displaced volume, over E; its rate is a number or (sample,).

    Raises:
        InputError: a sample without the needle lies outside the library, or its dent does.
    """
    library.check_walls(thickness_m, iop_ratio)
    thickness_m, iop_ratio, tip_m, rate = np.broadcast_arrays(thickness_m, iop_ratio, tip_m, globe.rate)
    volumes, slopes = library.displaced_along_pressure(thickness_m, tip_m)
    ratios = library.tension * (thickness_m / library.radius_m)[:, None]
    missing = globe.level(ratios) - rate[:, None] * volumes
    rise = globe.level_slope(ratios) * ratios - rate[:, None] * slopes
    log_tension = first_crossing(np.log(library.tension), missing, rise, globe.level(iop_ratio))
    return np.where(rate != 0.0, np.exp(log_tension) * thickness_m / library.radius_m, iop_ratio)
