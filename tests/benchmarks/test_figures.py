import json
import math
import multiprocessing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest
from workers import leave_a_mark_or_fail, leave_a_mark_or_wait

from figures import __main__ as figures_main, commands, readings, recordings
from figures.commands import answers, made_by
from figures.declared import as_declared, declare
from figures.folder import FiguresFolder
from figures.groups import GROUPS, draw_eyes
from figures.page import BEGIN, END, insert_tables
from figures.picture import draw_forces
from figures.readings import Method
from figures.recordings import MadeEye, lowest_m
from figures.scores import AnsweredFrame, answered_frame, score
from figures.sections import compute_eye
from figures.table import COLUMNS, GroupResult, ModulusErrors, as_json, as_markdown
from figures.workers import in_processes
from provenance import __main__ as provenance_main, behaviour as provenance_behaviour
from provenance.stamps import new_stamp, read_stamps
from scleraforce.errors import ScleraforceError
from scleraforce.laboratory.phantom import plan_phantom
from scleraforce.learning.fingerprint import item
from scleraforce.mechanics.contact import Section
from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo, read_info
from scleraforce.study import Study, read_study
from scleraforce.study.toml import format_record
from scleraforce.units import to_si

STUDY = Study()


def frame(target, predicted, usable=True, *, by_log=None, true_mn=20.0, read_mn=None, interval_mn=None, in_window=True):
    return AnsweredFrame(
        "eye",
        "0001.png",
        target if by_log is None else by_log,
        true_mn + 0.5,
        target,
        true_mn,
        in_window,
        predicted,
        usable,
        read_mn,
        interval_mn,
    )


def test_scores_of_a_few_frames_are_as_counted_by_hand():
    found = score(
        [
            frame(0, 0, true_mn=2.0, read_mn=3.0, interval_mn=(1.0, 3.5)),
            frame(1, 2, by_log=2, true_mn=29.0, read_mn=31.0, interval_mn=(30.0, 32.0)),
            frame(2, 0, true_mn=40.0, read_mn=4.0, interval_mn=(3.0, 5.0)),
            frame(2, 2, true_mn=50.0, read_mn=50.0, interval_mn=(49.0, 51.0)),
            frame(2, 2, usable=False, true_mn=55.0, in_window=False),
            frame(0, 2, usable=False, true_mn=1.0),
        ]
    )
    assert (found.accuracy.hits, found.accuracy.total) == (3, 6)
    assert (found.usable_accuracy.hits, found.usable_accuracy.total) == (2, 4)
    assert (found.log_accuracy.hits, found.log_accuracy.total) == (4, 6)
    assert (found.log_usable_accuracy.hits, found.log_usable_accuracy.total) == (3, 4)
    assert (found.recall.hits, found.recall.total) == (2, 3)
    assert found.as_harmless == 1
    assert (found.unusable.hits, found.unusable.total) == (1, 5)
    assert found.mae_mn == pytest.approx((1.0 + 2.0 + 36.0 + 0.0) / 4)
    assert found.log_mae_mn == pytest.approx((0.5 + 1.5 + 36.5 + 0.5) / 4)
    assert found.bias_mn == pytest.approx((1.0 + 2.0 - 36.0 + 0.0) / 4)
    assert (found.coverage.hits, found.coverage.total) == (2, 4)
    assert (found.log_coverage.hits, found.log_coverage.total) == (2, 4)
    classes_only = score([frame(1, 1)])
    assert math.isnan(classes_only.mae_mn)
    assert classes_only.coverage.total == 0


def test_a_frame_of_an_evaluation_counts_if_it_has_a_label_and_is_not_excluded():
    entry = {"eye": "e", "file": "0001.png", "target": 1, "measured_force_mn": 29.5, "predicted": 2, "usable": True,
             "excluded": None, "predicted_force_mn": 30.5, "interval_mn": [29.0, 32.0], "reason": None}  # fmt: skip
    found = answered_frame(entry, 30.2e-3, True, STUDY.classes)
    assert found is not None
    assert (found.target, found.true_target, found.read_mn, found.interval_mn) == (1, 2, 30.5, (29.0, 32.0))
    assert answered_frame({**entry, "target": None}, 30.2e-3, True, STUDY.classes) is None
    assert answered_frame({**entry, "excluded": "over 60 mN"}, 30.2e-3, True, STUDY.classes) is None


