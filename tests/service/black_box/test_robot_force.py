import numpy as np
import pytest

from scleraforce.recording.folder import ForceInfo
from scleraforce.service.black_box.heard import RobotForce

INFO = ForceInfo("fy", -1)


@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 731.0])
def test_samples_are_the_means_of_what_came_in_each_hundredth_of_a_second(rate_hz):
    rng = np.random.default_rng(0)
    at_s = 50.0 + np.cumsum(rng.exponential(1 / rate_hz, 500))
    values = rng.standard_normal((500, 3))
    force = RobotForce(INFO)
    returned = [force.add(float(time_s), row.tolist(), "robot") for time_s, row in zip(at_s, values, strict=True)]
    steps = np.floor(at_s / 0.01).astype(int)
    expected = [((step + 0.5) * 0.01, values[steps == step].mean(axis=0)) for step in np.unique(steps)[:-1]]
    assert [sample for sample in returned if sample] == list(force.samples)
    assert [sample.at_s for sample in force.samples] == pytest.approx([middle_s for middle_s, _ in expected])
    assert np.allclose([sample.values for sample in force.samples], [mean for _, mean in expected])
    assert force.columns == ("fx_n", "fy_n", "fz_n")


def test_a_clock_that_stands_or_runs_back_makes_no_sample_twice():
    force = RobotForce(INFO)
    for at_s in (1.001, 1.011, 1.005, 1.011, 0.5, 1.021):
        force.add(at_s, [1.0], "robot")
    assert [sample.at_s for sample in force.samples] == pytest.approx([1.005, 1.015])


def test_one_number_is_the_axis_with_its_sign_and_six_have_torques():
    force = RobotForce(INFO)
    force.add(1.0, [0.25], "robot")
    assert force.add(2.0, [0.5], "robot").values == (-0.25,)
    assert force.columns == ("fy_n",)
    force = RobotForce(INFO)
    force.add(1.0, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "robot")
    assert force.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
    assert force.add(2.0, [0.0] * 6, "robot").values == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize("values", [[], [1.0, 2.0], [1.0] * 4, [float("nan")], [float("inf"), 0.0, 0.0]])
def test_what_is_no_force_is_refused_and_does_not_choose_the_source(values):
    force = RobotForce(INFO)
    assert force.add(1.0, values, "other") is None
    assert force.refused == 1
    force.add(1.0, [1.0], "robot")
    assert force.add(2.0, [1.0], "robot") is not None
    assert force.refused == 1


def test_memory_is_that_of_ten_minutes():
    force = RobotForce(INFO)
    for step in range(70_000):
        force.add(step * 0.01 + 0.005, [1.0], "robot")
    assert len(force.samples) == 60_000
    assert force.samples[-1].at_s - force.samples[0].at_s == pytest.approx(599.99)
