"""The exported graph answers as PyTorch does, and says where it comes from."""

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from scleraforce.learning.classifier.graph import onnx_bytes
from scleraforce.learning.classifier.network import build_network, trained_network
from scleraforce.learning.classifier.samples import normalisation
from scleraforce.study import NetworkStudy


@pytest.mark.parametrize("hidden", [(), (6,), (600, 600), (9, 8, 7)])
def test_onnx_runtime_answers_as_pytorch_does(bars, hidden: tuple[int, ...]) -> None:
    training, validation = bars
    norm = normalisation(training)
    torch.manual_seed(1)
    network = build_network(int(norm.varies.sum()), NetworkStudy(hidden=hidden), 3).eval()
    centred = torch.from_numpy(validation.pixels[:, norm.varies] / np.float32(255) - norm.mean[norm.varies])
    with torch.inference_mode():
        expected = torch.softmax(network(centred), dim=1).numpy()
    session = onnxruntime.InferenceSession(onnx_bytes(trained_network(network, norm), 12, 10, {}))
    (found,) = session.run(None, {"slices": validation.slices})
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.ptp(expected, axis=0).max() > 1e-3, "a network that answers always the same proves nothing"


def test_the_graph_carries_its_provenance_and_is_the_same_every_time(bars) -> None:
    norm = normalisation(bars[0])
    network = trained_network(build_network(int(norm.varies.sum()), NetworkStudy(hidden=(4,)), 3), norm)
    content = onnx_bytes(network, 12, 10, {"seed": "7", "dataset_sha256": "ab"})
    assert content == onnx_bytes(network, 12, 10, {"dataset_sha256": "ab", "seed": "7"})
    properties = {entry.key: entry.value for entry in onnx.load_from_string(content).metadata_props}
    assert properties == {"seed": "7", "dataset_sha256": "ab"}
