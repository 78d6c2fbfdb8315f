"""What can be seen of a wall: a step of light at its surface or at its end, over gaps that are narrow."""

import numpy as np

from scleraforce.laboratory.scenes.scene import judged_columns, seen_columns

ROWS, COLUMNS = 200, 160
SURFACE = np.full(COLUMNS, 60.0)
INNER = np.full(COLUMNS, 110.0)


def frame(level: float, first: int = 60, last: int = 110, noise: float = 20.0) -> np.ndarray:
    """Noise, and a band that is brighter."""
    rng = np.random.default_rng(0)
    counts = rng.exponential(noise, (ROWS, COLUMNS))
    counts[first:last] += level
    return np.clip(counts, 0, 65535).astype(np.uint16)


def test_a_step_is_seen_from_half_a_standard_deviation_of_the_noise_on() -> None:
    assert seen_columns(frame(20.0), SURFACE, INNER).mean() > 0.9
    assert seen_columns(frame(2.0), SURFACE, INNER).mean() < 0.2


def test_one_of_both_boundaries_is_enough() -> None:
    assert seen_columns(frame(40.0, last=ROWS), SURFACE, INNER).all()
    assert seen_columns(frame(40.0, first=0), SURFACE, INNER).all()
    assert seen_columns(frame(40.0, first=0, last=ROWS), SURFACE, INNER).mean() < 0.03


def test_darker_tissue_below_something_bright_is_not_seen() -> None:
    assert not seen_columns(frame(300.0, first=20, last=60), SURFACE, np.full(COLUMNS, 190.0)).any()


def test_narrow_shadows_are_bridged_and_wide_ones_are_not_judged() -> None:
    counts = frame(60.0)
    counts[60:110, 40:55] -= 60
    counts[60:110, 100:140] -= 60
    seen, judged = judged_columns(counts, SURFACE, SURFACE, INNER)
    assert seen[:95].all()
    assert not seen[105:135].any()
    assert np.array_equal(seen, judged)


def test_where_no_wall_is_a_column_is_judged() -> None:
    outer = np.where(np.arange(COLUMNS) < 50, np.nan, SURFACE)
    seen, judged = judged_columns(frame(60.0), outer, outer, INNER)
    assert not seen[:50].any()
    assert judged[:50].all()
    assert seen[60:].all()


def test_a_frame_that_shows_a_twentieth_of_its_wall_shows_none() -> None:
    counts = frame(0.0)
    counts[60:110, 80:88] += 60
    seen, judged = judged_columns(counts, SURFACE, SURFACE, INNER)
    assert not seen.any()
    assert judged.all()


def test_a_boundary_beyond_the_frame_is_not_seen() -> None:
    assert not seen_columns(frame(60.0, first=0), np.full(COLUMNS, -20.0), np.full(COLUMNS, 300.0)).any()
