"""A library and its walls of every stiffening: one from the other (NumPy only)."""

from typing import Any

import numpy as np

from scleraforce.library.responses import Library
from scleraforce.library.stiffened import StiffenedWalls, WholeCurves


def library_of(walls: StiffenedWalls, **others: Any) -> Library:
    """Return the library of walls, of the first stiffening that they have; `others`: its other arguments.

    Raises:
        InputError: they do not belong together.
    """
    first = float(walls.stiffening[0])
    stiffened = walls if len(walls.stiffening) > 1 else None
    return Library(**walls.at(first), stiffening=first, stiffened=stiffened, **others)


def walls_of(library: Library) -> StiffenedWalls:
    """Return what a library holds of walls of every stiffening."""
    return library.stiffened or StiffenedWalls(
        stiffening=np.array([library.stiffening]),
        force_ratio_btpd=library.force_ratio_tpd[None],
        displaced_btpd=library.displaced_tpd[None],
        undented_btpbnc=library.undented_tpbnc[None],
        curves=WholeCurves(library.curves_tpdbnc[None]),
    )
