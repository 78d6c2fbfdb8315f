"""Virtual acquisitions: force logs, held and moving needles, one eye and many."""

import json
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from effects import contents, less_than

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.front.cli.main import run
from scleraforce.lab.virtual_eye import (
    LinearSections,
    paper_eyes,
)
from scleraforce.lab.virtual_recording import (
    PhantomPlan,
    in_planes,
    needle_tip,
    plan_moving_phantom,
    plan_phantom,
    plan_sections,
    render_frame,
    with_travel,
    write_phantom,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.frame_and_force_tables import ForceLog
from scleraforce.recordings.recording_folder import read_recording, true_forces
from scleraforce.records import study as st
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.motion import Motion
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Plane, Scan
from scleraforce.records.setup import Setup
from virtual_eyes import changed, wall_of

STUDY = st.Study(oct=st.OctStudy(columns=128, rows=96), mesh=st.MeshStudy(divisions=4))
EYE = Setup(
    eye=Eye("eye-x", thickness_m=600e-6, modulus=Modulus.stated(0.25e6), iop_pa=266.0),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.6),
    scan=Scan(direction_rad=0.2),
)
FORCES_N = (0.02, 0.002, 0.045)


def dented_sections(forces_n):
    angle = np.linspace(-1.2, 1.2, 300)
    outside = 12e-3 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    dent = np.exp(-((angle / 0.13) ** 2))

    for force_n in forces_n:
        outer = outside + np.stack([0 * angle, 40e-3 * force_n * dent], axis=1)
        yield WallSection(
            outer, outer + 600e-6 * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        )


@pytest.fixture(scope="module")
def plan() -> PhantomPlan:
    return plan_phantom(EYE, FORCES_N, STUDY, 3)


