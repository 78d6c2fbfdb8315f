"""Calibrate on recordings with force logs, and fit a reader's intervals to them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from scleraforce.base.errors import InputError
from scleraforce.calibration.calibrate import (
    STIFFENING,
    calibrate_recordings,
    calibration_passes,
)
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.calibration.calibration_checks import (
    check_recording,
    checked_calibration,
)
from scleraforce.calibration.evaluation import recording_scores
from scleraforce.calibration.seen_frames import CalibrationSettings
from scleraforce.calibration.stiffness_from_shape import calibrate_without_force
from scleraforce.front.api.progress import Counting, counting_for
from scleraforce.front.api.reading_frames import (
    Given,
    finder_of,
    opened_recordings,
    summary_of_calibration,
)
from scleraforce.library import Library, load_library
from scleraforce.library.library_plan import plan_library
from scleraforce.reading.interval_widths import (
    IntervalStretch,
    find_stretches,
    intervals_record,
    stretched_factors,
)
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.trained_ranges import CLASSIFIER, READER, untrained_values
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records import model_folder
from scleraforce.records.calibration_file import (
    parse_calibration_file,
    population_modulus,
    summary_of,
    write_calibration,
)
from scleraforce.records.fields import check_quantity
from scleraforce.records.recording_info import known_of_recording
from scleraforce.records.study import Study, refuse_unused, study_hash
from scleraforce.records.study_of_eye import check_relaxation

if TYPE_CHECKING:
    from scleraforce.front.api.reading_frames import GivenCalibration

MECHANICS = ("finite-strain", "linear")
PARAMETERS = ("e", "stiffening", "iop", "thickness", "gap")


def calibrate(
    recordings: Given | Sequence[Given],
    study: Study | None = None,
    *,
    frames: int | None = None,
    parameters: Sequence[str] | None = None,
    mechanics: str = "finite-strain",
    without_force: bool = False,
    calibration: "GivenCalibration | None" = None,
    wall_finder: str | PathLike[str] | None = model_folder.SHIPPED_WALL_FINDER,
    thickness_m: float | None = None,
    relaxation: Sequence[Sequence[float]] | None = None,
    out: str | PathLike[str] | None = None,
    note: Callable[[str], object] | None = None,
    progress: Callable[[int], object] | None = None,
    counting: Counting | None = None,
) -> Calibration:
    """Estimate Young's modulus of each eye from its recordings.

    Args:
        recordings: one or more, opened or as folders, with force logs unless
            `without_force`; recordings of one eye add up.
        study: prior, filter and library; None: the paper's.
        frames: number of frames above 5 mN to take of each recording, of several planes
            moments; None: all. With `without_force`, the number of frames whose forces
            count as well; None: none.
        parameters: the uncertain ones of "e", "stiffening", "iop", "thickness", "gap";
            "e" among them. None: e and the stiffening, with linear mechanics e.
        mechanics: "finite-strain" (from the library), or the paper's "linear".
        without_force: find E by the shape of the dents beside the stated IOP; no force
            log is needed.
        calibration: with `without_force`, other eyes' calibration or its file: their
            population is the prior of E.
        wall_finder: model folder that checks the walls, by default the bundled one;
            None: nothing checks them.
        thickness_m: of the wall, of a single eye; None: the recordings'.
        relaxation: of the tissue: terms of a share of a held force that is lost and a
            time constant in s; (): elastic; None: as the recordings say, else by the
            holds of their logs.
        out: a file to write as well; it must not exist.
        note: called, at the start, with a sentence for each quantity that a reader of
            the study would not read.
        progress: called with 1 after each frame.
        counting: for bars, in place of `progress`: a context manager of a title
            ("library", "frames") and its steps.

    Returns:
        `eyes` by name, each with `mean_pa`, `sd_pa` and `status`, and the mean and
        spread of the `population`.

    Raises:
        InputError: a recording cannot be calibrated on or contradicts its frames (the
            message names the likely cause), a reader would refuse them, `out` exists,
            the study has
            keys that this mechanics does not use, or `without_force` meets
            `parameters`, linear mechanics, or a recording that does not state the IOP.

    >>> import scleraforce as sf
    >>> calibration = sf.calibrate("eye-a", sf.read_study("study.toml"), frames=2)
    >>> print(f"{calibration.eyes['eye-a'].mean_pa / 1e6:.1f} MPa")
    0.3 MPa
    """
    if mechanics not in MECHANICS:
        raise InputError(f"mechanics: {mechanics!r}; give {' or '.join(MECHANICS)}")

    names = set(parameters or "e")
    if parameters is not None and (
        "e" not in names or names - set(PARAMETERS) or len(names) < len(parameters)
    ):
        others = ", ".join(repr(name) for name in PARAMETERS[1:])
        raise InputError(
            f"parameters: {parameters!r}; give a list of 'e' and of others that are"
            f" uncertain: {others}"
        )
    if without_force and (mechanics == "linear" or parameters is not None):
        raise InputError(
            "without_force: finds E at finite strain; leave out parameters and"
            " mechanics"
        )
    if calibration is not None and not without_force:
        raise InputError("calibration: is the prior of without_force; leave it out")
    if relaxation is not None:
        check_relaxation(relaxation)
        if mechanics == "linear":
            raise InputError("relaxation: linear mechanics knows none; leave it out")
    if frames is not None and frames < 1:
        raise InputError(f"frames: {frames}; give at least 1")
    if thickness_m is not None:
        check_quantity("thickness_m", thickness_m)
    if out is not None and Path(out).exists():
        raise InputError(f"{out}: exists already; remove it or choose another name")

    study = study or Study()
    counting = counting or counting_for(progress, "frames")
    refuse_unused(study, "calibrate", mechanics)

    sought = None if parameters is None else tuple(parameters)
    if study.tissue.stiffening > 0.0 and (sought is None or STIFFENING in sought):
        way = "leave it out, or seek e alone (parameters e)"
        raise InputError(f"study: tissue.stiffening: is sought in the frames; {way}")

    each = _with_thickness(opened_recordings(recordings), thickness_m)
    if relaxation is not None:
        each = [_relaxing(one, relaxation) for one in each]

    kind = CLASSIFIER if mechanics == "linear" else READER

    for recording in each:
        info = recording.info
        if info.eye.thickness_m is None:
            place = recording.path / "recording.toml"
            raise InputError(
                f"{place}: eye.thickness_m: missing; state it there, or give"
                " thickness_m"
            )

        for sentence in untrained_values(
            kind, study, known_of_recording(info), info.oct, info.needle.gauge
        ):
            if note is not None:
                note(f"{recording.path}: {sentence}")

    finder = finder_of(wall_finder)
    for recording in each:
        check_recording(recording, study, finder, with_forces=not without_force)
    library = library_for(study, mechanics, counting)
    passes = 1 if without_force else calibration_passes(library, sought)

    with counting(
        "frames", passes * sum(len(recording.frames) for recording in each)
    ) as advance:
        if without_force and library is not None:
            summary = (
                None if calibration is None else summary_of_calibration(calibration)
            )
            prior = None if summary is None else population_modulus(summary)
            stiffening = (
                study.tissue.stiffening
                if summary is None
                else summary.population_stiffening
            )
            settings = CalibrationSettings(
                study, library.for_stiffening(stiffening), ("e",), False, frames, finder
            )
            found = calibrate_without_force(
                each, settings, study_hash(study), prior, advance
            )
        else:
            by_force = (
                study,
                study_hash(study),
                library,
                sought,
                frames,
                advance,
                finder,
            )
            found = calibrate_recordings(each, *by_force)

    # A file that cannot be read back is not written.
    file = parse_calibration_file(
        json.dumps(found.to_dict(), allow_nan=False).encode(), "the calibration"
    )
    parse_calibration(file)
    if library is not None:
        found = checked_calibration(
            found, summary_of(file), each, study, library, finder
        )
    if out is not None:
        write_calibration(found.to_dict(), Path(out))

    return found


def library_for(
    study: Study, mechanics: str, counting: Counting, workers: int | None = None
) -> Library | None:
    """Return the library for finite strain (linear: None), the bundled one or the
    cache's; counts "library".
    """
    if mechanics == "linear":
        return None

    plan = plan_library(study)
    shipped = model_folder.read_folder(model_folder.SHIPPED_READER)
    if plan_library(model_folder.folder_study(shipped)).key == plan.key:
        return load_library(
            shipped.path / model_folder.LIBRARY_FILE,
            shipped.files[model_folder.LIBRARY_FILE],
        )

    # 260 ms: Zarr and the mechanics, not where the bundled library fits
    from scleraforce.library.library_store import cached_library

    with counting("library", plan.units) as advance:
        return cached_library(study, workers=workers, progress=advance)


def _with_thickness(
    recordings: list[Recording], thickness_m: float | None
) -> list[Recording]:
    if thickness_m is None:
        return recordings

    eyes = {recording.info.eye.id for recording in recordings}
    if len(eyes) > 1:
        raise InputError(
            f"thickness_m: of one eye; the recordings are of {', '.join(sorted(eyes))}"
        )

    return [
        replace(
            one,
            info=replace(one.info, eye=replace(one.info.eye, thickness_m=thickness_m)),
        )
        for one in recordings
    ]


def _relaxing(recording: Recording, relaxation: Sequence[Sequence[float]]) -> Recording:
    terms = tuple((float(share), float(time_s)) for share, time_s in relaxation)
    eye = replace(recording.info.eye, relaxation=terms)
    return replace(recording, info=replace(recording.info, eye=eye))


def recalibrate_intervals(
    model: str | PathLike[str],
    recordings: Sequence[str | PathLike[str]],
    out: Path,
    counting: Counting,
    *,
    frames: int,
    wall_finder: str | PathLike[str] | None,
    note: Callable[[str], object] = lambda _: None,
) -> tuple[IntervalStretch, ...]:
    """Write a reader whose intervals hold on recordings with force logs: counts
    "calibration" and "reading".

    Each eye is calibrated on `frames` of each recording; the others are read, and their
    scores stretch the intervals. Few eyes only widen them
    (`reading.interval_widths.FEW_EYES`). `note` is as for `calibrate`.
    """
    model_folder.check_place(out)
    reader = load_force_reader(model, finder=wall_finder)
    folder = model_folder.read_folder(model)
    study = reader.study
    each = opened_recordings(recordings)
    count = sum(len(recording.frames) for recording in each)

    for recording in each:
        info = recording.info
        for sentence in reader.limits(
            known_of_recording(info), info.oct, info.needle.gauge
        ):
            note(f"{recording.path}: {sentence}")

    finder = finder_of(wall_finder)
    for recording in each:
        check_recording(recording, study, finder)
    with counting(
        "calibration", count * calibration_passes(reader.library, None)
    ) as advance:
        calibration = calibrate_recordings(
            each,
            study,
            study_hash(study),
            reader.library,
            frames=frames,
            progress=advance,
            finder=finder,
        )

    summary = summary_of_calibration(calibration)
    checked_calibration(calibration, summary, each, study, reader.library, finder)
    with counting("reading", count) as advance:
        scores = [
            found
            for recording in each
            for found in recording_scores(reader, recording, summary, advance)
        ]

    if not scores:
        raise InputError(
            f"{each[0].path}: no frame with a known force is left to read; take fewer"
            " `frames`"
        )

    source = "recordings of " + ", ".join(
        sorted({recording.info.eye.id for recording in each})
    )
    record = {
        key: value
        for key, value in folder.record.items()
        if key not in ("format", "files")
    }
    changes = find_stretches(scores)
    record["intervals"] = intervals_record(
        scores, stretched_factors(reader.factors, changes), source
    )
    more = {
        name: content
        for name, content in folder.files.items()
        if name not in model_folder.COMMON_FILES
    }
    study_toml, card = (
        folder.files[name].decode()
        for name in (model_folder.STUDY_FILE, model_folder.CARD_FILE)
    )
    card += (
        f"\n## Intervals\nStretched to hold on {source}; `intervals` of model.json has"
        " the factors.\n"
    )
    model_folder.write_folder(
        out, folder.files[model_folder.NETWORK_FILE], study_toml, card, record, more
    )

    return changes