def test_a_high_force_that_is_read_as_safe_with_confidence_is_counted():
    frames = [
        frame(2, 1, true_mn=36.0, read_mn=25.0, interval_mn=(20.0, 29.9)),
        frame(2, 1, true_mn=36.0, read_mn=25.0, interval_mn=(20.0, 30.1)),  # its interval says that it may be class 2
        frame(2, 2, true_mn=36.0, usable=False),
        frame(2, 0, true_mn=34.0, read_mn=4.0, interval_mn=(3.0, 5.0)),
    ]
    found = score(frames)
    assert (found.as_safe.hits, found.as_safe.total) == (1, 3)
    assert found.width_mn == pytest.approx(9.9)
    assert found.refused_eyes == 0
    assert score([frame(2, 2, usable=False)]).refused_eyes == 1
    assert score([frame(2, 2, usable=False)]).coverage_band is None


def test_the_stretch_makes_nine_in_ten_frames_hold_with_equal_weight_of_the_eyes():
    """Half widths: 2 mN upwards, 1 mN downwards."""
    below = [frame(1, 1, true_mn=20.0 - 0.1 * n, read_mn=20.0, interval_mn=(19.0, 22.0)) for n in range(1, 11)]
    assert score(below).stretch == pytest.approx(0.9)
    above = [replace(one, true_mn=20.0 + 0.1 * n) for n, one in enumerate(below, start=1)]
    assert score(above).stretch == pytest.approx(0.45)
    alone = replace(below[0], eye="other", true_mn=23.0)
    assert score([*below, alone]).stretch == pytest.approx(1.5)
    assert math.isnan(score([frame(1, 1)]).stretch)


RANGES = {
    "youngs_modulus_pa": (0.2e6, 0.5e6),
    "thickness_m": (0.45e-3, 0.85e-3),
    "iop_pa": (to_si(1.0, "mmhg"), to_si(4.0, "mmhg")),
    "polar_rad": (math.radians(25), math.radians(45)),
    "gap_m": (0.4e-3, 0.9e-3),
}
OWN_RANGES = {
    "needle": {"gap_m": (0.0, 0.4 * 0.7e-3)},  # of the largest needle
    "limbus": {"polar_rad": (math.asin(5.5 / 12) + 2 / 12, math.asin(0.5) + 5 / 12)},  # 37 to 54 deg
    "living": {"youngs_modulus_pa": (1e6, 2e6), "iop_pa": (to_si(10.0, "mmhg"), to_si(25.0, "mmhg"))},
}


def test_eyes_of_each_group_fill_its_ranges():
    for group in GROUPS:
        eyes = draw_eyes(group, 50, STUDY)
        for name, (low, high) in (RANGES | OWN_RANGES.get(group, {})).items():
            values = np.array([getattr(drawn.eye, name) for drawn in eyes])
            assert low <= values.min() < low + 0.15 * (high - low), group
            assert high - 0.15 * (high - low) < values.max() <= high, group
        assert all(len(drawn.shares) == 20 and min(drawn.shares) >= 0 and max(drawn.shares) < 1 for drawn in eyes)
        assert len({drawn.eye.id for drawn in eyes}) == 50
        tensions = [drawn.eye.iop_pa * 12e-3 / (drawn.eye.youngs_modulus_pa * drawn.eye.thickness_m) for drawn in eyes]
        assert max(tensions) < 0.1, group  # far from the burst


def test_the_eyes_of_another_scanner_have_one_of_four_and_the_same_walls():
    drawn = draw_eyes("scanner", 30, STUDY)
    found = {
        (
            eye.study.oct.columns,
            round(eye.study.phantom.snr_db.bounds[0], 2),
            round(1e6 * eye.study.phantom.axial_resolution_m.bounds[0], 3),
            eye.study.phantom.display,
        )
        for eye in drawn
    }
    logarithmic = {(800, 15.0, 4.0), (512, 15.0, 12.0), (512, 8.98, 4.0)}
    assert found == {(*scanner, "logarithmic") for scanner in logarithmic} | {(512, 15.0, 4.0, "linear")}


