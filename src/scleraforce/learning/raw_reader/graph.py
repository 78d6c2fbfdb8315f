"""The raw reader's network as an ONNX graph: reduced frames and given values in; histogram and contact's place out.

The graphs of the wall finder and of the slice network (`finder_onnx_bytes`, `reader_onnx_bytes`) stand in it as they
are, and between them what makes a slice of the one's answers for the other: the same bytes for the same network.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.learning.classifier.graph import constant, model_bytes, node, tensor_values
from scleraforce.learning.framework import onnx
from scleraforce.learning.raw_reader.network import RawReaderNetwork
from scleraforce.learning.reader.graph import reader_onnx_bytes
from scleraforce.learning.wall_finder.graph import finder_onnx_bytes
from scleraforce.reader.networks import SLICES
from scleraforce.segmentation.wall_finder import FINDER_ROWS, FINDER_WALL

OF_SLICES = "read_"  # begins the names of the slice network's values: both graphs have a "signal0"


def raw_reader_onnx_bytes(network: RawReaderNetwork, provenance: Mapping[str, str]) -> bytes:
    """Return the network as a checked ONNX model; `reader.networks` says what goes in and comes out.

    Args:
        network: trained, in its evaluating mode.
        provenance: entries of `metadata_props`.
    """
    rows, columns = len(network.down), network.along.shape[1]
    seeing = onnx.load_from_string(finder_onnx_bytes(network.sees_wall, {})).graph
    reading = onnx.compose.add_prefix(
        onnx.load_from_string(reader_onnx_bytes(network.reads_slices, rows, columns, {})),
        OF_SLICES, rename_inputs=False, rename_outputs=False,
    ).graph  # fmt: skip
    given = next(value for value in reading.input if value.name != SLICES)
    graph = onnx.helper.make_graph(
        [*seeing.node, *_slices(), *reading.node],
        "raw_reader",
        [*seeing.input, given],
        list(reading.output),
        [*seeing.initializer, *(constant(name, value) for name, value in _constants(network).items()),
         *reading.initializer],
    )  # fmt: skip
    return model_bytes(graph, provenance)


def _constants(network: RawReaderNetwork) -> dict[str, NDArray[Any]]:
    return {
        "rows_down": np.array(2, dtype=np.int64),
        "half": np.array(0.5, dtype=np.float32),
        "boundary_axis": np.array([1], dtype=np.int64),
        "rows_of_slice": tensor_values(network.down),
        "columns_of_slice": tensor_values(network.along),
        "white": np.array(255.0, dtype=np.float32),
    }


def _slices() -> list[onnx.NodeProto]:
    """`RawReaderNetwork.slices`, line by line, times 255."""
    return [
        node("CumSum", [FINDER_ROWS, "rows_down"], "above_or_in_row"),
        node("Mul", [FINDER_ROWS, "half"], "half_of_row"),
        node("Sub", ["above_or_in_row", "half_of_row"], "passed"),
        node("Split", ["passed"], ["passed_outer", "passed_inner"], axis=1),
        node("Sub", ["passed_outer", "passed_inner"], "between"),
        node("Relu", ["between"], "inside"),
        node("Squeeze", ["inside", "boundary_axis"], "inside_of_rows"),
        node("Unsqueeze", [FINDER_WALL, "boundary_axis"], "wall_of_columns"),
        node("Mul", ["inside_of_rows", "wall_of_columns"], "wall_share"),
        node("MatMul", ["rows_of_slice", "wall_share"], "wall_rows"),
        node("MatMul", ["wall_rows", "columns_of_slice"], "wall_slice"),
        node("Mul", ["wall_slice", "white"], SLICES),
    ]
