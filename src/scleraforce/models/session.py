"""ONNX Runtime sessions of model folders, and whether a network was made with the study beside it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.errors import ModelError, StudyError
from scleraforce.models.folder import NETWORK_FILE, STUDY_FILE, ModelFolder, sha256
from scleraforce.study import Study, parse_study

EXTERNAL = b"location"  # the key of data in other files (onnx.proto, TensorProto.external_data); none of ours has it

# `scleraforce` has switched it off before ONNX Runtime was imported; this is for those who imported that first.
onnxruntime.disable_telemetry_events()


def folder_study(folder: ModelFolder) -> Study:
    """Return the study of a model folder.

    Raises:
        ModelError: it is none.
    """
    try:
        return parse_study(folder.files[STUDY_FILE].decode(), str(folder.path / STUDY_FILE))
    except (StudyError, UnicodeDecodeError) as fault:
        raise ModelError(str(fault)) from fault


def folder_session(folder: ModelFolder, threads: int) -> onnxruntime.InferenceSession:
    """Return a session of a folder's network; raises as `network_session`."""
    return network_session(folder.files[NETWORK_FILE], str(folder.path / NETWORK_FILE), threads)


def network_session(network: bytes, place: str, threads: int) -> onnxruntime.InferenceSession:
    """Return a session of a network on the CPU.

    Args:
        network: the ONNX model.
        place: what the messages name.
        threads: within one operation.

    Raises:
        ModelError: it is no such network, or has data in other files.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    if EXTERNAL in network:
        raise ModelError(f"{place}: asks for data in other files; ours have all in this one")
    try:
        # There is no other provider to fall back to, and it would print to standard output that it does.
        return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"], enable_fallback=0)
    except Exception as fault:  # ONNX Runtime's exceptions have no common base of their own
        raise ModelError(f"{place}: not a network that ONNX Runtime reads: {fault}") from fault


def check_provenance(folder: ModelFolder, session: onnxruntime.InferenceSession) -> None:
    """Check that the network was made with the study beside it.

    Raises:
        ModelError: it was not.
    """
    try:
        stated = session.get_modelmeta().custom_metadata_map.get("study_sha256")
    except ValueError as fault:  # names that are no text
        raise ModelError(f"{folder.path / NETWORK_FILE}: metadata: {fault}") from fault
    if stated != sha256(folder.files[STUDY_FILE]):
        place = folder.path / NETWORK_FILE
        raise ModelError(f"{place}: study_sha256: {stated} is not the study in {STUDY_FILE}; train the model again")


def check_interface(
    session: onnxruntime.InferenceSession,
    inputs: Mapping[str, tuple[str, list[int]]],
    outputs: Mapping[str, tuple[str, list[int]]],
    place: str,
) -> None:
    """Check that a network has just these inputs and outputs.

    Args:
        session: of the network.
        inputs: type and shape of each, but for its first axis, by its name.
        outputs: likewise.
        place: what the messages name.

    Raises:
        ModelError: it has others.
    """
    for which, wanted in (("inputs", inputs), ("outputs", outputs)):
        items = session.get_inputs() if which == "inputs" else session.get_outputs()
        found = {item.name: (item.type, item.shape[1:]) for item in items}
        if found != wanted:
            raise ModelError(f"{place}: {which}: found {found}, its study asks for {wanted}")


def run_network(
    session: onnxruntime.InferenceSession, outputs: list[str], inputs: dict[str, NDArray[Any]], place: str
) -> list[NDArray[Any]]:
    """Run a network; return its outputs.

    Raises:
        ModelError: it cannot be run, or answers with numbers that are not finite; names `place`.
    """
    try:
        answers: list[NDArray[Any]] = session.run(outputs, inputs)
    except Exception as fault:  # ONNX Runtime's exceptions have no common base of their own
        raise ModelError(f"{place}: the network cannot be run: {fault}") from fault
    if not all(np.isfinite(answer).all() for answer in answers):
        raise ModelError(f"{place}: the network answers with numbers that are not finite")
    return answers
