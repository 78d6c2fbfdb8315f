"""Inverses and determinants of 3 x 3 matrices, beside LAPACK and exact fractions."""

from fractions import Fraction

import numpy as np
import pytest

from scleraforce.mechanics.small_matrices import dilatations, inverses


@pytest.mark.parametrize("size", [1e-12, 1e-3, 0.3])
def test_the_inverse_is_that_of_lapack(size: float):
    gradients = np.random.default_rng(0).uniform(-size, size, (500, 3, 3))
    whole = gradients + np.eye(3)
    found = inverses(gradients)
    np.testing.assert_allclose(found, np.linalg.inv(whole), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(
        found @ whole, np.tile(np.eye(3), (500, 1, 1)), atol=1e-12
    )


@pytest.mark.parametrize("size", [1e-14, 1e-6, 0.3])
def test_no_digit_of_a_tiny_dilatation_is_lost(size: float):
    """det(I + H) - 1 by fractions; of 1 + 1e-14 two digits would be left."""
    gradients = np.random.default_rng(1).uniform(-size, size, (20, 3, 3))
    for gradient, found in zip(gradients, dilatations(gradients), strict=True):
        one = [[Fraction(float(value)) for value in row] for row in gradient]
        for row in range(3):
            one[row][row] += 1
        (a, b, c), (d, e, f), (g, h, i) = one
        exact = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) - 1
        assert found == pytest.approx(float(exact), rel=1e-12, abs=1e-15 * size)
