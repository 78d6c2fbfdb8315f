"""The classifier: descent, mirroring, ONNX, the grid search, and its model folder."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from scleraforce.base.errors import ModelError, SolverError
from scleraforce.front.cli.main import run
from scleraforce.lab.training import classifier_training
from scleraforce.lab.training.gradient_descent import learning_rate, train_in_rounds
from scleraforce.lab.training.slice_dataset import (
    Dataset,
    generate_dataset,
    open_dataset,
)
from scleraforce.lab.training.trained_models import train_classifier
from scleraforce.library import Library
from scleraforce.reading.load_model import load_reader
from scleraforce.records.study import (
    DatasetGroup,
    DatasetStudy,
    NetworkStudy,
    SliceStudy,
    Study,
    study_hash,
)

SIZE = SliceStudy(columns=10, rows=12)


@pytest.mark.slow
def test_a_network_that_learned_with_mirroring_reads_slices_that_only_the_mirror_shows(
    small,
):
    rng = np.random.default_rng(0)
    slices = np.zeros((300, 12, 10), dtype=np.uint8)
    target = rng.integers(0, 3, size=300)
    slices[np.arange(300), target * 4, :4] = 255 * rng.integers(0, 2, size=(300, 4))
    slices[np.arange(300), target * 4, 4] = 255
    left = classifier_training.Samples(slices, target)
    right = classifier_training.Samples(slices[:, :, ::-1].copy(), target)
    studies = (replace(small, mirror=mirror, epochs=8) for mirror in (True, False))
    mirrored, plain = (
        classifier_training.fit_classifier(study, left, right) for study in studies
    )
    assert mirrored.curves.validation_accuracy[-1] > 0.99
    assert plain.curves.validation_accuracy[-1] < 0.7
    # what it is validated on teaches nothing
    other = replace(small, mirror=False, epochs=8)
    again = classifier_training.fit_classifier(other, left, left)
    assert again.curves.validation_accuracy[-1] > 0.99
    np.testing.assert_equal(again.weights, plain.weights)


@pytest.mark.parametrize("limit", [1e6, 0.05], ids=["free", "clipped"])
def test_steps_of_a_descent_are_momentum_on_gradients_of_at_most_the_largest_norm(
    limit: float,
):
    """The loss of a line, w x + b, is w x: its gradient is the mean input, whatever the
    weights are.
    """
    inputs = torch.tensor([[3.0, 4.0]], dtype=torch.float64)
    network = torch.nn.Linear(2, 1, bias=False).double()
    optimiser = torch.optim.SGD(network.parameters(), lr=1.0, momentum=0.5)
    study = NetworkStudy(learning_rate=0.2, warmup=0.0, max_gradient_norm=limit)
    before = network.weight.detach().clone()
    # of one batch each, computed lazily
    rounds = ([(network(inputs).mean(), 1)] for _ in range(2))
    first, second = train_in_rounds(network, optimiser, rounds, study, 4)
    push = inputs * min(1.0, limit / 5.0)
    rates = [learning_rate(study, step, 4) for step in (0, 1)]
    assert first == pytest.approx(float(before @ inputs.T))
    assert second == pytest.approx(
        float((before - rates[0] * push) @ inputs.T), rel=1e-4
    )
    expected = before - rates[0] * push - rates[1] * 1.5 * push
    np.testing.assert_allclose(network.weight.detach(), expected, atol=1e-5)


@pytest.mark.parametrize("hidden", [(), (300, 200)])
def test_the_file_answers_as_the_rounded_network_at_half_the_size(hidden):
    rng = np.random.default_rng(1)
    slices = 255 * rng.integers(0, 2, (300, 12, 10), dtype=np.uint8)
    slices[:, -1] = 0  # a row that never varies
    samples = classifier_training.Samples(slices, np.zeros(300, dtype=int))
    mean, varies = classifier_training.normalisation(samples)
    torch.manual_seed(3)
    built = classifier_training.build_network(
        int(varies.sum()), NetworkStudy(hidden=hidden), 3
    ).eval()
    network = classifier_training.trained_network(built, mean, varies)
    centred = samples.pixels[:, varies] / np.float32(255) - mean[varies]
    by_torch = torch.softmax(built(torch.from_numpy(centred)), dim=1).detach().numpy()
    np.testing.assert_allclose(network.probabilities(slices), by_torch, atol=1e-5)
    rounded = classifier_training.with_half_weights(network)
    content = classifier_training.classifier_bytes(rounded, SIZE, {"seed": "7"})
    (found,) = onnxruntime.InferenceSession(content).run(None, {"slices": slices})
    np.testing.assert_allclose(found, rounded.probabilities(slices), atol=1e-5)
    assert not hidden or len(content) < 0.55 * sum(
        weight.nbytes for weight in rounded.weights
    )
    assert np.abs(found - by_torch).max() < 1e-3
    np.testing.assert_equal(rounded.biases, network.biases)

    for weight, before in zip(rounded.weights, network.weights, strict=True):
        assert 0.0 < np.abs(weight - before).max() < 1e-3 * np.abs(before).max()


STUDY = Study(
    dataset=DatasetStudy(
        contacts=20, group=(DatasetGroup(images=600, thickness_m=6e-4),)
    ),
    network=NetworkStudy(
        hidden=(16, 12),
        dropout=0.2,
        learning_rate=0.05,
        batch_size=16,
        epochs=6,
        search_widths=(4, 16),
        search_depths=(1,),
    ),
)
MODULUS_PA = 0.31e6  # as a calibration would give it: not the study's


@pytest.fixture(scope="module")
def dataset(library: Library, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    path = tmp_path_factory.mktemp("data") / "slices.zarr"
    generate_dataset(STUDY, path, youngs_modulus_pa=MODULUS_PA, library=library)
    return open_dataset(path)


@pytest.fixture(scope="module")
def model(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("trained") / "model"
    ticks = list[int]()
    train_classifier(dataset, path, progress=ticks.append)
    assert len(ticks) == 6
    return path


def test_the_reader_takes_the_folder_and_knows_its_modulus_data_study_and_accuracy(
    dataset, model
):
    reader = load_reader(model)
    _, validation = dataset.split()
    found = reader.probabilities(dataset.slices[validation]).argmax(axis=1)
    right = (found == dataset.target[validation]).mean()
    assert right > 0.8
    assert right == reader.record["metrics"]["validation_accuracy"]
    curves = reader.record["curves"]
    assert curves["validation_accuracy"][-1] == right
    assert curves["validation_loss"][-1] < 0.6 * curves["validation_loss"][0]
    assert reader.study == replace(
        STUDY, eye=replace(STUDY.eye, youngs_modulus_pa=MODULUS_PA)
    )
    made = {"torch": torch.__version__, "study_sha256": study_hash(reader.study)}
    assert made.items() <= reader.provenance.items()


@pytest.mark.parametrize("threads", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_equal_seeds_give_equal_weights_and_leave_pytorch_unchanged(
    dataset,
    tmp_path,
    monkeypatch,
    threads: int,
):
    monkeypatch.setattr(classifier_training, "CLASSIFIER_THREADS", threads)
    before = torch.get_rng_state()
    folders = [tmp_path / "model", tmp_path / "again"]
    for folder in folders:
        train_classifier(dataset, folder)

    first, again = ((folder / "model.onnx").read_bytes() for folder in folders)
    assert first == again
    assert torch.equal(torch.get_rng_state(), before)
    assert not torch.are_deterministic_algorithms_enabled()


def test_a_descent_that_diverges_says_so(dataset, tmp_path, monkeypatch):
    lost = torch.nn.functional.cross_entropy
    monkeypatch.setattr(
        torch.nn.functional,
        "cross_entropy",
        lambda *given, **more: lost(*given, **more) * torch.nan,
    )

    with pytest.raises(SolverError, match=r"step 1 of .*network\.learning_rate"):
        train_classifier(dataset, tmp_path / "model")


def test_ctrl_c_leaves_nothing_behind_and_an_existing_model_is_refused_before_any_training(
    dataset, tmp_path
):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_classifier(dataset, tmp_path / "model", progress=interrupt)

    assert not list(tmp_path.iterdir())
    (tmp_path / "model").mkdir()
    with pytest.raises(ModelError, match="exists already"):
        train_classifier(dataset, tmp_path / "model", progress=interrupt)


def test_the_command_searches_takes_the_best_and_shows_the_table_within_80_columns(
    dataset, tmp_path, capsys
):
    folder = tmp_path / "model"
    assert run(["train", str(dataset.path), "--out", str(folder), "--search"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["4", "16"]
    assert sum(line.endswith("<") for line in lines) == 1
    assert max(map(len, lines[:3])) <= 80
    reader = load_reader(folder)
    tried = reader.record["search"]
    assert [entry["hidden"] for entry in tried] == [[4], [16]]
    best = max(tried, key=lambda entry: entry["validation_accuracy"])
    assert list(reader.study.network.hidden) == best["hidden"]


@pytest.mark.slow
def test_without_pytorch_there_is_one_clear_line(dataset, tmp_path):
    block = (
        "import sys; sys.modules['torch'] = None; from scleraforce.front.cli.main import"
        " main; main()"
    )
    arguments = ["train", str(dataset.path), "--out", str(tmp_path / "model")]
    done = subprocess.run(
        [sys.executable, "-c", block, *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    said = (
        "error: training needs torch, which is not installed: pip install"
        " 'scleraforce[train]'"
    )
    assert (done.returncode, done.stderr.strip()) == (2, said)


def test_labels_for_another_modulus_make_another_model(dataset, tmp_path):
    factor = 1.2
    train_classifier(dataset, tmp_path / "model", youngs_modulus_pa=factor * MODULUS_PA)
    reader = load_reader(tmp_path / "model")
    assert reader.study.eye.youngs_modulus_pa == factor * MODULUS_PA
    _, validation = dataset.split()
    scaled = [
        STUDY.classes.classify(factor * force_n)
        for force_n in dataset.force_n[validation].tolist()
    ]
    counts = np.bincount(scaled, minlength=3).tolist()
    found = np.sum(reader.record["metrics"]["validation_confusion"], axis=1)
    assert found.tolist() == counts
    assert counts != np.bincount(dataset.target[validation], minlength=3).tolist()
