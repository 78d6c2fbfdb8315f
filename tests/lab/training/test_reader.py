"""The reader's network and training: against NumPy and brute force, repeatable, and it
learns.
"""

import json
from dataclasses import replace

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from analytic_library import solve_analytic

from scleraforce.base.errors import InputError
from scleraforce.front.cli.main import run
from scleraforce.lab.training import force_reader_training
from scleraforce.lab.training.gradient_descent import chosen_device
from scleraforce.lab.training.reader_samples import SampleSource
from scleraforce.lab.training.trained_models import train_reader
from scleraforce.library.library_store import build_library
from scleraforce.reading.force_network import ratio_edges
from scleraforce.reading.load_model import load_reader
from scleraforce.records.study import (
    Choice,
    EyeStudy,
    LibraryStudy,
    Range,
    ReaderStudy,
    Study,
    format_study,
)

TINY = Study(
    reader=ReaderStudy(
        channels=(6, 8),
        hidden=(24,),
        bins=16,
        batch_size=100,
        epochs=3,
        samples_per_epoch=2000,
        validation_samples=500,
        interval_eyes=0,
    ),
    library=LibraryStudy(
        thicknesses=4,
        tension=Range(min=1e-3, max=0.21),
        tensions=4,
        tips=16,
        elements=40,
    ),
)


@pytest.fixture(scope="module")
def source(library) -> SampleSource:
    return SampleSource(library, TINY.reader, TINY.slice)


def tiny_network(seed: int = 1) -> force_reader_training.ReaderNetwork:
    torch.manual_seed(seed)
    return force_reader_training.ReaderNetwork(TINY.reader, TINY.slice, 12e-3).eval()


def test_the_loss_is_likelihood_and_place_written_out():
    rng = np.random.default_rng(2)
    mixtures = rng.normal(size=(5, 9))
    places = rng.normal(size=5)
    forces = rng.uniform(0.0, 1.0, 5)
    truth = rng.normal(size=5)
    expected = []

    for row, place, force, true in zip(mixtures, places, forces, truth, strict=True):
        weights = np.exp(row[:3]) / np.exp(row[:3]).sum()
        z = (force - row[3:6]) / np.exp(np.clip(row[6:], -6.0, 1.0))
        density = (
            weights
            / np.exp(np.clip(row[6:], -6.0, 1.0))
            / (4.0 * np.cosh(z / 2.0) ** 2)
        ).sum()
        off = abs(place - true)
        expected.append(
            -np.log(density) + 2.0 * (0.5 * off**2 if off < 0.2 else 0.2 * (off - 0.1))
        )

    found = force_reader_training.reader_loss(
        *(torch.tensor(values) for values in (mixtures, places, forces, truth))
    )
    assert abs(float(found) - np.mean(expected)) < 1e-6


def test_the_histogram_is_the_mixture_s_density_summed_up():
    mixture = torch.tensor(
        [[0.3, -0.2, 0.5, 0.2, 0.5, 0.9, -3.0, -2.0, -4.0]], dtype=torch.float64
    )
    found = force_reader_training.histogram(mixture, 16).numpy()[0]
    fine = np.linspace(0.0, 1.0, 16 * 400, endpoint=False) + 0.5 / (16 * 400)
    density = torch.exp(
        force_reader_training.log_density(
            mixture.repeat(len(fine), 1), torch.from_numpy(fine)
        )
    ).numpy()
    summed = density.reshape(16, 400).mean(axis=1) / 16
    np.testing.assert_allclose(found[1:-1], summed[1:-1], atol=1e-5)
    assert abs(found.sum() - 1.0) < 1e-6
    assert found[-1] > summed[-1]  # has all that lies beyond


def test_onnx_runtime_answers_as_pytorch_does(source):
    samples = source.chunk(5, 200)
    net = tiny_network()

    with torch.inference_mode():
        wall = torch.from_numpy((samples.slices > 0).astype(np.float32))
        mixtures, place_mm = net(wall, torch.from_numpy(samples.given))
        expected = force_reader_training.histogram(mixtures, TINY.reader.bins).numpy()

    content = force_reader_training.force_bytes(net, {"seed": "7"})
    session = onnxruntime.InferenceSession(content)
    found, contact_m = session.run(
        ["histogram", "contact_m"], {"slices": samples.slices, "given": samples.given}
    )
    np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(contact_m, 1e-3 * place_mm.numpy(), atol=1e-8)
    assert np.ptp(expected, axis=0).max() > 1e-3, (
        "a network that answers always the same proves nothing"
    )
    assert content == force_reader_training.force_bytes(net, {"seed": "7"})
    assert [entry.value for entry in onnx.load_from_string(content).metadata_props] == [
        "7"
    ]


@pytest.mark.slow
def test_training_learns_and_is_the_same_with_any_number_of_processes(source):
    first, second = (
        force_reader_training.fit_reader(TINY, source.chunk, workers)
        for workers in (1, 2)
    )
    assert first.training_loss == second.training_loss
    assert all(
        map(torch.equal, first.network.parameters(), second.network.parameters())
    )
    assert first.training_loss[-1] < first.training_loss[0] - 0.3
    samples = source.chunk(9, 500)
    untrained = force_reader_training.reader_metrics(
        force_reader_training.network_outputs(tiny_network(), samples), samples, TINY
    )
    assert (
        force_reader_training.measure_reader(first.network, source, TINY)["mae_mn"]
        < 0.6 * untrained["mae_mn"]
    )


