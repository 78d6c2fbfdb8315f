import json
import math
from dataclasses import replace
from math import cos, sin
from types import SimpleNamespace

import numpy as np
import pytest
from effects import contents

from figures import readings, recordings, reuse
from figures.declared import as_declared, declare
from figures.eyes import Lean
from figures.folder import FiguresFolder
from figures.groups import GROUPS, draw_eyes
from figures.page import BEGIN, END, insert_tables
from figures.picture import draw_forces
from figures.readings import Method
from figures.recordings import MadeEye, lowest_m
from figures.scores import AnsweredFrame, score
from figures.sections import bend_leaning, compute_eye
from figures.table import COLUMNS, GroupResult, ModulusErrors, as_markdown
from provenance import __main__ as provenance_main, behaviour as provenance_behaviour
from provenance.fingerprint import item
from provenance.stamps import new_stamp, read_stamps
from scleraforce.base.errors import ScleraforceError
from scleraforce.base.units import to_si
from scleraforce.lab.virtual_recording import plan_phantom
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.recordings.recording_folder import read_info
from scleraforce.records.decoder import format_record
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN, Globe
from scleraforce.records.needle import Needle, gauge_diameter_m, one_lean
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import OctStudy, Study

STUDY = Study()


def frame(
    target,
    predicted,
    usable=True,
    *,
    true_mn=20.0,
    read_mn=None,
    interval_mn=None,
    in_window=True,
):
    return AnsweredFrame(
        "eye",
        "0001.png",
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
            frame(1, 2, true_mn=29.0, read_mn=31.0, interval_mn=(30.0, 32.0)),
            frame(2, 0, true_mn=40.0, read_mn=4.0, interval_mn=(3.0, 5.0)),
            frame(2, 2, true_mn=50.0, read_mn=50.0, interval_mn=(49.0, 51.0)),
            frame(2, 2, usable=False, true_mn=55.0, in_window=False),
            frame(0, 2, usable=False, true_mn=1.0),
        ]
    )
    assert (found.accuracy.hits, found.accuracy.total) == (3, 6)
    assert found.as_harmless == 1
    assert (found.unusable.hits, found.unusable.total) == (1, 5)
    assert found.mae_mn == pytest.approx((1.0 + 2.0 + 36.0 + 0.0) / 4)
    assert (found.coverage.hits, found.coverage.total) == (2, 4)
    assert math.isnan(score([frame(1, 1)]).mae_mn)
    above = [
        frame(2, 1, true_mn=36.0, read_mn=25.0, interval_mn=(20.0, 29.9)),
        frame(
            2, 1, true_mn=36.0, read_mn=25.0, interval_mn=(20.0, 30.1)
        ),  # its interval says that it may be class 2
        frame(2, 2, true_mn=36.0, usable=False),
    ]
    assert (score(above).as_safe.hits, score(above).as_safe.total) == (1, 3)
    assert (score(above).refused_eyes, score(above[2:]).refused_eyes) == (0, 1)


def test_the_stretch_makes_nine_in_ten_frames_hold_with_equal_weight_of_the_eyes():
    """Half widths: 2 mN upwards, 1 mN downwards."""
    below = [
        frame(1, 1, true_mn=20.0 - 0.1 * n, read_mn=20.0, interval_mn=(19.0, 22.0))
        for n in range(1, 11)
    ]
    assert score(below).stretch == pytest.approx(0.9)
    above = [
        replace(one, true_mn=20.0 + 0.1 * n) for n, one in enumerate(below, start=1)
    ]
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
    "limbus": {
        "polar_rad": (math.asin(5.5 / 12) + 2 / 12, math.asin(0.5) + 5 / 12)
    },  # 37 to 54 deg
    "living": {
        "youngs_modulus_pa": (1e6, 2e6),
        "iop_pa": (to_si(10.0, "mmhg"), to_si(25.0, "mmhg")),
    },
}


def drawn_value(setup: Setup, name: str) -> float:
    """Return what was drawn of an eye or of the needle on it."""
    if name == "youngs_modulus_pa":
        return setup.eye.modulus_pa
    return getattr(setup.needle if hasattr(setup.needle, name) else setup.eye, name)


