"""A classifier whose weights are stored in half precision: nearly all of its file is weights.

They are rounded before anything is measured on the network, and widened again when the file is loaded: what is measured
is what the file says. Sums run in single precision as before.
"""

from dataclasses import replace

import numpy as np

from scleraforce.learning.classifier.graph import constant, node
from scleraforce.learning.classifier.network import TrainedNetwork
from scleraforce.learning.framework import onnx

SUFFIX = "_half"


def with_half_weights(network: TrainedNetwork) -> TrainedNetwork:
    """Return a network whose weights are numbers of half precision; biases and mean stay as they are."""
    layers = (replace(layer, weight=layer.weight.astype(np.float16).astype(np.float32)) for layer in network.layers)
    return replace(network, layers=tuple(layers))


def stored_as_half(content: bytes) -> bytes:
    """Return an ONNX model whose matrices are stored in half precision and cast to single precision.

    Args:
        content: a model whose matrices are numbers of half precision (`with_half_weights`).
    """
    model = onnx.load_model_from_string(content)
    graph = model.graph
    wide = [tensor for tensor in graph.initializer if len(tensor.dims) == 2]
    casts = [node("Cast", [tensor.name + SUFFIX], tensor.name, to=onnx.TensorProto.FLOAT) for tensor in wide]
    for tensor in wide:
        tensor.CopyFrom(constant(tensor.name + SUFFIX, onnx.numpy_helper.to_array(tensor).astype(np.float16)))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model, full_check=True)
    stored: bytes = model.SerializeToString(deterministic=True)
    return stored
