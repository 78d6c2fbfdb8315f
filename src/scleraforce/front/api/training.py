"""From a study to a model: the response library or the data set that it learns from,
and its training.
"""

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from scleraforce.base.errors import InputError
from scleraforce.front.api.calibrating import library_for
from scleraforce.front.api.progress import Progress, counting_for
from scleraforce.front.api.reading_frames import load_model
from scleraforce.lab.training.slice_dataset import (
    Dataset,
    generate_dataset,
    open_dataset,
)
from scleraforce.library import Library
from scleraforce.library.library_store import (
    build_library,
    cached_library,
    open_library,
)
from scleraforce.reading.reading_models import Reader
from scleraforce.records.study import Study, refuse_unused


def library_of(
    study: Study | None = None,
    *,
    out: str | PathLike[str] | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Library:
    """Return the response library of a study: how its walls bend, for any thickness,
    pressure and modulus.

    The first time it is computed, which takes a minute; then it comes from the user's
    cache.

    Args:
        study: the study; None: the paper's.
        out: where to put it instead of the cache; an interrupted one is completed
            there.
        workers: processes that compute it; None: one for each core.
        progress: called with the number of load paths that are newly done.

    Raises:
        InputError: `out` holds something else, or the study has keys that a library
            does not use.
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
        mechanics: "linear" or "finite-strain" (drawn from the library); None: the
            study's.
        workers: processes of linear mechanics; None: one for each core.
        progress: called with the number of slices that are newly done.

    Raises:
        InputError: `out` holds something else, or the study has keys that this
            mechanics does not use.

    >>> import scleraforce as sf
    >>> study = sf.read_study("study.toml")
    >>> slices = sf.generate("slices", study, mechanics="finite-strain")
    >>> slices.images
    200
    """
    study = study or Study()
    kind = mechanics or study.mechanics.kind
    refuse_unused(study, "generate", kind)
    library = library_for(study, kind, counting_for(None, ""), workers)
    generate_dataset(
        study,
        Path(out),
        youngs_modulus_pa=youngs_modulus_pa,
        library=library,
        workers=workers,
        progress=progress,
    )

    return open_dataset(out)


def train(
    source: Library | Dataset,
    out: str | PathLike[str],
    study: Study | None = None,
    *,
    kind: str = "reader",
    search: bool = False,
    workers: int | None = None,
    device: str = "auto",
    progress: Progress | None = None,
) -> Reader:
    """Train a model, write its folder and return it loaded; needs the extra `train`
    (PyTorch).

    Args:
        source: a response library for a force reader, a data set for a classifier.
        out: the folder to make; it must not exist.
        study: whose `[reader]`, `[raw_reader]` or `[network]` counts; None: the
            paper's, or the data set's.
        kind: "reader", or "raw-reader", which learns from raw frames of the library's
            walls.
        search: try all sizes of the grid and keep the best (classifier).
        workers: that try the sizes.
        device: "cpu", "cuda" (a GPU), or "auto": the GPU if PyTorch finds one.
        progress: called with 1 after each epoch.

    Returns:
        The model; `record["metrics"]` has its results on validation samples.

    Raises:
        InputError: `out` exists, PyTorch is missing, source and study do not go
            together, or the study has keys that a library does not use.
        SolverError: the training diverged.

    >>> import scleraforce as sf
    >>> model = sf.train(sf.open_dataset("dataset"), "classifier")
    >>> 0.0 <= model.record["metrics"]["validation_accuracy"] <= 1.0
    True
    """
    counting = counting_for(progress, "epochs")
    if isinstance(source, Dataset):
        # 1,300 ms: PyTorch, not for `generate` and `library_of`
        from scleraforce.lab.training.classifier_training import grid
        from scleraforce.lab.training.trained_models import train_classifier

        network = source.study.network if study is None else study.network

        with counting(
            "epochs", network.epochs * (len(grid(network)) if search else 1)
        ) as advance:
            train_classifier(
                source,
                Path(out),
                network,
                search,
                advance,
                workers=workers,
                device=device,
            )

        return load_model(Path(out).absolute())  # not a bundled model of that name

    if not isinstance(source, Library):
        raise InputError(
            f"source: found {type(source).__name__}; give a library (library_of) or a"
            " data set (generate)"
        )
    if search:
        raise InputError(
            "search: is for classifiers; a reader has the sizes of [reader]"
        )
    if kind not in ("reader", "raw-reader"):
        raise InputError(f"kind: {kind!r}; give 'reader' or 'raw-reader'")

    study = study or Study()
    refuse_unused(study, f"train kind={kind}")
    # 1,100 ms: PyTorch, not for `generate` and `library_of`
    from scleraforce.lab.training.trained_models import train_raw_reader, train_reader

    if kind == "reader":
        reader = study.reader
        with (
            counting("epochs", reader.epochs) as advance,
            counting("eyes", reader.interval_eyes) as measured,
        ):
            train_reader(
                source,
                study,
                Path(out),
                progress=advance,
                measured=measured,
                device=device,
            )
    else:
        raw = study.raw_reader
        with (
            counting("epochs", raw.slice_epochs) as advance,
            counting("batches", raw.batches) as learned,
            counting("eyes", raw.interval_eyes) as measured,
        ):
            train_raw_reader(
                source,
                study,
                Path(out),
                progress=advance,
                learned=learned,
                measured=measured,
                device=device,
            )

    return load_model(Path(out).absolute())  # not a bundled model of that name
