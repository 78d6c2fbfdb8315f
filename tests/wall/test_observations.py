"""A frame's boundaries in metres, points on them with their noise, and its wall drawn
into slices.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from plain_slices import plain_slices

from scleraforce.records.scan import PixelScale
from scleraforce.records.study import SliceStudy
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import (
    Boundaries,
    assumed_inner_row,
    boundary_slice,
    boundary_slices,
    observe_points,
    segmented_boundaries,
)

LATERAL_M = (np.arange(500) - 249.5) * 30e-6
TOPS_M = np.array([[0.5e-3], [1.2e-3]])


def bowl(noise_m: float, rng: np.random.Generator, width: int = 1) -> Boundaries:
    """Parabolas with noise that is correlated over some columns."""
    noise = rng.standard_normal((2, len(LATERAL_M) + width))
    kernel = np.ones(width) / width**0.5
    noise = np.stack([np.convolve(row, kernel, "same") for row in noise])
    depth_m = TOPS_M + 40 * LATERAL_M**2 + noise_m * noise[:, : len(LATERAL_M)]
    return Boundaries(LATERAL_M, depth_m, 1e-9)


def test_half_of_the_points_lie_on_each_boundary_at_the_same_places_every_time():
    rng = np.random.default_rng(0)
    first, second = (observe_points(bowl(5e-6, rng), 9, 0.0, 4e-3) for _ in range(2))
    assert first.boundary.tolist() == [0] * 5 + [1] * 4
    np.testing.assert_array_equal(first.lateral_m, second.lateral_m)
    assert np.abs(first.lateral_m).max() <= 4e-3


@pytest.mark.parametrize("width", [1, 4])
def test_stated_noise_is_the_error_that_points_have(width):
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(200):
        points = observe_points(bowl(10e-6, rng, width), 10, 0.0, 4e-3)
        truth_m = TOPS_M[points.boundary, 0] + 40 * points.lateral_m**2
        errors.append((points.depth_m - truth_m) / points.sd_m)

    assert np.std(errors) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(errors)) < 0.1


def test_a_dent_that_leaves_the_window_still_gives_all_its_points():
    boundaries = bowl(1e-6, np.random.default_rng(3))
    boundaries.depth_m[:, np.abs(LATERAL_M) < 1e-3] = np.nan
    points = observe_points(boundaries, 10, 0.0, 4e-3)
    assert len(points.depth_m) == 10
    assert np.abs(points.lateral_m).min() >= 1e-3


def segmentation(
    outer: np.ndarray, inner: np.ndarray, rows: int = 400, found: bool = True
) -> Segmentation:
    thickness_m = 0.5e-3 if found else np.nan
    return Segmentation(outer, inner, rows, True, "", found, thickness_m=thickness_m)


SCALE = PixelScale(lateral_m=30e-6, depth_m=10e-6)
OUTER = np.full(300, 100.0)


def test_refraction_stretches_the_wall_but_not_what_lies_above_it():
    scale = PixelScale(lateral_m=30e-6, depth_m=10e-6, refractive_index=1.36)
    seen = segmented_boundaries(segmentation(OUTER, OUTER + 68.0), scale)
    expected_m = 100.5 * 10e-6 + np.array([[0.0], [0.5e-3]])
    np.testing.assert_allclose(seen.depth_m[:, 50:-50], np.tile(expected_m, 200))


def test_inner_boundary_is_unseen_where_the_frame_ends_or_the_wall_is_uneven():
    outer = np.where(np.arange(300) < 60, 380.0, OUTER)
    inner = outer + 50.0
    inner[250:] += 20.0
    seen = segmented_boundaries(segmentation(outer, inner), SCALE).depth_m[1]
    assert np.isnan(seen[:60]).all()
    assert np.isfinite(seen[70:245]).all()
    assert np.isnan(seen[251:]).all()
    missing = segmented_boundaries(segmentation(outer, inner, found=False), SCALE)
    assert np.isnan(missing.depth_m[1]).all()


SLICE = SliceStudy()


def test_an_assumed_inner_boundary_lies_a_thickness_below_the_surface_along_its_normal():
    """Below a slope of 30 degrees, across a gap, and to both ends."""
    columns = np.arange(200)
    scale = PixelScale(lateral_m=30e-6, depth_m=8e-6, refractive_index=1.4)
    outer_row = 40.0 + np.tan(np.pi / 6) * columns * scale.lateral_m / scale.depth_m
    outer_row[80:90] = np.nan
    inner_row = assumed_inner_row(
        segmentation(outer_row, outer_row, 600), scale, 0.5e-3
    )
    normal_m = (inner_row - outer_row) * scale.depth_m / 1.4 * np.cos(np.pi / 6)
    there = np.isfinite(outer_row)
    np.testing.assert_allclose(normal_m[there], 0.5e-3, rtol=1e-9)
    assert np.isnan(inner_row[~there]).all()


def test_a_pixel_whose_middle_lies_on_the_surface_is_wall_and_one_on_the_inner_boundary_is_not():
    found = segmentation(np.full(140, 3.0), np.full(140, 6.0), 40)
    scale = PixelScale(lateral_m=SLICE.pixel_m, depth_m=SLICE.pixel_m)
    drawn = boundary_slice(found, scale, SLICE) > 0
    expected = np.isin(np.arange(SLICE.rows), [3, 4, 5])
    np.testing.assert_array_equal(drawn, np.tile(expected, (SLICE.columns, 1)).T)


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.9, 1.0]))
def test_a_pixel_is_wall_where_its_middle_lies_between_the_lines_through_columns_with_wall(
    seed: int, missing: float
):
    """Any boundaries, of any scanner, with holes in each of them."""
    rng = np.random.default_rng(seed)
    columns = int(rng.integers(16, 700))
    outer_row = rng.uniform(-20.0, 300.0, columns)
    inner_row = outer_row + rng.uniform(-3.0, 90.0, columns)
    outer_row[rng.random(columns) < missing] = np.nan
    inner_row[rng.random(columns) < 0.05] = np.nan
    lateral_m, depth_m = rng.uniform((5e-6, 3e-6), (90e-6, 30e-6))
    index = rng.uniform(1.0, 1.5)
    scale = PixelScale(lateral_m=lateral_m, depth_m=depth_m, refractive_index=index)
    found = segmentation(outer_row, inner_row, 512)
    shifts = np.array([0.0, 0.3, -0.3])
    drawn, leaves, extent_m = boundary_slices(found, scale, SLICE, tuple(shifts))
    plain, plainly_leaves, plain_extent_m = plain_slices(
        found, scale, SLICE, tuple(shifts)
    )
    np.testing.assert_array_equal(drawn, plain)
    assert leaves == plainly_leaves
    assert extent_m == pytest.approx(plain_extent_m, abs=1e-12)
    middle_m = (np.arange(40) + 0.5 + shifts[:, None]) * SLICE.pixel_m
    there = np.flatnonzero(np.isfinite(outer_row) & np.isfinite(inner_row))

    for column in rng.integers(0, SLICE.columns, 12):
        off_m = (column + 0.5 - SLICE.columns / 2) * SLICE.pixel_m
        at = off_m / lateral_m + columns / 2 - 0.5
        nearest = min(max(round(at), 0), columns - 1)
        if not -0.5 <= at <= columns - 0.5 or nearest not in there:
            assert not drawn[:, :, column].any()
            continue

        outer, inner = (
            np.interp(at, there, rows[there]) + 0.5 for rows in (outer_row, inner_row)
        )
        outer_m = outer * depth_m
        inner_m = (outer + (inner - outer) / index) * depth_m
        ends_m = np.array([outer_m, inner_m])[:, None, None]
        sure = (np.abs(middle_m - ends_m) > 1e-12).all(axis=0)
        inside = (outer_m < middle_m) & (middle_m < inner_m)
        np.testing.assert_array_equal(drawn[:, :, column][sure], 255 * inside[sure])
