"""Frames of several planes: one answer for all of a moment, in `sf.read`, `read` and
`evaluate`.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import CLEAN, MODULUS_PA, SMALL_LIBRARY, STEEL, STUDY, tip_of
from commands import said
from scanned_planes import CONTACT_M, CROSS, TILT_RAD, cut_wall, write_moments
from small_models import write_fixed_reader

import scleraforce as sf
from scleraforce.base.errors import InputError, ModelError
from scleraforce.calibration.evaluation import evaluate_recordings
from scleraforce.lab.drawn_bscan import draw_shaft, render_bscan
from scleraforce.lab.tissue_light import sample_optics
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.recording_folder import read_recording

pytest.importorskip("onnx")

FORCES_N = 0.012, 0.02


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Reader:
    path = tmp_path_factory.mktemp("model") / "reader"
    write_fixed_reader(path, SMALL_LIBRARY, [1.0] * 32)
    return load_reader(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Two moments of a cross, without a force log."""
    return write_moments(tmp_path_factory.mktemp("planes") / "rec", FORCES_N)


def test_a_moment_has_one_force_and_one_contact_in_three_dimensions(
    model, recording
) -> None:
    frames = [recording / "frames" / f"1-{number}.png" for number in range(2)]
    answer = sf.read(model, frames, youngs_modulus_pa=MODULUS_PA)
    assert answer.usable
    assert answer.force_n == pytest.approx(FORCES_N[1], rel=0.05)
    through_m = cut_wall(
        replace(CROSS[0], offset_m=CONTACT_M[1]),
        tip_of(FORCES_N[1]),
        CONTACT_M,
        TILT_RAD,
    ).outer
    bottom_m = through_m[np.abs(through_m[:, 0]) < 1e-3, 1].max()
    assert answer.place.contact_m == pytest.approx(
        (*CONTACT_M[:2], bottom_m), abs=40e-6
    )
    given = sf.read(
        model, frames, youngs_modulus_pa=MODULUS_PA, scan=sf.Scan(planes=CROSS)
    )
    assert given.force_n == answer.force_n
    alone = sf.read(model, frames[0], youngs_modulus_pa=MODULUS_PA)
    assert alone.place is None
    assert np.ptp(alone.interval_n) > np.ptp(answer.interval_n)


def test_frames_that_name_their_planes_come_in_any_order(model, recording) -> None:
    frames = [recording / "frames" / f"1-{number}.png" for number in range(2)]
    named = [
        sf.Frame(path, plane=plane.name)
        for path, plane in zip(frames, CROSS, strict=True)
    ]
    given = {"youngs_modulus_pa": MODULUS_PA}
    expected = sf.read(model, frames, **given, scan=sf.Scan(planes=CROSS))
    turned = sf.Scan(planes=CROSS[::-1])
    answer = sf.read(model, sf.Moment(tuple(named)), **given, scan=turned)
    assert answer.to_dict() == expected.to_dict()
    swapped = sf.read(model, named[::-1], **given, scan=turned)
    assert swapped.force_n == pytest.approx(expected.force_n, rel=0.01)
    assert swapped.place.contact_m == pytest.approx(expected.place.contact_m, abs=10e-6)

    for wrong, words in (
        ([named[0], frames[1]], "frame: 1 of 2 name a plane; name that of each"),
        (
            [named[0], sf.Frame(frames[1], plane="up")],
            "frame: plane 'up' is not one of across, along",
        ),
        ([named[0], replace(named[1], plane="along")], "planes: two frames of one"),
    ):
        with pytest.raises(InputError, match=words):
            sf.read(model, wrong, **given, scan=turned)

    with pytest.raises(InputError, match="frame: plane 'up' is not one of a scan"):
        sf.read(model, sf.Frame(frames[0], plane="up"), **given)


@pytest.mark.parametrize(("bevel_deg", "is_known"), [(90.0, True), (20.0, False)])
def test_a_shaft_in_both_planes_tells_the_lean_unless_its_lines_may_be_a_bevels(
    model, bevel_deg, is_known
) -> None:
    both = replace(
        STEEL, diameter_m=0.7e-3, far_edge_db=0.0, bevel_rad=np.radians(bevel_deg)
    )
    shaft = replace(both, angle_rad=np.radians(8.0), lean_rad=np.radians(6.0))
    tip_m = tip_of(0.008)
    frames = []

    for number, plane in enumerate(CROSS):
        section = cut_wall(plane, tip_m, (0.0, 0.0, 0.4e-3))
        along = np.eye(2)[number]
        bottom_m = np.array(
            [0.0, section.outer[np.abs(section.outer[:, 0]) < 1e-3, 1].max()]
        )
        drawn = draw_shaft(shaft.in_plane(along, 0.0), bottom_m, 0.0, STUDY.oct)
        rng = np.random.default_rng(number)
        frames.append(
            render_bscan(
                section, STUDY.oct, sample_optics(CLEAN, STUDY.oct, rng), rng, drawn
            ).frame
        )

    answer = sf.read(
        model,
        frames,
        scan=sf.Scan(width_m=15e-3, depth_m=4e-3, planes=CROSS),
        youngs_modulus_pa=MODULUS_PA,
    )
    assert answer.usable

    if is_known:
        assert answer.places.lean_rad.value == pytest.approx(
            shaft.from_normal[0], abs=np.radians(2.0)
        )
    else:
        assert answer.places.lean_rad is answer.place.lean_rad is None


