"""The network as an ONNX graph: slices (uint8, 0 or 255) in, probabilities out, provenance in its metadata.

The graph is written node by node: it is eight lines of mathematics, and needs no tracing exporter.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.classifier.network import TrainedNetwork
from scleraforce.learning.framework import onnx, torch
from scleraforce.reader.kinds import INPUT, OUTPUT

OPSET, IR_VERSION = 17, 8  # old enough for every ONNX Runtime since 1.12


def onnx_bytes(network: TrainedNetwork, rows: int, columns: int, provenance: Mapping[str, str]) -> bytes:
    """Return the network as a checked ONNX model, the same bytes for the same network and provenance.

    Args:
        network: with rows * columns inputs.
        rows: of a slice.
        columns: of a slice.
        provenance: entries of `metadata_props`.
    """
    constants: dict[str, NDArray[np.float32]] = {"mean": network.mean, "white": np.array(1.0 / 255.0, dtype=np.float32)}
    nodes = [
        node("Flatten", [INPUT], "bytes", axis=1),
        node("Cast", ["bytes"], "grey", to=onnx.TensorProto.FLOAT),
        node("Mul", ["grey", "white"], "share"),
        node("Sub", ["share", "mean"], "hidden0"),
    ]
    last = len(network.layers)
    for number, layer in enumerate(network.layers, start=1):
        constants |= {f"weight{number}": layer.weight, f"bias{number}": layer.bias}
        arguments = [f"hidden{number - 1}", f"weight{number}", f"bias{number}"]
        nodes.append(node("Gemm", arguments, f"linear{number}", transB=1))
        if number < last:
            nodes.append(node("Relu", [f"linear{number}"], f"hidden{number}"))
    nodes.append(node("Softmax", [f"linear{last}"], OUTPUT, axis=1))
    graph = onnx.helper.make_graph(
        nodes,
        "force_classes",
        [onnx.helper.make_tensor_value_info(INPUT, onnx.TensorProto.UINT8, ["n", rows, columns])],
        [onnx.helper.make_tensor_value_info(OUTPUT, onnx.TensorProto.FLOAT, ["n", len(network.layers[-1].bias)])],
        [constant(name, value) for name, value in constants.items()],
    )
    return model_bytes(graph, provenance)


def node(operator: str, inputs: list[str], outputs: str | list[str], **attributes: int | list[int]) -> onnx.NodeProto:
    """Return a node that is named after its (first) output."""
    names = [outputs] if isinstance(outputs, str) else outputs
    made = onnx.helper.make_node(operator, inputs, names, name=names[0])
    made.attribute.extend(onnx.helper.make_attribute(key, value) for key, value in attributes.items())
    return made


def constant(name: str, value: NDArray[Any]) -> onnx.TensorProto:
    """Return an initialiser."""
    return onnx.numpy_helper.from_array(value, name)


def tensor_values(tensor: torch.Tensor) -> NDArray[np.float32]:
    """Return the values of a network's tensor, for `constant`."""
    values: NDArray[np.float32] = tensor.detach().numpy().copy()
    return values


def model_bytes(graph: onnx.GraphProto, provenance: Mapping[str, str]) -> bytes:
    """Return a graph as a checked model with its provenance, the same bytes for the same content."""
    opset = onnx.helper.make_opsetid("", OPSET)
    model = onnx.helper.make_model(graph, opset_imports=[opset], producer_name="scleraforce", ir_version=IR_VERSION)
    onnx.helper.set_model_props(model, dict(sorted(provenance.items())))
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content
