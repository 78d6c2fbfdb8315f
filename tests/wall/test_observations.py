"""A frame's boundaries in metres, points on them with their noise, and its wall drawn
into slices.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.records.scan import PixelScale
from scleraforce.records.study import SliceStudy
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import (
    Boundaries,
    boundary_slice,
    boundary_slices,
    observe_points,
    roughness,
    segmented_boundaries,
)

LATERAL = (np.arange(500) - 249.5) * 30e-6


def bowl(noise_m: float, rng: np.random.Generator, width: int = 1) -> Boundaries:
    noise = rng.standard_normal((2, len(LATERAL) + width))
    noise = np.stack(
        [np.convolve(row, np.ones(width) / width**0.5, "same") for row in noise]
    )[:, : len(LATERAL)]
    depth = (
        np.stack([0.5e-3 + 40 * LATERAL**2, 1.2e-3 + 40 * LATERAL**2]) + noise_m * noise
    )

    return Boundaries(LATERAL, depth, 1e-9)


def test_half_of_the_points_lie_on_each_boundary_at_the_same_places_every_time():
    rng = np.random.default_rng(0)
    first, second = (observe_points(bowl(5e-6, rng), 9, 0.0, 4e-3) for _ in range(2))
    assert first.boundary.tolist() == [0] * 5 + [1] * 4
    np.testing.assert_array_equal(first.lateral_m, second.lateral_m)
    assert np.abs(first.lateral_m).max() <= 4e-3


@pytest.mark.parametrize("width", [1, 4])
def test_stated_noise_is_the_error_that_points_have(width: int) -> None:
    rng = np.random.default_rng(1)
    errors = []

    for _ in range(200):
        points = observe_points(bowl(10e-6, rng, width), 10, 0.0, 4e-3)
        truth = (
            np.where(points.boundary == 0, 0.5e-3, 1.2e-3) + 40 * points.lateral_m**2
        )
        errors.append((points.depth_m - truth) / points.sd_m)

    assert np.std(errors) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(errors)) < 0.1


def test_roughness_tells_size_and_correlation_of_the_noise() -> None:
    rng = np.random.default_rng(2)
    plain = roughness(bowl(10e-6, rng), 0)
    blurred = roughness(bowl(10e-6, rng, 4), 0)
    assert plain.sd_m == pytest.approx(10e-6, rel=0.15)
    assert plain.columns_as_one() < 1.5
    assert 2.0 < blurred.columns_as_one() < 7.0


def test_a_dent_that_leaves_the_window_still_gives_all_its_points() -> None:
    boundaries = bowl(1e-6, np.random.default_rng(3))
    boundaries.depth_m[:, np.abs(LATERAL) < 1e-3] = np.nan
    points = observe_points(boundaries, 10, 0.0, 4e-3)
    assert len(points.depth_m) == 10
    assert np.abs(points.lateral_m).min() >= 1e-3


def segmentation(
    outer: np.ndarray, inner: np.ndarray, thickness_m: float, found: bool = True
) -> Segmentation:
    return Segmentation(outer, inner, 400, True, "", found, thickness_m=thickness_m)


def test_refraction_stretches_the_wall_but_not_what_lies_above_it() -> None:
    outer = np.full(300, 100.0)
    scale = PixelScale(lateral_m=30e-6, depth_m=10e-6)
    seen = segmented_boundaries(
        segmentation(outer, outer + 68.0, 0.5e-3), replace(scale, refractive_index=1.36)
    )
    np.testing.assert_allclose(seen.depth_m[0, 50:-50], 100.5 * 10e-6)
    np.testing.assert_allclose(seen.depth_m[1, 50:-50], 100.5 * 10e-6 + 0.5e-3)


def test_inner_boundary_is_unseen_where_the_frame_ends_or_the_wall_is_uneven() -> None:
    outer = np.full(300, 100.0)
    scale = PixelScale(lateral_m=30e-6, depth_m=10e-6)
    outer[:60] = 380.0
    inner = outer + 50.0
    inner[250:] += 20.0
    seen = segmented_boundaries(segmentation(outer, inner, 0.5e-3), scale)
    assert np.isnan(seen.depth_m[1, :60]).all()
    assert np.isfinite(seen.depth_m[1, 70:245]).all()
    assert np.isnan(seen.depth_m[1, 251:]).all()
    missing = segmented_boundaries(
        segmentation(outer, inner, np.nan, found=False), scale
    )
    assert np.isnan(missing.depth_m[1]).all()


SLICE = SliceStudy()


def test_a_pixel_whose_middle_lies_on_the_surface_is_wall_and_one_on_the_inner_boundary_is_not():
    found = Segmentation(
        np.full(140, 3.0), np.full(140, 6.0), 40, True, "", True, thickness_m=0.3e-3
    )
    scale = PixelScale(lateral_m=SLICE.pixel_m, depth_m=SLICE.pixel_m)
    drawn = boundary_slice(found, scale, SLICE)
    assert (
        np.flatnonzero(drawn.all(axis=1)).tolist()
        == np.flatnonzero(drawn.any(axis=1)).tolist()
        == [3, 4, 5]
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1, 0.9, 1.0]))
def test_a_pixel_is_wall_where_its_middle_lies_between_the_lines_through_columns_with_wall(
    seed: int, missing: float
):
    """Any boundaries, of any scanner, with holes in each of them."""
    rng = np.random.default_rng(seed)
    columns = int(rng.integers(16, 700))
    outer_row = rng.uniform(-20.0, 300.0, columns)
    inner_row = outer_row + rng.uniform(-3.0, 90.0, columns)
    outer_row[rng.random(columns) < missing] = inner_row[rng.random(columns) < 0.05] = (
        np.nan
    )
    scale = PixelScale(
        lateral_m=rng.uniform(5e-6, 90e-6),
        depth_m=rng.uniform(3e-6, 30e-6),
        refractive_index=rng.uniform(1.0, 1.5),
    )
    found = Segmentation(outer_row, inner_row, 512, True, "", True, thickness_m=0.5e-3)
    drawn, _, _ = boundary_slices(found, scale, SLICE, (0.0, 0.3, -0.3))
    there = [
        n for n in range(columns) if np.isfinite([outer_row[n], inner_row[n]]).all()
    ]

    for column in rng.integers(0, SLICE.columns, 12):
        at = (
            (column + 0.5 - SLICE.columns / 2) * SLICE.pixel_m / scale.lateral_m
            + columns / 2
            - 0.5
        )
        if (
            not -0.5 <= at <= columns - 0.5
            or min(max(round(at), 0), columns - 1) not in there
        ):
            assert not drawn[:, :, column].any()
            continue

        (one,) = [n for n in there if n <= at][-1:] or there[:1]
        (other,) = [n for n in there if n > at][:1] or there[-1:]
        share = (at - one) / max(other - one, 1)
        outer, inner = (
            rows[one] + share * (rows[other] - rows[one]) + 0.5
            for rows in (outer_row, inner_row)
        )
        outer_m = outer * scale.depth_m
        inner_m = (outer + (inner - outer) / scale.refractive_index) * scale.depth_m
        middle_m = (
            np.arange(40) + 0.5 + np.array([[0.0], [0.3], [-0.3]])
        ) * SLICE.pixel_m
        sure = (np.abs(middle_m - outer_m) > 1e-12) & (
            np.abs(middle_m - inner_m) > 1e-12
        )
        inside = (outer_m < middle_m) & (middle_m < inner_m)
        np.testing.assert_array_equal(drawn[:, :, column][sure], 255 * inside[sure])
