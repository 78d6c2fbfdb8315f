"""Sections of many eyes beside the pole: moved as the fit moves its own."""

import numpy as np
import pytest
from analytic_library import RADIUS_M, analytic_library, bulging

from scleraforce.library import Library
from scleraforce.library.base import pole_directions
from scleraforce.library.placement import Places, curve_depths
from scleraforce.library.prediction import Walls, place_walls
from scleraforce.library.sections import SectionMotion, section_motion
from scleraforce.library.slices import Framing, column_laterals, wall_boundaries
from scleraforce.library.unknowns import DEPTH, GAP, IOP, LATERAL, MODULUS, NAMES, POLE, ROTATION, SIZE, THICKNESS, TIP
from scleraforce.study import SliceStudy

STUDY = SliceStudy()
COLUMNS = column_laterals(STUDY)
COUNT = 30
REACH_M = 8.5e-3


def seen_by_the_fit(library: Library, unknown: np.ndarray) -> np.ndarray:
    """The depths in the columns that the fit predicts (boundary, column)."""
    walls = Walls(library, gap_m=unknown[GAP], thickness_m=unknown[THICKNESS])
    both = Places(np.concatenate([COLUMNS, COLUMNS]), np.repeat([0, 1], len(COLUMNS)))
    depth, _, _ = curve_depths(place_walls(walls, unknown[None])[0], both)
    return depth.reshape(2, -1)


def drawn(seed: int, tension: float) -> np.ndarray:
    """Unknowns of walls (sample, unknown), at one tension."""
    rng = np.random.default_rng(seed)
    unknown = np.zeros((COUNT, len(NAMES)))
    ranges = ((TIP, 0.0, 2.5e-3), (LATERAL, -1e-3, 1e-3), (DEPTH, 0.2e-3, 0.8e-3), (ROTATION, -0.08, 0.08),
              (GAP, 0.3e-3, 1e-3), (THICKNESS, 0.4e-3, 0.8e-3), (SIZE, -0.05, 0.05))  # fmt: skip
    for which, low, high in ranges:
        unknown[:, which] = rng.uniform(low, high, COUNT)
    unknown[: COUNT // 2, ROTATION] = 0.0
    unknown[:, MODULUS] = np.log(0.3e6)
    unknown[:, IOP] = np.log(tension * 0.3e6 * unknown[:, THICKNESS] / np.exp(unknown[:, SIZE]) / RADIUS_M)
    unknown[:, POLE] = pole_directions(np.radians(rng.uniform(20.0, 55.0, COUNT)), rng.uniform(-np.pi, np.pi, COUNT))
    return unknown


@pytest.mark.parametrize(("tension", "median_m", "nearly_all_m"), [(0.02, 0.5e-6, 3e-6), (0.05, 2e-6, 8e-6)])
def test_sections_agree_with_the_fit_s_prediction(tension: float, median_m: float, nearly_all_m: float) -> None:
    library, unknown = bulging(analytic_library()), drawn(3, tension)
    size = np.exp(unknown[:, SIZE])
    place = unknown[:, THICKNESS] / size, np.exp(unknown[:, IOP] - unknown[:, MODULUS])
    walls, gap_m = library.at_tip(*place, unknown[:, TIP] / size), unknown[:, GAP] / size
    framing = Framing(*(unknown[:, which] for which in (LATERAL, DEPTH)), size, unknown[:, ROTATION])
    moved = section_motion(library, walls, place, gap_m, unknown[:, POLE], REACH_M)
    upright = np.zeros(COUNT)
    mine, even = (
        wall_boundaries(walls.curves_sbnc, gap_m, upright, framing, STUDY, motion).depth_sbc for motion in (moved, None)
    )
    theirs = np.stack([seen_by_the_fit(library, one) for one in unknown])
    off = np.abs(mine - theirs)
    assert np.median(off) < median_m
    assert np.quantile(off, 0.95) < nearly_all_m
    assert np.quantile(np.abs(even - theirs), 0.95) > 10 * nearly_all_m


def test_the_motion_between_its_places_is_linear() -> None:
    lateral = np.linspace(-3e-3, 3e-3, 7)
    motion = SectionMotion(lateral, np.broadcast_to((2.0 * lateral + 1e-3)[:, None], (4, 2, 7, 3)))
    wanted = np.array([-4e-3, -2.9e-3, 0.0, 0.35e-3, 3e-3])
    expected = 2.0 * np.clip(wanted, -3e-3, 3e-3) + 1e-3  # beyond the last place as there
    np.testing.assert_allclose(motion.at(wanted)[1, 0, :, 2], expected, atol=1e-12)
    np.testing.assert_allclose(motion.across_contact, 1e-3)


@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_an_even_motion_along_the_section_and_down_shifts_it(turn_rad: float) -> None:
    library = analytic_library(thicknesses=4, ratios=4, tips=8)
    walls = library.at_tip(np.array([0.6e-3]), np.array([1e-3]), np.array([1.5e-3])).curves_sbnc
    moved = SectionMotion(np.linspace(-9e-3, 9e-3, 9), np.tile([0.1e-3, 0.0, 0.03e-3], (1, 2, 9, 1)))
    gap_m, level, turn, one = np.array([0.5e-3]), np.zeros(1), np.array([turn_rad]), np.ones(1)
    shifted = np.array([[0.1e-3, 0.03e-3]]) @ np.array(
        [[np.cos(turn_rad), np.sin(turn_rad)], [-np.sin(turn_rad), np.cos(turn_rad)]]
    )
    found = wall_boundaries(walls, gap_m, level, Framing(level, 0.4e-3 * one, one, turn), STUDY, moved)
    framing = Framing(shifted[:, 0], 0.4e-3 + shifted[:, 1], one, turn)
    expected = wall_boundaries(walls, gap_m, level, framing, STUDY)
    np.testing.assert_allclose(found.depth_sbc, expected.depth_sbc, atol=2e-6)
