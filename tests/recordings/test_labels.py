"""Labels of frames, logs that contradict their frames, and punctures: sudden falls to
friction, not retractions.
"""

import re
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest
from foreign_files import write_table
from scipy import signal
from small_recordings import LOGGED_INFO, write_small_recording

from scleraforce.base.errors import RecordingError
from scleraforce.lab.needle_pushes import sense
from scleraforce.lab.virtual_eye import paper_eyes
from scleraforce.lab.virtual_recording import plan_phantom
from scleraforce.recordings.forces_under_frames import (
    after_punctures,
    contact_force,
    label_frames,
    label_remarks,
    log_doubts,
    low_pass,
    with_punctures,
)
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    ForceLog,
    FrameEntry,
)
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.study import ClassesStudy, Study

SHARED = Path(__file__).parents[3] / "shared" / "recordings"
CLASSES = ClassesStudy()
FORCE = ForceInfo("fz", -1, 2.0)


def log_of(fz_n, rate_hz=200.0, start_s=0.0):
    wrench = np.zeros((len(fz_n), 6))
    wrench[:, 2] = fz_n
    return ForceLog(start_s + np.arange(len(fz_n)) / rate_hz, wrench, FORCE_COLUMNS[1:])


def recording_of(log, *frames_s, average_s=2.0, sign=-1):
    info = replace(LOGGED_INFO, force=ForceInfo("fz", sign, average_s))
    frames = tuple(FrameEntry(f"{k}.png", at_s) for k, at_s in enumerate(frames_s))
    return Recording(Path("rec"), info, frames, log)


def labels_of(log, *frames_s, **more):
    trials = label_frames(recording_of(log, *frames_s, **more), CLASSES)
    return [trial.measured_force_n for trial in trials]


def step_and_hold(force_n=0.02, quiet_s=2.0, ramp_s=0.5, hold_s=8.0, rate_hz=200.0):
    time_s = np.arange(round((quiet_s + ramp_s + hold_s) * rate_hz)) / rate_hz
    return force_n * np.clip((time_s - quiet_s) / ramp_s, 0.0, 1.0)


def sensed(force_n, rng, offset_n=0.0):
    """Return what a coarse sensor reads, with 4 mN of noise and steps of 5 mN."""
    noisy_n = force_n + offset_n + rng.normal(0, 4e-3, len(force_n))
    return 5e-3 * np.rint(noisy_n / 5e-3)


@pytest.mark.parametrize(("count", "rate_hz"), [(400, 200.0), (5000, 100.0)])
def test_an_even_clock_is_filtered_as_by_scipy(count, rate_hz):
    """SciPy's filter has no delay and passes half at its cut-off; its step overshoots
    by 4 %.
    """
    values = np.cumsum(np.random.default_rng(count).standard_normal(count)) + 3.0
    sections = signal.butter(2, 5.0, fs=rate_hz, output="sos")
    expected = signal.sosfiltfilt(sections, values, padtype="even", padlen=count - 1)
    smooth = low_pass(values, np.arange(count) / rate_hz)
    assert smooth == pytest.approx(expected, abs=1e-8)


def test_jittering_and_bursting_clocks_give_the_force_of_an_even_one():
    rng = np.random.default_rng(0)
    even_s = np.arange(3000) / 200.0
    time_s = even_s + rng.uniform(-1e-3, 1e-3, 3000)
    assert low_pass(np.sin(time_s), time_s) == pytest.approx(
        low_pass(np.sin(even_s), even_s), abs=2e-3
    )
    assert low_pass(np.sin(time_s), time_s)[100:-100] == pytest.approx(
        np.sin(time_s)[100:-100], abs=1e-4
    )
    burst_s = np.cumsum(np.where(rng.random(20_000) < 0.6, 1e-6, 0.19))
    assert low_pass(np.ones(20_000), burst_s) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(60))
