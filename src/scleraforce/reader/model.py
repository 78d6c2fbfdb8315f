"""Load a trained model from its folder (ONNX Runtime only; PyTorch is not needed), and
read in the control loop.
"""

import copyreg
from dataclasses import replace
from functools import cache, lru_cache
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from scleraforce import models
from scleraforce.arrays import Counts
from scleraforce.errors import InputError, ModelError
from scleraforce.known import Known
from scleraforce.library.files import load_library
from scleraforce.library.responses import Library
from scleraforce.reader.answer import Answer
from scleraforce.reader.intervals import parse_factors
from scleraforce.reader.kinds import Classifier, ForceReader, RawReader, Reader
from scleraforce.reader.limits import CLASSIFIER, KINDS, RAW_READER
from scleraforce.reader.networks import ForceNetwork
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.wall_finder import WallFinder

Kind = TypeVar("Kind", Classifier, ForceReader)
Finder = str | PathLike[str] | None
PICKLED = 8  # models whose pickles load them once in a process


def load_wall_finder(path: str | PathLike[str], threads: int = 1) -> WallFinder:
    """Load a model folder of kind "wall-finder"; arguments and errors as for
    `load_model`.
    """
    folder = models.read_folder(path, (models.WALL_FINDER,))
    study = models.folder_study(folder)
    session, metadata = models.folder_session(folder, threads)
    finder = WallFinder(
        session, study.wall_finder, str(folder.path / models.NETWORK_FILE)
    )
    models.check_provenance(folder, metadata)
    finder.origin = models.origin_of(folder, threads)

    return finder


def load_model(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = models.SHIPPED_WALL_FINDER,
) -> Reader:
    """Load a model folder of any kind that reads forces.

    `path` is the folder that `scleraforce train` wrote ("./mine"), or the name of a
    bundled one ("default"; `models.model_folder`); `threads` are ONNX Runtime's within
    one operation, 1 is fastest for single slices; `finder` is the folder of the wall
    finder that checks the walls it reads, None: nothing checks them. A file that is
    missing, was changed, or does not fit the study beside it raises `ModelError`.
    """
    folder = models.read_folder(path, KINDS)
    kind = folder.record["kind"]
    study = models.folder_study(folder)
    session, provenance = models.folder_session(folder, threads)

    if kind == CLASSIFIER:
        model: Reader = Classifier(folder.path, study, session)
    else:
        factors = parse_factors(folder.record, str(folder.path / models.RECORD_FILE))
        place = str(folder.path / models.NETWORK_FILE)
        network = ForceNetwork(session, study, place, factors, raw=kind == RAW_READER)

        if kind == RAW_READER:
            model = RawReader(folder.path, study, network)
        else:
            default = folder.record.get("default", "")
            model = ForceReader(
                folder.path, study, network, _library(folder), default, factors
            )

    models.check_provenance(folder, provenance)
    model.record = folder.record
    model.provenance = provenance
    model.origin = models.origin_of(folder, threads)
    model.finder = None if finder is None else load_wall_finder(finder, threads)

    return model


def opened(model: Reader | str | PathLike[str]) -> Reader:
    """Return a model; load one that is given by its folder or name, whose files are
    checked each time but loaded once.
    """
    if not isinstance(model, str | PathLike):
        return model

    folder = models.model_folder(Path(model))
    if folder in models.SHIPPED.values():
        return _bundled(folder, models.SHIPPED_WALL_FINDER)

    origin = models.origin_of(models.read_folder(folder, KINDS), 1)
    return replace(_loaded(origin), finder=bundled_finder())


@cache
def bundled_finder() -> WallFinder:
    """Return the bundled wall finder."""
    return load_wall_finder(models.SHIPPED_WALL_FINDER)


@lru_cache(maxsize=PICKLED)
def _loaded(origin: models.Origin) -> Reader:
    """Load the model of an origin, without a wall finder."""
    return load_model(models.origin_folder(origin), origin.threads, finder=None)


@lru_cache(maxsize=PICKLED)
def _loaded_finder(origin: models.Origin) -> WallFinder:
    """Load the wall finder of an origin."""
    return load_wall_finder(models.origin_folder(origin), origin.threads)


def _unpickled(origin: models.Origin, finder: WallFinder | None) -> Reader:
    return replace(_loaded(origin), finder=finder)


def _reduced(reader: Reader) -> tuple[Any, ...]:
    """Return what a pickle holds of a model: its origin, not its content, so that
    unpickling checks its files.
    """
    return _unpickled, (_origin(reader), reader.finder)


def _reduced_finder(finder: WallFinder) -> tuple[Any, ...]:
    return _loaded_finder, (_origin(finder),)


def _origin(model: Reader | WallFinder) -> models.Origin:
    if model.origin is None:
        raise ModelError(
            f"{model!r}: not loaded from a folder, so it cannot be pickled; give one of"
            " load_model"
        )
    return model.origin


