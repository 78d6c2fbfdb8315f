"""The classifier: descent, mirroring, ONNX, the grid search, and its model folder."""

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from scleraforce.base.errors import ModelError, SolverError
from scleraforce.front.cli.main import run
from scleraforce.lab.training import classifier_training
from scleraforce.lab.training.gradient_descent import learning_rate, train_in_rounds
from scleraforce.lab.training.slice_dataset import (
    SLICES,
    create_dataset,
    open_dataset,
    plan_dataset,
    unit_samples,
)
from scleraforce.lab.training.trained_models import split_samples, train_classifier
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


def test_a_network_that_learned_with_mirroring_reads_slices_that_only_the_mirror_shows(
    small,
) -> None:
    rng = np.random.default_rng(0)
    slices = np.zeros((300, 12, 10), dtype=np.uint8)
    target = rng.integers(0, 3, size=300)
    slices[np.arange(300), target * 4, :4] = 255 * rng.integers(0, 2, size=(300, 4))
    slices[np.arange(300), target * 4, 4] = 255
    left = classifier_training.Samples(slices, target)
    right = classifier_training.Samples(slices[:, :, ::-1].copy(), target)
    studies = (replace(small, mirror=mirror, epochs=8) for mirror in (True, False))
    mirrored, plain = (
        classifier_training.fit_classifier(
            study, left, right
        ).curves.validation_accuracy[-1]
        for study in studies
    )
    assert mirrored > 0.99
    assert plain < 0.7


@pytest.mark.parametrize("limit", [1e6, 0.05], ids=["free", "clipped"])
def test_steps_of_a_descent_are_momentum_on_gradients_of_at_most_the_largest_norm(
    limit: float,
) -> None:
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


