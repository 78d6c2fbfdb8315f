"""A model folder of kind "reader" whose network answers always the same: bins of F/E with the shares it was given."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scleraforce.library import Library, save_library
from scleraforce.models.folder import LIBRARY_FILE
from scleraforce.reader.networks import CONTACT, GIVEN, HISTOGRAM, SLICES, TOLD
from scleraforce.study import Study, format_study, study_hash


def fixed_study(bins: int) -> Study:
    """The paper's study with so many bins in the reader's histogram."""
    return replace(Study(), reader=replace(Study().reader, bins=bins))


def write_fixed_reader(
    path: Path, library: Library, shares: Sequence[float], contact_m: float = 0.0, default: str = "fit"
) -> Study:
    """Write the folder; returns its study."""
    import onnx
    from onnx.helper import make_graph, make_model, make_node, make_opsetid, make_tensor_value_info, set_model_props

    from scleraforce.models.folder import write_folder

    study = fixed_study(len(shares))
    values = {
        "none": np.zeros((len(GIVEN), len(shares)), dtype=np.float32),
        "shares": np.log(np.maximum(np.asarray(shares, dtype=np.float32), np.float32(1e-12))),
        "no_place": np.zeros((len(GIVEN), 1), dtype=np.float32),
        "place": np.array([contact_m], dtype=np.float32),
        "second": np.array([1], dtype=np.int64),
    }
    nodes = [
        make_node("Gemm", [TOLD, "none", "shares"], ["logits"]),
        make_node("Softmax", ["logits"], [HISTOGRAM], axis=1),
        make_node("Gemm", [TOLD, "no_place", "place"], ["places"]),
        make_node("Squeeze", ["places", "second"], [CONTACT]),
    ]
    float32 = onnx.TensorProto.FLOAT
    graph = make_graph(
        nodes,
        "fixed",
        [
            make_tensor_value_info(SLICES, onnx.TensorProto.UINT8, ["n", study.slice.rows, study.slice.columns]),
            make_tensor_value_info(TOLD, float32, ["n", len(GIVEN)]),
        ],
        [
            make_tensor_value_info(HISTOGRAM, float32, ["n", len(shares)]),
            make_tensor_value_info(CONTACT, float32, ["n"]),
        ],
        [onnx.numpy_helper.from_array(value, name) for name, value in values.items()],
    )
    model = make_model(graph, opset_imports=[make_opsetid("", 17)], ir_version=8)
    set_model_props(model, {"study_sha256": study_hash(study)})
    folder = path.parent / f"{path.name}.library"
    save_library(library, folder)
    content = folder.read_bytes()
    folder.unlink()
    record = {"kind": "reader", "default": default, "metrics": {}}
    write_folder(path, model.SerializeToString(), format_study(study), "# card\n", record, {LIBRARY_FILE: content})
    return study
