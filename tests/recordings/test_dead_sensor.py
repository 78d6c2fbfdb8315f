"""Readings that are no measurements, and sensors that repeat themselves honestly."""

from pathlib import Path

import numpy as np
import pytest
from small_recordings import write_small_recording

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.errors import RecordingError
from scleraforce.recordings.dead_sensor import no_values
from scleraforce.recordings.forces_under_frames import label_frames, label_remarks
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.study import ClassesStudy

SHARED = Path(__file__).parents[3] / "shared" / "recordings"
SIX_AXES = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
OFFSET_N = -7.3e-3
PUSHES_N = (12e-3, 24e-3, 36e-3, 34e-3, 20e-3)
FIRST_PUSH_S = 5.0
APART_S = 9.0
HOLD_S = 5.0
RAMP_S = 0.5
FRAMES_S = tuple(
    FIRST_PUSH_S + RAMP_S + HOLD_S / 2 + APART_S * nth for nth in range(len(PUSHES_N))
)


def pushes(time_s: Floats) -> Floats:
    """Return the force of a needle that pushes, holds and lets go, N."""
    force_n = np.zeros_like(time_s)
    for nth, push_n in enumerate(PUSHES_N):
        since_s = time_s - FIRST_PUSH_S - APART_S * nth
        force_n += push_n * np.interp(
            since_s, [0.0, RAMP_S, RAMP_S + HOLD_S, 2 * RAMP_S + HOLD_S], [0, 1, 1, 0]
        )

    return force_n


def sensed(
    noise_steps: float = 0.85,
    step_n: float = 5e-3,
    rate_hz: float = 200.0,
    repeats: int = 1,
    seed: int = 0,
) -> tuple[Floats, Floats]:
    """Return times and the readings of a sensor of six axes that is pushed along -z."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(50.0 * rate_hz)) / rate_hz
    steps = np.array([*[step_n] * 3, *[1e-5] * 3])
    wrench_sc = rng.normal(0.0, 1.0, (len(time_s), 6)) * noise_steps * steps
    wrench_sc[:, 2] += OFFSET_N - pushes(time_s)
    wrench_sc = wrench_sc[np.arange(len(time_s)) // repeats * repeats]

    return time_s, np.round(wrench_sc / steps) * steps


def zeros_among(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Set a fifth of the rows to 0."""
    failed = np.random.default_rng(1).random(len(time_s)) < 0.2
    wrench_sc[failed] = 0.0
    return failed


