"""The classifier: its steps against NumPy, repeatable, it learns; the model answers as the network; the grid search."""

from dataclasses import replace

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from scleraforce.errors import SolverError
from scleraforce.learning.classifier import (
    Candidate,
    Layer,
    Samples,
    TrainedNetwork,
    best,
    build_network,
    classifier_bytes,
    content_hash,
    cross_entropy,
    fit,
    grid,
    linear_layers,
    mirrored_pixels,
    normalisation,
    search_sizes,
    trained_network,
    weights,
    with_half_weights,
)
from scleraforce.learning.descent import descend, learning_rate
from scleraforce.study import NetworkStudy, SliceStudy

SIZE = SliceStudy(columns=10, rows=12)


def numpy_loss_and_gradient(layers: list[Layer], inputs: np.ndarray, target: np.ndarray):
    """Mean cross-entropy and its gradient by the chain rule, written out."""
    signals = [inputs]
    for layer in layers[:-1]:
        signals.append(np.maximum(signals[-1] @ layer.weight.T + layer.bias, 0.0))
    logits = signals[-1] @ layers[-1].weight.T + layers[-1].bias
    shares = np.exp(logits - logits.max(axis=1, keepdims=True))
    shares /= shares.sum(axis=1, keepdims=True)
    loss = -np.log(shares[np.arange(len(target)), target]).mean()
    slope = shares.copy()
    slope[np.arange(len(target)), target] -= 1.0
    slope /= len(target)
    gradient = []
    for layer, signal in zip(reversed(layers), reversed(signals), strict=True):
        gradient.insert(0, Layer(slope.T @ signal, slope.sum(axis=0)))
        slope = (slope @ layer.weight) * (signal > 0.0)
    return loss, gradient


def arrays(network) -> list[Layer]:
    return [Layer(x.weight.detach().numpy().copy(), x.bias.detach().numpy().copy()) for x in linear_layers(network)]


def step(network, optimiser, inputs, target, limit: float, masks: int = 1) -> float:
    """One step of the descent, at the optimiser's own rate."""
    rate = optimiser.param_groups[0]["lr"]
    study = NetworkStudy(learning_rate=max(rate, 1e-8), warmup=0.0, max_gradient_norm=limit)
    losses = [(cross_entropy(network, inputs, target, masks)[0], len(target))]
    (loss,) = descend(network, optimiser, [losses], study, 2, "network")
    return loss


def test_mirror_images_of_the_varying_pixels_are_the_pixels_of_the_mirrored_slices(bars) -> None:
    training, _ = bars
    lopsided = Samples(training.slices.copy(), training.target)
    lopsided.slices[:, :, :3] = 0  # three columns vary in the mirror images only
    norm = normalisation(lopsided, mirror=True)
    turned = Samples(lopsided.slices[:, :, ::-1], lopsided.target)
    across = mirrored_pixels(norm, 10)
    np.testing.assert_array_equal(lopsided.pixels[:, norm.varies][:, across], turned.pixels[:, norm.varies])
    both = Samples(np.concatenate([lopsided.slices, turned.slices]), np.concatenate([lopsided.target] * 2))
    np.testing.assert_allclose(norm.mean, normalisation(both).mean, rtol=1e-6)
    np.testing.assert_array_equal(norm.varies, normalisation(both).varies)


def test_a_network_that_learned_with_mirroring_reads_slices_that_only_the_mirror_shows(small) -> None:
    rng = np.random.default_rng(0)
    slices = np.zeros((300, 12, 10), dtype=np.uint8)
    target = rng.integers(0, 3, size=300)
    slices[np.arange(300), target * 4, :4] = 255 * rng.integers(0, 2, size=(300, 4))
    slices[np.arange(300), target * 4, 4] = 255
    left, right = Samples(slices, target), Samples(slices[:, :, ::-1].copy(), target)
    accuracy = {
        mirror: fit(replace(small, mirror=mirror, epochs=8), left, right).curves.validation_accuracy[-1]
        for mirror in (True, False)
    }
    assert accuracy[True] > 0.99
    assert accuracy[False] < 0.7


