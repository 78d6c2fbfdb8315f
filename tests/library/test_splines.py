"""The cubic splines against SciPy's, and their order."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline as SciPySpline

from scleraforce.library.response_splines import SUPPORT, CubicSpline, first_crossing

NODES = np.array([0.0, 0.1, 0.25, 0.6, 0.7, 1.3, 1.9, 2.0])


def evaluate(spline, coefficients, places):
    first, weights = spline.weights(places)
    return (coefficients[first[:, None] + np.arange(SUPPORT)] * weights).sum(axis=1)


def test_values_and_slopes_agree_with_scipys_not_a_knot_spline():
    for count in (4, 5, 8):
        nodes = NODES[:count]
        values = np.random.default_rng(0).normal(size=count)
        spline = CubicSpline(nodes)
        oracle = SciPySpline(nodes, values)
        coefficients = spline.coefficients(values)
        places = np.linspace(nodes[0], nodes[-1], 101)
        assert evaluate(spline, coefficients, places) == pytest.approx(
            oracle(places), abs=1e-11
        )
        assert spline.slopes(coefficients) == pytest.approx(oracle(nodes, 1), abs=1e-10)
        _, weights = spline.weights(np.zeros(1))
        # without a dent there is no force at all
        assert weights.tolist() == [[1.0, 0.0, 0.0, 0.0]]


def test_the_error_falls_with_the_fourth_power_of_the_spacing():
    def error(count):
        spline = CubicSpline(np.linspace(0.0, 3.0, count))
        places = np.linspace(0.0, 3.0, 1001)
        return np.abs(
            evaluate(spline, spline.coefficients(np.exp(spline.nodes)), places)
            - np.exp(places)
        ).max()

    orders = [np.log2(error(count) / error(2 * count - 1)) for count in (11, 21, 41)]
    assert orders == pytest.approx([4.0] * 3, abs=0.35)


TIP = 7e-3 * np.linspace(0.0, 1.0, 25) ** 1.5


def search(tip, force, slope, wanted):
    """Walk along the path in steps of 0.1 um and interpolate where the force is first
    reached.
    """
    path = CubicHermiteSpline(tip, force, slope)
    fine = np.linspace(tip[0], tip[-1], 70_001)
    values = path(fine)

    reached = np.flatnonzero(values >= wanted)
    if not len(reached):
        return np.nan

    k = reached[0]
    if k == 0:
        return fine[0]

    return np.interp(wanted, values[k - 1 : k + 1], fine[k - 1 : k + 1])


@pytest.mark.parametrize("seed", range(6))
def test_the_first_of_several_states_is_found(seed):
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(40, 3)) * [3.0, 2.0, 1.0]
    force = TIP * 1e3 + (
        waves[:, :, None] * np.sin(TIP * 1e3 * np.array([[0.6], [1.1], [1.7]]))
    ).sum(axis=1)
    slope = np.array([SciPySpline(TIP, row)(TIP, 1) for row in force])
    wanted = rng.uniform(0.0, 8.0, 40)
    found = first_crossing(TIP, np.hstack([force, slope]), wanted)
    expected = np.array(
        [search(TIP, *row) for row in zip(force, slope, wanted, strict=True)]
    )
    assert np.isnan(found).tolist() == np.isnan(expected).tolist()
    assert found == pytest.approx(expected, abs=2e-9, nan_ok=True)


def test_just_below_a_peak_between_two_tips_the_state_before_the_peak_counts():
    tip = np.array([0.0, 1.0, 2.0, 9.0])
    # forces, slopes
    path = np.array([[0.0, 1.0, 1.0, 8.0, 1.0, 1.0, -1.0, 2.0]])
    peak = 1.25
    assert first_crossing(tip, path, np.array([peak - 1e-3]))[0] < 1.5
    assert first_crossing(tip, path, np.array([peak + 1e-3]))[0] > 2.0
