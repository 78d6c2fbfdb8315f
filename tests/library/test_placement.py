"""Curves laid on a frame: depths against a naive search, the pose's derivatives against differences."""

from itertools import pairwise

import numpy as np
import pytest

from scleraforce.library.placement import Places, curve_depths, place_curves, pose_derivatives

LATERAL_M = np.linspace(-3e-3, 3e-3, 121)


def bowl(samples: int = 400) -> np.ndarray:
    """Two boundaries of a smooth dent, (boundary, sample, 2) in m."""
    x = np.linspace(-5e-3, 5e-3, samples)
    outer = 1e-3 * np.exp(-((x / 1.5e-3) ** 2)) + 0.04 * x**2 / 1e-3
    return np.stack([np.stack([x, outer], axis=1), np.stack([x, outer + 0.6e-3], axis=1)])


def both_boundaries(smoothing_m: float = 0.0) -> Places:
    return Places(np.tile(LATERAL_M, 2), np.repeat([0, 1], len(LATERAL_M)), smoothing_m)


def first_crossing_depth(curve: np.ndarray, at: float) -> float:
    """The depth of the first segment, in the order of the curve, that spans a lateral place."""
    farthest = curve[0, 0]
    for (x0, z0), (x1, z1) in pairwise(curve):
        if x1 > farthest and x0 <= at <= x1:
            return float(z0 + (z1 - z0) * (at - x0) / (x1 - x0))
        farthest = max(farthest, x1)
    return float("nan")


def test_depths_are_those_of_a_naive_search_along_the_curve() -> None:
    curves = place_curves(bowl(), 0.3e-3, 0.5e-3, 0.05)
    depth, _, seen = curve_depths(curves, both_boundaries())
    naive = [first_crossing_depth(curve, x) for curve in curves for x in LATERAL_M]
    assert seen.all()
    np.testing.assert_allclose(depth, naive, atol=1e-12)


def test_of_a_wall_that_folds_back_what_light_meets_first_counts() -> None:
    folded = np.array([[-2.0, 0.0], [0.0, 0.0], [0.5, 1.0], [0.2, 2.0], [1.0, 3.0], [3.0, 3.0]]) * 1e-3
    places = Places(np.array([-1e-3, 0.25e-3, 0.9e-3, 3.5e-3]), np.zeros(4, dtype=np.intp))
    depth, _, seen = curve_depths(np.stack([folded, folded]), places)
    assert depth[:2] == pytest.approx([0.0, 0.5e-3])
    assert depth[2] == pytest.approx(1e-3 + 0.4e-3 * 2e-3 / 0.5e-3)  # from the fold's edge straight to what lies ahead
    assert seen.tolist() == [True, True, True, False]


def test_of_a_wall_that_only_runs_back_nothing_is_seen() -> None:
    depth, slope, seen = curve_depths(bowl()[:, ::-1], both_boundaries(90e-6))
    assert not seen.any()
    assert np.isfinite(depth).all()
    assert not slope.any()


def test_derivatives_of_the_pose_are_differences_of_depths() -> None:
    pose = np.array([0.2e-3, 0.4e-3, 0.03])
    places, steps = both_boundaries(), (1e-7, 1e-7, 1e-5)
    depth, slope, _ = curve_depths(place_curves(bowl(4000), *pose), places)
    derivatives = pose_derivatives(places, depth, slope, (pose[0], pose[1]))
    for axis, (step, derivative) in enumerate(zip(steps, derivatives, strict=True)):
        moved = pose + step * np.eye(3)[axis]
        difference = (curve_depths(place_curves(bowl(4000), *moved), places)[0] - depth) / step
        np.testing.assert_allclose(derivative, difference, atol=0.02 * np.abs(difference).max())


def test_smoothing_is_a_gaussian_average_of_the_outer_boundary_alone() -> None:
    curves, sd_m = bowl(4000), 60e-6
    depth, _, _ = curve_depths(curves, both_boundaries(sd_m))
    plain, _, _ = curve_depths(curves, both_boundaries())
    offsets = np.linspace(-5, 5, 2001) * sd_m
    weights = np.exp(-0.5 * (offsets / sd_m) ** 2)
    averaged = [np.average(np.interp(x + offsets, *curves[0].T), weights=weights) for x in LATERAL_M]
    outer = len(LATERAL_M)
    np.testing.assert_allclose(depth[:outer], averaged, atol=0.1e-6)
    assert np.abs(depth[:outer] - plain[:outer]).max() > 1e-6
    np.testing.assert_array_equal(depth[outer:], plain[outer:])