for _kind in (Classifier, ForceReader, RawReader):
    copyreg.pickle(_kind, _reduced)
copyreg.pickle(WallFinder, _reduced_finder)


def suited(reader: Reader, known: Known) -> Reader:
    """Return the bundled reader that was trained for an eye, in place of the other one;
    any other reader is returned.

    The reader is changed only if it refuses the eye and the other one does not.
    """
    others = {
        models.SHIPPED_READER: models.SHIPPED_LIVING,
        models.SHIPPED_LIVING: models.SHIPPED_READER,
    }
    if reader.path not in others or reader.outside(known) is None:
        return reader

    other = _bundled(others[reader.path], None)
    return reader if other.outside(known) else replace(other, finder=reader.finder)


@cache
def _bundled(folder: Path, finder: Path | None) -> Reader:
    return load_model(folder, finder=finder)


def load_classifier(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = models.SHIPPED_WALL_FINDER,
) -> Classifier:
    """Load a model folder of kind "classifier"; arguments and errors as for
    `load_model`.
    """
    return _of_kind(load_model(path, threads, finder), Classifier)


def load_force_reader(
    path: str | PathLike[str],
    threads: int = 1,
    finder: Finder = models.SHIPPED_WALL_FINDER,
) -> ForceReader:
    """Load a model folder of kind "reader"; arguments and errors as for
    `load_model`.
    """
    return _of_kind(load_model(path, threads, finder), ForceReader)


def _of_kind(model: Reader, wanted: type[Kind]) -> Kind:
    if not isinstance(model, wanted):
        raise ModelError(
            f"{model.path}: kind: found {model.kind!r}, a {wanted.kind} is needed here"
        )
    return model


def _library(folder: models.ModelFolder) -> Library:
    """Read the library and prepare the arrays that its first evaluation would otherwise
    wait for.
    """
    try:
        library = load_library(
            folder.path / models.LIBRARY_FILE, folder.files[models.LIBRARY_FILE]
        )
    except InputError as fault:
        raise ModelError(str(fault)) from fault

    thickness_m = library.thickness_m[:1]
    library.at_tip(
        thickness_m, library.iop_ratio_ends(thickness_m)[0], library.tip_m[:1]
    )

    return library


THICKNESS_M = 0.6e-3  # of the wall, if unknown
SURFACE = 0.2  # depth of the apex, of the frame's
# counts; the tissue's are added
NOISE = (0, 400)
TISSUE = (600, 1600)
WARMING_FRAMES = 20


def warming_frame(
    shape: tuple[int, int],
    scale: PixelScale,
    radius_m: float,
    thickness_m: float | None = None,
) -> Counts:
    """Return a raw B-scan (row, column) of the wall of an eye at rest, the same at each
    call.
    """
    rows, columns = shape
    rng = np.random.default_rng(0)
    lateral_m = (np.arange(columns) + 0.5 - columns / 2) * scale.lateral_m
    falls_m = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
    depth_m = (
        np.arange(rows)[:, None] + 0.5 - SURFACE * rows
    ) * scale.depth_m - falls_m
    is_tissue = (depth_m > 0.0) & (
        depth_m < (thickness_m or THICKNESS_M) * scale.refractive_index
    )
    noise, tissue = (
        rng.integers(*counts, shape, dtype=np.uint16) for counts in (NOISE, TISSUE)
    )

    return noise + np.where(is_tissue, tissue, np.uint16(0))


class LiveReader:
    """Reads the frames of one eye in the control loop, one after the other.

    It reads some frames at the start, so that the first real one takes no longer than
    the others.
    """

    def __init__(self, reader: Reader, known: Known, refractive_index: float) -> None:
        self._reader = reader
        self._known = known
        self._refractive_index = refractive_index
        scanner = reader.study.oct
        scale = PixelScale.of(reader.study.oct)
        frame = warming_frame(
            (scanner.rows, scanner.columns),
            scale,
            reader.study.eye.radius_m,
            known.thickness_m,
        )

        for _ in range(WARMING_FRAMES):
            self.read(frame, scale)

    def adopt(self, known: Known) -> float | None:
        """Read the next frames with the eye as learned, if the model can read such an
        eye.

        The wall's steepest stiffness is returned, N/m; None if it is not known or the
        eye was not adopted.
        """
        if self._reader.refusal(known) is not None:
            return None
        self._known = known
        return self._reader.steepest_n_m(known)

    def read(self, frame: Pixels, scale: PixelScale) -> Answer:
        """Read one raw frame (`Reader.read_live`); the scanner's refractive index takes
        precedence over the scale's.
        """
        scale = PixelScale(
            lateral_m=scale.lateral_m,
            depth_m=scale.depth_m,
            refractive_index=self._refractive_index,
        )
        return self._reader.read_live(frame, scale, self._known)