def test_every_eye_of_the_conjunctiva_group_has_a_layer():
    layers = [drawn.study.phantom.conjunctiva_thickness_m.bounds for drawn in draw_eyes("conjunctiva", 50, STUDY)]
    assert all(low == high for low, high in layers)  # one for all frames of an eye
    assert 0.08e-3 <= min(layers)[0] < 0.09e-3 < 0.19e-3 < max(layers)[0] <= 0.2e-3


def test_moving_eyes_are_plain_or_harder_ones_that_turn_and_can_be_held_still():
    drawn = draw_eyes("moving", 50, STUDY)
    assert 15 <= sum(eye.study.form == STUDY.form for eye in drawn) <= 35
    for eye in drawn:
        phantom = eye.study.phantom
        assert phantom.eye_drift_rad.bounds == pytest.approx((math.radians(1), math.radians(3)))
        assert phantom.eye_saccade_rad.bounds == pytest.approx((math.radians(0.2), math.radians(1)))
        still = eye.held_still()
        assert still.study.phantom == STUDY.phantom
        assert replace(still, study=eye.study) == eye


@pytest.mark.slow
def test_a_moving_eye_is_computed_at_its_turned_contacts_and_its_frames_are_imaged_there(tmp_path):
    drawn = draw_eyes("moving", 1, STUDY)[0]
    mesh = replace(drawn.study.mesh, core=2, rings=4)
    drawn = replace(drawn, study=replace(drawn.study, mesh=mesh), shares=(0.1, 0.2))
    folder = FiguresFolder(tmp_path)
    for eye, paths in ((drawn, 3), (drawn.held_still(), 1)):
        computed = compute_eye(eye)
        assert len(computed.bent) == paths
        assert computed.largest_n <= min(bent.path.max_force_n for bent in computed.bent)
        recordings.make_eye(folder, eye)
        truth = json.loads((folder.recording(eye) / "truth.json").read_text())
        assert ("turn" in truth["frames"][0]) == (paths == 3)


def test_plain_and_harder_eyes_are_the_same_in_every_run():
    """Figures of commits stay comparable until eyes are drawn anew on purpose."""
    drawn = {group: draw_eyes(group, 1, STUDY)[0] for group in ("plain", "harder")}
    moduli = [eye.eye.youngs_modulus_pa for eye in drawn.values()]
    assert moduli == pytest.approx([486877.3112293596, 486136.88590328314], rel=1e-12)
    assert [round(eye.shares[0], 9) for eye in drawn.values()] == [0.868201516, 0.878665688]
    assert [eye.seed for eye in drawn.values()] == [1593491782, 920424444]
    assert draw_eyes("harder", 5, STUDY)[:3] == draw_eyes("harder", 3, STUDY)


def test_plain_eyes_have_the_studys_form_and_harder_ones_have_not():
    plain = [drawn.study for drawn in draw_eyes("plain", 3, STUDY)]
    assert all(
        (study.form, study.needle, study.phantom) == (STUDY.form, STUDY.needle, STUDY.phantom) for study in plain
    )
    harder = [drawn.study for drawn in draw_eyes("harder", 50, STUDY)]
    axes = np.array([study.form.semi_axes for study in harder])
    assert 0.94 <= axes.min() < 0.95 < 1.05 < axes.max() <= 1.06
    assert {abs(study.form.wave[0].amplitude_fraction) for study in harder} == {0.12}
    assert {study.form.wave[0].degree for study in harder} == {1, 2, 3}
    ratios = [study.form.region[0].modulus_ratio for study in harder]
    assert 0.6 <= min(ratios) < 0.7 < 1.3 < max(ratios) <= 1.4
    assert math.radians(9) < max(study.needle.tilt_rad for study in harder) <= math.radians(10)


