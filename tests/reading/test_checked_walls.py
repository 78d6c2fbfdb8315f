"""The wall that is read: checked by the wall finder, and below a conjunctiva, from
every entry.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic_frames import (
    CLEAN,
    KNOWN,
    LIBRARY,
    MODULUS_PA,
    SCALE,
    STUDY,
    THICKNESS_M,
    frame_under,
    tip_of,
    wall_section,
)
from commands import said
from small_models import (
    FINDER_STUDY,
    FIVE_MN,
    FixedNetwork,
    fixed_finder,
    write_blind_finder,
)

import scleraforce as sf
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import sample_conjunctiva, sample_optics
from scleraforce.reading.load_model import load_classifier
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.fields import fixed

HALF = FINDER_STUDY.columns // 2
SAID = "the network sees no wall"


@pytest.fixture(scope="module")
def blind(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models") / "blind"
    write_blind_finder(path)
    return path


def test_the_loop_reads_what_the_second_opinion_refuses():
    elsewhere = fixed_finder(np.full(HALF, 100.0), np.full(HALF, 110.0), sd=0.3)
    parts = (Path("model"), STUDY, FixedNetwork(FIVE_MN), LIBRARY, "fit")
    reader = ForceReader(*parts, finder=elsewhere)
    answer = reader.read(frame_under(0.02), SCALE, KNOWN)
    assert (answer.usable, answer.predicted, answer.can_calibrate) == (False, 2, False)
    assert answer.reason.startswith("two methods to find the wall differ")
    assert reader.read_live(frame_under(0.02), SCALE, KNOWN).usable


def test_a_classifier_checks_its_walls_too(tmp_path, blind, write_model):
    path = write_model(tmp_path / "tiny", STUDY).path
    checked = load_classifier(path, finder=blind)
    alone = load_classifier(path, finder=None)
    assert alone.read(frame_under(0.02), SCALE).usable
    assert str(checked.read(frame_under(0.02), SCALE).reason).startswith(SAID)
    assert checked.read_live(frame_under(0.02), SCALE).usable


def frames_of(capsys: pytest.CaptureFixture[str], *words: object) -> list[dict]:
    return json.loads(said(capsys, *words, "--json"))["frames"]


def test_the_commands_check_with_the_given_wall_finder(places, blind, capsys):
    frame = places["mine"] / "frames" / "1.png"
    read = {}
    for finder in (None, "none", blind):
        words = [] if finder is None else ["--wall-finder", finder]
        (read[finder],) = frames_of(capsys, "read", places["model"], frame, *words)
        found = frames_of(capsys, "evaluate", places["model"], places["mine"], *words)
        usable = [read[finder]["usable"]] * 4 + [False]
        assert [one["usable"] for one in found] == usable

    # the network may move the wall's end by a few rows
    force_mn = [read[finder]["predicted_force_mn"] for finder in (None, "none")]
    assert force_mn[0] == pytest.approx(force_mn[1], rel=0.05)
    assert read[blind]["reason"].startswith(SAID)
    wrong = ("--wall-finder", places["model"])
    message = said(capsys, "read", places["model"], frame, *wrong, code=2)
    assert "kind: found 'reader', a wall-finder is needed here" in message


@pytest.mark.slow
def test_calibrate_takes_no_frame_that_the_wall_finder_doubts(
    places, blind, capsys, tmp_path
):
    out = tmp_path / "found.json"
    options = ("--mechanics", "linear", "--frames", 1, "--out", out)
    command = ("calibrate", places["mine"], *options)
    message = said(capsys, *command, "--wall-finder", blind, code=2)
    assert f"not usable: {SAID}" in message
    assert not out.exists()

    means_mpa = []
    for words in (("--wall-finder", "none"), ()):
        said(capsys, *command, *words)
        means_mpa.append(json.loads(out.read_text())["population"]["mean_mpa"])
        out.unlink()
    assert means_mpa[1] == pytest.approx(means_mpa[0], rel=0.02)


LAYER_M = 140e-6


@pytest.fixture(scope="module")
def layered(places, tmp_path_factory) -> Path:
    """The frame of the analytic wall at 15 mN, under a layer, in its recording."""
    folder = tmp_path_factory.mktemp("layered")
    rng = np.random.default_rng(1)
    phantom = replace(CLEAN, conjunctiva_thickness_m=fixed(LAYER_M))
    over = sample_conjunctiva(phantom, rng)
    optics = replace(sample_optics(CLEAN, STUDY.oct, rng), conjunctiva=over)
    drawn = render_bscan(wall_section(tip_of(0.015)), STUDY.oct, optics, rng)
    (folder / "frames").mkdir()
    info = (places["mine"] / "recording.toml").read_text()
    (folder / "recording.toml").write_text(info)
    (folder / "frames.csv").write_text("file,time_s\n1.png,5.0\n")
    frame = folder / "frames" / "1.png"
    assert cv2.imwrite(str(frame), drawn.frame)
    return frame


def test_commands_look_below_a_layer(layered, places, capsys, tmp_path):
    recording = layered.parents[1]
    modulus = ("--youngs-modulus-mpa", MODULUS_PA / 1e6)
    (found,) = frames_of(capsys, "segment", recording, "--out", tmp_path)
    (read,) = frames_of(capsys, "read", places["model"], layered, *modulus)
    (evaluated,) = frames_of(capsys, "evaluate", places["model"], recording)
    for entry in (found, read, evaluated):
        assert entry["usable"], entry["reason"]
        assert entry["conjunctiva_um"] == pytest.approx(1e6 * LAYER_M, rel=0.15)
    assert found["thickness_um"] == pytest.approx(1e6 * THICKNESS_M, rel=0.06)
    assert read["predicted_force_mn"] == pytest.approx(15.0, abs=1.5)


@pytest.mark.parametrize("finder", ["bundled", None, "blind"])
def test_python_looks_below_a_layer_unless_the_network_sees_no_wall(
    layered, places, blind, finder
):
    chosen = {"wall_finder": blind if finder else None}
    chosen = {} if finder == "bundled" else chosen
    wall = sf.segment(layered, **chosen)
    model = sf.load_model(places["model"], **chosen)
    answer = sf.read(model, layered, youngs_modulus_pa=MODULUS_PA)
    assert wall.usable == answer.usable == (finder != "blind")
    assert wall.conjunctiva_m == pytest.approx(LAYER_M, rel=0.15)
    np.testing.assert_array_equal(wall.outer_row, answer.segmentation.outer_row)
    np.testing.assert_array_equal(wall.inner_row, answer.segmentation.inner_row)