def bursts_of_a_word(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Set rows for 0.1 s at a time to a word that is not 0."""
    failed = (time_s % 1.0) < 0.1
    wrench_sc[failed] = -1e-3
    return failed


def held(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Repeat the last row of a push for 6 s."""
    failed = (time_s >= FRAMES_S[1] - 1.0) & (time_s < FRAMES_S[1] + 5.0)
    wrench_sc[failed] = wrench_sc[np.argmax(failed)]
    return failed


def one_axis_held(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Repeat fz alone."""
    failed = (time_s >= FRAMES_S[1] - 1.0) & (time_s < FRAMES_S[1] + 5.0)
    wrench_sc[failed, 2] = wrench_sc[np.argmax(failed), 2]
    return failed


def zeros_before(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Begin with zeros: the sensor starts a second before the contact."""
    failed = time_s < FIRST_PUSH_S - 1.5
    wrench_sc[failed] = 0.0
    return failed


def flat_top(wrench_sc: Floats, _: Floats) -> Flags:
    """End the range of fz at -30 mN."""
    failed = wrench_sc[:, 2] <= -30e-3
    wrench_sc[failed, 2] = -30e-3
    return failed


def noisy_rail(wrench_sc: Floats, _: Floats) -> Flags:
    """End the range of fz at -30 mN, with noise of a few steps of 1 uN."""
    failed = wrench_sc[:, 2] <= -30e-3
    noise_n = 1e-6 * np.random.default_rng(2).integers(0, 4, len(failed))
    wrench_sc[failed, 2] = -30e-3 + noise_n[failed]
    return failed


def line(wrench_sc: Floats, time_s: Floats) -> Flags:
    """Fill a gap with a straight line, as a program that resamples does."""
    failed = (time_s >= FRAMES_S[1] - 2.0) & (time_s < FRAMES_S[1] + 2.0)
    ends = np.flatnonzero(failed)[[0, -1]]
    for column in wrench_sc.T:
        column[failed] = np.interp(np.flatnonzero(failed), ends, column[ends]).round(7)

    return failed


FAILURES = [
    zeros_among,
    bursts_of_a_word,
    held,
    one_axis_held,
    zeros_before,
    flat_top,
]
SENSORS = {
    "coarse": {},
    "fine": {"step_n": 1e-6, "noise_steps": 4000.0},
    "slow": {"rate_hz": 50.0},
    "slow, logged faster": {"repeats": 4, "step_n": 1e-6, "noise_steps": 4000.0},
}


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("failure", FAILURES, ids=lambda each: each.__name__)
def test_failures_are_found_and_the_rest_is_kept(failure, sensor):
    time_s, wrench_sc = sensed(**SENSORS[sensor])
    failed = failure(wrench_sc, time_s)

    found = no_values(wrench_sc, SIX_AXES, time_s)
    flags = np.any([each.samples for each in found], axis=0)
    near = np.convolve(failed, np.ones(101), "same") > 0 if failure is flat_top else 0
    kept = ~(failed | near)

    assert flags[failed].mean() > 0.98
    assert flags[kept].mean() < 0.01

    wrench_sc[flags] = np.nan  # reading what was written finds no more
    assert not no_values(wrench_sc, SIX_AXES, time_s)


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("columns", [slice(0, 6), slice(2, 3)])
def test_zeros_of_one_axis_are_found(columns, share):
    time_s, wrench_sc = sensed()
    failed = np.random.default_rng(3).random(len(time_s)) < share
    wrench_sc[failed, 2] = 0.0
    found = no_values(wrench_sc[:, columns], SIX_AXES[columns], time_s)

    flags = np.any([each.samples for each in found], axis=0)
    assert flags[failed & (pushes(time_s) > 20e-3)].mean() > 0.99
    assert flags[~failed].mean() < 0.05


def test_a_rail_with_noise_of_a_few_steps_is_the_end_of_a_range():
    time_s, wrench_sc = sensed(step_n=1e-6, noise_steps=4000.0)
    failed = noisy_rail(wrench_sc, time_s)
    found = no_values(wrench_sc, SIX_AXES, time_s)

    assert np.any([each.samples for each in found], axis=0)[failed].mean() > 0.98
    (fz,) = no_values(wrench_sc[:, 2:3] - 1e-9, ("fz_n",), time_s)[-1:]
    assert "the end of its range" in fz.words


def test_a_straight_line_through_noise_fills_a_gap():
    time_s, wrench_sc = sensed(step_n=1e-6, noise_steps=4000.0)
    failed = line(wrench_sc, time_s)
    (found,) = no_values(wrench_sc, SIX_AXES, time_s)

    assert (found.samples == failed).mean() > 0.999
    assert "a straight line" in found.words


def test_zeros_of_a_single_coarse_axis_are_told_from_honest_ones():
    time_s, wrench_sc = sensed()
    failed = zeros_among(wrench_sc, time_s)
    (found,) = no_values(wrench_sc[:, 2:3], ("fz_n",), time_s)

    pushed = pushes(time_s) > 15e-3
    assert found.samples[failed & pushed].all()
    assert not found.samples[wrench_sc[:, 2] != 0.0].any()


@pytest.mark.parametrize("columns", [1, 3, 6])
@pytest.mark.parametrize("repeats", [1, 4, 20])
@pytest.mark.parametrize(
    "noise_steps", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.85, 2.0, 50.0]
)
def test_an_honest_sensor_is_not_suspected(noise_steps, repeats, columns):
    time_s, wrench_sc = sensed(noise_steps, repeats=repeats)
    shown = slice(2, 3) if columns == 1 else slice(0, columns)
    assert not no_values(wrench_sc[:, shown], SIX_AXES[shown], time_s)


def test_knocks_of_one_size_are_forces():
    time_s, wrench_sc = sensed()
    wrench_sc[300::700, 2] -= 40e-3
    assert not no_values(wrench_sc, SIX_AXES, time_s)


def recording_of(folder: Path, wrench_sc: Floats, time_s: Floats) -> Path:
    write_small_recording(folder, frames=len(FRAMES_S), forces_mn=None)
    lines = [f"{nth:04d}.png,{at_s}" for nth, at_s in enumerate(FRAMES_S)]
    (folder / "frames.csv").write_text("\n".join(["file,time_s", *lines]) + "\n")
    np.savetxt(
        folder / "forces.csv",
        np.column_stack([time_s, wrench_sc]),
        fmt="%.7g",
        delimiter=",",
        header=",".join(["time_s", *SIX_AXES]),
        comments="",
    )
    info = (folder / "recording.toml").read_text()
    (folder / "recording.toml").write_text(
        info.replace("average_s = 0.1", "average_s = 2.0")
    )
    return folder


@pytest.mark.parametrize("failure", FAILURES, ids=lambda each: each.__name__)
def test_a_recording_made_earlier_has_no_label_where_the_sensor_failed(
    failure, tmp_path
):
    time_s, wrench_sc = sensed()
    failed = failure(wrench_sc, time_s)
    recording = read_recording(recording_of(tmp_path / "rec", wrench_sc, time_s))
    assert recording.forces is not None
    (said,) = recording.forces.notes
    assert "are no measurements and have no force" in said

    if failure in (zeros_among, bursts_of_a_word):
        with pytest.raises(RecordingError, match="no frame has a label"):
            label_frames(recording, ClassesStudy())
        return

    trials = label_frames(recording, ClassesStudy())
    reached = [failed[np.abs(time_s - at_s) <= 1.0].mean() for at_s in FRAMES_S]
    for trial, push_n, share in zip(trials, PUSHES_N, reached, strict=True):
        if share > 0.02:
            assert trial.measured_force_n is None
            assert "have no force" in str(trial.excluded)
        elif trial.measured_force_n is not None:
            assert trial.measured_force_n == pytest.approx(push_n, abs=0.8e-3)

    if failure is not zeros_before:
        (*_, unlabelled) = label_remarks(recording, trials)
        assert "frames have no label" in unlabelled.words


@pytest.mark.parametrize("start_s", [FIRST_PUSH_S - 0.2, FIRST_PUSH_S + RAMP_S])
def test_zeros_until_the_contact_leave_no_tare(start_s, tmp_path):
    time_s, wrench_sc = sensed()
    wrench_sc[time_s < start_s] = 0.0
    recording = read_recording(recording_of(tmp_path / "rec", wrench_sc, time_s))
    with pytest.raises(RecordingError, match=r"have no force, and .* the tare"):
        label_frames(recording, ClassesStudy())


def test_a_stated_range_counts_as_saturation(tmp_path):
    time_s, wrench_sc = sensed(
        noise_steps=0.0
    )  # without noise a flat top proves nothing
    wrench_sc[:, 2] = np.maximum(wrench_sc[:, 2], -40e-3)
    folder = recording_of(tmp_path / "rec", wrench_sc, time_s)
    trials = label_frames(read_recording(folder), ClassesStudy())
    assert all(trial.measured_force_n is not None for trial in trials)

    text = (folder / "recording.toml").read_text()
    (folder / "recording.toml").write_text(text + "range_n = 0.04\n")
    recording = read_recording(folder)
    trials = label_frames(recording, ClassesStudy())
    without = [trial.measured_force_n is None for trial in trials]
    assert without == [push_n > 32e-3 for push_n in PUSHES_N]
    assert recording.forces is not None
    assert "fz_n is at the end of the stated range, 0.04 N" in recording.forces.notes[0]


@pytest.mark.real
@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared/recordings")
@pytest.mark.parametrize("name", [f"sample-{letter}" for letter in "abcde"])
@pytest.mark.parametrize("columns", [(2,), (0, 1, 2), (0, 1, 2, 3, 4, 5)])
def test_the_coarse_sensor_of_the_samples_is_honest(name, columns):
    log = read_recording(SHARED / name).forces
    assert log is not None
    assert log.notes == ()
    shown = list(columns)
    names = tuple(SIX_AXES[column] for column in shown)
    assert not no_values(log.wrench_sc[:, shown], names, log.time_s)
