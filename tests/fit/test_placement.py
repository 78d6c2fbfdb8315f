"""Curves laid on a frame: depths against a naive search, the pose's derivatives against
differences.
"""

from itertools import pairwise

import numpy as np
import pytest
from fit_arrays import smoothed

from scleraforce.fit.curve_placement import PlacesOnFrame, curve_depths, place_curves

LATERAL_M = np.linspace(-3e-3, 3e-3, 121)
BOTH = PlacesOnFrame(np.tile(LATERAL_M, 2), np.repeat([0, 1], len(LATERAL_M)))


def bowl(samples: int = 400) -> np.ndarray:
    """Two boundaries of a smooth dent, (boundary, sample, 2) in m."""
    x = np.linspace(-5e-3, 5e-3, samples)
    outer = 1e-3 * np.exp(-((x / 1.5e-3) ** 2)) + 0.04 * x**2 / 1e-3
    return np.stack(
        [np.stack([x, outer], axis=1), np.stack([x, outer + 0.6e-3], axis=1)]
    )


def first_crossing_depth(curve: np.ndarray, at: float) -> float:
    """The depth of the first segment, in the order of the curve, that spans a lateral
    place.
    """
    farthest = curve[0, 0]
    for (x0, z0), (x1, z1) in pairwise(curve):
        if x1 > farthest and x0 <= at <= x1:
            return float(z0 + (z1 - z0) * (at - x0) / (x1 - x0))
        farthest = max(farthest, x1)
    return float("nan")


def test_depths_agree_with_a_naive_search_along_the_curve():
    curves = place_curves(bowl(), 0.3e-3, 0.5e-3, 0.05)
    depth, _, seen = curve_depths(curves, BOTH)
    naive = [first_crossing_depth(curve, x) for curve in curves for x in LATERAL_M]
    assert seen.all()
    np.testing.assert_allclose(depth, naive, atol=1e-12)


def test_light_sees_the_first_part_of_a_wall_that_folds_back():
    lateral = [-2.0, 0.0, 0.5, 0.2, 0.4, 1.0, 3.0]
    down = [0.0, 0.0, 1.0, 2.0, 2.5, 3.0, 3.0]
    folded = 1e-3 * np.stack([lateral, down], axis=1)
    places = PlacesOnFrame(
        np.array([-1e-3, 0.25e-3, 0.9e-3, 3.5e-3]), np.zeros(4, dtype=np.intp)
    )
    depth, _, seen = curve_depths(np.stack([folded, folded]), places)
    assert depth[:2] == pytest.approx([0.0, 0.5e-3])
    # straight from the fold's edge to the part ahead
    assert depth[2] == pytest.approx(1e-3 + 0.4e-3 * 2e-3 / 0.5e-3)
    assert seen.tolist() == [True, True, True, False]
    depth, slope, seen = curve_depths(bowl()[:, ::-1], BOTH)  # it only runs back
    assert not seen.any()
    assert np.isfinite(depth).all()
    assert not slope.any()


def test_the_oracle_smooths_by_a_gaussian_average():
    outer = bowl(4000)[0]
    sd_m = 60e-6
    depth, _, _ = smoothed(
        outer, PlacesOnFrame(LATERAL_M, np.zeros(len(LATERAL_M), dtype=np.intp), sd_m)
    )
    offsets = np.linspace(-5, 5, 2001) * sd_m
    weights = np.exp(-0.5 * (offsets / sd_m) ** 2)
    averaged = [
        np.average(np.interp(x + offsets, *outer.T), weights=weights) for x in LATERAL_M
    ]
    np.testing.assert_allclose(depth, averaged, atol=0.1e-6)
    assert np.abs(depth - np.interp(LATERAL_M, *outer.T)).max() > 1e-6
