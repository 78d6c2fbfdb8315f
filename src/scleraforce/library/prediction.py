"""The picture of a library's wall in the columns of a frame, its derivatives by the unknowns, and the globe's law.

The wall is a surface of revolution about the needle axis. The B-scan plane, parallel to that axis at a distance of one
gap, sees a point of it at the distance r from the axis at the lateral place sqrt(r² - gap²), to both sides. An eye that
is larger by a factor is the same eye at another length unit: thickness and dent count relative to it, and so do F/E, by
its square, and volumes, by its cube.

What a frame shows is the state at the pressure under the needle. In an open globe that is the IOP. In one that may be
sealed it is an unknown of its own. There level(P) - level(P0) = k dV (`mechanics.globe`), with P the pressure under the
needle. Of a normal k this says that level(P) is normal about level(P0) + mean(k) dV with the standard deviation
sd(k) dV. So the pressure is fitted, which a frame shows, and not the rigidity, which it shows only where the dent is
deep.

The pole's place, on which the base's motion depends (`library.base`), is an unknown where it is not given. The form of
an eye that is not an even sphere is added at rest (`library.unknowns`); how it bends is left out.
"""

from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.known import OPEN, KnownGlobe
from scleraforce.library import unknowns as at
from scleraforce.library.fit_loops import Depths, Law, predict
from scleraforce.library.placement import Placed, Places
from scleraforce.library.responses import Library
from scleraforce.study.eye import RIGIDITY_LAWS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Walls:
    """The candidate walls of a fit: a library and the known globe.

    `gap_m` and `thickness_m` are approximate values of the walls.
    """

    library: Library
    globe: KnownGlobe = OPEN
    _: KW_ONLY
    gap_m: float = 0.6e-3
    thickness_m: float = 0.6e-3


@lru_cache
def law_of(globe: KnownGlobe) -> Law:
    """Return the law of a globe."""
    rates = (float(globe.globe(rigidity).rate) for rigidity in (globe.lowest, globe.mean, globe.highest, globe.sd))
    sealed = globe.can_be_sealed
    return Law(at.PRESSURE if sealed else at.IOP, not sealed, globe.law == RIGIDITY_LAWS[1], *rates)


def force_n(walls: Walls, unknown_su: Array) -> Array:
    """Return the needle's force for each set of unknowns (sample, unknown), (sample,) in N."""
    return np.array([_predicted(walls, unknown, np.zeros(1), 1, 0.0)[2] for unknown in unknown_su])


def formed_wall(walls: Walls, unknown: Array) -> Array:
    """Return the two boundaries of a wall in the frame (boundary, point, 2): lateral from its middle, depth, m."""
    return _predicted(walls, unknown, np.zeros(1), 1, 0.0)[1]


def predict_wall(walls: Walls, unknown: Array, places: Places) -> Placed:
    """Predict the depths and slopes at places for unknowns in the order of `NAMES`, with their derivatives."""
    shown = _predicted(walls, unknown, places.lateral_m, places.outer, float(places.smoothing_m))[0]
    return Placed(shown.depth_m, shown.slope, shown.jacobian, shown.seen)


def _predicted(walls: Walls, unknown: Array, *places: Any) -> tuple[Depths, Array, float]:
    count, section = len(places[0]), np.empty((2, 2 * len(walls.library.node_angles()), 2))
    lines, jacobian = [np.empty(count) for _ in range(4)], np.empty((count, len(at.NAMES)))
    shown = Depths(lines[0], lines[1], lines[2], lines[3], np.empty(count, dtype=np.bool_), jacobian)
    tables, law = walls.library.tables, law_of(walls.globe)
    borne_n = predict(tables, law, places, walls.gap_m, walls.thickness_m, unknown, shown, section)
    return shown, section, borne_n


def shining(slope: Array) -> Array:
    """Return the shift of the edge by the mirror reflection, over that of a surface that faces the light."""
    return np.exp(-((slope / at.SHINING_SLOPE) ** 2))
