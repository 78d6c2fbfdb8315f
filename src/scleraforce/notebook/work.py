"""The work that commands and notebooks share: what decides its result stands here, once.

Commands show bars and notebooks call the `progress` of their user, so whoever asks for work says how it is counted.
Each function imports the rooms that it needs: they take seconds, PyTorch most of them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from scleraforce.compiled import use_compiled_loops
from scleraforce.errors import InputError
from scleraforce.models.folder import LIBRARY_FILE, SHIPPED_READER, read_folder
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.study import NetworkStudy, Study, study_hash
from scleraforce.study.unused import refuse_unused

if TYPE_CHECKING:
    from scleraforce.calibration.result import Calibration
    from scleraforce.dataset import CalibratedModulus, Dataset, Generation
    from scleraforce.learning.classifier.train import Trained
    from scleraforce.learning.raw_reader.train import TrainedRawReader
    from scleraforce.learning.reader.train import TrainedReader
    from scleraforce.library import Library
    from scleraforce.reader.intervals import Stretch

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


def library_for(study: Study, mechanics: str, counting: Counting, workers: int | None = None) -> "Library | None":
    """Return the library that finite strain draws from; linear mechanics needs None.

    It is that of the reader that ships where that is of this study, else from the user's cache.

    Args:
        study: the study.
        mechanics: "linear" or "finite-strain".
        counting: of "library".
        workers: that solve it where it is not there; None: a process for each core.

    Raises:
        InputError: the cache cannot be written.
        SolverError: a load path could not be followed.
    """
    if mechanics == "linear":
        return None
    from scleraforce.library.cache import cached_library
    from scleraforce.library.files import load_library
    from scleraforce.library.plan import plan_library
    from scleraforce.models.session import folder_study

    plan, shipped = plan_library(study), read_folder(SHIPPED_READER)
    if plan_library(folder_study(shipped)).key == plan.key:
        return load_library(shipped.path / LIBRARY_FILE, shipped.files[LIBRARY_FILE])
    with counting("library", plan.units) as advance:
        return cached_library(study, workers=workers, progress=advance)


def calibrate_eyes(
    recordings: Given | Sequence[Given],
    study: Study,
    counting: Counting,
    *,
    mechanics: str,
    parameters: Sequence[str] | None,
    frames: int | None,
    earlier: "Calibration | None",
    wall_finder: str | PathLike[str] | None,
    thickness_m: float | None = None,
    note: Callable[[str], object] = lambda _: None,
) -> "Calibration":
    """Calibrate every eye on its recordings: counts "library", where finite strain needs one, and "frames".

    The arguments are those of `sf.calibrate`, checked. `note` is called, before the work begins, with a sentence for
    each quantity of a recording that a reader of the study would not read.

    Raises:
        InputError: a recording cannot be calibrated on, or the study has keys that this mechanics does not use.
    """
    from scleraforce.calibration.calibrate import STIFFENING, calibrate_recordings, calibration_passes
    from scleraforce.known.eye import known_of_recording
    from scleraforce.reader.limits import slice_limits, wall_limits
    from scleraforce.reader.model import load_wall_finder

    refuse_unused(study, "calibrate", mechanics)
    sought = None if parameters is None else tuple(parameters)
    if study.tissue.stiffening > 0.0 and (sought is None or STIFFENING in sought):
        raise InputError(
            "study: tissue.stiffening: is sought in the frames; leave it out, or seek e alone (parameters e)"
        )
    use_compiled_loops()
    each = _with_thickness(opened(recordings), thickness_m)
    limits = slice_limits if mechanics == "linear" else wall_limits
    for recording in each:
        info = recording.info
        if info.eye.thickness_m is None:
            place = recording.path / "recording.toml"
            raise InputError(f"{place}: eye.thickness_m: missing; state the wall's thickness there, or --thickness-um")
        for sentence in limits(study, known_of_recording(info), info.oct, info.needle.gauge):
            note(f"{recording.path}: {sentence}")
    finder = None if wall_finder is None else load_wall_finder(wall_finder)
    library = library_for(study, mechanics, counting)
    passes = calibration_passes(library, sought)
    with counting("frames", passes * sum(len(recording.frames) for recording in each)) as advance:
        return calibrate_recordings(each, study, study_hash(study), library, sought, frames, earlier, advance, finder)


def _with_thickness(recordings: list[Recording], thickness_m: float | None) -> list[Recording]:
    """Return recordings of one eye that state a thickness in place of their own; None: their own."""
    if thickness_m is None:
        return recordings
    eyes = {recording.info.eye.id for recording in recordings}
    if len(eyes) > 1:
        raise InputError(f"--thickness-um: is one eye's, and the recordings are of {', '.join(sorted(eyes))}")
    return [replace(one, info=replace(one.info, eye=replace(one.info.eye, thickness_m=thickness_m)))
            for one in recordings]  # fmt: skip


def recalibrate_intervals(
    model: str | PathLike[str],
    recordings: Sequence[str | PathLike[str]],
    out: Path,
    counting: Counting,
    *,
    frames: int,
    wall_finder: str | PathLike[str] | None,
    note: Callable[[str], object] = lambda _: None,
) -> "tuple[Stretch, ...]":
    """Write a reader whose intervals hold on recordings: counts "calibration" and "reading".

    Each eye is calibrated on so many of its frames; the others are read, and their scores stretch the intervals.
    Few eyes only widen them (`reader.intervals.FEW_EYES`).

    Args:
        model: folder of a reader.
        recordings: with force logs.
        out: the folder to make.
        counting: how the work is counted.
        frames: of each recording that calibrate its eye.
        wall_finder: model that checks the walls; None: nothing does.
        note: called at the start with a sentence for each quantity of a recording that the model does not read.

    Returns:
        How the readings of each method with each kind of modulus did, and by how much they are stretched.

    Raises:
        InputError: the model is no reader, a recording cannot be calibrated on, or leaves no frame to read.
    """
    from scleraforce.calibration.calibrate import calibrate_recordings, calibration_passes
    from scleraforce.known.eye import known_of_recording
    from scleraforce.models.folder import (
        CARD_FILE,
        COMMON_FILES,
        NETWORK_FILE,
        STUDY_FILE,
        check_place,
        read_folder,
        write_folder,
    )
    from scleraforce.notebook.frames import summary_of_calibration
    from scleraforce.reader.evaluate import recording_scores
    from scleraforce.reader.intervals import intervals_record, stretched, stretches
    from scleraforce.reader.model import load_force_reader, load_wall_finder

    check_place(out)
    use_compiled_loops()
    reader, folder, each = load_force_reader(model, finder=wall_finder), read_folder(Path(model)), opened(recordings)
    study, count = reader.study, sum(len(recording.frames) for recording in each)
    for recording in each:
        info = recording.info
        for sentence in reader.limits(known_of_recording(info), info.oct, info.needle.gauge):
            note(f"{recording.path}: {sentence}")
    finder = None if wall_finder is None else load_wall_finder(wall_finder)
    with counting("calibration", count * calibration_passes(reader.library, None)) as advance:
        calibration = calibrate_recordings(
            each, study, study_hash(study), reader.library, frames=frames, progress=advance, finder=finder
        )
    summary = summary_of_calibration(calibration)
    with counting("reading", count) as advance:
        scores = [found for recording in each for found in recording_scores(reader, recording, summary, advance)]
    if not scores:
        raise InputError(f"{each[0].path}: no frame with a known force is left to read; take fewer --frames")
    source = "recordings of " + ", ".join(sorted({recording.info.eye.id for recording in each}))
    record = {key: value for key, value in folder.record.items() if key not in ("format", "files")}
    changes = stretches(scores)
    record["intervals"] = intervals_record(scores, stretched(reader.factors, changes), source)
    more = {name: content for name, content in folder.files.items() if name not in COMMON_FILES}
    study_toml, card = (folder.files[name].decode() for name in (STUDY_FILE, CARD_FILE))
    card += f"\n## Intervals\nStretched to hold on {source}; `intervals` of model.json has the factors.\n"
    write_folder(out, folder.files[NETWORK_FILE], study_toml, card, record, more)
    return changes


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
    library = library_for(study, kind, counting, workers)
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
    """Train a force reader and write its folder: counts "epochs", then the "eyes" of its intervals.

    Raises:
        InputError: as of `sf.train`.
        SolverError: the training diverged.
    """
    refuse_unused(study, "train --kind reader")
    from scleraforce.learning.reader.train import train_reader

    reader = study.reader
    with counting("epochs", reader.epochs) as advance, counting("eyes", reader.interval_eyes) as measured:
        return train_reader(library, study, out, progress=advance, measured=measured)


def train_on_raw_frames(library: "Library", study: Study, out: Path, counting: Counting) -> "TrainedRawReader":
    """Train a raw reader and write its folder: counts "epochs" of slices, "batches" of raw frames, then "eyes".

    Raises:
        InputError: as of `sf.train`.
        SolverError: the training diverged.
    """
    refuse_unused(study, "train --kind raw-reader")
    from scleraforce.learning.raw_reader.train import train_raw_reader

    raw = study.raw_reader
    with (
        counting("epochs", raw.slice_epochs) as advance,
        counting("batches", raw.batches) as learned,
        counting("eyes", raw.interval_eyes) as measured,
    ):
        return train_raw_reader(library, study, out, progress=advance, learned=learned, measured=measured)


def train_on_slices(
    dataset: "Dataset",
    network: NetworkStudy | None,
    out: Path,
    counting: Counting,
    *,
    search: bool,
    workers: int | None = None,
) -> "Trained":
    """Train a classifier, of the data set's network where None is given, and write its folder: counts "epochs".

    With `search` it tries all sizes of the grid, by `workers` where they are given.

    Raises:
        InputError: as of `sf.train`.
        SolverError: the training diverged.
    """
    from scleraforce.learning.classifier.search import grid
    from scleraforce.learning.classifier.train import train_classifier

    network = network or dataset.study.network
    with counting("epochs", network.epochs * (len(grid(network)) if search else 1)) as advance:
        return train_classifier(dataset, out, network, search, advance, workers=workers)
