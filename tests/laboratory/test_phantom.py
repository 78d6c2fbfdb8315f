import json
from collections import Counter
from dataclasses import asdict, replace

import numpy as np
import pytest
from effects import contents

from scleraforce.cli.main import run
from scleraforce.errors import InputError, RecordingError
from scleraforce.laboratory.phantom import plan_phantom, render_frame, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections, paper_eyes
from scleraforce.mechanics.contact import Section
from scleraforce.recording.folder import read_recording, true_forces
from scleraforce.recording.labels import label_frames
from scleraforce.study import CorneaStudy, FormStudy, MeshStudy, OctStudy, Study, fixed, format_study

STUDY = Study(oct=OctStudy(columns=128, rows=96), mesh=MeshStudy(divisions=4))
EYE = PhantomEye(
    id="eye-x",
    thickness_m=600e-6,
    youngs_modulus_pa=0.25e6,
    iop_pa=266.0,
    gap_m=0.5e-3,
    polar_rad=0.6,
    direction_rad=0.2,
)
FORCES_N = (0.02, 0.002, 0.045)


def dented_sections(forces_n):
    angle = np.linspace(-1.2, 1.2, 300)
    outside = 12e-3 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    dent = np.exp(-((angle / 0.13) ** 2))
    for force_n in forces_n:
        outer = outside + np.stack([0 * angle, 40e-3 * force_n * dent], axis=1)
        yield Section(outer, outer + 600e-6 * np.stack([-np.sin(angle), np.cos(angle)], axis=1))


@pytest.fixture
def written(tmp_path):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    write_phantom(tmp_path / "rec", plan, dented_sections, STUDY)
    return tmp_path / "rec"


def test_recording_comes_back_as_it_was_planned(written):
    recording = read_recording(written)
    assert recording.info.eye.id == "eye-x"
    assert recording.info.eye.thickness_m == 600e-6
    assert recording.info.eye.globe == "open"
    assert recording.info.needle.slice_gap_m == 0.5e-3
    assert recording.info.needle.gauge == 22
    assert recording.info.oct.plane_direction_rad == 0.2
    assert [frame.file for frame in recording.frames] == ["0001.png", "0002.png", "0003.png"]
    trials = label_frames(recording, STUDY.classes)
    assert [trial.measured_force_n for trial in trials] == pytest.approx(FORCES_N, abs=1.5e-3)
    assert [trial.target for trial in trials] == [1, 0, 2]


def test_frames_are_those_of_the_plan(written):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    recording = read_recording(written)
    for entry, frame, section in zip(recording.frames, plan.frames, dented_sections(FORCES_N), strict=True):
        assert (recording.frame(entry) == render_frame(frame, section, STUDY).frame).all()


def test_truth_has_every_parameter(written):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    truth = json.loads((written / "truth.json").read_text())
    assert truth["simulated"] is True
    assert truth["eye"] == asdict(EYE)
    assert truth["globe"]["kind"] == "open"
    assert truth["tissue"] == {"stiffening": 0.0}
    assert [frame["pressure_pa"] for frame in truth["frames"]] == [EYE.iop_pa] * 3
    assert truth["seed"] == 3
    assert set(truth["versions"]) >= {"scleraforce", "numpy"}
    assert [frame["force_n"] for frame in truth["frames"]] == pytest.approx(FORCES_N)
    assert [frame["target"] for frame in truth["frames"]] == [1, 0, 2]
    for said, frame in zip(truth["frames"], plan.frames, strict=True):
        assert said["pose"] == asdict(frame.pose)
        assert said["optics"] == json.loads(json.dumps(asdict(frame.optics)))
        assert said["seed"] == list(frame.seed)


def test_a_recording_may_keep_its_globe_to_itself_and_the_truth_has_it(written, tmp_path):
    plan = plan_phantom(EYE, FORCES_N, STUDY, 3)
    write_phantom(tmp_path / "untold", plan, dented_sections, STUDY, tell_globe=False)
    told, untold = contents(written), contents(tmp_path / "untold")
    assert {name for name in told if told[name] != untold[name]} == {"recording.toml"}
    assert read_recording(tmp_path / "untold").info.eye.globe is None
    assert json.loads((tmp_path / "untold" / "truth.json").read_text())["globe"]["kind"] == "open"


