"""A single wall of the library in the columns of a frame, with its derivatives: no
command needs it, but tests do.
"""

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.fit import unknowns
from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame
from scleraforce.fit.one_frame import law_of
from scleraforce.fit.shown_wall import WallDepths, predict_depths
from scleraforce.library.wall_responses import Library
from scleraforce.records.globe import OPEN, Globe

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Walls:
    """The candidate walls of a fit: a library and the known globe.

    `gap_m` and `thickness_m` are approximate values of the walls.
    """

    library: Library
    globe: Globe = OPEN
    _: KW_ONLY
    gap_m: float = 0.6e-3
    thickness_m: float = 0.6e-3


def force_n(walls: Walls, unknown_su: Array) -> Array:
    """Return the needle's force for each set of unknowns (sample, unknown), (sample,)
    in N.
    """
    return np.array(
        [_predicted(walls, unknown, np.zeros(1), 1, 0.0)[2] for unknown in unknown_su]
    )


def formed_wall(walls: Walls, unknown: Array) -> Array:
    """Return the two boundaries of a wall in the frame (boundary, point, 2): lateral
    from its middle, depth, m.
    """
    return _predicted(walls, unknown, np.zeros(1), 1, 0.0)[1]


def predict_wall(walls: Walls, unknown: Array, places: PlacesOnFrame) -> PlacedCurves:
    """Predict the depths and slopes at places for unknowns in the order of `NAMES`,
    with their derivatives.
    """
    shown = _predicted(
        walls, unknown, places.lateral_m, places.outer, float(places.smoothing_m)
    )[0]
    return PlacedCurves(shown.depth_m, shown.slope, shown.jacobian, shown.seen)


def _predicted(
    walls: Walls, unknown: Array, *places: Any
) -> tuple[WallDepths, Array, float]:
    count = len(places[0])
    section = np.empty((2, 2 * len(walls.library.node_angles()), 2))
    lines = [np.empty(count) for _ in range(4)]
    jacobian = np.empty((count, len(unknowns.NAMES)))
    shown = WallDepths(
        lines[0],
        lines[1],
        lines[2],
        lines[3],
        np.empty(count, dtype=np.bool_),
        jacobian,
    )
    tables = walls.library.tables
    law = law_of(walls.globe)
    borne_n = predict_depths(
        tables, law, places, walls.gap_m, walls.thickness_m, unknown, shown, section
    )

    return shown, section, borne_n
