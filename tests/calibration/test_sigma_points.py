import numpy as np
import pytest

from scleraforce.calibration.roukf import RULES, sigma_points


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("dimension", [1, 2, 3, 7])
def test_every_rule_has_zero_mean_and_unit_covariance(rule: str, dimension: int) -> None:
    points, weights = sigma_points(rule, dimension)
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(weights @ points, 0.0, atol=1e-14)
    np.testing.assert_allclose(points.T @ (weights[:, None] * points), np.eye(dimension), atol=1e-13)


@pytest.mark.parametrize(("rule", "count"), [("simplex", 2), ("canonical", 2), ("star", 3)])
def test_one_parameter_takes_as_many_points_as_the_rule_says(rule: str, count: int) -> None:
    assert len(sigma_points(rule, 1).points_rp) == count


def test_simplex_corners_lie_on_one_sphere_at_equal_distances() -> None:
    points = sigma_points("simplex", 4).points_rp
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 2.0)
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1)
    np.testing.assert_allclose(distances[~np.eye(5, dtype=bool)], distances[0, 1])


@pytest.mark.parametrize(("rule", "dimension"), [("cubature", 2), ("simplex", 0)])
def test_a_rule_that_does_not_exist_is_refused(rule: str, dimension: int) -> None:
    with pytest.raises(ValueError, match="sigma points"):
        sigma_points(rule, dimension)
