"""Load a trained model from its folder (ONNX Runtime only; PyTorch is not needed), and
read in the control loop.
"""

import copyreg
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from scleraforce.base.errors import InputError, ModelError
from scleraforce.library.library_file import load_library
from scleraforce.library.wall_responses import Library
from scleraforce.reading.force_network import ForceNetwork
from scleraforce.reading.interval_widths import parse_factors
from scleraforce.reading.reading_models import (
    Classifier,
    ForceReader,
    RawReader,
    Reader,
)
from scleraforce.reading.trained_ranges import CLASSIFIER, KINDS, RAW_READER
from scleraforce.records import model_folder
from scleraforce.records.setup import Setup
from scleraforce.wall.wall_network import WallFinder

Kind = TypeVar("Kind", Classifier, ForceReader)
Loaded = TypeVar("Loaded")
Finder = str | PathLike[str] | None
KEPT = 8  # models that a process keeps, so that it loads each of them once
_kept: dict[model_folder.Origin, Any] = {}


def load_wall_finder(path: str | PathLike[str], threads: int = 1) -> WallFinder:
    """Load a model folder of kind "wall-finder"; arguments and errors as for
    `load_reader`.
    """
    folder = model_folder.read_folder(path, (model_folder.WALL_FINDER,))
    return _once(_read_finder, folder, threads)


def load_reader(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = model_folder.SHIPPED_WALL_FINDER,
) -> Reader:
    """Load a model folder of any kind that reads forces.

    `path` is the folder that `scleraforce train` wrote ("./mine"), or the name of a
    bundled one ("default"; `model_folder.model_folder`); `threads` are ONNX Runtime's
    within one operation, 1 is fastest for single slices; `finder` is the folder of the
    wall finder that checks the walls it reads, None: nothing checks them. A file that
    is missing, was changed, or does not fit the study beside it raises `ModelError`:
    the files are checked each time, though a process loads them once.
    """
    folder = model_folder.read_folder(path, KINDS)
    return replace(
        _once(_read_reader, folder, threads),
        path=folder.path,  # as it is given now
        finder=None if finder is None else load_wall_finder(finder, threads),
    )


def _once(
    load: Callable[[model_folder.ModelFolder, model_folder.Origin], Loaded],
    folder: model_folder.ModelFolder,
    threads: int,
) -> Loaded:
    """Return the model of a folder whose files were just checked; load it if the
    process does not keep it.
    """
    origin = model_folder.origin_of(folder, threads)
    model: Loaded | None = _kept.get(origin)
    if model is None:
        model = load(folder, origin)
        while len(_kept) >= KEPT:
            _kept.pop(next(iter(_kept)), None)  # another thread may have done so
        _kept[origin] = model

    return model


def _read_finder(
    folder: model_folder.ModelFolder, origin: model_folder.Origin
) -> WallFinder:
    study = model_folder.folder_study(folder)
    session, metadata = model_folder.folder_session(folder, origin.threads)
    finder = WallFinder(
        session, study.wall_finder, str(folder.path / model_folder.NETWORK_FILE)
    )
    model_folder.check_provenance(folder, metadata)
    finder.origin = origin

    return finder


def _read_reader(
    folder: model_folder.ModelFolder, origin: model_folder.Origin
) -> Reader:
    """Load the model of a folder, without a wall finder."""
    kind = folder.record["kind"]
    study = model_folder.folder_study(folder)
    session, provenance = model_folder.folder_session(folder, origin.threads)

    if kind == CLASSIFIER:
        model: Reader = Classifier(folder.path, study, session)
    else:
        factors = parse_factors(
            folder.record, str(folder.path / model_folder.RECORD_FILE)
        )
        place = str(folder.path / model_folder.NETWORK_FILE)
        network = ForceNetwork(session, study, place, factors, raw=kind == RAW_READER)

        if kind == RAW_READER:
            model = RawReader(folder.path, study, network)
        else:
            default = folder.record.get("default", "")
            model = ForceReader(
                folder.path, study, network, _library(folder), default, factors
            )

    model_folder.check_provenance(folder, provenance)
    model.record = folder.record
    model.provenance = provenance
    model.origin = origin

    return model


