"""Punctures in force logs: sudden falls to friction, not retractions; the frames after them, in the same push."""

import numpy as np
import pytest

from scleraforce.recording.puncture import after_punctures, log_punctures
from scleraforce.recording.tables import ForceLog

RATE_HZ = 100.0
NO_TRAVEL = np.full(1200, np.nan)


def log_of(corners: list[tuple[float, float]], noise_n: float = 1e-3, seed: int = 0) -> tuple[ForceLog, np.ndarray]:
    """A log of 12 s whose force is straight between corners (s, mN), with noise."""
    time_s = np.arange(1200) / RATE_HZ
    force_n = np.interp(time_s, *np.array(corners).T) * 1e-3
    force_n += np.random.default_rng(seed).normal(0.0, noise_n, len(time_s))
    return ForceLog(time_s, force_n[:, None], ("fz_n",)), force_n


THROUGH = [(2.0, 0.0), (3.5, 30.0), (3.503, 9.0), (5.0, 9.0), (5.5, -9.0), (6.5, -9.0), (6.505, 0.0)]


def test_a_sudden_fall_to_friction_is_a_puncture_and_slow_or_whole_ones_are_not() -> None:
    for noise_n in (1e-4, 1e-3, 4e-3):
        log, force_n = log_of([(2.0, 0.0), (3.5, 45.0), (3.503, 13.0), (9.0, 13.0)], noise_n)
        assert log_punctures(log, force_n, NO_TRAVEL) == [pytest.approx(3.5, abs=0.03)]
    retracts = [(2.0, 0.0), (3.5, 30.0), (3.7, 9.0), (5.0, 9.0)]  # within 0.2 s
    lets_go = [(2.0, 0.0), (3.5, 30.0), (3.503, 0.0)]
    for corners in (retracts, lets_go, [(2.0, 0.0), (3.5, 30.0)], [(2.0, 0.0), (2.003, 30.0)]):
        for seed in range(20):
            log, force_n = log_of(corners, 1e-3, seed)
            assert log_punctures(log, force_n, NO_TRAVEL) == []


def test_a_needle_that_was_drawn_back_as_fast_explains_a_fall() -> None:
    log, force_n = log_of(THROUGH)
    back_m = np.interp(log.time_s, [3.49, 3.52], [2e-3, 1.5e-3])
    assert log_punctures(log, force_n, back_m) == []
    assert len(log_punctures(log, force_n, 1e-3 * log.time_s)) == 1


def test_the_frames_of_a_push_after_its_puncture_are_pierced_and_the_next_push_is_not() -> None:
    log, force_n = log_of([*THROUGH, (8.0, 0.0), (9.0, 20.0), (11.0, 20.0)], 1e-4)
    times_s = np.array([3.4, 3.6, 4.5, 5.25, 6.0, 8.5, 10.0])
    found = after_punctures(times_s, log_punctures(log, force_n, NO_TRAVEL), log.time_s, force_n)
    assert found == [False, True, True, True, True, False, False]
    assert after_punctures(times_s, [], log.time_s, force_n) == [False] * 7
    assert after_punctures(np.array([1.0, 3.0]), [2.0], np.zeros(0), np.zeros(0)) == [False, True]
