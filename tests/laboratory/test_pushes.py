from itertools import pairwise

import numpy as np
import pytest

from scleraforce.laboratory.pushes import format_log, plan_pushes, sample_sensor, sense, true_force
from scleraforce.study import PhantomStudy

FORCES_N = (0.002, 0.02, 0.0, 0.055)


def acquisition(seed=0, **changes):
    phantom = PhantomStudy(**changes)
    rng = np.random.default_rng(seed)
    pushes = plan_pushes(FORCES_N, phantom, rng)
    sensor = sample_sensor(phantom, rng)
    return pushes, sensor, sense(pushes, sensor, 2, -1, pushes[-1].end_s + 1.0, rng)


def test_true_force_at_each_frame_is_the_one_asked_for():
    pushes, _, _ = acquisition()
    assert true_force(pushes, np.array([push.frame_s for push in pushes])) == pytest.approx(FORCES_N, abs=1e-12)


def test_force_relaxes_while_the_needle_holds_and_is_zero_between_pushes():
    pushes, _, _ = acquisition()
    push = pushes[3]
    hold_s = push.start_s + push.ramp_s + np.linspace(0.0, push.hold_s, 200)
    held = true_force(pushes, hold_s)
    assert (np.diff(held) < 0.0).all()
    loss = 1.0 - held[-1] / held[0]
    assert loss == pytest.approx(push.relaxation_fraction * (1 - np.exp(-push.hold_s / push.relaxation_time_s)))
    between_s = np.array([(a.end_s + b.start_s) / 2 for a, b in pairwise(pushes)])
    assert (true_force(pushes, np.r_[0.0, between_s]) == 0.0).all()


def test_log_runs_at_its_rate_and_in_sensor_steps():
    _, _, log = acquisition()
    assert np.diff(log[:, 0]) == pytest.approx(1 / 200.0)
    steps = log[:, 1:4] / 5e-3
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    assert np.diff(acquisition(sample_rate_hz=500.0)[2][:, 0]) == pytest.approx(1 / 500.0)


def test_log_is_the_contact_force_with_sign_offset_drift_and_noise():
    pushes, sensor, log = acquisition(force_step_n=0.0)
    rest = log[:, 3] + true_force(pushes, log[:, 0]) - sensor.offset_n[2] - sensor.drift_n_per_s * log[:, 0]
    assert rest.std() == pytest.approx(sensor.noise_n, rel=0.03)
    assert abs(rest.mean()) < 4 * sensor.noise_n / np.sqrt(len(rest))
    assert np.corrcoef(rest[1:], rest[:-1])[0, 1] == pytest.approx(0.0, abs=0.05)
    assert log[:, 4:].std() == pytest.approx(sensor.torque_noise_nm, rel=0.05)


def test_lateral_axes_see_their_share_of_the_force():
    pushes, sensor, log = acquisition(force_step_n=0.0)
    force_n = true_force(pushes, log[:, 0])
    for column, share in ((1, sensor.cross_talk_fraction[0]), (2, sensor.cross_talk_fraction[1])):
        slope, offset = np.polyfit(force_n, log[:, column], 1)
        assert slope == pytest.approx(share, abs=0.01)
        assert offset == pytest.approx(sensor.offset_n[column - 1], abs=3e-4)


def test_csv_has_the_columns_and_digits_of_a_recording():
    lines = format_log(np.array([[0.005, -0.0, 0.015, -0.01, 1.23456e-4, -0.0, 0.0]])).splitlines()
    assert lines == [
        "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm",
        "0.0050,0.0000,0.0150,-0.0100,0.00012,0.00000,0.00000",
    ]
