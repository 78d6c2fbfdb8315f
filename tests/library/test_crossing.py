"""The first state that carries a force, against a search on a fine grid."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from scleraforce.library.splines import first_crossing

TIP = 7e-3 * np.linspace(0.0, 1.0, 25) ** 1.5


def search(tip, force, slope, wanted):
    """Walk along the path in steps of 0.1 um and interpolate where the force is first reached."""
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
    force = TIP * 1e3 + (waves[:, :, None] * np.sin(TIP * 1e3 * np.array([[0.6], [1.1], [1.7]]))).sum(axis=1)
    slope = np.array([CubicSpline(TIP, row)(TIP, 1) for row in force])
    wanted = rng.uniform(0.0, 8.0, 40)
    found = first_crossing(TIP, force, slope, wanted)
    expected = np.array([search(TIP, *row) for row in zip(force, slope, wanted, strict=True)])
    assert np.isnan(found).tolist() == np.isnan(expected).tolist()
    assert found == pytest.approx(expected, abs=2e-9, nan_ok=True)


def test_just_below_a_peak_between_two_tips_the_state_before_the_peak_counts():
    tip = np.array([0.0, 1.0, 2.0, 9.0])
    force, slope = np.array([[0.0, 1.0, 1.0, 8.0]]), np.array([[1.0, 1.0, -1.0, 2.0]])
    peak = 1.25
    assert first_crossing(tip, force, slope, np.array([peak - 1e-3]))[0] < 1.5
    assert first_crossing(tip, force, slope, np.array([peak + 1e-3]))[0] > 2.0


def test_no_force_is_no_dent_and_too_much_force_is_none():
    force, slope = np.tile(TIP, (3, 1)), np.ones((3, len(TIP)))
    found = first_crossing(TIP, force, slope, np.array([0.0, 7e-3, 7.001e-3]))
    assert found[:2] == pytest.approx([0.0, 7e-3], abs=1e-12)
    assert np.isnan(found[2])
