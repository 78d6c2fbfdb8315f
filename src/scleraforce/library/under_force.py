"""Sealed globes under a force: the state of the library whose pressure solves the globe's law (`library.sealed`)."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import elementwise

from scleraforce.compiled import loops_are_compiled
from scleraforce.eye.globe import Globe
from scleraforce.library.responses import Library
from scleraforce.study.eye import RIGIDITY_LAWS

Floats = NDArray[np.float64]

SPARE = 1e-3  # of the volume: the pressure of an end of the bracket lies beyond the solution


def iop_ratio_under_force(
    library: Library,
    thickness_m: Floats,
    iop_ratio: Floats,
    force_ratio: Floats,
    globe: Globe,
    tolerance: float = 1e-7,
) -> Floats:
    """Return the pressure over E under forces (sample,); the library's highest where it rises beyond.

    Under a force a higher pressure leaves a shallower dent, which displaces less: one pressure solves the law.

    Args:
        library: of responses.
        thickness_m: wall thickness, m.
        iop_ratio: pressure without the needle over E.
        force_ratio: F/E, m^2; where it is more than a wall carries, the dent counts as the library's deepest.
        globe: how the pressure follows the displaced volume, over E; its rate is a number or (sample,).
        tolerance: of the logarithm of the pressure.

    Raises:
        InputError: a wall lies outside the library.
    """
    walls = np.broadcast_arrays(thickness_m, iop_ratio, force_ratio, globe.rate)
    found: Floats = walls[1].astype(np.float64)
    (sealed,) = np.nonzero((walls[3] != 0.0) & (walls[2] > 0.0))
    if not len(sealed):
        return found
    eyes = tuple(np.asarray(values[sealed], dtype=np.float64) for values in walls)
    found[sealed] = (_by_loops if loops_are_compiled() else _by_arrays)(library, eyes, globe, tolerance)
    return found


def _by_loops(library: Library, eyes: tuple[Floats, ...], globe: Globe, tolerance: float) -> Floats:
    """Return the pressures of sealed eyes, whose walls lie in the library, by compiled loops."""
    from scleraforce.library.compiled_pressures import SealedEyes, pressures_under_forces

    thickness, resting, force, rate = eyes
    library.check_walls(thickness, resting)
    found = np.empty_like(resting)
    sealed = SealedEyes(thickness, resting, force, rate, *library.iop_ratio_ends(thickness))
    pressures_under_forces(library.tables, sealed, globe.law == RIGIDITY_LAWS[1], tolerance, found)
    return found


def _by_arrays(library: Library, eyes: tuple[Floats, ...], globe: Globe, tolerance: float) -> Floats:
    """Return the pressures of sealed eyes: thickness, resting pressure, force and rate (sample,) each."""
    thickness, resting, force, rate = eyes

    def missing(log_ratio: Floats, thickness: Floats, resting: Floats, force: Floats, rate: Floats) -> Floats:
        ratio = np.exp(log_ratio)
        volumes = library.displaced_m3(thickness, ratio, library.reached_tips(thickness, ratio, force))
        return globe.level(ratio) - globe.level(resting) - rate * volumes

    lowest, highest = library.iop_ratio_ends(thickness)
    # The dent of the resting pressure hardly ever displaces less than that of a higher one.
    most = library.displaced_m3(thickness, resting, library.reached_tips(thickness, resting, force))
    bound = np.clip(Globe(globe.law, rate).pressure(resting, (1.0 + SPARE) * most), resting, highest)
    low, high = np.log(np.where(rate > 0.0, resting, lowest)), np.log(bound)
    above, below = missing(high, *eyes), -rate * most
    beyond, under = above <= 0.0, rate < 0.0
    high[beyond] = np.log(highest[beyond])
    for place, ends, values in ((beyond, high, above), (under, low, below)):
        if place.any():
            values[place] = missing(ends[place], *(part[place] for part in eyes))
    within = (above > 0.0) & (below < 0.0)
    found: Floats = np.exp(np.where(below >= 0.0, low, high))
    args = tuple(values[within] for values in eyes)
    root = elementwise.find_root(
        missing, (low[within], high[within]), args=args, tolerances={"xatol": tolerance, "fatol": 0.0}
    )
    found[within] = np.exp(root.x)
    return found