def test_a_cornea_stands_in_the_truth_where_the_eye_has_one(written, tmp_path):
    assert "cornea" not in json.loads((written / "truth.json").read_text())["form"]
    study = replace(STUDY, form=FormStudy(cornea=CorneaStudy(radius_m=8e-3)))
    write_phantom(tmp_path / "cornea", plan_phantom(EYE, FORCES_N, study, 3), dented_sections, study)
    truth = json.loads((tmp_path / "cornea" / "truth.json").read_text())
    assert truth["form"]["cornea"] == asdict(CorneaStudy(radius_m=8e-3))


def test_same_seed_gives_the_same_bytes_and_another_seed_or_eye_others(written, tmp_path):
    for name, eye, seed, same in (("a", EYE, 3, True), ("b", EYE, 4, False), ("c", replace(EYE, id="y"), 3, False)):
        write_phantom(tmp_path / name, plan_phantom(eye, FORCES_N, STUDY, seed), dented_sections, STUDY)
        assert (contents(tmp_path / name) == contents(written)) is same
        assert ((tmp_path / name / "forces.csv").read_bytes() == (written / "forces.csv").read_bytes()) is same


def test_scanner_stays_the_same_within_a_recording_and_the_eye_moves():
    frames = plan_phantom(EYE, [0.01] * 30, STUDY, 0).frames
    of_recording = (
        "attenuation_per_m",
        "lines",
        "band_m",
        "axial_resolution_m",
        "choroid_level_db",
        "display_range_db",
    )
    assert all(len({getattr(frame.optics, name) for frame in frames}) == 1 for name in of_recording)
    assert len({frame.optics.snr_db for frame in frames}) == 30
    for shifts in ([frame.pose.lateral_m for frame in frames], [frame.pose.depth_m for frame in frames]):
        assert 0.25e-3 < np.ptp(shifts) <= 0.4e-3


def test_a_conjunctiva_is_one_in_a_recording_and_slides_from_push_to_push():
    study = replace(STUDY, phantom=replace(STUDY.phantom, conjunctiva_thickness_m=fixed(140e-6)))
    layers = [frame.optics.conjunctiva for frame in plan_phantom(EYE, FORCES_N, study, 3).frames]
    assert len({layer.phase_rad for layer in layers}) == len(FORCES_N)
    assert {replace(layer, phase_rad=0.0) for layer in layers} == {replace(layers[0], phase_rad=0.0)}
    others = [frame.optics for frame in plan_phantom(EYE, FORCES_N, STUDY, 3).frames]
    bare = [replace(frame.optics, conjunctiva=None) for frame in plan_phantom(EYE, FORCES_N, study, 3).frames]
    assert bare == others


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
    with pytest.raises(RecordingError, match="file"):
        write_phantom(tmp_path / "file" / "rec", plan, dented_sections, STUDY)


def test_a_force_that_no_study_may_hold_is_refused_with_the_largest():
    with pytest.raises(RecordingError, match=r"eye eye-x: forces: 1e\+09 mN; up to 1000 mN can be simulated"):
        plan_phantom(EYE, (0.01, 1e6), STUDY, 0)


@pytest.mark.parametrize("forces_n", [(), (-0.01,), (float("nan"),)])
def test_forces_that_are_none_are_an_error(forces_n):
    with pytest.raises(RecordingError, match=r"eye eye-x: forces: .*; give at least one, none negative"):
        plan_phantom(EYE, forces_n, STUDY, 0)


@pytest.mark.parametrize(
    ("field", "value"), [("thickness_m", 5e-2), ("iop_pa", -1.0), ("id", "a/b"), ("gap_m", float("nan"))]
)
def test_eye_that_cannot_be_is_an_error(field, value):
    with pytest.raises(InputError, match=f"{field}: "):
        replace(EYE, **{field: value})