def test_the_tare_ends_at_the_first_contact_in_noise_and_steps(seed):
    rng = np.random.default_rng(seed)
    offset_n = rng.uniform(-0.05, 0.05)
    force_n, quiet_s, ramp_s = (
        rng.uniform([10e-3, 1.0, 0.1], [60e-3, 20.0, 1.0])
        if seed < 30
        else (4e-3, 3.0, 0.5)
    )
    pushed_n = step_and_hold(force_n, quiet_s, ramp_s)
    log = log_of(-sensed(pushed_n, rng, offset_n=offset_n))
    (label_n,) = labels_of(log, quiet_s + ramp_s + 4.0)
    assert label_n == pytest.approx(force_n, abs=1.5e-3)

    # no contact before the needle comes
    contact_n = contact_force(log, FORCE)
    quiet = log.time_s < quiet_s - 0.5
    assert abs(contact_n[quiet].mean()) < 1e-3


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_contact(seed):
    raw_n = sensed(np.zeros(12_000), np.random.default_rng(seed), offset_n=7e-3)
    (trial,) = label_frames(recording_of(log_of(raw_n), 10.0), CLASSES)
    assert (trial.measured_force_n, trial.target) == (pytest.approx(0.0, abs=0.5e-3), 0)


@pytest.mark.parametrize("average_s", [0.2, 2.0, 5.0])
@pytest.mark.parametrize("sign", [-1, 1])
def test_label_is_the_mean_of_the_window_centred_on_the_frame(average_s, sign):
    # A force that grows evenly has its value at the frame as its mean over any centred
    # window.
    force_n = 1e-3 * np.maximum(np.arange(8000) / 200.0 - 5.0, 0.0)
    given = {"average_s": average_s, "sign": sign}
    labels_n = labels_of(log_of(sign * force_n), 15.0, 30.0, **given)
    assert labels_n == pytest.approx([0.010, 0.025], abs=1e-5)


IN_CONTACT = -np.r_[np.full(1000, 0.02), np.zeros(1000)]
LATE = r"^rec: the clocks do not overlap: .* forces.csv 100 to 109.995 s"


@pytest.mark.parametrize(
    ("force_n", "start_s", "time_s", "message"),
    [
        (
            step_and_hold(0.04),
            0.0,
            8.0,
            r"forces.csv: the needle would pull with \d+\.\d mN at .* of 0.png, 8 s",
        ),
        (IN_CONTACT, 0.0, 8.0, "starts before the first contact"),
        (np.zeros(2000), 100.0, 5.0, LATE),
        (np.zeros(2000), 100.0, 200.0, LATE),
    ],
)
def test_a_wrong_sign_a_log_that_starts_in_contact_and_clocks_apart_are_errors(
    force_n, start_s, time_s, message
):
    with pytest.raises(RecordingError, match=message):
        labels_of(log_of(force_n, start_s=start_s), time_s)


WHOLE = log_of(np.zeros(2000))
TORN = replace(WHOLE, time_s=WHOLE.time_s + 20.0 * (np.arange(2000) >= 1000))


@pytest.mark.parametrize(
    ("log", "frames_s", "lost"),
    [(TORN, (2.0, 15.0), 1), (WHOLE, (2.0, 10.4), 1), (WHOLE, (-0.5, 2.0), 0)],
)
def test_a_frame_without_samples_around_it_is_left_out_with_the_reason_and_the_others_count(
    log, frames_s, lost
):
    recording = recording_of(log, *frames_s)
    trials = label_frames(recording, CLASSES)
    assert (trials[1 - lost].measured_force_n, trials[1 - lost].excluded) == (0.0, None)
    assert (trials[lost].measured_force_n, trials[lost].target) == (None, None)
    assert "force samples within 1 s of its time" in trials[lost].excluded
    (remark,) = label_remarks(recording, trials)
    assert remark.code == "frames-without-label"
    assert remark.words.startswith(
        f"1 of 2 frames have no label and are left out ({lost}"
    )


FAST = log_of(-step_and_hold(0.02))


