"""The wall finder's network as an ONNX graph: reduced frames in; rows of both boundaries, and whether there is wall.

Written node by node, like `learning.reader.graph`: the same bytes for the same network and provenance. The
normalisations over the batch are folded into the convolutions before them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.classifier.graph import constant, model_bytes, node, tensor_values
from scleraforce.learning.framework import onnx, torch
from scleraforce.learning.wall_finder.network import BOUNDARIES, WallFinderNetwork
from scleraforce.segmentation.wall_finder import FINDER_FRAMES, FINDER_ROWS, FINDER_WALL


def finder_onnx_bytes(network: WallFinderNetwork, provenance: Mapping[str, str]) -> bytes:
    """Return the network as a checked ONNX model; `segmentation.wall_finder` says what goes in and comes out.

    Args:
        network: trained, in its evaluating mode.
        provenance: entries of `metadata_props`.
    """
    constants = _constants(network)
    nodes = [*_inputs(), *_encoder(network, constants), *_decoder(network, constants), *_answers(network, constants)]
    rows, columns, float32 = network.rows, network.columns, onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        nodes,
        "wall_finder",
        [onnx.helper.make_tensor_value_info(FINDER_FRAMES, float32, ["n", rows, columns])],
        [
            onnx.helper.make_tensor_value_info(FINDER_ROWS, float32, ["n", BOUNDARIES, rows, columns // 2]),
            onnx.helper.make_tensor_value_info(FINDER_WALL, float32, ["n", columns // 2]),
        ],
        [constant(name, value) for name, value in constants.items()],
    )
    return model_bytes(graph, provenance)


def _constants(network: WallFinderNetwork) -> dict[str, NDArray[Any]]:
    rows, columns = network.rows, network.columns
    row = np.linspace(-1.0, 1.0, rows, dtype=np.float32)[:, None] * np.ones((1, columns), dtype=np.float32)
    return {
        "row": row[None],
        "zero": np.array(0.0, dtype=np.float32),
        "channel_axis": np.array([1], dtype=np.int64),
        "row_axis": np.array([2], dtype=np.int64),
        "twice": np.array([1.0, 1.0, 2.0, 2.0], dtype=np.float32),
        "paired": np.array([0, BOUNDARIES, 2, rows // 2, columns // 2], dtype=np.int64),
        "whole": np.array([0, BOUNDARIES, rows, columns // 2], dtype=np.int64),
    }


def _inputs() -> list[onnx.NodeProto]:
    """`WallFinderNetwork.inputs`, line by line."""
    return [
        node("Max", [FINDER_FRAMES, "zero"], "lit"),
        node("Sqrt", ["lit"], "root"),
        node("Mul", [FINDER_FRAMES, "zero"], "none"),
        node("Add", ["none", "row"], "rows_of_all"),
        *(
            node("Unsqueeze", [name, "channel_axis"], f"{name}_channel")
            for name in (FINDER_FRAMES, "root", "rows_of_all")
        ),
        node("Concat", [f"{name}_channel" for name in (FINDER_FRAMES, "root", "rows_of_all")], "pixels", axis=1),
    ]


def _encoder(network: WallFinderNetwork, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    nodes, signal = [], "pixels"
    for number in range(len(network.down)):
        nodes += _block(network, f"down{number}", signal, constants)
        nodes += _block(network, f"level{number}", f"down{number}", constants)
        signal = f"level{number}"
    for number in range(len(network.deepest)):
        nodes += _block(network, f"deepest{number}", signal, constants)
        nodes.append(node("Add", [signal, f"deepest{number}"], f"added{number}"))
        signal = f"added{number}"
    nodes.append(node("Identity", [signal], "signal0"))
    return nodes


def _decoder(network: WallFinderNetwork, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    nodes, levels = [], len(network.level)
    for number in range(len(network.up)):
        nodes.append(_doubled(f"signal{number}", f"larger{number}"))
        nodes.append(node("Concat", [f"larger{number}", f"level{levels - 2 - number}"], f"joined{number}", axis=1))
        nodes += _block(network, f"up{number}", f"joined{number}", constants)
        nodes.append(node("Identity", [f"up{number}"], f"signal{number + 1}"))
    nodes.append(node("Identity", [f"signal{len(network.up)}"], "last"))
    return nodes


def _answers(network: WallFinderNetwork, constants: dict[str, NDArray[Any]]) -> list[onnx.NodeProto]:
    for name, layer in (("boundaries", network.boundaries), ("wall", network.wall)):
        constants |= {f"{name}_{key}": tensor_values(value) for key, value in layer.named_parameters()}
    return [
        node("Conv", ["last", "boundaries_weight", "boundaries_bias"], "channels", kernel_shape=[1, 1]),
        node("Reshape", ["channels", "paired"], "pairs"),
        node("Transpose", ["pairs"], "turned", perm=[0, 1, 3, 2, 4]),
        node("Reshape", ["turned", "whole"], "logits"),
        node("Softmax", ["logits"], FINDER_ROWS, axis=2),
        node("ReduceMax", ["last"], "largest", axes=[2], keepdims=0),
        node("ReduceMean", ["last"], "mean", axes=[2], keepdims=0),
        node("Concat", ["largest", "mean"], "pooled", axis=1),
        node("Conv", ["pooled", "wall_weight", "wall_bias"], "wall_logit", kernel_shape=[1]),
        node("Squeeze", ["wall_logit", "channel_axis"], "wall_logits"),
        node("Sigmoid", ["wall_logits"], FINDER_WALL),
    ]


def _block(
    network: WallFinderNetwork, name: str, source: str, constants: dict[str, NDArray[Any]]
) -> list[onnx.NodeProto]:
    """Return a convolution with its normalisation folded in, and the ramp behind it."""
    block = dict(network.convolutions())[name]
    weight, bias = _folded(block[0], block[1])
    constants |= {f"{name}_weight": weight, f"{name}_bias": bias}
    strides, pads = [2, 2] if name.startswith("down") else [1, 1], [1, 1, 1, 1]
    inputs = [source, f"{name}_weight", f"{name}_bias"]
    return [
        node("Conv", inputs, f"{name}_sum", kernel_shape=[3, 3], strides=strides, pads=pads),
        node("Relu", [f"{name}_sum"], name),
    ]


def _folded(
    convolution: torch.nn.Module, normalisation: torch.nn.Module
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return weight and bias of a convolution that does what both did: w g/s and b - m g/s, m and s as they ran."""
    assert isinstance(normalisation, torch.nn.BatchNorm2d)
    assert isinstance(convolution, torch.nn.Conv2d)
    mean, variance = normalisation.running_mean, normalisation.running_var
    assert mean is not None
    assert variance is not None
    gain = normalisation.weight / torch.sqrt(variance + normalisation.eps)
    weight, bias = convolution.weight * gain[:, None, None, None], normalisation.bias - mean * gain
    return tensor_values(weight), tensor_values(bias)


def _doubled(source: str, output: str) -> onnx.NodeProto:
    """Return what repeats every row and column."""
    made = node("Resize", [source, "", "twice"], output)
    words = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
    made.attribute.extend(onnx.helper.make_attribute(key, value) for key, value in words.items())
    return made