def test_eyes_of_each_group_fill_its_ranges():
    for group in GROUPS:
        eyes = draw_eyes(group, 50, STUDY)
        for name, (low, high) in (RANGES | OWN_RANGES.get(group, {})).items():
            values = np.array([drawn_value(drawn.setup, name) for drawn in eyes])
            assert low <= values.min() < low + 0.15 * (high - low), group
            assert high - 0.15 * (high - low) < values.max() <= high, group

        assert all(
            len(drawn.shares) == 20 and min(drawn.shares) >= 0 and max(drawn.shares) < 1
            for drawn in eyes
        )
        assert len({drawn.setup.eye.name for drawn in eyes}) == 50
        tensions = [
            drawn.setup.eye.iop_pa
            * 12e-3
            / (drawn.setup.eye.modulus_pa * drawn.setup.eye.thickness_m)
            for drawn in eyes
        ]
        assert max(tensions) < 0.1, group  # far from the burst
        assert {drawn.tell_globe for drawn in eyes} == {group != "untold"}
        _, _, width_mm = group.partition("narrow-")
        assert {drawn.study.oct.width_m for drawn in eyes} <= {
            1e-3 * float(width_mm or 15),
            16e-3,
        }


@pytest.mark.slow
def test_a_moving_eye_is_computed_at_its_turned_contacts_and_its_frames_are_imaged_there(
    tmp_path,
):
    drawn = draw_eyes("moving", 1, STUDY)[0]
    mesh = replace(drawn.study.mesh, core=2, rings=6)
    drawn = replace(drawn, study=replace(drawn.study, mesh=mesh), shares=(0.1, 0.2))
    folder = FiguresFolder(tmp_path)

    for eye, paths in ((drawn, 3), (drawn.held_still(), 1)):
        computed = compute_eye(eye)
        assert len(computed.bent) == paths
        assert computed.largest_n <= min(bent.max_force_n for bent in computed.bent)
        recordings.make_eye(folder, eye)
        truth = json.loads((folder.recording(eye) / "truth.json").read_text())
        assert ("turn" in truth["frames"][0]) == (paths == 3)


@pytest.mark.slow
def test_eyes_that_workers_make_are_made_once_and_are_those_made_here(tmp_path):
    drawn = draw_eyes("plain", 1, Study(oct=OctStudy(columns=128, rows=96)))[0]
    coarse = replace(drawn.study, mesh=replace(drawn.study.mesh, core=2, rings=4))
    drawn = replace(drawn, study=coarse, shares=(0.1, 0.2))
    there = FiguresFolder(tmp_path / "a")
    here = FiguresFolder(tmp_path)
    done = []
    for found_done in ([0, 1], [1]):
        assert recordings.make_recordings(there, [drawn], 2, done.append) == ()
        assert done == found_done
        done.clear()

    recordings.make_eye(here, drawn)
    assert (
        recordings.read_made(there, drawn).files
        == recordings.read_made(here, drawn).files
    )
    assert contents(there.path / "recordings") == contents(here.path / "recordings")


def test_leaning_needles_are_calibrated_in_another_recording_at_another_lean():
    for group in ("leaning", "sliding"):
        for drawn in draw_eyes(group, 5, STUDY):
            other = drawn.calibrating
            assert (other.setup, other.lean, other.calibrating) == (
                drawn.setup,
                drawn.calibrated_at,
                other,
            )
            assert (other.name, drawn.name) == (
                f"{drawn.setup.eye.name}-calibration",
                drawn.setup.eye.name,
            )
            assert other.lean.angle_rad != drawn.lean.angle_rad
            assert other.lean.friction == drawn.lean.friction
            assert (drawn.lean.friction is None) == (group == "leaning")


def test_a_dent_follows_the_part_of_the_force_along_the_normal():
    """A needle that sticks pushes along itself; of one that slides, friction has a
    share in what it feels.
    """
    drawn = draw_eyes("plain", 1, STUDY)[0]
    study = replace(drawn.study, mesh=replace(drawn.study.mesh, core=2, rings=6))
    leans = {
        Lean(0.0, 0.0): 1.0,
        Lean(0.7, 1.0): cos(0.7),
        Lean(0.7, 1.0, 0.3): 1.0 / (cos(0.7) + 0.3 * sin(0.7)),
    }
    upright, *leaning = (
        bend_leaning(drawn.setup, study, lean, 0.015) for lean in leans
    )

    for path, part in zip(leaning, list(leans.values())[1:], strict=True):
        assert path.tip_m(0.01) == pytest.approx(upright.tip_m(0.01 * part), rel=0.05)


def test_plain_and_harder_eyes_are_the_same_in_every_run():
    """Figures of commits stay comparable until eyes are drawn anew on purpose."""
    drawn = {group: draw_eyes(group, 1, STUDY)[0] for group in ("plain", "harder")}
    moduli = [eye.setup.eye.modulus_pa for eye in drawn.values()]
    assert moduli == pytest.approx([486877.3112293596, 486136.88590328314], rel=1e-12)
    assert [round(eye.shares[0], 9) for eye in drawn.values()] == [
        0.868201516,
        0.878665688,
    ]
    assert [eye.seed for eye in drawn.values()] == [1593491782, 920424444]
    assert draw_eyes("harder", 5, STUDY)[:3] == draw_eyes("harder", 3, STUDY)


