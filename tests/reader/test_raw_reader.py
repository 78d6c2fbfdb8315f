"""A raw reader answers with its network to the frame itself, and refuses what is no wall or outside its training."""

import json
from dataclasses import replace
from math import isfinite
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")
from analytic_frames import KNOWN, SCALE, image, recording_toml, tip_of, wall_section
from small_models import RAW_STUDY, write_raw_model

from scleraforce.cli.main import run
from scleraforce.errors import ModelError
from scleraforce.known import NO_DISCREPANCY, Known, Modulus
from scleraforce.models import network_session
from scleraforce.reader import RawReader, load_force_reader, load_model
from scleraforce.reader.answer import Reading
from scleraforce.reader.intervals import IntervalFactors
from scleraforce.reader.networks import GIVEN, ForceNetwork
from scleraforce.reader.verdicts import WIDEST_N, judged_answer
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.reduced import FrameWindow
from scleraforce.study import SliceStudy, Study


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw"
    write_raw_model(path)
    return path


@pytest.fixture(scope="module")
def reader(folder: Path) -> RawReader:
    model = load_model(folder)
    assert isinstance(model, RawReader)
    return model


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.02)))


def network(folder: Path, factors: IntervalFactors | None = None) -> ForceNetwork:
    session = network_session((folder / "model.onnx").read_bytes(), "place", 1)
    return ForceNetwork(session, RAW_STUDY, "place", factors or IntervalFactors(), raw=True)


def test_the_answer_is_the_networks_reading_of_the_reduced_frame(reader, folder, frame) -> None:
    reduced = FrameWindow.of(RAW_STUDY.raw_reader).reduced(frame, SCALE)[None]
    expected = network(folder).read(reduced, KNOWN)
    answer = reader.read(frame, SCALE, KNOWN)
    assert answer.usable
    assert (answer.force_n, answer.interval_n, answer.contact_m) == (
        expected.force_n, expected.interval_n, expected.contact_m,
    )  # fmt: skip
    assert answer.readings == (("network", expected),)
    assert answer.fit is None
    assert answer.can_calibrate
    assert reader.read_live(frame, SCALE, KNOWN) == replace(answer, can_calibrate=False)


def test_what_is_told_of_the_eye_counts(folder, frame) -> None:
    reduced = FrameWindow.of(RAW_STUDY.raw_reader).reduced(frame, SCALE)[None]
    first = network(folder).read(reduced, KNOWN)
    twice = Modulus(mean_pa=2.0 * KNOWN.modulus.mean_pa, sd_pa=KNOWN.modulus.sd_pa, source="own")
    assert network(folder).read(reduced, replace(KNOWN, modulus=twice)).force_n != first.force_n
    higher = network(folder).read(reduced, replace(KNOWN, discrepancy=replace(NO_DISCREPANCY, level=0.1)))
    assert higher.force_n != first.force_n
    wider = network(folder, IntervalFactors(network={"own E": {"open": 1.5}})).read(reduced, KNOWN)
    assert wider.force_n == first.force_n
    assert wider.interval_n[1] - first.force_n == pytest.approx(1.5 * (first.interval_n[1] - first.force_n))


def test_frames_that_show_no_wall_are_refused(reader) -> None:
    noise = np.random.default_rng(1).integers(0, 400, (512, 512)).astype(np.uint16)
    answer = reader.read(noise, SCALE, KNOWN)
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (replace(KNOWN, thickness_m=1.2e-3), "wall thickness 1200 µm, the model was trained on"),
        (replace(KNOWN, gap_m=1.5e-3), "gap between B-scan and needle axis 1.5 mm, the model was trained on 0 to 1 mm"),
    ],
)
def test_eyes_outside_the_training_are_refused(reader, frame, known: Known, words: str) -> None:
    assert words in (reader.refusal(known) or "")
    answer = reader.read(frame, SCALE, known)
    assert not answer.usable
    assert answer.reason == reader.refusal(known) or "thick" in (answer.reason or "")


