"""One wall of two: the finer one, and the other in stretches where the light falls more at its inner boundary."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from scleraforce.segmentation.checked_wall import joined_walls
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.needle import SeenNeedle

ROWS, COLUMNS = 200, 120
STEP = np.full(COLUMNS, 4.0)  # rows
OUTER = np.full(COLUMNS, 49.5)
STRETCH = slice(40, 60)


def wall(inner_row: np.ndarray, outer_row: np.ndarray = OUTER) -> Segmentation:
    return Segmentation(outer_row, inner_row, ROWS, True, "", True, thickness_m=0.6e-3)


def bright_to(inner_row: np.ndarray, noise: float = 150.0) -> np.ndarray:
    """A frame of noise whose tissue ends at a boundary, column by column."""
    row = np.arange(ROWS)[:, None]
    tissue = (row > 49.5) & (row < inner_row)
    return np.clip(np.random.default_rng(0).normal(500.0 + 400.0 * tissue, noise), 0.0, None).astype(np.uint16)


def moved(by: float, where: slice = STRETCH) -> np.ndarray:
    inner = np.full(COLUMNS, 110.0)
    inner[where] += by
    return inner


@pytest.mark.parametrize("by", [-25.0, -6.0, 6.0, 25.0])
def test_the_boundary_where_light_falls_is_taken_whichever_wall_has_it(by: float) -> None:
    straight, swerved = wall(moved(0.0)), wall(moved(by))
    for true in (straight, swerved):
        frame = bright_to(true.inner_row)
        for finer, other in ((straight, swerved), (swerved, straight)):
            joined = joined_walls(frame, finer, other, STEP)
            np.testing.assert_array_equal(joined.inner_row, true.inner_row)
            np.testing.assert_array_equal(joined.outer_row, OUTER)


def test_a_stretch_is_decided_as_a_whole_and_each_by_itself() -> None:
    """Single columns would fall to either side in such noise."""
    other, true = moved(8.0), moved(8.0)
    other[80:100] += 8.0
    joined = joined_walls(bright_to(true, noise=600.0), wall(moved(0.0)), wall(other), STEP)
    np.testing.assert_array_equal(joined.inner_row, true)


def test_what_parts_less_than_the_other_way_can_tell_stays_the_finer_walls() -> None:
    true = moved(4.0)
    joined = joined_walls(bright_to(true), wall(moved(0.0)), wall(true), STEP)
    np.testing.assert_array_equal(joined.inner_row, moved(0.0))
    joined = joined_walls(bright_to(true), wall(moved(0.0)), wall(true), STEP - 0.5)
    np.testing.assert_array_equal(joined.inner_row, true)


def test_a_boundary_beyond_the_frame_wins_only_where_nothing_falls_at_the_other() -> None:
    beyond = moved(150.0)
    dark, lit = bright_to(moved(0.0)), bright_to(beyond, noise=0.0)
    lit[100:] += np.arange(100, dtype=np.uint16)[:, None]  # it gets brighter: row 110 is not a boundary
    for frame, expected in ((dark, moved(0.0)), (lit, beyond)):
        joined = joined_walls(frame, wall(moved(0.0)), wall(beyond), STEP)
        np.testing.assert_array_equal(joined.inner_row, expected)


@pytest.mark.parametrize(("by", "rows", "more"), [(88.0, slice(198, 200), -500), (-50.5, slice(57, 60), 600)])
def test_light_that_falls_at_the_frames_edge_or_for_a_few_rows_is_not_the_walls_end(
    by: float, rows: slice, more: int
) -> None:
    """A program may leave the last two rows black; three rows above row 60 are brighter: light falls there by more."""
    elsewhere, frame = moved(by), bright_to(moved(0.0), noise=0.0)
    frame[rows] += np.int64(more).astype(np.uint16)
    for finer, other in ((moved(0.0), elsewhere), (elsewhere, moved(0.0))):
        np.testing.assert_array_equal(joined_walls(frame, wall(finer), wall(other), STEP).inner_row, moved(0.0))


def test_where_only_the_other_way_sees_the_wall_it_is_the_others_but_behind_a_needle() -> None:
    gap = np.where((np.arange(COLUMNS) >= 10) & (np.arange(COLUMNS) < 50), nan, 0.0)
    needle = SeenNeedle(angle_rad=0.0, tip_m=(0.0, 0.0), tip=(40.0, 40.0), top=(40.0, 0.0), hidden=(30, 50))
    finer = replace(wall(moved(0.0) + gap, OUTER + gap), needle=needle)
    joined = joined_walls(bright_to(moved(0.0)), finer, wall(moved(0.0) + 1.0, OUTER - 1.0), STEP)
    np.testing.assert_array_equal(joined.outer_row[10:30], OUTER[10:30] - 1.0)
    np.testing.assert_array_equal(joined.inner_row[10:30], 111.0)
    assert np.isnan(joined.outer_row[30:50]).all()
    assert np.isnan(joined.inner_row[30:50]).all()
    np.testing.assert_array_equal(joined.outer_row[50:], OUTER[50:])
    assert joined.needle is needle


def test_where_the_other_way_sees_no_wall_the_finer_one_stays() -> None:
    there = np.where(np.arange(COLUMNS) < 90, 0.0, nan)
    joined = joined_walls(bright_to(moved(0.0)), wall(moved(0.0)), wall(moved(20.0) + there, OUTER + there), STEP)
    np.testing.assert_array_equal(joined.inner_row, moved(0.0))
    np.testing.assert_array_equal(joined.outer_row, OUTER)
