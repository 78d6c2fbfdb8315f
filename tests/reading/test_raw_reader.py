"""A raw reader: its network's answer to the frame itself, and its refusals."""

import json
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, frame_under, recording_toml, write_one_frame
from small_models import RAW_STUDY, write_raw_model

from scleraforce.base.errors import ModelError
from scleraforce.base.onnx_network import network_session
from scleraforce.front.cli.main import run
from scleraforce.reading.force_network import ForceNetwork
from scleraforce.reading.load_model import load_force_reader, load_reader
from scleraforce.reading.reading_models import RawReader
from scleraforce.records.study import Study
from scleraforce.wall.wall_network import FrameWindow
from virtual_eyes import changed

pytest.importorskip("onnx")
FRAME = frame_under(0.02)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw"
    write_raw_model(path)
    return path


@pytest.fixture(scope="module")
def reader(folder) -> RawReader:
    model = load_reader(folder)
    assert isinstance(model, RawReader)
    return model


def network(folder: Path, study: Study) -> ForceNetwork:
    session = network_session((folder / "model.onnx").read_bytes(), "place", 1)
    return ForceNetwork(session, study, "place", raw=True)


def test_the_answer_is_the_networks_reading_of_the_reduced_frame(reader, folder):
    reduced = FrameWindow.of(RAW_STUDY.raw_reader).reduced(FRAME, SCALE)[None]
    expected = network(folder, RAW_STUDY).read(reduced, KNOWN)
    answer = reader.read(FRAME, SCALE, KNOWN)
    assert answer.usable
    assert (answer.force_n, answer.interval_n) == (
        expected.force_n,
        expected.interval_n,
    )
    assert answer.contact_m == expected.contact_m
    assert answer.readings == (("network", expected),)
    assert (answer.fit, answer.can_calibrate) == (None, True)
    assert reader.read_live(FRAME, SCALE, KNOWN) == replace(answer, can_calibrate=False)


@pytest.mark.parametrize(
    ("eye", "scale", "reason"),
    [
        ({"thickness_m": 1.2e-3}, SCALE, "wall thickness 1200 µm, the model was"),
        ({"gap_m": 1.5e-3}, SCALE, "gap between B-scan and needle axis 1.5 mm, the"),
        (
            {"thickness_m": None},
            replace(SCALE, refractive_index=1.38),
            "refractive index 1.38 of the frame, the model was trained with 1",
        ),
    ],
)
def test_eyes_and_frames_outside_the_training_are_refused(reader, eye, scale, reason):
    known = changed(KNOWN, **eye)
    answer = reader.read_live(FRAME, scale, known)
    assert not answer.usable
    if scale is SCALE:
        assert str(reader.refusal(known)).startswith(reason)
    else:
        assert answer.reason == reason


def test_gaps_below_a_slice_reader_s_are_read_and_a_frame_without_a_wall_is_not(reader):
    assert reader.refusal(changed(KNOWN, gap_m=0.1e-3)) is None
    noise = np.random.default_rng(1).integers(0, 400, (512, 512)).astype(np.uint16)
    answer = reader.read(noise, SCALE, KNOWN)
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)


def test_another_study_or_another_kind_than_the_network_s_is_refused(folder):
    other = replace(RAW_STUDY, raw_reader=replace(RAW_STUDY.raw_reader, columns=64))
    with pytest.raises(ModelError, match="place: inputs: found"):
        network(folder, other)
    with pytest.raises(ModelError, match="found 'raw-reader', a reader is needed here"):
        load_force_reader(folder)


def test_commands_read_with_it_and_the_monitor_refuses_it(folder, tmp_path, capsys):
    eye = tmp_path / "eye-a"
    box = tmp_path / "box"
    frame = write_one_frame(eye, recording_toml("eye-a"))

    for words in (
        ("classify", folder, frame, "--youngs-modulus-mpa", 0.3),
        ("evaluate", folder, eye),
    ):
        assert run([*map(str, words), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["kind"] == "raw-reader"
        (read,) = found["frames"]
        assert read["usable"]
        assert isfinite(read["predicted_force_mn"])
        assert len(read["interval_mn"]) == 2

    assert run(["show", str(folder)]) == 0
    assert "raw-reader" in capsys.readouterr().out
    assert run(["monitor", str(folder), "--port", "0", "--black-box", str(box)]) == 2
    words = f"{folder}: kind: raw-reader; the monitor needs a reader"
    assert words in capsys.readouterr().err
    assert not box.exists()
