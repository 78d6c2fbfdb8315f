"""A phantom whose needle moves while frames are taken."""

import json
from itertools import pairwise

import numpy as np
import pytest

from scleraforce.cli.main import run
from scleraforce.errors import RecordingError
from scleraforce.laboratory.phantom import plan_moving_phantom, render_frame, write_phantom
from scleraforce.laboratory.pushes import ForcePath, motion_end_s, true_force
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections, study_sections
from scleraforce.mechanics.contact import Section
from scleraforce.recording.folder import read_recording, true_forces
from scleraforce.recording.labels import label_frames
from scleraforce.study import MechanicsStudy, MeshStudy, OctStudy, PhantomStudy, Study, fixed, format_study

STUDY = Study(
    oct=OctStudy(columns=64, rows=48),
    mesh=MeshStudy(divisions=4),
    phantom=PhantomStudy(approach_s=fixed(2.5), shadow_count=fixed(2)),
)
EYE = PhantomEye(id="eye-x", thickness_m=600e-6, youngs_modulus_pa=0.25e6, iop_pa=266.0, gap_m=0.5e-3, polar_rad=0.6)
TURNING_POINTS_N = (0.02, 0.005, 0.035)


def plan(study=STUDY, seed=3, **changes):
    motion = {"rate_hz": 50.0, "ramp_n_per_s": 0.02, "hold_s": 0.5} | changes
    return plan_moving_phantom(EYE, TURNING_POINTS_N, study, seed, **motion)


def flat_sections(forces_n):
    lateral_m = np.linspace(-9e-3, 9e-3, 50)
    for force_n in forces_n:
        outer = np.stack([lateral_m, np.full(50, 20e-3 * force_n)], axis=1)
        yield Section(outer, outer + np.array([0.0, 600e-6]))


def test_the_force_follows_ramps_and_holds_through_its_turning_points() -> None:
    moving = plan()
    forces_n = np.array(moving.forces_n)
    times_s = np.array([frame.time_s for frame in moving.frames])
    # Off for 2.5 s; 1 s up to 20 mN; 0.5 s there; 0.75 s down to 5 mN; 0.5 s there; 1.5 s up to 35 mN; 0.5 s there.
    expected_mn = [
        (2.4, 0.0),
        (3.0, 10.0),
        (3.6, 20.0),
        (3.96, 20.0),
        (4.4, 12.0),
        (5.0, 5.0),
        (6.0, 20.0),
        (7.2, 35.0),
    ]
    for time_s, force_mn in expected_mn:
        assert forces_n[np.argmin(np.abs(times_s - time_s))] == pytest.approx(force_mn / 1e3, abs=1e-9)
    assert np.abs(np.diff(forces_n)).max() == pytest.approx(0.02 / 50)
    assert motion_end_s(moving.motion) == pytest.approx(7.25)
    assert times_s[-1] == pytest.approx(7.25, abs=0.02)


def test_frames_come_at_the_rate_from_before_contact_to_the_last_hold() -> None:
    times_s = np.array([frame.time_s for frame in plan(rate_hz=100.0).frames])
    assert np.diff(times_s) == pytest.approx(0.01)
    assert times_s[0] == 0.1
    assert len({frame.file for frame in plan(rate_hz=1000.0, hold_s=2.0).frames}) == 11651


def test_a_path_stays_at_its_ends() -> None:
    path = ForcePath((1.0, 2.0), (0.01, 0.03))
    assert true_force(path, np.array([0.0, 1.5, 9.0])).tolist() == pytest.approx([0.01, 0.02, 0.03])


def test_the_eye_and_the_light_change_smoothly_within_their_ranges() -> None:
    frames = plan(rate_hz=100.0, hold_s=20.0).frames
    for values, low, high, fastest in (
        ([frame.pose.lateral_m for frame in frames], -0.2e-3, 0.2e-3, 0.7e-3),
        ([frame.pose.depth_m for frame in frames], 0.15e-3, 0.8e-3, 0.7e-3),
        ([frame.optics.snr_db for frame in frames], 15.0, 35.0, 32.0),
        ([frame.optics.reflection_db for frame in frames], -3.0, 9.0, 19.0),
    ):
        assert low <= min(values) < max(values) <= high
        assert max(values) - min(values) > 0.3 * (high - low) * (0.6 if high == 0.8e-3 else 1.0)
        assert np.abs(np.diff(values)).max() * 100.0 < fastest  # a second; half waves are pi/2 times the mean slope
    assert len({frame.optics.shadows for frame in frames}) == 1
    assert len({frame.seed for frame in frames}) == len(frames)