def test_an_evaluation_repeats_the_answer_for_each_plane_and_counts_it_once(
    model, recording
) -> None:
    evaluation = evaluate_recordings(model, [recording])
    entries = evaluation.to_dict()["frames"]
    assert [(one["plane"], one["time_s"]) for one in entries] == [
        (p.name, t) for t in (8.0, 16.0) for p in CROSS
    ]

    for first, second in (entries[:2], entries[2:]):
        for key in (
            "predicted_force_mn",
            "interval_mn",
            "contact_xyz_mm",
            "predicted",
            "usable",
        ):
            assert first[key] == second[key], key

        assert first["contact_xyz_mm"][:2] == pytest.approx(
            [first["contact_mm"], second["contact_mm"]]
        )

    assert [frame.repeats for frame in evaluation.frames] == [False, True, False, True]


def test_a_plane_without_a_wall_is_left_out_and_without_any_no_frame_is_usable(
    model, recording
) -> None:
    entries = read_recording(recording)
    pixels = [entries.frame(entry) for entry in entries.frames[2:]]
    size = {
        "width_m": 15e-3,
        "depth_m": 4e-3,
        "youngs_modulus_pa": MODULUS_PA,
        "scan": sf.Scan(planes=CROSS),
    }
    empty = np.full_like(pixels[0], 300)
    answer = sf.read(model, [pixels[0], empty], **size)
    assert answer.usable
    assert answer.place is None
    assert any("left out: plane across:" in words for words in answer.warnings)
    both = sf.read(model, [empty, empty], **size)
    assert (both.usable, both.predicted) == (False, 2)


def test_inputs_that_do_not_fit_are_refused(model, recording, tiny_model) -> None:
    frames = [recording / "frames" / name for name in ("0-0.png", "0-1.png", "1-0.png")]
    for given, words in (
        ({"frame": [frames[0], frames[2]]}, "frame: of several times"),
        (
            {"frame": frames, "scan": sf.Scan(planes=CROSS)},
            "planes: 2 of 3 frames; give one for each",
        ),
        (
            {"frame": [frames[0], frames[0]]},
            "planes: two frames of one",
        ),
        (
            {"frame": frames[:2], "gap_m": 0.5e-3},
            "gap_m: several planes show their gaps",
        ),
        ({"frame": []}, "frame: none"),
        (
            {"frame": [frames[0]] * 2, "scan": sf.Scan(planes=CROSS)},
            "frame: one picture for two planes",
        ),
        (
            {"frame": frames[:2], "mask": np.zeros((512, 512), bool)},
            "mask: 1 for 2 frames",
        ),
    ):
        with pytest.raises(InputError, match=words):
            sf.read(model, **given)

    for planes, words in (
        (CROSS[:1], "planes: only one"),
        (CROSS[:1] * 2, "planes: name: 'along' is there twice"),
        (
            (CROSS[0], replace(CROSS[0], name="b")),
            "planes: 'along' and 'b' are at one place",
        ),
    ):
        with pytest.raises(InputError, match=words):
            sf.Scan(planes=planes)

    with pytest.raises(ModelError, match="a classifier reads single planes"):
        sf.read(load_reader(tiny_model.path), frames[:2])


def test_the_command_reads_the_frames_of_a_moment_together(
    model, recording, capsys
) -> None:
    frames = [str(path) for path in sorted((recording / "frames").iterdir())]
    stated = json.loads(said(capsys, "read", model.path, *frames, "--json"))["frames"]
    assert [one["plane"] for one in stated] == ["along", "across"] * 2
    placed = [
        "--plane",
        "along:0:0",
        frames[0],
        frames[2],
        "--plane=across:0:90",
        frames[1],
        frames[3],
    ]
    given = json.loads(said(capsys, "read", model.path, *placed, "--json"))["frames"]
    assert [one["file"] for one in given] == frames

    for first, second in zip(stated, given, strict=True):
        assert second["predicted_force_mn"] == pytest.approx(
            first["predicted_force_mn"], abs=1e-6
        )
        assert second["contact_xyz_mm"] == pytest.approx(
            first["contact_xyz_mm"], abs=1e-6
        )


def test_wrong_planes_on_the_command_line_are_one_line(model, capsys) -> None:
    for args, words in (
        (
            ("f.png", "--plane", "a:0:0", "g.png"),
            "--plane: after f.png, whose plane is not given",
        ),
        (("--plane", "a:0", "f.png"), "'a:0' is not NAME:OFFSET_MM:DIRECTION_DEG"),
        (("--plane", "a:99:0", "f.png"), "offset_m: 0.099 is above the largest"),
        (("--plane", "a:0:0", "f.png"), "--plane: only one"),
        (
            ("--plane", "a:0:0", "f.png", "--plane", "a:0:9", "g.png"),
            "--plane: name: 'a' is there twice",
        ),
        (
            ("--plane", "a:0:0", "f.png", "--plane", "b:0:90", "g.png", "h.png"),
            "'a' has 1, 'b' has 2",
        ),
    ):
        assert words in said(capsys, "read", model.path, *args, code=2)
