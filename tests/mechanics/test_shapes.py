import numpy as np
import pytest

from scleraforce.mechanics.shapes import node_positions, shape_gradients, shape_values

ELEMENTS = [(2, 4), (2, 8), (2, 9), (3, 8), (3, 20), (3, 27)]


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_each_shape_function_is_one_at_its_node_and_zero_at_the_others(dimension: int, nodes: int) -> None:
    np.testing.assert_array_equal(shape_values(node_positions(dimension, nodes), nodes), np.eye(nodes))


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_shape_functions_reproduce_the_polynomials_of_their_order(dimension: int, nodes: int) -> None:
    order = 1 if nodes == 2**dimension else 2
    points = np.random.default_rng(0).uniform(-1, 1, (50, dimension))
    slope = np.arange(1.0, dimension + 1)

    def field(x: np.ndarray) -> np.ndarray:
        return (0.3 + x @ slope) ** order

    interpolated = shape_values(points, nodes) @ field(node_positions(dimension, nodes))
    np.testing.assert_allclose(interpolated, field(points), atol=1e-13)


@pytest.mark.parametrize(("dimension", "nodes"), ELEMENTS)
def test_gradients_are_the_slopes_of_the_values(dimension: int, nodes: int) -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (20, dimension))
    for axis in range(dimension):
        step = 1e-3 * np.eye(dimension)[axis]  # central differences are exact for quadratics
        slopes = (shape_values(points + step, nodes) - shape_values(points - step, nodes)) / 2e-3
        np.testing.assert_allclose(shape_gradients(points, nodes)[..., axis], slopes, atol=1e-11)


def test_an_unknown_element_is_refused() -> None:
    with pytest.raises(ValueError, match="7 nodes"):
        shape_values(np.zeros((1, 3)), 7)