def test_a_gap_below_the_slice_readers_is_read_on_the_scale_of_the_training(reader, folder) -> None:
    assert reader.refusal(replace(KNOWN, gap_m=0.1e-3)) is None
    given, *_ = network(folder)._inputs(replace(KNOWN, gap_m=0.0))
    assert given[0, GIVEN.index("gap")] == -1.0


def test_frames_that_are_stretched_otherwise_than_the_trainings_are_refused(reader, frame) -> None:
    scale = PixelScale(lateral_m=SCALE.lateral_m, depth_m=SCALE.depth_m, refractive_index=1.38)
    answer = reader.read(frame, scale, replace(KNOWN, thickness_m=None))
    assert answer.reason == "refractive index 1.38 of the frame, the model was trained with 1"


def test_a_dent_that_leaves_the_window_is_read_where_its_interval_is_narrow() -> None:
    reading = Reading(probabilities=(0.0, 0.0, 1.0), force_n=0.05, interval_n=(0.048, 0.0481 + WIDEST_N), contact_m=0.0)
    wide = judged_answer(reading, "network", leaves=True, study=Study())
    assert not wide.usable
    assert wide.reason == ("the dent leaves the window of the slice, and its flanks leave the force uncertain by 6 mN")
    narrow = replace(reading, interval_n=(0.048, 0.0539))
    assert judged_answer(narrow, "network", leaves=True, study=Study()).usable
    assert judged_answer(reading, "network", leaves=False, study=Study()).usable
    beside = judged_answer(replace(reading, contact_m=3e-3), "network", leaves=False, study=Study())
    assert "contact 3.0 mm from the frame's middle" in (beside.reason or "")
    none = judged_answer(replace(reading, force_n=float("nan")), "network", leaves=False, study=Study())
    assert none.reason == "the reading of the network is not a number"


def test_a_network_of_another_size_than_its_study_is_refused(folder) -> None:
    other = replace(RAW_STUDY, raw_reader=replace(RAW_STUDY.raw_reader, columns=64))
    session = network_session((folder / "model.onnx").read_bytes(), "place", 1)
    with pytest.raises(ModelError, match="place: inputs: found"):
        ForceNetwork(session, other, "place", raw=True)


def test_a_raw_reader_is_no_force_reader(folder) -> None:
    with pytest.raises(ModelError, match="found 'raw-reader', a reader is needed here"):
        load_force_reader(folder)


def test_it_stands_in_classify_and_evaluate(folder, frame, tmp_path, capsys) -> None:
    eye = tmp_path / "eye-a"
    (eye / "frames").mkdir(parents=True)
    cv2.imwrite(str(eye / "frames" / "0001.png"), frame)
    (eye / "recording.toml").write_text(recording_toml("eye-a"))
    (eye / "frames.csv").write_text("file,time_s\n0001.png,1.0\n")
    assert (
        run(["classify", str(folder), str(eye / "frames" / "0001.png"), "--youngs-modulus-mpa", "0.3", "--json"]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "raw-reader"
    (read,) = found["frames"]
    assert read["usable"]
    assert isfinite(read["predicted_force_mn"])
    assert len(read["interval_mn"]) == 2
    assert run(["evaluate", str(folder), str(eye), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "raw-reader"
    assert isfinite(found["frames"][0]["predicted_force_mn"])
    assert run(["show", str(folder)]) == 0
    assert "raw-reader" in capsys.readouterr().out


def test_the_monitor_wants_a_model_that_something_checks(folder, tmp_path, capsys) -> None:
    assert run(["monitor", str(folder), "--port", "0", "--black-box", str(tmp_path / "box")]) == 2
    message = capsys.readouterr().err
    assert f"{folder}: kind: raw-reader; the monitor needs a reader" in message
    assert not (tmp_path / "box").exists()


def test_its_window_reaches_as_far_as_the_slice_does() -> None:
    window, cut = FrameWindow.of(Study().raw_reader), SliceStudy()
    assert window.columns * window.column_m >= cut.columns * cut.pixel_m
    assert window.rows * window.row_m >= cut.rows * cut.pixel_m - 1e-12
