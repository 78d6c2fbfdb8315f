"""Calibrate on recordings with force logs, and fit a reader's intervals to them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

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
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.calibration.seen_frames import CalibrationSettings
from scleraforce.calibration.stiffness_from_shape import calibrate_without_force
from scleraforce.front.api.opened_frames import finder_of
from scleraforce.front.api.progress import Counting, Progress, counting_for
from scleraforce.front.api.reading_frames import (
    Given,
    opened_recordings,
    summary_of_calibration,
)
from scleraforce.front.api.shorthand import declared_setup
from scleraforce.library import Library, load_library
from scleraforce.library.library_plan import plan_library
from scleraforce.reading.interval_widths import (
    IntervalStretch,
    find_stretches,
    intervals_record,
    stretched_factors,
)
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.trained_ranges import (
    CLASSIFIER,
    READER,
    radius_fault,
    untrained_values,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records import model_folder
from scleraforce.records.calibration_file import (
    CalibrationFile,
    population_modulus,
    summary_of,
    write_calibration,
)
from scleraforce.records.eye import FOUND_BY_CALIBRATION, Eye
from scleraforce.records.fields import check_kind
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, refuse_unused, study_hash

if TYPE_CHECKING:
    from scleraforce.front.api.reading_frames import GivenCalibration

LINEAR = "linear"
# each estimator with its mechanics of the wall
ESTIMATORS = {"ours": "finite-strain", "roukf": LINEAR}
MECHANICS = tuple(ESTIMATORS.values())
PARAMETERS = ("e", "stiffening", "iop", "thickness", "gap")


@dataclass(frozen=True, kw_only=True)
class CalibrationMethod:
    """How a calibration finds its eyes.

    Attributes:
        estimator: "ours" fits all frames and their forces at once; "roukf", the
            paper's filter, takes them one by one. None: that of the mechanics.
        mechanics: "finite-strain" (from the library) of ours, "linear" of roukf. None:
            that of the estimator; without one finite strain.
        parameters: the uncertain ones of "e", "stiffening", "iop", "thickness", "gap";
            "e" among them. None: e and the stiffening, with linear mechanics e.
        without_force: find E by the shape of the dents beside the stated IOP; no force
            log is needed.
        prior: with `without_force`, other eyes' calibration or its file: their
            population is the prior of E. None: the study's.
        wall_finder: model folder that checks the walls, by default the bundled one;
            None: nothing checks them.

    Raises:
        InputError: no such estimator, mechanics or parameters, or they do not go
            together.

    >>> import scleraforce as sf
    >>> sf.CalibrationMethod(parameters=["e", "thickness"]).sought
    ('e', 'thickness')
    >>> sf.CalibrationMethod(estimator="roukf").wall_mechanics
    'linear'
    """

    estimator: str | None = None
    mechanics: str | None = None
    parameters: Sequence[str] | None = None
    without_force: bool = False
    prior: "GivenCalibration | None" = None
    wall_finder: str | PathLike[str] | None = model_folder.SHIPPED_WALL_FINDER

    def __post_init__(self) -> None:
        self._check_mechanics()
        parameters = self.parameters
        names = set(parameters or "e")
        if parameters is not None and (
            "e" not in names or names - set(PARAMETERS) or len(names) < len(parameters)
        ):
            others = ", ".join(repr(name) for name in PARAMETERS[1:])
            raise InputError(
                f"parameters: {parameters!r}; give a list of 'e' and of others that are"
                f" uncertain: {others}"
            )
        is_linear = self.wall_mechanics == LINEAR
        if self.without_force and (is_linear or parameters is not None):
            raise InputError(
                "`without_force`: finds E at finite strain; leave out `estimator`,"
                " `mechanics` and `parameters`"
            )
        if self.prior is not None and not self.without_force:
            raise InputError("`prior`: is the prior of without_force; leave it out")

    def _check_mechanics(self) -> None:
        """Raise an `InputError` if an estimator does not have the stated mechanics."""
        estimator = self.estimator
        mechanics = self.mechanics
        if estimator is not None and estimator not in ESTIMATORS:
            names = " or ".join(ESTIMATORS)
            raise InputError(f"`estimator`: {estimator!r}; give {names}")
        if mechanics is not None and mechanics not in MECHANICS:
            names = " or ".join(MECHANICS)
            raise InputError(f"mechanics: {mechanics!r}; give {names}")

        own = self.wall_mechanics if estimator is None else ESTIMATORS[estimator]
        if mechanics not in (None, own):
            raise InputError(
                f"`estimator`: {estimator} has {own} mechanics, not {mechanics}; leave"
                " out `mechanics` or `estimator`"
            )

    @property
    def wall_mechanics(self) -> str:
        """The mechanics of the walls: as stated, else the estimator's."""
        return self.mechanics or ESTIMATORS[self.estimator or "ours"]

    @property
    def sought(self) -> tuple[str, ...] | None:
        """The uncertain parameters; None: the usual ones."""
        return None if self.parameters is None else tuple(self.parameters)


