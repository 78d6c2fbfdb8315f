import math
import time

import numpy as np
import pytest
from pieces_of_work import leave_a_mark_or_fail, leave_a_mark_or_wait

from figures import commands, recordings
from figures.commands import answers, made_by
from figures.eyes import GROUPS, draw_eyes
from figures.folder import FiguresFolder
from figures.page import BEGIN, END, insert_tables
from figures.recordings import MadeEye, lowest_m
from figures.scores import AnsweredFrame, answered_frame, score
from figures.workers import in_processes
from provenance import stamps
from provenance.stamps import new_stamp, read_stamps
from scleraforce.errors import ScleraforceError
from scleraforce.laboratory.phantom import plan_phantom
from scleraforce.section.plane import Section
from scleraforce.study import Study
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


def test_scores_of_a_handful_of_frames_are_those_counted_by_hand():
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


def test_a_classifier_reads_no_force():
    found = score([frame(1, 1)])
    assert math.isnan(found.mae_mn)
    assert found.coverage.total == 0


def test_a_frame_of_an_evaluation_counts_where_it_has_a_label_and_is_not_excluded():
    entry = {"eye": "e", "file": "0001.png", "target": 1, "measured_force_mn": 29.5, "predicted": 2, "usable": True,
             "excluded": None, "predicted_force_mn": 30.5, "interval_mn": [29.0, 32.0], "reason": None}  # fmt: skip
    found = answered_frame(entry, 30.2e-3, True, STUDY.classes)
    assert found is not None
    assert (found.target, found.true_target, found.read_mn, found.interval_mn) == (1, 2, 30.5, (29.0, 32.0))
    assert answered_frame({**entry, "target": None}, 30.2e-3, True, STUDY.classes) is None
    assert answered_frame({**entry, "excluded": "over 60 mN"}, 30.2e-3, True, STUDY.classes) is None


@pytest.mark.parametrize("group", GROUPS)
def test_eyes_lie_in_the_ranges_that_were_asked_for(group):
    eyes = draw_eyes(group, 50, STUDY)
    bounds = {
        "youngs_modulus_pa": (0.2e6, 0.5e6),
        "thickness_m": (0.45e-3, 0.85e-3),
        "iop_pa": (to_si(1.0, "mmhg"), to_si(4.0, "mmhg")),
        "polar_rad": (math.radians(25), math.radians(45)),
        "gap_m": (0.4e-3, 0.9e-3),
    }
    for name, (low, high) in bounds.items():
        values = np.array([getattr(drawn.eye, name) for drawn in eyes])
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high
    assert all(len(drawn.shares) == 20 and min(drawn.shares) >= 0 and max(drawn.shares) < 1 for drawn in eyes)
    assert len({drawn.eye.id for drawn in eyes}) == 50


def test_plain_eyes_are_those_of_the_study_and_harder_ones_are_not():
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


def test_more_eyes_leave_those_before_as_they_are():
    assert draw_eyes("harder", 5, STUDY)[:3] == draw_eyes("harder", 3, STUDY)


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

    start = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        in_processes(leave_a_mark_or_wait, [tmp_path / "first", tmp_path / "waits"], 2, stop)
    assert time.perf_counter() - start < 30


def test_a_result_is_made_anew_with_other_sources_other_words_or_another_input(tmp_path, monkeypatch):
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
    commands.write_key(given, "made by other sources")
    assert [runs_after("--more"), runs_after("--more")] == [4, 4]
    monkeypatch.setattr(commands, "source_key", lambda *_: "other sources")
    assert [runs_after("--more"), runs_after("--more")] == [5, 5]


def test_an_eye_is_computed_anew_when_the_sources_that_compute_it_have_changed(tmp_path, monkeypatch):
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
    monkeypatch.setattr(recordings, "source_key", lambda *_: "other sources")
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
    made_by(out, ["phantom", *small])  # nobody knows by what it was made: it is made anew
    assert not (out / "old").exists()
    assert "made anew" in capsys.readouterr().err
    (out / "mark").write_text("")
    assert made_by(out, ["phantom", *small]) == out  # it is there: nothing is run
    assert (out / "mark").exists()


@pytest.mark.slow
def test_what_a_command_prints_is_kept(tmp_path):
    out = tmp_path / "answers" / "kept.json"
    out.parent.mkdir()
    out.write_text('{"frames": []}')
    commands.write_key(out, commands._command_key(["evaluate", "no-model"]))
    assert answers(out, ["evaluate", "no-model"]) == {"frames": []}
    with pytest.raises(ScleraforceError, match="evaluate: exit code"):
        answers(tmp_path / "other.json", ["evaluate", tmp_path / "no-model", tmp_path])


def test_tables_take_the_place_of_those_before(tmp_path):
    page, stamp = tmp_path / "page.md", new_stamp("make figures", "figures.page", "scleraforce.units")
    page.write_text(f"above\n\n{BEGIN}\n{END}\n\nbelow\n")
    insert_tables("| old |\n", stamp, page)
    insert_tables("| new |\n", stamp, page)
    assert page.read_text() == f"above\n\n{BEGIN}\n\n{stamp}\n\n| new |\n\n{END}\n\nbelow\n"
    assert list(read_stamps(page)) == [stamp]
    page.write_text("no marks")
    with pytest.raises(ScleraforceError, match="expected one line"):
        insert_tables("| new |\n", stamp, page)


def test_figures_are_older_where_a_source_has_changed_or_has_gone(tmp_path, monkeypatch):
    folder = tmp_path / "invented"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "decides.py").write_text("import invented.further\n")
    (folder / "further.py").write_text("ANSWER = 41\n")
    (folder / "other.py").touch()
    monkeypatch.setitem(stamps.PACKAGES, "invented", folder)
    stamp = new_stamp("make wonders", "invented.decides", "scleraforce.units")
    (folder / "other.py").write_text("changed\n")
    assert stamp.current
    (folder / "further.py").write_text("ANSWER = 42\n")
    assert not stamp.current
    (folder / "decides.py").unlink()
    assert not stamp.current