@pytest.mark.parametrize(
    ("group", "kinds", "declared"),
    [("plain", {"open"}, True), ("harder", {"open"}, True), ("sealed", {"sealed"}, True),
     ("untold", {"open", "sealed"}, False), ("limbus", {"open"}, True), ("living", {"sealed"}, True)],
)  # fmt: skip
def test_globes_are_open_or_sealed_and_declared_as_the_group_states(group, kinds, declared):
    eyes = draw_eyes(group, 50, STUDY)
    assert {drawn.study.globe.kind for drawn in eyes} == kinds
    assert {drawn.tell_globe for drawn in eyes} == {declared}
    low, high = to_si(0.01, "mmhg13_per_ul"), to_si(0.05, "mmhg13_per_ul")
    rigidities = [drawn.study.globe.rigidity_pa13_per_m3 for drawn in eyes if drawn.study.globe.kind == "sealed"]
    assert all(low <= rigidity <= high for rigidity in rigidities)
    assert 15 <= len(rigidities) <= 35 if group == "untold" else len(rigidities) in (0, 50)


def test_the_limbus_lies_2_to_5_mm_before_the_contact():
    for drawn in draw_eyes("limbus", 50, STUDY):
        cornea, (region,) = drawn.study.form.cornea, drawn.study.form.region
        assert cornea.radius_m == 7.8e-3
        assert 5.5e-3 <= cornea.limbus_radius_m <= 6e-3
        limbus_rad = math.asin(cornea.limbus_radius_m / 12e-3)
        assert 2e-3 <= 12e-3 * (drawn.eye.polar_rad - limbus_rad) <= 5e-3
        assert region.half_angle_rad == limbus_rad
        assert 0.6 <= region.modulus_ratio <= 1.4


def test_calibration_frames_are_left_out_of_every_method(tmp_path, monkeypatch):
    eyes = draw_eyes("sealed", 2, STUDY)
    files = tuple(f"{number:04}.png" for number in range(1, 6))
    made = MadeEye(files, 0.05, np.full(5, 0.02), np.zeros(5), np.zeros((5, 2)), 1.0)
    used = {drawn.eye.id: SimpleNamespace(frames=[SimpleNamespace(file=file) for file in files[1:4]]) for drawn in eyes}
    known = {"target": 1, "measured_force_mn": 20.0, "predicted": 1, "usable": True, "excluded": None}

    def evaluated(_out, command):
        return {"frames": [{"eye": command[2].name, "file": file, **known} for file in files]}

    monkeypatch.setattr(readings, "read_made", lambda *_: made)
    monkeypatch.setattr(readings, "calibrated_eyes", lambda *_: used)
    monkeypatch.setattr(readings, "_calibration", lambda *_: tmp_path / "calibration.json")
    monkeypatch.setattr(readings, "answers", evaluated)
    for method in (Method("fit", "", tmp_path), Method("paper", "", tmp_path, calibrated=False)):
        answered = readings.read_frames(FiguresFolder(tmp_path), eyes, method)
        assert [(entry.eye, entry.file) for entry in answered] == [
            (drawn.eye.id, file) for drawn in eyes for file in ("0001.png", "0005.png")
        ]


def results():
    """Yield small results of every group: one method, which refuses living eyes."""
    method = Method("fit", "the reader's fit (default), the eye's E", Path("reader"))
    read = [frame(1, 1, true_mn=12.0, read_mn=12.5, interval_mn=(11.0, 14.0)) for _ in range(9)]
    refused = [frame(2, 2, usable=False, true_mn=40.0)]
    moduli = [ModulusErrors(3, (0.01, -0.02), 1)]
    for group in GROUPS:
        answered = refused if group == "living" else [*read, *refused]
        yield GroupResult(group, 2, len(answered), 0, 0, 0, {method: score(answered)}, moduli)


