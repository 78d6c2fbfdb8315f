"""Virtual acquisitions: force logs, held and moving needles, one eye and many."""

import json
from collections import Counter
from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest
from effects import contents, less_than

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.front.cli.main import run
from scleraforce.lab.needle_pushes import (
    NeedlePath,
    path_of_pushes,
    plan_pushes,
    sample_sensor,
    sense,
)
from scleraforce.lab.virtual_eye import (
    LinearSections,
    paper_eyes,
    scan_plane,
    study_sections,
)
from scleraforce.lab.virtual_recording import (
    PhantomPlan,
    in_planes,
    needle_tip,
    phantom_truth,
    plan_moving_phantom,
    plan_phantom,
    plan_sections,
    render_frame,
    with_travel,
    write_phantom,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.recording_folder import read_recording, true_forces
from scleraforce.records import study as st, study_of_eye
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
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


@pytest.fixture
def written(tmp_path):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    write_phantom(tmp_path / "rec", plan, dented_sections, STUDY)
    return tmp_path / "rec"


def test_the_recording_has_the_plans_frames_forces_and_values(written):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    recording = read_recording(written)
    info = recording.info
    assert (info.eye_name, info.eye.thickness_m, info.eye.globe) == (
        "eye-x",
        600e-6,
        OPEN,
    )
    assert (
        info.needle.gap_m,
        info.needle.gauge,
        info.scan.direction_rad,
    ) == (0.5e-3, 22, 0.2)
    assert [frame.file for frame in recording.frames] == [
        "0001.png",
        "0002.png",
        "0003.png",
    ]
    trials = label_frames(recording, STUDY.classes)
    assert [trial.measured_force_n for trial in trials] == pytest.approx(
        FORCES_N, abs=1.5e-3
    )
    assert [trial.target for trial in trials] == [1, 0, 2]

    for entry, frame, section in zip(
        recording.frames, plan.frames, dented_sections(FORCES_N), strict=True
    ):
        assert (
            recording.frame(entry) == render_frame(frame, section, STUDY).frame
        ).all()


def test_the_planes_of_a_moment_see_one_eye_and_one_needle():
    """A plane across another one sees its gap as a lateral place, and its tilt as a
    rotation.
    """
    ranges = {
        "needle_count": st.fixed(1),
        "needle_lean_rad": st.fixed(0.2),
        "needle_angle_rad": st.fixed(-0.3),
    }
    phantom = replace(STUDY.phantom, eye_tilt_rad=st.Range(min=-0.1, max=0.1), **ranges)
    study = replace(
        STUDY, phantom=phantom, mechanics=st.MechanicsStudy(kind="finite-strain")
    )
    planes = Plane("along", 0.0, 0.0), Plane("across", 0.1e-3, np.pi / 2)
    plan = in_planes(plan_phantom(EYE, FORCES_N, study, 3), planes, study)
    assert [frame.file for frame in plan.frames[:3]] == [
        "0001-1.png",
        "0001-2.png",
        "0002-1.png",
    ]
    assert plan.forces_n[::2] == plan.forces_n[1::2] == pytest.approx(FORCES_N)

    for along, across in zip(plan.frames[::2], plan.frames[1::2], strict=True):
        assert (along.time_s, along.plane, across.plane) == (across.time_s, *planes)
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

    for other in (
        STUDY,
        replace(study, globe=st.GlobeStudy(kind="sealed", leak_time_s=9.0)),
    ):
        with pytest.raises(
            RecordingError, match="planes: of an eye that keeps still, does not leak"
        ):
            in_planes(plan_phantom(EYE, FORCES_N, other, 3), planes, other)

    with pytest.raises(
        RecordingError, match="of several planes, and its sections are of one"
    ):
        plan_sections(plan, dented_sections)


def test_truth_has_every_parameter(written):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    truth = json.loads((written / "truth.json").read_text())
    assert truth["simulated"] is True
    assert "cornea" not in truth["form"]
    study = replace(
        STUDY, form=st.FormStudy(cornea=study_of_eye.CorneaStudy(radius_m=8e-3))
    )
    assert phantom_truth(plan, study, [0.0] * 3)["form"]["cornea"] == asdict(
        study_of_eye.CorneaStudy(radius_m=8e-3)
    )
    assert truth["eye"] == {
        "id": "eye-x",
        "thickness_m": 600e-6,
        "youngs_modulus_pa": 0.25e6,
        "iop_pa": 266.0,
        "gap_m": wall_of(EYE).gap_m,
        **asdict(scan_plane(EYE).contact),
        "direction_rad": scan_plane(EYE).direction_rad,
        "tilt_rad": scan_plane(EYE).tilt_rad,
    }
    assert truth["globe"]["kind"] == "open"
    assert truth["tissue"] == json.loads(json.dumps(asdict(STUDY.tissue)))
    assert [frame["pressure_pa"] for frame in truth["frames"]] == [
        wall_of(EYE).iop_pa
    ] * 3
    assert truth["seed"] == 3
    assert set(truth["versions"]) >= {"scleraforce", "numpy"}
    assert [frame["force_n"] for frame in truth["frames"]] == pytest.approx(FORCES_N)
    assert [frame["target"] for frame in truth["frames"]] == [1, 0, 2]

    for said, frame in zip(truth["frames"], plan.frames, strict=True):
        assert said["pose"] == asdict(frame.pose)
        assert said["optics"] == json.loads(json.dumps(asdict(frame.optics)))
        assert said["seed"] == list(frame.seed)


def test_same_seed_gives_the_same_bytes_and_another_seed_or_eye_others(
    written, tmp_path
):
    for name, eye, seed, same in (
        ("a", EYE, 3, True),
        ("b", EYE, 4, False),
        ("c", changed(EYE, name="y"), 3, False),
    ):
        write_phantom(
            tmp_path / name,
            plan_phantom(eye, FORCES_N, STUDY, seed),
            dented_sections,
            STUDY,
        )
        assert (contents(tmp_path / name) == contents(written)) is same
        assert (
            (tmp_path / name / "forces.csv").read_bytes()
            == (written / "forces.csv").read_bytes()
        ) is same


def test_a_conjunctiva_is_one_in_a_recording_and_slides_from_push_to_push():
    study = replace(
        STUDY, phantom=replace(STUDY.phantom, conjunctiva_thickness_m=st.fixed(140e-6))
    )
    plans = (plan_phantom(EYE, FORCES_N, each, 3) for each in (study, STUDY))
    with_layer, bare = ([frame.optics for frame in each.frames] for each in plans)
    layers = [optics.conjunctiva for optics in with_layer]
    assert len({layer.phase_rad for layer in layers}) == len(FORCES_N)
    assert len({replace(layer, phase_rad=0.0, press=None) for layer in layers}) == 1
    assert [layer.press.force_n for layer in layers] == list(FORCES_N)
    assert {(layer.press.radius_m, layer.press.gap_m) for layer in layers} == {
        (0.35e-3, wall_of(EYE).gap_m)
    }
    assert [replace(optics, conjunctiva=None) for optics in with_layer] == bare


def test_nothing_half_written_is_left_and_nothing_is_overwritten(written, tmp_path):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)

    def interrupted(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_phantom(tmp_path / "other", plan, dented_sections, STUDY, interrupted)

    assert [path.name for path in tmp_path.iterdir()] == ["rec"]
    before = contents(written)
    with pytest.raises(RecordingError, match="rec: exists already; remove it"):
        write_phantom(written, plan, dented_sections, STUDY)

    assert contents(written) == before
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        write_phantom(tmp_path / "file" / "rec", plan, dented_sections, STUDY)


def test_impossible_forces_motions_and_eyes_are_errors():
    for forces_n in ((), (-0.01,), (float("nan"),), (0.01, 1e6)):
        with pytest.raises(RecordingError, match="eye eye-x: forces: "):
            plan_phantom(EYE, forces_n, STUDY, 0)

    for changes in ({"rate_hz": 0.0}, {"ramp_n_per_s": -1.0}, {"hold_s": float("nan")}):
        with pytest.raises(
            RecordingError, match=f"eye eye-x: {next(iter(changes)).split('_')[0]}: "
        ):
            plan(**changes)

    punctures = {
        -0.01: "forces: ",
        0.035: "puncture: 35 mN; must be ",
        5.0: "forces: 5000 mN; up to",
    }
    for puncture_n, said in punctures.items():
        with pytest.raises(RecordingError, match=f"eye eye-x: {said}"):
            plan(puncture_n=puncture_n)

    turning = replace(
        MOVING_STUDY,
        phantom=replace(MOVING_STUDY.phantom, eye_drift_rad=st.fixed(0.02)),
    )
    with pytest.raises(RecordingError, match="puncture: of an eye that keeps still"):
        plan_sections(plan(turning, puncture_n=0.04), study_sections(EYE, turning))

    for field, value in {
        "thickness_m": 5e-2,
        "iop_pa": -1.0,
        "name": "a/b",
        "gap_m": float("nan"),
    }.items():
        with pytest.raises(InputError, match=f"{field.replace('name', 'id')}: "):
            plan_phantom(changed(EYE, **{field: value}), FORCES_N, STUDY, 0)


def test_linear_sections_scale_with_the_force_and_start_from_the_loaded_wall():
    rest, one, two = LinearSections(EYE, STUDY)([0.0, 0.01, 0.02])
    middle = len(rest.outer) // 2
    depth_m = [section.outer[middle, 1] for section in (rest, one, two)]
    assert depth_m[1] - depth_m[0] > 0.1e-3
    assert depth_m[2] - depth_m[0] == pytest.approx(
        2 * (depth_m[1] - depth_m[0]), rel=0.05
    )
    thickness = np.linalg.norm(rest.outer[middle] - rest.inner[middle])
    assert thickness == pytest.approx(600e-6, rel=0.05)


def test_paper_eyes_have_the_design_of_tables_1_and_2():
    study = st.Study()
    eyes = paper_eyes(study)
    counts = [
        Counter(study.classes.classify(force_n) for force_n in forces_n)
        for _, forces_n in eyes
    ]
    expected = [0, 11, 14], [1, 2, 2], [2, 0, 3], [2, 1, 2], [2, 1, 2]
    assert [[count[target] for target in range(3)] for count in counts] == [*expected]
    assert [round(setup.eye.thickness_m * 1e6) for setup, _ in eyes] == [
        800,
        500,
        650,
        560,
        800,
    ]
    assert [round(setup.eye.modulus_pa / 1e6, 2) for setup, _ in eyes] == [
        0.27,
        0.22,
        0.24,
        0.29,
        0.25,
    ]
    forces_mn = (
        np.array([force_n for _, forces_n in eyes for force_n in forces_n]) * 1e3
    )
    assert len(forces_mn) == 45
    assert forces_mn.max() <= 58.0
    assert min(np.abs(forces_mn - 5.0).min(), np.abs(forces_mn - 30.0).min()) >= 2.0


def test_forces_up_to_the_bounds_are_of_the_same_eyes_and_classes():
    study = st.Study()
    eyes = paper_eyes(study, to_the_bounds=True)
    clear = paper_eyes(study)
    assert [eye for eye, _ in eyes] == [eye for eye, _ in clear]

    for (_, drawn_n), (_, spread_n) in zip(eyes, clear, strict=True):
        assert Counter(map(study.classes.classify, drawn_n)) == Counter(
            map(study.classes.classify, spread_n)
        )

    forces_mn = (
        np.array([force_n for _, forces_n in eyes for force_n in forces_n]) * 1e3
    )
    assert min(np.abs(forces_mn - 5.0).min(), np.abs(forces_mn - 30.0).min()) < 1.0
    other = replace(study, phantom=replace(study.phantom, seed=study.phantom.seed + 1))
    assert (
        eyes
        == paper_eyes(study, to_the_bounds=True)
        != paper_eyes(other, to_the_bounds=True)
    )


def test_commands_write_recordings_of_held_and_moving_needles_and_print_json(
    tmp_path, capsys
):
    study = tmp_path / "study.toml"
    out = tmp_path / "eye"
    study.write_text(st.format_study(MOVING_STUDY))
    arguments = ["phantom", "--study", str(study), "--eye", "pig", "--json", "--out"]
    given = ["--forces-mn", "30,2", "--thickness-um", "700", "--iop-mmhg", "3"]
    assert run([*arguments, str(out), *given]) == 0
    expected = {
        "recording": str(out),
        "frames": 2,
        "seed": 0,
        "mechanics": "linear",
        "globe": "open",
        "stiffening": 0,
    }
    assert json.loads(capsys.readouterr().out) == expected
    eye = read_recording(out).info.eye
    assert (eye.name, eye.thickness_m, eye.iop_pa) == (
        "pig",
        700e-6,
        pytest.approx(400.0, abs=0.1),
    )
    assert true_forces(out) == {
        "0001.png": pytest.approx(30e-3),
        "0002.png": pytest.approx(2e-3),
    }
    moving = [
        "--forces-mn",
        "10,4",
        "--rate-hz",
        "20",
        "--ramp-mn-per-s",
        "20",
        "--hold-s",
        "0.3",
    ]
    assert run([*arguments, str(tmp_path / "moving"), *moving]) == 0
    # 2.5 + 0.5 + 0.3 + 0.3 + 0.3 s, the first at 0.1 s
    assert json.loads(capsys.readouterr().out)["frames"] == 77
    new = str(tmp_path / "x")

    for refused, said in (
        ([str(out)], "exists already"),
        ([new, "--forces-mn", "many"], "'many' is not a list of forces in mN"),
        ([new, "--hold-s", "2"], "give --rate-hz too"),
        ([new, "--puncture-mn", "20"], "give --rate-hz too"),
    ):
        assert run([*arguments, *refused]) == 2
        assert said in capsys.readouterr().err


def test_a_truth_that_is_broken_is_one_clear_line_and_a_real_recording_has_none(
    tmp_path,
):
    assert true_forces(tmp_path) == {}
    for content in ("{", "[]", '{"frames": [{"file": "0001.png"}]}'):
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


def plan(study=MOVING_STUDY, seed=3, **changes):
    motion = {"rate_hz": 50.0, "ramp_n_per_s": 0.02, "hold_s": 0.5} | changes
    return plan_moving_phantom(EYE, TURNING_POINTS_N, study, seed, Motion(**motion))


def flat_sections(forces_n):
    lateral_m = np.linspace(-9e-3, 9e-3, 50)
    for force_n in forces_n:
        outer = np.stack([lateral_m, np.full(50, 20e-3 * force_n)], axis=1)
        yield WallSection(outer, outer + np.array([0.0, 600e-6]))


def test_the_force_follows_ramps_and_holds_through_its_turning_points() -> None:
    moving = plan()
    forces_n = np.array(moving.forces_n)
    times_s = np.array([frame.time_s for frame in moving.frames])
    # Off for 2.5 s; 1 s up to 20 mN; 0.5 s there; 0.75 s down to 5 mN; 0.5 s there; 1.5
    # s up to 35 mN; 0.5 s there.
    expected_mn = {
        2.4: 0.0,
        3.0: 10.0,
        3.6: 20.0,
        3.96: 20.0,
        4.4: 12.0,
        5.0: 5.0,
        6.0: 20.0,
        7.2: 35.0,
    }

    for time_s, force_mn in expected_mn.items():
        assert forces_n[np.argmin(np.abs(times_s - time_s))] == pytest.approx(
            force_mn / 1e3, abs=1e-9
        )

    assert np.abs(np.diff(forces_n)).max() == pytest.approx(0.02 / 50)
    assert moving.path.times_s[-1] == pytest.approx(7.25)
    assert (times_s[0], times_s[-1]) == (0.1, pytest.approx(7.25, abs=0.02))
    assert np.diff(times_s) == pytest.approx(0.02)
    path = NeedlePath((0.0, 1.0, 2.0), (0.0, 0.01, 0.03))  # constant beyond its end
    assert path.felt_n(np.array([0.0, 1.5, 9.0])).tolist() == pytest.approx(
        [0.0, 0.02, 0.03]
    )


def test_the_eye_and_the_light_change_smoothly_within_their_ranges() -> None:
    frames = plan(rate_hz=100.0, hold_s=20.0).frames
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


@pytest.mark.slow
def test_a_recording_of_it_is_labelled_with_the_force_at_each_frame(tmp_path) -> None:
    moving = plan(ramp_n_per_s=0.02)
    write_phantom(tmp_path / "rec", moving, flat_sections, MOVING_STUDY)
    recording = read_recording(tmp_path / "rec")
    assert recording.info.force is not None
    assert recording.info.force.average_s == 0.1
    trials = label_frames(recording, MOVING_STUDY.classes)
    errors_n = np.array([trial.measured_force_n for trial in trials]) - moving.forces_n
    # noise of 4 mN and steps of 5 mN below 5 Hz
    assert np.sqrt((errors_n**2).mean()) < 1.5e-3
    assert list(true_forces(tmp_path / "rec").values()) == moving.forces_n
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())
    assert truth["path"]["forces_n"] == [
        0.0,
        0.0,
        0.02,
        0.02,
        0.005,
        0.005,
        0.035,
        0.035,
    ]
    assert "push" not in truth["frames"][0]
    frame = moving.frames[200]
    section = list(flat_sections(moving.forces_n))[200]
    assert (
        recording.frame(recording.frames[200])
        == render_frame(frame, section, MOVING_STUDY).frame
    ).all()


