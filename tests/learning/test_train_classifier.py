"""From a data set to a model folder that the reader takes: whole, repeatable, or not there at all."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from scleraforce.cli.main import run
from scleraforce.errors import ModelError
from scleraforce.learning.classifier import TrainedNetwork
from scleraforce.learning.dataset import (
    complete_dataset,
    create_dataset,
    open_dataset,
    plan_dataset,
    write_dataset_unit,
)
from scleraforce.learning.train import split_samples, train_classifier
from scleraforce.reader import load_model
from scleraforce.study import DatasetGroup, DatasetStudy, NetworkStudy, SliceStudy, Study, study_hash

STUDY = Study(
    slice=SliceStudy(columns=10, rows=8),
    dataset=DatasetStudy(contacts=20, group=(DatasetGroup(images=400),)),
    network=NetworkStudy(
        hidden=(16, 12),
        dropout=0.2,
        learning_rate=0.1,
        batch_size=16,
        epochs=6,
        search_widths=(4, 16),
        search_depths=(1,),
    ),
)
MODULUS_PA = 0.31e6  # as a calibration would give it: not the study's


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> Path:
    """A complete data set whose wall lies deeper the larger the force is."""
    path = tmp_path_factory.mktemp("data") / "bars.zarr"
    plan = plan_dataset(STUDY)
    create_dataset(path, STUDY, MODULUS_PA, None, plan)
    top = plan.force_n / 10e-3
    row = np.arange(8)[:, None]
    bars = np.broadcast_to((row >= top[:, None, None]) & (row < top[:, None, None] + 2), (plan.images, 8, 10))
    for unit in range(plan.units):
        write_dataset_unit(path, plan, STUDY, unit, bars[plan.unit(unit)].astype(np.uint8) * np.uint8(255))
    complete_dataset(path, plan, STUDY)
    return path


def test_the_reader_takes_the_folder_and_reaches_the_stated_accuracy(store: Path, tmp_path: Path) -> None:
    dataset = open_dataset(store)
    ticks: list[int] = []
    trained = train_classifier(dataset, tmp_path / "model", progress=ticks.append)
    assert len(ticks) == 6
    reader = load_model(tmp_path / "model")
    _, validation = split_samples(dataset, dataset.youngs_modulus_pa)
    right = reader.probabilities(validation.slices).argmax(axis=1) == validation.target
    assert right.mean() == trained.validation_accuracy == reader.record["metrics"]["validation_accuracy"]
    assert trained.validation_accuracy > 0.8
    assert reader.record["curves"]["validation_loss"] == list(trained.curves.validation_loss)
    assert {"slices", "training loss"} <= set(reader.record["fingerprint"])


def test_weights_are_rounded_before_they_are_measured_and_stored(store: Path, tmp_path: Path, monkeypatch) -> None:
    dataset = open_dataset(store)
    train_classifier(dataset, tmp_path / "model")
    held = onnx.load_model(tmp_path / "model" / "model.onnx").graph.initializer
    assert {len(tensor.dims) for tensor in held if tensor.data_type == onnx.TensorProto.FLOAT16} == {2}
    assert {len(tensor.dims) for tensor in held if tensor.data_type == onnx.TensorProto.FLOAT} == {1}

    def to_nothing(network: TrainedNetwork) -> TrainedNetwork:
        return replace(network, layers=tuple(replace(layer, weight=0.0 * layer.weight) for layer in network.layers))

    monkeypatch.setattr("scleraforce.learning.train.with_half_weights", to_nothing)
    train_classifier(dataset, tmp_path / "nothing")
    rows = load_model(tmp_path / "nothing").record["metrics"]["validation_confusion"]
    assert np.count_nonzero(np.sum(rows, axis=0)) == 1  # it answers always the same


def test_the_model_knows_the_modulus_data_and_study_that_it_was_made_from(store: Path, tmp_path: Path) -> None:
    train_classifier(open_dataset(store), tmp_path / "model")
    reader = load_model(tmp_path / "model")
    assert reader.study == replace(STUDY, eye=replace(STUDY.eye, youngs_modulus_pa=MODULUS_PA))
    assert reader.provenance["study_sha256"] == study_hash(reader.study)
    assert reader.provenance["youngs_modulus_mpa"] == "0.31"
    assert reader.provenance["class_bounds_mn"] == "5, 30"
    assert reader.provenance["torch"] == torch.__version__
    assert "0.31 MPa" in (tmp_path / "model/card.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_two_trainings_write_the_same_bytes(store: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        train_classifier(open_dataset(store), tmp_path / name)
    for file in ("model.onnx", "study.toml", "card.md", "model.json"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


@pytest.mark.parametrize("moment", ["while training", "while writing"])
def test_ctrl_c_leaves_nothing_behind(store: Path, tmp_path: Path, monkeypatch, moment: str) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if moment == "while writing":
        written: list[Path] = []
        write = Path.write_bytes

        def second_fails(path: Path, content: bytes) -> int:
            written.append(path)
            if len(written) == 2:
                interrupt()
            return write(path, content)

        monkeypatch.setattr(Path, "write_bytes", second_fails)
    with pytest.raises(KeyboardInterrupt):
        train_classifier(
            open_dataset(store), tmp_path / "model", progress=interrupt if moment == "while training" else None
        )
    assert not list(tmp_path.iterdir())


def test_an_existing_model_is_kept_and_refused_before_any_training(store: Path, tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    ticks: list[int] = []
    with pytest.raises(ModelError, match="exists already"):
        train_classifier(open_dataset(store), tmp_path / "model", progress=ticks.append)
    assert not ticks


def test_the_command_prints_its_json(store: Path, tmp_path: Path, capsys) -> None:
    assert run(["train", str(store), "--out", str(tmp_path / "model"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["epochs"] == 6
    assert result["validation_accuracy"] == load_model(tmp_path / "model").record["metrics"]["validation_accuracy"]
    assert result["seconds"] > 0


def test_the_command_searches_and_shows_the_table_within_80_columns(store: Path, tmp_path: Path, capsys) -> None:
    assert run(["train", str(store), "--out", str(tmp_path / "model"), "--search"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["4", "16"]
    assert sum(line.endswith("<") for line in lines) == 1
    assert max(map(len, lines[:3])) <= 80
    reader = load_model(tmp_path / "model")
    assert [entry["hidden"] for entry in reader.record["search"]] == [[4], [16]]
    assert reader.study.network.hidden in ((4,), (16,))


@pytest.mark.slow
def test_without_pytorch_there_is_one_clear_line(store: Path, tmp_path: Path) -> None:
    block = "import sys; sys.modules['torch'] = None; from scleraforce.cli.main import main; main()"
    arguments = ["train", str(store), "--out", str(tmp_path / "model")]
    done = subprocess.run([sys.executable, "-c", block, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.strip() == (
        "error: training needs torch, which is not installed: pip install 'scleraforce[train]'"
    )


def test_labels_for_another_modulus_make_another_model(store: Path, tmp_path: Path) -> None:
    dataset = open_dataset(store)
    training, validation = split_samples(dataset, 1.2 * MODULUS_PA)
    scaled = np.concatenate([part.target for part in (training, validation)])
    order = np.concatenate(dataset.split())
    bounds_n = np.array(STUDY.classes.bounds_n)
    assert scaled.tolist() == np.searchsorted(bounds_n, 1.2 * dataset.force_n[order]).tolist()
    assert not np.array_equal(scaled, dataset.target[order])
    train_classifier(dataset, tmp_path / "model", youngs_modulus_pa=1.2 * MODULUS_PA)
    reader = load_model(tmp_path / "model")
    assert reader.study.eye.youngs_modulus_pa == 1.2 * MODULUS_PA
    assert (
        np.sum(reader.record["metrics"]["validation_confusion"], axis=1).tolist()
        == np.bincount(validation.target, minlength=3).tolist()
    )