def test_linear_sections_scale_with_the_force_and_start_from_the_loaded_wall():
    rest, one, two = linear_sections(EYE, STUDY)([0.0, 0.01, 0.02])
    middle = len(rest.outer) // 2
    depth_m = [section.outer[middle, 1] for section in (rest, one, two)]
    assert depth_m[1] - depth_m[0] > 0.1e-3
    assert depth_m[2] - depth_m[0] == pytest.approx(2 * (depth_m[1] - depth_m[0]), rel=0.05)
    thickness = np.linalg.norm(rest.outer[middle] - rest.inner[middle])
    assert thickness == pytest.approx(600e-6, rel=0.05)


def test_paper_eyes_have_the_design_of_tables_1_and_2():
    study = Study()
    eyes = paper_eyes(study)
    counts = [Counter(study.classes.classify(force_n) for force_n in forces_n) for _, forces_n in eyes]
    assert [[count[target] for target in range(3)] for count in counts] == [
        [0, 11, 14],
        [1, 2, 2],
        [2, 0, 3],
        [2, 1, 2],
        [2, 1, 2],
    ]
    assert [round(eye.thickness_m * 1e6) for eye, _ in eyes] == [800, 500, 650, 560, 800]
    assert [round(eye.youngs_modulus_pa / 1e6, 2) for eye, _ in eyes] == [0.27, 0.22, 0.24, 0.29, 0.25]
    forces_mn = np.array([force_n for _, forces_n in eyes for force_n in forces_n]) * 1e3
    assert len(forces_mn) == 45
    assert forces_mn.max() <= 58.0
    assert min(np.abs(forces_mn - 5.0).min(), np.abs(forces_mn - 30.0).min()) >= 2.0


def test_forces_up_to_the_bounds_are_of_the_same_eyes_and_classes():
    study = Study()
    eyes, clear = paper_eyes(study, to_the_bounds=True), paper_eyes(study)
    assert [eye for eye, _ in eyes] == [eye for eye, _ in clear]
    for (_, drawn_n), (_, spread_n) in zip(eyes, clear, strict=True):
        assert Counter(map(study.classes.classify, drawn_n)) == Counter(map(study.classes.classify, spread_n))
    forces_mn = np.array([force_n for _, forces_n in eyes for force_n in forces_n]) * 1e3
    assert min(np.abs(forces_mn - 5.0).min(), np.abs(forces_mn - 30.0).min()) < 1.0
    other = replace(study, phantom=replace(study.phantom, seed=study.phantom.seed + 1))
    assert eyes == paper_eyes(study, to_the_bounds=True) != paper_eyes(other, to_the_bounds=True)


def test_command_writes_a_recording_and_prints_json(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(format_study(STUDY))
    out = tmp_path / "eye"
    arguments = ["phantom", "--study", str(study), "--out", str(out), "--eye", "pig", "--forces-mn", "30,2", "--json"]
    assert run([*arguments, "--thickness-um", "700", "--iop-mmhg", "3"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "recording": str(out),
        "frames": 2,
        "seed": 0,
        "mechanics": "linear",
        "globe": "open",
        "stiffening": 0.0,
    }
    recording = read_recording(out)
    assert recording.info.eye.id == "pig"
    assert recording.info.eye.thickness_m == 700e-6
    assert recording.info.eye.iop_pa == pytest.approx(400.0, abs=0.1)
    assert run(arguments) == 2
    assert "exists already" in capsys.readouterr().err
    assert run(["phantom", "--out", str(tmp_path / "x"), "--forces-mn", "many"]) == 2
    assert "'many' is not a list of forces in mN" in capsys.readouterr().err
    true = true_forces(out)
    assert list(true) == ["0001.png", "0002.png"]
    assert list(true.values()) == pytest.approx([30e-3, 2e-3], rel=1e-9)


@pytest.mark.parametrize("content", [None, "{", "[]", '{"frames": [{"file": "0001.png"}]}'])
def test_a_truth_that_is_missing_or_broken_is_one_clear_line(tmp_path, content):
    if content is not None:
        (tmp_path / "truth.json").write_text(content)
    with pytest.raises(RecordingError, match=r"truth\.json: "):
        true_forces(tmp_path)
