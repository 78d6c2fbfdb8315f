"""Sections of many eyes beside the pole: moved as the fit moves its own."""

import numpy as np
import pytest
from analytic_library import RADIUS_M, analytic_library, bulging

from predicted_walls import Walls, formed_wall
from scleraforce.fit.curve_placement import PlacesOnFrame, curve_depths
from scleraforce.fit.unknowns import (
    DEPTH,
    GAP,
    IOP,
    LATERAL,
    MODULUS,
    NAMES,
    ROTATION,
    SIZE,
    THICKNESS,
    TIP,
)
from scleraforce.library import Library
from scleraforce.library.moving_base import pole_directions
from scleraforce.library.plane_cut import (
    Framing,
    column_laterals,
    section_motion,
    wall_boundaries,
)
from scleraforce.records.study import SliceStudy

STUDY = SliceStudy()
COLUMNS = column_laterals(STUDY)
COUNT = 30
POLE = [NAMES.index(name) for name in ("pole_along", "pole_across")]
REACH_M = 8.5e-3


def seen_by_the_fit(library: Library, unknown: np.ndarray) -> np.ndarray:
    """The depths in the columns that the fit predicts (boundary, column)."""
    walls = Walls(library, gap_m=unknown[GAP], thickness_m=unknown[THICKNESS])
    both = PlacesOnFrame(
        np.concatenate([COLUMNS, COLUMNS]), np.repeat([0, 1], len(COLUMNS))
    )
    depth, _, _ = curve_depths(formed_wall(walls, unknown), both)
    return depth.reshape(2, -1)


def drawn(seed: int, tension: float) -> np.ndarray:
    """Unknowns of walls (sample, unknown), at one tension."""
    rng = np.random.default_rng(seed)
    unknown = np.zeros((COUNT, len(NAMES)))
    ranges = (
        (TIP, 0.0, 2.5e-3),
        (LATERAL, -1e-3, 1e-3),
        (DEPTH, 0.2e-3, 0.8e-3),
        (ROTATION, -0.08, 0.08),
        (GAP, 0.3e-3, 1e-3),
        (THICKNESS, 0.4e-3, 0.8e-3),
        (SIZE, -0.05, 0.05),
    )

    for which, low, high in ranges:
        unknown[:, which] = rng.uniform(low, high, COUNT)

    unknown[: COUNT // 2, ROTATION] = 0.0
    unknown[:, MODULUS] = np.log(0.3e6)
    unknown[:, IOP] = np.log(
        tension * 0.3e6 * unknown[:, THICKNESS] / np.exp(unknown[:, SIZE]) / RADIUS_M
    )
    unknown[:, POLE] = pole_directions(
        np.radians(rng.uniform(20.0, 55.0, COUNT)), rng.uniform(-np.pi, np.pi, COUNT)
    )

    return unknown


@pytest.mark.parametrize(
    ("tension", "median_m", "nearly_all_m"), [(0.02, 0.5e-6, 3e-6), (0.05, 2e-6, 8e-6)]
)
def test_sections_agree_with_the_fit_s_prediction(
    tension: float, median_m: float, nearly_all_m: float
):
    library = bulging(analytic_library())
    unknown = drawn(3, tension)
    size = np.exp(unknown[:, SIZE])
    place = unknown[:, THICKNESS] / size, np.exp(unknown[:, IOP] - unknown[:, MODULUS])
    walls = library.at_tip(*place, unknown[:, TIP] / size)
    gap_m = unknown[:, GAP] / size
    framing = Framing(
        *(unknown[:, which] for which in (LATERAL, DEPTH)), size, unknown[:, ROTATION]
    )
    moved = section_motion(library, walls, place, gap_m, unknown[:, POLE], REACH_M)
    upright = np.zeros(COUNT)
    mine, even = (
        wall_boundaries(
            walls.curves_sbnc, gap_m, upright, framing, STUDY, motion
        ).depth_sbc
        for motion in (moved, None)
    )
    theirs = np.stack([seen_by_the_fit(library, one) for one in unknown])
    off = np.abs(mine - theirs)
    assert np.median(off) < median_m
    assert np.quantile(off, 0.95) < nearly_all_m
    assert np.quantile(np.abs(even - theirs), 0.95) > 10 * nearly_all_m
