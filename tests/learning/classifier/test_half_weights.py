"""Weights stored in half precision: a file of half the size that answers as the network it was measured on."""

import numpy as np
import onnx
import onnxruntime
import torch

from scleraforce.learning.classifier.graph import onnx_bytes
from scleraforce.learning.classifier.half_weights import stored_as_half, with_half_weights
from scleraforce.learning.classifier.network import TrainedNetwork, build_network, trained_network
from scleraforce.learning.classifier.samples import normalisation
from scleraforce.study import NetworkStudy


def network_of(bars) -> TrainedNetwork:
    norm = normalisation(bars[0])
    torch.manual_seed(3)
    network = build_network(int(norm.varies.sum()), NetworkStudy(hidden=(300, 200)), 3).eval()
    return trained_network(network, norm)


def answers(content: bytes, slices: np.ndarray) -> np.ndarray:
    (found,) = onnxruntime.InferenceSession(content).run(None, {"slices": slices})
    return found


def test_the_file_answers_as_the_rounded_network_and_is_half_as_large(bars) -> None:
    rounded, slices = with_half_weights(network_of(bars)), bars[1].slices
    whole = onnx_bytes(rounded, 12, 10, {"seed": "7"})
    half = stored_as_half(whole)
    np.testing.assert_array_equal(answers(half, slices), answers(whole, slices))
    np.testing.assert_allclose(answers(half, slices), rounded.probabilities(slices), atol=1e-5)
    assert len(half) < 0.55 * len(whole)
    assert half == stored_as_half(whole)
    model = onnx.load_model_from_string(half)
    assert {entry.key: entry.value for entry in model.metadata_props} == {"seed": "7"}
    kinds = {tensor.name: tensor.data_type for tensor in model.graph.initializer}
    assert {name for name, kind in kinds.items() if kind == onnx.TensorProto.FLOAT16} == {
        "weight1_half",
        "weight2_half",
        "weight3_half",
    }


def test_rounding_moves_the_answers_by_less_than_a_thousandth(bars) -> None:
    network = network_of(bars)
    rounded = with_half_weights(network)
    slices = bars[1].slices
    assert np.abs(rounded.probabilities(slices) - network.probabilities(slices)).max() < 1e-3
    for layer, before in zip(rounded.layers, network.layers, strict=True):
        np.testing.assert_array_equal(layer.bias, before.bias)
        assert 0.0 < np.abs(layer.weight - before.weight).max() < 1e-3 * np.abs(before.weight).max()