@pytest.mark.parametrize("threads", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_equal_seeds_and_training_samples_give_equal_weights_and_leave_pytorch_unchanged(
    bars, small, monkeypatch, threads: int
) -> None:
    monkeypatch.setattr(
        "scleraforce.lab.training.classifier_training.CLASSIFIER_THREADS", threads
    )
    torch.set_num_threads(1)
    before = torch.get_rng_state()
    training, validation = bars
    flipped = classifier_training.Samples(validation.slices, 2 - validation.target)
    first, again, unseen = (
        classifier_training.fit_classifier(small, training, other)
        for other in (validation, validation, flipped)
    )
    other = classifier_training.fit_classifier(replace(small, seed=1), *bars)
    assert first.curves == again.curves
    assert first.curves.validation_accuracy != unseen.curves.validation_accuracy

    for same in (again, unseen):
        np.testing.assert_equal(
            asdict(first), asdict(replace(same, curves=first.curves))
        )

    assert not any(map(np.array_equal, first.weights, other.weights))
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.get_num_threads() == 1
    assert not torch.are_deterministic_algorithms_enabled()


def test_it_learns_and_reports_the_figures_of_the_returned_network(bars, small) -> None:
    fitted = classifier_training.fit_classifier(replace(small, epochs=12), *bars)
    _, validation = bars
    curves = fitted.curves
    first = fitted.weights[0].reshape(-1, 12, 10)
    assert len(curves.training_loss) == len(curves.validation_accuracy) == 12
    assert curves.validation_accuracy[-1] > 0.97
    assert 0.8 < curves.training_accuracy[-1] <= 1.0  # during training, with dropout
    assert curves.validation_loss[-1] < 0.3 * curves.validation_loss[0]
    shares = fitted.probabilities(validation.slices)
    assert (
        curves.validation_accuracy[-1]
        == (shares.argmax(axis=1) == validation.target).mean()
    )
    loss = -np.log(shares[np.arange(len(validation)), validation.target]).mean()
    assert curves.validation_loss[-1] == pytest.approx(loss, abs=1e-6)
    assert not first[:, -1].any()  # a row that never varies
    assert first[:, :-1].any(axis=0).all()


def test_a_descent_that_diverges_says_so(bars, small, monkeypatch) -> None:
    lost = torch.nn.functional.cross_entropy
    monkeypatch.setattr(
        torch.nn.functional,
        "cross_entropy",
        lambda *given, **more: lost(*given, **more) * torch.nan,
    )

    with pytest.raises(SolverError, match=r"step 1 of .*network\.learning_rate"):
        classifier_training.fit_classifier(small, *bars)


@pytest.mark.parametrize("hidden", [(), (300, 200)])
def test_the_file_is_repeatable_and_answers_as_the_rounded_network_at_half_the_size(
    bars, hidden
) -> None:
    mean, varies = classifier_training.normalisation(bars[0])
    torch.manual_seed(3)
    built = classifier_training.build_network(
        int(varies.sum()), NetworkStudy(hidden=hidden), 3
    ).eval()
    network = classifier_training.trained_network(built, mean, varies)
    centred = torch.from_numpy(
        bars[1].pixels[:, varies] / np.float32(255) - mean[varies]
    )
    by_torch = torch.softmax(built(centred), dim=1).detach().numpy()
    np.testing.assert_allclose(
        network.probabilities(bars[1].slices), by_torch, atol=1e-5
    )
    rounded = classifier_training.with_half_weights(network)
    slices = bars[1].slices
    content = classifier_training.classifier_bytes(
        rounded, SIZE, {"seed": "7", "dataset_sha256": "ab"}
    )
    assert content == classifier_training.classifier_bytes(
        rounded, SIZE, {"dataset_sha256": "ab", "seed": "7"}
    )
    (found,) = onnxruntime.InferenceSession(content).run(None, {"slices": slices})
    np.testing.assert_allclose(found, rounded.probabilities(slices), atol=1e-5)
    assert not hidden or len(content) < 0.55 * sum(
        weight.nbytes for weight in rounded.weights
    )
    model = onnx.load_from_string(content)
    assert {entry.key: entry.value for entry in model.metadata_props} == {
        "seed": "7",
        "dataset_sha256": "ab",
    }
    kinds = [
        tensor.data_type for tensor in model.graph.initializer if len(tensor.dims) == 2
    ]
    assert kinds == [onnx.TensorProto.FLOAT16] * (len(hidden) + 1)
    assert (
        np.abs(rounded.probabilities(slices) - network.probabilities(slices)).max()
        < 1e-3
    )
    np.testing.assert_equal(rounded.biases, network.biases)

    for weight, before in zip(rounded.weights, network.weights, strict=True):
        assert 0.0 < np.abs(weight - before).max() < 1e-3 * np.abs(before).max()


def test_the_best_candidate_is_the_most_accurate_and_of_equals_the_smallest() -> None:
    tried = tuple(
        classifier_training.Candidate(
            hidden=(9,),
            weights=weights,
            validation_accuracy=accuracy,
            validation_loss=0.1,
        )
        for weights, accuracy in ((500, 0.97), (300, 0.99), (200, 0.99), (100, None))
    )
    assert classifier_training.best_candidate(tried) == 2

    with pytest.raises(SolverError, match="every size"):
        classifier_training.best_candidate(tried[3:])


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
    unwritten = create_dataset(path, STUDY, MODULUS_PA, None, plan)
    top = plan.force_n / 10e-3
    row = np.arange(8)[:, None]
    bars = np.broadcast_to(
        (row >= top[:, None, None]) & (row < top[:, None, None] + 2), (len(plan), 8, 10)
    )

    for unit, samples in enumerate(unit_samples(STUDY)):
        unwritten.write(unit, {SLICES: bars[samples].astype(np.uint8) * np.uint8(255)})

    unwritten.finish()
    return path


def test_the_reader_takes_the_folder_and_knows_its_modulus_data_study_and_accuracy(
    store: Path, tmp_path: Path
) -> None:
    dataset = open_dataset(store)
    ticks = list[int]()
    record = train_classifier(dataset, tmp_path / "model", progress=ticks.append)
    assert len(ticks) == 6
    reader = load_reader(tmp_path / "model")
    _, validation = split_samples(dataset, dataset.youngs_modulus_pa)
    right = reader.probabilities(validation.slices).argmax(axis=1) == validation.target
    assert 0.8 < right.mean() == record["metrics"]["validation_accuracy"]
    assert json.loads(json.dumps(record)).items() <= reader.record.items()
    assert reader.study == replace(
        STUDY, eye=replace(STUDY.eye, youngs_modulus_pa=MODULUS_PA)
    )
    made = {
        "youngs_modulus_mpa": "0.31",
        "class_bounds_mn": "5, 30",
        "torch": torch.__version__,
    }
    assert (
        made | {"study_sha256": study_hash(reader.study)}
    ).items() <= reader.provenance.items()
    assert "`youngs_modulus_mpa` | 0.31 |" in (tmp_path / "model/card.md").read_text(
        encoding="utf-8"
    )


def test_ctrl_c_leaves_nothing_behind_and_an_existing_model_is_refused_before_any_training(
    store, tmp_path
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_classifier(open_dataset(store), tmp_path / "model", progress=interrupt)

    assert not list(tmp_path.iterdir())
    (tmp_path / "model").mkdir()
    with pytest.raises(ModelError, match="exists already"):
        train_classifier(open_dataset(store), tmp_path / "model", progress=interrupt)


def test_the_command_searches_and_shows_the_table_within_80_columns(
    store: Path, tmp_path: Path, capsys
) -> None:
    assert run(["train", str(store), "--out", str(tmp_path / "model"), "--search"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["4", "16"]
    assert sum(line.endswith("<") for line in lines) == 1
    assert max(map(len, lines[:3])) <= 80
    reader = load_reader(tmp_path / "model")
    assert [entry["hidden"] for entry in reader.record["search"]] == [[4], [16]]
    assert reader.study.network.hidden in ((4,), (16,))


@pytest.mark.slow
def test_without_pytorch_there_is_one_clear_line(store: Path, tmp_path: Path) -> None:
    block = (
        "import sys; sys.modules['torch'] = None; from scleraforce.front.cli.main import"
        " main; main()"
    )
    arguments = ["train", str(store), "--out", str(tmp_path / "model")]
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


def test_labels_for_another_modulus_make_another_model(
    store: Path, tmp_path: Path
) -> None:
    dataset = open_dataset(store)
    training, validation = split_samples(dataset, 1.2 * MODULUS_PA)
    scaled = np.concatenate([part.target for part in (training, validation)])
    order = np.concatenate(dataset.split())
    bounds_n = np.array(STUDY.classes.bounds_n)
    assert (
        scaled.tolist()
        == np.searchsorted(bounds_n, 1.2 * dataset.force_n[order]).tolist()
    )
    assert not np.array_equal(scaled, dataset.target[order])
    train_classifier(dataset, tmp_path / "model", youngs_modulus_pa=1.2 * MODULUS_PA)
    reader = load_reader(tmp_path / "model")
    assert reader.study.eye.youngs_modulus_pa == 1.2 * MODULUS_PA
    of_classes = np.sum(reader.record["metrics"]["validation_confusion"], axis=1)
    assert of_classes.tolist() == np.bincount(validation.target, minlength=3).tolist()
