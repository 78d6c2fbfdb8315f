"""Readings that are no measurements, and sensors that repeat themselves honestly."""

from pathlib import Path

import numpy as np
import pytest
from foreign_files import write_table
from small_recordings import write_small_recording

from scleraforce.base.errors import RecordingError
from scleraforce.recordings.forces_under_frames import label_frames, label_remarks
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.study import ClassesStudy

SHARED = Path(__file__).parents[3] / "shared" / "recordings"
FZ = slice(2, 3)
FINE = {"step_n": 1e-6, "noise_steps": 4000.0}
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


def pushes(time_s):
    """Return the force of a needle that pushes, holds and lets go, N."""
    force_n = np.zeros_like(time_s)
    for nth, push_n in enumerate(PUSHES_N):
        since_s = time_s - FIRST_PUSH_S - APART_S * nth
        force_n += push_n * np.interp(
            since_s, [0.0, RAMP_S, RAMP_S + HOLD_S, 2 * RAMP_S + HOLD_S], [0, 1, 1, 0]
        )

    return force_n


def sensed(
    noise_steps=0.85,
    step_n=5e-3,
    rate_hz=100.0,
    repeats=1,
    seed=0,
):
    """Return times and the readings of a sensor of six axes that is pushed along -z."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(50.0 * rate_hz)) / rate_hz
    steps = np.array([*[step_n] * 3, *[1e-5] * 3])
    wrench_sc = rng.normal(0.0, 1.0, (len(time_s), 6)) * noise_steps * steps
    wrench_sc[:, 2] += OFFSET_N - pushes(time_s)
    wrench_sc = wrench_sc[np.arange(len(time_s)) // repeats * repeats]

    return time_s, np.round(wrench_sc / steps) * steps


def zeros_among(wrench_sc, time_s):
    """Set a fifth of the rows to 0."""
    failed = np.random.default_rng(1).random(len(time_s)) < 0.2
    wrench_sc[failed] = 0.0
    return failed


def bursts_of_a_word(wrench_sc, time_s):
    """Set rows for 0.1 s at a time to a word that is not 0."""
    failed = (time_s % 1.0) < 0.1
    wrench_sc[failed] = -1e-3
    return failed


def held(wrench_sc, time_s):
    """Repeat the last row of a push for 6 s."""
    failed = (time_s >= FRAMES_S[1] - 1.0) & (time_s < FRAMES_S[1] + 5.0)
    wrench_sc[failed] = wrench_sc[np.argmax(failed)]
    return failed


def one_axis_held(wrench_sc, time_s):
    """Repeat fz alone."""
    failed = (time_s >= FRAMES_S[1] - 1.0) & (time_s < FRAMES_S[1] + 5.0)
    wrench_sc[failed, 2] = wrench_sc[np.argmax(failed), 2]
    return failed


def zeros_before(wrench_sc, time_s):
    """Begin with zeros: the sensor starts a second before the contact."""
    failed = time_s < FIRST_PUSH_S - 1.5
    wrench_sc[failed] = 0.0
    return failed


def flat_top(wrench_sc, _):
    """End the range of fz at -30 mN."""
    failed = wrench_sc[:, 2] <= -30e-3
    wrench_sc[failed, 2] = -30e-3
    return failed


def noisy_rail(wrench_sc, _):
    """End the range of fz at -30 mN, with noise of a few steps of 1 uN."""
    failed = wrench_sc[:, 2] <= -30e-3
    noise_n = 1e-6 * np.random.default_rng(2).integers(0, 4, len(failed))
    wrench_sc[failed, 2] = -30e-3 + noise_n[failed]
    return failed


def line(wrench_sc, time_s):
    """Fill a gap with a straight line, as a program that resamples does."""
    failed = (time_s >= FRAMES_S[1] - 2.0) & (time_s < FRAMES_S[1] + 2.0)
    ends = np.flatnonzero(failed)[[0, -1]]
    for column in wrench_sc.T:
        column[failed] = np.interp(np.flatnonzero(failed), ends, column[ends]).round(7)

    return failed


FAILURES = [zeros_among, bursts_of_a_word, held, one_axis_held, zeros_before, flat_top]
SENSORS = {
    "coarse": {},
    "fine": FINE,
    "slow": {"rate_hz": 50.0},
    "slow, logged faster": {"repeats": 4, **FINE},
}


@pytest.fixture
def recorded(tmp_path):
    """A recording of frames under these readings, of all columns or some; `more` are
    lines below [force].
    """
    folder = write_small_recording(tmp_path / "rec", frames=len(FRAMES_S))
    lines = [(f"{nth:04d}.png", at_s) for nth, at_s in enumerate(FRAMES_S)]
    write_table(folder / "frames.csv", "file,time_s", *lines)
    info = folder / "recording.toml"
    text = info.read_text().replace("average_s = 0.1", "average_s = 2.0")

    def recorded(wrench_sc, time_s, columns=slice(None), more=""):
        table = np.column_stack([time_s, wrench_sc[:, columns]])
        header = ",".join(["time_s", *SIX_AXES[columns]])
        options = {"fmt": "%.10g", "delimiter": ",", "comments": ""}
        np.savetxt(folder / "forces.csv", table, header=header, **options)
        info.write_text(text + more)
        return read_recording(folder)

    return recorded


@pytest.fixture
def read(recorded):
    """Read what a sensor writes: the samples without a force, and what is said of
    them.
    """

    def read(*readings):
        log = recorded(*readings).forces
        return np.isnan(log.wrench_sc).any(axis=1), " ".join(log.notes)

    return read


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("failure", FAILURES)
def test_failures_are_found_and_the_rest_is_kept(read, failure, sensor):
    time_s, wrench_sc = sensed(**SENSORS[sensor])
    failed = failure(wrench_sc, time_s)
    near = np.convolve(failed, np.ones(101), "same") > 0 if failure is flat_top else 0
    kept = ~(failed | near)

    flags, _ = read(wrench_sc, time_s)
    assert flags[failed].mean() > 0.98
    assert flags[kept].mean() < 0.01

    wrench_sc[flags] = np.nan  # reading what was written finds no more
    again, said = read(wrench_sc, time_s)
    assert (again == flags).all()
    assert "no measurements" not in said


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("columns", [slice(0, 6), FZ])
def test_zeros_of_one_axis_are_found(read, columns, share):
    time_s, wrench_sc = sensed()
    failed = np.random.default_rng(3).random(len(time_s)) < share
    wrench_sc[failed, 2] = 0.0
    flags, _ = read(wrench_sc, time_s, columns)
    assert flags[failed & (pushes(time_s) > 20e-3)].mean() > 0.99
    assert flags[~failed].mean() < 0.05


@pytest.mark.parametrize("columns", [slice(0, 6), FZ])
def test_a_rail_with_noise_of_a_few_steps_is_the_end_of_a_range(read, columns):
    time_s, wrench_sc = sensed(**FINE)
    failed = noisy_rail(wrench_sc, time_s)
    flags, said = read(wrench_sc - 1e-9, time_s, columns)
    assert flags[failed].mean() > 0.98
    assert "the end of its range" in said


def test_a_straight_line_through_noise_fills_a_gap(read):
    time_s, wrench_sc = sensed(**FINE)
    failed = line(wrench_sc, time_s)
    flags, said = read(wrench_sc, time_s)
    assert (flags == failed).mean() > 0.999
    assert "a straight line" in said


def test_zeros_of_a_single_coarse_axis_are_told_from_honest_ones(read):
    time_s, wrench_sc = sensed()
    failed = zeros_among(wrench_sc, time_s)
    flags, _ = read(wrench_sc, time_s, FZ)
    assert flags[failed & (pushes(time_s) > 15e-3)].all()
    assert not flags[wrench_sc[:, 2] != 0.0].any()


@pytest.mark.parametrize("columns", [slice(0, 6), FZ])
@pytest.mark.parametrize("repeats", [1, 4, 20])
@pytest.mark.parametrize("noise_steps", [0.0, 0.1, 0.3, 0.5, 0.7, 0.85, 2.0, 50.0])
def test_an_honest_sensor_is_not_suspected(read, noise_steps, repeats, columns):
    time_s, wrench_sc = sensed(noise_steps, repeats=repeats)
    flags, said = read(wrench_sc, time_s, columns)
    assert (flags.any(), said) == (False, "")


def test_knocks_of_one_size_are_forces(read):
    time_s, wrench_sc = sensed()
    wrench_sc[300::700, 2] -= 40e-3
    assert not read(wrench_sc, time_s)[0].any()


def labels_of(recording):
    trials = label_frames(recording, ClassesStudy())
    return trials, [trial.measured_force_n for trial in trials]


@pytest.mark.parametrize("failure", [zeros_among, bursts_of_a_word])
def test_a_recording_has_no_label_where_the_sensor_failed_all_the_time(
    recorded, failure
):
    time_s, wrench_sc = sensed()
    failure(wrench_sc, time_s)
    with pytest.raises(RecordingError, match="no frame has a label"):
        labels_of(recorded(wrench_sc, time_s))


@pytest.mark.parametrize("failure", [held, one_axis_held, zeros_before, flat_top])
def test_a_frame_has_no_label_where_the_sensor_failed(recorded, failure):
    time_s, wrench_sc = sensed(rate_hz=200.0)
    failed = failure(wrench_sc, time_s)
    recording = recorded(wrench_sc, time_s)
    (said,) = recording.forces.notes
    assert "are no measurements and have no force" in said

    trials, labels_n = labels_of(recording)
    for trial, at_s, push_n in zip(trials, FRAMES_S, PUSHES_N, strict=True):
        if failed[np.abs(time_s - at_s) <= 1.0].mean() > 0.02:
            assert trial.measured_force_n is None
            assert "have no force" in trial.excluded
        elif trial.measured_force_n is not None:
            assert trial.measured_force_n == pytest.approx(push_n, abs=0.8e-3)

    remarks = [remark.words for remark in label_remarks(recording, trials)]
    assert any("have no label" in words for words in remarks) == (None in labels_n)
    assert (None in labels_n) == (failure is not zeros_before)


@pytest.mark.parametrize("start_s", [FIRST_PUSH_S - 0.2, FIRST_PUSH_S + RAMP_S])
def test_zeros_until_the_contact_leave_no_tare(recorded, start_s):
    time_s, wrench_sc = sensed()
    wrench_sc[time_s < start_s] = 0.0
    with pytest.raises(RecordingError, match=r"have no force, and .* the tare"):
        labels_of(recorded(wrench_sc, time_s))


def test_a_stated_range_counts_as_saturation(recorded):
    # without noise a flat top proves nothing
    time_s, wrench_sc = sensed(noise_steps=0.0)
    wrench_sc[:, 2] = np.maximum(wrench_sc[:, 2], -40e-3)
    _, labels_n = labels_of(recorded(wrench_sc, time_s))
    assert None not in labels_n

    recording = recorded(wrench_sc, time_s, more="range_n = 0.04\n")
    _, labels_n = labels_of(recording)
    assert [label is None for label in labels_n] == [n > 32e-3 for n in PUSHES_N]
    assert "fz_n is at the end of the stated range, 0.04 N" in recording.forces.notes[0]


@pytest.mark.real
@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared/recordings")
@pytest.mark.parametrize("name", [f"sample-{letter}" for letter in "abcde"])
def test_the_coarse_sensor_of_the_samples_is_honest(read, name):
    log = read_recording(SHARED / name).forces
    assert log.notes == ()
    for columns in (slice(0, 3), FZ):
        assert not read(log.wrench_sc, log.time_s, columns)[0].any()
