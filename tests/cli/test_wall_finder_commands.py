"""`train --kind wall-finder` and `segment --wall-finder`."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from scleraforce.cli.main import run
from scleraforce.laboratory.scenes import draw_scene
from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import ScenesStudy, format_study

pytest.importorskip("torch")  # the extra `train`

from small_models import SMALL_STUDY, write_blind_finder


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "blind"
    write_blind_finder(folder)
    return folder


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "scene.png"
    cv2.imwrite(str(path), draw_scene(SMALL_STUDY.scenes, 5).frame)
    return path


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert run([str(word) for word in arguments]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.lower().startswith("error: ")
    return message


def test_a_wall_finder_that_differs_makes_a_frame_unusable_and_says_why(blind, frame, tmp_path, capsys) -> None:
    words = ["segment", frame, "--out", tmp_path, "--width-mm", 10, "--depth-mm", 4, "--wall-finder", blind, "--json"]
    assert run([str(word) for word in words]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["frames"]
    assert not entry["usable"]
    assert "two ways to find the wall differ" in entry["reason"] or "the network sees no wall" in entry["reason"]
    assert (tmp_path / "scene.png").is_file()


def test_the_shipped_wall_finder_looks_unless_told_otherwise(tmp_path) -> None:
    """In a drawn scene where it finds another wall than the classical way."""
    scene, path = draw_scene(ScenesStudy(seed=3), 6), tmp_path / "scene.png"
    cv2.imwrite(str(path), scene.frame)
    scale = PixelScale(lateral_m=10e-3 / scene.frame.shape[1], depth_m=4e-3 / len(scene.frame))
    checked = find_wall(scene.frame, scale, finder=load_wall_finder(SHIPPED_WALL_FINDER))
    assert not np.array_equal(checked.mask, find_wall(scene.frame, scale).mask)
    assert np.array_equal(mask_of(path, tmp_path / "a"), checked.mask)
    assert np.array_equal(mask_of(path, tmp_path / "b", "--wall-finder", SHIPPED_WALL_FINDER), checked.mask)


def test_without_a_wall_finder_the_mask_is_that_of_the_classical_way(frame, tmp_path) -> None:
    pixels = cv2.imread(str(frame), cv2.IMREAD_UNCHANGED)
    scale = PixelScale(lateral_m=10e-3 / pixels.shape[1], depth_m=4e-3 / pixels.shape[0])
    assert np.array_equal(mask_of(frame, tmp_path, "--wall-finder", "none"), find_wall(pixels, scale).mask)


def mask_of(frame: Path, out: Path, *words: object) -> np.ndarray:
    asked = ["segment", frame, "--out", out, "--width-mm", 10, "--depth-mm", 4, *words]
    assert run([str(word) for word in asked]) == 0
    return cv2.imread(str(out / "scene.png"), cv2.IMREAD_UNCHANGED)


def test_options_that_exclude_each_other_are_refused(tmp_path, capsys) -> None:
    for options, said in (
        (["data.zarr", "--kind", "wall-finder"], "data.zarr: --kind wall-finder draws its scenes; leave DATASET out"),
        ([], "--kind classifier: DATASET is missing; only --kind wall-finder needs none"),
        (["--kind", "reader"], "--kind reader: DATASET is missing"),
        (["--kind", "raw-reader"], "--kind raw-reader: DATASET is missing"),
        (["lib", "--kind", "raw-reader", "--search"], "a raw-reader has the sizes of [raw_reader]"),
        (["--kind", "wall-finder", "--search"], "--search is for --kind classifier: a wall-finder has the sizes"),
        (["slices", "--scheduler", "tcp://127.0.0.1:9"], "--scheduler: for --search and --kind wall-finder"),
    ):
        assert said in refused(capsys, "train", *options, "--out", tmp_path / "model")
        assert not (tmp_path / "model").exists()


def test_sizes_that_cannot_be_halved_are_refused_with_their_line(tmp_path, capsys) -> None:
    study = tmp_path / "study.toml"
    study.write_text("[wall_finder]\nrows = 100\n")
    message = refused(capsys, "train", "--kind", "wall-finder", "--study", study, "--out", tmp_path / "model")
    assert f"{study}:2: wall_finder.rows: 100 is not a multiple of 16" in message


@pytest.mark.slow
def test_training_prints_what_it_reached_and_its_model_segments(frame, tmp_path, capsys) -> None:
    study = tmp_path / "study.toml"
    study.write_text(format_study(SMALL_STUDY))
    model = tmp_path / "finder"
    assert run(["train", "--kind", "wall-finder", "--study", str(study), "--out", str(model), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["kind"] == "wall-finder"
    assert answer["scenes"] == 640
    assert answer["dice_mean"] > 0.85
    words = ["segment", frame, "--out", tmp_path, "--width-mm", 10, "--depth-mm", 4, "--wall-finder", model, "--json"]
    assert run([str(word) for word in words]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["frames"]
    assert entry["reason"] == ""
