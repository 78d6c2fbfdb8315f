"""The cubic splines against SciPy's, and their order."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline as SciPySpline

from scleraforce.library.splines import SUPPORT, CubicSpline

NODES = np.array([0.0, 0.1, 0.25, 0.6, 0.7, 1.3, 1.9, 2.0])


def evaluate(spline, coefficients, places):
    first, weights = spline.weights(places)
    return (coefficients[first[:, None] + np.arange(SUPPORT)] * weights).sum(axis=1)


@pytest.mark.parametrize("count", [4, 5, 8])
def test_values_and_slopes_are_those_of_scipys_not_a_knot_spline(count):
    nodes = NODES[:count]
    values = np.random.default_rng(0).normal(size=count)
    spline, oracle = CubicSpline(nodes), SciPySpline(nodes, values)
    coefficients = spline.coefficients(values)
    places = np.linspace(nodes[0], nodes[-1], 101)
    assert evaluate(spline, coefficients, places) == pytest.approx(oracle(places), abs=1e-11)
    assert spline.slopes(coefficients) == pytest.approx(oracle(nodes, 1), abs=1e-10)


def test_weights_add_up_to_one_also_at_the_nodes():
    spline = CubicSpline(NODES)
    first, weights = spline.weights(np.concatenate([NODES, np.linspace(0.0, 2.0, 57)]))
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert first.min() == 0
    assert first.max() == len(NODES) - SUPPORT


def test_the_first_node_is_met_exactly():
    for nodes in (4, 5, 8):
        _, weights = CubicSpline(NODES[:nodes]).weights(np.zeros(1))
        assert weights.tolist() == [[1.0, 0.0, 0.0, 0.0]]  # no dent takes no force at all


def test_any_axis_is_interpolated_as_the_first():
    values = np.random.default_rng(1).normal(size=(3, 8, 2))
    spline = CubicSpline(NODES)
    along = spline.coefficients(values, axis=1)
    assert along[2, :, 1] == pytest.approx(spline.coefficients(values[2, :, 1]))


def test_the_error_falls_with_the_fourth_power_of_the_spacing():
    def error(count):
        spline = CubicSpline(np.linspace(0.0, 3.0, count))
        places = np.linspace(0.0, 3.0, 1001)
        return np.abs(evaluate(spline, spline.coefficients(np.exp(spline.nodes)), places) - np.exp(places)).max()

    orders = [np.log2(error(count) / error(2 * count - 1)) for count in (11, 21, 41)]
    assert orders == pytest.approx([4.0] * 3, abs=0.35)
