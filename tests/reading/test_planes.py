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
from scleraforce.recordings.formats.image_files import read_frame

pytest.importorskip("onnx")

FORCES_N = 0.012, 0.02
SCAN = sf.Scan(width_m=15e-3, depth_m=4e-3, planes=CROSS)


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Reader:
    path = tmp_path_factory.mktemp("model") / "reader"
    write_fixed_reader(path, SMALL_LIBRARY, [1.0] * 32)
    return load_reader(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Two moments of a cross."""
    folder = tmp_path_factory.mktemp("planes") / "rec"
    return write_moments(folder, FORCES_N, log=True)


@pytest.fixture
def frames(recording) -> list[Path]:
    """The frames of the second moment."""
    return [recording / "frames" / f"1-{number}.png" for number in range(2)]


def read(model: Reader, frames: object, **known: object):
    return sf.read(model, frames, youngs_modulus_pa=MODULUS_PA, **known)


def test_a_moment_has_one_force_and_one_contact_in_three_dimensions(model, frames):
    answer = read(model, frames)
    assert answer.usable
    assert answer.force_n == pytest.approx(FORCES_N[1], rel=0.05)
    plane = replace(CROSS[0], offset_m=CONTACT_M[1])
    through_m = cut_wall(plane, tip_of(FORCES_N[1]), CONTACT_M, TILT_RAD).outer
    bottom_m = through_m[np.abs(through_m[:, 0]) < 1e-3, 1].max()
    contact_m = (*CONTACT_M[:2], bottom_m)
    assert answer.place.contact_m == pytest.approx(contact_m, abs=40e-6)
    given = read(model, frames, scan=sf.Scan(planes=CROSS))
    assert given.force_n == answer.force_n
    alone = read(model, frames[0])
    assert alone.place is None
    assert np.ptp(alone.interval_n) > np.ptp(answer.interval_n)


def named(frames: list[Path], *planes: str) -> list[sf.Frame]:
    return [sf.Frame(path, plane=p) for path, p in zip(frames, planes, strict=True)]


def test_frames_that_name_their_planes_come_in_any_order(model, frames):
    expected = read(model, frames, scan=sf.Scan(planes=CROSS))
    turned = sf.Scan(planes=CROSS[::-1])
    told = named(frames, "along", "across")
    answer = read(model, sf.Moment(tuple(told)), scan=turned)
    assert answer.to_dict() == expected.to_dict()
    swapped = read(model, told[::-1], scan=turned)
    assert swapped.force_n == pytest.approx(expected.force_n, rel=0.01)
    assert swapped.place.contact_m == pytest.approx(expected.place.contact_m, abs=10e-6)


@pytest.mark.parametrize(
    ("planes", "words"),
    [
        (("along", None), "frame: 1 of 2 name a plane; name that of each"),
        (("along", "up"), "frame: plane 'up' is not one of across, along"),
        (("along", "along"), "planes: two frames of one"),
    ],
)
def test_names_that_are_not_those_of_the_planes_are_refused(
    model, frames, planes, words
):
    with pytest.raises(InputError, match=words):
        read(model, named(frames, *planes), scan=sf.Scan(planes=CROSS[::-1]))


MASK = np.zeros((512, 512), bool)


@pytest.mark.parametrize(
    ("files", "known", "words"),
    [
        (["0-0.png", "1-0.png"], {}, "frame: of several times"),
        (["0-0.png", "0-0.png"], {}, "planes: two frames of one"),
        (["0-0.png", "0-0.png"], {"scan": SCAN}, "frame: one picture for two planes"),
        (["0-0.png", "0-1.png", "1-0.png"], {"scan": SCAN}, "planes: 2 of 3 frames"),
        (["0-0.png", "0-1.png"], {"gap_m": 5e-4}, "gap_m: several planes show their"),
        (["0-0.png", "0-1.png"], {"mask": MASK}, "mask: 1 for 2 frames"),
        ([], {}, "frame: none"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(model, recording, files, known, words):
    with pytest.raises(InputError, match=words):
        read(model, [recording / "frames" / file for file in files], **known)


def test_a_classifier_reads_no_planes(frames, tiny_model):
    with pytest.raises(ModelError, match="a classifier reads single planes"):
        read(load_reader(tiny_model.path), frames)


@pytest.mark.parametrize(("bevel_deg", "is_known"), [(90.0, True), (20.0, False)])
def test_a_shaft_in_both_planes_tells_the_lean_unless_its_lines_may_be_a_bevels(
    model, bevel_deg, is_known
):
    sides = {"diameter_m": 0.7e-3, "far_edge_db": 0.0}
    angles_rad = np.radians([bevel_deg, 8.0, 6.0])
    names = ("bevel_rad", "angle_rad", "lean_rad")
    shaft = replace(STEEL, **sides, **dict(zip(names, angles_rad, strict=True)))
    frames = []
    for number, plane in enumerate(CROSS):
        section = cut_wall(plane, tip_of(0.008), (0.0, 0.0, 0.4e-3))
        bottom_m = section.outer[np.abs(section.outer[:, 0]) < 1e-3, 1].max()
        in_plane = shaft.in_plane(np.eye(2)[number], 0.0)
        drawn = draw_shaft(in_plane, np.array([0.0, bottom_m]), 0.0, STUDY.oct)
        rng = np.random.default_rng(number)
        optics = sample_optics(CLEAN, STUDY.oct, rng)
        frames.append(render_bscan(section, STUDY.oct, optics, rng, drawn).frame)

    answer = read(model, frames, scan=SCAN)
    assert answer.usable
    if is_known:
        lean_rad = pytest.approx(shaft.from_normal[0], abs=np.radians(2.0))
        assert answer.places.lean_rad.value == lean_rad
    else:
        assert answer.places.lean_rad is answer.place.lean_rad is None


def test_a_plane_without_a_wall_is_left_out_and_without_any_no_frame_is_usable(
    model, frames
):
    pixels = read_frame(frames[0])
    empty = np.full_like(pixels, 300)
    answer = read(model, [pixels, empty], scan=SCAN)
    assert answer.usable
    assert answer.place is None
    assert any("left out: plane across:" in words for words in answer.warnings)
    both = read(model, [empty, empty], scan=SCAN)
    assert (both.usable, both.predicted) == (False, 2)


def test_an_evaluation_repeats_the_answer_for_each_plane_and_counts_it_once(
    model, recording
):
    evaluation = evaluate_recordings(model, [recording])
    entries = evaluation.to_dict()["frames"]
    shown = [(one["plane"], one["time_s"]) for one in entries]
    assert shown == [(plane.name, time_s) for time_s in (8.0, 16.0) for plane in CROSS]
    assert [frame.scored for frame in evaluation.frames] == [True, False, True, False]

    shared = {"predicted_force_mn", "interval_mn", "contact_xyz_mm", "predicted"}
    for first, second in (entries[:2], entries[2:]):
        assert {key: first[key] for key in shared} == {
            key: second[key] for key in shared
        }
        contact_mm = [first["contact_mm"], second["contact_mm"]]
        assert first["contact_xyz_mm"][:2] == pytest.approx(contact_mm)


def test_the_command_reads_the_frames_of_a_moment_together(model, recording, capsys):
    frames = [str(path) for path in sorted((recording / "frames").iterdir())]
    stated = json.loads(said(capsys, "read", model.path, *frames, "--json"))["frames"]
    assert [one["plane"] for one in stated] == ["along", "across"] * 2
    along = ("--plane", "along:0:0", *frames[::2])
    across = ("--plane=across:0:90", *frames[1::2])
    command = ("read", model.path, *along, *across, "--json")
    given = json.loads(said(capsys, *command))["frames"]
    assert [one["file"] for one in given] == frames

    for first, second in zip(stated, given, strict=True):
        for key in ("predicted_force_mn", "contact_xyz_mm"):
            assert second[key] == pytest.approx(first[key], abs=1e-6)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ("f.png --plane a:0:0 g.png", "--plane: after f.png, whose plane is not given"),
        ("--plane a:0:0 f.png --plane b:0:90 g.png h.png", "'a' has 1, 'b' has 2"),
    ],
)
def test_wrong_planes_on_the_command_line_are_one_line(model, capsys, args, words):
    assert words in said(capsys, "read", model.path, *args.split(), code=2)
