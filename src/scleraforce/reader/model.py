"""Load a trained model from its folder (ONNX Runtime only; PyTorch is not needed)."""

import reprlib
from os import PathLike
from pathlib import Path
from typing import TypeVar

from scleraforce.errors import InputError, ModelError
from scleraforce.library.files import load_library
from scleraforce.library.responses import Library
from scleraforce.models.folder import LIBRARY_FILE, NETWORK_FILE, RECORD_FILE, ModelFolder, read_folder
from scleraforce.models.session import check_provenance, folder_session, folder_study, network_session
from scleraforce.models.shipped import SHIPPED_WALL_FINDER
from scleraforce.reader.classifier import Classifier
from scleraforce.reader.force_reader import ForceReader
from scleraforce.reader.interval_factors import parse_factors
from scleraforce.reader.raw_network import OnnxRawNetwork
from scleraforce.reader.raw_reader import RawReader
from scleraforce.reader.reader import Reader
from scleraforce.reader.readings import METHODS
from scleraforce.reader.slice_network import OnnxSliceNetwork
from scleraforce.reader.wall_finder_model import load_wall_finder
from scleraforce.study import Study

READS = (Classifier.kind, ForceReader.kind, RawReader.kind)  # kinds of models that read forces

Kind = TypeVar("Kind", Classifier, ForceReader)


def load_model(
    path: str | PathLike[str], threads: int = 1, finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER
) -> Reader:
    """Load a model folder of any kind that reads forces.

    Args:
        path: the folder that `scleraforce train` wrote, or the name of one that ships ("default").
        threads: of ONNX Runtime within one operation; 1 is fastest for single slices.
        finder: folder of the wall finder that checks the walls it reads; None: nothing checks them.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it.
    """
    folder = read_folder(Path(path))
    if folder.record["kind"] not in READS:
        wanted = f"{', '.join(READS[:-1])} or {READS[-1]}"
        raise ModelError(f"{folder.path}: kind: found {folder.record['kind']!r}, {wanted} is needed here")
    study = folder_study(folder)
    session = folder_session(folder, threads)
    walls = None if finder is None else load_wall_finder(finder, threads)
    if folder.record["kind"] == Classifier.kind:
        classifier = Classifier(folder.path, study, folder.record, session, walls)
        check_provenance(folder, session)
        return classifier
    factors = parse_factors(folder.record, str(folder.path / RECORD_FILE))
    if folder.record["kind"] == RawReader.kind:
        reads_frames = OnnxRawNetwork(session, study, str(folder.path / NETWORK_FILE), factors)
        check_provenance(folder, session)
        return RawReader(folder.path, study, folder.record, reads_frames, walls)
    network = OnnxSliceNetwork(session, study, str(folder.path / NETWORK_FILE), factors)
    check_provenance(folder, session)
    return ForceReader(folder.path, study, folder.record, network, _library(folder), _default(folder), factors, walls)


def load_classifier(
    path: str | PathLike[str], threads: int = 1, finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER
) -> Classifier:
    """Load a model folder of kind "classifier"; arguments and errors of `load_model`.

    Raises:
        ModelError: it is of another kind.
    """
    return _of_kind(load_model(path, threads, finder), Classifier)


def load_force_reader(
    path: str | PathLike[str], threads: int = 1, finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER
) -> ForceReader:
    """Load a model folder of kind "reader"; arguments and errors of `load_model`.

    Raises:
        ModelError: it is of another kind.
    """
    return _of_kind(load_model(path, threads, finder), ForceReader)


def slice_network(network: bytes, study: Study, place: str = NETWORK_FILE) -> OnnxSliceNetwork:
    """Return a reader's network from its bytes, without factors for its intervals.

    Raises:
        ModelError: it is none, or another one than its study asks for.
    """
    return OnnxSliceNetwork(network_session(network, place, 1), study, place)


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