@pytest.fixture(scope="module")
def written(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "rec"
    write_phantom(path, plan, dented_sections, STUDY)
    return path


def truth_of(recording):
    return json.loads((recording / "truth.json").read_text())


@pytest.mark.parametrize(
    ("part", "range_name", "value"),
    [("needle", "needle_count", 1), ("conjunctiva", "conjunctiva_thickness_m", 140e-6)],
)
def test_a_needle_or_a_conjunctiva_is_one_in_a_recording_and_leaves_every_other_number(
    plan, part, range_name, value
):
    """A conjunctiva slides from push to push, and is pressed by the force of each."""
    phantom = replace(STUDY.phantom, **{range_name: st.fixed(value)})
    other = plan_phantom(EYE, FORCES_N, replace(STUDY, phantom=phantom), 3)
    with_part = [frame.optics for frame in other.frames]
    assert [replace(optics, **{part: None}) for optics in with_part] == [
        frame.optics for frame in plan.frames
    ]
    parts = [getattr(optics, part) for optics in with_part]
    if part == "needle":
        assert {needle.gap_m for needle in parts} == {wall_of(EYE).gap_m}
    else:
        assert len({layer.phase_rad for layer in parts}) == len(FORCES_N)
        assert [layer.press.force_n for layer in parts] == list(FORCES_N)
        assert {(layer.press.radius_m, layer.press.gap_m) for layer in parts} == {
            (0.35e-3, wall_of(EYE).gap_m)
        }
        parts = [replace(layer, phase_rad=0.0, press=None) for layer in parts]

    assert len(set(parts)) == 1


BENT = st.MechanicsStudy(kind="finite-strain")
PLANES = Plane("along", 0.0, 0.0), Plane("across", 0.1e-3, np.pi / 2)


def test_the_planes_of_a_moment_see_one_eye_and_one_needle(tmp_path):
    """A plane across another one sees its gap as a lateral place, and its tilt as a
    rotation.
    """
    ranges = {
        "needle_count": st.fixed(1),
        "needle_lean_rad": st.fixed(0.2),
        "needle_angle_rad": st.fixed(-0.3),
    }
    phantom = replace(STUDY.phantom, eye_tilt_rad=st.Range(min=-0.1, max=0.1), **ranges)
    study = replace(STUDY, phantom=phantom, mechanics=BENT)
    plan = in_planes(plan_phantom(EYE, FORCES_N, study, 3), PLANES, study)
    assert [frame.file for frame in plan.frames[:3]] == [
        "0001-1.png",
        "0001-2.png",
        "0002-1.png",
    ]
    assert plan.forces_n[::2] == plan.forces_n[1::2] == pytest.approx(FORCES_N)

    for along, across in zip(plan.frames[::2], plan.frames[1::2], strict=True):
        assert (along.time_s, along.plane, across.plane) == (across.time_s, *PLANES)
        assert across.pose.lateral_m == pytest.approx(-along.cut.gap_m)
        assert across.cut.gap_m == pytest.approx(0.1e-3 + along.pose.lateral_m)
        assert (across.pose.tilt_rad, across.cut.tilt_rad) == pytest.approx(
            (along.cut.tilt_rad, -along.pose.tilt_rad)
        )
        assert (along.cut.direction_rad, across.cut.direction_rad) == pytest.approx(
            (0.2, 0.2 + np.pi / 2)
        )
        needle = along.optics.needle
        assert needle.angle_rad == pytest.approx(-0.3)
        assert np.tan(across.optics.needle.angle_rad) == pytest.approx(
            -np.tan(0.2) / np.cos(0.3)
        )
        assert across.optics.needle.gap_m == across.cut.gap_m
        axes = [plane.optics.needle.from_normal[0] for plane in (along, across)]
        assert axes[0] == pytest.approx(axes[1], abs=0.01)

    with pytest.raises(RecordingError, match="planes, and its sections are of one"):
        write_phantom(tmp_path / "rec", plan, dented_sections, study)


@pytest.mark.parametrize(
    "changes",
    [{}, {"globe": st.GlobeStudy(kind="sealed", leak_time_s=9.0), "mechanics": BENT}],
)
def test_several_planes_are_of_an_eye_at_finite_strain_that_does_not_leak(changes):
    study = replace(STUDY, **changes)
    with pytest.raises(
        RecordingError, match="planes: of an eye that keeps still, does not leak"
    ):
        in_planes(plan_phantom(EYE, FORCES_N, study, 3), PLANES, study)


@pytest.mark.parametrize(
    ("name", "seed", "same"), [("eye-x", 3, True), ("eye-x", 4, False), ("y", 3, False)]
)
def test_same_seed_gives_the_same_bytes_and_another_seed_or_eye_others(
    written, tmp_path, name, seed, same
):
    plan = plan_phantom(changed(EYE, name=name), FORCES_N, STUDY, seed)
    write_phantom(tmp_path / "rec", plan, dented_sections, STUDY)
    assert (contents(tmp_path / "rec") == contents(written)) is same
    logs = [(path / "forces.csv").read_bytes() for path in (written, tmp_path / "rec")]
    assert (logs[0] == logs[1]) is same


def test_nothing_half_written_is_left_and_nothing_is_overwritten(
    written, plan, tmp_path
):
    def interrupted(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_phantom(tmp_path / "other", plan, dented_sections, STUDY, interrupted)

    assert not list(tmp_path.iterdir())
    before = contents(written)
    with pytest.raises(RecordingError, match="rec: exists already; remove it"):
        write_phantom(written, plan, dented_sections, STUDY)

    assert contents(written) == before
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        write_phantom(tmp_path / "file" / "rec", plan, dented_sections, STUDY)


@pytest.mark.parametrize(
    "forces_n", [(), (-0.01,), (float("nan"),), (0.01, 1e6)], ids=str
)
def test_impossible_forces_are_refused(forces_n):
    with pytest.raises(RecordingError, match="eye eye-x: forces: "):
        plan_phantom(EYE, forces_n, STUDY, 0)


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ({"rate_hz": 0.0}, "rate: "),
        ({"ramp_n_per_s": -1.0}, "ramp: "),
        ({"hold_s": float("nan")}, "hold: "),
        ({"puncture_n": -0.01}, "forces: "),
        ({"puncture_n": 0.035}, "puncture: 35 mN; must be "),
        ({"puncture_n": 5.0}, "forces: 5000 mN; up to"),
    ],
)
def test_impossible_motions_are_refused(motion, said):
    with pytest.raises(RecordingError, match=f"eye eye-x: {said}"):
        moving(**motion)


