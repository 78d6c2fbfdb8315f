"""The wall that is read: checked by the wall finder, below a conjunctiva, and the same
from every entry.
"""

import json
from dataclasses import replace
from math import log
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic_frames import (
    CLEAN,
    GAP_M,
    IOP_PA,
    KNOWN,
    LIBRARY,
    MODULUS_PA,
    SCALE,
    STUDY,
    THICKNESS_M,
    image,
    recording_toml,
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
from small_recordings import FORCE_TOML, write_places

import scleraforce as sf
from predicted_walls import Walls, formed_wall
from scleraforce.base.units import from_si
from scleraforce.fit.unknowns import (
    DEPTH,
    GAP,
    IOP,
    LATERAL,
    MODULUS,
    NAMES,
    THICKNESS,
    TIP,
)
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import sample_conjunctiva, sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_classifier, load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.fields import fixed

pytest.importorskip("torch")

HALF = FINDER_STUDY.columns // 2
SAID = ("two ", "the network sees no wall", "the network does not know")


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("reader"))


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    write_blind_finder(folder := tmp_path_factory.mktemp("models") / "blind")
    return folder


def test_the_loop_reads_what_the_second_opinion_refuses() -> None:
    frame = image(wall_section(tip_of(0.02)))
    elsewhere = fixed_finder(np.full(HALF, 100.0), np.full(HALF, 110.0), sd=0.3)
    reader = ForceReader(
        Path("model"), STUDY, FixedNetwork(FIVE_MN), LIBRARY, "fit", finder=elsewhere
    )
    answer = reader.read(frame, SCALE, KNOWN)
    assert not answer.usable
    assert answer.predicted == 2
    assert answer.reason.startswith(SAID[0])
    assert not answer.can_calibrate
    assert reader.read_live(frame, SCALE, KNOWN).usable


def test_a_classifier_checks_its_walls_too(
    tmp_path: Path, blind: Path, write_model
) -> None:
    frame = image(wall_section(tip_of(0.02)))
    path = write_model(tmp_path / "tiny", STUDY).path
    checked = load_classifier(path, finder=blind)
    alone = load_classifier(path, finder=None)
    assert alone.read(frame, SCALE).usable
    assert not checked.read(frame, SCALE).usable
    assert checked.read(frame, SCALE).reason.startswith(SAID)
    assert checked.read_live(frame, SCALE).usable


def frames_of(capsys: pytest.CaptureFixture[str], *words: object) -> list[dict]:
    return json.loads(said(capsys, *words, "--json"))["frames"]


def test_the_commands_check_with_the_given_wall_finder(places, blind, capsys) -> None:
    frame = places["mine"] / "frames" / "1.png"
    read = {}

    for finder in (None, "none", blind):
        words = [] if finder is None else ["--wall-finder", finder]
        (read[finder],) = frames_of(capsys, "classify", places["model"], frame, *words)
        found = frames_of(capsys, "evaluate", places["model"], places["mine"], *words)
        assert [one["usable"] for one in found] == [read[finder]["usable"]] * 4 + [
            False
        ]
        assert found[1]["reason"] == read[finder]["reason"]

    assert read[None]["usable"]  # the network may move the wall's end by a few rows
    assert read[None]["predicted_force_mn"] == pytest.approx(
        read["none"]["predicted_force_mn"], rel=0.05
    )
    assert not read[blind]["usable"]
    assert read[blind]["reason"].startswith(SAID)
    message = said(
        capsys,
        "evaluate",
        places["model"],
        places["mine"],
        "--wall-finder",
        places["model"],
        code=2,
    )
    assert "kind: found 'reader', a wall-finder is needed here" in message


@pytest.mark.slow
def test_calibrate_takes_no_frame_that_the_wall_finder_doubts(
    places, blind, capsys, tmp_path
) -> None:
    command = [
        "calibrate",
        places["mine"],
        "--mechanics",
        "linear",
        "--frames",
        1,
        "--out",
    ]
    message = said(
        capsys, *command, tmp_path / "a.json", "--wall-finder", blind, code=2
    )
    assert any(f"not usable: {words}" in message for words in SAID)
    assert not (tmp_path / "a.json").exists()
    said(capsys, *command, tmp_path / "b.json", "--wall-finder", "none")
    said(capsys, *command, tmp_path / "c.json")
    files = (json.loads((tmp_path / name).read_text()) for name in ("b.json", "c.json"))
    alone, checked = (file["population"]["mean_mpa"] for file in files)
    assert checked == pytest.approx(alone, rel=0.02)


