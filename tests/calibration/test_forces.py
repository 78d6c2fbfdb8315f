from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_recordings import LOGGED_INFO

from scleraforce.calibration.forces import ZERO_PRIOR, frame_forces, rest_zeros, zero_line
from scleraforce.recording.folder import ForceInfo, Recording
from scleraforce.recording.labels import label_frames, low_pass
from scleraforce.recording.tables import ForceLog, FrameEntry
from scleraforce.study import ClassesStudy


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


def test_samples_that_are_no_forces_and_frames_without_a_label_leave_the_others_as_they_are() -> None:
    _, time_s, frames_s, _ = pushes(0.0, np.random.default_rng(3))
    phase = (time_s - 4) % 10
    fz_n = -np.where((time_s > 4) & (time_s < 204) & (phase < 8), 20e-3, 0.0)
    fz_n += 1e-3 * np.random.default_rng(4).standard_normal(len(time_s))
    holed_n = np.where(np.abs(time_s - frames_s[7]) < 1.5, np.nan, fz_n)
    found = []
    for force_n in (fz_n, holed_n):
        log = ForceLog(time_s, force_n[:, None], ("fz_n",))
        frames = tuple(FrameEntry(f"{k}.png", at) for k, at in enumerate(frames_s.tolist()))
        recording = Recording(Path("rec"), replace(LOGGED_INFO, force=ForceInfo("fz", -1, 2.0)), frames, log)
        trials = label_frames(recording, ClassesStudy())
        found.append(frame_forces(replace(recording, forces=log.known("fz")), trials))
    assert np.flatnonzero(np.isnan(found[1].force_n)).tolist() == [7]
    known = np.isfinite(found[1].force_n)
    np.testing.assert_allclose(found[1].force_n[known], found[0].force_n[known], atol=1e-4)
    assert np.isfinite(found[1].zero).all()
