"""Boundary errors that are made: their shape and bookkeeping, and that they are like those of the segmentation."""

from dataclasses import replace

import numpy as np
import pytest

from boundary_errors.segmented import random_eyes, segmented_boundaries
from boundary_errors.statistics import boundary_statistics
from scleraforce.learning.walls import BoundaryErrors, disturb
from scleraforce.library import INNER, OUTER
from scleraforce.library.build import cached_library
from scleraforce.study import LibraryStudy, Range, SliceStudy, Study

SLICE = SliceStudy()
NONE = BoundaryErrors(
    surface_smoothing_m=1e-9, shine_m=0.0, shine_sd_m=0.0, outer_sd_m=0.0, thickness_scale_sd=0.0, thickness_sd_m=0.0,
    bumps=0.0, layer_share=0.0, side_loss_share=0.0, bottom_knee_m=1e-12,
)  # fmt: skip


def walls(count: int, bend_per_m: float = 80.0) -> np.ndarray:
    """Parabolic walls of 0.6 mm, (sample, boundary, column), m."""
    lateral = (np.arange(SLICE.columns) + 0.5 - SLICE.columns / 2) * SLICE.pixel_m
    outer = 0.5e-3 + 0.5 * bend_per_m * lateral**2
    return np.repeat(np.stack([outer, outer + 0.6e-3])[None], count, axis=0)


def test_without_errors_the_boundaries_stay_where_they_can_be_seen() -> None:
    true = walls(3)
    true[1, :, :7] = np.nan
    seen = disturb(true, SLICE, np.random.default_rng(0), NONE)
    known = np.isfinite(seen)
    np.testing.assert_array_equal(known, np.isfinite(true))
    np.testing.assert_allclose(seen[known], true[known], atol=1e-9)


