"""A network in an ONNX file: opened, checked against its interface, and run."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import ModelError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession  # type: ignore[import-untyped]  # it ships no types


# the key of data in other files (onnx.proto, TensorProto.external_data); our models
# have none
EXTERNAL = b"location"

# type and shape of each input or output
Interface = Mapping[str, tuple[str, list[int]]]


def network_session(network: bytes, place: str, threads: int) -> "InferenceSession":
    """Return a session of a network on the CPU; raises `ModelError`."""
    # 18 ms: not for commands that run no network
    import onnxruntime

    # `scleraforce` switches telemetry off before ONNX Runtime is imported; this is for
    # those who imported that first.
    onnxruntime.disable_telemetry_events()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4

    if EXTERNAL in network:
        raise ModelError(
            f"{place}: asks for data in other files; ours have all in this one"
        )

    try:
        # There is no other provider to fall back to, and it would print to standard
        # output that it does.
        return onnxruntime.InferenceSession(
            network, options, providers=["CPUExecutionProvider"], enable_fallback=0
        )
    except (
        Exception
    ) as fault:  # ONNX Runtime's exceptions have no common base of their own
        raise ModelError(
            f"{place}: not a network that ONNX Runtime reads: {fault}"
        ) from fault


def check_interface(
    session: "InferenceSession", inputs: Interface, outputs: Interface, place: str
) -> None:
    """Check types and shapes, without the first axis, of a network's inputs and
    outputs; raises `ModelError`.
    """
    sides = (
        ("inputs", session.get_inputs(), inputs),
        ("outputs", session.get_outputs(), outputs),
    )
    for which, items, wanted in sides:
        found = {item.name: (item.type, item.shape[1:]) for item in items}
        if found != wanted:
            raise ModelError(
                f"{place}: {which}: found {found}, its study asks for {wanted}"
            )


def run_network(
    session: "InferenceSession",
    outputs: list[str],
    inputs: dict[str, NDArray[Any]],
    place: str,
) -> list[NDArray[Any]]:
    """Run a network; return its outputs; raises `ModelError`."""
    try:
        answers: list[NDArray[Any]] = session.run(outputs, inputs)
    except (
        Exception
    ) as fault:  # ONNX Runtime's exceptions have no common base of their own
        raise ModelError(f"{place}: the network cannot be run: {fault}") from fault

    if not all(np.isfinite(answer).all() for answer in answers):
        raise ModelError(
            f"{place}: the network answers with numbers that are not finite"
        )

    return answers
