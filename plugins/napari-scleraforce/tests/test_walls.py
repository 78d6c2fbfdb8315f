"""Walls as paths and masks."""

import numpy as np
import pytest

from napari_scleraforce.walls import LOWER, UPPER, mask_of, paths_of

COLUMN = np.arange(200.0)
OUTER = 40.0 + 12.0 * np.cos(COLUMN / 30.0)
INNER = OUTER + 25.0


def bounds(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows between which each column's wall is."""
    wall = mask == 255
    return wall.argmax(axis=0) - 0.5, len(mask) - wall[::-1].argmax(axis=0) - 0.5


def test_a_wall_survives_its_paths_within_a_row_and_they_have_few_points() -> None:
    paths = paths_of(3, OUTER, INNER)
    assert [name for name, _ in paths] == [UPPER, LOWER]
    assert all(len(points) < 30 and set(points[:, 0]) == {3} for _, points in paths)

    for found, true in zip(
        bounds(mask_of(paths, (100, 200))), (OUTER, INNER), strict=True
    ):
        assert np.abs(found - true).max() < 1.0


def test_columns_behind_a_needle_are_not_judged() -> None:
    outer = OUTER.copy()
    inner = INNER.copy()
    outer[90:110] = np.nan
    inner[80:120] = np.nan
    paths = paths_of(0, outer, inner)
    assert [name for name, _ in paths] == [UPPER, UPPER, LOWER, LOWER]
    mask = mask_of(paths, (100, 200))
    assert np.flatnonzero((mask == 128).all(axis=0)).tolist() == list(range(80, 120))
    assert not (mask[:, :80] == 128).any()


def test_a_wall_without_a_lower_boundary_ends_below_the_frame() -> None:
    mask = mask_of(paths_of(0, OUTER, None), (60, 200))
    assert (mask[-1] == 255).all()


def test_a_frame_without_paths_is_not_judged() -> None:
    assert (mask_of([], (60, 200)) == 128).all()


@pytest.mark.parametrize("backwards", [False, True])
def test_the_direction_in_which_a_path_is_drawn_makes_no_difference(
    backwards: bool,
) -> None:
    paths = [
        (name, points[::-1] if backwards else points)
        for name, points in paths_of(0, OUTER, INNER)
    ]
    np.testing.assert_array_equal(
        mask_of(paths, (100, 200)), mask_of(paths_of(0, OUTER, INNER), (100, 200))
    )