class CalibrationShorthand(TypedDict, total=False):
    """Fields of a `CalibrationMethod`, and the thickness of an `Eye`."""

    estimator: str | None
    mechanics: str | None
    parameters: Sequence[str] | None
    without_force: bool
    thickness_m: float | None


def calibrate(
    recordings: Given | Sequence[Given],
    study: Study | None = None,
    *,
    frames: int | None = None,
    method: CalibrationMethod | None = None,
    eye: Eye | None = None,
    out: str | PathLike[str] | None = None,
    note: Callable[[str], object] | None = None,
    progress: Progress | None = None,
    **short: Unpack[CalibrationShorthand],
) -> Calibration:
    """Estimate Young's modulus of each eye from its recordings.

    Args:
        recordings: one or more, opened or as folders, with force logs unless the method
            is `without_force`; recordings of one eye add up.
        study: prior, library and filter; None: the paper's.
        frames: number of frames above 5 mN to take of each recording, of several planes
            moments; None: all. With `without_force`, the number of frames whose forces
            count as well; None: none.
        method: estimator, what is uncertain, and whether forces are used.
        eye: what is known of a single eye, in place of what its recordings state; None:
            the recordings'. Where neither states the relaxation, it is estimated from
            the holds of the logs.
        out: a file to write as well; it must not exist.
        note: called, at the start, with a sentence for each quantity that a reader of
            the study would not read, and for each input that is missing, with what it
            costs; the calibration's `remarks` have them, too.
        progress: called with 1 after each frame.
        short: `estimator`, `mechanics`, `parameters`, `without_force` in place of a
            method, and the eye's `thickness_m`.

    Returns:
        `eyes` by name, each with `mean_pa`, `sd_pa` and `status`, the mean and spread
        of the `population`, and `remarks`.

    Raises:
        InputError: a recording cannot be calibrated on or contradicts its frames (the
            message names the likely cause), a reader would refuse them, `out` exists,
            the study has keys that this mechanics does not use, or a recording without
            forces does not state the IOP.

    >>> import scleraforce as sf
    >>> calibration = sf.calibrate("eye-a", sf.read_study("study.toml"), frames=2)
    >>> print(f"{calibration.eyes['eye-a'].mean_pa / 1e6:.1f} MPa")
    0.3 MPa
    """
    options: dict[str, Any] = dict(short)
    eye = declared_setup(
        eye, None, None, {"thickness_m": options.pop("thickness_m", None)}
    ).eye
    method = _method(method, options)
    mechanics = method.wall_mechanics
    without_force = method.without_force

    if eye.relaxation is not None and mechanics == LINEAR:
        raise InputError("relaxation: linear mechanics knows none; leave it out")
    if frames is not None and frames < 1:
        raise InputError(f"frames: {frames}; give at least 1")
    if out is not None and Path(out).exists():
        raise InputError(f"{out}: exists already; remove it or choose another name")

    study = study or Study()
    check_kind("study", study, Study, 'read_study("study.toml")')
    counting = counting_for(progress, "frames")
    refuse_unused(study, "calibrate", mechanics)

    sought = method.sought
    if study.tissue.stiffening > 0.0 and (sought is None or STIFFENING in sought):
        way = "leave it out, or seek e alone (parameters e)"
        raise InputError(f"study: tissue.stiffening: is sought in the frames; {way}")

    each = _of_eye(opened_recordings(recordings), eye)
    kind = CLASSIFIER if mechanics == LINEAR else READER
    of_inputs = list[Remark]()

    for recording in each:
        info = recording.info
        if info.eye.thickness_m is None:
            place = recording.path / "recording.toml"
            raise InputError(
                f"{place}: eye.thickness_m: missing; state it there, or give"
                " thickness_m"
            )

        radius_m = info.eye.radius_m
        if radius_m is not None and mechanics == LINEAR:
            raise InputError(
                f"{recording.path}: eye.radius_m: linear mechanics takes the study's;"
                " leave it out"
            )
        if fault := radius_fault(radius_m, study.eye.radius_m):
            raise InputError(f"{recording.path}: eye.radius_m: {fault}")

        on_inputs = _input_remarks(recording, kind, study, not without_force)
        of_inputs += on_inputs
        if note is not None:
            for remark in on_inputs:
                note(str(remark))

    walls = FoundWalls(finder_of(method.wall_finder))
    for recording in each:
        check_recording(recording, study, walls, with_forces=not without_force)
    library = library_for(study, mechanics, counting)
    passes = 1 if without_force else calibration_passes(library, sought)

    with counting(
        "frames", passes * sum(len(recording.frames) for recording in each)
    ) as advance:
        if without_force and library is not None:
            summary = (
                None if method.prior is None else summary_of_calibration(method.prior)
            )
            prior = None if summary is None else population_modulus(summary)
            stiffening = (
                study.tissue.stiffening
                if summary is None
                else summary.population_stiffening
            )
            settings = CalibrationSettings(
                study, library.for_stiffening(stiffening), ("e",), False, frames, walls
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
                walls,
            )
            found = calibrate_recordings(each, *by_force)

    found = replace(found, of_inputs=tuple(of_inputs))
    # A file that cannot be read back is not written.
    file = CalibrationFile("the calibration", found.to_dict())
    parse_calibration(file)
    if library is not None:
        found = checked_calibration(
            found, summary_of(file), each, study, library, walls
        )
    if out is not None:
        write_calibration(found.to_dict(), Path(out))

    return found