def test_calibration_frames_are_left_out_of_every_method(tmp_path, monkeypatch):
    eyes = draw_eyes("sealed", 2, STUDY)
    files = tuple(f"{number:04}.png" for number in range(1, 6))
    made = MadeEye(files, np.full(5, 0.02), np.zeros(5), np.zeros((5, 2)))
    used = {
        drawn.setup.eye.name: SimpleNamespace(
            frames=[SimpleNamespace(file=file) for file in files[1:4]]
        )
        for drawn in eyes
    }
    answer = SimpleNamespace(predicted=1, usable=True, force_n=None, interval_n=None)
    known = {"target": 1, "excluded": None, "answer": answer}

    def evaluated(_model, recordings, _calibration):
        return SimpleNamespace(
            frames=[
                SimpleNamespace(eye=recordings[0].name, file=file, **known)
                for file in files
            ]
        )

    monkeypatch.setattr(readings, "read_made", lambda *_: made)
    monkeypatch.setattr(readings, "calibrated_eyes", lambda *_: used)
    monkeypatch.setattr(readings, "calibration_of", lambda *_: None)
    monkeypatch.setattr(readings.sf, "evaluate", evaluated)

    for method in (
        Method("fit", "", SimpleNamespace()),
        Method("paper", "", SimpleNamespace(), calibrated=False),
    ):
        answered = readings.read_frames(FiguresFolder(tmp_path), eyes, method)
        assert [(entry.eye, entry.file) for entry in answered] == [
            (drawn.setup.eye.name, file)
            for drawn in eyes
            for file in ("0001.png", "0005.png")
        ]

    elsewhere = [replace(drawn, calibrated_at=Lean(0.1, 0.0)) for drawn in eyes]
    assert len(
        readings.read_frames(FiguresFolder(tmp_path), elsewhere, method)
    ) == 2 * len(files)


def test_tables_and_picture_have_every_group(tmp_path):
    method = Method("fit", "the reader's fit", tmp_path)
    read = frame(1, 1, true_mn=12.0, read_mn=12.5, interval_mn=(11.0, 14.0))
    refused = frame(2, 2, usable=False, true_mn=40.0)
    answers = {
        group: [refused] if group == "living" else [*[read] * 9, refused]
        for group in GROUPS
    }
    moduli = [ModulusErrors(3, (0.01, -0.02), 1)]
    results = [
        GroupResult(group, 2, len(frames), {method: score(frames)}, moduli)
        for group, frames in answers.items()
    ]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in as_markdown(results).splitlines()
    ]
    read_mn = {
        row[0]: dict(zip(COLUMNS, row[1:], strict=True))
        for row in rows
        if len(row) == 1 + len(COLUMNS)
    }

    for name, group in GROUPS.items():
        assert read_mn[name]["force error, mN"].endswith(
            f"(goal {group.error_mn:g})" if group.error_mn else "0.50"
        )

    assert read_mn["living"]["not usable, %"] == "100.0, 1 whole eyes"
    assert read_mn["plain"]["above 35 mN read below 30"] == "0 of 1"
    shown = [
        axes for axes in draw_forces(answers, (5.0, 30.0)).axes if axes.get_visible()
    ]
    assert [axes.get_title(loc="left") for axes in shown] == list(GROUPS)


def test_the_lowest_point_of_a_boundary_is_sought_between_the_black_bands():
    drawn = draw_eyes("plain", 1, STUDY)[0]
    shown = plan_phantom(drawn.setup, drawn.forces_n(0.06), STUDY, drawn.seed).frames[0]
    lateral = np.linspace(-10e-3, 10e-3, 2001)
    outer = np.stack(
        [lateral, np.where(np.abs(lateral) > 8e-3, 9e-3, 2e-3 - np.abs(lateral) / 10)],
        axis=1,
    )
    outer_m, inner_m = lowest_m(
        shown, WallSection(outer, outer + np.array([0.0, 0.7e-3])), STUDY
    )
    assert outer_m == pytest.approx(2e-3 + shown.pose.depth_m, abs=1e-6)
    assert inner_m == pytest.approx(2.7e-3 + shown.pose.depth_m, abs=1e-6)
    made = MadeEye(
        ("a", "b"),
        np.zeros(2),
        np.zeros(2),
        np.array([[3.9e-3, 4.5e-3], [4.1e-3, 4.9e-3]]),
    )
    assert made.in_window(4e-3).tolist() == [True, False]


