"""The reduced-order filter against the full-order one and filterpy; sigma points,
misfits.
"""

from collections.abc import Callable

import numpy as np
import pytest
from filterpy.kalman import UnscentedKalmanFilter

from scleraforce.base.arrays import Floats
from scleraforce.calibration.filter.unscented_filter import (
    RULES,
    FilterParams,
    SigmaPoints,
    filter_step,
    initial_posterior,
    sigma_points,
)


def random_covariance(
    rng: np.random.Generator, size: int, scale: float = 1.0
) -> Floats:
    root = rng.normal(size=(size, size)) * scale
    return root @ root.T + scale**2 * np.eye(size)


def bent(states: Floats) -> Floats:
    """Observe p = 3 parameters through five functions that are not linear."""
    a = states[..., 0]
    b = states[..., 1]
    c = states[..., 2]
    return np.stack([a * b, np.sin(c), a + c**2, np.tanh(0.3 * b), a - b], axis=-1)


class PointsForFilterPy:
    """The rule under test in FilterPy's interface."""

    def __init__(self, sigma: SigmaPoints) -> None:
        self.sigma = sigma
        self.Wm = self.Wc = sigma.weights_r

    def num_sigmas(self) -> int:
        return len(self.Wm)

    def sigma_points(self, x: Floats, P: Floats) -> Floats:
        return x + self.sigma.points_rp @ np.linalg.cholesky(P).T


@pytest.mark.parametrize("iterations", [1, 4])
@pytest.mark.parametrize("rule", RULES)
def test_linear_observation_of_a_gaussian_gives_the_kalman_filter(
    rule: str, iterations: int
):
    rng = np.random.default_rng(1)
    params = FilterParams(sigma_points(rule, 3), iterations=iterations, tolerance=0.0)
    mean = rng.normal(size=3)
    covariance = random_covariance(rng, 3)
    posterior = initial_posterior(mean, covariance)

    for _ in range(20):
        H = rng.normal(size=(5, 3))
        R = random_covariance(rng, 5, 0.5)
        y = rng.normal(size=5)
        step = filter_step(params, posterior, lambda x, H=H: x @ H.T, y, R)
        posterior = step.posterior
        gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
        mean = mean + gain @ (y - H @ mean)
        covariance = (np.eye(3) - gain @ H) @ covariance
        np.testing.assert_allclose(posterior.mean, mean, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(
            posterior.covariance, covariance, rtol=1e-10, atol=1e-10
        )


@pytest.mark.parametrize("rule", RULES)
def test_every_step_equals_filterpys_full_order_ukf_with_the_same_points(
    rule: str,
):
    rng = np.random.default_rng(4)
    sigma = sigma_points(rule, 3)
    peer = UnscentedKalmanFilter(
        3, 5, 1.0, bent, lambda x, _: x, PointsForFilterPy(sigma)
    )
    peer.x = rng.normal(size=3)
    peer.P = random_covariance(rng, 3, 0.5)
    peer.Q = np.zeros((3, 3))
    posterior = initial_posterior(peer.x, peer.P)

    for _ in range(15):
        peer.R = random_covariance(rng, 5, 0.3)
        y = rng.normal(size=5)
        peer.predict()
        peer.update(y)
        posterior = filter_step(
            FilterParams(sigma), posterior, bent, y, peer.R
        ).posterior
        np.testing.assert_allclose(posterior.mean, peer.x, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(posterior.covariance, peer.P, rtol=1e-8, atol=1e-10)


def test_a_frame_full_of_outliers_is_a_misfit_that_widens_the_noise():
    rng = np.random.default_rng(10)
    H = rng.normal(size=(10, 2))
    y = 50 * rng.normal(size=10)
    prior = initial_posterior(np.zeros(2), np.eye(2))
    sigma = sigma_points("simplex", 2)
    step = filter_step(
        FilterParams(sigma, gate=4.0, inflate=True),
        prior,
        lambda x: x @ H.T,
        y,
        0.01 * np.eye(10),
    )
    assert step.gated == ()
    assert step.inflation == pytest.approx(step.nis / 10)
    assert step.inflation > 100
    fitted = filter_step(
        FilterParams(sigma),
        prior,
        lambda x: x @ H.T,
        y,
        0.01 * step.inflation * np.eye(10),
    )
    np.testing.assert_allclose(step.posterior.covariance, fitted.posterior.covariance)


@pytest.mark.parametrize(
    ("observe", "noise", "status"),
    [
        (lambda x: np.nan * x, 1.0, "cannot be evaluated at the sigma points"),
        # two observations that are one have no inverse of their covariance
        (lambda x: np.repeat(x, 2, axis=1), 0.0, "diverged: the iteration left"),
    ],
)
def test_a_model_that_cannot_be_evaluated_or_rounding_keeps_the_posterior(
    observe: Callable[[Floats], Floats], noise: float, status: str
):
    prior = initial_posterior(np.zeros(1), np.eye(1))
    params = FilterParams(sigma_points("simplex", 1))
    y = np.ones(len(observe(np.ones((1, 1)))[0]))
    step = filter_step(params, prior, observe, y, noise * np.eye(len(y)))
    assert status in step.status
    assert step.posterior is prior


@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
@pytest.mark.parametrize("rule", RULES)
def test_every_rule_has_zero_mean_and_unit_covariance(rule: str, dimension: int):
    points, weights = sigma_points(rule, dimension)
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(weights @ points, 0.0, atol=1e-14)
    np.testing.assert_allclose(
        points.T @ (weights[:, None] * points), np.eye(dimension), atol=1e-13
    )
