"""From a study to a model: the response library or the data set that it learns from, and its training."""

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from scleraforce.dataset import Dataset, open_dataset
from scleraforce.errors import InputError
from scleraforce.library import Library
from scleraforce.library.build import build_library
from scleraforce.library.cache import cached_library
from scleraforce.library.store import open_library
from scleraforce.notebook.frames import load_model
from scleraforce.notebook.work import counting_for, simulate_slices, train_on_library, train_on_slices
from scleraforce.reader.answer import Reader
from scleraforce.study import Study
from scleraforce.study.unused import refuse_unused


def library_of(
    study: Study | None = None,
    *,
    out: str | PathLike[str] | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Library:
    """Return the response library of a study: how its walls bend, for any thickness, pressure and modulus.

    The first time it is computed, which takes a minute; then it comes from the user's cache.

    Args:
        study: the study; None: the paper's.
        out: where to put it instead of the cache; an interrupted one is completed there.
        workers: processes that compute it; None: one for each core.
        progress: called with the number of load paths that are newly done.

    Raises:
        InputError: `out` holds something else, or the study has keys that a library does not use.
        SolverError: a load path could not be followed.

    >>> import scleraforce as sf
    >>> library = sf.library_of(sf.read_study("study.toml"))
    >>> print(f"a wall of {library.radius_m * 1e3:g} mm radius")
    a wall of 12 mm radius
    """
    study = study or Study()
    refuse_unused(study, "library")
    if out is None:
        return cached_library(study, workers=workers, progress=progress)
    build_library(study, Path(out), workers=workers, progress=progress)
    return open_library(out)


def generate(
    out: str | PathLike[str],
    study: Study | None = None,
    *,
    youngs_modulus_pa: float | None = None,
    mechanics: str | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Dataset:
    """Simulate the slices that a classifier learns from.

    Args:
        out: where the data set goes; an interrupted one of the same study is completed.
        study: the study; None: the paper's.
        youngs_modulus_pa: of the walls; None: the study's.
        mechanics: "linear" or "finite-strain" (drawn from the library); None: the study's.
        workers: processes of linear mechanics; None: one for each core.
        progress: called with the number of slices that are newly done.

    Raises:
        InputError: `out` holds something else, or the study has keys that this mechanics does not use.

    >>> import scleraforce as sf
    >>> slices = sf.generate("slices", sf.read_study("study.toml"), mechanics="finite-strain")
    >>> slices.images
    200
    """
    counting = counting_for("generate", progress)
    simulate_slices(
        study or Study(),
        Path(out),
        counting,
        mechanics=mechanics,
        youngs_modulus_pa=youngs_modulus_pa,
        workers=workers,
    )
    return open_dataset(out)


def train(
    source: Library | Dataset,
    out: str | PathLike[str],
    study: Study | None = None,
    *,
    search: bool = False,
    progress: Callable[[int], object] | None = None,
) -> Reader:
    """Train a model, write its folder and return it loaded; needs the extra `train` (PyTorch).

    Args:
        source: a response library for a force reader, a data set for a classifier.
        out: the folder to make; it must not exist.
        study: whose `[reader]` or `[network]` counts; None: the paper's, or the data set's.
        search: try all sizes of the grid and keep the best (classifier).
        progress: called with 1 after each epoch.

    Returns:
        The model; `record["metrics"]` has what it reached on its validation samples.

    Raises:
        InputError: `out` exists, PyTorch is missing, source and study do not go together, or the study has keys that a
            library does not use.
        SolverError: the training diverged.

    >>> import scleraforce as sf
    >>> model = sf.train(sf.open_dataset("dataset"), "classifier")
    >>> 0.0 <= model.record["metrics"]["validation_accuracy"] <= 1.0
    True
    """
    counting = counting_for("epochs", progress)
    if isinstance(source, Library):
        if search:
            raise InputError("search: is for classifiers; a reader has the sizes of [reader]")
        train_on_library(source, study or Study(), Path(out), counting)
    elif isinstance(source, Dataset):
        train_on_slices(source, None if study is None else study.network, Path(out), counting, search=search)
    else:
        raise InputError(f"source: found {type(source).__name__}; give a library (library_of) or a data set (generate)")
    return load_model(out)