def test_a_puncture_is_of_an_eye_that_keeps_still(tmp_path):
    """Sections that are not of one resting eye stand for those of an eye that turns."""
    plan = moving(puncture_n=0.04)
    with pytest.raises(RecordingError, match="puncture: of an eye that keeps still"):
        write_phantom(tmp_path / "x", plan, flat_sections, MOVING_STUDY)


def forces_mn(eyes):
    return 1e3 * np.array([force_n for _, forces_n in eyes for force_n in forces_n])


def test_paper_eyes_have_the_design_of_tables_1_and_2():
    study = st.Study()
    eyes = paper_eyes(study)
    counts = [
        Counter(study.classes.classify(force_n) for force_n in forces_n)
        for _, forces_n in eyes
    ]
    expected = [0, 11, 14], [1, 2, 2], [2, 0, 3], [2, 1, 2], [2, 1, 2]
    assert [[count[target] for target in range(3)] for count in counts] == [*expected]
    assert np.abs(forces_mn(eyes)[:, None] - [5.0, 30.0]).min() >= 2.0
    # others of the same eyes and classes may lie at the bounds
    near = paper_eyes(study, to_the_bounds=True)
    assert [eye for eye, _ in near] == [eye for eye, _ in eyes]
    assert [
        Counter(study.classes.classify(force_n) for force_n in forces_n)
        for _, forces_n in near
    ] == counts
    assert np.abs(forces_mn(near)[:, None] - [5.0, 30.0]).min() < 1.0


