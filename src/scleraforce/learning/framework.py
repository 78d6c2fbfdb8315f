"""PyTorch and ONNX, with one clear line where they are not installed; and networks as ONNX models."""

import os
import warnings
from collections.abc import Mapping, Sequence
from io import BytesIO

from scleraforce.errors import InputError

# Threads that wait by spinning take the cores from whoever else needs them, and from each other: on a busy machine an
# epoch then takes five times as long. OpenMP reads this when PyTorch loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

try:
    import onnx as onnx
    import torch as torch
except ModuleNotFoundError as fault:
    raise InputError(f"training needs {fault.name}, which is not installed: pip install 'scleraforce[train]'") from None

OPSET = 17  # old enough for every ONNX Runtime since 1.12


def onnx_bytes(
    network: torch.nn.Module,
    inputs: Mapping[str, torch.Tensor],
    outputs: Sequence[str],
    provenance: Mapping[str, str],
    folded: bool = True,
) -> bytes:
    """Return a network as a checked ONNX model, the same bytes for the same network and provenance.

    Args:
        network: in its evaluating mode.
        inputs: examples by name, of two samples; the model takes any number.
        outputs: names.
        provenance: entries of `metadata_props`.
        folded: store what is computed from weights alone, as convolutions with their normalisations, and not the
            weights. What is not folded here ONNX Runtime folds when it loads the model.
    """
    file = BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of tracing: the other exporter needs one more package
        torch.onnx.export(
            network,
            tuple(inputs.values()),
            file,  # type: ignore[arg-type]  # tracing writes to files, too
            dynamo=False,
            opset_version=OPSET,
            do_constant_folding=folded,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes={name: {0: "n"} for name in (*inputs, *outputs)},
        )
    model = onnx.load_model_from_string(file.getvalue())
    model.producer_name = "scleraforce"
    onnx.helper.set_model_props(model, dict(sorted(provenance.items())))
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content
