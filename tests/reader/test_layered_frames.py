"""A frame under a conjunctiva, in a recording that states the wall's thickness: what commands and Python say of it."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic_frames import CLEAN, MODULUS_PA, STUDY, THICKNESS_M, recording_toml, tip_of, wall_section
from small_models import write_blind_finder
from small_recordings import FORCE_TOML, write_places

import scleraforce as sf
from scleraforce.cli.main import run
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import sample_conjunctiva, sample_optics
from scleraforce.study.fields import fixed

pytest.importorskip("torch")

LAYER_M = 140e-6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One frame of the analytic wall at 15 mN, under a layer."""
    path, rng = tmp_path_factory.mktemp("layered") / "eye", np.random.default_rng(1)
    over = sample_conjunctiva(replace(CLEAN, conjunctiva_thickness_m=fixed(LAYER_M)), rng)
    optics = replace(sample_optics(CLEAN, STUDY.oct, rng), conjunctiva=over)
    (path / "frames").mkdir(parents=True)
    cv2.imwrite(str(path / "frames" / "1.png"), render_bscan(wall_section(tip_of(0.015)), STUDY.oct, optics, rng).frame)
    (path / "recording.toml").write_text(recording_toml("mine", more=FORCE_TOML))
    (path / "frames.csv").write_text("file,time_s\n1.png,5.0\n")
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_places(tmp_path_factory.mktemp("reader"))["model"]


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    write_blind_finder(folder := tmp_path_factory.mktemp("models") / "blind")
    return folder


def frames_of(capsys: pytest.CaptureFixture[str], *words: object) -> list[dict]:
    assert run([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["frames"]


def test_commands_look_below_it_and_tell_its_thickness(recording, model, capsys, tmp_path) -> None:
    frame, told = recording / "frames" / "1.png", ("--youngs-modulus-mpa", MODULUS_PA / 1e6)
    (found,) = frames_of(capsys, "segment", recording, "--out", tmp_path / "a")
    assert found["thickness_um"] == pytest.approx(1e6 * THICKNESS_M, rel=0.06)
    (read,) = frames_of(capsys, "classify", model, frame, *told)
    (evaluated,) = frames_of(capsys, "evaluate", model, recording)
    for entry in (found, read, evaluated):
        assert entry["usable"], entry["reason"]
        assert entry["conjunctiva_um"] == pytest.approx(1e6 * LAYER_M, rel=0.15)
    assert read["predicted_force_mn"] == pytest.approx(15.0, abs=1.5)
    (alone,) = frames_of(capsys, "segment", recording, "--out", tmp_path / "b", "--wall-finder", "none")
    assert alone["conjunctiva_um"] == found["conjunctiva_um"]


def test_python_looks_below_it_too_and_checks_with_the_wall_finder_that_it_is_given(recording, model, blind) -> None:
    frame = recording / "frames" / "1.png"
    for finder in (sf.segment(frame), sf.segment(frame, wall_finder=None)):
        assert finder.conjunctiva_m == pytest.approx(LAYER_M, rel=0.15)
    usable = [
        sf.read(reader, frame, youngs_modulus_pa=MODULUS_PA).usable
        for reader in (
            sf.load_model(model),
            sf.load_model(model, wall_finder=None),
            sf.load_model(model, wall_finder=blind),
        )
    ]
    assert usable == [True, True, False]
    assert not sf.segment(frame, wall_finder=blind).usable
