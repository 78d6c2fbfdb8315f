from dataclasses import replace

import numpy as np
import pytest

from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.observations import Boundaries, observe_points, roughness, segmented_boundaries

LATERAL = (np.arange(500) - 249.5) * 30e-6


def bowl(noise_m: float, rng: np.random.Generator, width: int = 1) -> Boundaries:
    noise = rng.standard_normal((2, len(LATERAL) + width))
    noise = np.stack([np.convolve(row, np.ones(width) / width**0.5, "same") for row in noise])[:, : len(LATERAL)]
    depth = np.stack([0.5e-3 + 40 * LATERAL**2, 1.2e-3 + 40 * LATERAL**2]) + noise_m * noise
    return Boundaries(LATERAL, depth, 1e-9)


def test_half_of_the_points_lie_on_each_boundary_at_the_same_places_every_time() -> None:
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
        truth = np.where(points.boundary == 0, 0.5e-3, 1.2e-3) + 40 * points.lateral_m**2
        errors.append((points.depth_m - truth) / points.sd_m)
    assert np.std(errors) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(errors)) < 0.1


def test_roughness_tells_size_and_correlation_of_the_noise() -> None:
    rng = np.random.default_rng(2)
    plain, blurred = roughness(bowl(10e-6, rng), 0), roughness(bowl(10e-6, rng, 4), 0)
    assert plain.sd_m == pytest.approx(10e-6, rel=0.15)
    assert plain.columns_as_one() < 1.5
    assert 2.0 < blurred.columns_as_one() < 7.0


def test_a_dent_that_leaves_the_window_still_gives_all_its_points() -> None:
    boundaries = bowl(1e-6, np.random.default_rng(3))
    boundaries.depth_m[:, np.abs(LATERAL) < 1e-3] = np.nan
    points = observe_points(boundaries, 10, 0.0, 4e-3)
    assert len(points.depth_m) == 10
    assert np.abs(points.lateral_m).min() >= 1e-3


def segmentation(outer: np.ndarray, inner: np.ndarray, thickness_m: float, found: bool = True) -> Segmentation:
    return Segmentation(outer, inner, 400, True, "", found, thickness_m=thickness_m)


def test_refraction_stretches_the_wall_but_not_what_lies_above_it() -> None:
    outer, scale = np.full(300, 100.0), PixelScale(lateral_m=30e-6, depth_m=10e-6)
    seen = segmented_boundaries(segmentation(outer, outer + 68.0, 0.5e-3), replace(scale, refractive_index=1.36))
    np.testing.assert_allclose(seen.depth_m[0, 50:-50], 100.5 * 10e-6)
    np.testing.assert_allclose(seen.depth_m[1, 50:-50], 100.5 * 10e-6 + 0.5e-3)


def test_inner_boundary_is_unseen_where_the_frame_ends_or_the_wall_is_uneven() -> None:
    outer, scale = np.full(300, 100.0), PixelScale(lateral_m=30e-6, depth_m=10e-6)
    outer[:60] = 380.0
    inner = outer + 50.0
    inner[250:] += 20.0
    seen = segmented_boundaries(segmentation(outer, inner, 0.5e-3), scale)
    assert np.isnan(seen.depth_m[1, :60]).all()
    assert np.isfinite(seen.depth_m[1, 70:245]).all()
    assert np.isnan(seen.depth_m[1, 251:]).all()
    missing = segmented_boundaries(segmentation(outer, inner, np.nan, found=False), scale)
    assert np.isnan(missing.depth_m[1]).all()