def test_a_method_has_a_table_with_a_row_for_each_group_and_its_goals():
    text = as_markdown(list(results()))
    assert "**The reader's fit (default), the eye's E**" in text
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    read = {row[0]: dict(zip(COLUMNS, row[1:], strict=True)) for row in rows if len(row) == 1 + len(COLUMNS)}
    assert set(GROUPS) < set(read)
    for name, group in GROUPS.items():
        assert read[name]["right class, %"].endswith(f"(goal {group.accuracy_percent})") == bool(group.accuracy_percent)
        assert read[name]["force error, mN"].endswith(f"(goal {group.error_mn:g})" if group.error_mn else "0.50")
    assert read["plain"]["above 35 mN read below 30"] == "0 of 1"
    assert (read["plain"]["other eyes, %"], read["plain"]["median width, mN"]) == ("100 to 100", "3.00")
    assert read["living"]["not usable, %"] == "100.0, 1 whole eyes"
    assert read["living"]["other eyes, %"] == "-"


def test_the_tables_as_json_have_no_nan():
    found = json.loads(json.dumps(as_json(list(results())), allow_nan=False))
    assert found["living"]["methods"]["fit"]["coverage_band"] is None
    assert found["plain"]["methods"]["fit"]["as_safe"] == {"share": 0.0, "hits": 0, "of": 1}
    assert found["plain"]["youngs_modulus_errors"][0]["diverged"] == 1


def test_the_picture_has_a_panel_for_each_group():
    answers = {group: [frame(1, 1, read_mn=21.0, interval_mn=(20.0, 22.0))] for group in GROUPS}
    shown = [axes for axes in draw_forces(answers, (5.0, 30.0)).axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in shown] == list(GROUPS)


def test_the_lowest_point_of_a_boundary_is_sought_between_the_black_bands():
    drawn = draw_eyes("plain", 1, STUDY)[0]
    shown = plan_phantom(drawn.eye, drawn.forces_n(0.06), STUDY, drawn.seed).frames[0]
    lateral = np.linspace(-10e-3, 10e-3, 2001)
    outer = np.stack([lateral, np.where(np.abs(lateral) > 8e-3, 9e-3, 2e-3 - np.abs(lateral) / 10)], axis=1)
    outer_m, inner_m = lowest_m(shown, Section(outer, outer + np.array([0.0, 0.7e-3])), STUDY)
    assert outer_m == pytest.approx(2e-3 + shown.pose.depth_m, abs=1e-6)
    assert inner_m == pytest.approx(2.7e-3 + shown.pose.depth_m, abs=1e-6)
    made = MadeEye(("a", "b"), 0.06, np.zeros(2), np.zeros(2), np.array([[3.9e-3, 4.5e-3], [4.1e-3, 4.9e-3]]), 1.0)
    assert made.in_window(4e-3).tolist() == [True, False]


def test_one_piece_of_work_may_fail_and_the_others_are_done(tmp_path):
    done = {}
    pieces = [tmp_path / name for name in ("a", "fails", "b")]
    in_processes(leave_a_mark_or_fail, pieces, 2, lambda piece, code: done.update({piece.name: code}))
    assert done == {"a": 0, "fails": 3, "b": 0}
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def test_processes_end_with_whoever_waits_for_them(tmp_path):
    def stop(_piece, _code):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        in_processes(leave_a_mark_or_wait, [tmp_path / "first", tmp_path / "waits"], 2, stop)
    assert not multiprocessing.active_children()


def test_a_result_is_made_anew_with_other_words_another_input_or_another_behaviour(tmp_path, monkeypatch):
    runs = []
    monkeypatch.setattr(commands, "_run", lambda words: runs.append(words) or '{"frames": []}')
    given, out = tmp_path / "given", tmp_path / "answers" / "kept.json"
    given.mkdir()
    (given / "model.json").write_text("one")

    def runs_after(*words):
        answers(out, ["evaluate", given, *words])
        return len(runs)

    assert [runs_after(), runs_after()] == [1, 1]
    assert [runs_after("--more"), runs_after("--more")] == [2, 2]
    (given / "model.json").write_text("two")
    assert [runs_after("--more"), runs_after("--more")] == [3, 3]
    commands.write_key(given, "made otherwise")
    assert [runs_after("--more"), runs_after("--more")] == [4, 4]
    for value, runs_then in ((1.0, 5), (1.0 + 1e-9, 5), (1.1, 6)):
        commands.take_up(tmp_path, {"forces": item([value])})
        assert [runs_after("--more"), runs_after("--more")] == [runs_then] * 2


