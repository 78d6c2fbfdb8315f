"""A raw reader: its network's answer to the frame itself, and its refusals."""

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

from scleraforce.base.errors import ModelError
from scleraforce.base.onnx_network import network_session
from scleraforce.front.cli.main import run
from scleraforce.reading.answer import Reading
from scleraforce.reading.force_network import GIVEN, ForceNetwork
from scleraforce.reading.frame_checks import WIDEST_N, judged_answer
from scleraforce.reading.interval_widths import IntervalFactors
from scleraforce.reading.load_model import load_force_reader, load_reader
from scleraforce.reading.reading_models import RawReader
from scleraforce.records.eye import NO_DISCREPANCY, Modulus
from scleraforce.records.study import Study
from scleraforce.wall.wall_network import FrameWindow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw"
    write_raw_model(path)
    return path


@pytest.fixture(scope="module")
def reader(folder: Path) -> RawReader:
    model = load_reader(folder)
    assert isinstance(model, RawReader)
    return model


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.02)))


def network(folder: Path, factors: IntervalFactors | None = None) -> ForceNetwork:
    session = network_session((folder / "model.onnx").read_bytes(), "place", 1)
    return ForceNetwork(
        session, RAW_STUDY, "place", factors or IntervalFactors(), raw=True
    )


def test_the_answer_is_the_networks_reading_of_the_reduced_frame(
    reader, folder, frame
) -> None:
    reduced = FrameWindow.of(RAW_STUDY.raw_reader).reduced(frame, SCALE)[None]
    expected = network(folder).read(reduced, KNOWN)
    answer = reader.read(frame, SCALE, KNOWN)
    assert answer.usable
    assert (answer.force_n, answer.interval_n, answer.contact_m) == (
        expected.force_n,
        expected.interval_n,
        expected.contact_m,
    )
    assert answer.readings == (("network", expected),)
    assert answer.fit is None
    assert answer.can_calibrate
    assert reader.read_live(frame, SCALE, KNOWN) == replace(answer, can_calibrate=False)


def test_the_known_values_of_the_eye_change_the_reading(folder, frame) -> None:
    reduced = FrameWindow.of(RAW_STUDY.raw_reader).reduced(frame, SCALE)[None]
    first = network(folder).read(reduced, KNOWN)
    twice = Modulus(
        mean_pa=2.0 * KNOWN.eye.modulus.mean_pa,
        sd_pa=KNOWN.eye.modulus.sd_pa,
        source="own",
    )
    stiffer = replace(
        KNOWN, eye=replace(KNOWN.eye, discrepancy=replace(NO_DISCREPANCY, level=0.1))
    )

    for other in (replace(KNOWN, eye=replace(KNOWN.eye, modulus=twice)), stiffer):
        assert network(folder).read(reduced, other).force_n != first.force_n

    wider = network(folder, IntervalFactors(network={"own E": {"open": 1.5}})).read(
        reduced, KNOWN
    )
    assert wider.force_n == first.force_n
    assert wider.interval_n[1] - first.force_n == pytest.approx(
        1.5 * (first.interval_n[1] - first.force_n)
    )


def test_frames_without_a_wall_and_eyes_outside_the_training_are_refused(
    reader, frame, folder
) -> None:
    noise = np.random.default_rng(1).integers(0, 400, (512, 512)).astype(np.uint16)
    answer = reader.read(noise, SCALE, KNOWN)
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)
    gap = (
        "gap between B-scan and needle axis 1.5 mm, the model was trained on 0 to 1 mm"
    )

    for known, words in (
        (
            replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=1.2e-3)),
            "wall thickness 1200 µm, the model was trained on",
        ),
        (replace(KNOWN, needle=replace(KNOWN.needle, gap_m=1.5e-3)), gap),
    ):
        assert words in (reader.refusal(known) or "")
        answer = reader.read(frame, SCALE, known)
        assert not answer.usable
        assert answer.reason == reader.refusal(known) or "thick" in (
            answer.reason or ""
        )

    assert (
        reader.refusal(replace(KNOWN, needle=replace(KNOWN.needle, gap_m=0.1e-3)))
        is None
    )
    given, *_ = network(folder)._inputs(
        replace(KNOWN, needle=replace(KNOWN.needle, gap_m=0.0)), 1
    )
    assert given[0, GIVEN.index("gap")] == -1.0  # below the slice readers'
    stretched = replace(SCALE, refractive_index=1.38)
    answer = reader.read(
        frame, stretched, replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=None))
    )
    assert (
        answer.reason
        == "refractive index 1.38 of the frame, the model was trained with 1"
    )


def test_a_dent_that_leaves_the_window_is_read_where_its_interval_is_narrow() -> None:
    reading = Reading(
        probabilities=(0.0, 0.0, 1.0),
        force_n=0.05,
        interval_n=(0.048, 0.0481 + WIDEST_N),
        contact_m=0.0,
    )

    def reason(one: Reading, leaves: bool = False) -> str | None:
        answer = judged_answer(one, "network", leaves=leaves, study=Study())
        assert answer.usable == (answer.reason is None)
        return answer.reason

    said = reason(reading, leaves=True)
    assert (
        said
        == "the dent leaves the window of the slice, and its flanks leave the force"
        " uncertain by 6 mN"
    )
    assert reason(replace(reading, interval_n=(0.048, 0.0539)), leaves=True) is None
    assert reason(reading) is None
    assert "contact 3.0 mm from the frame's middle" in reason(
        replace(reading, contact_m=3e-3)
    )
    assert (
        reason(replace(reading, force_n=float("nan")))
        == "the reading of the network is not a number"
    )


def test_another_study_or_another_kind_than_the_network_s_is_refused(folder) -> None:
    other = replace(RAW_STUDY, raw_reader=replace(RAW_STUDY.raw_reader, columns=64))
    session = network_session((folder / "model.onnx").read_bytes(), "place", 1)
    with pytest.raises(ModelError, match="place: inputs: found"):
        ForceNetwork(session, other, "place", raw=True)
    with pytest.raises(ModelError, match="found 'raw-reader', a reader is needed here"):
        load_force_reader(folder)


def test_commands_read_with_it_and_the_monitor_refuses_it(
    folder, frame, tmp_path, capsys
) -> None:
    eye = tmp_path / "eye-a"
    box = tmp_path / "box"
    (eye / "frames").mkdir(parents=True)
    cv2.imwrite(str(eye / "frames" / "0001.png"), frame)
    (eye / "recording.toml").write_text(recording_toml("eye-a"))
    (eye / "frames.csv").write_text("file,time_s\n0001.png,1.0\n")

    for words in (
        ("classify", eye / "frames" / "0001.png", "--youngs-modulus-mpa", 0.3),
        ("evaluate", eye),
    ):
        assert run([words[0], str(folder), *map(str, words[1:]), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["kind"] == "raw-reader"
        (read,) = found["frames"]
        assert read["usable"]
        assert isfinite(read["predicted_force_mn"])
        assert len(read["interval_mn"]) == 2

    assert run(["show", str(folder)]) == 0
    assert "raw-reader" in capsys.readouterr().out
    assert run(["monitor", str(folder), "--port", "0", "--black-box", str(box)]) == 2
    assert (
        f"{folder}: kind: raw-reader; the monitor needs a reader"
        in capsys.readouterr().err
    )
    assert not box.exists()
