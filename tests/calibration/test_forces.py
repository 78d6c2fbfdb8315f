import numpy as np
import pytest

from scleraforce.calibration.forces import ZERO_PRIOR, rest_zeros, zero_line
from scleraforce.recording.labels import low_pass


def pushes(drift_n_per_s: float, rng: np.random.Generator, lets_go: bool = True) -> tuple[np.ndarray, ...]:
    """A log of 20 pushes of 8 s with 2 s of rest, noise of 4 mN at 200 Hz."""
    time_s = np.arange(0, 210, 0.005)
    phase = (time_s - 4) % 10
    held = (time_s > 4) & (time_s < 204) & ((phase < 8) if lets_go else True)
    force = np.where(held, 20e-3, 0.0) + drift_n_per_s * time_s + 4e-3 * rng.standard_normal(len(time_s))
    frames_s = 4 + 10 * np.arange(20) + 5.0
    return low_pass(force, time_s), time_s, frames_s, np.full(20, 20e-3)


@pytest.mark.parametrize("drift", [-5e-6, 0.0, 5e-6])
def test_rests_show_offset_and_drift_of_the_sensor(drift: float) -> None:
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(8):
        zero, covariance = zero_line(*rest_zeros(*pushes(drift, rng)))
        at = np.array([1.0, 100.0])
        errors.append((at @ zero - drift * 100.0) / np.sqrt(at @ covariance @ at))
    assert np.abs(np.mean(errors)) < 1.2
    assert np.std(errors) < 2.0


def test_a_needle_that_never_lets_go_leaves_the_tare_as_it_is() -> None:
    zero, covariance = zero_line(*rest_zeros(*pushes(0.0, np.random.default_rng(1), lets_go=False)))
    np.testing.assert_array_equal(zero, 0.0)
    np.testing.assert_allclose(covariance, ZERO_PRIOR)


def test_weak_pushes_are_not_taken_for_rests() -> None:
    contact, time_s, frames_s, forces = pushes(0.0, np.random.default_rng(2))
    assert len(rest_zeros(contact, time_s, frames_s, forces)[0]) == 19
    assert len(rest_zeros(contact, time_s, frames_s, 0.1 * forces)[0]) == 0
