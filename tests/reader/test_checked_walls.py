"""Frames in which a network sees another wall: refused by all that reads them, but not in the control loop."""

import json
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import KNOWN, LIBRARY, SCALE, STUDY, image, tip_of, wall_section
from small_models import FINDER_STUDY, FIVE_MN, FixedNetwork, told_finder, write_blind_finder
from small_recordings import write_places

from scleraforce.cli.main import run
from scleraforce.reader import load_classifier
from scleraforce.reader.kinds import ForceReader

pytest.importorskip("torch")

HALF = FINDER_STUDY.columns // 2
SAID = ("two ways to find the wall differ", "the network sees no wall", "the network does not know")


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("reader"))


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    write_blind_finder(folder := tmp_path_factory.mktemp("models") / "blind")
    return folder


def test_the_loop_reads_what_the_second_opinion_refuses() -> None:
    frame = image(wall_section(tip_of(0.02)))
    elsewhere = told_finder(np.full(HALF, 100.0), np.full(HALF, 110.0), sd=0.3)
    reader = ForceReader(Path("model"), STUDY, {}, FixedNetwork(FIVE_MN), LIBRARY, "fit", finder=elsewhere)
    answer = reader.read(frame, SCALE, KNOWN)
    assert not answer.usable
    assert answer.predicted == 2
    assert answer.reason.startswith(SAID[0])
    assert not answer.can_calibrate
    assert reader.read_live(frame, SCALE, KNOWN).usable


def test_a_classifier_checks_its_walls_too(tmp_path: Path, blind: Path, write_model) -> None:
    frame = image(wall_section(tip_of(0.02)))
    path = write_model(tmp_path / "tiny", STUDY).path
    checked, alone = load_classifier(path, finder=blind), load_classifier(path, finder=None)
    assert alone.read(frame, SCALE).usable
    assert not checked.read(frame, SCALE).usable
    assert checked.read(frame, SCALE).reason.startswith(SAID)
    assert checked.read_live(frame, SCALE).usable


def told(capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> str:
    assert run([str(word) for word in words]) == code
    printed = capsys.readouterr()
    return printed.out if code == 0 else printed.err


def test_the_commands_check_with_the_wall_finder_that_they_are_given(places, blind, capsys) -> None:
    frame = places["mine"] / "frames" / "1.png"
    read = {}
    for finder in (None, "none", blind):
        words = [] if finder is None else ["--wall-finder", finder]
        (entry,) = json.loads(told(capsys, "classify", places["model"], frame, "--json", *words))["frames"]
        found = json.loads(told(capsys, "evaluate", places["model"], places["mine"], "--json", *words))["frames"]
        read[finder] = {key: entry[key] for key in ("usable", "reason", "predicted_force_mn", "interval_mn")}
        assert [one["usable"] for one in found] == [entry["usable"]] * 4 + [False]
        assert found[1]["reason"] == entry["reason"]
    assert read[None] == read["none"]
    assert read[None]["usable"]
    assert not read[blind]["usable"]
    assert read[blind]["reason"].startswith(SAID)


@pytest.mark.slow
def test_calibrate_takes_no_frame_that_the_wall_finder_doubts(places, blind, capsys, tmp_path) -> None:
    asked = ["calibrate", places["mine"], "--mechanics", "linear", "--frames", 1, "--out"]
    message = told(capsys, *asked, tmp_path / "a.json", "--wall-finder", blind, code=2)
    assert any(f"not usable: {said}" in message for said in SAID)
    assert not (tmp_path / "a.json").exists()
    told(capsys, *asked, tmp_path / "b.json", "--wall-finder", "none")
    told(capsys, *asked, tmp_path / "c.json")
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "c.json").read_bytes()


def test_a_wall_finder_that_is_none_is_refused_by_name(places, capsys) -> None:
    message = told(capsys, "evaluate", places["model"], places["mine"], "--wall-finder", places["model"], code=2)
    assert "kind: found 'reader', a wall-finder is needed here" in message