@pytest.mark.slow
def test_a_recording_of_it_is_labelled_with_the_force_at_each_frame(tmp_path) -> None:
    moving = plan(ramp_n_per_s=0.02)
    write_phantom(tmp_path / "rec", moving, flat_sections, STUDY)
    recording = read_recording(tmp_path / "rec")
    assert recording.info.force is not None
    assert recording.info.force.average_s == 0.1
    trials = label_frames(recording, STUDY.classes)
    errors_n = np.array([trial.measured_force_n for trial in trials]) - moving.forces_n
    assert np.sqrt((errors_n**2).mean()) < 1.5e-3  # noise of 4 mN and steps of 5 mN below 5 Hz
    assert list(true_forces(tmp_path / "rec").values()) == moving.forces_n
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())
    assert truth["path"]["forces_n"] == [0.0, 0.0, 0.02, 0.02, 0.005, 0.005, 0.035, 0.035]
    assert "push" not in truth["frames"][0]
    frame, section = moving.frames[200], list(flat_sections(moving.forces_n))[200]
    assert (recording.frame(recording.frames[200]) == render_frame(frame, section, STUDY).frame).all()


def test_equal_seeds_give_equal_plans_and_others_others() -> None:
    assert plan() == plan()
    assert plan().frames[9].pose != plan(seed=4).frames[9].pose


def test_sections_of_many_forces_are_those_of_each_alone() -> None:
    sections_at = linear_sections(EYE, STUDY)
    forces_n = np.linspace(0.0, 0.03, 300)
    many = sections_at(forces_n)
    assert len(many) == 300
    for index in (0, 255, 256, 299):
        (alone,) = sections_at([forces_n[index]])
        assert np.abs(many[index].outer - alone.outer).max() < 1e-12


@pytest.mark.slow
def test_a_finite_strain_eye_moves_too() -> None:
    study = Study(mesh=MeshStudy(kind="graded", core=4, rings=6), mechanics=MechanicsStudy("finite-strain"))
    sections = study_sections(EYE, study)(plan(study, rate_hz=20.0, hold_s=0.0).forces_n)
    top_m = [np.interp(0.0, section.outer[:, 0], section.outer[:, 1]) for section in sections]
    assert max(np.abs(np.diff(top_m))) < 0.2e-3 < 1e-3 < max(top_m) - min(top_m)


@pytest.mark.parametrize("changes", [{"rate_hz": 0.0}, {"ramp_n_per_s": -1.0}, {"hold_s": float("nan")}])
def test_a_motion_that_is_none_is_an_error(changes) -> None:
    with pytest.raises(RecordingError, match=r"eye eye-x: (rate|ramp|hold): .* must be between"):
        plan(**changes)


def test_the_command_writes_a_moving_recording(tmp_path, capsys) -> None:
    study = tmp_path / "study.toml"
    study.write_text(format_study(STUDY))
    arguments = ["phantom", "--study", str(study), "--out", str(tmp_path / "moving"), "--forces-mn", "10,4", "--json"]
    assert run([*arguments, "--rate-hz", "20", "--ramp-mn-per-s", "20", "--hold-s", "0.3"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 77  # 2.5 + 0.5 + 0.3 + 0.3 + 0.3 s, the first at 0.1 s
    entries = read_recording(tmp_path / "moving").frames
    assert all(b.time_s - a.time_s == pytest.approx(0.05) for a, b in pairwise(entries))
    assert run([*arguments[:4], str(tmp_path / "x"), "--hold-s", "2"]) == 2
    assert "give --rate-hz too" in capsys.readouterr().err
