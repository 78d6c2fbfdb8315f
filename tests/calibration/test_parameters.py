import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.calibration.eye_model import Parameter, ParameterSpace, spread


@given(mean=st.floats(1e-3, 1e6), ratio=st.floats(0.01, 3.0), positive=st.booleans())
def test_prior_has_the_moments_that_were_asked_for(mean: float, ratio: float, positive: bool) -> None:
    space = ParameterSpace((Parameter("x", mean=mean, sd=ratio * mean, positive=positive),))
    (found_mean,), (found_sd,) = space.moments(*space.prior())
    assert found_mean == pytest.approx(mean)
    assert found_sd == pytest.approx(ratio * mean)


def test_lognormal_moments_equal_those_of_a_large_sample() -> None:
    space = ParameterSpace((Parameter("x", mean=2.0, sd=1.0),))
    mean, covariance = space.prior()
    drawn = np.random.default_rng(0).normal(mean[0], np.sqrt(covariance[0, 0]), (200_000, 1))
    values = space.values(drawn)
    assert values.mean() == pytest.approx(2.0, rel=0.01)
    assert values.std() == pytest.approx(1.0, rel=0.02)


@given(st.floats(-50.0, 50.0))
def test_a_positive_parameter_is_positive_at_any_coordinate(coordinate: float) -> None:
    space = ParameterSpace((Parameter("x", mean=0.49, sd=0.34),))
    assert space.values(np.array([coordinate]))[0] > 0


def test_an_unchanged_parameter_may_become_negative() -> None:
    space = ParameterSpace((Parameter("x", mean=0.49, sd=0.34, positive=False),))
    assert space.values(np.array([-1.0]))[0] == pytest.approx(-0.49)


def test_mixed_space_treats_each_parameter_by_its_own_rule() -> None:
    space = ParameterSpace((Parameter("a", mean=2.0, sd=1.0), Parameter("b", mean=3.0, sd=0.5, positive=False)))
    np.testing.assert_allclose(space.values(np.array([[0.0, 1.0]])), [[2.0, 3.0]])


@pytest.mark.parametrize(("mean", "sd"), [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0)])
def test_a_prior_without_width_or_sign_is_refused(mean: float, sd: float) -> None:
    with pytest.raises(ValueError, match="x: a prior"):
        Parameter("x", mean=mean, sd=sd)


def test_spread_is_the_sample_standard_deviation() -> None:
    assert spread([0.27, 0.22, 0.24, 0.29]) == pytest.approx((0.255, np.std([0.27, 0.22, 0.24, 0.29], ddof=1)))
    assert spread([0.3]) == (0.3, None)


@pytest.mark.parametrize("either_sign", [False, True])
def test_what_is_no_number_is_no_eye(either_sign: bool) -> None:
    space = ParameterSpace((Parameter("x", mean=1.0, sd=1.0, positive=False, either_sign=either_sign),))
    values = np.array([[1.0], [-1.0], [np.nan], [np.inf], [-np.inf]])
    assert space.exist(values).tolist() == [True, either_sign, False, False, False]
