"""`train --kind wall-finder` and `segment --wall-finder`."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from scleraforce.laboratory.scenes import draw_scene
from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import ScenesStudy, format_study

pytest.importorskip("torch")  # the extra `train`

from small_models import SMALL_STUDY, write_blind_finder

SIZE = ["--width-mm", 10, "--depth-mm", 4]


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


def test_a_wall_finder_that_differs_makes_a_frame_unusable_and_the_reason_says_so(
    blind, frame, tmp_path, shell
) -> None:
    (entry,) = shell.json("segment", frame, "--out", tmp_path, *SIZE, "--wall-finder", blind)["frames"]
    assert not entry["usable"]
    assert "differ" in entry["reason"] or "the network sees no wall" in entry["reason"]
    assert [path.name for path in tmp_path.iterdir()] == ["scene.guess.png"]


def test_the_bundled_wall_finder_checks_the_wall_by_default_and_none_switches_it_off(tmp_path, shell) -> None:
    """In a drawn scene in which it finds another wall than edge detection."""
    scene, path = draw_scene(ScenesStudy(seed=3), 6), tmp_path / "scene.png"
    cv2.imwrite(str(path), scene.frame)
    scale = PixelScale(lateral_m=10e-3 / scene.frame.shape[1], depth_m=4e-3 / len(scene.frame))
    checked = find_wall(scene.frame, scale, finder=load_wall_finder(SHIPPED_WALL_FINDER)).mask
    unchecked = find_wall(scene.frame, scale).mask
    assert not np.array_equal(checked, unchecked)
    for name, words, expected in (
        ("a", (), checked), ("b", ("--wall-finder", SHIPPED_WALL_FINDER), checked),
        ("c", ("--wall-finder", "none"), unchecked),
    ):  # fmt: skip
        (entry,) = shell.json("segment", path, "--out", tmp_path / name, *SIZE, *words)["frames"]
        assert np.array_equal(cv2.imread(entry["mask"], cv2.IMREAD_UNCHANGED), expected)


def test_options_that_exclude_each_other_are_refused(tmp_path, shell) -> None:
    for options, said in (
        (["data.zarr", "--kind", "wall-finder"], "data.zarr: --kind wall-finder draws its scenes; leave DATASET out"),
        ([], "--kind classifier: DATASET is missing; only --kind wall-finder needs none"),
        (["--kind", "raw-reader"], "--kind raw-reader: DATASET is missing"),
        (["lib", "--kind", "raw-reader", "--search"], "a raw-reader has the sizes of [raw_reader]"),
        (["slices", "--scheduler", "tcp://127.0.0.1:9"], "--scheduler: for --search and --kind wall-finder"),
    ):
        assert said in shell.refused("train", *options, "--out", tmp_path / "model")
        assert not (tmp_path / "model").exists()


@pytest.mark.slow
def test_training_prints_its_results_and_its_model_segments(frame, tmp_path, shell) -> None:
    study, model = tmp_path / "study.toml", tmp_path / "finder"
    study.write_text(format_study(SMALL_STUDY))
    answer = shell.json("train", "--kind", "wall-finder", "--study", study, "--out", model)
    assert (answer["kind"], answer["scenes"]) == ("wall-finder", 640)
    assert answer["dice_mean"] > 0.85
    (entry,) = shell.json("segment", frame, "--out", tmp_path, *SIZE, "--wall-finder", model)["frames"]
    assert entry["reason"] == "" or "does not know where the wall ends" in entry["reason"]  # 640 scenes teach little