def test_a_window_with_a_gap_has_no_label_and_the_others_keep_theirs():
    frames_s = (3.9, 5.5, 6.9, 8.0)
    holed = replace(FAST, wrench_sc=FAST.wrench_sc.copy())
    holed.wrench_sc[1000:1200] = np.nan  # 5 to 6 s
    holed.wrench_sc[100] = np.nan  # one sample before the contact
    first_n, _, _, last_n = labels_of(FAST, *frames_s)
    kept_n = [pytest.approx(each_n, abs=1e-5) for each_n in (first_n, last_n)]
    assert labels_of(holed, *frames_s) == [kept_n[0], None, None, kept_n[1]]
    trials = label_frames(recording_of(holed, *frames_s), CLASSES)
    assert trials[2].excluded == "20 of the 401 force samples around it have no force"


@pytest.mark.parametrize(
    ("log", "shift_s"),
    [
        (FAST, 0.0),
        (log_of(-step_and_hold(0.02, rate_hz=30.0), 30.0), 0.0),
        (replace(FAST, time_s=FAST.time_s + 1e6 * (FAST.time_s > 7.0)), 1e6),
    ],
)
def test_a_slow_log_and_one_with_a_gap_give_the_labels_of_a_fast_one_to_its_end(
    log, shift_s
):
    labels_n = labels_of(log, 5.0, 9.0 + shift_s, 10.3 + shift_s)
    assert labels_n == pytest.approx([0.02] * 3, abs=1e-4)


def test_half_of_a_window_is_enough_however_the_clock_is_rounded():
    """One sample of the first eleven is missing; steps a little below 10 ms make the
    window expect a little over 20.
    """
    time_s = np.arange(400) * 0.01 * (1 - 1e-12)
    one, two = (
        replace(log_of(np.zeros(400 - len(gaps))), time_s=np.delete(time_s, gaps))
        for gaps in ([3], [3, 5])
    )
    assert labels_of(one, 0.005, average_s=0.2) == [0.0]
    with pytest.raises(RecordingError, match=r"no frame has a label; 0.png: 9 force"):
        labels_of(two, 0.005, average_s=0.2)


def test_pierced_trials_and_those_above_the_largest_force_are_kept_with_the_reason():
    recording = recording_of(log_of(-step_and_hold(0.07)), 1.1, 8.0)
    before, after = recording.frames
    pierced = replace(recording, frames=(before, replace(after, pierced=True)))
    reasons = [
        label_frames(each, CLASSES, largest_n)[1].excluded
        for each, largest_n in ((recording, None), (recording, 0.06), (pierced, 0.06))
    ]
    above = "above the largest force of the study, 60 mN"
    assert reasons == [None, above, "pierced"]
    assert label_frames(recording, CLASSES, 0.06)[0].excluded is None


def labels_of_the_paper_eyes(study, seed):
    for eye, forces_n in paper_eyes(study):
        plan = plan_phantom(eye, forces_n, study, seed)
        rng = np.random.default_rng(seed)
        end_s = plan.path.times_s[-1] + 1.5
        table = sense(plan.path, plan.sensor, 2, -1, end_s, rng)
        log = ForceLog(table[:, 0], table[:, 1:], FORCE_COLUMNS[1:])
        recording = recording_of(log, *(frame.push.frame_s for frame in plan.frames))
        trials = label_frames(recording, CLASSES)
        for frame, trial in zip(plan.frames, trials, strict=True):
            yield frame.push.force_n, trial


def test_labels_of_virtual_recordings_meet_the_truth():
    # With the default ranges, drift included: 0.5 mN (standard deviation), 2 mN at
    # most, and every class is right.
    pairs = [
        pair for seed in range(6) for pair in labels_of_the_paper_eyes(Study(), seed)
    ]
    errors_n = np.array([trial.measured_force_n - force_n for force_n, trial in pairs])
    assert abs(errors_n.mean()) < 0.25e-3
    assert errors_n.std() < 0.7e-3
    assert np.abs(errors_n).max() < 2e-3
    assert all(trial.target == CLASSES.classify(force_n) for force_n, trial in pairs)


