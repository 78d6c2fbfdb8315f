"""A library's spline weights and axes as plain arrays, as compiled loops read them (`library.compiled_states`)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.splines import Pieces

Floats = NDArray[np.float64]


class SplineTables(NamedTuple):
    """Spline weights and axes of a library.

    `curves` (t p d, b n c), `undented` (t p, b n c), `forces` and `volumes` (t p d,) are the weights; the splines run
    over log thickness, log tension and tip, which have `tensions` and `tips` nodes and lie between `thickness_ends_m`
    and `tension_ends`. `paths` (t p, 2 d) are the weights of force and slope at the tips `tip_m` (d,). `angles` (node,)
    are those of the walls without the needle.
    """

    thickness: Pieces
    tension: Pieces
    tip: Pieces
    tensions: int
    tips: int
    curves: NDArray[np.float32]
    undented: Floats
    forces: Floats
    volumes: Floats
    paths: Floats
    tip_m: Floats
    thickness_ends_m: tuple[float, float]
    tension_ends: tuple[float, float]
    angles: Floats
    radius_m: float
    poisson_ratio: float
