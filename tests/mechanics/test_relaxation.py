"""Relaxation against closed forms and SciPy's solver of differential equations."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from scleraforce.base.errors import InputError
from scleraforce.mechanics.elastic_force import driven_back
from scleraforce.mechanics.tissue_material import PronySeries, line_weights

TISSUE = PronySeries((0.12, 0.15), (1.2, 12.0))
TURNS_S = np.array([0.0, 2.0, 3.0, 9.0, 9.5, 14.0, 20.0])
TURNS_N = np.array([0.0, 0.0, 0.03, 0.03, 0.05, 0.02, 0.04])


def uneven_times(count: int = 400) -> np.ndarray:
    """Uneven samples that hit every turning point of the path."""
    return np.union1d(TURNS_S, np.random.default_rng(0).uniform(0.0, 20.0, count))


def path(time_s: ArrayLike) -> np.ndarray:
    return np.asarray(np.interp(time_s, TURNS_S, TURNS_N), dtype=np.float64)


def felt(tissue: PronySeries, time_s: np.ndarray) -> np.ndarray:
    """F along the path without a look at contact."""
    return tissue.felt_along(TURNS_S.tolist(), TURNS_N.tolist(), time_s)


def test_a_ramp_and_hold_follow_the_closed_form():
    rise_s = 0.7
    hold_s = np.array([0.0, 0.3, 2.0, 11.0, 80.0])
    expected = np.full(len(hold_s), 1.0)

    for share, tau_s in zip(TISSUE.shares, TISSUE.times_s, strict=True):
        # 1 - m at the end of the ramp
        lag = tau_s / rise_s * (1.0 - np.exp(-rise_s / tau_s))
        expected -= share * (1.0 - lag * np.exp(-hold_s / tau_s))

    assert TISSUE.felt_along(
        [0.0, rise_s], [0.0, 1.0], rise_s + hold_s
    ) == pytest.approx(expected, rel=1e-12)


def test_the_felt_force_agrees_with_a_solver_of_differential_equations():
    tau = np.array(TISSUE.times_s)
    memory = np.zeros(2)
    ends = []

    for begin_s, end_s in pairwise(TURNS_S):  # the solver does not see the corners
        solved = solve_ivp(
            lambda t, m: (path(t) - m) / tau,
            (begin_s, end_s),
            memory,
            rtol=1e-11,
            atol=1e-15,
        )
        memory = solved.y[:, -1]
        ends.append(path(end_s) - memory @ TISSUE.shares)

    assert felt(TISSUE, TURNS_S[1:]) == pytest.approx(ends, abs=1e-11)


def test_elastic_force_and_memory_come_back_from_the_felt_force_for_each_candidate():
    time_s = uneven_times()
    shares = np.array([TISSUE.shares, (0.0, 0.0)])
    felt_n = felt(TISSUE, time_s)
    elastic_n, memories_n = driven_back(
        felt_n, time_s, np.ones(len(time_s), dtype=bool), shares, TISSUE.times_s
    )
    assert elastic_n[0] == pytest.approx(path(time_s), abs=1e-13)
    assert path(time_s) - memories_n[0] @ shares[0] == pytest.approx(felt_n, abs=1e-13)
    assert np.array_equal(elastic_n[1], felt_n)


def test_memory_decays_where_contact_is_lost_and_is_felt_in_the_next_push():
    time_s = np.array([0.0, 1.0, 20.0, 20.001, 25.0, 25.001])
    contact = np.array([False, True, True, False, False, True])
    (elastic_n,), (memories_n,) = driven_back(
        np.array([0.0, 0.9, 0.75, 0.0, 0.0, 0.8]),
        time_s,
        contact,
        np.array([TISSUE.shares]),
        TISSUE.times_s,
    )
    assert (elastic_n[[0, 3, 4]] == 0.0).all()
    assert memories_n[4] == pytest.approx(
        memories_n[3] * np.exp(-4.999 / np.array(TISSUE.times_s)), rel=1e-9
    )
    assert elastic_n[5] == pytest.approx(0.8 + memories_n[5] @ TISSUE.shares, rel=1e-9)
    assert elastic_n[5] > 0.8 + 0.9 * 0.15 * memories_n[4, 1]


@pytest.mark.parametrize("x", [1e-12, 1e-6, 0.9e-3, 1.1e-3, 0.5, 40.0])
def test_weights_keep_their_digits(x: float):
    old, kept, new = line_weights(np.array([x]), (1.0,))[0, :, 0]
    term = x / 2
    exact_new = 0.0
    for power in range(3, 200):  # 1 - q = x/2! - x^2/3! + ...
        exact_new = exact_new + term
        term = -term * x / power

    assert new == pytest.approx(exact_new if x < 5.0 else 1.0 - 1.0 / x, rel=1e-11)
    assert old + kept + new == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("shares", "times_s"),
    [
        ((0.6, 0.5), (1.0, 10.0)),
        ((-0.1,), (1.0,)),
        ((0.1,), (0.0,)),
        ((0.1,), ()),
        ((float("nan"),), (1.0,)),
    ],
)
def test_an_impossible_series_is_refused(
    shares: tuple[float, ...], times_s: tuple[float, ...]
):
    with pytest.raises(InputError, match="relaxation"):
        PronySeries(shares, times_s)