@pytest.mark.slow
def test_the_gradient_over_many_dropout_masks_comes_close_to_its_expectation() -> None:
    rng = np.random.default_rng(0)
    inputs, target = torch.from_numpy(rng.normal(size=(16, 8))).float(), torch.from_numpy(rng.integers(0, 3, size=16))
    torch.manual_seed(0)
    network = build_network(8, NetworkStudy(hidden=(10, 10), dropout=0.5), 3)
    still = torch.optim.SGD(network.parameters(), lr=0.0)

    def gradient(masks: int) -> torch.Tensor:
        step(network, still, inputs, target, 1e6, masks)
        return torch.cat([parameter.grad.flatten() for parameter in network.parameters()])

    expected = torch.stack([gradient(16) for _ in range(40)]).mean(0)
    scatter = {m: torch.stack([(gradient(m) - expected).norm() for _ in range(30)]).square().mean() for m in (1, 16)}
    assert 8 < scatter[1] / scatter[16] < 32


@pytest.mark.parametrize("limit", [1e6, 0.05], ids=["free", "clipped"])
def test_two_steps_with_momentum_equal_the_chain_rule_written_out_in_numpy(limit: float) -> None:
    slack = 1e-5 if limit < 1 else 1e-12  # clip_grad_norm_ adds 1e-6 to the norm that it divides by
    rng = np.random.default_rng(3)
    inputs, target = rng.normal(size=(20, 9)), rng.integers(0, 3, size=20)
    torch.manual_seed(0)
    network = build_network(9, NetworkStudy(hidden=(7, 5), dropout=0.0), 3).double()
    optimiser = torch.optim.SGD(network.parameters(), lr=0.2, momentum=0.9)
    layers, speed = arrays(network), None
    for _ in range(2):
        loss, gradient = numpy_loss_and_gradient(layers, inputs, target)
        length = np.sqrt(sum((g.weight**2).sum() + (g.bias**2).sum() for g in gradient))
        factor = min(1.0, limit / length)
        push = [Layer(g.weight * factor, g.bias * factor) for g in gradient]
        speed = push if speed is None else [
            Layer(0.9 * v.weight + g.weight, 0.9 * v.bias + g.bias) for v, g in zip(speed, push, strict=True)
        ]  # fmt: skip
        layers = [Layer(x.weight - 0.2 * v.weight, x.bias - 0.2 * v.bias) for x, v in zip(layers, speed, strict=True)]
        found = step(network, optimiser, torch.from_numpy(inputs), torch.from_numpy(target), limit)
        assert found == pytest.approx(loss, rel=slack)
    for mine, theirs in zip(layers, arrays(network), strict=True):
        np.testing.assert_allclose(theirs.weight, mine.weight, atol=slack)
        np.testing.assert_allclose(theirs.bias, mine.bias, atol=slack)


def test_the_first_logits_are_as_large_with_the_papers_dropout_as_without() -> None:
    torch.manual_seed(0)
    signal = torch.randn(200, 400)
    sizes = {}
    for dropout in (0.0, 0.8):
        network = build_network(400, NetworkStudy(hidden=(300, 300), dropout=dropout), 3).train()
        sizes[dropout] = network(signal).square().mean().item()
    assert 0.5 < sizes[0.8] / sizes[0.0] < 2.0


