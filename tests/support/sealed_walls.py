"""The pressure of sealed walls of a library at dents."""

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.library import Library, sealed
from scleraforce.library.responses import check_inside, inside_ends
from scleraforce.mechanics.globe import Globe
from scleraforce.study.eye import RIGIDITY_LAWS


def iop_ratio_at_dent(library: Library, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats, globe: Globe) -> Floats:
    """Return the pressure over E at dents (sample,); NaN where no pressure of the library solves the law.

    It then runs away (`mechanics.equilibrium.SealedDent`), or rises beyond the library. Dents count from the undented
    wall at that pressure. `iop_ratio` is the pressure without the needle over E; the globe is over E, and its rate a
    number or (sample,). Walls without the needle, and dents, outside the library raise `InputError`.
    """
    library.check_walls(thickness_m, iop_ratio)
    check_inside("tip", tip_m, 0.0, float(library.tip_m[-1]), "mm")
    inside = inside_ends(thickness_m, library.thickness_m), inside_ends(tip_m, library.tip_m)
    eyes = np.broadcast_arrays(*inside, globe.rate, iop_ratio)
    thickness, tip, rate, ratio = (np.array(part, dtype=np.float64) for part in eyes)
    is_logarithmic = globe.law == RIGIDITY_LAWS[1]
    sealed.pressures_at_dents(library.tables, sealed.volume_paths(library), thickness, tip, rate, is_logarithmic, ratio)
    return ratio