@pytest.fixture(scope="module")
def through() -> tuple[PhantomPlan, LinearSections]:
    sections_at = LinearSections(EYE, MOVING_STUDY)
    return with_travel(plan(rate_hz=200.0, puncture_n=0.04), sections_at), sections_at


def test_through_the_wall_the_force_falls_within_milliseconds_and_friction_turns_with_the_needle(
    through,
) -> None:
    pierced, _ = through
    puncture = pierced.path.puncture
    times_s = np.array([frame.time_s for frame in pierced.frames])
    forces_n = np.array(pierced.forces_n)
    travels_m = np.array([frame.travel.travel_m for frame in pierced.frames])
    assert puncture.force_n == 0.04
    after_s = np.array([0.0, puncture.fall_s / 2, puncture.fall_s]) + puncture.time_s
    left_n = puncture.friction_fraction * 0.04
    assert pierced.path.felt_n(after_s) == pytest.approx(
        [0.04, (0.04 + left_n) / 2, left_n]
    )
    assert puncture.fall_s <= 4e-3
    on = (times_s > puncture.time_s + puncture.fall_s) & (
        times_s < puncture.driven_s[-2]
    )
    assert forces_n[on] == pytest.approx(left_n)
    assert (np.diff(travels_m[on]) > 0.0).all(), "the needle continues"
    before = (times_s > puncture.time_s - 0.1) & (times_s < puncture.time_s)
    assert np.diff(travels_m[on]).mean() == pytest.approx(
        np.diff(travels_m[before]).mean()
    )
    back = (times_s > puncture.driven_s[-2]) & (times_s < puncture.out_s)
    assert (np.diff(travels_m[back]) < 0.0).all()
    assert forces_n[back].min() == pytest.approx(-left_n)
    assert forces_n[times_s > puncture.out_s + puncture.fall_s].tolist() == []
    assert pierced.path.felt_n(
        np.array([puncture.out_s + puncture.fall_s, 99.0])
    ) == pytest.approx([0.0, 0.0])
    inside_m = [frame.travel.inside_m for frame in pierced.frames]
    assert inside_m[np.flatnonzero(times_s < puncture.out_s)[-1]] == pytest.approx(
        0.0, abs=5e-5
    )