def test_commands_write_recordings_of_held_and_moving_needles_and_print_json(
    tmp_path, capsys
):
    study = tmp_path / "study.toml"
    out = tmp_path / "eye"
    study.write_text(st.format_study(MOVING_STUDY))
    arguments = ["phantom", "--study", str(study), "--eye", "pig", "--json", "--out"]
    given = ["--forces-mn", "30,2", "--thickness-um", "700", "--iop-mmhg", "3"]
    assert run([*arguments, str(out), *given]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 2
    eye = read_recording(out).info.eye
    assert (eye.name, eye.thickness_m) == ("pig", 700e-6)
    assert eye.iop_pa == pytest.approx(400.0, abs=0.1)
    assert list(true_forces(out).values()) == pytest.approx([30e-3, 2e-3])
    motion = "--forces-mn 10,4 --rate-hz 20 --ramp-mn-per-s 20 --hold-s 0.3"
    assert run([*arguments, str(tmp_path / "moving"), *motion.split()]) == 0
    # 2.5 + 0.5 + 0.3 + 0.3 + 0.3 s, the first at 0.1 s
    assert json.loads(capsys.readouterr().out)["frames"] == 77


@pytest.mark.parametrize("content", ["{", "[]", '{"frames": [{"file": "0001.png"}]}'])
def test_a_truth_that_is_broken_is_one_clear_line(tmp_path, content):
    (tmp_path / "truth.json").write_text(content)
    with pytest.raises(RecordingError, match=r"truth\.json: "):
        true_forces(tmp_path)


PHANTOM = st.PhantomStudy(approach_s=st.fixed(2.5), shadow_count=st.fixed(2))
MOVING_STUDY = st.Study(
    oct=st.OctStudy(columns=64, rows=48),
    mesh=st.MeshStudy(divisions=4),
    phantom=PHANTOM,
)
TURNING_POINTS_N = (0.02, 0.005, 0.035)


def moving(study=MOVING_STUDY, seed=3, **changes):
    motion = {"rate_hz": 50.0, "ramp_n_per_s": 0.02, "hold_s": 0.5} | changes
    return plan_moving_phantom(EYE, TURNING_POINTS_N, study, seed, Motion(**motion))


def flat_sections(forces_n):
    lateral_m = np.linspace(-9e-3, 9e-3, 50)
    for force_n in forces_n:
        outer = np.stack([lateral_m, np.full(50, 20e-3 * force_n)], axis=1)
        yield WallSection(outer, outer + np.array([0.0, 600e-6]))


def test_the_force_follows_ramps_and_holds_through_its_turning_points():
    plan = moving()
    times_s = np.array([frame.time_s for frame in plan.frames])
    # Off for 2.5 s; 1 s up to 20 mN; 0.5 s there; 0.75 s down to 5 mN; 0.5 s there; 1.5
    # s up to 35 mN; 0.5 s there.
    at_s = [2.4, 3.0, 3.6, 3.96, 4.4, 5.0, 6.0, 7.2]
    expected_mn = np.array([0.0, 10.0, 20.0, 20.0, 12.0, 5.0, 20.0, 35.0])
    assert np.interp(at_s, times_s, plan.forces_n) == pytest.approx(
        expected_mn / 1e3, abs=1e-9
    )
    assert np.abs(np.diff(plan.forces_n)).max() == pytest.approx(0.02 / 50)
    assert plan.path.times_s[-1] == pytest.approx(7.25)
    assert (times_s[0], times_s[-1]) == (0.1, pytest.approx(7.25, abs=0.02))
    assert np.diff(times_s) == pytest.approx(0.02)
    # constant beyond its end
    assert plan.path.felt_n(np.array([9.0])) == pytest.approx(0.035)


def test_labels_of_its_recording_follow_a_needle_that_moves(tmp_path):
    """With noise of 4 mN, and steps of 5 mN below 5 Hz."""
    plan = moving()
    few = replace(plan, frames=plan.frames[::4])
    write_phantom(tmp_path / "rec", few, flat_sections, MOVING_STUDY)
    trials = label_frames(read_recording(tmp_path / "rec"), MOVING_STUDY.classes)
    errors_n = np.array([trial.measured_force_n for trial in trials]) - few.forces_n
    assert np.sqrt((errors_n**2).mean()) < 1.5e-3


def test_the_eye_and_the_light_change_smoothly_within_their_ranges():
    frames = moving(rate_hz=100.0, hold_s=20.0).frames
    for values, low, high, fastest in (
        ([frame.pose.lateral_m for frame in frames], -0.2e-3, 0.2e-3, 0.7e-3),
        ([frame.pose.depth_m for frame in frames], 0.15e-3, 0.8e-3, 0.7e-3),
        ([frame.optics.snr_db for frame in frames], 15.0, 35.0, 32.0),
        ([frame.optics.reflection_db for frame in frames], -3.0, 9.0, 19.0),
    ):
        assert low <= min(values) < max(values) <= high
        assert max(values) - min(values) > 0.3 * (high - low) * (
            0.6 if high == 0.8e-3 else 1.0
        )
        # a second; half waves are pi/2 times the mean slope
        assert np.abs(np.diff(values)).max() * 100.0 < fastest

    assert len({frame.optics.shadows for frame in frames}) == 1
    assert len({frame.seed for frame in frames}) == len(frames)


@pytest.fixture(scope="module")
def through() -> tuple[PhantomPlan, LinearSections]:
    sections_at = LinearSections(EYE, MOVING_STUDY)
    return with_travel(moving(rate_hz=200.0, puncture_n=0.04), sections_at), sections_at


def test_through_the_wall_the_force_falls_within_milliseconds_and_friction_turns_with_the_needle(
    through,
):
    pierced, _ = through
    path = pierced.path
    puncture = path.puncture
    assert puncture.force_n == 0.04
    assert puncture.fall_s <= 4e-3
    friction_n = puncture.friction_fraction * 0.04
    after_s = puncture.time_s + puncture.fall_s * np.array([0.0, 0.5, 1.0])
    falling_n = [0.04, (0.04 + friction_n) / 2, friction_n]
    assert path.felt_n(after_s) == pytest.approx(falling_n)
    out_s = puncture.out_s + puncture.fall_s
    assert path.felt_n(np.array([out_s, 99.0])) == pytest.approx([0.0, 0.0])

    times_s = np.array([frame.time_s for frame in pierced.frames])
    turns_s = puncture.driven_s[-2]
    on = (times_s > puncture.time_s + puncture.fall_s) & (times_s < turns_s)
    back = (times_s > turns_s) & (times_s < puncture.out_s)
    forces_n = np.array(pierced.forces_n)
    assert forces_n[on] == pytest.approx(friction_n)
    assert forces_n[back].min() == pytest.approx(-friction_n)
    assert times_s[-1] <= out_s
    travels_m = np.array([frame.travel.travel_m for frame in pierced.frames])
    before = (times_s > puncture.time_s - 0.1) & (times_s < puncture.time_s)
    assert (np.diff(travels_m[on]) > 0.0).all(), "the needle continues"
    assert np.diff(travels_m[on]).mean() == pytest.approx(
        np.diff(travels_m[before]).mean()
    )
    assert (np.diff(travels_m[back]) < 0.0).all()
    inside_m = np.array([frame.travel.inside_m for frame in pierced.frames])
    assert inside_m[back][-1] == pytest.approx(0.0, abs=5e-5)


def test_the_dent_springs_back_is_pulled_outwards_and_a_track_stays_as_deep_as_the_needle_was(
    through,
):
    pierced, sections_at = through
    sections, _ = plan_sections(pierced, sections_at)
    rest = sections_at([0.0])[0]
    tops_m = np.array(
        [
            needle_tip(frame, section)[1] - frame.pose.depth_m
            for frame, section in zip(pierced.frames, sections, strict=True)
        ]
    )
    rest_m = needle_tip(pierced.frames[0], rest)[1] - pierced.frames[0].pose.depth_m
    ratio = (tops_m - rest_m) / np.maximum(np.abs(pierced.forces_n), 1e-9)
    assert (np.sign(tops_m - rest_m) == np.sign(pierced.forces_n))[
        np.abs(pierced.forces_n) > 1e-3
    ].all()
    assert (
        np.ptp(np.abs(ratio[np.abs(pierced.forces_n) > 5e-3]))
        < 0.1 * np.abs(ratio).max()
    )
    tracked = pierced.frames[-1]
    section = sections[-1]
    without = render_frame(replace(tracked, travel=None), section, MOVING_STUDY).frame
    seen = render_frame(tracked, section, MOVING_STUDY).frame
    rows, columns = np.nonzero(seen != without)
    pixel_m = MOVING_STUDY.oct.depth_m / MOVING_STUDY.oct.rows
    assert tracked.travel.track_m == max(
        frame.travel.track_m for frame in pierced.frames
    )
    assert 0 < np.ptp(columns) <= 10
    assert np.ptp(rows) * pixel_m <= tracked.travel.track_m + 8 * pixel_m


def test_a_recording_of_it_has_the_travel_and_only_its_truth_the_puncture(
    through, tmp_path
):
    pierced, sections_at = through
    few = replace(pierced, frames=pierced.frames[::40])
    write_phantom(tmp_path / "rec", few, sections_at, MOVING_STUDY)
    entries = read_recording(tmp_path / "rec").frames
    truth = truth_of(tmp_path / "rec")
    assert {entry.pierced for entry in entries} == {None}
    assert [entry.travel_m for entry in entries] == pytest.approx(
        [frame.travel.travel_m for frame in few.frames], abs=1e-6
    )
    puncture_s = truth["puncture"]["time_s"]
    assert puncture_s == pierced.path.puncture.time_s
    inside = [entry.time_s > puncture_s for entry in entries]
    assert [frame["pierced"] for frame in truth["frames"]] == inside


PUSHES_N = (0.002, 0.02, 0.0, 0.055)
RELAXING = ((st.fixed(0.12), st.fixed(1.2)), (st.fixed(0.15), st.fixed(12.0)))


def pushed(relaxation=RELAXING, **phantom) -> PhantomPlan:
    study = replace(
        STUDY,
        phantom=st.PhantomStudy(**phantom),
        tissue=st.TissueStudy(relaxation=relaxation),
    )
    return plan_phantom(EYE, PUSHES_N, study, 0)


def test_the_force_is_the_given_one_at_frames_and_falls_as_tissue_relaxes_while_the_dent_stays():
    plan = pushed()
    pushes = [frame.push for frame in plan.frames]
    path = plan.path
    assert plan.forces_n == pytest.approx(PUSHES_N, abs=1e-12)
    first, *_, last = pushes
    hold_s = last.start_s + last.ramp_s + np.linspace(0.0, last.hold_s, 200)
    assert (np.diff(path.felt_n(hold_s)) < 0.0).all()
    assert np.ptp(path.elastic_n(hold_s)) < 1e-12
    # after rest: the ramp's convolution with G
    since_s = np.linspace(0.0, first.ramp_s + first.hold_s, 4000)
    driven_n = path.elastic_n(first.start_s + since_s + 1e-9)
    left_s = since_s[-1] - (since_s[1:] + since_s[:-1]) / 2
    left = 1.0 - 0.12 * (1 - np.exp(-left_s / 1.2)) - 0.15 * (1 - np.exp(-left_s / 12))
    expected_n = driven_n[0] + float(np.diff(driven_n) @ left)
    assert path.felt_n(np.array([first.start_s + since_s[-1]])) == pytest.approx(
        expected_n, abs=1e-8
    )
    between_s = [(a.corners_s[-1] + b.start_s) / 2 for a, b in pairwise(pushes)]
    rests_s = np.array([0.0, *between_s])
    assert (path.felt_n(rests_s) == 0.0).all()
    assert (path.elastic_n(rests_s) == 0.0).all()


def test_a_frame_shows_the_dent_of_the_elastic_force_and_truth_tells_both(
    tmp_path,
):
    first, _ = RELAXING
    plan = pushed((first, (st.Range(min=0.1, max=0.2), st.fixed(12.0))))
    asked: list[list[float]] = []

    def sections(forces_n):
        asked.append(list(forces_n))
        return list(flat_sections(forces_n))

    write_phantom(tmp_path / "rec", plan, sections, STUDY)
    truth = truth_of(tmp_path / "rec")
    told = {
        key: [frame[key] for frame in truth["frames"]]
        for key in ("force_n", "elastic_force_n")
    }
    assert told["force_n"] == pytest.approx(PUSHES_N, abs=1e-12)
    assert told["elastic_force_n"] == asked[-1] == plan.elastic_n
    (kept, _), (drawn, _) = truth["tissue"]["relaxation"]
    assert kept == 0.12
    assert 0.1 <= drawn <= 0.2
    elastic_n = np.array(plan.elastic_n)
    assert (np.array(PUSHES_N) <= (1.0 - 0.12 * 0.8) * elastic_n).all()
    assert pushed(()).elastic_n == pushed(()).forces_n


def logged(path, **phantom) -> tuple[PhantomPlan, ForceLog]:
    plan = pushed(**phantom)
    write_phantom(path, plan, flat_sections, STUDY)
    return plan, read_recording(path).forces


def test_the_log_is_the_force_with_sign_offset_drift_noise_and_cross_talk_at_its_rate_in_steps(
    tmp_path,
):
    _, log = logged(tmp_path / "steps", sample_rate_hz=500.0)
    assert np.diff(log.time_s) == pytest.approx(1 / 500.0)
    steps = log.wrench_sc[:, :3] / 5e-3
    assert np.abs(steps - np.rint(steps)).max() < 1e-6
    drift = {"force_drift_n_per_s": st.fixed(1e-4)}
    plan, log = logged(tmp_path / "even", force_step_n=0.0, **drift)
    sensor = plan.sensor
    force_n = plan.path.felt_n(log.time_s)
    rest = log.wrench_sc[:, 2] + force_n - sensor.offset_n[2]
    rest -= sensor.drift_n_per_s * log.time_s
    assert rest.std() == pytest.approx(sensor.noise_n, rel=0.03)
    assert abs(rest.mean()) < 4 * sensor.noise_n / np.sqrt(len(rest))
    assert np.corrcoef(rest[1:], rest[:-1])[0, 1] == pytest.approx(0.0, abs=0.05)
    assert log.wrench_sc[:, 3:].std() == pytest.approx(sensor.torque_noise_nm, rel=0.05)

    for column, share in enumerate(sensor.cross_talk_fraction):
        slope, offset = np.polyfit(force_n, log.wrench_sc[:, column], 1)
        assert slope == pytest.approx(share, abs=0.01)
        assert offset == pytest.approx(sensor.offset_n[column], abs=3e-4)


def test_a_plan_of_too_many_frames_is_refused_before_they_are_drawn():
    """1.8 billion frames, each within the limits of rate, ramp and hold."""
    motion = {"rate_hz": 1000.0, "ramp_n_per_s": 1e-5, "hold_s": 3600.0}
    with less_than(64 * 2**20), pytest.raises(RecordingError, match="may have 100000"):
        plan_moving_phantom(EYE, (0.02, 0.03) * 250, STUDY, 0, Motion(**motion))
