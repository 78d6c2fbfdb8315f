"""The reader's network as an ONNX graph: slices (uint8) and given values in; histogram and lateral place out.

Written node by node, like `graph`: the same bytes for the same network and provenance.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.classifier.graph import constant, model_bytes, node, tensor_values
from scleraforce.learning.framework import onnx, torch
from scleraforce.learning.reader.network import KERNEL, SHARPNESS, STRIDE, ReaderNetwork, bin_ends
from scleraforce.reader.networks import CONTACT, GIVEN, HISTOGRAM, SLICES, TOLD


def reader_onnx_bytes(network: ReaderNetwork, rows: int, columns: int, provenance: Mapping[str, str]) -> bytes:
    """Return the network as a checked ONNX model.

    Its inputs are `slices`, uint8 (n, rows, columns) of 0 and 255, and `given`, float32 (n, len(GIVEN)); its outputs
    `histogram`, float32 (n, bins), rows sum to 1, and `contact_m`, float32 (n,).

    Args:
        network: trained.
        rows: of a slice.
        columns: of a slice.
        provenance: entries of `metadata_props`.
    """
    constants: dict[str, NDArray[Any]] = {
        "second_axis": np.array([1], dtype=np.int64),
        "white": np.array(1.0 / 255.0, dtype=np.float32),
        "one": np.array(1.0, dtype=np.float32),
        "millimetre": np.array(1e-3, dtype=np.float32),
        "wall_unit": np.array(network.wall_unit, dtype=np.float32),
        "circle": tensor_values(network.circle),
        "projection": tensor_values(network.projection),
    }
    nodes = [*_features(), *_convolutions(network, constants), *_layers(network, constants)]
    float32 = onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        nodes,
        "force_reader",
        [
            onnx.helper.make_tensor_value_info(SLICES, onnx.TensorProto.UINT8, ["n", rows, columns]),
            onnx.helper.make_tensor_value_info(TOLD, float32, ["n", len(GIVEN)]),
        ],
        [
            onnx.helper.make_tensor_value_info(HISTOGRAM, float32, ["n", network.bins]),
            onnx.helper.make_tensor_value_info(CONTACT, float32, ["n"]),
        ],
        [constant(name, value) for name, value in constants.items()],
    )
    return model_bytes(graph, provenance)


def _features() -> list[onnx.NodeProto]:
    """`ReaderNetwork.features`, line by line."""
    return [
        node("Cast", [SLICES], "grey", to=onnx.TensorProto.FLOAT),
        node("Mul", ["grey", "white"], "wall"),
        node("Conv", ["wall", "projection"], "sums", kernel_shape=[1]),
        node("Split", ["sums"], ["amount", "moment"], axis=1),
        node("Min", ["amount", "one"], "there"),
        node("Max", ["amount", "one"], "divisor"),
        node("Div", ["moment", "divisor"], "mean_depth"),
        node("Mul", ["circle", "there"], "circle_there"),
        node("Sub", ["mean_depth", "circle_there"], "below_circle"),
        node("Mul", ["amount", "wall_unit"], "walls"),
        node("Sub", ["walls", "there"], "excess"),
        node("Concat", ["there", "excess", "below_circle"], "signal0", axis=1),
    ]


def _convolutions(network: ReaderNetwork, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    nodes = []
    for number, layer in enumerate(network.convolutions):
        constants |= {f"{name}{number}": tensor_values(value) for name, value in layer.named_parameters()}
        arguments = [f"signal{number}", f"weight{number}", f"bias{number}"]
        pads = [KERNEL // 2, KERNEL // 2]
        nodes.append(node("Conv", arguments, f"convolved{number}", kernel_shape=[KERNEL], strides=[STRIDE], pads=pads))
        nodes.append(node("Relu", [f"convolved{number}"], f"signal{number + 1}"))
    return nodes


def _layers(network: ReaderNetwork, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    nodes = [
        node("Flatten", [f"signal{len(network.convolutions)}"], "flat0", axis=1),
        *_linear(network.given_layer, TOLD, "known_linear", constants),
        node("Relu", ["known_linear"], "known"),
    ]
    for number, layer in enumerate(network.hidden):
        nodes.append(node("Concat", [f"flat{number}", "known"], f"joined{number}", axis=1))
        nodes += _linear(layer, f"joined{number}", f"linear{number}", constants)
        nodes.append(node("Relu", [f"linear{number}"], f"flat{number + 1}"))
    last = f"flat{len(network.hidden)}"
    nodes += _linear(network.force, last, "mixture", constants)
    nodes += _histogram(network.bins, constants)
    nodes += _linear(network.place, last, "place_mm", constants)
    nodes += [
        node("Mul", ["place_mm", "millimetre"], "place_m"),
        node("Squeeze", ["place_m", "second_axis"], CONTACT),
    ]
    return nodes


def _histogram(bins: int, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    """`reader_network.histogram`, line by line."""
    constants |= {
        "bin_ends": bin_ends(bins)[None, None],
        "sharpest": np.array(SHARPNESS[0], dtype=np.float32),
        "bluntest": np.array(SHARPNESS[1], dtype=np.float32),
        "third_axis": np.array([2], dtype=np.int64),
        "begin": np.array([0], dtype=np.int64),
        "second": np.array([1], dtype=np.int64),
        "last": np.array([bins], dtype=np.int64),
        "all": np.array([bins + 1], dtype=np.int64),
    }
    return [
        node("Split", ["mixture"], ["weight_logits", "middle", "free_log_scale"], axis=1),
        node("Softmax", ["weight_logits"], "weight", axis=1),
        node("Clip", ["free_log_scale", "sharpest", "bluntest"], "log_scale"),
        node("Exp", ["log_scale"], "scale"),
        *(node("Unsqueeze", [name, "third_axis"], f"{name}_of_ends") for name in ("weight", "middle", "scale")),
        node("Sub", ["bin_ends", "middle_of_ends"], "from_middle"),
        node("Div", ["from_middle", "scale_of_ends"], "scaled"),
        node("Sigmoid", ["scaled"], "below_each"),
        node("Mul", ["weight_of_ends", "below_each"], "weighed"),
        node("ReduceSum", ["weighed", "second_axis"], "below", keepdims=0),
        node("Slice", ["below", "begin", "last", "second_axis"], "below_lower"),
        node("Slice", ["below", "second", "all", "second_axis"], "below_upper"),
        node("Sub", ["below_upper", "below_lower"], HISTOGRAM),
    ]


def _linear(
    layer: torch.nn.Module, source: str, output: str, constants: dict[str, NDArray[Any]]
) -> list[onnx.NodeProto]:
    constants |= {f"{output}_{name}": tensor_values(value) for name, value in layer.named_parameters()}
    return [node("Gemm", [source, f"{output}_weight", f"{output}_bias"], output, transB=1)]