def test_the_dent_springs_back_is_pulled_outwards_and_a_track_stays_as_deep_as_the_needle_was(
    through,
) -> None:
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
) -> None:
    pierced, sections_at = through
    few = replace(pierced, frames=pierced.frames[::40])
    write_phantom(tmp_path / "rec", few, sections_at, MOVING_STUDY)
    recording = read_recording(tmp_path / "rec")
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())
    assert [entry.pierced for entry in recording.frames] == [None] * len(few.frames)
    travels_m = [frame.travel.travel_m for frame in few.frames]
    assert [entry.travel_m for entry in recording.frames] == pytest.approx(
        travels_m, abs=1e-6
    )
    assert truth["puncture"]["time_s"] == pierced.path.puncture.time_s
    inside = [entry.time_s > pierced.path.puncture.time_s for entry in recording.frames]
    assert [frame["pierced"] for frame in truth["frames"]] == inside


PUSHES_FORCES_N = (0.002, 0.02, 0.0, 0.055)
RELAXATION = PronySeries((0.12, 0.15), (1.2, 12.0))


def acquisition(seed=0, relaxation=RELAXATION, **changes):
    phantom = st.PhantomStudy(**changes)
    rng = np.random.default_rng(seed)
    pushes = plan_pushes(PUSHES_FORCES_N, phantom, rng)
    path = path_of_pushes(pushes, relaxation)
    sensor = sample_sensor(phantom, rng)

    return (
        pushes,
        path,
        sensor,
        sense(path, sensor, 2, -1, pushes[-1].corners_s[-1] + 1.0, rng),
    )