@pytest.mark.parametrize(
    ("lateral_m", "drawn"),
    [
        (Range(min=-1e-3, max=1e-3), [0, 1]),
        (Range(min=0.0, max=1e-3), [0, 1, 2]),
        (Choice((-1e-3, 0.5e-3, 1e-3)), [0, 1, 2]),
    ],
)
def test_mirror_images_are_learned_from_where_left_and_right_are_drawn_alike(
    source, lateral_m, drawn
):
    samples = source.chunk(1, 40)
    asked = list[int]()
    study = replace(TINY, reader=replace(TINY.reader, lateral_m=lateral_m))
    fitted = force_reader_training.fit_reader(
        study, lambda number: asked.append(number) or samples, 0
    )
    assert asked == drawn
    assert len(set(fitted.training_loss)) == 3


def test_metrics_are_counted_as_by_hand(source):
    samples = source.chunk(3, 100)
    outputs = force_reader_training.network_outputs(tiny_network(), samples)
    metrics = force_reader_training.reader_metrics(outputs, samples, TINY)
    mixtures, places_mm = (torch.cat(values) for values in zip(*outputs, strict=True))
    edges = ratio_edges(TINY.reader.bins, TINY.reader.max_force_ratio)
    below = [
        np.append(0.0, shares).cumsum()
        for shares in force_reader_training.histogram(mixtures, 16).double().numpy()
    ]
    of_eyes = zip(below, samples.modulus_pa, strict=True)
    low, median, high = np.array(
        [pa * np.interp((0.05, 0.5, 0.95), shares, edges) for shares, pa in of_eyes]
    ).T
    inside = sum(
        a <= f <= b for a, f, b in zip(low, samples.force_n, high, strict=True)
    )
    assert metrics["coverage"] == inside / 100
    assert metrics["mae_mn"] == pytest.approx(
        1e3 * np.mean(np.abs(median - samples.force_n))
    )
    assert metrics["lateral_mae_mm"] == pytest.approx(
        np.mean(np.abs(places_mm.numpy() - 1e3 * samples.lateral_m))
    )
    assert sum(map(sum, metrics["validation_confusion"])) == 100


def test_the_runtime_takes_the_folder_and_gives_the_network_s_answers(
    library, tmp_path
):
    study = replace(TINY, reader=replace(TINY.reader, epochs=1))
    record = train_reader(library, study, tmp_path / "model", workers=1)
    model = load_reader(tmp_path / "model")
    assert (model.kind, model.study) == ("reader", study)
    assert model.record["metrics"] == json.loads(json.dumps(record["metrics"]))
    assert model.record["samples"] == {"training": 2000, "validation": 500}
    with np.load(tmp_path / "model/library.npz") as stored:
        assert model.record["library"] == {
            "curves_m": float(stored["curves_error_m"]),
            "stiffness": float(stored["stiffness_error"]),
        }


@pytest.mark.slow
def test_the_command_trains_a_reader_and_prints_its_json(tmp_path, capsys):
    library = tmp_path / "library.zarr"
    build_library(TINY, library, workers=1, solve=solve_analytic)
    study = tmp_path / "study.toml"
    one_epoch = replace(TINY, reader=replace(TINY.reader, epochs=1))
    study.write_text(format_study(one_epoch))
    model = tmp_path / "model"
    options = ["--kind", "reader", "--study", study, "--out", model, "--json"]
    assert run(["train", str(library), *map(str, options)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["kind"], result["epochs"]) == ("reader", 1)
    assert result["mae_mn"] == load_reader(model).record["metrics"]["mae_mn"]
    assert min(result[key] for key in ("validation_accuracy", "coverage")) > 0.0


def test_a_reader_is_not_trained_on_a_library_of_another_eye(library, tmp_path):
    other = replace(TINY, eye=EyeStudy(radius_m=11e-3))
    with pytest.raises(InputError, match=r"radius 0\.012, the study has 0\.011"):
        train_reader(library, other, tmp_path / "model")

    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "said"), [([], "library"), (["--search"], "--search")]
)
def test_a_reader_is_neither_trained_on_slices_nor_searched_for(
    tmp_path, capsys, options, said
):
    (tmp_path / "data.zarr").mkdir()
    out = ["--out", str(tmp_path / "model"), "--kind", "reader"]
    assert run(["train", str(tmp_path / "data.zarr"), *out, *options]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_training_ends_with_intervals_that_are_measured(library, tmp_path):
    study = replace(TINY, reader=replace(TINY.reader, epochs=1, interval_eyes=3))
    counted: list[int] = []
    train_reader(library, study, tmp_path / "model", workers=2, measured=counted.append)
    model = load_reader(tmp_path / "model")
    intervals = model.record["intervals"]
    assert counted == [1, 1, 1]
    assert 1 <= intervals["eyes"] <= 3
    assert set(intervals["network"]) == {"own E", "other E"}
    assert model.factors.network == intervals["network"]
    assert model.factors.fit == intervals["fit"]
    assert "measured on" in (tmp_path / "model" / "card.md").read_text()
    train_reader(library, study, tmp_path / "again", workers=1)
    assert load_reader(tmp_path / "again").record["intervals"] == intervals


@pytest.mark.parametrize("found", [False, True])
def test_a_gpu_is_taken_if_it_is_there_and_refused_if_it_is_not(
    found: bool, monkeypatch
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: found)
    assert chosen_device("cpu") == "cpu"
    assert chosen_device("auto") == ("cuda" if found else "cpu")
    for name in ("gpu",) if found else ("gpu", "cuda"):
        with pytest.raises(InputError, match=r"^device: "):
            chosen_device(name)

    assert not found or chosen_device("cuda") == "cuda"
