"""The same frame with the same inputs gives the same answer and the same wall, to the last bit, wherever it is read."""

import json
from math import log
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic_frames import GAP_M, IOP_PA, MODULUS_PA, THICKNESS_M, image, recording_toml

import scleraforce as sf
from scleraforce.cli.main import run
from scleraforce.known import known_of_recording
from scleraforce.library.prediction import Walls, place_walls
from scleraforce.library.unknowns import DEPTH, GAP, IOP, LATERAL, MODULUS, NAMES, THICKNESS, TIP
from scleraforce.mechanics.contact import Section
from scleraforce.reader import load_force_reader
from scleraforce.reader.answer import Answer
from scleraforce.recording.folder import read_recording
from scleraforce.recording.pixels import PixelScale
from scleraforce.units import from_si

DENTS_MM = (0.4, 1.0, 1.6)
FILES = [f"{number}.png" for number in range(len(DENTS_MM) + 1)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three dents of walls of the shipped library, and noise."""
    folder = tmp_path_factory.mktemp("eye") / "eye"
    (folder / "frames").mkdir(parents=True)
    walls = Walls(load_force_reader("default").library)
    frames = []
    for dent_mm in DENTS_MM:
        unknown = np.zeros(len(NAMES))
        unknown[[TIP, LATERAL, DEPTH, GAP, THICKNESS]] = dent_mm * 1e-3, 0.3e-3, 0.5e-3, GAP_M, THICKNESS_M
        unknown[[MODULUS, IOP]] = log(MODULUS_PA), log(IOP_PA)
        frames.append(image(Section(*place_walls(walls, unknown[None])[0])))
    frames.append(np.random.default_rng(0).integers(0, 4096, frames[0].shape, dtype=np.uint16))
    for file, frame in zip(FILES, frames, strict=True):
        assert cv2.imwrite(str(folder / "frames" / file), frame)
    (folder / "frames.csv").write_text("file,time_s\n" + "".join(f"{file},{n}.0\n" for n, file in enumerate(FILES)))
    (folder / "recording.toml").write_text(recording_toml("eye"))
    return folder


def in_json(answer: Answer) -> dict[str, object]:
    """What a reading is in the JSON of commands."""
    return {
        "predicted": answer.predicted,
        "predicted_force_mn": from_si(answer.force_n, "mn"),
        "interval_mn": None if answer.interval_n is None else [from_si(end, "mn") for end in answer.interval_n],
        "usable": answer.usable,
        "reason": answer.reason,
    }


def test_all_readings_of_a_frame_are_one(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, paths = sf.load_model("default"), [recording / "frames" / file for file in FILES]
    answers = [sf.read(model, path) for path in paths]
    assert [answer.usable for answer in answers] == [True, True, True, False]
    info = read_recording(recording).info
    known, scale = known_of_recording(info), PixelScale.of(info.oct)
    for answer, path in zip(answers, paths, strict=True):
        opinion = model.read(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), scale, known)  # as the second opinion does
        assert opinion.verdict == answer.verdict
    evaluated = sf.evaluate(model, recording).frames
    for command in (["read", "default", *map(str, paths)], ["evaluate", "default", str(recording)]):
        assert run([*command, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)["frames"]
        for answer, entry in zip(answers, told, strict=True):
            expected = in_json(answer)
            assert {key: entry[key] for key in expected} == expected
    for answer, other, path in zip(answers, evaluated, paths, strict=True):
        assert (other.answer.force_n, other.answer.interval_n) == (answer.force_n, answer.interval_n)
        for wall in (answer.segmentation, sf.segment(path)):
            np.testing.assert_array_equal(wall.outer_row, other.answer.segmentation.outer_row)
            np.testing.assert_array_equal(wall.inner_row, other.answer.segmentation.inner_row)
            assert (wall.usable, wall.reason) == (other.answer.segmentation.usable, other.answer.segmentation.reason)