def test_the_force_is_the_given_one_at_frames_and_falls_as_tissue_relaxes_while_the_dent_stays():
    pushes, path, _, _ = acquisition()
    assert path.felt_n(np.array([push.frame_s for push in pushes])) == pytest.approx(
        PUSHES_FORCES_N, abs=1e-12
    )
    first = pushes[0]
    push = pushes[3]
    hold_s = push.start_s + push.ramp_s + np.linspace(0.0, push.hold_s, 200)
    assert (np.diff(path.felt_n(hold_s)) < 0.0).all()
    assert np.ptp(path.elastic_n(hold_s)) < 1e-12
    # after rest: the ramp's convolution with G
    since_s = np.linspace(0.0, first.ramp_s + first.hold_s, 4000)
    driven_n = path.elastic_n(first.start_s + since_s + 1e-9)
    steps_n = np.diff(driven_n)
    middle_s = (since_s[1:] + since_s[:-1]) / 2
    expected_n = driven_n[0] + float(steps_n @ RELAXATION.left(since_s[-1] - middle_s))
    assert path.felt_n(np.array([first.start_s + since_s[-1]])) == pytest.approx(
        expected_n, abs=1e-8
    )
    between_s = np.array(
        [(a.corners_s[-1] + b.start_s) / 2 for a, b in pairwise(pushes)]
    )
    assert (path.felt_n(np.r_[0.0, between_s]) == 0.0).all()
    assert (path.elastic_n(np.r_[0.0, between_s]) == 0.0).all()


