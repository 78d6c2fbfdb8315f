"""The reduced-order filter against the full-order one, filterpy, grids; sigma points,
gating, divergence.
"""

from itertools import product

import numpy as np
import pytest
from filterpy.kalman import UnscentedKalmanFilter

from scleraforce.base.arrays import Floats
from scleraforce.calibration.filter.unscented_filter import (
    RULES,
    FilterParams,
    Posterior,
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


def test_linear_observation_of_a_gaussian_gives_the_kalman_filter() -> None:
    for rule, iterations in product(RULES, (1, 4)):
        rng = np.random.default_rng(1)
        params = FilterParams(
            sigma_points(rule, 3), iterations=iterations, tolerance=0.0
        )
        mean = rng.normal(size=3)
        covariance = random_covariance(rng, 3)
        posterior = initial_posterior(mean, covariance)

        for _ in range(20):
            H = rng.normal(size=(5, 3))
            R = random_covariance(rng, 5, 0.5)
            y = rng.normal(size=5)
            posterior = filter_step(
                params, posterior, lambda x, H=H: x @ H.T, y, R
            ).posterior
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
) -> None:
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


def inverse_law(states: Floats) -> Floats:
    """Like a dent: proportional to 1/E, with E = exp(x)."""
    return np.exp(-states[:, :1]) * np.linspace(0.2, 1.0, 8)


def assimilate_inverse_law(iterations: int) -> Posterior:
    rng = np.random.default_rng(7)
    params = FilterParams(sigma_points("simplex", 1), iterations=iterations)
    posterior = initial_posterior(np.array([0.3]), np.array([[0.4]]))

    for _ in range(10):
        y = inverse_law(np.array([[-0.6]]))[0] + 0.02 * rng.normal(size=8)
        posterior = filter_step(
            params, posterior, inverse_law, y, 0.02**2 * np.eye(8)
        ).posterior

    return posterior


def test_iterating_a_step_is_honest_where_a_wide_prior_meets_a_curved_observation():
    for iterations, honest in ((8, True), (1, False)):
        found = assimilate_inverse_law(iterations)
        assert (
            abs(found.mean[0] + 0.6) < 2 * np.sqrt(found.covariance[0, 0])
        ) == honest


def valley(states: Floats) -> Floats:
    """Like the dents of a globe: shallow ones tell the first parameter, deep ones only
    both together.
    """
    shares = np.linspace(0.2, 1.0, 8)
    soft, sealed = (
        np.exp(np.clip(values, -40.0, 40.0))
        for values in (-states[:, :1], states[:, 1:])
    )
    return soft * shares - sealed * soft**2 * shares**3


def test_a_start_in_a_bent_valley_gives_the_posterior_of_a_grid_from_a_wide_prior():
    truth = np.array([[-1.0, 1.0]])
    noise = 0.05**2 * np.eye(8)
    y = valley(truth)[0] + 0.05 * np.random.default_rng(0).normal(size=8)
    axis = np.linspace(-4.0, 4.0, 801)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_weights = -0.5 * (((y - valley(grid)) / 0.05) ** 2).sum(axis=1) - 0.5 * (
        grid**2
    ).sum(axis=1)
    weights = np.exp(log_weights - log_weights.max())
    mean = np.average(grid, axis=0, weights=weights)
    sd = np.sqrt(np.diag(np.cov(grid.T, aweights=weights)))
    params = FilterParams(sigma_points("simplex", 2), iterations=30)
    prior = initial_posterior(np.zeros(2), np.eye(2))
    begun = filter_step(params, prior, valley, y, noise, start=truth[0] + [0.1, 0.2])
    assert begun.status == "ok"
    np.testing.assert_array_less(np.abs(begun.posterior.mean - mean), 0.2 * sd)
    np.testing.assert_allclose(
        np.sqrt(np.diag(begun.posterior.covariance)), sd, rtol=0.15
    )
    # does not find the way
    assert filter_step(params, prior, valley, y, noise).status.startswith("diverged")


def test_a_start_is_taken_only_if_it_explains_more_and_never_moves_a_linear_posterior():
    rng = np.random.default_rng(12)
    H = rng.normal(size=(5, 2))
    y = 5.0 * rng.normal(size=5)
    params = FilterParams(sigma_points("simplex", 2), iterations=8)
    prior = initial_posterior(np.zeros(2), np.eye(2))
    best = np.linalg.solve(np.eye(2) + H.T @ H, H.T @ y)
    none, far, near = (
        filter_step(params, prior, lambda x: x @ H.T, y, np.eye(5), start=at)
        for at in (None, np.full(2, 50.0), best + 0.1)
    )
    assert far.iterations == none.iterations
    np.testing.assert_array_equal(far.posterior.mean, none.posterior.mean)
    np.testing.assert_allclose(near.posterior.mean, none.posterior.mean, rtol=1e-9)
    np.testing.assert_allclose(
        near.posterior.covariance, none.posterior.covariance, rtol=1e-9
    )