@pytest.mark.parametrize("threads", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_two_runs_with_one_seed_give_the_same_weights_and_another_seed_others(
    bars, small, monkeypatch, threads: int
) -> None:
    monkeypatch.setattr("scleraforce.learning.classifier.CLASSIFIER_THREADS", threads)
    first, again, other = (fit(study, *bars) for study in (small, small, replace(small, seed=1)))
    assert first.curves == again.curves
    for one, two, three in zip(first.network.layers, again.network.layers, other.network.layers, strict=True):
        np.testing.assert_array_equal(one.weight, two.weight)
        np.testing.assert_array_equal(one.bias, two.bias)
        assert not np.array_equal(one.weight, three.weight)


def test_training_leaves_pytorchs_global_state_as_it_was(bars, small) -> None:
    torch.set_num_threads(1)
    before = torch.get_rng_state()
    fit(replace(small, epochs=1), *bars)
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.get_num_threads() == 1
    assert not torch.are_deterministic_algorithms_enabled()


def test_it_learns(bars, small) -> None:
    curves = fit(replace(small, epochs=12), *bars).curves
    assert len(curves.training_loss) == len(curves.validation_accuracy) == 12
    assert curves.validation_accuracy[-1] > 0.97
    assert curves.validation_loss[-1] < 0.3 * curves.validation_loss[0]


def test_validation_samples_do_not_influence_the_weights(bars, small) -> None:
    training, validation = bars
    flipped = Samples(validation.slices, 2 - validation.target)
    one, two = fit(small, training, validation), fit(small, training, flipped)
    np.testing.assert_array_equal(one.network.layers[0].weight, two.network.layers[0].weight)
    assert one.curves.validation_accuracy != two.curves.validation_accuracy


def test_pixels_that_never_vary_in_training_have_no_weight(bars, small) -> None:
    network = fit(small, *bars).network
    first = network.layers[0].weight.reshape(-1, 12, 10)
    assert not first[:, -1].any()
    assert first[:, :-1].any(axis=0).all()


def test_the_reported_validation_figures_are_those_of_the_returned_network(bars, small) -> None:
    fitted, (_, validation) = fit(small, *bars), bars
    shares = fitted.network.probabilities(validation.slices)
    assert fitted.curves.validation_accuracy[-1] == (shares.argmax(axis=1) == validation.target).mean()
    loss = -np.log(shares[np.arange(len(validation)), validation.target]).mean()
    assert fitted.curves.validation_loss[-1] == pytest.approx(loss, abs=1e-6)


def test_a_descent_that_diverges_says_so(bars, small, monkeypatch) -> None:
    lost = torch.nn.functional.cross_entropy
    monkeypatch.setattr(torch.nn.functional, "cross_entropy", lambda *given, **more: lost(*given, **more) * torch.nan)
    with pytest.raises(SolverError, match=r"step 1 of .*network\.learning_rate"):
        fit(small, *bars)


def test_the_rate_rises_then_falls_and_never_turns_negative() -> None:
    study = NetworkStudy(learning_rate=0.3, warmup=0.2)
    rates = np.array([learning_rate(study, step, 50) for step in range(50)])
    assert rates.argmax() in (9, 10)
    assert rates.max() == pytest.approx(0.3)
    assert (np.diff(rates[:10]) > 0).all()
    assert (np.diff(rates[10:]) < 0).all()
    assert rates.min() > 0
    assert learning_rate(replace(study, warmup=0.0), 0, 50) == 0.3


def test_normalisation_is_the_share_of_wall_at_each_pixel(bars) -> None:
    training, _ = bars
    norm = normalisation(training)
    np.testing.assert_allclose(norm.mean, (training.slices / 255.0).mean(axis=0).ravel(), rtol=1e-6)
    np.testing.assert_array_equal(norm.varies, training.slices.std(axis=0).ravel() > 0)


def test_the_content_hash_changes_with_one_pixel_and_with_one_label(bars) -> None:
    training, validation = bars
    slices, target = training.slices.copy(), training.target.copy()
    slices[5, 5, 5] ^= 255
    target[7] = (target[7] + 1) % 3
    hashes = {
        content_hash(training, validation),
        content_hash(Samples(slices, training.target), validation),
        content_hash(Samples(training.slices, target), validation),
        content_hash(validation, training),
    }
    assert len(hashes) == 4
    assert content_hash(training, validation) in hashes


@pytest.mark.parametrize("hidden", [(), (6,), (600, 600), (9, 8, 7)])
def test_onnx_runtime_answers_as_pytorch_does(bars, hidden: tuple[int, ...]) -> None:
    training, validation = bars
    norm = normalisation(training)
    torch.manual_seed(1)
    network = build_network(int(norm.varies.sum()), NetworkStudy(hidden=hidden), 3).eval()
    centred = torch.from_numpy(validation.pixels[:, norm.varies] / np.float32(255) - norm.mean[norm.varies])
    with torch.inference_mode():
        for linear in linear_layers(network):
            linear.weight.copy_(linear.weight.half())
        expected = torch.softmax(network(centred), dim=1).numpy()
    session = onnxruntime.InferenceSession(classifier_bytes(trained_network(network, norm), SIZE, {}))
    (found,) = session.run(None, {"slices": validation.slices})
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.ptp(expected, axis=0).max() > 1e-3, "a network that answers always the same proves nothing"


def test_the_graph_carries_its_provenance_and_is_the_same_every_time(bars) -> None:
    norm = normalisation(bars[0])
    network = trained_network(build_network(int(norm.varies.sum()), NetworkStudy(hidden=(4,)), 3), norm)
    content = classifier_bytes(network, SIZE, {"seed": "7", "dataset_sha256": "ab"})
    assert content == classifier_bytes(network, SIZE, {"dataset_sha256": "ab", "seed": "7"})
    properties = {entry.key: entry.value for entry in onnx.load_from_string(content).metadata_props}
    assert properties == {"seed": "7", "dataset_sha256": "ab"}


def network_of(bars) -> TrainedNetwork:
    norm = normalisation(bars[0])
    torch.manual_seed(3)
    network = build_network(int(norm.varies.sum()), NetworkStudy(hidden=(300, 200)), 3).eval()
    return trained_network(network, norm)


def test_the_file_answers_as_the_rounded_network_and_is_half_as_large(bars) -> None:
    rounded, slices = with_half_weights(network_of(bars)), bars[1].slices
    content = classifier_bytes(rounded, SIZE, {})
    (found,) = onnxruntime.InferenceSession(content).run(None, {"slices": slices})
    np.testing.assert_allclose(found, rounded.probabilities(slices), atol=1e-5)
    assert len(content) < 0.55 * sum(layer.weight.nbytes for layer in rounded.layers)
    kinds = [tensor.data_type for tensor in onnx.load_from_string(content).graph.initializer if len(tensor.dims) == 2]
    assert kinds == [onnx.TensorProto.FLOAT16] * 3


def test_rounding_moves_the_answers_by_less_than_a_thousandth(bars) -> None:
    network = network_of(bars)
    rounded = with_half_weights(network)
    slices = bars[1].slices
    assert np.abs(rounded.probabilities(slices) - network.probabilities(slices)).max() < 1e-3
    for layer, before in zip(rounded.layers, network.layers, strict=True):
        np.testing.assert_array_equal(layer.bias, before.bias)
        assert 0.0 < np.abs(layer.weight - before.weight).max() < 1e-3 * np.abs(before.weight).max()


def test_the_best_candidate_is_the_most_accurate_and_of_equals_the_smallest() -> None:
    tried = (
        Candidate(hidden=(9,), weights=500, validation_accuracy=0.97, validation_loss=0.1),
        Candidate(hidden=(5,), weights=300, validation_accuracy=0.99, validation_loss=0.3),
        Candidate(hidden=(3, 3), weights=200, validation_accuracy=0.99, validation_loss=0.4),
        Candidate(hidden=(2,), weights=100, validation_accuracy=None, validation_loss=None),
    )
    assert best(tried) == 2
    with pytest.raises(SolverError, match="every size"):
        best(tried[3:])


def test_weights_are_counted_as_pytorch_counts_them() -> None:
    network = build_network(50, NetworkStudy(hidden=(7, 4)), 3)
    expected = sum(x.weight.numel() + x.bias.numel() for x in linear_layers(network))
    assert weights(50, (7, 4), 3) == expected


@pytest.mark.slow
def test_the_search_returns_what_training_the_chosen_size_alone_would(bars, small) -> None:
    study = replace(small, search_widths=(2, 12), search_depths=(1, 2), epochs=2)
    ticks: list[int] = []
    found = search_sizes(study, *bars, progress=ticks.append)
    assert [entry.hidden for entry in found.candidates] == list(grid(study))
    assert sum(ticks) == 2 * len(found.candidates)
    assert found.study.hidden == found.candidates[best(found.candidates)].hidden
    alone = fit(found.study, *bars)
    assert alone.curves == found.fitted.curves
    np.testing.assert_array_equal(alone.network.layers[-1].weight, found.fitted.network.layers[-1].weight)
