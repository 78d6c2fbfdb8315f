"""The work that commands and notebooks share: what decides its result stands here, once.

Commands show bars and notebooks call the `progress` of their user, so whoever asks for work says how it is counted.
Each function imports the rooms that it needs: they take seconds, PyTorch most of them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from scleraforce.errors import InputError
from scleraforce.recording.files import Recording, read_recording
from scleraforce.study import NetworkStudy, Study, study_hash
from scleraforce.study.unused import refuse_unused

if TYPE_CHECKING:
    from scleraforce.calibration.calibrate import Calibration
    from scleraforce.dataset import CalibratedModulus, Dataset, Generation
    from scleraforce.learning.classifier.train import Trained
    from scleraforce.learning.reader.train import TrainedReader
    from scleraforce.library import Library

__all__ = [
    "Counting",
    "Given",
    "calibrate_eyes",
    "counting_for",
    "library_for",
    "opened",
    "simulate_slices",
    "train_on_library",
    "train_on_slices",
]

Given = Recording | str | PathLike[str]
# Of work with a title and a number of steps: entered around it, it gives what is called with the steps newly done.
Counting = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]


def counting_for(title: str, progress: Callable[[int], object] | None) -> Counting:
    """Return a counting that tells `progress` of the work with one title, and nobody of any other."""

    @contextmanager
    def counting(name: str, _total: int) -> Iterator[Callable[[int], None]]:
        def advance(count: int) -> None:
            if progress is not None and name == title:
                progress(count)

        yield advance

    return counting


def opened(given: Given | Sequence[Given]) -> list[Recording]:
    """Return recordings, those that are folders read.

    Raises:
        InputError: there is none, or one cannot be read.
    """
    each = [given] if isinstance(given, Recording | str | PathLike) else list(given)
    if not each:
        raise InputError("recordings: none; give at least one")
    return [entry if isinstance(entry, Recording) else read_recording(entry) for entry in each]


def library_for(study: Study, mechanics: str, counting: Counting) -> "Library | None":
    """Return the library that finite strain draws from, from the user's cache; linear mechanics needs None.

    Raises:
        InputError: the cache cannot be written.
        SolverError: a load path could not be followed.
    """
    if mechanics == "linear":
        return None
    from scleraforce.library.cache import cached_library
    from scleraforce.library.plan import plan_library

    with counting("library", plan_library(study).units) as advance:
        return cached_library(study, progress=advance)


def calibrate_eyes(
    recordings: Given | Sequence[Given],
    study: Study,
    counting: Counting,
    *,
    mechanics: str,
    parameters: Sequence[str],
    frames: int | None,
    earlier: "Calibration | None",
) -> "Calibration":
    """Calibrate every eye on its recordings: counts "library", where finite strain needs one, and "frames".

    The arguments are those of `sf.calibrate`, checked.

    Raises:
        InputError: a recording cannot be calibrated on, or the study has keys that this mechanics does not use.
    """
    from scleraforce.calibration.calibrate import calibrate_recordings

    refuse_unused(study, "calibrate", mechanics)
    each = opened(recordings)
    library = library_for(study, mechanics, counting)
    with counting("frames", sum(len(recording.frames) for recording in each)) as advance:
        return calibrate_recordings(
            each, study, study_hash(study), library, tuple(parameters), frames, earlier, advance
        )


def simulate_slices(
    study: Study,
    out: Path,
    counting: Counting,
    *,
    mechanics: str | None,
    youngs_modulus_pa: float | None = None,
    calibration: "CalibratedModulus | None" = None,
    workers: int | None,
) -> "Generation":
    """Simulate the data set of a study: counts "library", where finite strain needs one, and "generate".

    The arguments are those of `generate_dataset`; mechanics: None: the study's.

    Raises:
        InputError: `out` holds something else, or the study has keys that this mechanics does not use.
    """
    from scleraforce.dataset.generate import generate_dataset

    kind = mechanics or study.mechanics.kind
    refuse_unused(study, "generate", kind)
    library = library_for(study, kind, counting)
    with counting("generate", sum(group.images for group in study.dataset.group)) as advance:
        return generate_dataset(
            study,
            out,
            youngs_modulus_pa=youngs_modulus_pa,
            calibration=calibration,
            library=library,
            workers=workers,
            progress=advance,
        )


def train_on_library(library: "Library", study: Study, out: Path, counting: Counting) -> "TrainedReader":
    """Train a force reader and write its folder: counts "epochs".

    Raises:
        InputError: as of `sf.train`.
        SolverError: the training diverged.
    """
    refuse_unused(study, "train --kind reader")
    from scleraforce.learning.reader.train import train_reader

    with counting("epochs", study.reader.epochs) as advance:
        return train_reader(library, study, out, progress=advance)


def train_on_slices(
    dataset: "Dataset", network: NetworkStudy | None, out: Path, counting: Counting, *, search: bool
) -> "Trained":
    """Train a classifier, of the data set's network where None is given, and write its folder: counts "epochs".

    Raises:
        InputError: as of `sf.train`.
        SolverError: the training diverged.
    """
    from scleraforce.learning.classifier.search import grid
    from scleraforce.learning.classifier.train import train_classifier

    network = network or dataset.study.network
    with counting("epochs", network.epochs * (len(grid(network)) if search else 1)) as advance:
        return train_classifier(dataset, out, network, search, advance)