def test_a_frame_shows_the_dent_of_the_elastic_force_and_truth_tells_both(
    tmp_path,
) -> None:
    terms = (
        (st.fixed(0.12), st.fixed(1.2)),
        (st.Range(min=0.1, max=0.2), st.fixed(12.0)),
    )
    study = replace(STUDY, tissue=st.TissueStudy(relaxation=terms))
    planned = plan_phantom(EYE, (30e-3, 2e-3), study, 1)
    elastic = plan_phantom(EYE, (30e-3, 2e-3), STUDY, 1)
    asked: list[list[float]] = []

    def sections(forces_n):
        asked.append(list(forces_n))
        return list(flat_sections(forces_n))

    write_phantom(tmp_path / "rec", planned, sections, study)
    truth = json.loads((tmp_path / "rec" / "truth.json").read_text())
    frames = truth["frames"]
    assert [frame["force_n"] for frame in frames] == pytest.approx([30e-3, 2e-3])
    assert (
        [frame["elastic_force_n"] for frame in frames] == asked[-1] == planned.elastic_n
    )
    assert elastic.elastic_n == elastic.forces_n
    shares = [share for share, _ in truth["tissue"]["relaxation"]]
    assert shares == list(planned.path.relaxation.shares)
    assert shares[0] == 0.12
    assert 0.1 <= shares[1] <= 0.2
    assert all(
        frame["force_n"] < (1.0 - 0.12 * 0.8) * frame["elastic_force_n"]
        for frame in frames
    )


