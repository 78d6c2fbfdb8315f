"""Relaxation against closed forms, SciPy's solver of differential equations and the convolution with G."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import quad, solve_ivp

from scleraforce.errors import InputError
from scleraforce.mechanics.relaxation import Memory, PronySeries, after_gap, after_line, line_weights, unknown_memory

TISSUE = PronySeries((0.12, 0.15), (1.2, 12.0))
TURNS_S, TURNS_N = np.array([0.0, 2.0, 3.0, 9.0, 9.5, 14.0, 20.0]), np.array([0.0, 0.0, 0.03, 0.03, 0.05, 0.02, 0.04])


def uneven_times(count: int = 400) -> np.ndarray:
    """Uneven samples that hit every turning point of the path."""
    return np.union1d(TURNS_S, np.random.default_rng(0).uniform(0.0, 20.0, count))


def path(time_s: ArrayLike) -> np.ndarray:
    return np.asarray(np.interp(time_s, TURNS_S, TURNS_N), dtype=np.float64)


def test_a_ramp_and_hold_follow_the_closed_form() -> None:
    rise_s, hold_s = 0.7, np.array([0.0, 0.3, 2.0, 11.0, 80.0])
    expected = np.full(len(hold_s), 1.0)
    for share, tau_s in zip(TISSUE.shares, TISSUE.times_s, strict=True):
        lag = tau_s / rise_s * (1.0 - np.exp(-rise_s / tau_s))  # 1 - m at the end of the ramp
        expected -= share * (1.0 - lag * np.exp(-hold_s / tau_s))
    felt = TISSUE.felt(np.array([0.0, *np.ones(len(hold_s))]), np.array([0.0, *(rise_s + hold_s)]))
    assert felt[1:] == pytest.approx(expected, rel=1e-12)


def test_a_fast_rise_leaves_the_share_g() -> None:
    held_s = np.array([0.1, 1.0, 10.0, 100.0])
    felt = TISSUE.felt(np.array([0.0, *np.ones(5)]), np.array([0.0, 1e-9, *held_s]))
    assert felt[2:] == pytest.approx(TISSUE.left(held_s), abs=1e-8)


def test_the_update_agrees_with_a_solver_of_differential_equations() -> None:
    time_s, tau = uneven_times(), np.array(TISSUE.times_s)
    memory, ends = np.zeros(2), []
    for begin_s, end_s in pairwise(TURNS_S):  # the solver does not see the corners
        solved = solve_ivp(lambda t, m: (path(t) - m) / tau, (begin_s, end_s), memory, rtol=1e-11, atol=1e-15)
        memory = solved.y[:, -1]
        ends.append(path(end_s) - memory @ TISSUE.shares)
    at_turns = TISSUE.felt(path(time_s), time_s)[np.isin(time_s, TURNS_S[1:])]
    assert at_turns == pytest.approx(ends, abs=1e-11)


def test_the_update_agrees_with_the_convolution() -> None:
    time_s, slopes = uneven_times(), np.diff(TURNS_N) / np.diff(TURNS_S)
    felt = TISSUE.felt(path(time_s), time_s)
    for index in (150, 250, 390):
        now_s, expected = time_s[index], 0.0
        for begin_s, end_s, slope in zip(TURNS_S[:-1], TURNS_S[1:], slopes, strict=True):
            upto_s = min(end_s, now_s)
            if upto_s > begin_s:
                left = quad(lambda s, now_s=now_s: float(TISSUE.left(np.array(now_s - s))), begin_s, upto_s)[0]
                expected += slope * left
        assert felt[index] == pytest.approx(expected, abs=1e-12)


def test_the_elastic_force_comes_back_from_the_felt_one_through_losses_of_contact() -> None:
    time_s = uneven_times()
    elastic_n = np.where((time_s > 11.0) & (time_s < 12.5), 0.0, path(time_s))
    elastic_n[-41:-1] *= np.linspace(1.0, 1e-3, 40)  # a withdrawal: the wall lags, the needle leaves it before Fe is 0
    elastic_n[-1] = 0.05  # and comes back at once
    felt_n = TISSUE.felt(elastic_n, time_s)
    lost = (elastic_n > 0.0) & (felt_n == 0.0)
    assert lost.any()
    found_n = TISSUE.elastic(felt_n, time_s, felt_n > 0.0)
    assert found_n == pytest.approx(np.where(lost, 0.0, elastic_n), abs=1e-14)


def test_memory_after_lost_contact_decays_and_is_still_felt() -> None:
    time_s = np.array([0.0, 1.0, 20.0, 20.001, 25.0, 25.001])
    felt_n = TISSUE.felt(np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0]), time_s)
    assert felt_n[3] == felt_n[4] == 0.0
    fresh = TISSUE.felt(np.array([0.0, 1.0]), np.array([0.0, 0.001]))[-1]
    remembered = 0.15 * (1.0 - np.exp(-19.5 / 12.0)) * np.exp(-5.0 / 12.0)
    assert fresh - felt_n[5] == pytest.approx(remembered, rel=0.05)


def test_tissue_without_shares_feels_the_elastic_force() -> None:
    time_s = uneven_times()
    assert np.array_equal(PronySeries((), ()).felt(path(time_s), time_s), path(time_s))


@pytest.mark.parametrize("x", [1e-12, 1e-6, 0.9e-3, 1.1e-3, 0.5, 40.0])
def test_weights_keep_their_digits(x: float) -> None:
    old, kept, new = line_weights(np.array([x]), (1.0,))[0, :, 0]
    term, exact_new = x / 2, 0.0
    for power in range(3, 200):  # 1 - q = x/2! - x^2/3! + ...
        exact_new, term = exact_new + term, -term * x / power
    assert new == pytest.approx(exact_new if x < 5.0 else 1.0 - 1.0 / x, rel=1e-11)
    assert old + kept + new == pytest.approx(1.0, rel=1e-15)


def test_bounds_of_a_gap_hold_every_path_in_it_and_are_reached() -> None:
    rng, times_s = np.random.default_rng(1), TISSUE.times_s
    bounds = after_gap(unknown_memory(2, 0.06), 3.0, (0.01, 0.04), times_s)
    for _ in range(200):
        memory = rng.uniform(0.0, 0.06, 2)
        steps_s, forces_n = rng.dirichlet(np.ones(30)) * 3.0, rng.uniform(0.01, 0.04, 31)
        for index, weights in enumerate(line_weights(steps_s, times_s)):
            memory = weights[0] * forces_n[index] + weights[1] * memory + weights[2] * forces_n[index + 1]
        assert np.all(bounds.smallest_n <= memory)
        assert np.all(memory <= bounds.largest_n)
    high = after_line(Memory(np.full(2, 0.06), np.full(2, 0.06)), 3.0, (0.04, 0.04), (0.04, 0.04), times_s)
    assert high.largest_n == pytest.approx(bounds.largest_n, rel=1e-12)


def test_bounds_of_the_felt_force_hold_every_share_in_its_range() -> None:
    memory = Memory(np.array([0.01, 0.005]), np.array([0.02, 0.03]))
    low_n, high_n = memory.felt((0.03, 0.032), (np.array([0.1, 0.1]), np.array([0.2, 0.3])))
    assert low_n == pytest.approx(0.03 - 0.2 * 0.02 - 0.3 * 0.03)
    assert high_n == pytest.approx(0.032 - 0.1 * 0.01 - 0.1 * 0.005)


@pytest.mark.parametrize(
    ("shares", "times_s"),
    [((0.6, 0.5), (1.0, 10.0)), ((-0.1,), (1.0,)), ((0.1,), (0.0,)), ((0.1,), ()), ((float("nan"),), (1.0,))],
)
def test_an_impossible_series_is_refused(shares: tuple[float, ...], times_s: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="relaxation"):
        PronySeries(shares, times_s)