def _input_remarks(
    recording: Recording, kind: str, study: Study, by_holds: bool
) -> tuple[Remark, ...]:
    """Return remarks on what a recording states: outside a reader's training, or
    missing.

    A calibration `by_holds` of the log looks for the relaxation itself, and says what
    stays open.
    """
    info = recording.info
    outside = untrained_values(kind, study, info.setup, info.scan, info.needle.gauge)
    missing = missing_inputs(
        info.setup, forces=recording.forces is not None, classifier=kind == CLASSIFIER
    )
    open_inputs = (
        remark for remark in missing if not (by_holds and "relaxation" in remark.fields)
    )
    return tuple(remark.on(recording.path) for remark in (*outside, *open_inputs))


def library_for(
    study: Study, mechanics: str, counting: Counting, workers: int | None = None
) -> Library | None:
    """Return the library for finite strain (linear: None), the bundled one or the
    cache's; counts "library".
    """
    if mechanics == LINEAR:
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


def _method(
    method: CalibrationMethod | None, options: Mapping[str, Any]
) -> CalibrationMethod:
    """Return the method of a record or of keywords."""
    names = {item.name for item in fields(CalibrationMethod)}
    for name in options:
        if name not in names:
            raise TypeError(f"unexpected keyword {name!r}; docs/python.md lists them")
        if method is not None:
            raise InputError(
                f"{name}: stated beside a method; give it there, or leave the method"
                " out"
            )

    if method is None:
        return CalibrationMethod(**options)
    check_kind("method", method, CalibrationMethod, "CalibrationMethod()")
    return method


def _of_eye(recordings: list[Recording], eye: Eye) -> list[Recording]:
    """Return recordings with what is known of their single eye."""
    given = {
        item.name: value
        for item in fields(eye)
        if (value := getattr(eye, item.name)) is not None
    }
    for name in FOUND_BY_CALIBRATION:
        if name in given:
            raise InputError(f"{name}: is what a calibration finds; leave it out")

    eyes = {recording.info.eye_name for recording in recordings}
    if given and len(eyes) > 1:
        raise InputError(
            f"{next(iter(given))}: of one eye; the recordings are of"
            f" {', '.join(sorted(eyes))}"
        )
    if eye.name is not None and eye.name not in eyes:
        raise InputError(
            f"eye: {eye.name!r}; the recordings are of {', '.join(sorted(eyes))}"
        )

    return [
        replace(
            one,
            info=replace(one.info, eye=Setup(eye=eye).completed_by(one.info.setup).eye),
        )
        for one in recordings
    ]


def recalibrate_intervals(
    model: str | PathLike[str],
    recordings: Sequence[str | PathLike[str]],
    out: Path,
    counting: Counting,
    *,
    frames: int,
    wall_finder: str | PathLike[str] | None,
    note: Callable[[Remark], object] = lambda _: None,
) -> tuple[IntervalStretch, ...]:
    """Write a reader whose intervals hold on recordings with force logs: counts
    "calibration" and "reading".

    Each eye is calibrated on `frames` of each recording; the others are read, and their
    scores stretch the intervals. Few eyes only widen them
    (`reading.interval_widths.FEW_EYES`). `note` is called, at the start, with the
    remarks on what the recordings state.
    """
    model_folder.check_place(out)
    reader = load_force_reader(model, finder=wall_finder)
    folder = model_folder.read_folder(model)
    study = reader.study
    each = opened_recordings(recordings)
    count = sum(len(recording.frames) for recording in each)

    for recording in each:
        for remark in _input_remarks(recording, reader.kind, study, True):
            note(remark)

    walls = FoundWalls(finder_of(wall_finder))
    for recording in each:
        check_recording(recording, study, walls)
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
            walls=walls,
        )

    summary = summary_of_calibration(calibration)
    checked_calibration(calibration, summary, each, study, reader.library, walls)
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
        sorted({recording.info.eye_name for recording in each})
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
