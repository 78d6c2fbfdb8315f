"""The cubic splines against SciPy's, and their order."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline as SciPySpline

from scleraforce.library.response_splines import SUPPORT, CubicSpline

NODES = np.array([0.0, 0.1, 0.25, 0.6, 0.7, 1.3, 1.9, 2.0])


def evaluate(spline, coefficients, places):
    first, weights = spline.weights(places)
    return (coefficients[first[:, None] + np.arange(SUPPORT)] * weights).sum(axis=1)


@pytest.mark.parametrize("count", [4, 5, 8])
def test_values_and_slopes_agree_with_scipys_not_a_knot_spline(count):
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