LAYER_M = 140e-6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One frame of the analytic wall at 15 mN, under a layer."""
    path = tmp_path_factory.mktemp("layered") / "eye"
    rng = np.random.default_rng(1)
    over = sample_conjunctiva(
        replace(CLEAN, conjunctiva_thickness_m=fixed(LAYER_M)), rng
    )
    optics = replace(sample_optics(CLEAN, STUDY.oct, rng), conjunctiva=over)
    (path / "frames").mkdir(parents=True)
    cv2.imwrite(
        str(path / "frames" / "1.png"),
        render_bscan(wall_section(tip_of(0.015)), STUDY.oct, optics, rng).frame,
    )
    (path / "recording.toml").write_text(recording_toml("mine", more=FORCE_TOML))
    (path / "frames.csv").write_text("file,time_s\n1.png,5.0\n")

    return path


def test_commands_and_python_look_below_a_layer(
    recording, places, blind, capsys, tmp_path
) -> None:
    frame = recording / "frames" / "1.png"
    modulus = ("--youngs-modulus-mpa", MODULUS_PA / 1e6)
    (found,) = frames_of(capsys, "segment", recording, "--out", tmp_path / "a")
    assert found["thickness_um"] == pytest.approx(1e6 * THICKNESS_M, rel=0.06)
    (read,) = frames_of(capsys, "classify", places["model"], frame, *modulus)
    (evaluated,) = frames_of(capsys, "evaluate", places["model"], recording)

    for entry in (found, read, evaluated):
        assert entry["usable"], entry["reason"]
        assert entry["conjunctiva_um"] == pytest.approx(1e6 * LAYER_M, rel=0.15)

    assert read["predicted_force_mn"] == pytest.approx(15.0, abs=1.5)
    (alone,) = frames_of(
        capsys, "segment", recording, "--out", tmp_path / "b", "--wall-finder", "none"
    )
    assert alone["conjunctiva_um"] == found["conjunctiva_um"]

    for wall in (sf.segment(frame), sf.segment(frame, wall_finder=None)):
        assert wall.conjunctiva_m == pytest.approx(LAYER_M, rel=0.15)

    models = [
        sf.load_model(places["model"], **finder)
        for finder in ({}, {"wall_finder": None}, {"wall_finder": blind})
    ]
    usable = [
        sf.read(model, frame, youngs_modulus_pa=MODULUS_PA).usable for model in models
    ]
    assert usable == [True, True, False]
    assert not sf.segment(frame, wall_finder=blind).usable


DENTS_MM = (0.4, 1.0, 1.6)
FILES = [f"{number}.png" for number in range(len(DENTS_MM) + 1)]


@pytest.fixture(scope="module")
def small_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three dents of walls of the shipped library, and noise."""
    folder = tmp_path_factory.mktemp("eye") / "eye"
    (folder / "frames").mkdir(parents=True)
    walls = Walls(load_force_reader("default").library)
    frames = []

    for dent_mm in DENTS_MM:
        unknown = np.zeros(len(NAMES))
        unknown[[TIP, LATERAL, DEPTH, GAP, THICKNESS]] = (
            dent_mm * 1e-3,
            0.3e-3,
            0.5e-3,
            GAP_M,
            THICKNESS_M,
        )
        unknown[[MODULUS, IOP]] = log(MODULUS_PA), log(IOP_PA)
        frames.append(image(WallSection(*formed_wall(walls, unknown))))

    frames.append(
        np.random.default_rng(0).integers(0, 4096, frames[0].shape, dtype=np.uint16)
    )
    for file, frame in zip(FILES, frames, strict=True):
        assert cv2.imwrite(str(folder / "frames" / file), frame)

    (folder / "frames.csv").write_text(
        "file,time_s\n" + "".join(f"{file},{n}.0\n" for n, file in enumerate(FILES))
    )
    (folder / "recording.toml").write_text(recording_toml("eye"))

    return folder


def in_json(answer: Answer) -> dict[str, object]:
    """The answer's keys in the JSON of commands."""
    return {
        "predicted": answer.predicted,
        "predicted_force_mn": from_si(answer.force_n, "mn"),
        "interval_mn": (
            None
            if answer.interval_n is None
            else [from_si(end, "mn") for end in answer.interval_n]
        ),
        "usable": answer.usable,
        "reason": answer.reason,
        "lean_deg": answer.to_dict()["lean_deg"],
        "elastic_force_mn": from_si(answer.elastic_force_n, "mn"),
    }


@pytest.mark.parametrize("remembers", [False, True])
def test_all_readings_of_a_frame_are_one(
    small_recording: Path, capsys, remembers: bool
) -> None:
    if remembers:
        toml = small_recording / "recording.toml"
        text = toml.read_text().replace("[eye]", "[eye]\nrelaxation = [[0.2, 3.0]]")
        toml.write_text(text.replace("[needle]", "[needle]\nlean_rad = 0.4"))
        rows = [f"{file},{n}e-1\n" for n, file in enumerate(FILES)]
        (small_recording / "frames.csv").write_text("".join(["file,time_s\n", *rows]))

    model = sf.load_model("default")
    paths = [small_recording / "frames" / file for file in FILES]
    answers = [sf.read(model, path) for path in paths]
    assert [answer.usable for answer in answers] == [True, True, True, False]
    info = read_recording(small_recording).info
    known = info.setup
    scale = info.scan.scale
    evaluated = sf.evaluate(model, small_recording).frames
    history = TissueMemory.unknown(known, 60e-3)

    for n, (answer, other, path) in enumerate(
        zip(answers, evaluated, paths, strict=True)
    ):
        # as the second opinion does
        elastic = model.read(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), scale, known)
        opinion, history = history.read(
            elastic, model.study.classes.bounds_n, n * 0.1 if remembers else float(n)
        )
        assert opinion.verdict == other.answer.verdict
        assert (other.answer.verdict == answer.verdict) == (
            not (remembers and answer.usable)
        )

        for wall in (answer.segmentation, sf.segment(path)):
            np.testing.assert_array_equal(
                wall.outer_row, other.answer.segmentation.outer_row
            )
            np.testing.assert_array_equal(
                wall.inner_row, other.answer.segmentation.inner_row
            )
            assert (wall.usable, wall.reason) == (
                other.answer.segmentation.usable,
                other.answer.segmentation.reason,
            )

    for command in (
        ["read", "default", *reversed(paths)],
        ["evaluate", "default", small_recording],
    ):
        entries = {
            Path(entry["file"]).name: entry for entry in frames_of(capsys, *command)
        }
        for frame in evaluated:
            expected = in_json(frame.answer)
            entry = entries[frame.file]
            assert {key: entry[key] for key in expected} == expected