def test_the_same_generator_gives_the_same_errors_and_the_truth_is_left_alone() -> None:
    true = walls(5)
    before = true.copy()
    first, second = (disturb(true, SLICE, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(true, before)
    assert np.nanmax(np.abs(first - true)) > 1e-6


def test_smoothing_moves_a_bent_surface_by_half_its_variance_times_the_curvature() -> None:
    smoothing_m = 0.18e-3
    seen = disturb(walls(1, 200.0), SLICE, np.random.default_rng(0), replace(NONE, surface_smoothing_m=smoothing_m))
    moved = (seen - walls(1, 200.0))[0, OUTER, 45:95]
    np.testing.assert_allclose(moved, 0.5 * smoothing_m**2 * 200.0, rtol=0.01)


def test_the_noise_has_the_stated_size_and_reaches_along_the_columns() -> None:
    errors = replace(NONE, outer_sd_m=10e-6, outer_lengths_m=(0.3e-3, 0.3e-3), spread=0.0)
    true = walls(4000, 5.0)
    error = (disturb(true, SLICE, np.random.default_rng(1), errors) - true)[:, OUTER, 10:-10]
    assert abs(error.std() / 10e-6 - 1.0) < 0.02
    for lag in (1, 3, 6):  # of Gaussian-smoothed white noise: exp(-(lag / length)^2 / 4)
        found = (error[:, lag:] * error[:, :-lag]).mean() / error.var()
        assert abs(found - np.exp(-((lag / 3.0) ** 2) / 4)) < 0.02


def test_errors_scale_and_bumps_lie_on_steep_flanks_only() -> None:
    true = walls(500, 100.0)
    flat = np.abs(np.gradient(true[0, OUTER], SLICE.pixel_m)) < 0.2
    bumps = replace(NONE, bumps=5.0, bump_length_m=0.1e-3)
    error = np.abs(disturb(true, SLICE, np.random.default_rng(2), bumps) - true)[:, INNER]
    steep = np.abs(np.gradient(true[0, OUTER], SLICE.pixel_m)) > 0.45
    assert np.nanmax(error[:, flat]) < 1e-6 < 1e-4 < np.nanmax(error[:, steep])
    noise = replace(NONE, thickness_sd_m=5e-6, thickness_scale_sd=0.01, spread=0.0)
    once, thrice = (disturb(true, SLICE, np.random.default_rng(2), noise, scale) - true for scale in (1.0, 3.0))
    np.testing.assert_allclose(thrice[:, INNER], 3.0 * once[:, INNER], atol=1e-9)


def test_a_layer_below_is_taken_for_wall_in_the_stated_share_of_frames() -> None:
    true = walls(4000, 5.0)
    layers = replace(NONE, layer_share=0.1, layer_m=(0.12e-3, 0.18e-3))
    added = (disturb(true, SLICE, np.random.default_rng(6), layers) - true)[:, INNER]
    hit = added.max(axis=1) > 1e-6
    assert abs(hit.mean() - 0.1) < 0.015
    assert added[hit].max(axis=1).min() > 0.119e-3
    assert added.max() < 0.181e-3
    assert 0.4 < (added[hit] > 1e-6).mean() < 0.8


def test_a_surface_that_leaves_at_the_bottom_is_seen_too_high_and_then_lost() -> None:
    lateral = (np.arange(SLICE.columns) + 0.5 - SLICE.columns / 2) * SLICE.pixel_m
    outer = 4.6e-3 - 0.3 * np.abs(lateral)
    true = np.repeat(np.stack([outer, outer + 0.6e-3])[None], 300, axis=0)
    seen = disturb(true, SLICE, np.random.default_rng(6), replace(NONE, bottom_knee_m=0.02e-3))[:, OUTER]
    assert np.isnan(seen[:, outer > 4.5e-3]).all()
    assert np.isfinite(seen[:, outer < 3.94e-3]).all()
    assert np.nanmax(seen) <= 3.945e-3
    reached = np.nanmax(np.where(np.isfinite(seen), outer, np.nan), axis=1) - 3.945e-3
    assert 0.05e-3 < reached.mean() < 0.12e-3


def test_sides_are_lost_as_often_and_as_far_as_stated() -> None:
    seen = disturb(
        walls(4000, 5.0), SLICE, np.random.default_rng(5), replace(NONE, side_loss_share=0.4, side_loss_m=0.5e-3)
    )
    lost = np.isnan(seen[:, OUTER])
    assert abs(lost[:, 0].mean() - 0.4) < 0.03
    assert abs(lost[:, :70].sum(axis=1)[lost[:, 0]].mean() - 5.5) < 0.4  # the mean of an exponential, rounded up


@pytest.mark.long
@pytest.mark.slow
def test_the_errors_made_are_like_those_of_freshly_segmented_frames(tmp_path) -> None:
    study = Study(
        library=LibraryStudy(
            thicknesses=5, tension=Range(min=1e-3, max=0.21), tensions=6, tips=30, max_tip_m=6e-3, stiffenings=1
        )
    )
    library = cached_library(study, folder=tmp_path)
    forces_n = np.linspace(0.0, 55e-3, 12).tolist()
    eyes = random_eyes(study, 14, 271)
    pairs = [segmented_boundaries(library, study, eye, forces_n, 314) for eye in eyes]
    true, seen = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    real = boundary_statistics(true, seen, SLICE)
    without_layers = BoundaryErrors(layer_share=0.0)  # this segmentation takes none for wall: they are made on purpose
    made = boundary_statistics(true, disturb(true, SLICE, np.random.default_rng(1), without_layers), SLICE)
    for name in (
        "outer_sd_m",
        "outer_per_curvature_m2",
        "shine_m",
        "shine_sd_m",
        "thickness_sd_m",
        "thickness_steep_sd_m",
        "thickness_scale_sd",
    ):
        assert 0.6 < getattr(made, name) / getattr(real, name) < 1.7, name
    np.testing.assert_allclose(made.outer_correlation, real.outer_correlation, atol=0.25)
    np.testing.assert_allclose(made.thickness_correlation, real.thickness_correlation, atol=0.3)
    assert abs(made.outer_bias_m - real.outer_bias_m) < 2e-6
    assert abs(made.large_share - real.large_share) < 0.02
    assert max(made.lost_share, real.lost_share) < 0.01


def test_the_surface_lies_higher_where_it_faces_the_light_and_the_wall_ends_where_it_did() -> None:
    true = walls(3000)
    shining = disturb(true, SLICE, np.random.default_rng(2), replace(NONE, shine_m=8e-6, shine_sd_m=2e-6)) - true
    lateral = (np.arange(SLICE.columns) + 0.5 - SLICE.columns / 2) * SLICE.pixel_m
    slope = np.gradient(true[0, OUTER], SLICE.pixel_m)
    expected = -8e-6 * np.exp(-((slope / 0.115) ** 2))
    inside = np.abs(lateral) < 5e-3
    np.testing.assert_allclose(shining[:, OUTER].mean(axis=0)[inside], expected[inside], atol=0.15e-6)
    middle = np.abs(slope).argmin()
    assert shining[:, OUTER, middle].std() == pytest.approx(2e-6, rel=0.05)
    np.testing.assert_allclose(shining[:, INNER][:, inside], 0.0, atol=1e-12)
    none = disturb(true, SLICE, np.random.default_rng(2), replace(NONE, shine_m=-1.0)) - true
    np.testing.assert_allclose(none[:, OUTER][:, inside], 0.0, atol=1e-12)
