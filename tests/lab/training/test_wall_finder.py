"""A wall finder learns from scenes alone; its model folder says what it was made of and
runs without PyTorch.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from small_models import SMALL_STUDY

from scleraforce.base.errors import ModelError
from scleraforce.base.onnx_network import network_session, run_network
from scleraforce.lab.scenes.drawn_scenes import draw_scene
from scleraforce.lab.training import wall_network_training
from scleraforce.lab.training.trained_models import train_wall_finder
from scleraforce.reading.load_model import load_reader, load_wall_finder
from scleraforce.records.study import Study, parse_study, study_hash
from scleraforce.wall.wall_network import (
    FINDER_FRAMES,
    FINDER_ROWS,
    FINDER_WALL,
    WallFinder,
)

FINDER = SMALL_STUDY.wall_finder


@pytest.mark.slow
def test_it_finds_walls_of_new_easy_scenes_and_writes_a_wall_finder_that_is_checked(
    tmp_path,
):
    folder = tmp_path / "finder"
    record = train_wall_finder(SMALL_STUDY, folder, workers=1)
    assert record["metrics"]["dice_mean"] > 0.85
    assert record["metrics"]["found"] > 0.95
    assert (
        json.loads(json.dumps(record)).items()
        <= json.loads((folder / "model.json").read_text()).items()
    )
    assert record["provenance"]["study_sha256"] == study_hash(SMALL_STUDY)
    assert parse_study((folder / "study.toml").read_text()) == SMALL_STUDY
    assert (
        f"{FINDER.batches * FINDER.batch_size} drawn scenes"
        in (folder / "card.md").read_text()
    )
    losses = record["curves"]["training_loss"]
    assert len(losses) == 50
    assert losses[0] > losses[-1]

    with pytest.raises(ModelError, match="kind: found 'wall-finder'"):
        load_reader(folder)

    with pytest.raises(ModelError, match="place: inputs: found"):
        WallFinder(load_wall_finder(folder).session, Study().wall_finder, "place")

    changed = Path(shutil.copytree(folder, tmp_path / "changed"))
    (changed / "model.onnx").write_bytes(
        (changed / "model.onnx").read_bytes()[:-1] + b"x"
    )

    with pytest.raises(
        ModelError, match=r"model\.onnx: SHA-256 .* was changed after training"
    ):
        load_wall_finder(changed)


def test_the_graph_answers_as_the_network_does():
    with torch.random.fork_rng():
        torch.manual_seed(3)
        network = wall_network_training.WallFinderNetwork(FINDER)
        frames = torch.rand(5, FINDER.rows, FINDER.columns)
        network(frames)  # moves the running means away from 0

    network.eval()
    session = network_session(
        wall_network_training.finder_bytes(network, {"kind": "test"}), "graph", 1
    )
    rows, wall = run_network(
        session, [FINDER_ROWS, FINDER_WALL], {FINDER_FRAMES: frames.numpy()}, "graph"
    )

    with torch.inference_mode():
        row_logits, wall_logits = network(frames)

    assert rows == pytest.approx(row_logits.softmax(dim=2).numpy(), abs=1e-5)
    assert wall == pytest.approx(wall_logits.sigmoid().numpy(), abs=1e-5)


def test_a_batch_has_the_truth_of_its_scenes_in_rows_of_the_reduced_frame():
    batch = wall_network_training.scene_batch(SMALL_STUDY, 2)
    scene = draw_scene(SMALL_STUDY.scenes, 2 * FINDER.batch_size + 5)
    middle = FINDER.columns // 4
    nearest = round((middle + 0.5) * scene.frame.shape[1] / (FINDER.columns // 2) - 0.5)
    expected = (scene.inner_row[nearest] + 0.5) * FINDER.rows / len(scene.frame) - 0.5
    assert batch.boundaries[5, 1, middle] == pytest.approx(expected, abs=1e-4)
    assert batch.weight[5, middle] == scene.judged[nearest]
    assert FINDER.batches * FINDER.batch_size < wall_network_training.VALIDATION_SCENES


def loss_of(
    found_row: float, wall: list[float], true_row: float, judged: list[bool]
) -> float:
    """The loss of both boundaries found about a row, in four columns."""
    row = torch.arange(FINDER.rows, dtype=torch.float32)
    logits = -((row - found_row) ** 2) / (2 * FINDER.target_rows**2)
    return wall_network_training.finder_loss(
        logits[None, None, :, None].expand(1, 2, -1, 4),
        torch.tensor([wall]),
        torch.full((1, 2, 4), true_row),
        torch.tensor([judged]),
        FINDER.target_rows,
    ).item()


def test_the_loss_grows_with_the_distance_and_counts_visible_columns_only():
    sure = [9.0] * 4
    all_judged = [True] * 4
    losses = [loss_of(row, sure, 10.0, all_judged) for row in (10.0, 11.0, 14.0, 20.0)]
    assert losses == sorted(losses)
    assert len(set(losses)) == 4
    nowhere = float("nan")
    assert loss_of(10.0, [-5.0] * 4, nowhere, all_judged) < 0.01
    assert loss_of(10.0, [5.0] * 4, nowhere, all_judged) > 4.9
    half = [True, True, False, False]
    assert loss_of(10.0, [-5.0, -5.0, 50.0, -50.0], nowhere, half) < 0.01


def test_dice_of_a_scene_leaves_out_what_nobody_can_see():
    scene = draw_scene(SMALL_STUDY.scenes, 0)
    half = np.arange(scene.frame.shape[1]) < scene.frame.shape[1] // 2
    found = (scene.mask > 0) & half
    for judged, expected in ((half, 1.0), (~half, 0.0)):
        seen = replace(scene, judged=judged)
        assert wall_network_training.scene_dice(found, seen) == expected