def test_an_eye_is_computed_anew_when_the_code_behaves_otherwise(tmp_path, monkeypatch):
    folder, eyes, made = FiguresFolder(tmp_path), draw_eyes("plain", 3, STUDY), []

    def keep(_work, pieces, _workers, _progress):
        for place, eye in pieces:
            made.append(eye.eye.id)
            place.recording(eye).mkdir(parents=True, exist_ok=True)
            commands.write_key(place.recording(eye), recordings.recording_key(eye))

    monkeypatch.setattr(recordings, "in_processes", keep)
    recordings.make_recordings(folder, eyes[:2], 1, lambda _: None)
    recordings.make_recordings(folder, eyes, 1, lambda _: None)
    assert made == ["plain-01", "plain-02", "plain-03"]
    commands.take_up(tmp_path, {})
    recordings.make_recordings(folder, eyes, 1, lambda _: None)
    assert made == ["plain-01", "plain-02", "plain-03"] * 2


@pytest.mark.slow
def test_a_command_is_run_once_and_what_it_left_unfinished_is_removed(tmp_path, capsys):
    out = tmp_path / "made" / "recording"
    (out.parent / ".recording.partial").mkdir(parents=True)
    small = ["--forces-mn", "2", "--thickness-um", "500"]
    with pytest.raises(ScleraforceError, match="phantom: exit code 2"):
        made_by(out, ["phantom", "--forces-mn", "-2"])
    assert not out.exists()
    assert not (out.parent / ".recording.partial").exists()
    out.mkdir()
    (out / "old").write_text("")
    made_by(out, ["phantom", *small])  # without a key it is made again
    assert not (out / "old").exists()
    assert "made again" in capsys.readouterr().err
    (out / "mark").write_text("")
    assert made_by(out, ["phantom", *small]) == out  # it is there: nothing is run
    assert (out / "mark").exists()


def test_new_tables_replace_the_old_ones(tmp_path):
    page, stamp = tmp_path / "page.md", new_stamp("make figures")
    page.write_text(f"above\n\n{BEGIN}\n{END}\n\nbelow\n")
    insert_tables("| old |\n", stamp, page)
    insert_tables("| new |\n", stamp, page)
    assert page.read_text() == f"above\n\n{BEGIN}\n\n{stamp}\n\n| new |\n\n{END}\n\nbelow\n"
    assert list(read_stamps(page)) == [stamp]
    page.write_text("no marks")
    with pytest.raises(ScleraforceError, match="expected one line"):
        insert_tables("| new |\n", stamp, page)