def test_the_log_is_the_force_with_sign_offset_drift_noise_and_cross_talk_at_its_rate_in_steps():
    _, _, _, log = acquisition()
    assert np.diff(log[:, 0]) == pytest.approx(1 / 200.0)
    steps = log[:, 1:4] / 5e-3
    assert np.abs(steps - np.rint(steps)).max() < 1e-9
    assert np.diff(acquisition(sample_rate_hz=500.0)[3][:, 0]) == pytest.approx(
        1 / 500.0
    )
    _, path, sensor, log = acquisition(force_step_n=0.0)
    force_n = path.felt_n(log[:, 0])
    rest = log[:, 3] + force_n - sensor.offset_n[2] - sensor.drift_n_per_s * log[:, 0]
    assert rest.std() == pytest.approx(sensor.noise_n, rel=0.03)
    assert abs(rest.mean()) < 4 * sensor.noise_n / np.sqrt(len(rest))
    assert np.corrcoef(rest[1:], rest[:-1])[0, 1] == pytest.approx(0.0, abs=0.05)
    assert log[:, 4:].std() == pytest.approx(sensor.torque_noise_nm, rel=0.05)

    for column, share in (
        (1, sensor.cross_talk_fraction[0]),
        (2, sensor.cross_talk_fraction[1]),
    ):
        slope, offset = np.polyfit(force_n, log[:, column], 1)
        assert slope == pytest.approx(share, abs=0.01)
        assert offset == pytest.approx(sensor.offset_n[column - 1], abs=3e-4)


def test_a_plan_of_too_many_frames_is_refused_before_they_are_drawn() -> None:
    """1.8 billion frames, each within the limits of rate, ramp and hold."""
    motion = {"rate_hz": 1000.0, "ramp_n_per_s": 1e-5, "hold_s": 3600.0}
    with less_than(64 * 2**20), pytest.raises(RecordingError, match="may have 100000"):
        plan_moving_phantom(EYE, (0.02, 0.03) * 250, STUDY, 0, Motion(**motion))
