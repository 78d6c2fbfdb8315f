"""A trained model, ready to read slices (ONNX Runtime only; PyTorch is not needed)."""

import reprlib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

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
from scleraforce.reader.readings import METHODS
from scleraforce.reader.slice_network import OnnxSliceNetwork, run_network
from scleraforce.reader.wall_reader import WallReader
from scleraforce.study import Study, parse_study

__all__ = ["INPUT", "OUTPUT", "ForceReader", "load_classifier", "load_model"]

INPUT, OUTPUT = "slices", "probabilities"
EXTERNAL = b"location"  # the key of data in other files (onnx.proto, TensorProto.external_data); none of ours has it

# `scleraforce` has switched it off before ONNX Runtime was imported; this is for those who imported that first.
onnxruntime.disable_telemetry_events()


class ForceReader:
    """A model of kind "classifier": reads the force class from slices.

    Made by `load_model`; its network, study and hashes belong together.

    The same slices give the same answer: the session runs on the CPU with a fixed number of threads.
    """

    kind = "classifier"

    def __init__(self, folder: ModelFolder, study: Study, session: onnxruntime.InferenceSession) -> None:
        self.path: Path = folder.path
        self.study: Study = study
        self.record: Mapping[str, Any] = folder.record
        self._session = session

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making: hashes of study and data set, seed, versions, class bounds."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def probabilities(self, slices: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the probability of each force class.

        Args:
            slices: uint8, shape (slice, row, column) of the study; 255 where wall is, 0 elsewhere.

        Returns:
            Shape (slice, class); rows sum to 1.

        Raises:
            ModelError: another shape or type, or values other than 0 and 255.
        """
        expected = (self.study.slice.rows, self.study.slice.columns)
        if slices.dtype != np.uint8 or slices.ndim != 3 or slices.shape[1:] != expected:
            raise ModelError(
                f"{self.path}: slices: found {slices.dtype} of shape {slices.shape}, this model reads uint8 of shape "
                f"(n, {expected[0]}, {expected[1]})"
            )
        if np.any((slices != 0) & (slices != 255)):
            raise ModelError(f"{self.path}: slices: a value other than 0 (no wall) and 255 (wall)")
        if not len(slices):
            return np.empty((0, self.classes))
        (answer,) = run_network(self._session, [OUTPUT], {INPUT: np.ascontiguousarray(slices)}, str(self.path))
        if answer.shape != (len(slices), self.classes):
            raise ModelError(f"{self.path}: the network answers {answer.shape} to {len(slices)} slices")
        # float32 leaves the sum at 1 to some 1e-7; double makes it exact to the last digits that are printed.
        result: NDArray[np.float64] = answer.astype(np.float64)
        result /= result.sum(axis=1, keepdims=True)

        return result


def load_model(path: str | PathLike[str], threads: int = 1) -> ForceReader | WallReader:
    """Load a model folder.

    Args:
        path: the folder that `scleraforce train` wrote.
        threads: of ONNX Runtime within one operation; 1 is fastest for single slices.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it.
    """
    folder = read_folder(Path(path))
    study = _study(folder)
    session = _session(folder, threads)
    if folder.record["kind"] == ForceReader.kind:
        _check_network(folder, study, session)
        _check_provenance(folder, session)
        return ForceReader(folder, study, session)
    network = OnnxSliceNetwork(session, study, str(folder.path / NETWORK_FILE))
    _check_provenance(folder, session)
    return WallReader(folder.path, study, folder.record, network, _library(folder), _default(folder))


def load_classifier(path: str | PathLike[str], threads: int = 1) -> ForceReader:
    """Load a model folder of kind "classifier"; arguments and errors of `load_model`.

    Raises:
        ModelError: it is of another kind.
    """
    model = load_model(path, threads)
    if not isinstance(model, ForceReader):
        raise ModelError(f"{path}: kind: found {model.kind!r}, a classifier is needed here")
    return model


def _library(folder: ModelFolder) -> Library:
    """Read the library, and have it prepare what its first evaluation would otherwise wait for."""
    try:
        library = load_library(folder.path / LIBRARY_FILE, folder.files[LIBRARY_FILE])
    except InputError as fault:
        raise ModelError(str(fault)) from fault
    library.at_tip(library.thickness_m[:1], library.iop_ratio[:1], library.tip_m[:1])
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
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    if EXTERNAL in folder.files[NETWORK_FILE]:
        raise ModelError(f"{folder.path / NETWORK_FILE}: asks for data in other files; ours have all in this one")
    try:
        return onnxruntime.InferenceSession(folder.files[NETWORK_FILE], options, providers=["CPUExecutionProvider"])
    except Exception as fault:  # ONNX Runtime's exceptions have no common base of their own
        raise ModelError(f"{folder.path / NETWORK_FILE}: not a network that ONNX Runtime reads: {fault}") from fault


def _check_network(folder: ModelFolder, study: Study, session: onnxruntime.InferenceSession) -> None:
    """Check that network and study fit each other."""
    place = folder.path / NETWORK_FILE
    inputs = {item.name: (item.type, item.shape[1:]) for item in session.get_inputs()}
    outputs = {item.name: (item.type, item.shape[1:]) for item in session.get_outputs()}
    classes = len(study.classes.bounds_n) + 1
    if inputs != {INPUT: ("tensor(uint8)", [study.slice.rows, study.slice.columns])}:
        raise ModelError(
            f"{place}: input: found {inputs}, {STUDY_FILE} asks for {study.slice.rows} x "
            f"{study.slice.columns} uint8 '{INPUT}'"
        )
    if outputs != {OUTPUT: ("tensor(float)", [classes])}:
        raise ModelError(f"{place}: output: found {outputs}, expected {classes} floats '{OUTPUT}'")


def _check_provenance(folder: ModelFolder, session: onnxruntime.InferenceSession) -> None:
    """Check that the network was made with the study beside it."""
    try:
        stated = session.get_modelmeta().custom_metadata_map.get("study_sha256")
    except ValueError as fault:  # names that are no text
        raise ModelError(f"{folder.path / NETWORK_FILE}: metadata: {fault}") from fault
    if stated != sha256(folder.files[STUDY_FILE]):
        place = folder.path / NETWORK_FILE
        raise ModelError(f"{place}: study_sha256: {stated} is not the study in {STUDY_FILE}; train the model again")
