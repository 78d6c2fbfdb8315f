"""Forces under frames: rests, drift, and the errors of labels."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from relaxing_eyes import sensed
from small_recordings import LOGGED_INFO

from scleraforce.lab.virtual_eye import paper_eyes
from scleraforce.lab.virtual_recording import plan_phantom
from scleraforce.recordings.force_errors import (
    ZERO_PRIOR,
    FrameForces,
    frame_forces,
    label_sds,
)
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    ForceLog,
    FrameEntry,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.study import ClassesStudy, PhantomStudy, Study, fixed

CLASSES = ClassesStudy()


def recording_of(
    time_s: np.ndarray,
    wrench_sc: np.ndarray,
    frames_s: list[float],
    average_s: float = 2.0,
) -> Recording:
    frames = tuple(
        FrameEntry(f"{number}.png", time) for number, time in enumerate(frames_s)
    )
    info = replace(LOGGED_INFO, force=ForceInfo("fz", -1, average_s))

    return Recording(
        Path("rec"), info, frames, ForceLog(time_s, wrench_sc, FORCE_COLUMNS[1:])
    )


PUSHES_S = 4.0 + 10.0 * np.arange(20)
AT_100_S = np.array([1.0, 100.0])
FRAMES_S = (PUSHES_S + 5.0).tolist()


def pushes(
    drift_n_per_s: float,
    rng: np.random.Generator,
    lets_go: bool = True,
    push_n: float = 20e-3,
    noise_n: float = 4e-3,
) -> tuple[np.ndarray, np.ndarray]:
    """Times and wrenches of 20 pushes of 8 s with 2 s of rest, with noise, at
    200 Hz.
    """
    time_s = np.arange(0, 210, 0.005)
    phase_s = (time_s - 4) % 10
    held = (time_s > 4) & (time_s < 204) & ((phase_s < 8) if lets_go else True)
    wrench_sc = np.zeros((len(time_s), 6))
    wrench_sc[:, 2] = -(
        np.where(held, push_n, 0.0)
        + drift_n_per_s * time_s
        + noise_n * rng.standard_normal(len(time_s))
    )
    return time_s, wrench_sc


def forces_of(time_s: np.ndarray, wrench_sc: np.ndarray) -> FrameForces:
    recording = recording_of(time_s, wrench_sc, FRAMES_S)
    known = replace(recording, forces=recording.forces.known("fz"))
    return frame_forces(known, label_frames(recording, CLASSES))


@pytest.mark.parametrize("drift", [-5e-6, 0.0, 5e-6])
def test_rests_show_offset_and_drift_of_the_sensor(drift: float):
    rng = np.random.default_rng(0)
    errors = []

    for _ in range(8):
        found = forces_of(*pushes(drift, rng))
        sd_n = np.sqrt(AT_100_S @ found.zero_covariance @ AT_100_S)
        errors.append((AT_100_S @ found.zero - drift * 100.0) / sd_n)

    assert np.abs(np.mean(errors)) < 1.2
    assert np.std(errors) < 2.0


@pytest.mark.parametrize("push", [{"lets_go": False}, {"push_n": 2e-3}])
def test_a_needle_that_never_lets_go_or_hardly_pushes_has_no_rests(
    push: dict[str, Any],
):
    found = forces_of(*pushes(0.0, np.random.default_rng(1), **push))
    np.testing.assert_array_equal(found.zero, 0.0)
    np.testing.assert_allclose(found.zero_covariance, ZERO_PRIOR)


@pytest.mark.parametrize("drift", [-2e-5, 2e-5])
def test_forces_are_freed_of_most_of_the_drift(drift: float):
    found = forces_of(*pushes(drift, np.random.default_rng(5), noise_n=1e-3))
    assert abs(np.polyfit(FRAMES_S, found.force_n, 1)[0]) < 0.6 * abs(drift)


def test_samples_and_frames_without_a_force_leave_the_others_unchanged():
    time_s, wrench_sc = pushes(0.0, np.random.default_rng(3), noise_n=1e-3)
    holed_sc = wrench_sc.copy()
    holed_sc[np.abs(time_s - FRAMES_S[7]) < 1.5, 2] = np.nan
    whole, holed = (forces_of(time_s, each) for each in (wrench_sc, holed_sc))
    assert np.flatnonzero(np.isnan(holed.force_n)).tolist() == [7]
    known = np.isfinite(holed.force_n)
    np.testing.assert_allclose(holed.force_n[known], whole.force_n[known], atol=1e-4)
    assert np.isfinite(holed.zero).all()


def errors_and_sds(phantom: PhantomStudy, seeds: int) -> Iterator[tuple[float, float]]:
    """Yield the error of each label of virtual logs of the paper's pushes, N, and its
    stated standard deviation.
    """
    study = replace(Study(), phantom=phantom)
    for seed in range(seeds):
        for eye, forces_n in paper_eyes(study):
            plan = plan_phantom(eye, forces_n, study, seed)
            log = sensed(plan.path, plan.sensor, np.random.default_rng(seed))
            recording = recording_of(
                log.time_s, log.wrench_sc, [frame.time_s for frame in plan.frames]
            )
            trials = label_frames(recording, CLASSES)

            for frame, trial, sd_n in zip(
                plan.frames, trials, label_sds(recording, trials), strict=True
            ):
                yield trial.measured_force_n - frame.push.force_n, sd_n


@pytest.mark.parametrize(
    ("low", "high", "phantom"),
    [
        pytest.param(0.8, 1.1, {}, id="default"),
        pytest.param(0.8, 1.15, {"sample_rate_hz": 100.0}, id="100 Hz"),
        pytest.param(0.65, 1.1, {"force_noise_n": fixed(0.03)}, id="noisy"),
        pytest.param(0.7, 1.1, {"force_drift_n_per_s": fixed(0.0)}, id="no drift"),
        pytest.param(
            0.8, 1.3, {"force_noise_n": fixed(2e-4), "force_step_n": 1e-4}, id="fine"
        ),
        pytest.param(
            0.55, 1.1, {"force_noise_n": fixed(5e-4)}, id="coarse"
        ),  # steps of 5 mN, which are not dithered
        pytest.param(
            0.5, 1.1, {"frame_delay_s": fixed(0.6)}, id="in motion"
        ),  # the window reaches into the ramp
    ],
)
def test_standardised_errors_of_labels_have_unit_spread(
    low: float, high: float, phantom: dict[str, Any]
):
    errors_n, sds_n = np.array(list(errors_and_sds(PhantomStudy(**phantom), 4))).T
    assert low < np.sqrt(np.mean((errors_n / sds_n) ** 2)) < high


def test_noise_that_neighbouring_samples_share_counts_fully():
    """Noise held for 50 ms looks quiet to differences of neighbours, and is averaged
    over a tenth as often.
    """
    rng = np.random.default_rng(3)
    time_s = np.arange(8000) / 200.0
    force_n = np.where(time_s > 5.0, 0.02, 0.0)
    frames_s = np.arange(8.0, 38.0, 3.0).tolist()

    def stated_n(noise_n: np.ndarray) -> float:
        wrench = np.zeros((len(time_s), 6))
        wrench[:, 2] = -(force_n + noise_n)
        recording = recording_of(time_s, wrench, frames_s)
        return float(np.median(label_sds(recording, label_frames(recording, CLASSES))))

    white = rng.normal(0.0, 4e-3, len(time_s))
    held = np.repeat(rng.normal(0.0, 4e-3, len(time_s) // 10), 10)
    assert stated_n(held) > 2.0 * stated_n(white)


def test_a_log_of_zeros_states_an_error_and_a_trial_without_a_label_none():
    recording = recording_of(np.arange(2000) / 200.0, np.zeros((2000, 6)), [5.0])
    (sd_n,) = label_sds(recording, label_frames(recording, CLASSES))
    assert sd_n is not None
    assert 0.0 < sd_n < 1e-4
    bare = replace(recording, forces=None)
    assert label_sds(bare, label_frames(bare, CLASSES)) == (None,)