@pytest.mark.real
@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared")
@pytest.mark.parametrize(
    ("name", "counts"), [("sample-a", [3, 5, 6]), ("sample-b", [3, 5, 4])]
)
def test_sample_recordings_have_labels_in_all_classes_and_none_near_a_bound(
    name, counts
):
    trials = label_frames(read_recording(SHARED / name), CLASSES, 0.06)
    assert np.bincount([trial.target for trial in trials]).tolist() == counts
    assert all(trial.excluded is None for trial in trials)


@pytest.mark.parametrize("average_s", [0.1, 2.0])
@pytest.mark.parametrize(
    ("force_n", "found"),
    [
        (0.02, r"fz_n: \d+.* N under 0.png, more than 3 N; .* 0.001"),
        (1e-3, r"fz_n: a noise of 4\.?\d* N, more than the 300 mN .* by 0.001"),
    ],
)
def test_millinewtons_in_columns_of_newtons_are_refused_and_the_unit_is_asked_for(
    average_s, force_n, found
):
    log = log_of(sensed(-step_and_hold(force_n), np.random.default_rng(0)))
    good = recording_of(log, 8.0, average_s=average_s)
    (trial,) = label_frames(good, CLASSES)
    assert trial.measured_force_n == pytest.approx(force_n, abs=5e-3)
    milli = replace(good, forces=replace(log, wrench_sc=1e3 * log.wrench_sc))
    with pytest.raises(RecordingError, match=rf"rec/forces.csv: {found}"):
        label_frames(milli, CLASSES)


@pytest.fixture
def logged(tmp_path):
    """A recording of one frame, of this log."""

    def logged(force_n):
        folder = write_small_recording(tmp_path / "rec", frames=1)
        write_table(folder / "frames.csv", "file,time_s", ("0000.png", 9.0))
        lines = [(nth / 200, each_n) for nth, each_n in enumerate(force_n)]
        write_table(folder / "forces.csv", "time_s,fz_n", *lines)
        return read_recording(folder)

    return logged


@pytest.mark.parametrize("levels_n", [[0.0], [0.01, 0.02]])
def test_bursts_are_gaps(logged, levels_n):
    force_n = np.repeat([*levels_n, *levels_n, 213.0], 100)
    log = logged(force_n).forces
    assert (np.isnan(log.force_n("fz")) == (force_n > 200.0)).all()
    assert any("is it in N?" in note for note in log.notes)


def test_the_levels_of_a_coarse_sensor_in_millinewtons_are_no_gaps(logged):
    pushed_mn = 20.0 * np.clip((np.arange(2000) - 1500) / 100.0, 0.0, 1.0)
    recording = logged(-np.rint(pushed_mn / 5.0) * 5.0)
    assert np.isfinite(recording.forces.wrench_sc).all()
    assert not any("is it in N?" in note for note in recording.forces.notes)
    found = r"fz_n: 20.* N under 0000.png, more than 3 N; .* by 0.001"
    with pytest.raises(RecordingError, match=found):
        label_frames(recording, CLASSES)


def test_overloads_and_knocks_are_not_taken_for_another_unit():
    force_n = step_and_hold(0.9)
    force_n[600] += 50.0  # something fell on the table before the frame
    trial = label_frames(recording_of(log_of(-force_n), 8.0), CLASSES, 0.06)[0]
    assert trial.measured_force_n == pytest.approx(0.9, abs=0.02)
    assert "above the largest force" in trial.excluded


def test_work_grows_with_the_samples_and_not_with_the_time_that_they_span():
    time_s = np.arange(2000) / 200.0
    far_s = np.r_[time_s, 1e9 + time_s, 2e9]  # an even clock would have 4e11 samples
    force_n = np.r_[np.sin(time_s), np.cos(time_s), 0.3]
    smooth_n = low_pass(force_n, far_s)
    assert smooth_n[:2000] == pytest.approx(low_pass(np.sin(time_s), time_s))
    assert smooth_n[2000:4000] == pytest.approx(
        low_pass(np.cos(time_s), time_s), abs=1e-4
    )
    assert smooth_n[4000] == 0.3