def test_figures_are_out_of_date_where_an_entry_that_decides_them_has_moved(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(provenance_behaviour, "KEPT", tmp_path / "behaviour.json")
    then, now = ({"paper slices": item([1.0]), "default samples": item([value])} for value in (1.0, 2.0))
    for command, moved in (("make figures", ["default samples"]), ("scleraforce train DATASET --search", [])):
        stamp = new_stamp(command)
        assert provenance_behaviour.moved_since(stamp, now) is None
        provenance_behaviour.keep(stamp, then)
        assert provenance_behaviour.moved_since(stamp, then) == []
        assert provenance_behaviour.moved_since(stamp, now) == moved
        assert provenance_behaviour.moved_since(replace(stamp, commit="another"), now) is None
    monkeypatch.setattr(provenance_main, "behaviour", lambda: now)
    monkeypatch.setattr("sys.argv", ["provenance"])
    assert provenance_main.main() == 0
    assert "benchmarks/RESULTS.md: make bench, " in capsys.readouterr().out


def test_only_living_eyes_are_calibrated_with_the_study_of_their_own_reader(tmp_path, monkeypatch):
    asked = {}
    for group in GROUPS:
        monkeypatch.setattr(readings, "made_by", lambda _, command, group=group: asked.update({group: command}))
        readings._calibration(FiguresFolder(tmp_path), draw_eyes(group, 2, STUDY), 3)
    assert [group for group, command in asked.items() if "--study" in command] == ["living"]
    study = read_study(asked["living"][asked["living"].index("--study") + 1])
    assert study.calibration.prior_mean_pa > 2 * STUDY.calibration.prior_mean_pa


def test_a_raw_reader_is_compared_with_the_default_reader_only(tmp_path, monkeypatch):
    monkeypatch.setattr(figures_main, "make_methods", lambda *_: [Method("fit", "", tmp_path)])
    given = {"default": tmp_path, "living": tmp_path}
    for group, names in (("harder", ["fit", "raw"]), ("living", ["fit"])):
        folder = FiguresFolder(tmp_path)
        methods = figures_main._methods(folder, group, {}, STUDY, given, tmp_path / "raw")
        assert [method.name for method in methods] == names
        assert [each.name for each in figures_main._methods(folder, group, {}, STUDY, given, None)] == ["fit"]
    assert methods[0].own_modulus


def test_some_groups_have_other_numbers_of_eyes() -> None:
    kind = figures_main._Counts()
    counts = kind.convert("30,needle=6,moving=4", None, None)
    assert {name: counts[name] for name in ("plain", "needle", "moving")} == {"plain": 30, "needle": 6, "moving": 4}
    assert set(counts) == set(GROUPS)
    for wrong, words in (("30,nedle=6", "'nedle' is not a group"), ("30,needle=x", "'x'"), ("1", "'1'"), ("", "''")):
        with pytest.raises(click.BadParameter, match=words):
            kind.convert(wrong, None, None)


def test_declared_values_have_the_errors_of_users_and_frames_stay_the_same(tmp_path) -> None:
    info = RecordingInfo(
        eye=EyeInfo("eye", thickness_m=600e-6, iop_pa=300.0, globe="open"),
        oct=OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3, plane_direction_rad=0.3),
        needle=NeedleInfo(gauge=22, slice_gap_m=0.5e-3, polar_angle_rad=0.6),
        force=ForceInfo("fz", -1),
    )
    drawn = draw_eyes("plain", 1, STUDY)[0]
    folder = FiguresFolder(tmp_path)
    recording = folder.recording(drawn)
    (recording / "frames").mkdir(parents=True)
    (recording / "frames" / "0001.png").write_bytes(b"a frame")
    (recording / "truth.json").write_text("{}")
    (recording / "recording.toml").write_text(format_record(info))
    folder.made(drawn).parent.mkdir()
    folder.made(drawn).write_bytes(b"its values")
    declared = declare(folder, [drawn]).recording(drawn)
    assert declare(folder, [drawn]).made(drawn).read_bytes() == b"its values"
    assert sorted(path.name for path in declared.rglob("*")) == ["0001.png", "frames", "recording.toml"]
    assert (declared / "frames" / "0001.png").read_bytes() == b"a frame"
    assert read_info(recording / "recording.toml") == info
    assert read_info(declared / "recording.toml") != info

    rng, reader = np.random.default_rng(3), STUDY.reader
    said = [as_declared(info, reader, rng) for _ in range(400)]
    assert {(each.eye.globe, each.needle.gauge, each.oct.plane_tilt_rad) for each in said} == {("open", 22, 0.0)}
    for value, true, sd in (
        (lambda each: each.eye.iop_pa, 300.0, 300.0 * reader.iop_noise_fraction),
        (lambda each: each.eye.thickness_m, 600e-6, 600e-6 * reader.thickness_noise_fraction),
        (lambda each: each.needle.slice_gap_m, 0.5e-3, 0.5e-3 * reader.gap_noise_fraction),
        (lambda each: each.needle.polar_angle_rad, 0.6, reader.pole_noise_rad),
        (lambda each: each.oct.plane_direction_rad, 0.3, reader.pole_noise_rad),
    ):
        off = np.array([value(each) for each in said]) - true
        assert abs(off.mean()) < 4.0 * sd / math.sqrt(len(said))
        assert off.std() == pytest.approx(sd, rel=0.15)