def opened_reader(model: Reader | str | PathLike[str]) -> Reader:
    """Return a model; load one that is given by its folder or name, whose files are
    checked each time but loaded once.
    """
    if not isinstance(model, str | PathLike):
        return model

    folder = model_folder.model_folder(Path(model))
    if folder in model_folder.SHIPPED.values():
        return _bundled(folder, model_folder.SHIPPED_WALL_FINDER)

    return replace(load_reader(folder, finder=None), finder=bundled_finder())


@cache
def bundled_finder() -> WallFinder:
    """Return the bundled wall finder."""
    return load_wall_finder(model_folder.SHIPPED_WALL_FINDER)


def _unpickled_finder(origin: model_folder.Origin) -> WallFinder:
    return load_wall_finder(model_folder.origin_folder(origin), origin.threads)


def _unpickled(origin: model_folder.Origin, finder: WallFinder | None) -> Reader:
    folder = model_folder.origin_folder(origin)
    return replace(load_reader(folder, origin.threads, finder=None), finder=finder)


def _reduced(reader: Reader) -> tuple[Any, ...]:
    """Return what a pickle holds of a model: its origin, not its content, so that
    unpickling checks its files.
    """
    return _unpickled, (_origin(reader), reader.finder)


def _reduced_finder(finder: WallFinder) -> tuple[Any, ...]:
    return _unpickled_finder, (_origin(finder),)


def _origin(model: Reader | WallFinder) -> model_folder.Origin:
    if model.origin is None:
        raise ModelError(
            f"{model!r}: not loaded from a folder, so it cannot be pickled; give one of"
            " load_model"
        )
    return model.origin


for _kind in (Classifier, ForceReader, RawReader):
    copyreg.pickle(_kind, _reduced)
copyreg.pickle(WallFinder, _reduced_finder)


def suited_reader(reader: Reader, setup: Setup) -> Reader:
    """Return the bundled reader that was trained for an eye, in place of the other one;
    any other reader is returned.

    The reader is changed only if it refuses the eye and the other one does not.
    """
    others = {
        model_folder.SHIPPED_READER: model_folder.SHIPPED_LIVING,
        model_folder.SHIPPED_LIVING: model_folder.SHIPPED_READER,
    }
    if reader.path not in others or reader.outside(setup) is None:
        return reader

    other = _bundled(others[reader.path], None)
    return reader if other.outside(setup) else replace(other, finder=reader.finder)


@cache
def _bundled(folder: Path, finder: Path | None) -> Reader:
    return load_reader(folder, finder=finder)


def load_classifier(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = model_folder.SHIPPED_WALL_FINDER,
) -> Classifier:
    """Load a model folder of kind "classifier"; arguments and errors as for
    `load_reader`.
    """
    return _of_kind(load_reader(path, threads, finder), Classifier)


def load_force_reader(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = model_folder.SHIPPED_WALL_FINDER,
) -> ForceReader:
    """Load a model folder of kind "reader"; arguments and errors as for
    `load_reader`.
    """
    return _of_kind(load_reader(path, threads, finder), ForceReader)


def _of_kind(model: Reader, wanted: type[Kind]) -> Kind:
    if not isinstance(model, wanted):
        raise ModelError(
            f"{model.path}: kind: found {model.kind!r}, a {wanted.kind} is needed here"
        )
    return model


def _library(folder: model_folder.ModelFolder) -> Library:
    """Read the library of a folder; its first evaluation prepares the arrays of the
    tissue that is asked for.
    """
    try:
        return load_library(
            folder.path / model_folder.LIBRARY_FILE,
            folder.files[model_folder.LIBRARY_FILE],
        )
    except InputError as fault:
        raise ModelError(str(fault)) from fault
