"""Load a trained model from its folder (ONNX Runtime only; PyTorch is not needed)."""

import reprlib
from os import PathLike
from pathlib import Path
from typing import TypeVar

import onnxruntime  # type: ignore[import-untyped]  # it ships no types

from scleraforce.errors import InputError, ModelError, StudyError
from scleraforce.library.files import load_library
from scleraforce.library.responses import Library
from scleraforce.models.folder import (
    LIBRARY_FILE,
    NETWORK_FILE,
    RECORD_FILE,
    STUDY_FILE,
    ModelFolder,
    read_folder,
    sha256,
)
from scleraforce.reader.classifier import Classifier
from scleraforce.reader.force_reader import ForceReader
from scleraforce.reader.interval_factors import parse_factors
from scleraforce.reader.reader import Reader
from scleraforce.reader.readings import METHODS
from scleraforce.reader.slice_network import OnnxSliceNetwork
from scleraforce.study import Study, parse_study

__all__ = ["load_classifier", "load_force_reader", "load_model", "slice_network"]

EXTERNAL = b"location"  # the key of data in other files (onnx.proto, TensorProto.external_data); none of ours has it

# `scleraforce` has switched it off before ONNX Runtime was imported; this is for those who imported that first.
onnxruntime.disable_telemetry_events()


Kind = TypeVar("Kind", Classifier, ForceReader)


def load_model(path: str | PathLike[str], threads: int = 1) -> Reader:
    """Load a model folder of either kind.

    Args:
        path: the folder that `scleraforce train` wrote.
        threads: of ONNX Runtime within one operation; 1 is fastest for single slices.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it.
    """
    folder = read_folder(Path(path))
    study = _study(folder)
    session = _session(folder, threads)
    if folder.record["kind"] == Classifier.kind:
        classifier = Classifier(folder.path, study, folder.record, session)
        _check_provenance(folder, session)
        return classifier
    factors = parse_factors(folder.record, str(folder.path / RECORD_FILE))
    network = OnnxSliceNetwork(session, study, str(folder.path / NETWORK_FILE), factors)
    _check_provenance(folder, session)
    return ForceReader(folder.path, study, folder.record, network, _library(folder), _default(folder), factors)


def load_classifier(path: str | PathLike[str], threads: int = 1) -> Classifier:
    """Load a model folder of kind "classifier"; arguments and errors of `load_model`.

    Raises:
        ModelError: it is of another kind.
    """
    return _of_kind(load_model(path, threads), Classifier)


def load_force_reader(path: str | PathLike[str], threads: int = 1) -> ForceReader:
    """Load a model folder of kind "reader"; arguments and errors of `load_model`.

    Raises:
        ModelError: it is of another kind.
    """
    return _of_kind(load_model(path, threads), ForceReader)


def slice_network(network: bytes, study: Study, place: str = NETWORK_FILE) -> OnnxSliceNetwork:
    """Return a reader's network from its bytes, without factors for its intervals.

    Raises:
        ModelError: it is none, or another one than its study asks for.
    """
    return OnnxSliceNetwork(_network_session(network, place, 1), study, place)


def _of_kind(model: Reader, wanted: type[Kind]) -> Kind:
    if not isinstance(model, wanted):
        raise ModelError(f"{model.path}: kind: found {model.kind!r}, a {wanted.kind} is needed here")
    return model


def _library(folder: ModelFolder) -> Library:
    """Read the library, and have it prepare what its first evaluation would otherwise wait for."""
    try:
        library = load_library(folder.path / LIBRARY_FILE, folder.files[LIBRARY_FILE])
    except InputError as fault:
        raise ModelError(str(fault)) from fault
    thickness_m = library.thickness_m[:1]
    library.at_tip(thickness_m, library.iop_ratio_ends(thickness_m)[0], library.tip_m[:1])
    return library


def _default(folder: ModelFolder) -> str:
    """Return which method answers."""
    default = folder.record.get("default")
    if default not in METHODS:
        place = folder.path / RECORD_FILE
        raise ModelError(f"{place}: default: found {reprlib.repr(default)}, expected {' or '.join(METHODS)}")
    return str(default)


def _study(folder: ModelFolder) -> Study:
    try:
        return parse_study(folder.files[STUDY_FILE].decode(), str(folder.path / STUDY_FILE))
    except (StudyError, UnicodeDecodeError) as fault:
        raise ModelError(str(fault)) from fault


def _session(folder: ModelFolder, threads: int) -> onnxruntime.InferenceSession:
    return _network_session(folder.files[NETWORK_FILE], str(folder.path / NETWORK_FILE), threads)


def _network_session(network: bytes, place: str, threads: int) -> onnxruntime.InferenceSession:
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


def _check_provenance(folder: ModelFolder, session: onnxruntime.InferenceSession) -> None:
    """Check that the network was made with the study beside it."""
    try:
        stated = session.get_modelmeta().custom_metadata_map.get("study_sha256")
    except ValueError as fault:  # names that are no text
        raise ModelError(f"{folder.path / NETWORK_FILE}: metadata: {fault}") from fault
    if stated != sha256(folder.files[STUDY_FILE]):
        place = folder.path / NETWORK_FILE
        raise ModelError(f"{place}: study_sha256: {stated} is not the study in {STUDY_FILE}; train the model again")