PUSHES_N = np.array(
    [0.031, 0.008, 0.045, 0.002, 0.022, 0.051, 0.015, 0.038, 0.004, 0.027]
)
FRAMES_S = 8.0 + 10.0 * np.arange(len(PUSHES_N))


def recording(rng, later_s=0.0, pushes_n=PUSHES_N):
    """Pushes of 4 s, a frame in the middle of each; its time is stated as `later_s`
    later than it is.
    """
    time_s = np.arange(0.0, 115.0, 0.005)
    force_n = sum(
        f * np.clip(2.5 - np.abs(time_s - t), 0.0, 1.0)
        for f, t in zip(pushes_n, FRAMES_S, strict=True)
    )
    wrench = rng.normal(0.0, 4e-3, (len(time_s), 6))
    wrench[:, 2] -= force_n
    wrench[:, 0] += 0.02 * force_n
    frames = tuple(FrameEntry(f"{k}.png", t + later_s) for k, t in enumerate(FRAMES_S))

    return Recording(
        Path("rec"), LOGGED_INFO, frames, ForceLog(time_s, wrench, FORCE_COLUMNS[1:])
    )


def seen(rng, pushes_n=PUSHES_N):
    """Return dents in another unit, out of proportion and with noise; one is
    unknown.
    """
    shown = 30.0 * pushes_n**0.8 * rng.normal(1.0, 0.1, len(pushes_n))
    shown[3] = np.nan
    return shown[None]


@pytest.mark.parametrize(
    "seed",
    [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 10))],
)
def test_a_log_that_fits_its_frames_is_not_doubted(seed):
    rng = np.random.default_rng(seed)
    fitting = recording(rng)
    assert log_doubts(fitting, CLASSES, seen(rng)) == ()
    # too few to tell
    few = np.array([[1.0, 2.0, 3.0, *[np.nan] * 7]])
    assert log_doubts(recording(rng, 5.0), CLASSES, few) == ()
    # gaps raise no doubt
    fitting.forces.wrench_sc[rng.random(len(fitting.forces.time_s)) < 0.1] = np.nan
    assert log_doubts(fitting, CLASSES, seen(rng)) == ()
    assert log_doubts(fitting, CLASSES, PUSHES_N[None], PUSHES_N.tolist()) == ()


@pytest.mark.parametrize("seed", range(20))
def test_pushes_of_one_force_prove_no_shift(seed):
    alike_n = np.full(len(PUSHES_N), 0.02)
    rng = np.random.default_rng(seed)
    assert log_doubts(recording(rng, 0.0, alike_n), CLASSES, seen(rng, alike_n)) == ()


@pytest.mark.parametrize(
    ("later_s", "side"), [(6.0, "earlier"), (-6.0, "later"), (10.0, "earlier")]
)
def test_shifted_times_are_named_with_their_direction_unless_the_dents_are_rounding(
    later_s, side
):
    rng = np.random.default_rng(1)
    doubted = recording(rng, later_s)
    shown = seen(rng)
    (doubt,) = log_doubts(doubted, CLASSES, shown)
    off = f"the frames' times are off: .* s {side} than frames.csv says"
    assert re.search(off, doubt.words)
    assert (doubt.code, doubt.severity) == ("clock-contradicted", "doubt")
    rounding = log_doubts(doubted, CLASSES, 1.0 + 1e-12 * shown)
    assert not any("times are off" in doubt.words for doubt in rounding)


def test_dents_of_other_frames_are_unrelated_to_a_log():
    other = np.array([[1.0, 9.0, 4.0, 6.0, 2.0, 3.0, 9.0, 5.0, 8.0, 2.0]])
    (doubt,) = log_doubts(recording(np.random.default_rng(1)), CLASSES, other)
    assert "forces.csv is unrelated to the frames" in doubt.words