def test_a_result_is_made_anew_with_another_key_or_behaviour(tmp_path, capsys):
    runs = []
    out = tmp_path / "eyes" / "kept"

    def make(part):
        runs.append(part)
        part.mkdir()

    def runs_after(key):
        assert reuse.made(out, key, make) == out
        return len(runs)

    (out.parent / ".kept.partial").mkdir(parents=True)  # of an interrupted run
    assert [runs_after("one"), runs_after("one")] == [1, 1]
    assert capsys.readouterr().err == ""
    assert [runs_after("two"), runs_after("two")] == [2, 2]
    assert "made again" in capsys.readouterr().err

    for value, runs_then in ((1.0, 3), (1.0 + 1e-9, 3), (1.1, 4)):
        reuse.take_up(tmp_path, {"forces": item([value])})
        assert [runs_after("two"), runs_after("two")] == [runs_then] * 2


def test_new_tables_replace_the_old_ones(tmp_path):
    page = tmp_path / "page.md"
    stamp = new_stamp("make figures")
    page.write_text(f"above\n\n{BEGIN}\n{END}\n\nbelow\n")
    insert_tables("| old |\n", stamp, page)
    insert_tables("| new |\n", stamp, page)
    assert (
        page.read_text()
        == f"above\n\n{BEGIN}\n\n{stamp}\n\n| new |\n\n{END}\n\nbelow\n"
    )
    assert list(read_stamps(page)) == [stamp]
    page.write_text("no marks")

    with pytest.raises(ScleraforceError, match="expected one line"):
        insert_tables("| new |\n", stamp, page)


def test_figures_are_out_of_date_where_an_entry_that_decides_them_has_moved(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(provenance_behaviour, "KEPT", tmp_path / "behaviour.json")
    then, now = (
        {"paper slices": item([1.0]), "default samples": item([value])}
        for value in (1.0, 2.0)
    )

    for command, moved in (
        ("make figures", ["default samples"]),
        ("scleraforce train DATASET --search", []),
    ):
        stamp = new_stamp(command)
        assert provenance_behaviour.moved_since(stamp, now) is None
        provenance_behaviour.keep(stamp, then)
        assert provenance_behaviour.moved_since(stamp, then) == []
        assert provenance_behaviour.moved_since(stamp, now) == moved
        assert (
            provenance_behaviour.moved_since(replace(stamp, commit="another"), now)
            is None
        )

    monkeypatch.setattr(provenance_main, "behaviour", lambda: now)
    monkeypatch.setattr("sys.argv", ["provenance"])
    assert provenance_main.main() == 0
    assert "benchmarks/RESULTS.md: make bench, " in capsys.readouterr().out


def test_declared_values_have_the_errors_of_users_and_frames_stay_the_same(
    tmp_path,
) -> None:
    info = RecordingInfo(
        eye=Eye("eye", thickness_m=600e-6, iop_pa=300.0, globe=Globe.declared("open")),
        scan=Scan(
            columns=512,
            rows=512,
            bits=12,
            width_m=15e-3,
            depth_m=4e-3,
            direction_rad=0.3,
            tilt_rad=0.0,
            refractive_index=1.0,
        ),
        needle=Needle(
            diameter_m=gauge_diameter_m(22),
            gap_m=0.5e-3,
            polar_rad=0.6,
            lean_rad=(0.4, 0.4),
        ),
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
    assert sorted(path.name for path in declared.rglob("*")) == [
        "0001.png",
        "frames",
        "recording.toml",
    ]
    assert (declared / "frames" / "0001.png").read_bytes() == b"a frame"
    assert read_info(recording / "recording.toml") == info
    assert read_info(declared / "recording.toml") != info

    rng = np.random.default_rng(3)
    reader = STUDY.reader
    said = [as_declared(info, reader, rng) for _ in range(400)]
    assert {
        (each.eye.globe, each.needle.gauge, each.scan.tilt_rad) for each in said
    } == {(OPEN, 22, 0.0)}

    for value, true, sd in (
        (lambda each: each.eye.iop_pa, 300.0, 300.0 * reader.iop_noise_fraction),
        (
            lambda each: each.eye.thickness_m,
            600e-6,
            600e-6 * reader.thickness_noise_fraction,
        ),
        (
            lambda each: each.needle.gap_m,
            0.5e-3,
            0.5e-3 * reader.gap_noise_fraction,
        ),
        (lambda each: each.needle.polar_rad, 0.6, reader.pole_noise_rad),
        (lambda each: one_lean(each.needle.lean_rad), 0.4, reader.pole_noise_rad),
        (lambda each: each.scan.direction_rad, 0.3, reader.pole_noise_rad),
    ):
        off = np.array([value(each) for each in said]) - true
        assert abs(off.mean()) < 4.0 * sd / math.sqrt(len(said))
        assert off.std() == pytest.approx(sd, rel=0.15)
