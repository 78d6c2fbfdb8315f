"""States of walls, as a library answers with them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Curves = NDArray[np.float32]


@dataclass(frozen=True)
class Responses:
    """States of walls, one for each sample.

    `curves_sbnc` (sample, boundary, node, 2), m: distance from the needle axis and depth below the undeformed contact
    of material points of the outer and the inner surface, from the axis outwards; float32, exact to 1 nm.
    `tip_m` (sample,): inward displacement of the contact relative to the wall under IOP alone.
    `force_ratio` (sample,): F/E, m^2.
    """

    curves_sbnc: Curves
    tip_m: Floats
    force_ratio: Floats