def test_an_axis_across_the_needle_is_named_with_the_one_along_it():
    good = recording(np.random.default_rng(3))
    unknown = np.full((1, len(PUSHES_N)), np.nan)
    wrong = replace(good, info=replace(LOGGED_INFO, force=ForceInfo("fx", -1)))
    assert log_doubts(good, CLASSES, unknown) == ()
    (doubt,) = log_doubts(wrong, CLASSES, unknown)
    assert re.search(
        r"mN along fz under the frames, but .* mN along fx: check \[force\] axis",
        doubt.words,
    )
    assert doubt.fields == ("axis",)


def test_forces_of_another_size_than_the_read_ones_are_doubted():
    rng = np.random.default_rng(4)
    log = recording(rng, 0.0, PUSHES_N / 9.81)  # kilogram-force
    (doubt,) = log_doubts(log, CLASSES, PUSHES_N[None], PUSHES_N.tolist())
    words = "forces.csv has 0.1 times the force that the frames show"
    assert doubt.words.startswith(words)
    assert (
        log_doubts(recording(rng), CLASSES, PUSHES_N[None], (1.5 * PUSHES_N).tolist())
        == ()
    )


# ---- punctures


def pierced(corners, frames_s, noise_n=1e-3, seed=0, travels_m=()):
    """Return whether frames are pierced in a log of 12 s whose force is straight
    between corners (s, mN), with noise.
    """
    time_s = np.arange(1200) / 100.0
    force_n = np.interp(time_s, *np.array(corners).T) * 1e-3
    force_n += np.random.default_rng(seed).normal(0.0, noise_n, len(time_s))
    log = ForceLog(time_s, -force_n[:, None], ("fz_n",))
    frames = tuple(
        FrameEntry(f"{nth}.png", at_s, travel_m=travel_m)
        for nth, (at_s, travel_m) in enumerate(zip_longest(frames_s, travels_m))
    )
    found = with_punctures(replace(recording_of(log), frames=frames))
    return [frame.pierced for frame in found.frames]


RISE = [(2.0, 0.0), (3.5, 30.0)]
THROUGH = [*RISE, (3.503, 9.0), (5.0, 9.0), (5.5, -9.0), (6.5, -9.0), (6.505, 0.0)]


@pytest.mark.parametrize("noise_n", [1e-4, 1e-3, 4e-3])
def test_a_sudden_fall_to_friction_is_a_puncture(noise_n):
    corners = [(2.0, 0.0), (3.5, 45.0), (3.503, 13.0), (9.0, 13.0)]
    assert pierced(corners, (3.46, 3.54), noise_n) == [False, True]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(
    "corners",
    [
        [*RISE, (3.7, 9.0), (5.0, 9.0)],  # retracts within 0.2 s
        [*RISE, (3.503, 0.0)],  # lets go
        RISE,
        [(2.0, 0.0), (2.003, 30.0)],
    ],
)
def test_slow_and_whole_falls_are_no_punctures(corners, seed):
    assert not any(pierced(corners, (2.5, 3.54, 4.0, 5.0), seed=seed))


@pytest.mark.parametrize(
    ("travels_m", "found"),
    [((2e-3, 2e-3, 1.5e-3), False), ((3e-3, 3.49e-3, 3.52e-3), True)],
)
def test_a_needle_that_was_drawn_back_as_fast_explains_a_fall(travels_m, found):
    frames_s = (3.0, 3.49, 3.52)
    travels_m = (*travels_m, travels_m[-1])
    assert pierced(THROUGH, (*frames_s, 4.0), travels_m=travels_m)[3] == found


def test_the_frames_of_a_push_after_its_puncture_are_pierced_and_the_next_push_is_not():
    corners = [*THROUGH, (8.0, 0.0), (9.0, 20.0), (11.0, 20.0)]
    frames_s = (3.4, 3.6, 4.5, 5.25, 6.0, 8.5, 10.0)
    found = [False, True, True, True, True, False, False]
    assert pierced(corners, frames_s, 1e-4) == found


def test_without_a_log_a_frame_is_pierced_from_the_puncture_on():
    nothing = np.zeros(0)
    times_s = np.array([1.0, 3.0])
    assert after_punctures(times_s, [2.0], nothing, nothing) == [False, True]
    assert after_punctures(times_s, [], nothing, nothing) == [False, False]
