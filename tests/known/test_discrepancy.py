"""How far an eye's forces lie off the library's: corrected forces and draws of them."""

import numpy as np
import pytest

from scleraforce.known import NO_DISCREPANCY, ForceDiscrepancy

LIBRARY_N = np.array([0.0, 5e-3, 30e-3, 55e-3])
STIFFENING = ForceDiscrepancy(level=0.05, growth=0.4, level_sd=0.02, growth_sd=0.1, correlation=-0.6)


def test_forces_of_an_eye_without_a_discrepancy_are_the_library_s() -> None:
    np.testing.assert_array_equal(NO_DISCREPANCY.corrected_n(LIBRARY_N), LIBRARY_N)


def test_forces_grow_by_level_and_growth_and_beyond_the_range_by_no_more() -> None:
    expected = LIBRARY_N * np.exp(0.05 + 0.4 * (LIBRARY_N / 60e-3 - 0.5))
    np.testing.assert_allclose(STIFFENING.corrected_n(LIBRARY_N), expected)
    assert STIFFENING.corrected_n(np.array([90e-3]))[0] == pytest.approx(90e-3 * np.exp(0.05 + 0.2))


def test_draws_have_the_standard_deviations_and_the_correlation() -> None:
    level_z, growth_z = np.random.default_rng(0).standard_normal((2, 200_000))
    low, high = (
        np.log(STIFFENING.corrected_n(np.full(200_000, force_n), level_z, growth_z) / force_n)
        for force_n in (15e-3, 45e-3)
    )
    assert np.std(high - low) == pytest.approx(0.5 * 0.1, rel=0.01)
    assert np.std(0.5 * (high + low)) == pytest.approx(0.02, rel=0.01)
    assert np.corrcoef(high + low, high - low)[0, 1] == pytest.approx(-0.6, abs=0.01)