def test_an_outlier_is_gated_and_reported_and_leaves_the_posterior_as_without_it():
    rng = np.random.default_rng(8)
    H = rng.normal(size=(10, 2))
    prior = initial_posterior(np.zeros(2), 25 * np.eye(2))
    params = FilterParams(sigma_points("simplex", 2), gate=4.0)
    y = H @ np.array([1.0, -2.0]) + 0.1 * rng.normal(size=10)
    y[6] += 3.0
    step = filter_step(params, prior, lambda x: x @ H.T, y, 0.01 * np.eye(10))
    rest = np.arange(10) != 6
    clean = filter_step(
        params, prior, lambda x: x @ H[rest].T, y[rest], 0.01 * np.eye(9)
    )
    assert (step.gated, step.observations, step.status) == ((6,), 9, "ok")
    np.testing.assert_allclose(step.posterior.mean, clean.posterior.mean)
    np.testing.assert_allclose(step.posterior.covariance, clean.posterior.covariance)


def test_a_frame_full_of_outliers_is_a_misfit_that_widens_the_noise() -> None:
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


def test_a_filter_whose_model_is_wrong_says_that_it_diverges() -> None:
    rng = np.random.default_rng(11)
    params = FilterParams(sigma_points("simplex", 1))
    posterior = initial_posterior(np.zeros(1), np.eye(1))
    statuses = []

    for frame in range(12):
        y = np.full(10, 0.5 * frame) + 0.1 * rng.normal(size=10)
        step = filter_step(
            params, posterior, lambda x: np.repeat(x, 10, axis=1), y, 0.01 * np.eye(10)
        )
        posterior = step.posterior
        statuses.append(step.status)

    assert statuses[0] == "ok"
    assert statuses[-1].startswith("diverged: over the last 5 frames")


def test_a_model_that_cannot_be_evaluated_or_rounding_keeps_the_posterior() -> None:
    """Rounding: two observations that are one, without noise, have no inverse of their
    covariance.
    """
    prior = initial_posterior(np.zeros(1), np.eye(1))
    sigma = sigma_points("simplex", 1)
    step = filter_step(
        FilterParams(sigma),
        prior,
        lambda x: np.full((2, 3), np.nan) * x,
        np.zeros(3),
        np.eye(3),
    )
    assert "cannot be evaluated at the sigma points" in step.status
    assert step.posterior is prior

    for iterations in (1, 10):
        params = FilterParams(sigma, iterations=iterations)
        same = np.array([1.0, 1.0])
        step = filter_step(
            params, prior, lambda x: np.repeat(x, 2, axis=1), same, np.zeros((2, 2))
        )
        assert step.status.startswith("diverged: the iteration left")
        assert step.posterior is prior


def test_a_precision_of_rounding_alone_has_no_covariance() -> None:
    """Two parameters that differ by less than rounding in an observation without noise
    to speak of.
    """
    params = FilterParams(sigma_points("simplex", 2))
    prior = initial_posterior(np.zeros(2), np.eye(2))
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(40, 1)) * [1.0, 2.0] + 1e-12 * rng.normal(
        size=(40, 2)
    )
    seen = [
        filter_step(
            params,
            prior,
            lambda x, d=d: 1e12 * x @ d[:, None] * [[1.0, 1.0]],
            np.ones(2),
            1e-9 * np.eye(2),
        )
        for d in directions
    ]
    diverged = [
        step for step in seen if step.status.startswith("diverged: the iteration left")
    ]
    assert diverged
    assert all(step.posterior is prior for step in diverged)

    for step in seen:
        assert (np.diag(step.posterior.covariance) > 0.0).all()


def test_every_rule_has_zero_mean_and_unit_covariance() -> None:
    for rule, dimension in product(RULES, (1, 2, 3, 7)):
        points, weights = sigma_points(rule, dimension)
        assert weights.sum() == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(weights @ points, 0.0, atol=1e-14)
        np.testing.assert_allclose(
            points.T @ (weights[:, None] * points), np.eye(dimension), atol=1e-13
        )

    assert [len(sigma_points(rule, 1).points_rp) for rule in RULES] == [2, 2, 3]
    corners = sigma_points("simplex", 4).points_rp
    distances = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    np.testing.assert_allclose(distances[~np.eye(5, dtype=bool)], distances[0, 1])
